/*
 * From a device of the list to transfers that can be submitted: check the permission, the profile against the device's
 * descriptors, and the memory; then open, configure, claim, choose the setting. Each error has a hint.
 *
 * A kernel driver is detached from the profile's interface only, and reattached when the interface is released. Nothing
 * is ever done with a device that has a mass storage interface.
 */
#include <errno.h>
#include <fcntl.h>
#include <libusb.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "log.h"
#include "usb_priv.h"

enum { SPARE_SIZE = 16384, TRANSFERS_MAX = 4096, PAGE = 4096 };

static int usb_failed(struct usb_capture *c, int r, const char *what)
{
	char words[160];

	switch (r) {
	case LIBUSB_ERROR_NO_DEVICE:
		return usb_refusal_left(&c->device, "while it was started", &c->err);
	case LIBUSB_ERROR_ACCESS:
		return usb_refusal_mode(&c->device, EACCES, &c->err);
	case LIBUSB_ERROR_BUSY:
		return usb_refusal_busy(&c->device, c->setting.configuration, c->profile.interface, &c->err);
	case LIBUSB_ERROR_NO_MEM:
		return err_set(&c->err, ERR_NOMEM, "no memory to open a device");
	}
	err_set(&c->err, ERR_IO, "%s: %s: %s", usb_device_words(&c->device, words, sizeof(words)), what, libusb_strerror(r));
	return err_add_hint(&c->err, "unplug it and plug it in again");
}

static int profile_misfit(struct usb_capture *c, const char *fmt, unsigned a, unsigned b)
{
	char words[160], text[200];

	snprintf(text, sizeof(text), fmt, a, b);
	err_set(&c->err, ERR_INPUT, "profile %s does not fit %s: %s", c->profile.name,
		usb_device_words(&c->device, words, sizeof(words)), text);
	return err_add_hint(&c->err, "lsusb -v -d %04x:%04x shows what the device has", c->device.vendor, c->device.product);
}

static bool is_stream(const struct usb_endpoint *endpoint)
{
	return endpoint->type == LIBUSB_TRANSFER_TYPE_BULK || endpoint->type == LIBUSB_TRANSFER_TYPE_INTERRUPT;
}

static int check_endpoints(struct usb_capture *c)
{
	const struct profile *p = &c->profile;

	c->in = usb_setting_endpoint(&c->setting, p->endpoint_in);
	c->out = p->endpoint_out ? usb_setting_endpoint(&c->setting, p->endpoint_out) : NULL;
	if (!c->in || !(p->endpoint_in & LIBUSB_ENDPOINT_IN))
		return profile_misfit(c, "interface %2$u has no endpoint 0x%1$02x to read from", p->endpoint_in, p->interface);
	if (!is_stream(c->in))
		return profile_misfit(c, "endpoint 0x%02x is of type %u, not bulk or interrupt", p->endpoint_in, c->in->type);
	if (p->endpoint_out && (!c->out || p->endpoint_out & LIBUSB_ENDPOINT_IN || !is_stream(c->out)))
		return profile_misfit(c, "interface %2$u has no endpoint 0x%1$02x to write to", p->endpoint_out, p->interface);
	if (!p->endpoint_out && p->starts + p->stops)
		return profile_misfit(c, "it has %u commands to send, but no endpoint to write to%.0u",
				      (unsigned)(p->starts + p->stops), 0);
	if (!p->transfers || p->transfers > TRANSFERS_MAX || !p->transfer_size || p->transfer_size > INT32_MAX)
		return profile_misfit(c, "%u transfers of %u bytes cannot be made", p->transfers, p->transfer_size);
	if (c->in->packet && p->transfer_size % c->in->packet)
		return profile_misfit(c, "transfer_size %u is no multiple of the endpoint's packet, %u bytes", p->transfer_size,
				      c->in->packet);
	return 0;
}

/* Mass storage by the current descriptors, not by those that the caller has. */
static int check_device(struct usb_capture *c)
{
	uint8_t descriptors[USB_DESCRIPTORS_MAX];
	struct usb_device now = c->device;
	unsigned configuration = usb_sysfs_configuration(USB_SYSFS, c->device.port);
	size_t size;
	int r = usb_sysfs_descriptors(USB_SYSFS, c->device.port, descriptors, sizeof(descriptors), &size);

	if (r || !usb_watch_present(c->usb, &c->device) || !usb_descriptor_device(descriptors, size, configuration, &now) ||
	    now.vendor != c->device.vendor || now.product != c->device.product)
		return usb_refusal_left(&c->device, "before it was started", &c->err);
	if (now.mass_storage || c->device.mass_storage)
		return usb_refusal_storage(&c->device, &c->err);
	if (c->profile.configuration)
		configuration = c->profile.configuration;
	if (!usb_descriptor_setting(descriptors, size, configuration, c->profile.interface, c->profile.alternate, &c->setting))
		return profile_misfit(c, "it has no interface %u with setting %u", c->profile.interface, c->profile.alternate);
	usb_access(&now);
	if (now.refused == ENOENT)
		return usb_refusal_left(&c->device, "before it was started", &c->err);
	if (now.refused)
		return usb_refusal_mode(&c->device, now.refused, &c->err);
	return check_endpoints(c);
}

static int check_memory(struct usb_capture *c, uint64_t others)
{
	struct usb_limit limit;
	int r = usb_limit_read(USB_MEMORY_FILE, &limit, &c->err);

	if (r)
		return r;
	if (limit.assumed)
		log_debug("usb: " USB_MEMORY_FILE " cannot be read: %llu MB are assumed",
			  (unsigned long long)(limit.bytes >> 20));
	return usb_limit_check(&limit, &c->profile, others, &c->err);
}

static bool matches_device(libusb_device *device, const struct usb_device *wanted)
{
	struct libusb_device_descriptor d;
	size_t last = strlen(wanted->port);

	while (last && wanted->port[last - 1] >= '0' && wanted->port[last - 1] <= '9')
		last--;
	return libusb_get_bus_number(device) == wanted->bus && libusb_get_device_address(device) == wanted->address &&
	       libusb_get_port_number(device) == atoi(wanted->port + last) && libusb_get_device_descriptor(device, &d) == 0 &&
	       d.idVendor == wanted->vendor && d.idProduct == wanted->product;
}

/* A device that libusb does not list (udev's events do not arrive here) is opened by its node. */
static int open_node(struct usb_capture *c)
{
	c->node_fd = open(c->device.node, O_RDWR | O_CLOEXEC);
	if (c->node_fd < 0 && (errno == EACCES || errno == EPERM))
		return usb_refusal_mode(&c->device, errno, &c->err);
	if (c->node_fd < 0)
		return usb_refusal_left(&c->device, "while it was started", &c->err);
	return libusb_wrap_sys_device(c->usb->context, (intptr_t)c->node_fd, &c->handle);
}

static int open_device(struct usb_capture *c)
{
	libusb_device **list = NULL;
	bool found = false;
	ssize_t n = libusb_get_device_list(c->usb->context, &list);
	int r = 0;

	for (ssize_t i = 0; i < n && !found; i++) {
		found = matches_device(list[i], &c->device);
		if (found)
			r = libusb_open(list[i], &c->handle);
	}
	if (n >= 0)
		libusb_free_device_list(list, 1);
	if (!found)
		r = open_node(c);
	if (c->err.code)
		return -(int)c->err.code;
	return r ? usb_failed(c, r, "it cannot be opened") : 0;
}

static int claim_interface(struct usb_capture *c)
{
	const struct profile *p = &c->profile;
	char driver[64];
	int r = 0;

	if (p->configuration && p->configuration != usb_sysfs_configuration(USB_SYSFS, c->device.port))
		r = libusb_set_configuration(c->handle, (int)p->configuration);
	if (r)
		return usb_failed(c, r, "its configuration cannot be set");
	usb_sysfs_driver(USB_SYSFS, c->device.port, c->setting.configuration, p->interface, driver, sizeof(driver));
	if (!strcmp(driver, "usb-storage") || !strcmp(driver, "uas"))
		return usb_refusal_storage(&c->device, &c->err);
	if (libusb_kernel_driver_active(c->handle, (int)p->interface) == 1)
		libusb_set_auto_detach_kernel_driver(c->handle, 1);
	r = libusb_claim_interface(c->handle, (int)p->interface);
	if (r)
		return usb_failed(c, r, "its interface cannot be claimed");
	c->claimed = true;
	if (p->alternate)
		r = libusb_set_interface_alt_setting(c->handle, (int)p->interface, (int)p->alternate);
	return r ? usb_failed(c, r, "its setting cannot be chosen") : 0;
}

static bool slot_init(struct usb_capture *c, struct usb_slot *slot, uint32_t size)
{
	void *at;

	slot->transfer = libusb_alloc_transfer(0);
	if (!slot->transfer || posix_memalign(&at, PAGE, size))
		return false;
	slot->at = at;
	usb_transfer_fill(c, slot, size);
	return true;
}

static int allocate_slots(struct usb_capture *c)
{
	uint32_t packet = c->in->packet ? c->in->packet : 1, spare = (SPARE_SIZE + packet - 1) / packet * packet;
	bool whole;

	c->slots = calloc(c->profile.transfers, sizeof(*c->slots));
	c->slots_n = c->slots ? c->profile.transfers : 0;
	c->talk.transfer = libusb_alloc_transfer(0);
	whole = c->slots && c->talk.transfer && slot_init(c, &c->spare, spare);
	for (uint32_t i = c->slots_n; whole && i-- > 0;) {
		whole = slot_init(c, &c->slots[i], c->profile.transfer_size);
		usb_slot_free(c, &c->slots[i]);
	}
	if (whole)
		return 0;
	return err_set(&c->err, ERR_NOMEM, "no memory for %u transfers of %u bytes", c->profile.transfers,
		       c->profile.transfer_size);
}

int usb_open_device(struct usb_capture *c, uint64_t others)
{
	int r = check_device(c);

	if (r == 0)
		r = check_memory(c, others);
	if (r == 0 && !c->usb->context)
		r = usb_refusal_left(&c->device, "before it was started", &c->err);
	if (r == 0)
		r = open_device(c);
	if (r == 0)
		r = claim_interface(c);
	if (r == 0)
		r = allocate_slots(c);
	return r;
}

void usb_close_device(struct usb_capture *c)
{
	if (c->claimed)
		libusb_release_interface(c->handle, (int)c->profile.interface);
	if (c->handle)
		libusb_close(c->handle);
	if (c->node_fd >= 0)
		close(c->node_fd);
	c->claimed = false;
	c->handle = NULL;
	c->node_fd = -1;
}

static void slot_done(struct usb_slot *slot)
{
	libusb_free_transfer(slot->transfer);
	free(slot->at);
}

void usb_slots_free(struct usb_capture *c)
{
	for (uint32_t i = 0; i < c->slots_n; i++)
		slot_done(&c->slots[i]);
	slot_done(&c->spare);
	libusb_free_transfer(c->talk.transfer);
	free(c->slots);
}
