/*
 * record from a device: buffers of the capture into the spool, each released as soon as it is appended. Other news of the bus
 * becomes events. With --reconnect a device that leaves is waited for: the same serial number, or without one the same
 * numbers at the same port.
 */
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "scan_record.h"

enum { RETRY_MS = 1000, TAKES = 64 };

static void add_counts(struct usb_counts *to, const struct usb_counts *c)
{
	to->transfers += c->transfers;
	to->bytes += c->bytes;
	to->shorts += c->shorts;
	to->stalls += c->stalls;
	to->overflows += c->overflows;
	to->timeouts += c->timeouts;
	to->errors += c->errors;
	to->parked += c->parked;
	to->parked_ns += c->parked_ns;
}

static const char *event_name(enum usb_kind kind)
{
	switch (kind) {
	case USB_STALL:
		return "stall";
	case USB_CLEARED:
		return "cleared";
	case USB_OVERFLOW:
		return "overflow";
	case USB_TIMEOUT:
		return "timeout";
	case USB_ERROR:
		return "error";
	case USB_PARKED:
		return "parked";
	case USB_DATA:
	case USB_SENT:
	case USB_GONE:
		break;
	}
	return "error";
}

static int event(struct record *r, const struct usb_buffer *b, struct err *err)
{
	const char *name = event_name(b->kind);

	if (b->kind == USB_OVERFLOW || b->kind == USB_ERROR)
		record_gap(r);
	if (b->kind != USB_PARKED)
		record_report_event(r, name, b->text);
	return b->kind == USB_PARKED ? spool_event(r->spool, b->time_ns, err, "%s", b->text) :
				       spool_event(r->spool, b->time_ns, err, "%s %s", name, b->text);
}

static int keep(struct record *r, const struct usb_buffer *b, struct err *err)
{
	unsigned flags =
		(b->is_short ? SPOOL_SHORT : 0) | (b->after_gap ? SPOOL_AFTER_GAP : 0) | (b->with_error ? SPOOL_WITH_ERROR : 0);

	if (b->kind == USB_DATA)
		return record_data(r, flags, b->time_ns, b->at, b->size, err);
	if (b->kind == USB_SENT)
		return spool_append(r->spool, SPOOL_SENT, 0, b->time_ns, b->at, b->size, err);
	return event(r, b, err);
}

/* Appends the buffers that are there, but no more than TAKES at once: a device that is faster than the disk must not delay a
 * stop. 1: it was the last. After a failure the rest is only released. */
static int take_all(struct record *r, enum usb_end *ret_end, char ret_text[USB_LINE_SIZE], struct err *err)
{
	struct usb_buffer b;

	for (int i = 0; i < TAKES && usb_capture_take(r->capture, &b) == 1; i++) {
		if (b.kind == USB_GONE) {
			*ret_end = b.end;
			snprintf(ret_text, USB_LINE_SIZE, "%s", b.text);
			return 1;
		}
		if (!err->code)
			keep(r, &b, err);
		usb_capture_give(r->capture, &b);
	}
	return 0;
}

/* One capture, from its start to its last buffer. A failure of the spool is in err. */
static enum usb_end capture(struct record *r, char ret_text[USB_LINE_SIZE], struct err *err)
{
	struct pollfd p[2] = {{.fd = usb_capture_fd(r->capture), .events = POLLIN}, {.fd = scan_stop_fd(), .events = POLLIN}};
	enum usb_end end = USB_END_STOPPED;
	struct usb_counts counts;
	bool stopping = false;

	while (!take_all(r, &end, ret_text, err)) {
		if (!stopping && (err->code || record_over(r))) {
			usb_capture_stop(r->capture);
			stopping = true;
			p[1].fd = -1;
		}
		record_report_progress(r);
		if (poll(p, 2, stopping ? -1 : record_patience(r)) < 0 && errno != EINTR && !stopping)
			err_sys(err, errno, "cannot wait for the device");
	}
	usb_capture_counts(r->capture, &counts);
	add_counts(&r->before, &counts);
	r->capture = usb_capture_free(r->capture);
	return end;
}

static bool same(const struct usb_device *a, const struct usb_device *b)
{
	if (a->vendor != b->vendor || a->product != b->product)
		return false;
	return a->serial[0] ? !strcmp(a->serial, b->serial) : !b->serial[0] && !strcmp(a->port, b->port);
}

/* Whether it is plugged in; *ret as it is now. */
static bool there(struct scan_device *d, struct usb_device *ret)
{
	struct err err = ERR_INIT;
	struct usb_device *list;
	bool found = false;
	size_t n;

	if (usb_list(d->usb, true, &list, &n, &err))
		return false;
	for (size_t i = 0; i < n && !found; i++) {
		found = same(&d->device, &list[i]);
		if (found)
			*ret = list[i];
	}
	free(list);
	return found;
}

/* Waits for the device and starts it again; 0: it runs, or the capture is over (why). */
static int come_back(struct record *r, struct scan_device *d, struct err *err)
{
	struct pollfd p[2] = {{.fd = usb_watch_fd(d->usb), .events = POLLIN}, {.fd = scan_stop_fd(), .events = POLLIN}};
	char last[sizeof(err->message)] = "";
	enum usb_change change;
	struct usb_device device;

	while (!record_over(r)) {
		struct err why = ERR_INIT;
		int wait = record_patience(r);

		while (usb_change(d->usb, &change, &device) == 1)
			;
		if (there(d, &device)) {
			if (!usb_capture_start(d->usb, &device, &d->profile.profile, &r->capture, &why)) {
				d->device = device;
				record_report_event(r, "back", device.port);
				r->clock_ns = clock_mono_ns();
				return spool_event(r->spool, (int64_t)r->clock_ns, err, "back %s", device.port) ||
						       spool_clock(r->spool, err) ?
					       -(int)err->code :
					       0;
			}
			/* The reason why the device cannot be opened yet (no rights from udev, still starting): printed once. */
			if (why.code != ERR_CANCELLED && strcmp(last, why.message)) {
				snprintf(last, sizeof(last), "%s", why.message);
				record_report_event(r, "error", why.message);
				if (spool_event(r->spool, (int64_t)clock_mono_ns(), err, "error %s", why.message))
					return -(int)err->code;
			}
			wait = wait < 0 || wait > RETRY_MS ? RETRY_MS : wait;
		}
		record_report_progress(r);
		poll(p, 2, wait);
	}
	return 0;
}

int record_from_usb(struct record *r, struct scan_device *d, struct err *err)
{
	int rc = usb_capture_start(d->usb, &d->device, &d->profile.profile, &r->capture, err);
	char words[200], text[USB_LINE_SIZE];

	if (rc)
		return rc;
	record_report_start(r, scan_device_text(&d->device, words, sizeof(words)));
	if (d->profile.profile.note[0])
		console_note(&r->args->console, "%s", d->profile.profile.note);
	while (r->capture) {
		enum usb_end end = capture(r, text, err);

		if (err->code)
			return -(int)err->code;
		if (end == USB_END_STOPPED) {
			record_over(r); /* why: also where it was stopped before it was begun */
			return 0;
		}
		r->left++;
		record_gap(r);
		record_report_event(r, end == USB_END_LEFT ? "left" : "error", text);
		if (spool_event(r->spool, (int64_t)clock_mono_ns(), err, "%s %s", end == USB_END_LEFT ? "left" : "error", text))
			return -(int)err->code;
		if (record_over(r))
			return 0;
		if (!r->args->reconnect && end == USB_END_LEFT) {
			r->why = RECORD_UNPLUGGED;
			return 0;
		}
		if (!r->args->reconnect) {
			err_set(err, ERR_IO, "%s does not answer any more: %s", words, text);
			return err_add_hint(err, "plug it in again; the data until now is in the spool");
		}
		rc = come_back(r, d, err);
		if (rc) {
			r->capture = usb_capture_free(r->capture); /* it came back, and the disk would not have it */
			return rc;
		}
	}
	return 0;
}
