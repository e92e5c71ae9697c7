/*
 * The list of devices, and hotplug.
 *
 * The list is made from the kernel's folder (usb_sysfs.c), which is read again when libusb's hotplug reports an event,
 * when a caller asks, and each second if udev's events do not arrive. The hotplug callback only queues numbers of bus
 * and device; everything else is done between two rounds of libusb's loop. A device that udev has reported as removed
 * does not count as added again while the folder still has it.
 *
 * No device is opened here.
 */
#include <libusb.h>
#include <net/if.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "clock.h"
#include "grow.h"
#include "log.h"
#include "usb_priv.h"

enum { NOTICES = 1024 };
#define POLL_NS 1000000000u

static int LIBUSB_CALL on_hotplug(libusb_context *context, libusb_device *device, libusb_hotplug_event event, void *ctx)
{
	struct usb *usb = ctx;

	if (!grow(&usb->events, &usb->events_room, usb->events_n + 1, 16, sizeof(*usb->events))) {
		usb->events_lost = true; /* the list is read anyway */
		return 0;
	}
	usb->events[usb->events_n++] = (struct usb_event){.left = event == LIBUSB_HOTPLUG_EVENT_DEVICE_LEFT,
							  .bus = libusb_get_bus_number(device),
							  .address = libusb_get_device_address(device)};
	return 0;
}

/* In a separate network namespace: udev sends its messages only in the host's. */
static bool has_own_network(void)
{
	struct if_nameindex *all = if_nameindex();
	bool alone = true;

	for (size_t i = 0; all && all[i].if_index; i++)
		alone = alone && !strcmp(all[i].if_name, "lo");
	if (all)
		if_freenameindex(all);
	return alone;
}

void usb_watch_start(struct usb *usb)
{
	const char *why = NULL;
	int r;

	if (!usb->context) {
		why = "there is no USB here";
	} else if (!libusb_has_capability(LIBUSB_CAP_HAS_HOTPLUG)) {
		why = "libusb was built without hotplug";
	} else {
		r = libusb_hotplug_register_callback(usb->context,
						     LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED | LIBUSB_HOTPLUG_EVENT_DEVICE_LEFT, 0,
						     LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY,
						     on_hotplug, usb, &usb->hotplug);
		usb->registered = r == 0;
		if (r)
			why = "libusb's hotplug cannot be used";
		else if (usb->polls)
			why = usb->polls; /* no monitor */
		else if (access("/run/udev/control", F_OK))
			why = "udev does not run here";
		else if (has_own_network())
			why = "udev's messages do not get into this network namespace (PrivateNetwork=)";
	}
	pthread_mutex_lock(&usb->lock);
	usb->polls = why;
	pthread_mutex_unlock(&usb->lock);
	if (why)
		log_debug("usb: %s; the list is looked at each second", why);
}

void usb_watch_stop(struct usb *usb)
{
	if (usb->registered)
		libusb_hotplug_deregister_callback(usb->context, usb->hotplug);
	usb->registered = false;
}

/* Under the lock. */
static void queue_notice(struct usb *usb, enum usb_change change, const struct usb_device *device)
{
	struct usb_notice *notice = malloc(sizeof(*notice)), *old;

	if (!notice) {
		log_warning("usb: no memory to tell what came or left at %s", device->port);
		return;
	}
	*notice = (struct usb_notice){.change = change, .device = *device};
	if (usb->last)
		usb->last->next = notice;
	else
		usb->first = notice;
	usb->last = notice;
	if (++usb->notices > NOTICES) { /* nobody takes them */
		old = usb->first;
		usb->first = old->next;
		usb->notices--;
		free(old);
	}
	eventfd_write(usb->watch_fd, 1);
}

static void mark_left(struct usb *usb, uint8_t bus, uint8_t address)
{
	for (struct usb_capture *c = usb->captures; c; c = c->next)
		c->left = c->left || (c->device.bus == bus && c->device.address == address);
}

static struct usb_known *find_known(struct usb *usb, uint8_t bus, uint8_t address)
{
	for (size_t i = 0; i < usb->n; i++) {
		if (usb->known[i].device.bus == bus && usb->known[i].device.address == address)
			return &usb->known[i];
	}
	return NULL;
}

static void remove_known(struct usb *usb, struct usb_known *known)
{
	*known = usb->known[--usb->n];
}

static int match_profile(struct usb *usb, const struct usb_device *device)
{
	struct profile_device told = {
		.vendor = device->vendor,
		.product = device->product,
		.device_class = device->device_class,
		.interface_classes = device->interface_classes,
		.interfaces = device->interfaces,
		.serial = device->serial[0] ? device->serial : NULL,
	};
	const struct profile_entry *entry = usb->profiles ? profile_set_match(usb->profiles, &told) : NULL;

	for (size_t i = 0; entry && i < profile_set_count(usb->profiles); i++) {
		if (profile_set_at(usb->profiles, i) == entry)
			return (int)i;
	}
	return -1;
}

/* Under the lock. False: no memory. */
static bool add_known(struct usb *usb, const struct usb_device *device, bool silent)
{
	if (!grow(&usb->known, &usb->room, usb->n + 1, 16, sizeof(*usb->known)))
		return false;
	usb->known[usb->n] = (struct usb_known){.device = *device, .seen = true};
	usb->known[usb->n].device.profile = match_profile(usb, device);
	if (!silent)
		queue_notice(usb, USB_CAME, &usb->known[usb->n].device);
	usb->n++;
	return true;
}

static bool same_device(const struct usb_device *a, const struct usb_device *b)
{
	return a->vendor == b->vendor && a->product == b->product && !strcmp(a->port, b->port) && !strcmp(a->serial, b->serial);
}

/* Under the lock. */
static bool merge_list(struct usb *usb, const struct usb_device *list, size_t n, bool silent)
{
	bool whole = true;

	for (size_t i = 0; i < usb->n; i++)
		usb->known[i].seen = false;
	for (size_t i = 0; i < n; i++) {
		struct usb_known *known = find_known(usb, list[i].bus, list[i].address);

		if (known && !same_device(&known->device, &list[i])) { /* the number was assigned to another device */
			if (!known->gone)
				queue_notice(usb, USB_LEFT, &known->device);
			mark_left(usb, known->device.bus, known->device.address);
			remove_known(usb, known);
			known = NULL;
		}
		if (known)
			known->seen = true;
		else
			whole = add_known(usb, &list[i], silent) && whole;
	}
	for (size_t i = 0; i < usb->n;) {
		struct usb_known *known = &usb->known[i];

		if (known->seen) {
			i++;
			continue;
		}
		if (!known->gone) {
			queue_notice(usb, USB_LEFT, &known->device);
			mark_left(usb, known->device.bus, known->device.address);
		}
		remove_known(usb, known);
	}
	return whole;
}

void usb_watch_scan(struct usb *usb)
{
	struct usb_device *list = NULL;
	struct err err = ERR_INIT;
	size_t n = 0;
	int r = usb_sysfs_list(USB_SYSFS, &list, &n, &err);

	if (r)
		log_err(LOG_LEVEL_DEBUG, "usb", &err);
	pthread_mutex_lock(&usb->lock);
	if (!r && !merge_list(usb, list, n, usb->scan_done == 0))
		r = -ERR_NOMEM;
	usb->scan_failed = r;
	pthread_mutex_unlock(&usb->lock);
	free(list);
}

static void handle_event(struct usb *usb, const struct usb_event *event)
{
	struct usb_known *known = find_known(usb, event->bus, event->address);

	if (event->left)
		mark_left(usb, event->bus, event->address);
	if (event->left && known && !known->gone) {
		known->gone = true;
		queue_notice(usb, USB_LEFT, &known->device);
	}
	if (!event->left && known && known->gone)
		remove_known(usb, known); /* it is new again */
}

void usb_watch_step(struct usb *usb)
{
	uint64_t now = clock_mono_ns(), wanted;
	bool scan = usb->events_n || usb->events_lost;

	pthread_mutex_lock(&usb->lock);
	for (size_t i = 0; i < usb->events_n; i++)
		handle_event(usb, &usb->events[i]);
	wanted = usb->scan_wanted;
	scan = scan || wanted > usb->scan_done;
	if (usb->polls && now >= usb->poll_at) {
		usb->poll_at = now + POLL_NS;
		scan = true;
	}
	pthread_mutex_unlock(&usb->lock);
	usb->events_n = 0;
	usb->events_lost = false;
	if (!scan)
		return;
	usb_watch_scan(usb);
	pthread_mutex_lock(&usb->lock);
	usb->scan_done = wanted;
	pthread_cond_broadcast(&usb->scanned);
	pthread_mutex_unlock(&usb->lock);
}

bool usb_watch_present(struct usb *usb, const struct usb_device *device)
{
	struct usb_known *known;
	bool there;

	pthread_mutex_lock(&usb->lock);
	known = find_known(usb, device->bus, device->address);
	there = known && !known->gone && same_device(&known->device, device);
	pthread_mutex_unlock(&usb->lock);
	return there;
}

int usb_watch_fd(struct usb *usb)
{
	return usb->watch_fd;
}

int usb_change(struct usb *usb, enum usb_change *ret, struct usb_device *ret_device)
{
	struct usb_notice *notice;
	eventfd_t count;

	pthread_mutex_lock(&usb->lock);
	notice = usb->first;
	if (notice) {
		usb->first = notice->next;
		usb->notices--;
	}
	if (!usb->first) {
		usb->last = NULL;
		eventfd_read(usb->watch_fd, &count);
	}
	pthread_mutex_unlock(&usb->lock);
	if (!notice)
		return 0;
	*ret = notice->change;
	*ret_device = notice->device;
	usb_access(ret_device); /* udev may have changed permissions since */
	free(notice);
	return 1;
}
