/* Shared by the files of this room. */
#ifndef MAINTENANCE_PRIV_H
#define MAINTENANCE_PRIV_H

#include "dataset.h"
#include "job.h"
#include "maintenance.h"

struct maintenance {
	struct core *core;
	struct datasets *datasets;
	struct jobs *jobs;
	struct cache_verify *verify; /* the one that is running; NULL: none */
	struct cache_adopt *adopt;   /* those that are running */
	struct verified verified;
};

/* cache_verify.c */
void cache_verify_tick(struct maintenance *);
/* cache_adopt.c */
void cache_adopt_tick(struct maintenance *);
/* cache_gc.c */
int cache_may(const struct peer *, const char *what, struct err *err); /* -ERR_PERM: not an administrator */
/* verified.c */
void verified_load(struct maintenance *); /* reads the disk */
void verified_note(struct maintenance *, const struct cache_verified *);

#endif
