/*
 * list: the devices that are plugged in, known scanners or everything. No device is opened. --watch prints a line for each
 * device that comes or leaves, for scripts, mass storage included, which acut-scan itself never touches.
 */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include "term_table.h"
#include "err.h"
#include "scan_device.h"

static void as_json(const struct usb_device *d, const struct profile_set *set, const char *event)
{
	struct term_json j = {.out = stdout};

	term_json_open(&j, NULL, '{');
	if (event)
		term_json_text(&j, "event", event);
	scan_device_json(&j, d, set);
	term_json_end(&j);
}

static void cell(struct term_table *t, const char *text)
{
	if (text && *text)
		term_table_text(t, "%s", text);
	else
		term_table_none(t);
}

static void as_table(const struct usb_device *list, size_t n, const struct profile_set *set)
{
	static const struct term_column columns[] = {{"PORT"},
						     {"ID"},
						     {"MODEL", .shrink = true},
						     {"SERIAL", .shrink = true},
						     {"SPEED", .spare = true},
						     {"PROFILE"},
						     {"MAY BE OPENED", .tail = true}};
	struct term_table *t = term_table_new(stdout, columns, sizeof(columns) / sizeof(*columns));

	for (size_t i = 0; i < n; i++) {
		const struct usb_device *d = &list[i];
		bool good = d->openable && !d->mass_storage;

		term_table_text(t, "%s", d->port);
		term_table_text(t, "%04x:%04x", d->vendor, d->product);
		cell(t, d->model[0] ? d->model : d->manufacturer);
		cell(t, d->serial);
		cell(t, d->speed);
		cell(t, d->profile >= 0 ? profile_set_at(set, (size_t)d->profile)->profile.name : NULL);
		term_table_tint(t, good ? TERM_GOOD : d->profile >= 0 ? TERM_BAD : TERM_PLAIN);
		term_table_text(t, "%s", scan_device_access(d));
	}
	term_table_free(t);
}

static void print_change(struct program *args, enum usb_change change, const struct usb_device *d, const struct profile_set *set)
{
	char words[200];

	if (!args->all && d->profile < 0)
		return;
	if (args->console.json) {
		as_json(d, set, change == USB_CAME ? "came" : "left");
		return;
	}
	term_line(stdout, "%s %s%s%s", change == USB_CAME ? "came" : "left", scan_device_text(d, words, sizeof(words)),
		  d->profile >= 0 ? ", profile " : "",
		  d->profile >= 0 ? profile_set_at(set, (size_t)d->profile)->profile.name : "");
	fflush(stdout);
}

/* Runs until it is stopped or its reader is gone. */
static int watch(struct program *args, struct usb *usb, const struct profile_set *set, struct err *err)
{
	struct pollfd p[] = {{.fd = scan_stop_fd(), .events = POLLIN}, {.fd = usb_watch_fd(usb), .events = POLLIN}, {.fd = 1}};
	struct usb_device device;
	enum usb_change change;

	if (usb_polls(usb))
		console_note(&args->console, "%s; the list is read each second", usb_polls(usb));
	while (!scan_stopped() && !ferror(stdout)) {
		if (poll(p, 3, -1) < 0 && errno != EINTR)
			return err_sys(err, errno, "cannot wait");
		if (p[2].revents & POLLERR)
			break;
		while (usb_change(usb, &change, &device) == 1)
			print_change(args, change, &device, set);
	}
	return 0;
}

int scan_list(struct program *args)
{
	struct profile_set *set = NULL;
	struct usb_device *list = NULL;
	struct err err = ERR_INIT;
	struct usb *usb = NULL;
	size_t n = 0;
	int r = scan_profile_set(args, &set, &err);

	if (!r)
		r = usb_new(set, &usb, &err);
	if (!r)
		r = usb_list_begin(usb, args->all, &list, &n, &err);
	if (!r && args->console.json)
		for (size_t i = 0; i < n; i++)
			as_json(&list[i], set, args->watch ? "there" : NULL);
	if (!r && !args->console.json)
		as_table(list, n, set);
	if (!r && !n && !args->watch)
		console_note(&args->console,
			     args->all ? "nothing is plugged in" : "no known scanner is plugged in; --all shows all devices");
	if (!r && args->watch)
		r = watch(args, usb, set, &err);
	free(list);
	usb_free(usb);
	profile_set_free(set);
	return r ? scan_fail(args, &err) : 0;
}
