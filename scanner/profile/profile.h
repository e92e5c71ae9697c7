/*
 * A profile describes a model of scanner: how to recognize it, how to talk to it, how to cut its bytes into telegrams,
 * how to decode telegrams, how its head is mounted. One file each, acut-scanners.d(5). The program itself only has the
 * decoders of families.
 */
#ifndef PROFILE_H
#define PROFILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;

enum {
	PROFILE_NAME_SIZE = 64,
	PROFILE_TEXT_SIZE = 256,
	PROFILE_COMMANDS = 16,
	PROFILE_COMMAND_SIZE = 256,
	PROFILE_FILE_MAX = 64 << 10
};

enum profile_framer {
	PROFILE_FRAMER_STREAM,
	PROFILE_FRAMER_STX_ETX,
	PROFILE_FRAMER_LINE,
	PROFILE_FRAMER_FIXED,
	PROFILE_FRAMER_LENGTH,
	PROFILE_FRAMER_LAS
};
enum profile_time { PROFILE_TIME_ARRIVAL, PROFILE_TIME_DEVICE }; /* time of the transfer, or the time in the telegram */

enum profile_stamp { PROFILE_STAMP_FIRST, PROFILE_STAMP_LAST }; /* the shot to which the device's time belongs */

/* A number at a fixed place of a telegram: "u16le@4". */
struct profile_field {
	int32_t offset; /* of its first byte in the telegram; -1: no such field */
	uint8_t size;   /* 1, 2, 4 */
	bool big_endian;
};

/* Decoder "ranges": binary telegrams with consecutive ranges, described completely by the profile. */
struct profile_ranges {
	struct profile_field kind;  /* distinguishes data from other telegrams: those with another value than ... */
	uint32_t data_kind;         /* ... this have no sweep */
	struct profile_field count; /* number of shots; offset -1: `shots`, or as many as fit */
	uint32_t shots;
	struct profile_field range;       /* of the first shot; the next ones are `range_stride` bytes further */
	uint32_t range_stride;            /* 0: its size */
	double range_scale;               /* metres in a unit */
	uint32_t range_least, range_most; /* raw values outside of these are no return */
	struct profile_field intensity;   /* of the first shot */
	uint32_t intensity_stride;
	uint32_t intensity_full;        /* raw value of intensity 1; 0: the largest value */
	double angle_first, angle_step; /* degrees, 0 ahead, positive to the left */
	double period_s;                /* of a revolution; 0: unknown */
	struct profile_field counter;
	struct profile_field time; /* in units of time_scale seconds */
	double time_scale;
};

struct profile_command {
	uint8_t at[PROFILE_COMMAND_SIZE]; /* as it is sent, with its framing */
	size_t size;
	uint8_t answer[PROFILE_COMMAND_SIZE]; /* the beginning of an answer that is awaited; size 0: none */
	size_t answer_size;
};

struct profile {
	char name[PROFILE_NAME_SIZE];                           /* of the file, without ".conf" */
	char title[PROFILE_TEXT_SIZE], note[PROFILE_TEXT_SIZE]; /* note: shown once at capture, e.g. from the maker */
	/* match: each criterion that is set must hold; -1 and "" are not set */
	int vendor, product, device_class, interface_class;
	char serial[PROFILE_TEXT_SIZE]; /* with * and ? */
	/* usb */
	unsigned configuration; /* 0: the current one */
	unsigned interface, alternate;
	uint8_t endpoint_in, endpoint_out; /* endpoint_out 0: none */
	uint32_t transfer_size, transfers; /* size of each, number in flight */
	uint32_t timeout_ms;               /* of commands; a silent stream is not an error */
	struct profile_command start[PROFILE_COMMANDS], stop[PROFILE_COMMANDS];
	size_t starts, stops;
	/* framer */
	enum profile_framer framer;
	uint32_t telegram_max; /* longer ones are bad */
	uint32_t fixed_size;   /* FIXED: size of each */
	uint8_t sync[8];       /* FIXED and LENGTH: the beginning of each */
	size_t sync_size;
	/* LENGTH: its offset, its size (1, 2, 4), the bytes that it does not count */
	uint32_t length_offset, length_size, length_add;
	bool length_big_endian;
	/* LINE: the stream is running when capture starts, so what comes before its first line end is not a line */
	bool starts_torn;
	/* decoder */
	char decoder[PROFILE_NAME_SIZE]; /* a row of decoder.h */
	char columns[16];                /* XYZ: letters as in acutctl --columns */
	double angle_ahead;              /* COLA-A: the device's angle for ahead, degrees */
	enum profile_stamp stamp;        /* of the device's time */
	struct profile_ranges ranges;
	/* geometry: of the sensor in the vehicle's body (x ahead, y right, z down), degrees and metres */
	double mount_roll, mount_pitch, mount_heading, lever[3];
	double range_min, range_max; /* metres; other shots are not points. max 0: from the decoder */
	enum profile_time time;
	double latency_s; /* from the shot to the arrival */
};

/* Whether it can match a device by itself: [match] has a criterion. */
bool profile_matches_some(const struct profile *);

/* Parses the text of a profile; keys that it does not have get defaults. `name`: of the profile; `file`: for messages.
 * -ERR_INPUT: err's file is FILE, its offset the line and its field "line"; or, for faults that concern several lines,
 * its field is the key. Unknown keys and sections are errors. */
enum { PROFILE_LINE_MAX = 1024 };
int profile_parse(const char *text, size_t size, const char *name, const char *file, struct profile *ret, struct err *);

/* The folders of the build, NULL-terminated: those of the package (PREFIX/share/acut/scanners.d), then those of the
 * administrator (/etc/acut/scanners.d). */
extern const char *const profile_folders[];

/* Read once, in order of names. A later folder's file replaces one of the same name; if it is empty or a link to
 * /dev/null, it removes that one. */
struct profile_set;
struct profile_entry {
	struct profile profile;
	char *text; /* as it was read; stored in spools */
	size_t size;
	char path[512];
	char *fault; /* why the file is invalid (it then matches nothing); NULL: valid */
};
/* `folders` in order (missing ones are skipped); NULL-terminated; NULL: profile_folders. Invalid files are not errors,
 * but entries with a fault; a folder that cannot be read is an error. */
int profile_set_read(const char *const *folders, struct profile_set **ret, struct err *);
struct profile_set *profile_set_free(struct profile_set *);
size_t profile_set_count(const struct profile_set *);
const struct profile_entry *profile_set_at(const struct profile_set *, size_t);
const struct profile_entry *profile_set_find(const struct profile_set *, const char *name);
/* Reads one file, anywhere (its name: the last part without ".conf"). Allocated; profile_entry_free. An invalid file is
 * an error here. */
int profile_entry_read(const char *path, struct profile_entry **ret, struct err *);
struct profile_entry *profile_entry_free(struct profile_entry *);

/* A device's description of itself; classes of its interfaces. */
struct profile_device {
	uint16_t vendor, product;
	uint8_t device_class;
	const uint8_t *interface_classes;
	size_t interfaces;
	const char *serial; /* NULL: unknown (not opened): a profile that requires one does not match */
};
/* The entry that matches most specifically (serial, then product, vendor, class); or NULL. */
const struct profile_entry *profile_set_match(const struct profile_set *, const struct profile_device *);

#endif
