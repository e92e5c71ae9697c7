/* Finds the device of a command; prints devices to people and in JSON. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "scan_device.h"

static int profile_of(struct program *args, struct scan_device *d, struct err *err)
{
	char words[200];

	if (args->profile)
		return scan_profile_named(d->set, args->profile, &d->profile, err);
	if (d->device.profile >= 0)
		return scan_profile_copy(profile_set_at(d->set, (size_t)d->device.profile), &d->profile, err);
	err_set(err, ERR_USAGE, "no profile is for %s", scan_device_text(&d->device, words, sizeof(words)));
	return err_add_hint(err, "name one with --profile, or write one: man acut-scanners.d");
}

int scan_device_open(struct program *args, struct scan_device *ret, struct err *err)
{
	const char *which = args->device ? args->device : args->line.nword ? args->line.word[0] : "";
	struct scan_device d = {0};
	int r;

	if (args->device && args->line.nword) {
		err_set(err, ERR_USAGE, "two devices are named: %s and --device %s", args->line.word[0], args->device);
		return err_add_hint(err, "name one");
	}
	r = scan_profile_set(args, &d.set, err);
	if (!r)
		r = usb_new(d.set, &d.usb, err);
	if (!r) {
		usb_set_stop_fd(d.usb, scan_stop_fd());
		r = usb_find(d.usb, which, &d.device, err);
	}
	if (!r)
		r = profile_of(args, &d, err);
	if (r)
		scan_device_done(&d);
	else
		*ret = d;
	return r;
}

void scan_device_done(struct scan_device *d)
{
	scan_profile_done(&d->profile);
	d->usb = usb_free(d->usb);
	d->set = profile_set_free(d->set);
}

char *scan_device_text(const struct usb_device *d, char *buf, size_t size)
{
	char name[32];

	snprintf(name, sizeof(name), "device %04x:%04x", d->vendor, d->product);
	snprintf(buf, size, "%.60s%s%.60s at %s", d->model[0] ? d->model : name, d->serial[0] ? " serial " : "", d->serial,
		 d->port);
	return buf;
}

const char *scan_device_access(const struct usb_device *d)
{
	if (d->mass_storage)
		return "mass storage, left alone";
	return d->openable ? "yes" : strerror(d->refused);
}

void scan_device_json(struct term_json *j, const struct usb_device *d, const struct profile_set *set)
{
	char id[8];

	term_json_text(j, "port", d->port);
	term_json_text(j, "node", d->node);
	snprintf(id, sizeof(id), "%04x", d->vendor);
	term_json_text(j, "vendor", id);
	snprintf(id, sizeof(id), "%04x", d->product);
	term_json_text(j, "product", id);
	term_json_known(j, "manufacturer", d->manufacturer);
	term_json_known(j, "model", d->model);
	term_json_known(j, "serial", d->serial);
	term_json_known(j, "speed", d->speed);
	term_json_text(j, "profile", set && d->profile >= 0 ? profile_set_at(set, (size_t)d->profile)->profile.name : NULL);
	term_json_bool(j, "mass_storage", d->mass_storage);
	term_json_bool(j, "may_open", d->openable && !d->mass_storage);
	term_json_text(j, "why_not", d->openable && !d->mass_storage ? NULL : scan_device_access(d));
}
