/* Devices: found for a command, printed. */
#ifndef SCAN_DEVICE_H
#define SCAN_DEVICE_H

#include "scan_profile.h"
#include "usb.h"

/* The device that a command works on. */
struct scan_device {
	struct profile_set *set;
	struct usb *usb;
	struct usb_device device;
	struct scan_profile profile; /* --profile, or that which matches */
};
/* Finds it by --device or the argument. -ERR_USAGE also if there is no profile for it. */
int scan_device_open(struct program *, struct scan_device *ret, struct err *);
void scan_device_done(struct scan_device *);

/* "TiM561 serial 20370043 at 1-2.4". Returns buf. */
char *scan_device_text(const struct usb_device *, char *buf, size_t size);
/* The keys of a device, in an object that is open. */
void scan_device_json(struct term_json *, const struct usb_device *, const struct profile_set *);
/* "yes", or why it cannot be opened. */
const char *scan_device_access(const struct usb_device *);

#endif
