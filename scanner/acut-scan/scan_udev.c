/*
 * udev rules out of profiles: "profiles --udev". The installed rules are made so when acut is built, and an administrator
 * makes those of an added profile so: there is one source for which device is which scanner.
 *
 * A rule may only use what udev knows of a device at that moment, which is less than what a profile may ask for but never
 * wider than the vendor: a profile without a vendor (all devices of a class) gets no rule, and is for --profile.
 */
#include <ctype.h>
#include <string.h>

#include "err.h"
#include "profile.h"
#include "scan.h"

static const char head[] =
	"# Scanners that acut-scan knows, made from their profiles by \"acut-scan profiles --udev\": who may use them, and a capture\n"
	"# (acut-scan@.service) for each that is plugged in. What acut-scanners.d(5) says under UDEV changes that, in another file.\n"
	"ACTION==\"remove\", GOTO=\"acut_scanner_end\"\n"
	"SUBSYSTEM!=\"usb\", GOTO=\"acut_scanner_end\"\n"
	"ENV{DEVTYPE}!=\"usb_device\", GOTO=\"acut_scanner_end\"\n"
	"\n";

/* Mass storage is never captured, whatever a profile says. The alias gives the unit a device to be bound to that has the same
 * name, BUS-PORT: a unit's name has - for /. */
static const char tail[] = "\n"
			   "ENV{ACUT_SCANNER}==\"\", GOTO=\"acut_scanner_end\"\n"
			   "ENV{ACUT_SCANNER}==\"none\", GOTO=\"acut_scanner_end\"\n"
			   "ENV{ID_USB_INTERFACES}==\"*:08????:*\", GOTO=\"acut_scanner_end\"\n"
			   "SUBSYSTEM==\"usb\", GROUP=\"acut-scan\", MODE=\"0660\", TAG+=\"systemd\", "
			   "ENV{SYSTEMD_ALIAS}+=\"/acut/scanner/$attr{busnum}/$attr{devpath}\"\n"
			   "ENV{ACUT_SCANNER_START}!=\"no\", ENV{SYSTEMD_WANTS}+=\"acut-scan@$kernel.service\"\n"
			   "LABEL=\"acut_scanner_end\"\n";

/* A value in a rule: a character that is special to udev is replaced by one that matches any character. */
static void print_glob(FILE *out, const char *glob)
{
	for (; *glob; glob++)
		fputc(strchr("[]|\"\\$%", *glob) ? '?' : *glob, out);
}

static bool is_plain(const char *name)
{
	for (const char *c = name; *c; c++)
		if (!isalnum((unsigned char)*c) && !strchr("._+-", *c))
			return false;
	return *name;
}

static void print_rule(FILE *out, const struct profile *p, bool alone)
{
	fprintf(out, "# %s%s%s\n", p->name, p->title[0] ? ": " : "", p->title);
	if (p->vendor < 0 || !is_plain(p->name)) {
		fprintf(out, "# (no rule: %s)\n",
			p->vendor < 0 ? "it names no vendor" : "its name has other than letters, digits and ._+-");
		return;
	}
	fputs(alone ? "SUBSYSTEM==\"usb\", ENV{DEVTYPE}==\"usb_device\", " : "SUBSYSTEM==\"usb\", ENV{ACUT_SCANNER}==\"\", ",
	      out);
	fprintf(out, "ATTR{idVendor}==\"%04x\", ", (unsigned)p->vendor);
	if (p->product >= 0)
		fprintf(out, "ATTR{idProduct}==\"%04x\", ", (unsigned)p->product);
	if (p->device_class >= 0)
		fprintf(out, "ATTR{bDeviceClass}==\"%02x\", ", (unsigned)p->device_class);
	if (p->interface_class >= 0)
		fprintf(out, "ENV{ID_USB_INTERFACES}==\"*:%02x*\", ", (unsigned)p->interface_class);
	if (p->serial[0]) {
		fputs("ATTR{serial}==\"", out);
		print_glob(out, p->serial);
		fputs("\", ", out);
	}
	fprintf(out, "ENV{ACUT_SCANNER}=\"%s\"\n", p->name);
}

static int print_all(FILE *out, const struct profile_set *set, struct program *args, struct err *err)
{
	fputs(head, out);
	for (size_t i = 0; i < profile_set_count(set); i++) {
		const struct profile_entry *e = profile_set_at(set, i);

		/* rules without a scanner that should be in them are no rules */
		if (e->fault)
			return err_set(err, ERR_INPUT, "%s is broken: %s", e->path, e->fault);
		print_rule(out, &e->profile, false);
	}
	fputs(tail, out);
	return 0;
}

static int print_some(FILE *out, const struct profile_set *set, struct program *args, struct err *err)
{
	for (size_t i = 0; i < args->line.nword; i++) {
		const struct profile_entry *e = profile_set_find(set, args->line.word[i]);

		if (!e) {
			err_set(err, ERR_USAGE, "there is no profile %s", args->line.word[i]);
			return err_add_hint(err, "acut-scan profiles lists them; --udev takes names, not files");
		}
		if (e->fault)
			return err_set(err, ERR_INPUT, "%s is broken: %s", e->path, e->fault);
		print_rule(out, &e->profile, true);
	}
	return 0;
}

int scan_udev(struct program *args)
{
	struct profile_set *set = NULL;
	struct err err = ERR_INIT;
	int rc = profile_set_read(args->profiles.n ? args->profiles.text : NULL, &set, &err);

	if (!rc)
		rc = args->line.nword ? print_some(stdout, set, args, &err) : print_all(stdout, set, args, &err);
	profile_set_free(set);
	return rc ? scan_fail(args, &err) : 0;
}
