/*
 * Transfers: submission, completion, cancellation.
 *
 * A bulk endpoint serves its transfers in the order of submission, and libusb reports them in the order of completion,
 * so the order of callbacks is the order on the wire. Whatever the status of a transfer, its bytes are data. After a
 * stall, an overflow or an error nothing is submitted until all transfers were cancelled and have returned (newest
 * first, so that none is filled after an earlier one was cancelled); then the endpoint is restarted (usb_step.c).
 */
#include <libusb.h>
#include <string.h>

#include "clock.h"
#include "log.h"
#include "usb_priv.h"

void usb_slot_free(struct usb_capture *c, struct usb_slot *slot)
{
	if (slot == &c->spare) {
		c->spare_out = false;
		return;
	}
	slot->next = c->free;
	c->free = slot;
}

static void count_status(struct usb_capture *c, const struct libusb_transfer *t)
{
	pthread_mutex_lock(&c->lock);
	c->counts.in_flight = c->flying;
	c->counts.transfers += t->status == LIBUSB_TRANSFER_COMPLETED || t->actual_length > 0;
	c->counts.shorts += t->status == LIBUSB_TRANSFER_COMPLETED && t->actual_length < t->length;
	pthread_mutex_unlock(&c->lock);
}

/* Reports the first of its kind in an episode; the transfers behind it often end with the same status, which is no news. */
static bool report_trouble(struct usb_capture *c, enum usb_recover how)
{
	if (c->recover != USB_RECOVER_NONE) {
		bool is_new = !(c->troubles & 1u << how);

		c->troubles |= 1u << how;
		return is_new;
	}
	c->recover = how;
	c->troubles = 1u << how;
	c->cancelled = false;
	c->retry_at = 0;
	c->fruitless++;
	return true;
}

static void count_trouble(struct usb_capture *c, uint64_t *what)
{
	pthread_mutex_lock(&c->lock);
	++*what;
	pthread_mutex_unlock(&c->lock);
}

static void status_kind(struct usb_capture *c, const struct libusb_transfer *t, int64_t now)
{
	int n = t->actual_length;

	switch (t->status) {
	case LIBUSB_TRANSFER_COMPLETED:
	case LIBUSB_TRANSFER_CANCELLED:
		break;
	case LIBUSB_TRANSFER_NO_DEVICE:
		c->left = true;
		break;
	case LIBUSB_TRANSFER_STALL:
		if (!report_trouble(c, USB_RECOVER_STALL) && !n)
			break;
		count_trouble(c, &c->counts.stalls);
		usb_queue_event(c, USB_STALL, NULL, 0, now, "endpoint 0x%02x stalled after %d bytes", t->endpoint, n);
		break;
	case LIBUSB_TRANSFER_OVERFLOW:
		report_trouble(c, USB_RECOVER_OVERFLOW);
		c->gap = true;
		count_trouble(c, &c->counts.overflows);
		usb_queue_event(c, USB_OVERFLOW, NULL, 0, now, "more came than %d bytes; %d are kept", t->length, n);
		break;
	case LIBUSB_TRANSFER_ERROR:
	case LIBUSB_TRANSFER_TIMED_OUT:
		c->gap = true;
		if (!report_trouble(c, USB_RECOVER_ERROR) && !n)
			break;
		count_trouble(c, &c->counts.errors);
		usb_queue_event(c, USB_ERROR, NULL, 0, now, "transfer failed on the bus after %d bytes", n);
		break;
	}
}

static void LIBUSB_CALL on_done(struct libusb_transfer *t)
{
	struct usb_slot *slot = t->user_data;
	struct usb_capture *c = slot->capture;
	uint64_t now = clock_mono_ns();
	bool failed = t->status != LIBUSB_TRANSFER_COMPLETED && t->status != LIBUSB_TRANSFER_CANCELLED;

	slot->flying = false;
	c->flying--;
	count_status(c, t);
	if (t->actual_length > 0) {
		c->fruitless = 0;
		usb_talk_feed(c, slot->at, (size_t)t->actual_length);
		usb_queue_data(c, slot, (size_t)t->actual_length, failed, (int64_t)now);
	} else {
		usb_slot_free(c, slot);
	}
	status_kind(c, t, (int64_t)now);
}

void usb_transfer_fill(struct usb_capture *c, struct usb_slot *slot, uint32_t size)
{
	if (c->in->type == LIBUSB_TRANSFER_TYPE_INTERRUPT)
		libusb_fill_interrupt_transfer(slot->transfer, c->handle, c->in->address, slot->at, (int)size, on_done, slot, 0);
	else
		libusb_fill_bulk_transfer(slot->transfer, c->handle, c->in->address, slot->at, (int)size, on_done, slot, 0);
	slot->capture = c;
}

static void note_flying(struct usb_capture *c, uint64_t now)
{
	uint64_t parked = 0;

	pthread_mutex_lock(&c->lock);
	c->counts.in_flight = c->flying;
	if (c->parked_since) {
		parked = now - c->parked_since;
		c->counts.parked_ns += parked;
		c->parked_since = 0;
	}
	pthread_mutex_unlock(&c->lock);
	if (parked)
		usb_queue_event(c, USB_PARKED, NULL, 0, (int64_t)now, "parked %llu", (unsigned long long)parked);
}

/* Others use the kernel's memory: tried again later. */
static void retry_later(struct usb_capture *c, uint64_t now)
{
	if (!c->lacking && c->phase != USB_PHASE_START)
		usb_queue_event(c, USB_ERROR, NULL, 0, (int64_t)now, "the kernel has no memory for a transfer (usbfs_memory_mb)");
	c->lacking = true;
}

bool usb_transfer_submit(struct usb_capture *c, struct usb_slot *slot, uint64_t now)
{
	int r = libusb_submit_transfer(slot->transfer);

	if (r == 0) {
		slot->flying = true;
		slot->order = ++c->submitted;
		c->flying++;
		c->lacking = false;
		note_flying(c, now);
		return true;
	}
	log_debug("usb: a transfer is not taken: %s", libusb_error_name(r));
	if (r == LIBUSB_ERROR_NO_DEVICE)
		c->left = true;
	else if (r == LIBUSB_ERROR_NO_MEM)
		retry_later(c, now);
	else if (report_trouble(c, USB_RECOVER_ERROR)) {
		count_trouble(c, &c->counts.errors);
		usb_queue_event(c, USB_ERROR, NULL, 0, (int64_t)now, "a transfer is not taken: %s", libusb_strerror(r));
	}
	return false;
}

void usb_transfer_submit_free(struct usb_capture *c, uint64_t now)
{
	struct usb_slot *slot;

	while ((slot = c->free) && c->recover == USB_RECOVER_NONE && !c->left) {
		if (!usb_transfer_submit(c, slot, now))
			return;
		c->free = slot->next;
	}
}

static struct usb_slot *newest_slot(struct usb_capture *c, uint64_t before)
{
	struct usb_slot *found = NULL;

	for (uint32_t i = 0; i <= c->slots_n; i++) {
		struct usb_slot *slot = i < c->slots_n ? &c->slots[i] : &c->spare;

		if (slot->flying && slot->order < before && (!found || slot->order > found->order))
			found = slot;
	}
	return found;
}

void usb_transfer_cancel(struct usb_capture *c)
{
	struct usb_slot *slot;
	uint64_t before = UINT64_MAX;

	while ((slot = newest_slot(c, before))) {
		before = slot->order;
		libusb_cancel_transfer(slot->transfer); /* one that has completed, or whose device is gone, returns, too */
	}
}

void usb_transfer_forget(struct usb_capture *c)
{
	for (uint32_t i = 0; i < c->slots_n; i++)
		c->slots[i].flying = false;
	c->spare.flying = c->talk.flying = false;
	c->flying = 0;
}
