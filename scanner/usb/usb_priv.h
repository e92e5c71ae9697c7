/*
 * Shared by the files of this room. Members marked "thread's" are only used by the thread of libusb, the others under the lock
 * beside them. Locks are leaves: while one is held only malloc, free and write are called.
 */
#ifndef USB_PRIV_H
#define USB_PRIV_H

#include <pthread.h>

#include "err.h"
#include "profile.h"
#include "usb.h"

#define USB_SYSFS "/sys/bus/usb/devices"
#define USB_NODES "/dev/bus/usb"
#define USB_MEMORY_FILE "/sys/module/usbcore/parameters/usbfs_memory_mb"
#define USB_RULE_FILE "/etc/udev/rules.d/69-acut-local.rules"
#define USB_RULE_GROUP "acut-scan"

enum { USB_CLASS_STORAGE = 8, USB_CLASS_HUB = 9, USB_ENDPOINTS = 30, USB_DESCRIPTORS_MAX = 16384 };

struct libusb_context;
struct libusb_device;
struct libusb_device_handle;
struct libusb_transfer;

/* ---- usb_descriptor.c: pure ---- */

struct usb_endpoint {
	uint8_t address, type; /* type: from bmAttributes, 0 control 1 isochronous 2 bulk 3 interrupt */
	uint16_t packet;       /* bytes */
};
struct usb_setting { /* an alternate setting of an interface */
	uint8_t configuration, interface, alternate, interface_class;
	struct usb_endpoint endpoints[USB_ENDPOINTS];
	size_t n;
};
/* Fills vendor, product, classes and mass_storage. `configuration`: the active one, 0: the first. False: too short. */
bool usb_descriptor_device(const uint8_t *at, size_t size, unsigned configuration, struct usb_device *ret);
/* False: there is none. `configuration` 0: the first one that has it. */
bool usb_descriptor_setting(const uint8_t *at, size_t size, unsigned configuration, unsigned interface, unsigned alternate,
			    struct usb_setting *ret);
const struct usb_endpoint *usb_setting_endpoint(const struct usb_setting *, unsigned address);

/* ---- usb_sysfs.c: information of the kernel, without opening a device ---- */

struct dirent;
/* Allocated, and each entry, too; returns their number, or -errno. */
int usb_folder_names(const char *folder, struct dirent ***ret);
int usb_sysfs_list(const char *folder, struct usb_device **ret, size_t *ret_n, struct err *);
/* Descriptors of the device at a port; 0 or -errno. */
int usb_sysfs_descriptors(const char *folder, const char *port, uint8_t *ret, size_t room, size_t *ret_size);
unsigned usb_sysfs_configuration(const char *folder, const char *port); /* 0: unknown */
/* Name of the driver of an interface; "" none. */
void usb_sysfs_driver(const char *folder, const char *port, unsigned configuration, unsigned interface, char *ret, size_t room);
void usb_access(struct usb_device *); /* sets openable and refused to the current state */

/* ---- usb_limit.c ---- */

struct usb_limit {
	uint64_t bytes; /* 0: none */
	bool assumed;   /* the file does not exist */
};
int usb_limit_read(const char *file, struct usb_limit *ret, struct err *);
uint64_t usb_limit_need(uint32_t transfers, uint32_t transfer_size); /* as usbcore computes it */
int usb_limit_check(const struct usb_limit *, const struct profile *, uint64_t others, struct err *);

/* ---- usb_refusal.c: why a device cannot be used ---- */

int usb_refusal_mode(const struct usb_device *, int sys, struct err *);
int usb_refusal_busy(const struct usb_device *, unsigned configuration, unsigned interface, struct err *);
int usb_refusal_storage(const struct usb_device *, struct err *);
int usb_refusal_left(const struct usb_device *, const char *when, struct err *);
char *usb_device_words(const struct usb_device *, char *buf, size_t size); /* "TiM561, serial 123, at 1-2" */
/* Bytes as readable text: "\\x02sRN\\x03", at most `size`; "..." at the end if truncated. */
char *usb_bytes_words(const uint8_t *at, size_t n, char *buf, size_t size);

/* ---- usb_watch.c: thread's, except for what it puts under usb->lock ---- */

struct usb_known {
	struct usb_device device;
	bool gone; /* reported as left, but the kernel's folder still has it */
	bool seen;
};
struct usb_notice { /* a change that was not taken yet */
	struct usb_notice *next;
	enum usb_change change;
	struct usb_device device;
};
void usb_watch_start(struct usb *);
void usb_watch_stop(struct usb *);
void usb_watch_step(struct usb *); /* handles queued events, then reads the list if necessary */
void usb_watch_scan(struct usb *);
bool usb_watch_present(struct usb *, const struct usb_device *);

/* ---- the context ---- */

struct usb_event { /* from libusb's hotplug, as the callback queues it */
	bool left;
	uint8_t bus, address;
};
struct usb {
	const struct profile_set *profiles;
	pthread_t thread;
	int stop_fd;

	pthread_mutex_t lock;
	pthread_cond_t scanned;         /* tickets */
	struct libusb_context *context; /* NULL: no usbfs */
	int wake_fd;                    /* of the thread without a context */
	bool quit;
	const char *polls;
	uint64_t scan_wanted, scan_done;
	int scan_failed;
	struct usb_capture *starting; /* passed to the thread, linked by `next` */
	struct usb_known *known;
	size_t n, room;
	struct usb_notice *first, *last;
	size_t notices;
	int watch_fd;

	/* thread's */
	struct usb_capture *captures;
	struct usb_event *events;
	size_t events_n, events_room;
	bool events_lost, registered;
	int hotplug;
	uint64_t poll_at;
	unsigned failures; /* consecutive failures of the event loop */
};
void usb_wake(struct usb *);

/* ---- capture ---- */

enum usb_phase {
	USB_PHASE_START, /* transfers in flight, start commands in progress */
	USB_PHASE_STREAM,
	USB_PHASE_QUIET, /* stopping: transfers are being cancelled */
	USB_PHASE_STOP,  /* stop commands in progress, one small transfer reads */
	USB_PHASE_LEAVE, /* everything is being cancelled */
	USB_PHASE_ENDED,
};
enum usb_recover { USB_RECOVER_NONE, USB_RECOVER_STALL, USB_RECOVER_OVERFLOW, USB_RECOVER_ERROR };

struct usb_item { /* in the queue to the caller, or taken by it */
	struct usb_item *next;
	struct usb_buffer buffer;
	struct usb_slot *slot; /* NULL: bytes behind this struct, or none */
};
struct usb_slot { /* a transfer and its memory */
	struct usb_capture *capture;
	struct libusb_transfer *transfer;
	uint8_t *at;
	struct usb_slot *next; /* next free or returned one */
	uint64_t order;        /* of submission */
	bool flying;
	struct usb_item item;
};

enum { USB_CAME_KEPT = 64 };
enum usb_talk_state { USB_TALK_NEXT, USB_TALK_SENDING, USB_TALK_WAITING, USB_TALK_BROKEN, USB_TALK_DONE };
struct usb_talk { /* commands, one after the other; thread's */
	const struct profile_command *list;
	size_t n, i;
	enum usb_talk_state state;
	struct libusb_transfer *transfer;
	uint8_t out[PROFILE_COMMAND_SIZE];
	bool flying, returned;
	bool taken, heard; /* the device has accepted one, whatever its result; it has answered one whose answer is awaited */
	uint64_t deadline;
	uint16_t fall[PROFILE_COMMAND_SIZE]; /* where to continue in the answer after a byte that does not match */
	size_t matched;
	bool answered;
	uint8_t came[USB_CAME_KEPT];
	uint64_t came_n;
};

struct usb_capture {
	struct usb *usb;
	struct usb_capture *next;
	struct profile profile;
	struct usb_device device;

	pthread_mutex_t lock;
	pthread_cond_t changed;               /* has ended */
	int fd;                               /* the caller's queue */
	int start_fd;                         /* the start has finished */
	struct usb_item *first, *last, *held; /* held: copies taken by the caller */
	size_t copied;                        /* bytes in copies */
	struct usb_slot *given;
	struct usb_counts counts;
	bool stop, abandon, ready, ended, gone_taken, short_of_memory;
	enum usb_end end;
	char end_text[USB_LINE_SIZE];
	int64_t end_ns;
	uint64_t parked_since;

	/* thread's */
	enum usb_phase phase;
	struct libusb_device_handle *handle;
	int node_fd; /* of a device that libusb does not list; -1 */
	bool claimed, left, cancelled, gap, lacking, spare_out;
	bool start_failed; /* the start was told to stop, and has failed: err has the reason */
	struct usb_setting setting;
	const struct usb_endpoint *in, *out;
	struct usb_slot *slots, spare; /* spare: reads while stop commands are sent */
	uint32_t slots_n;
	struct usb_slot *free;
	uint32_t flying;
	uint64_t submitted;
	enum usb_recover recover;
	unsigned troubles;           /* kinds of trouble in this episode: 1 << usb_recover */
	unsigned fruitless;          /* consecutive stalls and errors without data in between */
	uint64_t retry_at, drain_by; /* 0: none */
	struct usb_talk talk;
	struct err err; /* why the start failed */
};

/* usb_open.c: opens, claims, allocates. On failure c->err is set, and usb_close_device closes what was opened.
 * `others`: kernel memory of other captures. */
int usb_open_device(struct usb_capture *, uint64_t others);
void usb_close_device(struct usb_capture *);
void usb_slots_free(struct usb_capture *);

/* usb_queue.c */
void usb_queue_data(struct usb_capture *, struct usb_slot *, size_t size, bool with_error, int64_t now);
void usb_queue_event(struct usb_capture *, enum usb_kind, const uint8_t *at, size_t size, int64_t now, const char *fmt, ...)
	__attribute__((format(printf, 6, 7)));
bool usb_queue_has_data(const struct usb_capture *); /* has data that were not taken; under the lock */
void usb_queue_end(struct usb_capture *);
void usb_slot_free(struct usb_capture *, struct usb_slot *); /* can be submitted again; thread's */
struct usb_slot *usb_queue_given(struct usb_capture *);

/* usb_transfer.c */
void usb_transfer_fill(struct usb_capture *, struct usb_slot *, uint32_t size);
void usb_transfer_submit_free(struct usb_capture *, uint64_t now);
bool usb_transfer_submit(struct usb_capture *, struct usb_slot *, uint64_t now);
void usb_transfer_cancel(struct usb_capture *); /* newest first */
void usb_transfer_forget(struct usb_capture *); /* the device was closed before they came back */

/* usb_talk.c */
void usb_talk_begin(struct usb_capture *, const struct profile_command *, size_t n);
/* 1: all done; 0: in progress; negative: the command failed (the next step continues with the next command). */
int usb_talk_step(struct usb_capture *, uint64_t now, struct err *);
void usb_talk_feed(struct usb_capture *, const uint8_t *at, size_t size);
/* Whether the device has accepted one of them, and answered if an answer is awaited. */
bool usb_talk_heard(const struct usb_capture *);
/* Whether the device has accepted one of them, and another one can be sent. */
bool usb_talk_taken(const struct usb_capture *);
void usb_talk_cancel(struct usb_capture *);
uint64_t usb_talk_until(const struct usb_capture *); /* when the next step is due */

/* usb_step.c */
void usb_step_begin(struct usb_capture *);
/* Does the next step; returns when to call it again at the latest (CLOCK_MONOTONIC, ns). */
uint64_t usb_step(struct usb_capture *, uint64_t now);

#endif
