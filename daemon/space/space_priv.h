/* The state of the disk's accounts, shared by space.c (accounts) and space_evict.c (eviction). Amounts are bytes. */
#ifndef SPACE_PRIV_H
#define SPACE_PRIV_H

#include "lock.h"
#include "space.h"

enum { SPACE_ON_STATE, SPACE_ON_CACHE, SPACE_SIDES };

struct space_held {
	struct space_held *next;
	struct digest selection;
	unsigned users;
};

/* The last answer of a file system. */
struct space_fs {
	uint64_t total, free;
	uint64_t queried_ns; /* when that query began */
};

struct space {
	struct space_params p;
	struct space_fs fs[SPACE_SIDES];
	pthread_cond_t answered; /* a query has ended */
	struct lock lock;        /* LOCK_SPACE: guards everything but the descriptors; not held while a file system is queried */
	struct lock evicting;    /* LOCK_EVICT: one pass over the folders at a time; taken before `lock` */
	bool one_fs;             /* state and cache are on one file system */
	uint64_t taken[SPACE_KINDS];
	uint64_t counted[SPACE_KINDS]; /* space_set_counted */
	uint64_t entries[SPACE_KINDS];
	uint64_t uncommitted[SPACE_KINDS]; /* part of `taken`: has no final name yet, so a pass does not see it */
	uint64_t committed[SPACE_KINDS];   /* since the start */
	uint64_t unwritten[SPACE_SIDES];
	struct space_held *held;
	int64_t running_since_us; /* domains used since then are in use */
	bool measured;
	bool inexact;          /* files were committed during the last pass, which may have counted them twice */
	uint64_t futile_ns[2]; /* by need: when an eviction last freed too little; 0: none has */
	uint64_t evicted_bytes, evicted_files;
};

/* What is missing on one side for so many more bytes. */
struct space_shortage {
	uint64_t bytes; /* the larger of the next two; 0: nothing is missing */
	uint64_t by_quota, by_free;
	uint64_t used, quota, free, keep_free;
};
struct space_shortage space_shortage_of(struct space *, int side, uint64_t bytes); /* with the lock */
/* The part of a shortage that eviction can remove. With the lock. */
uint64_t space_evictable(const struct space *, int side, const struct space_shortage *);
/* Queries the file system of that side. It may never answer: workers, without the lock. */
void space_query_side(struct space *, int side);
/* Whether the selection with that name in cache/selected is held. Takes the lock. */
bool space_is_held(struct space *, const char *selection);

/* Evicts until `bytes` more may be written on that side, and a reserve. Success does not mean that there is enough space.
 * *ret_bytes, *ret_files: what was removed. Workers. */
int space_evict_for(struct space *, int side, uint64_t bytes, enum space_need, uint64_t *ret_bytes, uint64_t *ret_files,
		    struct err *err);

#endif
