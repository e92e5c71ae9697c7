/*
 * A drop folder: scanning it (ctl_drop_scan.c), moving files out of it (ctl_drop_move.c).
 */
#ifndef CTL_DROP_H
#define CTL_DROP_H

#include <limits.h>

#include "ctl_input.h"
#include "digest.h"

/* A drop folder: opened once, and everything in it reached through this descriptor. */
struct ctl_drop {
	const char *name; /* as the user gave it */
	char *path;       /* absolute */
	int fd, done, failed;
};

struct ctl_drop_file {
	struct ctl_input in; /* name: safe to print; entry: as it is */
	char *entry, *path;
	uint64_t since;     /* it was seen as it is */
	struct digest hash; /* of its bytes */
	bool tried, there, hashed;
	bool taken; /* the dataset has its content */
	size_t bad; /* it is refused as the file of that number, counted from 1, of the refusals; 0: it is not */
};

struct ctl_drop_list {
	struct ctl_drop_file *file; /* by name */
	size_t n, room;
	unsigned passed_by;  /* neither files nor folders */
	uint64_t scanned_ns; /* start of the last scan: files that were there before were seen again */
};

struct ctl_drop_name {
	char text[NAME_MAX + 16]; /* "done/NAME", below the folder */
};

/* Makes done/ and failed/ where they are not there, and sees to it that files can be moved into them. */
int ctl_drop_open(struct ctl_drop *, const char *name, struct err *err);
void ctl_drop_close(struct ctl_drop *);
/* Reads the folder. Files that have not changed keep all that is known of them. */
int ctl_drop_scan(const struct ctl_drop *, struct ctl_drop_list *, struct err *err);
void ctl_drop_list_done(struct ctl_drop_list *);
/* Moves what was pushed, if it is still what was pushed, under a name that nothing has yet. -ERR_CHANGED: it is not, and stays.
 */
int ctl_drop_done(const struct ctl_drop *, const struct ctl_input *, struct ctl_drop_name *ret, struct err *err);
/* Likewise refused files; NAME.error beside a file has the reason. */
int ctl_drop_failed(const struct ctl_drop *, const struct ctl_input *, const char *dataset, const struct err *why,
		    struct ctl_drop_name *ret, struct err *err);

#endif
