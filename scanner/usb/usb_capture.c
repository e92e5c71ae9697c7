/*
 * A capture as its caller has it: made here, handed to the thread, which steps it (usb_step.c) until it has ended;
 * from then on it is the caller's alone.
 */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "usb_priv.h"

static void ask_to_stop(struct usb_capture *c, bool abandon)
{
	bool wake;

	pthread_mutex_lock(&c->lock);
	c->stop = true;
	c->abandon = c->abandon || abandon;
	wake = !c->ended;
	pthread_mutex_unlock(&c->lock);
	if (wake)
		usb_wake(c->usb);
}

static void destroy(struct usb_capture *c)
{
	struct usb_item *item;

	while ((item = c->first)) {
		c->first = item->next;
		if (!item->slot)
			free(item);
	}
	while ((item = c->held)) {
		c->held = item->next;
		free(item);
	}
	usb_slots_free(c);
	if (c->fd >= 0)
		close(c->fd);
	if (c->start_fd >= 0)
		close(c->start_fd);
	pthread_cond_destroy(&c->changed);
	pthread_mutex_destroy(&c->lock);
	free(c);
}

static struct usb_capture *create(struct usb *usb, const struct usb_device *device, const struct profile *profile)
{
	struct usb_capture *c = calloc(1, sizeof(*c));

	if (!c)
		return NULL;
	c->usb = usb;
	c->device = *device;
	c->profile = *profile;
	c->err = ERR_INIT;
	c->node_fd = -1;
	pthread_mutex_init(&c->lock, NULL);
	pthread_cond_init(&c->changed, NULL);
	c->fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	c->start_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	return c;
}

/* Until the thread says so; a stop is passed on and waited for, too. */
static void wait_for_start(struct usb *usb, struct usb_capture *c)
{
	struct pollfd p[2] = {{.fd = c->start_fd, .events = POLLIN}, {.fd = usb->stop_fd, .events = POLLIN}};

	while (poll(p, 2, -1) < 0 || !p[0].revents) {
		if (p[1].revents) {
			p[1].fd = -1;
			p[1].revents = 0;
			ask_to_stop(c, false);
		}
	}
}

int usb_capture_start(struct usb *usb, const struct usb_device *device, const struct profile *profile, struct usb_capture **ret,
		      struct err *err)
{
	struct usb_capture *c = create(usb, device, profile);
	bool ready;

	if (!c)
		return err_set(err, ERR_NOMEM, "no memory for a capture");
	if (c->fd < 0 || c->start_fd < 0) {
		err_sys(err, errno, "no descriptor for a capture");
		destroy(c);
		return -(int)err->code;
	}
	pthread_mutex_lock(&usb->lock);
	c->next = usb->starting;
	usb->starting = c;
	pthread_mutex_unlock(&usb->lock);
	usb_wake(usb);
	wait_for_start(usb, c);
	pthread_mutex_lock(&c->lock);
	ready = c->ready;
	pthread_mutex_unlock(&c->lock);
	if (ready) {
		*ret = c;
		return 0;
	}
	if (err->code == ERR_NONE)
		*err = c->err;
	destroy(c);
	return -(int)err->code;
}

void usb_capture_stop(struct usb_capture *c)
{
	ask_to_stop(c, false);
}

struct usb_capture *usb_capture_free(struct usb_capture *c)
{
	bool ended;

	if (!c)
		return NULL;
	pthread_mutex_lock(&c->lock);
	ended = c->ended;
	pthread_mutex_unlock(&c->lock);
	if (!ended)
		ask_to_stop(c, true);
	pthread_mutex_lock(&c->lock);
	while (!c->ended)
		pthread_cond_wait(&c->changed, &c->lock);
	pthread_mutex_unlock(&c->lock);
	destroy(c);
	return NULL;
}
