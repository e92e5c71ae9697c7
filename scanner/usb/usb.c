/*
 * The thread of libusb. Only this thread calls libusb. It waits in libusb's event loop, and between two rounds it
 * handles what callers have queued (a list, a new capture, returned buffers, a stop) and what hotplug has queued, and
 * runs the next step of each capture. Callers wake it with libusb's interrupt, and never wait for a device except in
 * usb_capture_start.
 *
 * If the kernel has no USB, the thread checks for it each second; everything else is as with an empty bus.
 *
 * It does not interpret bytes.
 */
#include "usb.h"

#include <errno.h>
#include <libusb.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "clock.h"
#include "log.h"
#include "usb_priv.h"

#define HOUR_NS 3600000000000u
enum { FAILURES_MAX = 100, FAILURE_NAP_US = 10000 };

static void LIBUSB_CALL on_log(libusb_context *context, enum libusb_log_level level, const char *text)
{
	log_debug("%.*s", (int)strcspn(text, "\n"), text);
}

/* Without udev's socket (no AF_NETLINK) libusb's hotplug does not work; then it is opened without it. */
static libusb_context *open_context(const char **ret_polls)
{
	libusb_context *context = NULL;
	int r;

	if (access(USB_NODES, R_OK | X_OK))
		return NULL;
	/* a context's own callback is called in addition to writing to stderr */
	libusb_set_log_cb(NULL, on_log, LIBUSB_LOG_CB_GLOBAL);
	r = libusb_init(&context);
	if (r) {
		log_debug("usb: libusb does not start with its list of devices (%s)", libusb_error_name(r));
		*ret_polls = "udev cannot be listened to";
		r = libusb_set_option(NULL, LIBUSB_OPTION_NO_DEVICE_DISCOVERY);
		if (!r)
			r = libusb_init(&context);
	}
	if (r) {
		log_debug("usb: libusb does not start (%s)", libusb_error_name(r));
		return NULL;
	}
	libusb_set_option(context, LIBUSB_OPTION_LOG_LEVEL,
			  log_enabled(LOG_LEVEL_DEBUG) ? LIBUSB_LOG_LEVEL_INFO : LIBUSB_LOG_LEVEL_ERROR);
	return context;
}

void usb_wake(struct usb *usb)
{
	pthread_mutex_lock(&usb->lock);
	if (usb->context)
		libusb_interrupt_event_handler(usb->context);
	else
		eventfd_write(usb->wake_fd, 1);
	pthread_mutex_unlock(&usb->lock);
}

/* ---- the thread ---- */

static void wait_without(struct usb *usb)
{
	struct pollfd p = {.fd = usb->wake_fd, .events = POLLIN};
	libusb_context *context;
	const char *polls = NULL;
	eventfd_t count;

	poll(&p, 1, 1000);
	eventfd_read(usb->wake_fd, &count);
	context = open_context(&polls);
	if (!context)
		return;
	pthread_mutex_lock(&usb->lock);
	usb->context = context;
	usb->polls = polls;
	pthread_mutex_unlock(&usb->lock);
	usb_watch_start(usb);
}

/* A loop that fails repeatedly (the node no longer answers) must neither spin nor wait forever. */
static void loop_failed(struct usb *usb, int r)
{
	log_debug("usb: libusb's loop: %s", libusb_error_name(r));
	usleep(FAILURE_NAP_US);
	if (++usb->failures < FAILURES_MAX)
		return;
	usb->failures = 0;
	for (struct usb_capture *c = usb->captures; c; c = c->next)
		c->left = true;
}

static void wait_with(struct usb *usb, uint64_t until)
{
	uint64_t now = clock_mono_ns(), ns = until > now ? until - now : 0;
	struct timeval tv = {.tv_sec = (time_t)(ns / 1000000000), .tv_usec = (suseconds_t)(ns % 1000000000 / 1000 + 1)};
	int r;

	if (tv.tv_usec > 999999)
		tv.tv_usec = 999999;
	r = libusb_handle_events_timeout_completed(usb->context, &tv, NULL);
	if (r == 0 || r == LIBUSB_ERROR_INTERRUPTED || r == LIBUSB_ERROR_TIMEOUT)
		usb->failures = 0;
	else
		loop_failed(usb, r);
}

/* Steps all captures; those that have ended belong to their callers. */
static uint64_t step_all(struct usb *usb, bool quit)
{
	struct usb_capture **at = &usb->captures, *c;
	uint64_t now = clock_mono_ns(), until = now + HOUR_NS, next;

	while ((c = *at)) {
		if (quit) {
			pthread_mutex_lock(&c->lock);
			c->stop = c->abandon = true;
			pthread_mutex_unlock(&c->lock);
		}
		next = usb_step(c, now);
		until = next < until ? next : until;
		if (c->phase != USB_PHASE_ENDED) {
			at = &c->next;
			continue;
		}
		*at = c->next;
		usb_queue_end(c); /* from here on it may be freed */
	}
	return until;
}

static void *run(void *arg)
{
	struct usb *usb = arg;
	struct usb_capture *starting, *c;
	uint64_t until;
	bool quit;

	for (;;) {
		usb_watch_step(usb);
		pthread_mutex_lock(&usb->lock);
		quit = usb->quit;
		starting = usb->starting;
		usb->starting = NULL;
		pthread_mutex_unlock(&usb->lock);
		while ((c = starting)) {
			starting = c->next;
			usb_step_begin(c);
			c->next = usb->captures;
			usb->captures = c;
		}
		until = step_all(usb, quit);
		if (quit && !usb->captures)
			return NULL;
		if (usb->polls && usb->poll_at < until)
			until = usb->poll_at;
		if (usb->context)
			wait_with(usb, until);
		else
			wait_without(usb);
	}
}

/* ---- callers ---- */

int usb_new(const struct profile_set *profiles, struct usb **ret, struct err *err)
{
	struct usb *usb = calloc(1, sizeof(*usb));
	int r;

	if (!usb)
		return err_set(err, ERR_NOMEM, "no memory to look for scanners");
	usb->profiles = profiles;
	usb->stop_fd = -1;
	pthread_mutex_init(&usb->lock, NULL);
	pthread_cond_init(&usb->scanned, NULL);
	usb->wake_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	usb->watch_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	if (usb->wake_fd < 0 || usb->watch_fd < 0) {
		err_sys(err, errno, "no descriptor to wait for scanners with");
		usb_free(usb);
		return -(int)err->code;
	}
	usb->context = open_context(&usb->polls);
	usb_watch_start(usb);
	usb->scan_wanted = 1;
	usb_watch_step(usb); /* existing devices are not changes */
	r = pthread_create(&usb->thread, NULL, run, usb);
	if (r) {
		usb->thread = 0;
		err_sys(err, r, "no thread for libusb");
		usb_free(usb);
		return -(int)err->code;
	}
	pthread_setname_np(usb->thread, "usb");
	*ret = usb;
	return 0;
}

struct usb *usb_free(struct usb *usb)
{
	struct usb_notice *notice;

	if (!usb)
		return NULL;
	if (usb->thread) {
		pthread_mutex_lock(&usb->lock);
		usb->quit = true;
		pthread_mutex_unlock(&usb->lock);
		usb_wake(usb);
		pthread_join(usb->thread, NULL);
	}
	usb_watch_stop(usb);
	if (usb->context)
		libusb_exit(usb->context);
	while ((notice = usb->first)) {
		usb->first = notice->next;
		free(notice);
	}
	if (usb->wake_fd >= 0)
		close(usb->wake_fd);
	if (usb->watch_fd >= 0)
		close(usb->watch_fd);
	pthread_cond_destroy(&usb->scanned);
	pthread_mutex_destroy(&usb->lock);
	free(usb->known);
	free(usb->events);
	free(usb);
	return NULL;
}

void usb_set_stop_fd(struct usb *usb, int fd)
{
	usb->stop_fd = fd;
}

const char *usb_polls(struct usb *usb)
{
	const char *why;

	pthread_mutex_lock(&usb->lock);
	why = usb->polls;
	pthread_mutex_unlock(&usb->lock);
	return why;
}

static int by_port(const void *a, const void *b)
{
	return strverscmp(((const struct usb_device *)a)->port, ((const struct usb_device *)b)->port);
}

/* Under the lock. */
static void drop_notices(struct usb *usb)
{
	struct usb_notice *notice;
	eventfd_t count;

	while ((notice = usb->first)) {
		usb->first = notice->next;
		free(notice);
	}
	usb->last = NULL;
	usb->notices = 0;
	eventfd_read(usb->watch_fd, &count);
}

static int list_now(struct usb *usb, bool all, bool begins, struct usb_device **ret, size_t *ret_n, struct err *err)
{
	struct usb_device *list;
	uint64_t ticket;
	size_t n = 0;
	int failed;

	pthread_mutex_lock(&usb->lock);
	ticket = ++usb->scan_wanted;
	pthread_mutex_unlock(&usb->lock);
	usb_wake(usb);
	pthread_mutex_lock(&usb->lock);
	while (usb->scan_done < ticket)
		pthread_cond_wait(&usb->scanned, &usb->lock);
	if (begins)
		drop_notices(usb);
	failed = usb->scan_failed;
	list = calloc(usb->n ? usb->n : 1, sizeof(*list));
	for (size_t i = 0; list && i < usb->n; i++) {
		if (!usb->known[i].gone && (all || usb->known[i].device.profile >= 0))
			list[n++] = usb->known[i].device;
	}
	pthread_mutex_unlock(&usb->lock);
	if (!list || failed == -ERR_NOMEM) {
		free(list);
		return err_set(err, ERR_NOMEM, "no memory for the list of devices");
	}
	if (failed) {
		free(list);
		err_set(err, ERR_IO, "the devices on the bus cannot be listed");
		return err_add_file(err, USB_SYSFS);
	}
	for (size_t i = 0; i < n; i++)
		usb_access(&list[i]);
	qsort(list, n, sizeof(*list), by_port);
	*ret = list;
	*ret_n = n;
	return 0;
}

int usb_list(struct usb *usb, bool all, struct usb_device **ret, size_t *ret_n, struct err *err)
{
	return list_now(usb, all, false, ret, ret_n, err);
}

int usb_list_begin(struct usb *usb, bool all, struct usb_device **ret, size_t *ret_n, struct err *err)
{
	return list_now(usb, all, true, ret, ret_n, err);
}
