/*
 * Shared by the rooms of the daemon: parameters, folders, charged memory, disk space by user, background work.
 *
 * The model: one `struct core` per daemon. A room above keeps its own state and a pointer to the core. The core calls no room
 * above it, except by callbacks in `struct core`, which a room sets when it is made. Functions belong to the loop thread, and
 * assert that, unless they say "any thread".
 */
#ifndef CORE_H
#define CORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "catalogue.h"
#include "err.h"
#include "ledger.h"
#include "lock.h"
#include "log.h"
#include "rights.h"
#include "sched_pool.h"
#include "space.h"
#include "thread.h"

/* Settings that a reload changes (daemon/settings.c). */
struct core_limits {
	struct space_limit disk, keep_free; /* as in space_params */
	double keep_removed;                /* seconds that a removed dataset can be restored; 0: 7 days */
	double space_wait;                  /* seconds that work for a waiting client may wait for disk space */
	struct user_limits {                /* of one user who is no administrator; 0, SPACE_UNLIMITED: no limit */
		unsigned jobs;              /* unfinished */
		unsigned memory;            /* per cent of the memory, for jobs, pushes and plans */
		unsigned datasets;          /* that the user owns, removed ones included */
		struct space_limit disk;    /* of datasets and pushes; per cent: of the state's file system */
	} user;
};

/* Pointers and descriptors are borrowed, until core_free. */
struct core_params {
	struct ledger *ledger;
	struct sched *sched;
	struct catalogue *catalogue; /* not started */
	int statefd, cachefd;        /* folders */
	const uint8_t *store;        /* the 16 bytes that identify this store (its marker); NULL: zeros */
	unsigned threads;            /* domains at once, at most */
	double defer_seconds;        /* after the start, without client work, before deferred tasks run; 0: none */
	struct core_limits limits;
	/* Makes the removed folder of the cache again; *ret_fd is the caller's. NULL: it stays removed. */
	int (*remake_cache)(void *ctx, int *ret_fd, struct err *err);
	void *cache_ctx;
};

/* Counts of work since the start. */
struct tally {
	uint64_t points_staged, files_staged, bytes_read; /* of files that pushes have read completely */
	uint64_t triangles, domains_made, domains_reused;
	uint64_t merges, merged_bytes;
};

/* `pending`: of an interrupted push. */
typedef void core_usage_fn(void *to, uint32_t uid, uint64_t bytes, bool pending);

struct core {
	struct core_params p;
	struct tally tally;
	struct space *space; /* accounts of the disk; any thread */
	/* state/datasets, cache/one-step, cache/domains, cache/tmp, state/plans */
	int datafd, onestepfd, domainsfd, tempfd, plansfd;
	bool stopping;       /* the daemon stops: nothing new begins */
	bool loading;        /* the catalogue is being read */
	unsigned background; /* tasks that belong to no job or push (core_background) */
	uint64_t last_flow;  /* number of the newest flow of tasks (struct sched_owner) */
	uint64_t last_push;  /* of the newest push, merge, prune or import in the catalogue */

	/* Finished jobs, which are dropped when other work needs their memory. */
	struct core_history {
		void *ctx;
		uint64_t (*bytes)(void *ctx); /* of LEDGER_JOBS, that they hold */
		/* Drops one, of the user who has the most (`more` added to those of `uid`). False: there is none. */
		bool (*forget)(void *ctx, uint32_t uid, uint64_t more);
	} history;
	/* Bytes on the disk by user, of datasets and interrupted pushes. Called with LOCK_LIMITS held. */
	struct core_usage {
		void *ctx;
		void (*each)(void *ctx, core_usage_fn *add, void *to);
	} usage;

	struct core_private *priv; /* core_priv.h */
};

/* Opens the folders, and makes those that are missing. Reads the disk: before the loop runs. */
int core_new(const struct core_params *, struct core **ret, struct err *err);
struct core *core_free(struct core *); /* NULL is fine; returns NULL */
/* Submits the removal of what an earlier daemon left in the cache. After deferred_begin. */
void core_sweep_cache(struct core *);
/* Opens a folder, and makes it if it is missing. *ret_fd is the caller's. Any thread. */
int core_folder(int dirfd, const char *name, int *ret_fd, struct err *err);
/* cache/selected. Opened for each use, since somebody may empty the cache. *ret_fd is the caller's. Any thread. */
int core_selected_folder(const struct core *, int *ret_fd, struct err *err);
/* Submits a task that belongs to no job or push. Its `done` calls core_background_done. */
void core_background(struct core *, struct sched_task *);
void core_background_done(struct core *);

/* A holder of memory, for reports. */
struct core_holder {
	const char *kind; /* "job", "fetch" (a later stream of a job), "plan", "push", "connection" */
	uint64_t id;      /* of the job or push; a serial number for a connection; 0: none */
	struct peer peer;
	const char *dataset;         /* "": none; borrowed */
	uint64_t held[LEDGER_NAMES]; /* bytes by account */
};
/* Adds what a task holds to `held`. */
void core_task_held(const struct core *, const struct sched_task *, uint64_t held[LEDGER_NAMES]);

/* ---- charge.c: memory of datasets, jobs and pushes, in bytes of LEDGER_JOBS. Errors: -ERR_BUSY ---- */

/* For what ends by itself. `what` is a noun for the message. */
int charge(struct core *, uint64_t bytes, const char *what, struct err *err);
/* For what stays, of that user. Leaves a `kind`-th of the account to work that ends by itself. Drops finished jobs if necessary:
 * do not call it with one of them in hand, or in a loop over them. */
enum charge_lasting_kind { CHARGE_DATASET = 8, CHARGE_JOB = 16 };
int charge_lasting(struct core *, enum charge_lasting_kind kind, uint32_t uid, uint64_t bytes, const char *what, struct err *err);
void uncharge(struct core *, uint64_t bytes);
/* Drops finished jobs for the largest charge that was refused since the last call. True: refused work may try again. */
bool charge_reclaim(struct core *);
/* Bytes of a view with that text and so many areas, prepared for judging points. */
uint64_t charge_view_bytes(const char *text, unsigned areas);

/* ---- deferred.c: work of a start that may wait ---- */

void deferred_begin(struct core *);
/* Submits the task as core_background does, at once or when deferral ends. Its `done` calls deferred_done. */
void deferred_submit(struct core *, struct sched_task *);
void deferred_done(struct core *, const struct sched_task *);
/* Ends deferral if its time is over, or if there is work for clients. True: it has ended. */
bool deferred_tick(struct core *, bool client_work);
bool deferred_is_pending(const struct core *); /* deferral has not ended */
/* Ends deferral. Tasks that have not begun do not run. */
void deferred_cancel_all(struct core *);

/* ---- disk.c: the file systems, and the folders of the cache ---- */

/* Refreshes the figures of the file systems before they are reported. Waits 20 ms for the answer. */
void disk_query_now(struct core *);
/* Restores folders, queries the file systems, and measures or evicts the cache in the background. `active`: work goes on. */
void disk_tick(struct core *, bool active);
/* Makes removed folders of the cache again, under the same descriptors. Cheap if none is removed. */
void disk_restore_folders(struct core *);
void disk_stop(struct core *);              /* the daemon stops: ends the measuring of the cache */
bool disk_is_querying(const struct core *); /* a worker queries the file systems */

/* ---- limit.c: bytes on the disk of one user (user-disk) ---- */

/* Charges bytes to the user, beside those of core_usage. `what` is a noun for the message. Any thread. -ERR_LIMIT, with the
 * setting's name as field. */
int limit_disk_take(struct core *, uint32_t uid, bool admin, uint64_t bytes, const char *what, struct err *err);
void limit_disk_give(struct core *, uint32_t uid, uint64_t bytes); /* any thread */
struct limit_geoid {
	uint32_t uid;
	uint64_t bytes;
};
void limit_geoids(struct core *, const struct limit_geoid *all, size_t n); /* all grids that are stored; any thread */
void limit_recount(struct core *);                                         /* reads core_usage again */
/* Releases what two users have charged, and reads core_usage again, in one step. Negative: charges, beyond the limit. */
void limit_release_and_recount(struct core *, uint32_t uid, int64_t bytes, uint32_t other_uid, int64_t other_bytes);
/* What the user has, and may have on a file system of `state_bytes`. Both 0: there is no limit. */
void limit_disk_of(struct core *, uint32_t uid, uint64_t state_bytes, uint64_t *ret_has, uint64_t *ret_most);

/* ---- events and counts (core.c) ---- */

void tally_domain(struct core *, uint32_t triangles); /* a domain was triangulated */
/* Logs an event if `why` is ERR_CORRUPT: stored data is damaged. Any thread. */
void event_damage(const struct log_about *, const struct err *why);

/* ---- client_file.c: a descriptor that a client passed ---- */

/* Identifies a file, and shows whether it changed while it was read. */
struct client_file {
	uint64_t dev, ino, size;
	int64_t mtime_ns, ctime_ns;
};
/* The descriptor must be a regular file that can be read. `name` is for the message. Any thread. */
int client_file_check(int fd, const char *name, struct client_file *ret, struct err *err);

#endif
