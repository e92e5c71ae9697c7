/*
 * acut-scan: what its commands share. One file a command, one row in scan_command.c; options are rows of
 * scan_option.c, from which help and completion are made.
 */
#ifndef SCAN_H
#define SCAN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;

enum { SCAN_PROFILE_FOLDERS = 8 };

struct scan_args {
	const char *command;
	const char *const *inputs;   /* what is no option */
	size_t n;
	bool json, quiet, all;
	const char *profiles[SCAN_PROFILE_FOLDERS + 1]; /* --profiles DIR, in place of the built-in folders */
	const char *device;          /* --device WHICH: serial:..., port:..., VENDOR:PRODUCT, a profile's name */
	const char *output;          /* -o FILE */
	const char *folder;          /* --folder DIR: record makes PROFILE-SERIAL-TIME.spool in it */
	bool reconnect;              /* --reconnect: goes on in the same spool when the device comes back */
	double seconds;              /* --for SECONDS; 0: until stopped */
	uint64_t bytes;              /* --bytes SIZE; 0 */
	double sync_s;               /* --sync SECONDS */
	const char *profile;         /* --profile NAME|FILE: in place of the spool's own */
	/* push */
	const char *socket, *into, *pose, *crs, *utm, *name;
	const char *pose_clock;      /* --pose-clock utc|gps */
	double gap_s, pose_offset_s;
	/* replay */
	const char *to;              /* --to telegrams|sweeps|raw */
};

/* Exit status; errors were printed. */
int scan_list(const struct scan_args *);
int scan_probe(const struct scan_args *);
int scan_record(const struct scan_args *);
int scan_replay(const struct scan_args *);
int scan_push(const struct scan_args *);
int scan_profiles(const struct scan_args *);

/* "acut-scan: ..." on stderr, or as JSON where it was asked for; gives the exit status of err.def. */
int scan_fail(const struct scan_args *, const struct err *);
/* SIGINT and SIGTERM since start; the descriptor is readable then. */
bool scan_stopped(void);
int scan_stop_fd(void);

#endif
