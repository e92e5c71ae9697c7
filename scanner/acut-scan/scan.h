/*
 * acut-scan: what its commands share. One file a command, one row in scan_command.c.
 */
#ifndef SCAN_H
#define SCAN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "cli.h"
#include "console.h"
#include "term.h"
#include "term_error.h"
#include "term_json.h"

struct err;

struct program {
	struct console console;
	struct cli_line line;
	bool all;
	bool watch;                /* --watch: list prints devices as they come and leave */
	bool udev;                 /* --udev: profiles as rules for udev */
	struct cli_texts profiles; /* --profiles DIR, in place of the built-in folders */
	const char *device;        /* --device WHICH: serial:..., port:..., VENDOR:PRODUCT, a profile's name */
	const char *output;        /* -o FILE */
	const char *folder;        /* --folder DIR: record makes PROFILE-SERIAL-TIME.spool in it */
	const char *from;          /* --from FILE|-: record takes the bytes of a file or pipe, not those of a device */
	bool resume;               /* --continue: record continues the spool -o that has no END */
	bool reconnect;            /* --reconnect: continue in the same spool when the device comes back */
	double seconds;            /* --for SECONDS; 0: until stopped */
	uint64_t bytes;            /* --bytes SIZE; 0 */
	double sync_s;             /* --sync SECONDS */
	const char *profile;       /* --profile NAME|FILE: in place of the spool's own */
	/* push */
	const char *socket, *into, *pose, *crs, *utm, *name;
	const char *pose_clock;      /* --pose-clock utc|gps */
	double gap_s, pose_offset_s; /* gap 0: not given */
	const char *heading;         /* --heading true|grid: the reference of headings; NULL: from the columns of positions */
	const char *geoid;           /* --geoid NAME: a grid of the daemon */
	bool grid_scale, replace;
	/* replay */
	const char *to; /* --to raw|telegrams|sweeps|csv|points */
};

/* Exit status; errors were printed. */
int scan_list(struct program *);
int scan_probe(struct program *);
int scan_record(struct program *);
int scan_replay(struct program *);
int scan_push(struct program *);
int scan_profiles(struct program *);
int scan_udev(struct program *); /* profiles --udev */
int scan_version(struct program *);

/* Prints the error. Its exit status; after a signal an -ERR_CANCELLED is "interrupted", with 128 and the signal's number. */
int scan_fail(struct program *, const struct err *);

/* SIGINT, SIGTERM and SIGHUP since start; the descriptor is readable then. The second of a kind kills. */
void scan_signal_init(void);
bool scan_stopped(void);
int scan_stop_fd(void);

/* ---- the tables: scan_command.c ---- */

enum scan_group {
	SCAN_PROFILES = 2, /* reads the folders of profiles */
	SCAN_DEVICE = 4,   /* of one device */
	SCAN_LIST = 8,
	SCAN_PROBE = 16,
	SCAN_RECORD = 32,
	SCAN_REPLAY = 64,
	SCAN_PUSH = 128,
	SCAN_KINDS = 256, /* profiles */
};
struct cli scan_cli(void);
/* Candidates of the kinds of words that are acut-scan's own, for cli_complete. No device is opened for it. */
bool scan_offer(struct cli_typed *, const char *kind, size_t n);

#endif
