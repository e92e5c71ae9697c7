/*
 * The service: all rooms of the daemon together. Makes them, gives each its turn in the loop, and stops them.
 *
 * Everything here belongs to the loop thread. Disks are read and written by workers and by the catalogue's thread only.
 */
#ifndef SERVICE_H
#define SERVICE_H

#include "copy.h"
#include "core.h"
#include "dataset.h"
#include "geoid.h"
#include "inspect.h"
#include "job.h"
#include "maintenance.h"
#include "push.h"

struct service {
	struct core *core;
	struct admission *admission;
	struct datasets *datasets;
	struct geoids *geoids;
	struct copies *copies;
	struct runs *runs;
	struct pushes *pushes;
	struct jobs *jobs;
	struct maintenance *maintenance;
	/* of service.c */
	uint64_t counted_ns;
	/* of health.c */
	struct health_state *health;
};

struct service_params {
	struct core_params core;
	/* A job came to be, went on, or ended. */
	void (*changed)(void *ctx, struct job *);
	void *ctx;
};
/* Loads the catalogue, removes what uncommitted pushes and dead one-step datasets left, queues the jobs that were not done. Reads
 * the disk: call it before the loop runs. */
int service_new(const struct service_params *, struct service **ret, struct err *err);
/* Only when service_parked. NULL is fine; returns NULL. */
struct service *service_free(struct service *);
/* What may change while the service runs; as in core_params. What is there already is held to it from the next look on: what can
 * be made again is evicted, who waits goes on. */
struct service_limits {
	struct space_limit disk, keep_free;
	double keep_removed, space_wait;
};
void service_set_limits(struct service *, const struct service_limits *);
/* For what is asked from now on. */
void service_set_user_limits(struct service *, const struct user_limits *);
/* After sched_dispatch and catalogue_dispatch: gives memory to who starves, starts what can start. */
void service_settle(struct service *);
/* About ten times a second while service_active or service_resting. */
void service_tick(struct service *);
bool service_active(const struct service *);  /* a push is open, or a job or stream is not over */
bool service_resting(const struct service *); /* what a start has to sweep and measure has not begun; nobody waits for that */
/* Work stops as soon as it can: pushes end, bound jobs end, unbound jobs stay queued for the next start. */
void service_park(struct service *);
bool service_parked(const struct service *);
/* The last resort of a stop that takes too long: removes temporary files at once. Workers still run: exit next. */
void service_abandon(struct service *);

/* ---- numbers ---- */

/* What goes on, for a line about it: open pushes, jobs, and the domains of those that run (total 0: not planned yet). */
struct service_work {
	uint32_t pushes, running, waiting;
	uint64_t domains_done, domains_total;
};
void service_work(const struct service *, struct service_work *ret);
/* All that hold something. What is held beside them is of the service, or of tasks that look at a single file. */
void service_holders(const struct service *, void (*each)(void *ctx, const struct core_holder *), void *ctx);
struct service_numbers {
	struct tally tally;
	struct verified verified;
	uint64_t states[JOB_STATES]; /* jobs that are not over */
	uint64_t kept;               /* jobs, over ones included */
	double oldest_waiting;       /* seconds since the oldest job that has not begun was submitted; 0: none waits */
	uint64_t pushes;             /* open */
	uint64_t pending;            /* interrupted ones that wait */
	double pending_left;         /* seconds until the first of these is dropped */
	uint64_t waiting_space;      /* jobs */
	uint64_t datasets, removed;
	bool unsure; /* the catalogue cannot be written, and nobody knows what of the last change it has */
};
void service_numbers(const struct service *, struct service_numbers *ret);
struct service_user {
	uint32_t uid, datasets, jobs; /* jobs: unfinished */
	uint64_t bytes, points;       /* of named datasets, removed ones included */
	uint64_t pending_bytes;       /* at most, of interrupted pushes */
};
/* Those who have something, by uid, from `from` on; their number, up to n. */
size_t service_users(const struct service *, uint64_t from, struct service_user *ret, size_t n);

/* How much one user has of what he may; a limit of 0: there is none. */
struct service_own {
	bool exempt;                                                /* no limit holds for him */
	unsigned jobs, jobs_most, datasets, removed, datasets_most; /* jobs: unfinished; of the datasets so many are removed */
	uint64_t disk, disk_most;
};
void service_own(const struct service *, const struct peer *, uint64_t state_bytes,
		 struct service_own *ret); /* size of that file system */

/* ---- health ---- */

/* What a worker sees of disks and grids when it looks. */
struct health_side {
	int sys;                                 /* errno: it cannot be looked at */
	uint64_t free, total, files_free, files; /* bytes; inodes, files 0: it does not count them */
	bool read_only;
};
struct health {
	struct health_side state, cache;
	unsigned geoids, geoids_bad;
	char geoid_why[512];          /* of the first that is bad */
	unsigned open_files, threads; /* of this process */
};
/* What was seen within the last second, or what a worker sees now: one look serves all who ask meanwhile. */
void health_check(struct service *, const struct peer *,
		  void (*answer)(void *token, const struct err *why, const struct health *), void *token);

#endif
