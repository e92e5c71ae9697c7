/*
 * Scanners on the bus, through libusb: which are there, their coming and going, and the capture of one. libusb has a
 * thread of its own here, with its own loop; nothing of libusb is seen above this header, and nothing below it knows
 * of spools: bytes go through a queue of buffers that is as long as the transfers are many.
 */
#ifndef USB_H
#define USB_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;
struct profile;
struct profile_set;

enum { USB_TEXT_SIZE = 128, USB_INTERFACES = 32 };

struct usb_device {
	uint16_t vendor, product;
	uint8_t device_class, bus, address;
	char port[32];                       /* "1-2.4" as the kernel names it */
	char node[48];                       /* /dev/bus/usb/001/004 */
	uint8_t interface_classes[USB_INTERFACES];
	size_t interfaces;
	char manufacturer[USB_TEXT_SIZE], model[USB_TEXT_SIZE], serial[USB_TEXT_SIZE]; /* "": does not say */
	bool openable;                       /* we may */
	int refused;                         /* errno of the try, where not */
	bool mass_storage;                   /* one of its interfaces is: it is left alone */
	const char *speed;                   /* "full", "high", "super", ... */
	int profile;                         /* place in the profile_set; -1: none */
};

struct usb; /* the context and its thread */
int usb_new(const struct profile_set *, struct usb **ret, struct err *);
struct usb *usb_free(struct usb *); /* all captures were ended */
/* What is plugged in now, all or only the known; malloced array in order of ports. */
int usb_list(struct usb *, bool all, struct usb_device **ret, size_t *ret_n, struct err *);
/* The one that `which` names: "serial:TEXT", "port:1-2.4", "VENDOR:PRODUCT", a profile's name, or "" (the only known
 * one). -ERR_USAGE: none, or several (the message names them and how to tell them apart). */
int usb_find(struct usb *, const char *which, struct usb_device *ret, struct err *);

/* ---- coming and going: only queued in the thread, taken here ---- */
enum usb_change { USB_CAME, USB_LEFT };
int usb_watch_fd(struct usb *);                       /* readable: usb_change gives something */
/* 1: there was one. Of both kinds all devices, also mass storage (for scripts). */
int usb_change(struct usb *, enum usb_change *ret, struct usb_device *ret_device);

/* ---- capture ---- */

/* What completed, or happened. Buffers come in the order of completion on the wire. */
enum usb_kind { USB_DATA, USB_SENT, USB_STALL, USB_CLEARED, USB_OVERFLOW, USB_TIMEOUT, USB_ERROR, USB_GONE };
struct usb_buffer {
	enum usb_kind kind;
	const uint8_t *at;
	size_t size;
	bool is_short;         /* less than was asked for */
	int64_t time_ns;       /* CLOCK_MONOTONIC when it was completed */
	char text[96];         /* of what is no data */
	void *own;
};
struct usb_capture;
struct usb_counts {
	uint64_t transfers, bytes, shorts, stalls, overflows, timeouts, errors;
	uint64_t parked, parked_ns; /* times that no transfer was in flight because no buffer was free, and how long */
	uint32_t in_flight;
};
/* Opens, claims, sends the start commands, keeps profile->transfers in flight. -ERR_LIMIT: they need more than
 * usbfs_memory_mb lets (with the numbers); -ERR_PERM names the udev rule; mass storage is never detached. */
int usb_capture_start(struct usb *, const struct usb_device *, const struct profile *, struct usb_capture **ret,
		      struct err *);
int usb_capture_fd(struct usb_capture *);                 /* readable: usb_capture_take gives something */
/* 1: a buffer, the caller's until he gives it back: it is not resubmitted before (that is the back-pressure). */
int usb_capture_take(struct usb_capture *, struct usb_buffer *ret);
void usb_capture_give(struct usb_capture *, struct usb_buffer *);
void usb_capture_counts(struct usb_capture *, struct usb_counts *ret);
/* No new transfers; those in flight are cancelled, what they got is still to be taken, then USB_GONE. Stop commands are
 * sent where the device is still there. */
void usb_capture_stop(struct usb_capture *);
struct usb_capture *usb_capture_free(struct usb_capture *); /* after USB_GONE was taken */

#endif
