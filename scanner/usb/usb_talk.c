/*
 * Commands: they are sent one after the other, and each answer is searched for in the data from the device, wherever
 * transfers divide it and whatever precedes it. Answers stay in the data.
 *
 * Telegrams are not parsed here. An answer is found by its first bytes (Knuth, Morris, Pratt) in the data since the
 * command was submitted.
 */
#include <libusb.h>
#include <string.h>

#include "clock.h"
#include "usb_priv.h"

enum { TIMEOUT_DEFAULT_MS = 5000, BROKEN_MS = 500, RETURN_MS = 3000 };

static unsigned timeout_ms(const struct usb_capture *c)
{
	return c->profile.timeout_ms ? c->profile.timeout_ms : TIMEOUT_DEFAULT_MS;
}

void usb_talk_begin(struct usb_capture *c, const struct profile_command *list, size_t n)
{
	struct usb_talk *t = &c->talk;

	t->list = list;
	t->n = n;
	t->i = 0;
	t->taken = t->heard = false;
	t->state = USB_TALK_NEXT;
}

static void prepare_answer(struct usb_talk *t)
{
	const struct profile_command *command = &t->list[t->i];
	size_t k = 0;

	t->fall[0] = 0;
	for (size_t i = 1; i < command->answer_size; i++) {
		while (k && command->answer[i] != command->answer[k])
			k = t->fall[k - 1];
		k += command->answer[i] == command->answer[k];
		t->fall[i] = (uint16_t)k;
	}
	t->matched = 0;
	t->answered = command->answer_size == 0;
	t->came_n = 0;
}

void usb_talk_feed(struct usb_capture *c, const uint8_t *at, size_t size)
{
	struct usb_talk *t = &c->talk;
	const struct profile_command *command;

	if (t->state != USB_TALK_SENDING && t->state != USB_TALK_WAITING)
		return;
	command = &t->list[t->i];
	for (size_t i = 0; i < size && t->came_n + i < sizeof(t->came); i++)
		t->came[t->came_n + i] = at[i];
	t->came_n += size;
	for (size_t i = 0; i < size && !t->answered; i++) {
		while (t->matched && at[i] != command->answer[t->matched])
			t->matched = t->fall[t->matched - 1];
		t->matched += at[i] == command->answer[t->matched];
		t->answered = t->matched == command->answer_size;
	}
}

static void LIBUSB_CALL on_sent(struct libusb_transfer *transfer)
{
	struct usb_capture *c = transfer->user_data;

	c->talk.flying = false;
	c->talk.returned = true;
	if (transfer->status == LIBUSB_TRANSFER_NO_DEVICE)
		c->left = true;
	if (transfer->status == LIBUSB_TRANSFER_COMPLETED && transfer->actual_length == transfer->length)
		usb_queue_event(c, USB_SENT, c->talk.out, (size_t)transfer->length, (int64_t)clock_mono_ns(), "sent");
}

static int command_failed(struct usb_capture *c, enum err_code code, const char *how, struct err *err)
{
	struct usb_talk *t = &c->talk;
	const struct profile_command *command = &t->list[t->i];
	size_t kept = t->came_n < sizeof(t->came) ? (size_t)t->came_n : sizeof(t->came);
	char words[160], sent[64], answer[64], came[120];

	usb_device_words(&c->device, words, sizeof(words));
	usb_bytes_words(command->at, command->size, sent, sizeof(sent));
	usb_bytes_words(command->answer, command->answer_size, answer, sizeof(answer));
	usb_bytes_words(t->came, kept, came, sizeof(came));
	if (t->state == USB_TALK_WAITING)
		err_set(err, code, "%s: %s: sent \"%s\", waited %u ms for \"%s\", %llu byte%s came%s%s%s%s", words, how, sent,
			timeout_ms(c), answer, (unsigned long long)t->came_n, t->came_n == 1 ? "" : "s", t->came_n ? ": \"" : "",
			came, t->came_n > kept ? "..." : "", t->came_n ? "\"" : "");
	else
		err_set(err, code, "%s: %s: \"%s\"", words, how, sent);
	err_add_hint(err, "see whether profile %s is for this model, and its timeout", c->profile.name);
	t->i++;
	t->state = USB_TALK_NEXT;
	return -(int)code;
}

static int send_command(struct usb_capture *c, uint64_t now, struct err *err)
{
	struct usb_talk *t = &c->talk;
	const struct profile_command *command = &t->list[t->i];
	int r;

	prepare_answer(t);
	t->returned = false;
	memcpy(t->out, command->at, command->size);
	if (c->out->type == LIBUSB_TRANSFER_TYPE_INTERRUPT)
		libusb_fill_interrupt_transfer(t->transfer, c->handle, c->out->address, t->out, (int)command->size, on_sent, c,
					       timeout_ms(c));
	else
		libusb_fill_bulk_transfer(t->transfer, c->handle, c->out->address, t->out, (int)command->size, on_sent, c,
					  timeout_ms(c));
	r = libusb_submit_transfer(t->transfer);
	if (r == LIBUSB_ERROR_NO_DEVICE) {
		c->left = true;
		return 0;
	}
	if (r)
		return command_failed(c, ERR_IO, "a command could not be sent", err);
	t->flying = true;
	t->state = USB_TALK_SENDING;
	t->deadline = now + (timeout_ms(c) + RETURN_MS) * 1000000ull;
	return 0;
}

static int command_sent(struct usb_capture *c, uint64_t now, struct err *err)
{
	struct usb_talk *t = &c->talk;

	switch (t->transfer->status) {
	case LIBUSB_TRANSFER_COMPLETED:
		if (t->transfer->actual_length < t->transfer->length)
			return command_failed(c, ERR_IO, "the device took a part of a command only", err);
		t->taken = true;
		t->state = USB_TALK_WAITING;
		t->deadline = now + timeout_ms(c) * 1000000ull;
		return 0;
	case LIBUSB_TRANSFER_TIMED_OUT:
		return command_failed(c, ERR_TIMEOUT, "the device did not take a command in time", err);
	case LIBUSB_TRANSFER_STALL:
		libusb_clear_halt(c->handle, c->out->address);
		return command_failed(c, ERR_IO, "the device refused a command (stall)", err);
	case LIBUSB_TRANSFER_NO_DEVICE:
		return 0;
	default: /* often it is just being unplugged, which the kernel will report in a moment */
		t->state = USB_TALK_BROKEN;
		t->deadline = now + BROKEN_MS * 1000000ull;
		return 0;
	}
}

/* libusb's own timeout should have returned it: nothing can be sent any more. */
static int command_stuck(struct usb_capture *c, struct err *err)
{
	int r = command_failed(c, ERR_IO, "a command does not come back", err);

	c->talk.state = USB_TALK_DONE;
	return r;
}

int usb_talk_step(struct usb_capture *c, uint64_t now, struct err *err)
{
	struct usb_talk *t = &c->talk;
	int r = 0;

	while (!r && !c->left && t->state != USB_TALK_DONE) {
		if (t->state == USB_TALK_NEXT && t->i == t->n) {
			t->state = USB_TALK_DONE;
		} else if (t->state == USB_TALK_NEXT) {
			r = send_command(c, now, err);
		} else if (t->state == USB_TALK_SENDING) {
			if (t->returned)
				r = command_sent(c, now, err);
			else if (now < t->deadline)
				return 0;
			else
				r = command_stuck(c, err);
		} else if (t->state == USB_TALK_BROKEN) {
			if (now < t->deadline)
				return 0;
			r = command_failed(c, ERR_IO, "a command failed on the bus", err);
		} else if (t->answered) {
			t->heard = true;
			t->i++;
			t->state = USB_TALK_NEXT;
		} else if (now >= t->deadline) {
			r = command_failed(c, ERR_TIMEOUT, "no answer to a command", err);
		} else {
			return 0;
		}
	}
	return r ? r : t->state == USB_TALK_DONE;
}

bool usb_talk_heard(const struct usb_capture *c)
{
	const struct usb_talk *t = &c->talk;

	return t->heard ||
	       (t->state == USB_TALK_SENDING && t->returned && t->answered && t->transfer->status == LIBUSB_TRANSFER_COMPLETED);
}

bool usb_talk_taken(const struct usb_capture *c)
{
	return c->talk.taken && !c->talk.flying;
}

void usb_talk_cancel(struct usb_capture *c)
{
	if (c->talk.flying)
		libusb_cancel_transfer(c->talk.transfer);
}

uint64_t usb_talk_until(const struct usb_capture *c)
{
	return c->talk.state == USB_TALK_NEXT || c->talk.state == USB_TALK_DONE ? UINT64_MAX : c->talk.deadline;
}
