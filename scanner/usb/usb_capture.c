/*
 * The caller's side of a capture: it is created here and passed to the thread, which steps it (usb_step.c) until it has
 * ended; from then on it belongs to the caller.
 */
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "usb_priv.h"

static void request_stop(struct usb_capture *c, bool abandon)
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

static void capture_destroy(struct usb_capture *c)
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

static struct usb_capture *capture_create(struct usb *usb, const struct usb_device *device, const struct profile *profile)
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

/* Waits until the thread has finished the start; a stop is passed on and waited for, too. */
static void wait_for_start(struct usb *usb, struct usb_capture *c)
{
	struct pollfd p[2] = {{.fd = c->start_fd, .events = POLLIN}, {.fd = usb->stop_fd, .events = POLLIN}};

	while (poll(p, 2, -1) < 0 || !p[0].revents) {
		if (p[1].revents) {
			p[1].fd = -1;
			p[1].revents = 0;
			request_stop(c, false);
		}
	}
}

int usb_capture_start(struct usb *usb, const struct usb_device *device, const struct profile *profile, struct usb_capture **ret,
		      struct err *err)
{
	struct usb_capture *c = capture_create(usb, device, profile);
	bool ready;

	if (!c)
		return err_set(err, ERR_NOMEM, "no memory for a capture");
	if (c->fd < 0 || c->start_fd < 0) {
		err_sys(err, errno, "no descriptor for a capture");
		capture_destroy(c);
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
	capture_destroy(c);
	return -(int)err->code;
}

void usb_capture_stop(struct usb_capture *c)
{
	request_stop(c, false);
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
		request_stop(c, true);
	pthread_mutex_lock(&c->lock);
	while (!c->ended)
		pthread_cond_wait(&c->changed, &c->lock);
	pthread_mutex_unlock(&c->lock);
	capture_destroy(c);
	return NULL;
}
