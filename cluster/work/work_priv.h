/* What the files of this room share. Internal. */
#ifndef WORK_PRIV_H
#define WORK_PRIV_H

#include <stdio.h>

#include "work.h"

/* What is in the folder beside the results of tasks. */
#define WORK_ABOUT "acut-work"
#define WORK_INPUTS "inputs"
#define WORK_CANCELLED "cancelled"
extern const char *const work_folders[]; /* a NULL at the end */

struct work {
	char *folder, *path; /* as given; absolute, without links, NULL: unknown */
	bool linked;         /* the name that was given is a symbolic link */
	int fd;
	double patience;
	int (*interrupted)(void *ctx); /* NULL: never */
	void *interrupted_ctx;
	struct work_about about;
	char *text; /* of acut-work: holds its words */
};

/*
 * A text file of lines "KEY REST": the first is its kind and version, the last "check SUM", XXH3-64 of all bytes before that
 * line. In REST a backslash, a line feed and a carriage return are written as \\, \n and \r.
 */
struct work_out {
	char *bytes;
	size_t size;
	FILE *to; /* writes to `bytes` */
};
int work_out_begin(struct work_out *, const char *kind, struct err *err);
void work_out_line(struct work_out *, const char *key, const char *rest);
/* Adds the check. Afterwards bytes[0..size) are the file, to be freed with work_out_done. */
int work_out_end(struct work_out *, struct err *err);
void work_out_done(struct work_out *);

struct work_in {
	char *text, *at; /* lines are taken apart in place */
	size_t size;
};
/* -ERR_CORRUPT, -ERR_VERSION. WORK_E_ABSENT: there is no such file, or, with `wait`, not even after the patience. `text` is the
 * caller's (free). */
int work_in_read(const struct work *, const char *name, const char *kind, bool wait, struct work_in *ret, struct err *err);
size_t work_in_lines(const struct work_in *); /* that are left */
/* The next line; false: there are no more. */
bool work_in_line(struct work_in *, char **ret_key, char **ret_rest);
/* A number in front of `*rest`, which is moved behind it and the space there. */
bool work_in_u64(char **rest, uint64_t *ret);

int work_corrupt(const char *name, const char *what, struct err *err); /* -ERR_CORRUPT */

/* Writes a new file `temp`, fsynced, which must not exist. */
int work_write_new(const struct work *, const char *temp, const void *bytes, size_t n, struct err *err);
uint64_t work_random(void);
/* Whether the error is one that a shared file system mends: the file is not seen yet, or not any more. */
bool work_passing(int sys);

#endif
