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
enum profile_time { PROFILE_TIME_ARRIVAL, PROFILE_TIME_DEVICE }; /* of the transfer, or what the telegram says */

enum profile_stamp { PROFILE_STAMP_FIRST, PROFILE_STAMP_LAST }; /* the shot that the device's own time is of */

/* A number in a telegram of a fixed form: "u16le@4". */
struct profile_field {
	int32_t offset; /* of its first byte in the telegram; -1: there is none */
	uint8_t size;   /* 1, 2, 4 */
	bool big_endian;
};

/* Decoder "ranges": binary telegrams that have their ranges in a row, described wholly by the profile. */
struct profile_ranges {
	struct profile_field kind;  /* tells data from other telegrams: those with another value than ... */
	uint32_t data_kind;         /* ... this carry no sweep */
	struct profile_field count; /* shots; offset -1: `shots`, or as many as there is room for */
	uint32_t shots;
	struct profile_field range;       /* of the first shot; the next ones `range_stride` bytes further */
	uint32_t range_stride;            /* 0: its size */
	double range_scale;               /* metres of a unit */
	uint32_t range_least, range_most; /* raw values below and above are no return */
	struct profile_field intensity;   /* of the first shot */
	uint32_t intensity_stride;
	uint32_t intensity_full;        /* raw value of intensity 1; 0: all ones */
	double angle_first, angle_step; /* degrees, 0 ahead, positive to the left */
	double period_s;                /* of a revolution; 0: not known */
	struct profile_field counter;
	struct profile_field time; /* units of time_scale seconds */
	double time_scale;
};

struct profile_command {
	uint8_t at[PROFILE_COMMAND_SIZE]; /* as it is sent, framing included */
	size_t size;
	uint8_t answer[PROFILE_COMMAND_SIZE]; /* an answer that begins so is waited for; size 0: none */
	size_t answer_size;
};

struct profile {
	char name[PROFILE_NAME_SIZE];                           /* of the file, without ".conf" */
	char title[PROFILE_TEXT_SIZE], note[PROFILE_TEXT_SIZE]; /* note: said once at capture, e.g. what the maker says */
	/* match: each that is said must hold; numbers -1 and texts "" are not said */
	int vendor, product, device_class, interface_class;
	char serial[PROFILE_TEXT_SIZE]; /* with * and ? */
	/* usb */
	unsigned configuration; /* 0: as it is */
	unsigned interface, alternate;
	uint8_t endpoint_in, endpoint_out; /* endpoint_out 0: none */
	uint32_t transfer_size, transfers; /* bytes of each, how many in flight */
	uint32_t timeout_ms;               /* of commands; a silent stream is no error */
	struct profile_command start[PROFILE_COMMANDS], stop[PROFILE_COMMANDS];
	size_t starts, stops;
	/* framer */
	enum profile_framer framer;
	uint32_t telegram_max; /* longer ones are bad */
	uint32_t fixed_size;   /* FIXED: bytes of each; */
	uint8_t sync[8];       /* and of LENGTH: what each begins with */
	size_t sync_size;
	uint32_t length_offset, length_size, length_add; /* LENGTH: where it stands, bytes 1 2 4, what it leaves out */
	bool length_big_endian;
	bool starts_torn; /* LINE: the stream runs already when capture starts: what stands before its
			     first line end is no line */
	/* decoder */
	char decoder[PROFILE_NAME_SIZE]; /* a row of decoder.h */
	char columns[16];                /* of XYZ: letters as of acutctl --columns */
	double angle_ahead;              /* COLA-A: what the device calls ahead, degrees */
	enum profile_stamp stamp;        /* of the device's time */
	struct profile_ranges ranges;
	/* geometry: of the sensor in the vehicle's body (x ahead, y right, z down), degrees and metres */
	double mount_roll, mount_pitch, mount_heading, lever[3];
	double range_min, range_max; /* metres; shots beyond are no points. max 0: what the decoder says */
	enum profile_time time;
	double latency_s; /* from the shot to the arrival */
};

/* Whether it can match a device by itself: something is said under [match]. */
bool profile_matches_some(const struct profile *);

/* Defaults of all fields, so that a text need not say them. `name` of the profile; `file` for messages.
 * -ERR_INPUT: err's file is FILE, its offset the line and its field "line", or, of what is
 * wrong between lines, its field the key; unknown keys and sections are errors. */
enum { PROFILE_LINE_MAX = 1024 };
int profile_parse(const char *text, size_t size, const char *name, const char *file, struct profile *ret, struct err *);

/* The folders of the build, NULL-terminated: what acut ships (PREFIX/share/acut/scanners.d), then the administrator's
 * (/etc/acut/scanners.d). */
extern const char *const profile_folders[];

/* Read once; in order of names, a later folder's file replaces one of the same name, and one that is empty or a link
 * to /dev/null takes it away. */
struct profile_set;
struct profile_entry {
	struct profile profile;
	char *text; /* as it was read: goes into spools */
	size_t size;
	char path[512];
	char *fault; /* this file is broken: why (the others are there; this one matches nothing); NULL */
};
/* Folders in order (those that are not there are none); NULL-terminated; NULL: profile_folders. Broken files are no
 * error, they are entries with a fault; a folder that cannot be read is one. */
int profile_set_read(const char *const *folders, struct profile_set **ret, struct err *);
struct profile_set *profile_set_free(struct profile_set *);
size_t profile_set_count(const struct profile_set *);
const struct profile_entry *profile_set_at(const struct profile_set *, size_t);
const struct profile_entry *profile_set_find(const struct profile_set *, const char *name);
/* One file, wherever it is (name: its last part without ".conf"). Malloced, profile_entry_free. A broken file is an
 * error here. */
int profile_entry_read(const char *path, struct profile_entry **ret, struct err *);
struct profile_entry *profile_entry_free(struct profile_entry *);

/* What a device says of itself; classes of its interfaces. */
struct profile_device {
	uint16_t vendor, product;
	uint8_t device_class;
	const uint8_t *interface_classes;
	size_t interfaces;
	const char *serial; /* NULL: not known (not opened): a profile that asks for one does not match */
};
/* The entry that says most about it (serial, then product, vendor, class); NULL. */
const struct profile_entry *profile_set_match(const struct profile_set *, const struct profile_device *);

#endif
