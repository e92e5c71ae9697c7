/*
 * acut-cluster and acut-task: what their files share. One file a command or two, a row in cluster_command.c; options are rows of
 * cluster_option.c. A command returns the exit status.
 *
 * A run is what its work folder says: the words of the command with all settings resolved. Every later command, and every task,
 * reads them with the same tables as the first one did (cluster_run_open).
 */
#ifndef CLUSTER_H
#define CLUSTER_H

#include <limits.h>

#include "ctl_fetch.h"
#include "ctl_stage.h"
#include "ctl_view.h"
#include "dispatch.h"
#include "work.h"

/* Options of acut-cluster alone. Texts are NULL, numbers 0 if not given. */
struct cluster_options {
	const char *work, *on, *script, *directory, *config, *scratch;
	const char *partition, *account, *qos;
	struct cli_texts sbatch;
	uint64_t task_memory, task_points, max_tasks, attempts;
	double task_seconds, time;
	bool sort, wait, force, keep_dataset, no_config;
};

struct program {
	struct session session; /* of no daemon: console, signals, --timeout */
	struct ctl_input_options input;
	struct ctl_stage_options stage;
	struct ctl_view_options view;
	struct ctl_fetch_options fetch;
	struct cluster_options opt;
	struct cli_line line;
	int argc;
	char **argv;
};

/* Which options a command takes. */
enum cluster_group {
	CLUSTER_INPUT = 2,      /* inputs, and what is said of them: mesh, stage, plan */
	CLUSTER_VIEW = 4,       /* which points, and what is written: mesh, plan */
	CLUSTER_RUN = 8,        /* sizes of tasks: mesh, stage, plan */
	CLUSTER_SCHEDULER = 16, /* what the scheduler is told: mesh, stage, plan, resume */
	CLUSTER_NEW = 32,       /* makes a work folder: mesh, stage */
	CLUSTER_WAIT = 64,      /* may wait: mesh, stage, resume */
	CLUSTER_CLEAN = 128,
	CLUSTER_SCRIPT = 256, /* writes a script: mesh, stage, resume */
};

struct cli cluster_cli(void);
extern const struct cli_option cluster_options[];
extern const size_t cluster_noptions;
bool cluster_offer(struct cli_typed *, const char *kind, size_t n);

/* ---- settings ---- */

/* What cluster.conf sets, as texts; NULL: nothing. */
enum cluster_setting {
	CLUSTER_SCHEDULER_NAME,
	CLUSTER_PARTITION,
	CLUSTER_ACCOUNT,
	CLUSTER_QOS,
	CLUSTER_TIME,
	CLUSTER_TASK_SECONDS,
	CLUSTER_TASK_MEMORY,
	CLUSTER_MAX_TASKS,
	CLUSTER_ATTEMPTS,
	CLUSTER_SCRATCH,
	CLUSTER_SBATCH,
	CLUSTER_SETTINGS
};
struct cluster_settings {
	char *text[CLUSTER_SETTINGS];
};
const char *cluster_setting_name(size_t id);
/* Reads the file of --config, or the installation's, and the folder beside it. Prints its warnings. */
int cluster_settings_read(struct program *, struct cluster_settings *ret, struct err *err);
/* A text of a file, as config_text of acutd: for tests. */
int cluster_settings_text(struct program *, const char *text, size_t n, struct cluster_settings *ret, struct err *err);
void cluster_settings_done(struct cluster_settings *);

/* ---- a command and its words ---- */

/* The words of this command without its inputs, with what the settings add; a NULL at the end. To be freed with
 * cluster_words_free. */
int cluster_words(const struct program *, const struct cluster_settings *, char ***ret, size_t *ret_n, struct err *err);
void cluster_words_free(char **);
/* Reads words as a command line. The texts stay in use. */
int cluster_words_parse(const char *const *word, size_t n, struct program *ret, struct err *err);

/* ---- how large ---- */

struct cluster_size {
	uint64_t inputs, bytes, points; /* points: by the sizes of files, about */
	uint32_t tasks[WORK_PHASES];
	uint64_t memory[WORK_PHASES]; /* a task */
	double hours[WORK_PHASES];    /* of a core, about */
	double time[WORK_PHASES];     /* seconds after which a task is ended */
	double core_hours;
};
/* Of the run that these options describe. `stage`: only up to the dataset. -ERR_LIMIT: a task needs more memory. */
int cluster_size_of(const struct program *, bool stage, const struct work_input *, size_t n, struct cluster_size *ret,
		    struct err *err);

/* ---- a run ---- */

struct cluster_run {
	struct program *program; /* the command that opened it, for its console and signals */
	struct program own;      /* the command that began it, with the scheduler's options of this one */
	struct cli_line line;    /* of `own` */
	char *words;
	struct work *work;
	char *folder; /* of it, absolute */
	char id[20];
	uid_t owner; /* of the run: who may submit it, and whose jobs are its */
	struct work_input *input;
	size_t ninput;
	struct cluster_size size;
	struct dispatch *dispatch;
	char task[PATH_MAX], script[PATH_MAX]; /* the program of its tasks; the file of --on script */
	enum work_phase phase[WORK_PHASES];    /* of the phases that it has, in order */
	unsigned nphase;
	bool submits; /* CLUSTER_SUBMITS */
	uint64_t begun_ns;
};
/* Numbers that are too large. -ERR_USAGE. */
int cluster_limits(const struct cluster_options *, struct err *err);
/* Opens a work folder. `script`: the file that the scheduler "script" writes, "": that in the folder; NULL: none. */
enum cluster_open { CLUSTER_LOOKS, CLUSTER_SUBMITS };
int cluster_run_open(struct program *, const char *folder, enum cluster_open, const char *script, struct cluster_run *ret,
		     struct err *err);
void cluster_run_close(struct cluster_run *);
/* Submits what is missing, and waits if the command shall, or if nothing else would run the tasks. Exit status. */
int cluster_run_go(struct cluster_run *);
/* Waits until it is done. Exit status. */
int cluster_run_wait(struct cluster_run *);
/* Says that it was cancelled. Exit status. */
int cluster_run_cancelled(struct cluster_run *);
bool cluster_run_done(const struct cluster_run *);

/* cluster_report.c: at the end, its warnings and what its last phase has reported, for people or as JSON. */
void cluster_run_result(const struct cluster_run *);
/* The same in parts, of a run that may not be done: warnings on standard error, the report, and both as members of an object. */
void cluster_run_warn(const struct cluster_run *);
void cluster_run_report_text(const struct cluster_run *);
void cluster_run_report_json(const struct cluster_run *, struct term_json *);

/* What there is to say of a run. */
struct cluster_again {
	enum dispatch_why why;
	char host[64];
	uint32_t tasks;
};
enum { CLUSTER_AGAIN = 6 };
struct cluster_phase_state {
	const char *name;
	uint32_t tasks;
	struct dispatch_counts counts;
	uint32_t again, nagain;
	struct cluster_again why[CLUSTER_AGAIN];
	double cpu, wall; /* seconds, of the tasks that are done */
	uint64_t peak;
};
void cluster_phase_state(const struct cluster_run *, unsigned phase, struct cluster_phase_state *ret);

/* ---- for acut-task ---- */

/* Runs a task here. -ERR_*; 0: it has its record. */
int task_run(struct program *, struct work *, enum work_phase, uint32_t index, struct err *err);

#define CLUSTER_COMMAND(name) int cluster_##name##_run(struct program *);
CLUSTER_COMMAND(cancel)
CLUSTER_COMMAND(clean)
CLUSTER_COMMAND(mesh)
CLUSTER_COMMAND(plan)
CLUSTER_COMMAND(resume)
CLUSTER_COMMAND(show)
CLUSTER_COMMAND(stage)
CLUSTER_COMMAND(version)
CLUSTER_COMMAND(wait)
#undef CLUSTER_COMMAND

#endif
