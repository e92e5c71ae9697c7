/*
 * profiles: lists the known kinds of scanners, shows one profile, and checks files of profiles. A word with a slash or with
 * the ending .conf is a file, wherever it is; any other word is the name of a profile in the folders.
 *
 * A broken file does not end the command: it is listed with its error, and the status is that of bad input.
 */
#include <stdio.h>
#include <string.h>

#include "decoder.h"
#include "err.h"
#include "profile.h"
#include "scan.h"

enum { FAULT = 1024 };

static const char *const framers[] = {"stream", "stx-etx", "line", "fixed", "length", "las"};

/* "" or why the profile cannot be used. */
static const char *fault_of(const struct profile_entry *e, char buf[FAULT])
{
	struct err err = ERR_INIT;

	if (e->fault)
		return e->fault;
	if (!decoder_check(&e->profile, &err))
		return "";
	err_add_file(&err, e->path);
	return err_format(&err, buf, FAULT);
}

/* "19a2:5001 serial A*", "any of class ff", "-". */
static const char *match_text(const struct profile *p, char buf[400])
{
	size_t n = 0;

	buf[0] = '\0';
	if (!profile_matches_some(p))
		return "-";
	if (p->vendor >= 0)
		n += (size_t)snprintf(buf, 400, p->product >= 0 ? "%04x:%04x" : "%04x:*", (unsigned)p->vendor,
				      (unsigned)p->product);
	if (p->device_class >= 0)
		n += (size_t)snprintf(buf + n, 400 - n, "%sclass %02x", n ? " " : "", (unsigned)p->device_class);
	if (p->interface_class >= 0)
		n += (size_t)snprintf(buf + n, 400 - n, "%sinterface class %02x", n ? " " : "", (unsigned)p->interface_class);
	if (p->serial[0])
		snprintf(buf + n, 400 - n, "%sserial %s", n ? " " : "", p->serial);
	return buf;
}

/* ---- for programs ---- */

static void json_number(struct term_json *j, const char *key, int v)
{
	if (v < 0)
		term_json_text(j, key, NULL);
	else
		term_json_i64(j, key, v);
}

static void json_profile(struct term_json *j, const struct profile *p)
{
	term_json_text(j, "title", p->title);
	term_json_known(j, "note", p->note);
	term_json_open(j, "match", '{');
	json_number(j, "vendor", p->vendor);
	json_number(j, "product", p->product);
	json_number(j, "device_class", p->device_class);
	json_number(j, "interface_class", p->interface_class);
	term_json_known(j, "serial", p->serial);
	term_json_close(j, '}');
	term_json_open(j, "usb", '{');
	term_json_u64(j, "interface", p->interface);
	term_json_u64(j, "endpoint_in", p->endpoint_in);
	json_number(j, "endpoint_out", p->endpoint_out ? p->endpoint_out : -1);
	term_json_u64(j, "transfer_size", p->transfer_size);
	term_json_u64(j, "transfers", p->transfers);
	term_json_number(j, "timeout_s", p->timeout_ms / 1e3);
	term_json_u64(j, "start_commands", p->starts);
	term_json_u64(j, "stop_commands", p->stops);
	term_json_close(j, '}');
	term_json_text(j, "framer", framers[p->framer]);
	term_json_text(j, "decoder", p->decoder);
	term_json_text(j, "time", p->time == PROFILE_TIME_DEVICE ? "device" : "arrival");
	term_json_number(j, "latency_s", p->latency_s);
	term_json_open(j, "mount", '{');
	term_json_number(j, "roll", p->mount_roll);
	term_json_number(j, "pitch", p->mount_pitch);
	term_json_number(j, "heading", p->mount_heading);
	term_json_open(j, "lever", '[');
	for (size_t i = 0; i < 3; i++)
		term_json_number(j, NULL, p->lever[i]);
	term_json_close(j, ']');
	term_json_close(j, '}');
	term_json_number(j, "range_min", p->range_min);
	term_json_number(j, "range_max", p->range_max);
}

static void json_entry(struct term_json *j, const struct profile_entry *e, const char *fault)
{
	term_json_open(j, NULL, '{');
	term_json_text(j, "name", e->profile.name);
	term_json_text(j, "file", e->path);
	term_json_known(j, "fault", fault);
	if (!e->fault)
		json_profile(j, &e->profile);
	term_json_close(j, '}');
}

/* ---- for people ---- */

static void show_usb(const struct profile *p)
{
	char out[40] = "";

	if (p->endpoint_out)
		snprintf(out, sizeof out, ", out 0x%02x", p->endpoint_out);
	term_field(stdout, "usb", "interface %u, endpoint in 0x%02x%s, %u transfers of %u bytes", p->interface, p->endpoint_in,
		   out, p->transfers, p->transfer_size);
	if (p->starts || p->stops)
		term_field(stdout, "commands", "%zu to start, %zu to stop", p->starts, p->stops);
}

static void show(const struct profile_entry *e)
{
	const struct profile *p = &e->profile;
	const struct decoder *d = decoder_find(p->decoder);
	char buf[400];

	term_field(stdout, "profile", "%s", p->name);
	term_field(stdout, "file", "%s", e->path);
	if (e->fault)
		return;
	term_field(stdout, "title", "%s", p->title);
	if (p->note[0])
		term_field(stdout, "note", "%s", p->note);
	term_field(stdout, "devices", "%s", profile_matches_some(p) ? match_text(p, buf) : "none by itself; for --profile");
	show_usb(p);
	term_field(stdout, "framer", "%s, telegrams of at most %u bytes", framers[p->framer], p->telegram_max);
	term_field(stdout, "decoder", "%s%s%s", p->decoder, d ? ": " : "", d ? d->title : "");
	term_field(stdout, "time", "%s, %g s late", p->time == PROFILE_TIME_DEVICE ? "of the device" : "of arrival",
		   p->latency_s);
	term_field(stdout, "mount", "roll %g, pitch %g, heading %g degrees; lever %g %g %g m", p->mount_roll, p->mount_pitch,
		   p->mount_heading, p->lever[0], p->lever[1], p->lever[2]);
	if (p->range_max > 0)
		term_field(stdout, "ranges", "%g to %g m", p->range_min, p->range_max);
}

static void list_row(const struct profile_entry *e, bool broken, int name_width, int match_width)
{
	char buf[400];

	term_line(stdout, "%-*s  %-*s  %s", name_width, e->profile.name, match_width,
		  broken ? "broken" : match_text(&e->profile, buf), e->profile.title);
}

static int list(struct program *args, const struct profile_set *set)
{
	struct term_json j = {.out = stdout};
	char fault[FAULT], match[400];
	int name = 4, device = 6, broken = 0; /* device: room for "broken" as well */

	for (size_t i = 0; i < profile_set_count(set); i++) {
		const struct profile_entry *e = profile_set_at(set, i);
		int n = (int)strlen(e->profile.name), m = e->fault ? 6 : (int)strlen(match_text(&e->profile, match));

		name = n > name ? n : name;
		device = m > device ? m : device;
	}
	if (args->console.json) {
		term_json_open(&j, NULL, '{');
		term_json_open(&j, "profiles", '[');
	} else if (profile_set_count(set)) {
		printf("%-*s  %-*s  TITLE\n", name, "NAME", device, "DEVICE");
	}
	for (size_t i = 0; i < profile_set_count(set); i++) {
		const struct profile_entry *e = profile_set_at(set, i);
		const char *why = fault_of(e, fault);

		if (args->console.json)
			json_entry(&j, e, why);
		else
			list_row(e, *why, name, device);
		broken += *why != '\0';
		if (*why && !args->console.json)
			term_line(stderr, "acut-scan: %s", why);
	}
	if (args->console.json) {
		term_json_close(&j, ']');
		term_json_end(&j);
	}
	if (!profile_set_count(set))
		console_note(&args->console, "there are no profiles");
	return broken ? err_exit_status(ERR_INPUT) : 0;
}

static bool is_file(const char *word)
{
	size_t n = strlen(word);

	return strchr(word, '/') || (n > 5 && !strcmp(word + n - 5, ".conf"));
}

/* Prints one profile: a file that is right gets a line, a name is shown in full. */
static int one(struct program *args, const struct profile_set *set, const char *word, struct term_json *j)
{
	struct profile_entry *own = NULL;
	const struct profile_entry *e;
	struct err err = ERR_INIT;
	char fault[FAULT], match[400];
	const char *why;

	if (is_file(word)) {
		if (profile_entry_read(word, &own, &err) < 0)
			return scan_fail(args, &err);
		e = own;
	} else if (!(e = profile_set_find(set, word))) {
		err_set(&err, ERR_NOTFOUND, "there is no profile %s", word);
		err_add_hint(&err, "acut-scan profiles lists them; a file is named with its path, or ends in .conf");
		return scan_fail(args, &err);
	}
	why = fault_of(e, fault);
	if (args->console.json) {
		json_entry(j, e, why);
		term_json_line(j);
	} else if (!own) {
		show(e);
	} else if (!*why && !args->console.quiet) {
		term_line(stdout, "%s: good; devices: %s; framer %s, decoder %s", word, match_text(&e->profile, match),
			  framers[e->profile.framer], e->profile.decoder);
	}
	if (*why && !args->console.json)
		term_line(stderr, "acut-scan: %s", why);
	profile_entry_free(own);
	return *why ? err_exit_status(ERR_INPUT) : 0;
}

int scan_profiles(struct program *args)
{
	struct term_json j = {.out = stdout};
	struct profile_set *set = NULL;
	struct err err = ERR_INIT;
	int status = 0;

	if (args->udev)
		return scan_udev(args);
	if (profile_set_read(args->profiles.n ? args->profiles.text : NULL, &set, &err) < 0)
		return scan_fail(args, &err);
	if (!args->line.nword)
		status = list(args, set);
	for (size_t i = 0; i < args->line.nword; i++) {
		int one_status = one(args, set, args->line.word[i], &j);

		status = status ? status : one_status;
		if (!args->console.json && i + 1 < args->line.nword && !is_file(args->line.word[i]))
			putchar('\n');
	}
	profile_set_free(set);
	return status;
}
