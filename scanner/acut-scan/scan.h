/*
 * acut-scan: what its commands share. One file a command, one row in scan_command.c; options are rows of
 * scan_option.c, from which help and completion are made.
 */
#ifndef SCAN_H
#define SCAN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "term_json.h"
#include "term.h"
#include "term_error.h"

struct err;

enum { SCAN_PROFILE_FOLDERS = 8 };

struct scan_args {
	const char *command;
	const char *const *inputs; /* what is no option */
	size_t n;
	bool json, quiet, all, no_progress, help;
	bool watch;                                     /* --watch: list goes on with what comes and leaves */
	bool udev;                                      /* --udev: profiles as rules for udev */
	const char *profiles[SCAN_PROFILE_FOLDERS + 1]; /* --profiles DIR, in place of the built-in folders; ends with NULL */
	size_t n_profiles;
	const char *device;  /* --device WHICH: serial:..., port:..., VENDOR:PRODUCT, a profile's name */
	const char *output;  /* -o FILE */
	const char *folder;  /* --folder DIR: record makes PROFILE-SERIAL-TIME.spool in it */
	const char *from;    /* --from FILE|-: record takes the bytes of a file or pipe, not those of a device */
	bool resume;         /* --continue: record goes on in the spool -o that has no END */
	bool reconnect;      /* --reconnect: goes on in the same spool when the device comes back */
	double seconds;      /* --for SECONDS; 0: until stopped */
	uint64_t bytes;      /* --bytes SIZE; 0 */
	double sync_s;       /* --sync SECONDS */
	const char *profile; /* --profile NAME|FILE: in place of the spool's own */
	/* push */
	const char *socket, *into, *pose, *crs, *utm, *name;
	const char *pose_clock;      /* --pose-clock utc|gps */
	double gap_s, pose_offset_s; /* gap 0: not said */
	const char *heading;         /* --heading true|grid: what headings are from; NULL: as the columns of positions say */
	const char *geoid;           /* --geoid NAME: a grid of the daemon */
	bool grid_scale, replace;
	/* replay */
	const char *to; /* --to raw|telegrams|sweeps|csv|points */
};

/* Exit status; errors were printed. */
int scan_list(const struct scan_args *);
int scan_probe(const struct scan_args *);
int scan_record(const struct scan_args *);
int scan_replay(const struct scan_args *);
int scan_push(const struct scan_args *);
int scan_profiles(const struct scan_args *);
int scan_udev(const struct scan_args *); /* profiles --udev */
int scan_help(const struct scan_args *);
int scan_version(const struct scan_args *);

/* "acut-scan: ..." on stderr, or as JSON where it was asked for; gives the exit status of err.def. An -ERR_CANCELLED
 * after a signal is said in a word, and gives 128 and the signal's number. */
int scan_fail(const struct scan_args *, const struct err *);
/* A line of text on stderr, "acut-scan: note: ...", "acut-scan: warning: ..."; not with --quiet, not with --json. */
void scan_note(const struct scan_args *, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
void scan_warn(const struct scan_args *, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
/* Where results and JSON go: standard output, or standard error where the output is "-". */
FILE *scan_report(const struct scan_args *);
/* One line that is written over, on stderr, where that is a terminal and neither --quiet, --json nor --no-progress was
 * said (scan_progress_on); it goes before anything else is told there. */
bool scan_progress_on(const struct scan_args *);
void scan_progress(const char *fmt, ...) __attribute__((format(printf, 1, 2)));
void scan_progress_clear(void);

/* SIGINT, SIGTERM and SIGHUP since start; the descriptor is readable then. The second of a kind kills. */
void scan_signal_init(void);
bool scan_stopped(void);
int scan_stop_fd(void);
int scan_stop_signal(void); /* 0: none */

/* ---- the tables ---- */

enum scan_group { /* an option is allowed where its groups meet the command's */
		  SCAN_ALL = 1,
		  SCAN_PROFILES = 2, /* reads the folders of profiles */
		  SCAN_DEVICE = 4,   /* of one device */
		  SCAN_LIST = 8,
		  SCAN_PROBE = 16,
		  SCAN_RECORD = 32,
		  SCAN_REPLAY = 64,
		  SCAN_PUSH = 128,
		  SCAN_KINDS = 256, /* profiles */
};

struct scan_command {
	const char *name, *usage, *help;
	unsigned groups;
	unsigned least, most; /* words */
	int (*run)(const struct scan_args *);
	bool hidden; /* not for people */
};
const struct scan_command *scan_command_rows(size_t *ret_n);
const struct scan_command *scan_command_find(const char *name); /* NULL: there is none */
int scan_command_unknown(const char *name, struct err *);

struct scan_option {
	const char *name; /* without the dashes */
	char letter;
	const char *value; /* what follows; small letters are the very values (a|b), capitals name a kind; NULL: nothing */
	enum { SCAN_FLAG, SCAN_TEXT, SCAN_FOLDERS, SCAN_SECONDS, SCAN_SIZE, SCAN_NUMBER } kind;
	size_t at; /* in struct scan_args */
	unsigned groups;
	const char *help;
};
const struct scan_option *scan_option_rows(size_t *ret_n);
/* Reads the command line; `words` (argc places) will hold what is no option. -ERR_USAGE. */
int scan_option_parse(int argc, char **argv, const char **words, struct scan_args *ret, const struct scan_command **ret_command,
		      struct err *);

/* "complete N WORD...": what could stand as the Nth of these words, for the shells. */
int scan_complete(int argc, char **argv);

#endif
