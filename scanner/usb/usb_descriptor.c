/*
 * Descriptors as in the kernel's file "descriptors": the device's, then each configuration with everything that belongs
 * to it (USB 2.0, 9.5 and 9.6). They come from the device and are not trusted: a length of 0 or beyond the end ends the
 * walk.
 *
 * It does not talk to a device, and does not parse class descriptors.
 */
#include <string.h>

#include "usb_priv.h"

enum {
	DESCRIPTOR_CONFIGURATION = 2,
	DESCRIPTOR_INTERFACE = 4,
	DESCRIPTOR_ENDPOINT = 5,
	DEVICE_SIZE = 18,
	CONFIGURATION_SIZE = 9,
	INTERFACE_SIZE = 9,
	ENDPOINT_SIZE = 7
};

static unsigned le16(const uint8_t *at)
{
	return at[0] | (unsigned)at[1] << 8;
}

/* Returns the descriptor at *offset and advances *offset; NULL at the end. */
static const uint8_t *next_descriptor(const uint8_t *at, size_t size, size_t *offset)
{
	const uint8_t *here = at + *offset;

	if (*offset + 2 > size || here[0] < 2 || here[0] > size - *offset)
		return NULL;
	*offset += here[0];
	return here;
}

static void note_interface(struct usb_device *device, const uint8_t *interface, unsigned *last)
{
	if (interface[5] == USB_CLASS_STORAGE)
		device->mass_storage = true;
	if (interface[2] == *last || device->interfaces == USB_INTERFACES)
		return; /* another setting of the same interface */
	*last = interface[2];
	device->interface_classes[device->interfaces++] = interface[5];
}

bool usb_descriptor_device(const uint8_t *at, size_t size, unsigned configuration, struct usb_device *ret)
{
	size_t offset = DEVICE_SIZE;
	unsigned current = 0, last = 256;
	const uint8_t *d;

	if (size < DEVICE_SIZE || at[0] < DEVICE_SIZE || at[1] != 1)
		return false;
	ret->vendor = (uint16_t)le16(at + 8);
	ret->product = (uint16_t)le16(at + 10);
	ret->device_class = at[4];
	ret->interfaces = 0;
	ret->mass_storage = at[4] == USB_CLASS_STORAGE;
	while ((d = next_descriptor(at, size, &offset))) {
		if (d[1] == DESCRIPTOR_CONFIGURATION && d[0] >= CONFIGURATION_SIZE) {
			current = d[5];
			if (!configuration)
				configuration = current;
		}
		if (d[1] != DESCRIPTOR_INTERFACE || d[0] < INTERFACE_SIZE)
			continue;
		if (current == configuration)
			note_interface(ret, d, &last);
		else if (d[5] == USB_CLASS_STORAGE)
			ret->mass_storage = true; /* in any configuration */
	}
	return true;
}

bool usb_descriptor_setting(const uint8_t *at, size_t size, unsigned configuration, unsigned interface, unsigned alternate,
			    struct usb_setting *ret)
{
	size_t offset = DEVICE_SIZE;
	unsigned current = 0;
	bool inside = false, found = false;
	const uint8_t *d;

	if (size < DEVICE_SIZE)
		return false;
	while ((d = next_descriptor(at, size, &offset))) {
		if (d[1] == DESCRIPTOR_CONFIGURATION && d[0] >= CONFIGURATION_SIZE) {
			current = d[5];
			inside = false;
		} else if (d[1] == DESCRIPTOR_INTERFACE && d[0] >= INTERFACE_SIZE) {
			inside = !found && (!configuration || current == configuration) && d[2] == interface && d[3] == alternate;
			if (!inside)
				continue;
			found = true;
			*ret = (struct usb_setting){
				.configuration = (uint8_t)current, .interface = d[2], .alternate = d[3], .interface_class = d[5]};
		} else if (d[1] == DESCRIPTOR_ENDPOINT && d[0] >= ENDPOINT_SIZE && inside && ret->n < USB_ENDPOINTS) {
			ret->endpoints[ret->n++] = (struct usb_endpoint){
				.address = d[2], .type = d[3] & 3, .packet = (uint16_t)(le16(d + 4) & 0x7ff)};
		}
	}
	return found;
}

const struct usb_endpoint *usb_setting_endpoint(const struct usb_setting *setting, unsigned address)
{
	for (size_t i = 0; i < setting->n; i++) {
		if (setting->endpoints[i].address == address)
			return &setting->endpoints[i];
	}
	return NULL;
}
