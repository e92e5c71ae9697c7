/* record: what its files share. One thread: it waits for buffers of the device (or bytes of a file), signals and time. */
#ifndef SCAN_RECORD_H
#define SCAN_RECORD_H

#include "err.h"
#include "framer.h"
#include "scan_device.h"
#include "spool.h"

enum { RECORD_DONE = 0, RECORD_LEFT = 3 }; /* exit statuses that are no error's */

/* Why a capture ends; the word of the event "stop". */
enum record_why { RECORD_GOES_ON, RECORD_SIGNAL, RECORD_TIME, RECORD_BYTES, RECORD_EOF, RECORD_UNPLUGGED, RECORD_ERROR };
const char *record_why_name(enum record_why);

struct record {
	struct program *args;
	struct spool_writer *spool;
	struct spool_head head;
	char *path;
	struct framer *framer;       /* counts telegrams; NULL: without a profile, or it failed */
	struct usb_counts before;    /* of captures of this run that are over (--reconnect) */
	struct usb_capture *capture; /* now; NULL */
	uint64_t began_ns, clock_ns; /* this run; the last CLOCK */
	uint64_t first_bytes;        /* in the spool when this run began (--continue) */
	uint64_t bytes, left;
	enum record_why why;
	/* telling */
	bool started, progress, notified;
	uint64_t reported_ns, reported_bytes;
	double rate; /* bytes a second, of the last seconds */
};

/* ---- scan_record.c ---- */

/* Appends a transfer, after a CLOCK every ten seconds; counts its telegrams. */
int record_data(struct record *, unsigned flags, int64_t time_ns, const void *at, size_t size, struct err *);
void record_gap(struct record *); /* bytes are missing: for the count of telegrams */
/* Whether --for or --bytes or a signal ends it now; sets why. */
bool record_over(struct record *);
/* Milliseconds until something is to be done though nothing happens; -1: never. */
int record_patience(const struct record *);

/* ---- scan_record_usb.c, scan_record_file.c: the bytes; `why` is set when they return 0 ---- */

int record_from_usb(struct record *, struct scan_device *, struct err *);
int record_from_file(struct record *, int fd, struct err *);

/* ---- scan_record_report.c ---- */

void record_report_start(struct record *, const char *what);
void record_report_progress(struct record *); /* as often as it is called, seldom done */
void record_report_event(struct record *, const char *event, const char *text);
void record_report_end(struct record *, const struct err *err); /* err->code ERR_NONE: none */

#endif
