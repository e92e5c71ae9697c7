/*
 * Backups of the state, exports of one dataset, and imports of a dataset that was exported, here or on another machine.
 */
#ifndef COPY_H
#define COPY_H

#include "core.h"

struct copies;
struct datasets;

/* At the start: also removes backup folders that a crash left. Reads the disk. */
int copies_new(struct core *, struct datasets *, struct copies **ret, struct err *err);
struct copies *copies_free(struct copies *); /* NULL is fine; returns NULL */

/* ---- backups and exports ---- */

struct backup;

struct backup_ready {
	struct backup *backup;
	uint64_t id, files, bytes;
	uint64_t ndamaged;         /* datasets whose manifest is damaged: all files in their folders are included */
	const struct err *damaged; /* the first damage */
	char identity[64];         /* unique to the store, and to the dataset of an export; independent of names */
	uint64_t place[2][2];      /* device and inode of the state folder and the cache folder; zeros: not known */
};
struct backup_file {
	const char *name; /* relative, with '/' */
	uint64_t size;
	bool lasting; /* immutable: a file of this name always has these bytes */
	int fd;       /* for reading; the callee's */
};

/* Takes a backup of the whole state ("", administrators only), or an export of one dataset (users who may read it). A user who
 * does not own the dataset gets its manifest without the paths of its source files. The files stay until backup_end, whatever is
 * pushed, merged or removed meanwhile. */
void backup_begin(struct copies *, const char *dataset, const struct peer *,
		  void (*ready)(void *token, const struct err *why, const struct backup_ready *), void *token);
/* Calls `next` with the next file, or with NULL after the last. One call at a time. */
void backup_next(struct backup *, void (*next)(void *token, const struct err *why, const struct backup_file *), void *token);
/* Ends it, complete or not. */
void backup_end(struct backup *);
uint64_t backup_id(const struct backup *);

/* ---- imports ---- */

struct import;
struct imported {
	const char *dataset;
	uint64_t generation, points;
};

/* Begins the import of a new dataset `name`, owned by this peer. The dataset exists once the commit has succeeded. */
void import_begin(struct copies *, const char *name, uint32_t mode, const struct peer *,
		  void (*begun)(void *token, const struct err *why, struct import *), void *token);
/* Adds a file: "manifest" first, then each file that it names. Takes `fd`. One call at a time. */
void import_file(struct import *, const char *name, int fd, void (*done)(void *token, const struct err *why), void *token);
/* Reads all files and checks every block, then makes the dataset. */
void import_commit(struct import *, void (*done)(void *token, const struct err *why, const struct imported *), void *token);
/* Ends the import. What was not committed is removed. */
void import_end(struct import *);
uint64_t import_id(const struct import *);

#endif
