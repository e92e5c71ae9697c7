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

enum { USB_TEXT_SIZE = 128, USB_LINE_SIZE = 256, USB_INTERFACES = 32 };

struct usb_device {
	uint16_t vendor, product;
	uint8_t device_class, bus, address;
	char port[32]; /* "1-2.4" as the kernel names it */
	char node[48]; /* /dev/bus/usb/001/004 */
	uint8_t interface_classes[USB_INTERFACES];
	size_t interfaces;
	char manufacturer[USB_TEXT_SIZE], model[USB_TEXT_SIZE], serial[USB_TEXT_SIZE]; /* "": does not say */
	bool openable;                                                                 /* we may */
	int refused;                                                                   /* errno of the try, where not */
	bool mass_storage; /* one of its interfaces is: it is left alone */
	const char *speed; /* "full", "high", "super", ... */
	int profile;       /* place in the profile_set; -1: none */
};

struct usb; /* the context and its thread */
/* The set is borrowed until usb_free; NULL: nothing is known. Succeeds on a machine without USB too: nothing is
 * plugged in there. */
int usb_new(const struct profile_set *, struct usb **ret, struct err *);
struct usb *usb_free(struct usb *); /* all captures were freed */
/* A descriptor that ends a usb_capture_start under way with -ERR_CANCELLED when it becomes readable; -1: none. A device
 * that has answered a start command gets the stop commands; where bytes had come, it is a capture that ends at once. */
void usb_set_stop_fd(struct usb *, int fd);
/* NULL: coming and going are told by udev; else why not: the list is looked at each second then. */
const char *usb_polls(struct usb *);
/* What is plugged in now (no hubs), all or only the known; malloced array in order of ports. Nothing is opened for it. */
int usb_list(struct usb *, bool all, struct usb_device **ret, size_t *ret_n, struct err *);
/* The same, and usb_change begins here: what came or left before is in the list, or no more, and not told. */
int usb_list_begin(struct usb *, bool all, struct usb_device **ret, size_t *ret_n, struct err *);
/* The one that `which` names: "serial:TEXT", "port:1-2.4", "VENDOR:PRODUCT" (four hexadecimal digits each), a
 * profile's name, or "" (the only known one). Serial, port and numbers also find what no profile knows.
 * -ERR_NOTFOUND: none. -ERR_USAGE: several (the message names them and how to tell them apart). */
int usb_find(struct usb *, const char *which, struct usb_device *ret, struct err *);

/* ---- coming and going: only queued in the thread, taken here ---- */
enum usb_change { USB_CAME, USB_LEFT };
int usb_watch_fd(struct usb *); /* readable: usb_change gives something */
/* 1: there was one since usb_new, 0: no more. Of both kinds all devices but hubs, also mass storage (for scripts). */
int usb_change(struct usb *, enum usb_change *ret, struct usb_device *ret_device);

/* ---- capture ---- */

/* What completed, or happened. Buffers come in the order of completion on the wire. */
enum usb_kind {
	USB_DATA,
	USB_SENT,     /* a command that the device took */
	USB_STALL,    /* the endpoint halted; USB_CLEARED follows, or USB_GONE */
	USB_CLEARED,  /* it was set going again (after a stall, an overflow or an error) */
	USB_OVERFLOW, /* more came than fits into a transfer: the data before it are what came, bytes are missing here */
	USB_TIMEOUT,  /* a command or its answer, while the capture goes on or is stopped */
	USB_ERROR,    /* of the bus, or of a stop command; bytes may be missing here */
	USB_PARKED,   /* transfers are in flight again; text "parked NANOSECONDS": no buffer had been free */
	USB_GONE,     /* the last: nothing follows, the device is released; `end` says why */
};
enum usb_end {
	USB_END_STOPPED, /* as it was asked for */
	USB_END_LEFT,    /* unplugged */
	USB_END_FAILED,  /* there, but it does not answer any more */
};
struct usb_buffer {
	enum usb_kind kind;
	enum usb_end end;
	const uint8_t *at; /* of DATA and SENT */
	size_t size;
	bool is_short;            /* less than was asked for */
	bool with_error;          /* its transfer ended with an error, which follows as an event */
	bool after_gap;           /* bytes before it may be missing (overflow, error) */
	int64_t time_ns;          /* CLOCK_MONOTONIC when it was completed */
	char text[USB_LINE_SIZE]; /* of what is no data: one line */
	void *own;
};
struct usb_capture;
struct usb_counts {
	uint64_t transfers; /* that were filled, or brought a part */
	uint64_t bytes, shorts, stalls, overflows, timeouts, errors;
	uint64_t parked, parked_ns; /* times that no transfer was in flight because no buffer was free, and how long */
	uint32_t in_flight;
};
/* Opens, claims, keeps profile->transfers in flight, sends the start commands and waits for their answers; what came
 * meanwhile is there to be taken. Blocks for as long as the device takes, at most timeout_ms a command and a little. Where a
 * start command fails and the device has taken one, the stop commands are sent: it does not go on unheard.
 * -ERR_LIMIT: they need more than usbfs_memory_mb lets (with the numbers); -ERR_PERM names the udev rule; -ERR_BUSY
 * who has it; -ERR_TIMEOUT an answer that did not come, with what was sent and what came; -ERR_NOTFOUND: unplugged
 * meanwhile; -ERR_UNSUPPORTED: mass storage, which is never opened; -ERR_INPUT: the profile does not fit the device's
 * interfaces and endpoints; -ERR_CANCELLED: see usb_set_stop_fd. */
int usb_capture_start(struct usb *, const struct usb_device *, const struct profile *, struct usb_capture **ret, struct err *);
int usb_capture_fd(struct usb_capture *); /* readable: usb_capture_take gives something */
/* 1: a buffer, the caller's until he gives it back: it is not resubmitted before (that is the back-pressure). Those
 * that are no data need not be given back. 0: nothing now, or nothing any more. */
int usb_capture_take(struct usb_capture *, struct usb_buffer *ret);
void usb_capture_give(struct usb_capture *, struct usb_buffer *);
void usb_capture_counts(struct usb_capture *, struct usb_counts *ret);
/* No new transfers; those in flight are cancelled, what they got is still to be taken, stop commands are sent where
 * the device is still there, it is released, then USB_GONE. Does not wait. */
void usb_capture_stop(struct usb_capture *);
/* After USB_GONE was taken; before it, stops without stop commands and waits. No buffer of it is used after this. */
struct usb_capture *usb_capture_free(struct usb_capture *);

#endif
