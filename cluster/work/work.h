/*
 * The work folder of a cluster run: all that its tasks share.
 *
 * A task is a phase and an index. It runs on any node, and may run twice at once, if a node was given up that still lives; one
 * execution is an attempt, with a random number. So no file is locked, appended to, or found by listing a folder. An attempt
 * writes files under names with its number, fsyncs them, and names them in its record; the record counts when it has its name,
 * which link(2) gives to one attempt alone. The others remove their files. Files of other tasks are found by their records.
 *
 * File systems of clusters show a file late: what must be there is waited for (work_set_patience). format.md, "Work folders",
 * has the bytes. One thread at a time may use a work folder.
 */
#ifndef WORK_H
#define WORK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;
struct work;

/* In the order in which they run. */
enum work_phase {
	WORK_HEAD,
	WORK_STAGE,
	WORK_SORT,
	WORK_COMMIT,
	WORK_PLAN,
	WORK_MESH,
	WORK_SUM,
	WORK_GATHER,
	WORK_FINISH,
	WORK_PHASES
};
const char *work_phase_text(enum work_phase); /* "head" ... */
bool work_phase_parse(const char *text, enum work_phase *ret);

/* What is fixed when the run begins. */
struct work_about {
	uint64_t id;                 /* random, not 0; names the run's jobs */
	uint64_t memory;             /* bytes of a task */
	uint32_t tasks[WORK_PHASES]; /* how many; 0: the run has no such phase */
	const char *kernel;          /* the version of what makes the mesh; NULL: none is said */
	const char *const *word;     /* the words of the command, with all settings resolved */
	size_t nword;
};
struct work_input {
	const char *path; /* absolute; without zeros, that is all */
	uint64_t size;    /* bytes */
	int64_t mtime_ns; /* last change, ns since 1970 */
};

/* Makes the folder, which may exist and be empty, with everything in it: `about`, then the inputs (copied). -ERR_CONFLICT: it is
 * a work folder already, or has other files. After another failure it is as it was before. */
int work_make(const char *folder, const struct work_about *, const struct work_input *input, size_t ninput, struct work **ret,
	      struct err *err);
/* -ERR_NOTFOUND: it is no work folder, or none at all. */
int work_open(const char *folder, struct work **ret, struct err *err);
/* The same of a task: what another node has made just now may not be seen yet, and is waited for. */
int work_open_task(const char *folder, struct work **ret, struct err *err);
struct work *work_close(struct work *);                   /* NULL is fine; returns NULL */
const char *work_folder(const struct work *);             /* as it was given */
int work_fd(const struct work *);                         /* the folder, while it is open */
const struct work_about *work_about(const struct work *); /* valid until work_close */
/* Reads the inputs, in the order of the command. The array and its texts are one allocation, the caller's (free). */
int work_inputs(const struct work *, struct work_input **ret, size_t *ret_n, struct err *err);

/* Seconds for which a file that must be there is waited for; 120 unless set ($ACUT_CLUSTER_PATIENCE). */
void work_set_patience(struct work *, double seconds);
/* Asked while something is waited for, and by the phases between their steps: not 0 ends the task. */
void work_set_interrupt(struct work *, int (*interrupted)(void *ctx), void *ctx);
int work_interrupted(void *work); /* what it answers; 0: none was set */
/* -ERR_CANCELLED: it was interrupted. */
int work_check_interrupt(struct work *, struct err *err);
/* Waits a little, longer each time; false: the patience is over, or the work was interrupted. *waited: seconds so far, 0 at
 * first. */
bool work_wait(const struct work *, double *waited);
/* Opens a file of the folder for reading, which some task has written. `size`: its bytes, by its record; UINT64_MAX: unknown. A
 * file that is absent, stale or shorter is waited for. *ret_fd is the caller's. */
int work_file_open(const struct work *, const char *name, uint64_t size, int *ret_fd, struct err *err);

/* ---- attempts ---- */

enum { WORK_NAME = 96, WORK_FILES = 64 }; /* of the name of a file; files of an attempt */
struct work_attempt;

/* WORK_E_DONE: the task has a record. -ERR_CANCELLED: the run was cancelled. -ERR_USAGE: there is no such task. */
enum { WORK_E_DONE = 1 };
int work_begin(struct work *, enum work_phase, uint32_t task, struct work_attempt **ret, struct err *err);
/* Removes the files that were announced, unless they were published, or may have been. NULL is fine; returns NULL. */
struct work_attempt *work_end(struct work_attempt *);
uint64_t work_attempt_number(const struct work_attempt *);
/* "FOLDER/KIND-TASK-ATTEMPT", or without a folder (""), for a file of this attempt; folders exist: WORK_IN_DATASET, WORK_IN_MESH.
 * It must be created with O_EXCL. From now on work_end removes it; an absent one is fine. `suffix`: as ".seg", or "". */
#define WORK_IN_DATASET "dataset"
#define WORK_IN_MESH "mesh"
int work_attempt_file(struct work_attempt *, const char *folder, const char *kind, const char *suffix, char ret[WORK_NAME],
		      struct err *err);
/* The file, complete and fsynced, is a result: the record names it, with its size. In the order of these calls. */
int work_result_file(struct work_attempt *, const char *name, struct err *err);
/* A value of the record: key without spaces, a text of one line. */
int work_result(struct work_attempt *, const char *key, const char *text, struct err *err);
int work_result_u64(struct work_attempt *, const char *key, uint64_t value, struct err *err);
/* Writes the record, with host, time, CPU time and peak memory of this process. WORK_E_LOST: another attempt was first, and this
 * one's files are removed by work_end. */
enum { WORK_E_LOST = 2 };
int work_publish(struct work_attempt *, struct err *err);
/* Records why an attempt failed, for people; errors of that are ignored. `why` stays the caller's. */
void work_fail(struct work_attempt *, const struct err *why);
/* A task from beginning to end: begins an attempt, calls `make`, publishes, and records a failure (-ERR_CANCELLED is none, and
 * nothing else of a task that is interrupted). 0:
 * the record is this attempt's. WORK_E_DONE, WORK_E_LOST: it is another's, and `make` was not called, or was in vain; then its
 * error does not matter, either. */
typedef int (*work_make_fn)(void *ctx, struct work_attempt *, uint32_t task, struct err *err);
int work_run(struct work *, enum work_phase, uint32_t task, work_make_fn make, void *ctx, struct err *err);

/* ---- records ---- */

struct work_file {
	const char *name;
	uint64_t size;
};
struct work_value {
	const char *key, *text;
};
struct work_record {
	enum work_phase phase;
	uint32_t task;
	uint64_t attempt;
	const char *host;
	int64_t begun_us; /* since 1970 */
	double wall, cpu; /* seconds */
	uint64_t peak;    /* bytes */
	struct work_file *file;
	size_t nfile;
	struct work_value *value;
	size_t nvalue;
	char *text; /* holds all texts */
};
/* WORK_E_ABSENT: there is none now. */
enum { WORK_E_ABSENT = 3 };
int work_record_look(const struct work *, enum work_phase, uint32_t task, struct work_record **ret, struct err *err);
/* The same, of a task that this one depends on: waits for it. -ERR_NOTFOUND names it. */
int work_record_need(const struct work *, enum work_phase, uint32_t task, struct work_record **ret, struct err *err);
struct work_record *work_record_free(struct work_record *);                /* NULL is fine; returns NULL */
const char *work_record_text(const struct work_record *, const char *key); /* NULL: it has no such value */
/* -ERR_CORRUPT: it has no such value, or it is no number. */
int work_record_u64(const struct work_record *, const char *key, uint64_t *ret, struct err *err);

/* The task is to be done again: removes its record, if there is one. No task that depends on it should run. */
int work_forget(const struct work *, enum work_phase, uint32_t task, struct err *err);
/* A file that the record names is not there any more, or has another size. */
bool work_record_lost(const struct work *, const struct work_record *);

/* The last failure of a task that has no record; how many there were. */
struct work_failure {
	uint32_t times;
	int64_t at_us;
	char host[64], code[32];
	char message[1600];
};
/* WORK_E_ABSENT: none is recorded. */
int work_failure_look(const struct work *, enum work_phase, uint32_t task, struct work_failure *ret, struct err *err);

/* Nobody needs to know of it any more. */
int work_failure_forget(const struct work *, enum work_phase, uint32_t task, struct err *err);

/* ---- the run ---- */

/* No attempt begins from now on. */
int work_cancel(struct work *, struct err *err);
int work_uncancel(struct work *, struct err *err);
bool work_cancelled(const struct work *);
/* Removes all of the run and the folder itself; not what is listed in `keep` (names in the folder; a NULL ends it). A folder that
 * was named by a symbolic link stays, empty. -ERR_CONFLICT: it has other files, too; nothing is removed. No task may run any
 * more. Lists folders. */
int work_clean(struct work *, const char *const *keep, struct err *err);

#endif
