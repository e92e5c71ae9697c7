/* Shared by the files of this room, and by its tests. */
#ifndef CORE_PRIV_H
#define CORE_PRIV_H

#include "core.h"

/* Charges of one user against user-disk, in bytes. */
struct limit_row {
	uint32_t uid;
	uint64_t counted; /* from core_usage */
	uint64_t pending; /* of `counted`: of interrupted pushes */
	uint64_t taken;   /* limit_disk_take */
	uint64_t geoids;
};

/* The task that queries the file systems. */
struct disk_query {
	struct sched_task task; /* first: a task is cast to its query */
	struct core *core;
};

struct core_private {
	/* charge.c: the largest charge that was refused since the last charge_reclaim, in bytes. */
	uint64_t refused_bytes;
	/* deferred.c */
	struct deferred {
		uint64_t since_ns;
		bool ended;
		struct sched_task *task[2]; /* whose `done` was not called; submitted if `ended` */
		unsigned n;
	} deferred;
	/* disk.c */
	struct disk {
		bool measured;           /* the measurement of the cache was submitted */
		struct sched_task *work; /* measures or evicts; NULL: there is none */
		bool querying;           /* a task queries the file systems */
		struct disk_query query;
		uint64_t queried_ns;   /* when it was last submitted */
		uint64_t remeasure_ns; /* from then on a cache whose use is not exactly known may be measured again */
		bool unknown;          /* a pass over the cache failed, and none has measured it since; this was logged */
	} disk;
	/* limit.c */
	struct limits {
		struct lock lock; /* LOCK_LIMITS: guards the rows */
		struct limit_row *row;
		size_t n, cap;
	} limits;
};

void limit_init(struct core_private *);
void limit_done(struct core_private *);

#endif
