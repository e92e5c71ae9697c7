/*
 * What acut-scan knows of a kind of scanner: how it is told from other devices, how it is talked to, how its bytes
 * are cut into telegrams, what a telegram means, how its head is mounted. One file each, acut-scanners.d(5); nothing
 * of a model stands in the program but the decoders of families.
 */
#ifndef PROFILE_H
#define PROFILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;

enum { PROFILE_NAME_SIZE = 64, PROFILE_TEXT_SIZE = 256, PROFILE_COMMANDS = 16, PROFILE_COMMAND_SIZE = 256,
       PROFILE_FILE_MAX = 64 << 10 };

enum profile_framer { PROFILE_FRAMER_STREAM, PROFILE_FRAMER_STX_ETX, PROFILE_FRAMER_LINE, PROFILE_FRAMER_FIXED,
		      PROFILE_FRAMER_LENGTH, PROFILE_FRAMER_LAS };
enum profile_time { PROFILE_TIME_ARRIVAL, PROFILE_TIME_DEVICE }; /* of the transfer, or what the telegram says */

struct profile_command {
	uint8_t at[PROFILE_COMMAND_SIZE];  /* as it is sent, framing included */
	size_t size;
	uint8_t answer[PROFILE_COMMAND_SIZE]; /* an answer that begins so is waited for; size 0: none */
	size_t answer_size;
};

struct profile {
	char name[PROFILE_NAME_SIZE];      /* of the file, without ".conf" */
	char title[PROFILE_TEXT_SIZE], note[PROFILE_TEXT_SIZE]; /* note: said once at capture, e.g. what the maker says */
	/* match: each that is said must hold; numbers -1 and texts "" are not said */
	int vendor, product, device_class, interface_class;
	char serial[PROFILE_TEXT_SIZE];    /* with * and ? */
	/* usb */
	unsigned configuration;            /* 0: as it is */
	unsigned interface, alternate;
	uint8_t endpoint_in, endpoint_out; /* endpoint_out 0: none */
	uint32_t transfer_size, transfers; /* bytes of each, how many in flight */
	uint32_t timeout_ms;               /* of commands; a silent stream is no error */
	struct profile_command start[PROFILE_COMMANDS], stop[PROFILE_COMMANDS];
	size_t starts, stops;
	/* framer */
	enum profile_framer framer;
	uint32_t telegram_max;             /* longer ones are bad */
	uint32_t fixed_size;               /* FIXED: bytes of each; */
	uint8_t sync[8];                   /* and of LENGTH: what each begins with */
	size_t sync_size;
	uint32_t length_offset, length_size, length_add; /* LENGTH: where it stands, bytes 1 2 4, what it leaves out */
	bool length_big_endian;
	/* decoder */
	char decoder[PROFILE_NAME_SIZE];   /* a row of decoder.h */
	char columns[16];                  /* of XYZ */
	/* geometry: of the sensor in the vehicle's body (x ahead, y right, z down), degrees and metres */
	double mount_roll, mount_pitch, mount_heading, lever[3];
	double range_min, range_max;       /* metres; shots beyond are no points. max 0: what the decoder says */
	enum profile_time time;
	double latency_s;                  /* from the shot to the arrival */
};

/* Defaults of all fields, so that a text need not say them. `name` of the profile; `file` for messages.
 * -ERR_INPUT: names line and key; unknown keys are errors. */
int profile_parse(const char *text, size_t size, const char *name, const char *file, struct profile *ret, struct err *);

struct profile_set; /* read once; in order of names, a later folder's file replaces one of the same name */
struct profile_entry {
	struct profile profile;
	char *text;      /* as it was read: goes into spools */
	size_t size;
	char path[512];
	char *fault;     /* this file is broken: why (the others are there); NULL */
};
/* Folders in order (those that are not there are none); NULL-terminated. PROFILE_FOLDERS of the build by default. */
int profile_set_read(const char *const *folders, struct profile_set **ret, struct err *);
struct profile_set *profile_set_free(struct profile_set *);
size_t profile_set_count(const struct profile_set *);
const struct profile_entry *profile_set_at(const struct profile_set *, size_t);
const struct profile_entry *profile_set_find(const struct profile_set *, const char *name);

/* What a device says of itself; classes of its interfaces. */
struct profile_device {
	uint16_t vendor, product;
	uint8_t device_class;
	const uint8_t *interface_classes;
	size_t interfaces;
	const char *serial;   /* NULL: not known (not opened): a profile that asks for one does not match */
};
/* The entry that says most about it (serial, then product, vendor, class); NULL. */
const struct profile_entry *profile_set_match(const struct profile_set *, const struct profile_device *);

#endif
