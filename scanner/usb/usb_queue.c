/*
 * The queue from libusb's thread to the caller of a capture: what completed, in that order. Data are not copied: the
 * caller gets the memory of the transfer itself, and only when it is given back is the transfer submitted again. While
 * start and stop commands are in progress nobody takes anything, so data are copied then, up to a limit, and the
 * transfers continue.
 */
#include <libusb.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "clock.h"
#include "usb_priv.h"

enum { COPIES_MAX = 16 << 20 };

/* Under the lock, like all static functions here. */
static void append_item(struct usb_capture *c, struct usb_item *item)
{
	item->next = NULL;
	if (c->last)
		c->last->next = item;
	else
		c->first = item;
	c->last = item;
	eventfd_write(c->fd, 1);
}

static struct usb_item *item_new(struct usb_capture *c, const uint8_t *at, size_t size)
{
	struct usb_item *item = calloc(1, sizeof(*item) + size);

	if (!item) {
		c->short_of_memory = true; /* that ends the capture: usb_step.c */
		return NULL;
	}
	if (size)
		memcpy(item + 1, at, size);
	item->buffer.at = size ? (const uint8_t *)(item + 1) : NULL;
	item->buffer.size = size;
	item->buffer.own = item;
	return item;
}

static bool copies_item(const struct usb_capture *c, const struct usb_slot *slot, size_t size)
{
	return (slot == &c->spare || c->phase == USB_PHASE_START) && c->copied + size <= COPIES_MAX;
}

void usb_queue_data(struct usb_capture *c, struct usb_slot *slot, size_t size, bool with_error, int64_t now)
{
	struct usb_item *item = NULL;

	pthread_mutex_lock(&c->lock);
	c->counts.bytes += size;
	if (copies_item(c, slot, size))
		item = item_new(c, slot->at, size);
	if (item) {
		c->copied += size;
		usb_slot_free(c, slot);
	} else {
		item = &slot->item;
		*item = (struct usb_item){.slot = slot, .buffer = {.at = slot->at, .size = size, .own = item}};
	}
	item->buffer.kind = USB_DATA;
	item->buffer.is_short = size < (size_t)slot->transfer->length;
	item->buffer.with_error = with_error;
	item->buffer.after_gap = c->gap;
	item->buffer.time_ns = now;
	c->gap = false;
	append_item(c, item);
	pthread_mutex_unlock(&c->lock);
}

void usb_queue_event(struct usb_capture *c, enum usb_kind kind, const uint8_t *at, size_t size, int64_t now, const char *fmt, ...)
{
	struct usb_item *item;
	va_list ap;

	pthread_mutex_lock(&c->lock);
	item = item_new(c, at, size);
	if (item) {
		item->buffer.kind = kind;
		item->buffer.time_ns = now;
		va_start(ap, fmt);
		vsnprintf(item->buffer.text, sizeof(item->buffer.text), fmt, ap);
		va_end(ap);
		append_item(c, item);
	}
	pthread_mutex_unlock(&c->lock);
}

bool usb_queue_has_data(const struct usb_capture *c)
{
	const struct usb_item *item = c->first;

	while (item && item->buffer.kind != USB_DATA)
		item = item->next;
	return item;
}

/* The last access of the thread to a capture. */
void usb_queue_end(struct usb_capture *c)
{
	pthread_mutex_lock(&c->lock);
	if (c->parked_since) {
		c->counts.parked_ns += clock_mono_ns() - c->parked_since;
		c->parked_since = 0;
	}
	c->end_ns = (int64_t)clock_mono_ns();
	c->ended = true;
	eventfd_write(c->fd, 1);
	eventfd_write(c->start_fd, 1);
	pthread_cond_broadcast(&c->changed);
	pthread_mutex_unlock(&c->lock);
}

struct usb_slot *usb_queue_given(struct usb_capture *c)
{
	struct usb_slot *given;

	pthread_mutex_lock(&c->lock);
	given = c->given;
	c->given = NULL;
	pthread_mutex_unlock(&c->lock);
	return given;
}

int usb_capture_fd(struct usb_capture *c)
{
	return c->fd;
}

static void hold_item(struct usb_capture *c, struct usb_item *item)
{
	item->next = c->held;
	c->held = item;
}

static void release_item(struct usb_capture *c, struct usb_item *item)
{
	struct usb_item **at = &c->held;

	while (*at && *at != item)
		at = &(*at)->next;
	if (!*at)
		return;
	*at = item->next;
	if (item->buffer.kind == USB_DATA)
		c->copied -= item->buffer.size;
	free(item);
}

static int take_item(struct usb_capture *c, struct usb_buffer *ret)
{
	struct usb_item *item = c->first;

	if (item) {
		c->first = item->next;
		if (!c->first)
			c->last = NULL;
		*ret = item->buffer;
		if (item->slot)
			return 1;
		if (ret->size) {
			hold_item(c, item); /* until it is given back or freed */
		} else {
			ret->own = NULL;
			free(item);
		}
		return 1;
	}
	if (!c->ended || c->gone_taken)
		return 0;
	c->gone_taken = true;
	*ret = (struct usb_buffer){.kind = USB_GONE, .end = c->end, .time_ns = c->end_ns};
	memcpy(ret->text, c->end_text, sizeof(ret->text));
	return 1;
}

int usb_capture_take(struct usb_capture *c, struct usb_buffer *ret)
{
	eventfd_t count;
	int got;

	pthread_mutex_lock(&c->lock);
	got = take_item(c, ret);
	if (!c->first && (!c->ended || c->gone_taken))
		eventfd_read(c->fd, &count);
	pthread_mutex_unlock(&c->lock);
	return got;
}

void usb_capture_give(struct usb_capture *c, struct usb_buffer *buffer)
{
	struct usb_item *item = buffer->own;
	bool wake = false;

	if (!item)
		return;
	pthread_mutex_lock(&c->lock);
	if (item->slot) {
		wake = !c->ended && !c->given;
		item->slot->next = c->given;
		c->given = item->slot;
	} else {
		release_item(c, item);
	}
	pthread_mutex_unlock(&c->lock);
	buffer->own = NULL;
	buffer->at = NULL;
	if (wake)
		usb_wake(c->usb);
}

void usb_capture_counts(struct usb_capture *c, struct usb_counts *ret)
{
	pthread_mutex_lock(&c->lock);
	*ret = c->counts;
	if (c->parked_since)
		ret->parked_ns += clock_mono_ns() - c->parked_since;
	pthread_mutex_unlock(&c->lock);
}
