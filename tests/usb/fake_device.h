/*
 * The model of a scanner: its descriptors, its stream, its answers to commands, and its faults. Two front ends use it
 * (fake_umockdev.c, fake_gadget.c). It has no USB code, no clock and no thread: a front end passes in the time and the room that
 * is left in its transfer.
 *
 * The model records the hash of all bytes that it delivered, and a row for each piece that it added to its source or left out of
 * it. A capture must have exactly the delivered bytes; the rows explain how these differ from the source.
 */
#ifndef FAKE_DEVICE_H
#define FAKE_DEVICE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "fake_hash.h"

enum { FAKE_TEXT = 128, FAKE_FAULTS = 512, FAKE_ANSWER = 4096, FAKE_DEVICES = 8, FAKE_ROWS = 4096, FAKE_DESCRIPTORS = 256 };

#define FAKE_NEVER INT64_MAX

/* Faults: each happens at a byte of the source, or at the n-th time of a step. */
enum fake_verb {
	FAKE_STALL,     /* the IN endpoint halts until it is cleared */
	FAKE_SHORT,     /* the next N bytes are a transfer of their own; 0: an empty packet */
	FAKE_BABBLE,    /* a packet that is too long: N bytes of the source are lost, the transfer ends with overflow */
	FAKE_ERROR,     /* the wire fails: N bytes are lost, the transfer ends with a protocol error */
	FAKE_LOSE,      /* the device drops N bytes itself and says nothing */
	FAKE_DELAY,     /* no bytes for S seconds */
	FAKE_DUPLICATE, /* the last N bytes (at most 4096) come again */
	FAKE_GARBAGE,   /* N bytes that no scanner would send, STX and ETX among them */
	FAKE_UNPLUG,    /* unplugged for S seconds; 0: for good */
	FAKE_SILENT,    /* no more bytes, but the device stays */
	FAKE_TIMEOUT,   /* commands are not taken any more */
	FAKE_REFUSE,    /* the OUT endpoint halts until it is cleared */
	FAKE_STOP,      /* the front end sends SIGINT to the program */
	FAKE_KILL,      /* ... SIGKILL */
	FAKE_PAUSE,     /* ... SIGSTOP, and SIGCONT after S seconds */
	FAKE_DENY,      /* the kernel does not take one transfer */
	FAKE_VERBS,
};
enum fake_step {
	FAKE_AT_BYTE,
	FAKE_AT_END,
	FAKE_AT_OPEN,
	FAKE_AT_STRING,
	FAKE_AT_CLAIM,
	FAKE_AT_START,
	FAKE_AT_SUBMIT,
	FAKE_AT_REAP,
	FAKE_AT_CLEAR,
	FAKE_AT_DISCARD,
	FAKE_AT_RELEASE,
	FAKE_STEPS,
};
extern const char *const fake_verb_names[FAKE_VERBS], *const fake_step_names[FAKE_STEPS];

struct fake_fault {
	enum fake_verb verb;
	enum fake_step step;
	uint64_t at;    /* byte of the source, or n of the step from 1 */
	uint64_t every; /* bytes; 0: once */
	uint64_t amount;
	int64_t span_ns;
	uint64_t fired;
};

enum fake_source { FAKE_PATTERN, FAKE_FILE, FAKE_COLA };

/* Bytes of the source that were not delivered (lost), or bytes that were added to it, with their place in the delivered stream.
 */
struct fake_row {
	enum fake_verb verb;
	uint64_t delivered, source, lost, added;
};

struct fake_device {
	/* identity */
	char name[FAKE_TEXT], serial[FAKE_TEXT], manufacturer[FAKE_TEXT], model[FAKE_TEXT], port[FAKE_TEXT];
	uint16_t vendor, product, packet;
	uint8_t device_class, interface_class, endpoint_in, endpoint_out;
	bool locked;            /* nobody may open its node */
	bool busy;              /* another program has its interface */
	bool unheard;           /* udev does not announce it; its node can be read */
	char driver[FAKE_TEXT]; /* of the kernel, that has its interface; "" */
	bool away;              /* not plugged in at first, but after appear_ns */
	int64_t appear_ns;
	char appear_path[512]; /* or once there is such a file; "" */
	bool after_close;      /* comes back only after the program has closed its node */
	/* the stream */
	enum fake_source source;
	char path[512];           /* FILE */
	char delivered_path[512]; /* a file that gets the delivered bytes, too; "" */
	uint64_t size;            /* of the source; COLA: telegrams */
	uint64_t seed, message;   /* a short packet ends each `message` bytes; 0: never */
	double rate;              /* bytes per second; 0: as fast as the host reads. COLA: telegrams per second */
	double hz;                /* COLA: sweeps per second by its own clock; 0: 15 */
	uint64_t buffer;          /* with a rate: more than this is dropped, the oldest first; 0: it waits */
	bool on_command;          /* streams only after a start command */
	/* faults */
	struct fake_fault faults[FAKE_FAULTS];
	size_t n_faults;
	/* behaviour of the front end */
	bool mock;         /* unplug: transfers end with NO_DEVICE, not with ERROR as real kernels do */
	bool no_fifo;      /* its node is a plain file: always writable */
	uint32_t caps_off; /* USBDEVFS_CAP_* that are not offered */

	/* state */
	bool detached; /* the kernel's driver was detached */
	bool denies;   /* the next transfer */
	bool running, halted, refusing, deaf, silent, gone, ended;
	int64_t gone_ns, gone_for_ns, not_before_ns, began_ns;
	uint64_t made, sent_stream; /* bytes taken from the source; bytes of it that count against the rate */
	uint64_t steps[FAKE_STEPS];
	uint8_t answer[FAKE_ANSWER];
	size_t answer_size, answer_sent;
	uint64_t short_left; /* bytes until the packet that ends early; meaningful with in_short */
	bool in_short;
	uint8_t *text; /* COLA: the telegram that is being sent */
	size_t text_size, text_sent;
	uint64_t telegrams; /* COLA: begun */
	FILE *file, *delivered_file;
	uint8_t last[4096]; /* the last bytes delivered */
	size_t last_size;
	/* records of what was delivered */
	uint64_t delivered, lost, added, commands, answers;
	struct fake_row rows[FAKE_ROWS];
	size_t n_rows, rows_missed;
	struct fake_hash hash; /* of what was delivered */
	/* signals that the front end has to send */
	bool wants_stop, wants_kill;
	int64_t wants_pause_ns;
};

/* Parses a script (its language: fake_script.c). On an error prints it and returns false. */
bool fake_script_read(const char *path, struct fake_device **ret, size_t *ret_n);
/* "name" with its numbers, for rows of reports. */
void fake_report(FILE *, const struct fake_device *); /* a JSON object */

void fake_device_init(struct fake_device *);
bool fake_device_open_source(struct fake_device *); /* prints the error, if any */
void fake_device_clear(struct fake_device *);

/* Device, configuration, interface, endpoints: as sysfs has them in `descriptors`. */
size_t fake_descriptors(const struct fake_device *, uint8_t at[FAKE_DESCRIPTORS]);
/* String `i` (1 manufacturer, 2 model, 3 serial, 0 languages) as a descriptor; 0: there is none. */
size_t fake_string(const struct fake_device *, unsigned i, uint8_t at[FAKE_DESCRIPTORS]);
/* A control request. Returns the size of the answer (at most `room`), or -EPIPE if the request is not known. */
int fake_control(struct fake_device *, const uint8_t setup[8], uint8_t *at, size_t room);

enum fake_kind { FAKE_WAIT, FAKE_BYTES, FAKE_HALT, FAKE_OVERFLOW, FAKE_BROKEN, FAKE_GONE };
struct fake_in {
	enum fake_kind kind;
	size_t size;     /* bytes put at `at`; they are there with every kind */
	bool ends;       /* a short packet: the transfer is complete */
	int64_t when_ns; /* WAIT: ask again at this time */
};
/* The next bytes for a transfer with `room` left. Never more than `room`; call until WAIT, `ends` or no room. */
void fake_device_in(struct fake_device *, int64_t now_ns, uint8_t *at, size_t room, struct fake_in *ret);
enum fake_out { FAKE_TAKEN, FAKE_OUT_HALT, FAKE_OUT_WAIT };
enum fake_out fake_device_out(struct fake_device *, int64_t now_ns, const uint8_t *at, size_t size);
void fake_device_clear_halt(struct fake_device *, uint8_t endpoint);
/* Counts one more `step`. Its faults, if any, change the state. */
void fake_device_step(struct fake_device *, enum fake_step, int64_t now_ns);
/* Plugged in again: the commands that it got are forgotten, the source continues where it was. */
void fake_device_plug(struct fake_device *);

/* fake_cola.c: telegram `number` of a scanner that moves over hilly ground, framed; malloced. */
uint8_t *fake_cola_telegram(const struct fake_device *, uint64_t number, size_t *ret_size);
/* Takes a command, framed or not, and makes the framed answer. Sets `running`. */
void fake_cola_command(struct fake_device *, const uint8_t *at, size_t size);

#endif
