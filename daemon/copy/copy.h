/*
 * What a client takes out and brings in whole: copies of the state, of one dataset, and a dataset that another
 * machine has written out.
 */
#ifndef COPY_H
#define COPY_H

#include "core.h"

struct copies;
struct datasets;

/* At the start: what a crash left of backups goes. Reads the disk. */
int copies_new(struct core *, struct datasets *, struct copies **ret, struct err *err);
struct copies *copies_free(struct copies *); /* NULL is fine; returns NULL */

/* ---- out ---- */

struct backup;

struct backup_ready {
	struct backup *backup;
	uint64_t id, files, bytes;
	uint64_t ndamaged;         /* datasets whose manifest is damaged: they are there as they lie on the disk */
	const struct err *damaged; /* what is wrong with the first of them */
	char identity[64];         /* of the store, and of the dataset in it: no two have the same, whatever their names */
	uint64_t place[2][2];      /* device and inode of the state folder and the cache folder; zeros: not known */
};
struct backup_file {
	const char *name; /* relative, with '/' */
	uint64_t size;
	bool lasting; /* one of this name never has other bytes */
	int fd;       /* for reading; the callee's */
};

/* All that the state of this moment consists of; dataset not "": the files of that one. Root and the daemon's user, the
 * who may read the dataset; who does not own it gets its manifest without the paths of its files. Nothing of it goes before
 * backup_end, whatever is pushed, merged or removed meanwhile. */
void backup_begin(struct copies *, const char *dataset, const struct peer *,
		  void (*ready)(void *token, const struct err *why, const struct backup_ready *), void *token);
/* The next file; NULL: that was all. One at a time. */
void backup_next(struct backup *, void (*next)(void *token, const struct err *why, const struct backup_file *), void *token);
/* Nobody wants more of it. */
void backup_end(struct backup *);
uint64_t backup_id(const struct backup *);

/* ---- in ---- */

struct import;
struct imported {
	const char *dataset;
	uint64_t generation, points;
};

/* A new dataset `name`, of this peer. It is there when the commit has answered, or never. */
void import_begin(struct copies *, const char *name, uint32_t mode, const struct peer *,
		  void (*begun)(void *token, const struct err *why, struct import *), void *token);
/* First "manifest", then each file that it names. Takes `fd`. One at a time. */
void import_file(struct import *, const char *name, int fd, void (*done)(void *token, const struct err *why), void *token);
/* Reads all of it and checks every block. */
void import_commit(struct import *, void (*done)(void *token, const struct err *why, const struct imported *), void *token);
/* Its client is done with it, or has left: what was not committed goes. */
void import_end(struct import *);
uint64_t import_id(const struct import *);

#endif
