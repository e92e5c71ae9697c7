/*
 * What the rooms of the daemon share: the budget, the worker threads, the catalogue, the disk, the folders, and the parameters.
 *
 * The model: one `struct core` a daemon. A room above keeps its own state and a pointer to the core. All functions belong to the
 * loop thread unless they say otherwise. The core calls no room above it: what it must ask of one is a callback in `struct core`
 * that the room sets when it is made.
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

struct core_params {
	struct ledger *ledger;
	struct sched *sched;
	struct catalogue *catalogue; /* not started */
	int statefd, cachefd;        /* folders, borrowed */
	const uint8_t *store; /* 16 bytes, of the state's marker, borrowed: what tells this store from others; NULL: zeros */
	unsigned threads;     /* domains at once, at most */
	struct space_limit disk, keep_free; /* as space_params */
	double keep_removed;                /* seconds that a removed dataset can be restored; 0: 7 days */
	double space_wait;                  /* seconds that what a client waits for may lack space */
	double rest; /* seconds after the start in which nothing is swept or measured, if nobody begins anything; 0: none */
	struct user_limits {             /* of one user who is no admin; 0, SPACE_UNLIMITED: none */
		unsigned jobs;           /* that are not done */
		unsigned memory;         /* per cent that jobs, pushes and plans hold */
		unsigned datasets;       /* that he owns, removed ones too */
		struct space_limit disk; /* of datasets and pushes; per cent: of the file system of the state */
	} user;
	/* The cache's folder is gone: makes it again, and gives a descriptor of it. NULL: it stays gone. */
	int (*cache_again)(void *ctx, int *ret_fd, struct err *err);
	void *cache_ctx;
};

/* Work that was done since the start. */
struct tally {
	uint64_t points_staged, files_staged, bytes_read; /* of files that pushes have read whole */
	uint64_t triangles, domains_made, domains_reused;
	uint64_t merges, merged_bytes;
};

struct core {
	struct core_params p;
	struct tally tally;
	struct space *space;                      /* accounts of the disk; any thread */
	int datafd, onestepfd, domainsfd, tempfd, /* state/datasets, cache/one-step, cache/domains, cache/tmp */
		plansfd;                          /* state/plans */
	bool parking;                             /* the daemon stops: nothing new begins */
	bool loading;                             /* the catalogue is being read */
	unsigned background;                      /* tasks of the service itself: removal of folders, probes for info */
	uint64_t last_flow;                       /* number of the newest flow of tasks (struct sched_owner) */
	uint64_t last_push;                       /* of the newest push, merge, prune or import in the catalogue */

	/* Finished jobs give way to what needs memory now. */
	struct core_history {
		void *ctx;
		uint64_t (*bytes)(void *ctx); /* of LEDGER_JOBS, that they hold */
		/* One of them goes, of the user who has most (`more` counted with those of `uid`). False: there is none. */
		bool (*forget)(void *ctx, uint32_t uid, uint64_t more);
	} history;
	/* Bytes on the disk by user, from the lists of what was pushed; with LOCK_LIMITS held. */
	struct core_used {
		void *ctx;
		void (*each)(void *ctx, void (*add)(void *to, uint32_t uid, uint64_t bytes), void *to);
	} used;

	/* of charge.c */
	uint64_t lacks; /* bytes that charge did not have, the most at a time (charge_make_room) */
	/* of deferred.c */
	struct deferred {
		uint64_t from_ns;
		bool over;
		struct sched_task *task[2];
		unsigned n;
	} deferred;
	/* of disk.c */
	struct disk {
		bool begun, busy;
		struct sched_task ask; /* of the file systems, what they have */
		uint64_t asked_ns;     /* when it began last */
		bool asking;
	} disk;
	/* of limit.c */
	struct limits {
		struct lock lock;
		struct limit_row *row;
		size_t n, cap;
	} limits;
};

/* Opens the folders, and makes those that are missing. Reads the disk: before the loop runs. */
int core_new(const struct core_params *, struct core **ret, struct err *err);
struct core *core_free(struct core *); /* NULL is fine; returns NULL */
/* What an earlier daemon left in the cache goes, later. After deferred_begin. */
void core_clear(struct core *);
/* Opens a folder, and makes it if it is missing. Any thread. */
int core_folder(int dirfd, const char *name, int *ret_fd, struct err *err);
/* cache/selected; opened (and made) each time, since a cache may be emptied. Any thread. */
int core_selected_folder(const struct core *, int *ret_fd, struct err *err);
/* Submits a task of the service itself; core_background_over in its `done`. */
void core_background(struct core *, struct sched_task *);
void core_background_over(struct core *);
/* Who holds how much of the budget, by name. */
struct core_holder {
	const char *kind; /* "job", "fetch", "plan", "push" */
	uint64_t id;      /* of the job or push; 0: none */
	struct peer peer;
	const char *dataset; /* "": none */
	uint64_t held[LEDGER_NAMES];
};
/* Adds what a task holds of the budget, by name. */
void core_task_held(const struct core *, const struct sched_task *, uint64_t held[LEDGER_NAMES]);

/* ---- charge.c: memory of datasets, jobs and pushes, of LEDGER_JOBS ---- */

/* -ERR_BUSY. */
int charge(struct core *, uint64_t bytes, const char *what, struct err *err); /* for what ends by itself */
/* For what stays, of that user: leaves that part of all to what is below, and to the above. Finished jobs are forgotten for it,
 * of the user first who has most of them: not to be called where one of them is in hand, or the next in a loop over them. */
enum charge_lasting_kind { CHARGE_DATASET = 8, CHARGE_JOB = 16 };
int charge_lasting(struct core *, enum charge_lasting_kind, uint32_t uid, uint64_t bytes, const char *what, struct err *err);
/* Forgets finished jobs for what found no memory since the last time; true: whoever waits for it may try again. */
bool charge_make_room(struct core *);
void uncharge(struct core *, uint64_t bytes);
uint64_t charge_view_bytes(const char *text, unsigned areas); /* what a view of that text takes where points are judged by it */

/* ---- deferred.c: work after a start that can wait ---- */

void deferred_begin(struct core *);
/* Submits the task as core_background does, now or when the time for that is over. */
void deferred_submit(struct core *, struct sched_task *);
bool deferred_over(struct core *, bool active); /* active: somebody has begun something */
bool deferred_waits(const struct core *);       /* that time is not over */
void deferred_end(struct core *);
void deferred_drop(struct core *);

/* ---- disk.c: the file systems, and the folders of the cache ---- */

/* Before figures of the file systems are reported: those of now, if they answer at once. */
void disk_ask_now(struct core *);
void disk_look(struct core *, bool active); /* folders that are gone, and what there is to measure or evict */
void disk_mend(struct core *);              /* makes folders of the cache again that somebody has removed */

/* ---- limit.c: bytes on the disk of one user; -ERR_LIMIT, with the setting's name as field ---- */

/* Bytes more of that user on the disk, beside those of `used`; any thread. Balanced. */
int limit_disk_take(struct core *, uint32_t uid, bool admin, uint64_t bytes, const char *what, struct err *err);
void limit_disk_give(struct core *, uint32_t uid, uint64_t bytes);
struct limit_geoid {
	uint32_t uid;
	uint64_t bytes;
};
void limit_geoids(struct core *, const struct limit_geoid *all, size_t n); /* all that are kept; any thread */
void limit_count(struct core *);                                           /* asks `used` again */
/* The same, and two users give back what they took (negative: take it, whatever the limit), in one step. */
void limit_count_given(struct core *, uint32_t uid, int64_t bytes, uint32_t other, int64_t others);
/* What that user has, and may have at most on a file system of that size; both 0: there is no limit. */
void limit_disk_of(struct core *, uint32_t uid, uint64_t state_bytes, uint64_t *ret_has, uint64_t *ret_most);
int limit_refused(const char *setting, struct err *err); /* adds hint and place to an error that is set */

/* ---- core.c ---- */

void tally_domain(struct core *, uint32_t triangles); /* one was triangulated */
/* Reports that stored data is damaged, if `why` says so. */
void event_damage(const struct log_about *, const struct err *why);

/* ---- client_file.c: a descriptor that a client passed ---- */

/* What identifies a file while it is read. */
struct client_file {
	uint64_t dev, ino, size;
	int64_t mtime_ns, ctime_ns;
};
/* A regular file that can be read, or an error with `name`. Any thread. */
int client_file_check(int fd, const char *name, struct client_file *ret, struct err *err);

#endif
