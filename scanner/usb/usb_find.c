/*
 * Finds the requested device. Devices of the same kind are distinguished by serial number, or, if these are equal or missing,
 * by port. If several match, the error message has the option for each.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "usb_priv.h"

enum which { WHICH_ANY, WHICH_SERIAL, WHICH_PORT, WHICH_NUMBERS, WHICH_PROFILE };

static enum which kind_of(const char *which, unsigned *ret_vendor, unsigned *ret_product)
{
	int used = 0;

	if (!which || !which[0])
		return WHICH_ANY;
	if (!strncmp(which, "serial:", 7))
		return WHICH_SERIAL;
	if (!strncmp(which, "port:", 5))
		return WHICH_PORT;
	if (strlen(which) == 9 && sscanf(which, "%4x:%4x%n", ret_vendor, ret_product, &used) == 2 && used == 9)
		return WHICH_NUMBERS;
	return WHICH_PROFILE;
}

static bool is_meant(struct usb *usb, enum which kind, const char *which, unsigned vendor, unsigned product,
		     const struct usb_device *device)
{
	switch (kind) {
	case WHICH_ANY:
		return device->profile >= 0 && !device->mass_storage;
	case WHICH_SERIAL:
		return !strcmp(device->serial, which + 7);
	case WHICH_PORT:
		return !strcmp(device->port, which + 5);
	case WHICH_NUMBERS:
		return device->vendor == vendor && device->product == product;
	case WHICH_PROFILE:
		return device->profile >= 0 &&
		       !strcmp(profile_set_at(usb->profiles, (size_t)device->profile)->profile.name, which);
	}
	return false;
}

/* What to write for this one and for no other of the list. */
static void name_it(const struct usb_device *list, size_t n, const struct usb_device *device, char *buf, size_t size)
{
	bool alone = device->serial[0];

	for (size_t i = 0; i < n; i++)
		alone = alone && (&list[i] == device || strcmp(list[i].serial, device->serial) != 0);
	if (alone)
		snprintf(buf, size, "serial:%s", device->serial);
	else
		snprintf(buf, size, "port:%s", device->port);
}

static int several(const struct usb_device *list, size_t n, struct err *err)
{
	char names[400] = "", one[USB_TEXT_SIZE + 16], first[USB_TEXT_SIZE + 16], words[160];
	size_t used = 0;

	name_it(list, n, &list[0], first, sizeof(first));
	for (size_t i = 0; i < n && used < sizeof(names) - 1; i++) {
		name_it(list, n, &list[i], one, sizeof(one));
		used += (size_t)snprintf(names + used, sizeof(names) - used, "%s%s (%s)", i ? "; " : "",
					 usb_device_words(&list[i], words, sizeof(words)), one);
	}
	err_set(err, ERR_USAGE, "%zu devices are meant: %s", n, names);
	return err_add_hint(err, "say which, such as --device %s", first);
}

static int none(struct usb *usb, enum which kind, const char *which, size_t there, struct err *err)
{
	if (kind == WHICH_PROFILE && (!usb->profiles || !profile_set_find(usb->profiles, which))) {
		err_set(err, ERR_NOTFOUND, "no device is named by \"%s\", and no profile has that name", which);
		return err_add_hint(err, "write serial:TEXT, port:1-2.4, VENDOR:PRODUCT or a profile's name; "
					 "acut-scan list shows what is plugged in");
	}
	if (kind == WHICH_ANY && there)
		err_set(err, ERR_NOTFOUND, "no scanner is plugged in that a profile knows, only %zu other device%s", there,
			there == 1 ? "" : "s");
	else if (kind == WHICH_ANY)
		err_set(err, ERR_NOTFOUND, "no scanner is plugged in");
	else
		err_set(err, ERR_NOTFOUND, "no device that is plugged in is \"%s\"", which);
	return err_add_hint(err, "acut-scan list --all shows what is plugged in, acut-scan profiles what is known");
}

int usb_find(struct usb *usb, const char *which, struct usb_device *ret, struct err *err)
{
	unsigned vendor = 0, product = 0;
	enum which kind = kind_of(which, &vendor, &product);
	struct usb_device *list;
	size_t n, found = 0;
	int r = usb_list(usb, true, &list, &n, err);

	if (r)
		return r;
	for (size_t i = 0; i < n; i++) {
		if (is_meant(usb, kind, which, vendor, product, &list[i]))
			list[found++] = list[i];
	}
	if (found == 1)
		*ret = list[0];
	else
		r = found ? several(list, found, err) : none(usb, kind, which, n, err);
	free(list);
	return r;
}
