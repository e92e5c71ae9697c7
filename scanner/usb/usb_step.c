/*
 * The next step of a capture: a state machine of a few phases (usb_priv.h), run between two rounds of libusb's loop.
 *
 *   START -> STREAM -> QUIET -> STOP -> LEAVE -> ENDED
 *
 * From every phase an unplug leads to LEAVE: all transfers are cancelled and awaited, then the device is closed. Some
 * kernels end the transfers of an unplugged device with an error, and report a moment later that it left, or fail the
 * next call; others report at once that there is no device. Both end here, once.
 *
 * A stall, an overflow or an error is an episode: drain, clear the halt, continue. Episodes without data in between are
 * separated by growing pauses, and a few in a row end the capture.
 */
#include <libusb.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/eventfd.h>

#include "clock.h"
#include "log.h"
#include "usb_priv.h"

#define NEVER UINT64_MAX
#define MS 1000000ull
enum { FRUITLESS_MAX = 10, DRAIN_MS = 3000, LACKING_MS = 250, PAUSE_MS = 10, PAUSE_MAX_MS = 1000 };

static void begin_leave(struct usb_capture *c, uint64_t now, enum usb_end end, const char *fmt, ...)
	__attribute__((format(printf, 4, 5)));

static void begin_leave(struct usb_capture *c, uint64_t now, enum usb_end end, const char *fmt, ...)
{
	va_list ap;

	if (c->phase >= USB_PHASE_LEAVE)
		return;
	c->phase = USB_PHASE_LEAVE;
	c->end = c->start_failed ? USB_END_FAILED : end;
	va_start(ap, fmt);
	vsnprintf(c->end_text, sizeof(c->end_text), fmt, ap);
	va_end(ap);
	usb_talk_cancel(c);
	usb_transfer_cancel(c);
	c->drain_by = now + DRAIN_MS * MS;
}

static void leave_left(struct usb_capture *c, uint64_t now)
{
	if (c->phase == USB_PHASE_START)
		usb_refusal_left(&c->device, "while it was started", &c->err);
	begin_leave(c, now, USB_END_LEFT, "the device was unplugged");
}

static void leave_failed(struct usb_capture *c, uint64_t now, const char *why)
{
	char words[160];

	usb_watch_scan(c->usb);
	if (!usb_watch_present(c->usb, &c->device)) {
		leave_left(c, now);
		return;
	}
	if (c->phase == USB_PHASE_START) {
		err_set(&c->err, ERR_IO, "%s: %s", usb_device_words(&c->device, words, sizeof(words)), why);
		err_add_hint(&c->err, "unplug it and plug it in again");
	}
	begin_leave(c, now, USB_END_FAILED, "%s", why);
}

static uint64_t pause_ns(unsigned fruitless)
{
	unsigned ms = fruitless < 2 ? 0 : fruitless > 8 ? PAUSE_MAX_MS : (unsigned)PAUSE_MS << (fruitless - 2);

	return (ms > PAUSE_MAX_MS ? PAUSE_MAX_MS : ms) * MS;
}

/* Cancels all transfers; true once none is in flight. */
static bool is_drained(struct usb_capture *c, uint64_t now)
{
	if (!c->flying)
		return true;
	if (!c->cancelled) {
		c->cancelled = true;
		c->drain_by = now + DRAIN_MS * MS;
		usb_transfer_cancel(c);
	} else if (now >= c->drain_by) {
		leave_failed(c, now, "transfers do not come back");
	}
	return false;
}

/* True: the endpoint was restarted, and the capture continues. */
static bool clear_halt(struct usb_capture *c, uint64_t now)
{
	enum usb_recover how = c->recover;
	int r;

	if (!c->retry_at)
		c->retry_at = now + pause_ns(c->fruitless);
	if (now < c->retry_at)
		return false;
	r = libusb_clear_halt(c->handle, c->in->address);
	if (r == LIBUSB_ERROR_NO_DEVICE) {
		c->left = true;
		return false;
	}
	if (r) {
		log_debug("usb: endpoint 0x%02x: clear halt: %s", c->in->address, libusb_error_name(r));
		c->fruitless++;
		c->retry_at = now + pause_ns(c->fruitless);
		return false;
	}
	c->recover = USB_RECOVER_NONE;
	c->retry_at = 0;
	usb_queue_event(c, USB_CLEARED, NULL, 0, (int64_t)clock_mono_ns(), "endpoint 0x%02x goes on after %s", c->in->address,
			how == USB_RECOVER_STALL    ? "a stall" :
			how == USB_RECOVER_OVERFLOW ? "an overflow" :
						      "an error");
	return true;
}

static uint64_t recover_endpoint(struct usb_capture *c, uint64_t now)
{
	if (!is_drained(c, now))
		return c->drain_by;
	if (c->fruitless > FRUITLESS_MAX) {
		leave_failed(c, now,
			     c->recover == USB_RECOVER_STALL ? "it stalls again and again without a byte" :
							       "it does not answer any more");
		return now;
	}
	clear_halt(c, now);
	return c->recover == USB_RECOVER_NONE ? now : c->retry_at;
}

static void note_ready(struct usb_capture *c)
{
	c->phase = USB_PHASE_STREAM;
	pthread_mutex_lock(&c->lock);
	c->ready = true;
	eventfd_write(c->start_fd, 1);
	pthread_mutex_unlock(&c->lock);
}

/* The device may be running, so it gets the stop commands. */
static void abort_start(struct usb_capture *c, uint64_t now)
{
	usb_talk_cancel(c);
	c->phase = USB_PHASE_QUIET;
	c->cancelled = false;
	c->drain_by = now + DRAIN_MS * MS;
}

static uint64_t step_start(struct usb_capture *c, uint64_t now)
{
	int r;

	if (c->lacking) {
		err_set(&c->err, ERR_LIMIT,
			"the kernel has no memory for %u transfers of %u bytes: other programs have what "
			"usbfs_memory_mb lends",
			c->profile.transfers, c->profile.transfer_size);
		err_add_hint(&c->err, "write more into " USB_MEMORY_FILE ", or end the other programs that use USB");
		begin_leave(c, now, USB_END_FAILED, "no memory for transfers");
		return now;
	}
	r = usb_talk_step(c, now, &c->err);
	if (r < 0) {
		c->start_failed = true;
		if (usb_talk_taken(c))
			abort_start(c, now);
		else
			begin_leave(c, now, USB_END_FAILED, "a start command failed");
		return now; /* if all transfers are in the queue, a returned buffer would not wake the thread */
	}
	if (r == 1)
		note_ready(c);
	return usb_talk_until(c);
}

/* From now on nothing is in flight, for lack of a free buffer. */
static void note_parked(struct usb_capture *c, uint64_t now)
{
	if (c->phase != USB_PHASE_STREAM || c->flying || c->free || c->left)
		return;
	pthread_mutex_lock(&c->lock);
	if (!c->given && !c->parked_since) {
		c->parked_since = now;
		c->counts.parked++;
	}
	pthread_mutex_unlock(&c->lock);
}

static uint64_t step_stream(struct usb_capture *c, uint64_t now)
{
	uint64_t until = NEVER, other;

	if (c->recover == USB_RECOVER_NONE)
		usb_transfer_submit_free(c, now);
	if (c->recover != USB_RECOVER_NONE)
		until = recover_endpoint(c, now);
	else
		note_parked(c, now);
	if (c->phase == USB_PHASE_START && !c->left) {
		other = step_start(c, now);
		until = other < until ? other : until;
	}
	if (c->lacking && until > now + LACKING_MS * MS)
		until = now + LACKING_MS * MS;
	return c->left ? now : until;
}

static uint64_t step_quiet(struct usb_capture *c, uint64_t now, bool abandon)
{
	if (!is_drained(c, now))
		return c->phase == USB_PHASE_QUIET ? c->drain_by : now;
	if (c->talk.flying && now < c->drain_by)
		return c->drain_by; /* a start command */
	if (abandon || c->talk.flying || !c->profile.stops || (c->err.code == ERR_CANCELLED && !usb_talk_heard(c))) {
		begin_leave(c, now, USB_END_STOPPED, "stopped");
		return now;
	}
	if (c->recover != USB_RECOVER_NONE)
		libusb_clear_halt(c->handle, c->in->address);
	c->recover = USB_RECOVER_NONE;
	c->fruitless = 0;
	c->phase = USB_PHASE_STOP;
	usb_talk_begin(c, c->profile.stop, c->profile.stops);
	return now;
}

static void note_failed(struct usb_capture *c, uint64_t now, bool timeout, const char *how)
{
	pthread_mutex_lock(&c->lock);
	c->counts.timeouts += timeout;
	c->counts.errors += !timeout;
	pthread_mutex_unlock(&c->lock);
	usb_queue_event(c, timeout ? USB_TIMEOUT : USB_ERROR, NULL, 0, (int64_t)now, "%s", how);
}

static uint64_t step_stop(struct usb_capture *c, uint64_t now, bool abandon)
{
	struct err err = ERR_INIT;
	int r;

	if (c->recover != USB_RECOVER_NONE && !c->spare.flying && c->fruitless <= FRUITLESS_MAX)
		clear_halt(c, now);
	if (c->recover == USB_RECOVER_NONE && !c->spare_out && !c->left) {
		c->spare_out = true;
		if (!usb_transfer_submit(c, &c->spare, now))
			c->spare_out = false;
	}
	r = usb_talk_step(c, now, &err);
	if (r < 0)
		note_failed(c, now, r == -ERR_TIMEOUT, err.message);
	if (r == 1 || abandon)
		begin_leave(c, now, USB_END_STOPPED, "stopped");
	if (r || c->left)
		return now;
	return c->recover != USB_RECOVER_NONE && c->retry_at && c->retry_at > now && c->retry_at < usb_talk_until(c) ?
		       c->retry_at :
		       usb_talk_until(c);
}

static uint64_t finish_capture(struct usb_capture *c, uint64_t now)
{
	if ((c->flying || c->talk.flying) && now < c->drain_by)
		return c->drain_by;
	if (c->flying || c->talk.flying)
		log_warning("usb: %s: %u transfers did not come back; the device is closed over them", c->device.port,
			    c->flying + c->talk.flying);
	usb_close_device(c);
	usb_transfer_forget(c);
	/* Data from before the unplug or the stop belong to the caller: a capture that ends at once. */
	pthread_mutex_lock(&c->lock);
	c->ready = c->ready || (c->end != USB_END_FAILED && usb_queue_has_data(c));
	pthread_mutex_unlock(&c->lock);
	c->phase = USB_PHASE_ENDED;
	return NEVER;
}

/* Returned buffers are no longer submitted. */
static void end_parking(struct usb_capture *c, uint64_t now)
{
	pthread_mutex_lock(&c->lock);
	if (c->parked_since)
		c->counts.parked_ns += now - c->parked_since;
	c->parked_since = 0;
	pthread_mutex_unlock(&c->lock);
}

static void apply_request(struct usb_capture *c, uint64_t now, bool *ret_abandon)
{
	struct usb_slot *slot, *given = usb_queue_given(c);
	bool stop, lacking;

	while ((slot = given)) {
		given = slot->next;
		usb_slot_free(c, slot);
	}
	pthread_mutex_lock(&c->lock);
	stop = c->stop;
	*ret_abandon = c->abandon;
	lacking = c->short_of_memory;
	pthread_mutex_unlock(&c->lock);
	if (c->phase >= USB_PHASE_LEAVE)
		return;
	if (c->left) {
		leave_left(c, now);
	} else if (lacking) {
		err_set(&c->err, ERR_NOMEM, "no memory for what happened to a device");
		begin_leave(c, now, USB_END_FAILED, "no memory for what happened");
	} else if (stop && c->phase == USB_PHASE_START) {
		err_set(&c->err, ERR_CANCELLED, "stopped while the scanner was started");
		if (usb_talk_heard(c) || c->talk.flying)
			abort_start(c, now);
		else
			begin_leave(c, now, USB_END_STOPPED, "stopped");
	} else if (stop && c->phase == USB_PHASE_STREAM) {
		end_parking(c, now);
		c->phase = USB_PHASE_QUIET;
		c->cancelled = false;
	}
}

void usb_step_begin(struct usb_capture *c)
{
	uint64_t others = 0;

	for (struct usb_capture *other = c->usb->captures; other; other = other->next)
		others += usb_limit_need(other->profile.transfers, other->profile.transfer_size);
	if (usb_open_device(c, others)) {
		usb_close_device(c);
		c->phase = USB_PHASE_ENDED;
		return;
	}
	c->phase = USB_PHASE_START;
	usb_talk_begin(c, c->profile.start, c->profile.starts);
}

uint64_t usb_step(struct usb_capture *c, uint64_t now)
{
	uint64_t until = now;
	bool abandon;

	while (c->phase != USB_PHASE_ENDED && until <= now) {
		apply_request(c, now, &abandon);
		switch (c->phase) {
		case USB_PHASE_START:
		case USB_PHASE_STREAM:
			until = step_stream(c, now);
			break;
		case USB_PHASE_QUIET:
			until = step_quiet(c, now, abandon);
			break;
		case USB_PHASE_STOP:
			until = step_stop(c, now, abandon);
			break;
		case USB_PHASE_LEAVE:
			until = finish_capture(c, now);
			break;
		case USB_PHASE_ENDED:
			break;
		}
	}
	return c->phase == USB_PHASE_ENDED ? NEVER : until;
}
