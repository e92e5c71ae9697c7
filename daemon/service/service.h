/*
 * The service: all rooms of the daemon together. It makes them, calls each of them in the event loop, and stops them.
 *
 * Everything here belongs to the loop thread. Only workers and the catalogue's thread read and write disks.
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
	uint64_t counted_ns; /* service.c */
	struct health_state *health;
};

struct service_params {
	struct core_params core;
	/* A job was added, made progress, or ended. */
	void (*changed)(void *ctx, struct job *);
	void *ctx;
};
/* Loads the catalogue, removes what uncommitted pushes and one-step datasets of an earlier daemon left, and queues the unfinished
 * jobs. Reads the disk: call it before the loop runs. */
int service_new(const struct service_params *, struct service **ret, struct err *err);
/* Only if service_is_stopped. NULL is fine; returns NULL. */
struct service *service_free(struct service *);
/* After a reload. They hold from the next check on: derived files are evicted, work that waits goes on. Those of users hold for
 * later requests. */
void service_set_limits(struct service *, const struct core_limits *);
/* Gives memory to starved tasks, and starts what can start. After sched_dispatch and catalogue_dispatch. */
void service_settle(struct service *);
/* Periodic work. About ten times a second while service_active or service_is_deferring. */
void service_tick(struct service *);
bool service_active(const struct service *);       /* a push is open, or a job or stream is unfinished */
bool service_is_deferring(const struct service *); /* tasks of the start wait; no client waits for them */
/* Ends work as soon as possible: pushes and bound jobs end, other jobs are queued for the next start. */
void service_stop(struct service *);
bool service_is_stopped(const struct service *); /* service_stop was called, and no task is left */
/* For a stop that takes too long: removes temporary files at once. Workers still run, so exit next. */
void service_abandon(struct service *);

/* ---- numbers ---- */

/* For a line of status: open pushes, jobs, and the domains of those that run (total 0: not planned yet). */
struct service_work {
	uint32_t pushes, running, waiting;
	uint64_t domains_done, domains_total;
};
void service_work(const struct service *, struct service_work *ret);
/* Calls `each` for every holder of memory. Everything else is held by the service itself, or by tasks that read a single file. */
void service_holders(const struct service *, void (*each)(void *ctx, const struct core_holder *), void *ctx);
struct service_numbers {
	struct tally tally;
	struct verified verified;
	uint64_t states[JOB_STATES]; /* unfinished jobs */
	uint64_t jobs_listed;        /* finished ones included */
	double oldest_waiting;       /* seconds since the oldest job that has not begun was submitted; 0: none waits */
	uint64_t pushes;             /* open */
	uint64_t pending;            /* interrupted pushes */
	double pending_left;         /* seconds until the first of these is removed */
	uint64_t waiting_space;      /* jobs */
	uint64_t datasets, removed;
	bool catalogue_failed; /* it cannot be written, and it is unknown what it has of the last change */
};
void service_numbers(const struct service *, struct service_numbers *ret);
/* What one user has. */
struct service_user {
	uint32_t uid, datasets, jobs; /* jobs: unfinished */
	uint64_t bytes, points;       /* of named datasets, removed ones included */
	uint64_t pending_bytes;       /* of interrupted pushes, at most */
};
/* The users who have something, by uid, beginning with `from`. Returns how many, up to n. */
size_t service_users(const struct service *, uint64_t from, struct service_user *ret, size_t n);

/* What one user has, and may have at most; most 0: no limit. */
struct service_usage {
	bool exempt;                               /* an administrator */
	unsigned jobs, jobs_most;                  /* unfinished */
	unsigned datasets, removed, datasets_most; /* removed: of the datasets */
	uint64_t disk, disk_most;                  /* bytes */
};
/* state_bytes: the size of the state's file system. */
void service_usage(const struct service *, const struct peer *, uint64_t state_bytes, struct service_usage *ret);

/* ---- health ---- */

/* The file system of state or cache. */
struct health_side {
	int sys;                    /* errno: it could not be queried; the rest is 0 */
	uint64_t free, total;       /* bytes */
	uint64_t files_free, files; /* inodes; files 0: it does not count them */
	bool read_only;
};
struct health {
	struct health_side state, cache;
	unsigned geoids, geoids_bad;
	char geoid_why[512];          /* error of the first bad one */
	unsigned open_files, threads; /* of this process */
};
/* Answers once, with a result of the last second at once, or with that of a new check. All requests that come meanwhile share
 * one check. `why`: there is no result. */
void health_check(struct service *, const struct peer *,
		  void (*answer)(void *token, const struct err *why, const struct health *), void *token);

#endif
