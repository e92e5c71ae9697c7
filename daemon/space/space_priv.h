/* The insides of the disk's accounts, shared by space.c (asking) and space_evict.c (what goes). */
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

/* What a file system said last of itself. */
struct space_fs {
	uint64_t total, free;
	uint64_t asked_ns; /* that question began */
};

struct space {
	struct space_params p;
	struct space_fs fs[SPACE_SIDES];
	pthread_cond_t answered;
	struct lock lock;     /* of all but `p`'s descriptors; nobody waits for a file system under it */
	struct lock evicting; /* one at a time reads the folders; taken before `lock` */
	bool one;             /* file system */
	uint64_t taken[SPACE_KINDS], set[SPACE_KINDS], entries[SPACE_KINDS];
	uint64_t open[SPACE_KINDS]; /* of `taken`: what is not there under its name yet, so that no look sees it */
	uint64_t come[SPACE_KINDS]; /* what has got its name since the start */
	uint64_t promised[SPACE_SIDES];
	struct space_held *held;
	int64_t since_us;
	bool measured;
	uint64_t in_vain_ns[2]; /* when an eviction last found too little, by need; 0: none has */
	uint64_t evicted_bytes, evicted_files;
};

/* What is lacking for so many more bytes there; locked. */
struct space_lack {
	uint64_t bytes; /* the larger of the next two; 0: nothing */
	uint64_t by_quota, by_free;
	uint64_t used, quota, free, keep_free;
};
/* Asks the file system of that side, which may take any time: workers, without the lock. */
void space_ask_side(struct space *, int side);
struct space_lack space_lack_of(struct space *, int side, uint64_t bytes);
uint64_t space_by_cache(const struct space *, int side, const struct space_lack *); /* of it, what evicting can mend */
bool space_is_held(struct space *, const char *selection); /* its name in cache/selected; takes the lock */

/* Evicts until `bytes` more may be written on that side, and some more. What goes is told, not what is lacking then. */
int space_evict_for(struct space *, int side, uint64_t bytes, enum space_need, uint64_t *ret_bytes, uint64_t *ret_files,
		    struct err *err);

#endif
