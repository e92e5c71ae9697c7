/* For the files of this room. */
#ifndef DISPATCH_PRIV_H
#define DISPATCH_PRIV_H

#include <stdio.h>

#include "dispatch.h"

struct err;

/* Of a task: what its phase has, and more if it has failed with less. */
struct dispatch_need {
	uint64_t memory;
	double time;
};

struct dispatch_scheduler {
	const char *name;
	/* NULL: nothing to do. */
	int (*check)(const char *work, const char *script, struct err *); /* whether it can be used here */
	int (*begin)(struct dispatch *, struct err *);
	void (*end)(struct dispatch *);
	/* Sets state, why and job of tasks; all are DISPATCH_ABSENT before. */
	int (*look)(struct dispatch *, struct err *);
	/* Submits tasks of a phase that need the same, `n` of them, sorted. Sets job, and the state to DISPATCH_WAITING. */
	int (*submit)(struct dispatch *, unsigned phase, const uint32_t *index, uint32_t n, const struct dispatch_need *,
		      struct err *);
	int (*submitted)(struct dispatch *, struct err *); /* after the last phase of a turn */
	void (*pause)(struct dispatch *);
	int (*cancel)(struct dispatch *, uint32_t *ret_n, struct err *);
	void (*troubles)(struct dispatch *, void (*each)(void *, const char *, const char *), void *ctx);
	/* Of the log of a task, in the folder log. */
	void (*log_name)(const struct dispatch *, unsigned phase, uint32_t index, char buf[96]);
	bool late;       /* tasks run on other machines: their records may become visible here later than their end */
	bool never_lost; /* what is absent is still to come: it is submitted once, by the user */
};
extern const struct dispatch_scheduler dispatch_slurm, dispatch_local, dispatch_script;

struct dispatch {
	const struct dispatch_scheduler *on;
	struct dispatch_options o;
	struct dispatch_phase phase[DISPATCH_PHASES];
	struct dispatch_task *task[DISPATCH_PHASES];
	struct dispatch_reason reason[DISPATCH_REASONS];
	size_t nreason;
	bool submitted; /* by this process */
	uint64_t begun_ns;
	void *own; /* of the scheduler */
};

void dispatch_note(struct dispatch *, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
bool dispatch_phase_done(const struct dispatch *, unsigned phase); /* all its tasks */
/* The path, made absolute, has that byte. */
bool dispatch_path_has(const char *path, char byte);
void dispatch_reason_count(struct dispatch *, const char *text);
/* Waits so long, or until options.stop says so. */
void dispatch_sleep(struct dispatch *, double seconds);

/* Runs a command until it ends; `input` goes to its standard input (NULL: nothing). *ret_out: what it printed, to be freed; NULL:
 * not wanted. -ERR_NODAEMON: there is no such program. -ERR_BUSY: it takes longer than `seconds`. -ERR_IO: it fails; the message
 * is what it said on standard error. */
int dispatch_command(const char *const *argv, const char *input, double seconds, char **ret_out, struct err *err);

/* ---- text of Slurm ---- */

/* "3,7,9-12" of sorted numbers less `offset`, up to `size` bytes with the zero. How many of them. */
uint32_t dispatch_ranges(const uint32_t *index, uint32_t n, uint32_t offset, char *buf, size_t size);
/* A row of squeue. False: it is none of ours. */
struct dispatch_row {
	unsigned phase;
	uint32_t job;
	enum dispatch_state state;
	enum dispatch_why why;
	const char *reason; /* in the row, which is changed */
	const char *list;   /* what is left of its indices */
	uint64_t offset;
};
bool dispatch_row_read(const struct dispatch *, char *row, struct dispatch_row *ret);
/* The next run of its tasks: a row has several where Slurm has not divided an array yet. False: there are no more. */
bool dispatch_row_next(const struct dispatch *, struct dispatch_row *, uint32_t *ret_from, uint32_t *ret_to);
/* The number behind "NAME = " in the answer of `scontrol show config`. False: there is none. */
bool dispatch_config_number(const char *text, const char *name, uint64_t *ret);
/* The number of a job that `sbatch --parsable` has printed. False: it is none. */
bool dispatch_job_read(const char *text, uint32_t *ret);
/* A path as a pattern of sbatch, in which % is written twice. */
void dispatch_pattern(const char *path, char *buf, size_t size);
/* `text` as one word of a shell, quoted; to `to`. */
void dispatch_quote(FILE *to, const char *text);

/* What sbatch has said: its controller did not answer, so the job may be there or not; the user may not have more tasks. */
bool dispatch_is_no_answer(const struct err *);
bool dispatch_is_full(const struct err *);
void dispatch_clear_environment(void);

/* ---- logs ---- */

void dispatch_log_parse(const char *text, size_t n, struct dispatch_log *ret);

#endif
