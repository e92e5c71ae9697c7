/*
 * Scanners on the bus, through libusb: the list of devices, hotplug, and the capture of a device. libusb has its own
 * thread and loop here. Users of this header do not see libusb, and this room does not know spools: bytes go through a
 * queue of buffers, as long as there are transfers.
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
	char port[32]; /* "1-2.4" as in the kernel */
	char node[48]; /* /dev/bus/usb/001/004 */
	uint8_t interface_classes[USB_INTERFACES];
	size_t interfaces;
	char manufacturer[USB_TEXT_SIZE], model[USB_TEXT_SIZE], serial[USB_TEXT_SIZE]; /* "": not provided */
	bool openable;                                                                 /* this process may open it */
	int refused;                                                                   /* errno of the attempt, if not */
	bool mass_storage; /* an interface is mass storage: the device is never opened */
	const char *speed; /* "full", "high", "super", ... */
	int profile;       /* index in the profile_set; -1: none */
};

struct usb; /* a context and its thread */
/* The set is borrowed until usb_free; NULL: no profiles. Also succeeds on a machine without USB; then there are no
 * devices. */
int usb_new(const struct profile_set *, struct usb **ret, struct err *);
struct usb *usb_free(struct usb *); /* all captures must have been freed */
/* When this descriptor becomes readable, a running usb_capture_start fails with -ERR_CANCELLED; -1: none. If the device
 * has answered a start command, it gets the stop commands; if bytes had come, the result is a capture that ends at
 * once. */
void usb_set_stop_fd(struct usb *, int fd);
/* NULL: udev reports hotplug; else why not: then the list is read each second. */
const char *usb_polls(struct usb *);
/* The devices that are plugged in now (no hubs): all, or only those with a profile; allocated array in the order of
 * ports. Opens no device. */
int usb_list(struct usb *, bool all, struct usb_device **ret, size_t *ret_n, struct err *);
/* The same, and usb_change reports only changes after this list. */
int usb_list_begin(struct usb *, bool all, struct usb_device **ret, size_t *ret_n, struct err *);
/* Finds a device: "serial:TEXT", "port:1-2.4", "VENDOR:PRODUCT" (four hexadecimal digits each), a profile's name, or ""
 * (the only one with a profile). Serial, port and numbers also find devices without a profile. -ERR_NOTFOUND: none.
 * -ERR_USAGE: several (the message lists them and how to distinguish them). */
int usb_find(struct usb *, const char *which, struct usb_device *ret, struct err *);

/* ---- hotplug: queued by the thread, taken by the caller ---- */
enum usb_change { USB_CAME, USB_LEFT };
int usb_watch_fd(struct usb *); /* readable if usb_change has a change */
/* 1: a change since usb_new; 0: none. Reports all devices except hubs, also mass storage (for scripts). */
int usb_change(struct usb *, enum usb_change *ret, struct usb_device *ret_device);

/* ---- capture ---- */

/* What completed or happened. Buffers come in the order of completion on the wire. */
enum usb_kind {
	USB_DATA,
	USB_SENT,     /* the device accepted a command */
	USB_STALL,    /* the endpoint halted; USB_CLEARED or USB_GONE follows */
	USB_CLEARED,  /* the endpoint was restarted (after a stall, an overflow or an error) */
	USB_OVERFLOW, /* the device sent more than fits a transfer: the data before it are complete, bytes are missing here */
	USB_TIMEOUT,  /* of a command or its answer, during the capture or its stop */
	USB_ERROR,    /* of the bus, or of a stop command; bytes may be missing here */
	USB_PARKED,   /* transfers were resubmitted; text "parked NANOSECONDS": no buffer had been free */
	USB_GONE,     /* the last one: the device is released; `end` has the reason */
};
enum usb_end {
	USB_END_STOPPED, /* on request */
	USB_END_LEFT,    /* unplugged */
	USB_END_FAILED,  /* present, but no longer responding */
};
struct usb_buffer {
	enum usb_kind kind;
	enum usb_end end;
	const uint8_t *at; /* for DATA and SENT */
	size_t size;
	bool is_short;            /* less than requested */
	bool with_error;          /* its transfer ended with an error, which follows as an event */
	bool after_gap;           /* bytes before it may be missing (overflow, error) */
	int64_t time_ns;          /* CLOCK_MONOTONIC at completion */
	char text[USB_LINE_SIZE]; /* for other kinds: one line */
	void *own;
};
struct usb_capture;
struct usb_counts {
	uint64_t transfers; /* transfers with data, complete or partial */
	uint64_t bytes, shorts, stalls, overflows, timeouts, errors;
	uint64_t parked, parked_ns; /* how often no transfer was in flight because no buffer was free, and how long */
	uint32_t in_flight;
};
/* Opens, claims, keeps profile->transfers in flight, sends the start commands and waits for their answers; data that
 * come meanwhile can be taken afterwards. Blocks for as long as the device takes, at most a little more than timeout_ms
 * for each command. If a start command fails and the device has accepted one, the stop commands are sent, so that the
 * device does not continue. -ERR_LIMIT: more memory than usbfs_memory_mb allows (with both numbers); -ERR_PERM: names
 * the udev rule; -ERR_BUSY: names the program that uses it; -ERR_TIMEOUT: an answer is missing; names what was sent and
 * received; -ERR_NOTFOUND: unplugged meanwhile; -ERR_UNSUPPORTED: mass storage, which is never opened; -ERR_INPUT: the
 * profile does not fit the device's interfaces and endpoints; -ERR_CANCELLED: see usb_set_stop_fd. */
int usb_capture_start(struct usb *, const struct usb_device *, const struct profile *, struct usb_capture **ret, struct err *);
int usb_capture_fd(struct usb_capture *); /* readable if usb_capture_take has something */
/* 1: a buffer, the caller's until it is given back; its transfer is not resubmitted before (back-pressure). Buffers
 * without data need not be given back. 0: nothing now, or nothing any more. */
int usb_capture_take(struct usb_capture *, struct usb_buffer *ret);
void usb_capture_give(struct usb_capture *, struct usb_buffer *);
void usb_capture_counts(struct usb_capture *, struct usb_counts *ret);
/* Stops submitting transfers and cancels those in flight; their data can still be taken. Sends the stop commands if the
 * device is present, releases it, then queues USB_GONE. Does not wait. */
void usb_capture_stop(struct usb_capture *);
/* After USB_GONE was taken. Before that, it stops without stop commands, and waits. No buffer of it may be used after
 * this. */
struct usb_capture *usb_capture_free(struct usb_capture *);

#endif
