/*
 * The configuration of acutd: from the command line, from acutd.conf and the files beside it, or defaults. One table has all
 * settings, config_table.def. Functions may be called by any thread, but share nothing.
 */
#ifndef CONFIG_H
#define CONFIG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "log.h"
#include "space.h"

struct config_report;
struct err;

enum { CONFIG_PATH_SIZE = 512, CONFIG_GROUP_SIZE = 64 };

/* Numbers of the settings, in the table's order: CONFIG_socket, ... */
enum config_id {
#define SETTING(name, field, ...) CONFIG_##field,
#include "config_table.def"
	CONFIG_SETTINGS
};

/* Where a value comes from. */
struct config_origin {
	enum { CONFIG_BY_DEFAULT, CONFIG_BY_ENVIRONMENT, CONFIG_BY_CGROUP, CONFIG_BY_FILE, CONFIG_BY_LINE } by;
	unsigned line;
	char file[CONFIG_PATH_SIZE];
};

struct config {
	char socket[CONFIG_PATH_SIZE]; /* "": the service manager passes sockets */
	char state[CONFIG_PATH_SIZE], cache[CONFIG_PATH_SIZE];
	bool init;       /* a new store may be made */
	bool init_first; /* --init-first, and the state folder is $STATE_DIRECTORY */
	uint64_t memory; /* bytes; found out if it is not set */
	unsigned threads;
	enum log_level level;
	double idle_exit; /* seconds; 0: never */
	struct space_limit disk, keep_free;
	double keep_removed; /* seconds that a removed dataset can be restored */
	double space_wait;   /* seconds that work for a waiting client waits for disk space */

	/* Names or numbers of groups, "": unset; and their numbers, -1: unset. */
	char group[CONFIG_GROUP_SIZE], admin_group[CONFIG_GROUP_SIZE];
	int64_t group_gid, admin_group_gid;
	/* Limits of each user who is not an administrator. 0, SPACE_UNLIMITED: no limit. */
	unsigned user_jobs;           /* unfinished jobs */
	unsigned user_memory;         /* per cent of `memory`, for jobs, pushes and plans */
	struct space_limit user_disk; /* data and pending pushes */
	unsigned user_datasets;       /* owned by the user, removed ones included */
	unsigned user_connections;

	struct config_origin origin[CONFIG_SETTINGS];
	uint64_t cgroup_limit;       /* UINT64_MAX: none */
	char file[CONFIG_PATH_SIZE]; /* read if it exists; "": none */
	int argc;                    /* of config_parse, borrowed */
	char **argv;
};

/* CONFIG_EXIT: --help or --version was printed. CONFIG_CHECK: call config_check, and start nothing. */
enum { CONFIG_RUN, CONFIG_EXIT, CONFIG_CHECK };
/*
 * Reads the command line and the files; the command line wins. Then finds out the values that are not set. Errors and warnings
 * go to the report; err has the error that the start fails with, -ERR_USAGE. Keeps argv for config_again.
 */
int config_parse(int argc, char **argv, struct config *ret, int *ret_what, struct config_report *report, struct err *err);
/* The configuration of a start now with the same command line. */
int config_again(const struct config *, struct config *ret, struct config_report *report, struct err *err);
/* --check-config: prints the configuration to stdout, or its errors to stderr. Examines the folders, and writes nothing. Returns
 * the exit status. */
int config_check(const struct config *, struct config_report *report);
void config_check_print(void *ctx, bool warning, const struct err *); /* for config_report.emit: prints to stderr */
void config_show(const struct config *, FILE *to);
/* "acutd.conf:3", "command line", "default", ... buf: at least CONFIG_ORIGIN_SIZE bytes. Returns buf. */
enum { CONFIG_ORIGIN_SIZE = CONFIG_PATH_SIZE + 16 };
char *config_origin_text(const struct config *, enum config_id, char *buf);

/* ---- the table ---- */

enum config_type {
	CONFIG_TYPE_PATH,    /* char[CONFIG_PATH_SIZE] */
	CONFIG_TYPE_GROUP,   /* char[CONFIG_GROUP_SIZE] */
	CONFIG_TYPE_FLAG,    /* bool */
	CONFIG_TYPE_SIZE,    /* uint64_t */
	CONFIG_TYPE_COUNT,   /* unsigned */
	CONFIG_TYPE_PERCENT, /* unsigned */
	CONFIG_TYPE_SECONDS, /* double */
	CONFIG_TYPE_LIMIT,   /* struct space_limit */
	CONFIG_TYPE_LEVEL,   /* enum log_level */
};
enum config_scope { CONFIG_RELOAD, CONFIG_RESTART, CONFIG_LINE };

struct config_setting {
	const char *name;
	enum config_type type;
	size_t offset; /* in struct config */
	uint64_t least, most;
	const char *unit;
	const char *preset;      /* NULL: none, or found out at the start */
	const char *preset_text; /* in words, if there is no preset */
	enum config_scope scope;
	const char *argument; /* NULL: a flag */
	const char *help, *more;
};
extern const struct config_setting config_settings[CONFIG_SETTINGS];

/* From a text. False: *ret_wanted says what is expected, and nothing is changed. */
bool config_value_parse(const struct config_setting *, const char *text, struct config *to, const char **ret_wanted);
/* As it would be written in the file; "": unset. buf: at least CONFIG_PATH_SIZE bytes. Returns buf. */
char *config_value_text(const struct config_setting *, const struct config *, char *buf);
void config_value_copy(const struct config_setting *, const struct config *from, struct config *to);
bool config_value_equal(const struct config_setting *, const struct config *, const struct config *);

/* All settings at their presets. */
void config_presets(struct config *ret);
/* Finds out what is not set: folders, memory, threads, numbers of groups. */
void config_resolve(struct config *, struct config_report *);

/* --help. */
void config_help(FILE *to);

/* ---- memory ---- */

/* The default of `memory`, in bytes. limit: the smallest limit of the control groups, UINT64_MAX: none. machine: bytes of RAM.
 * private: a daemon with one client (--idle-exit). */
uint64_t config_memory(uint64_t limit, uint64_t machine, bool private);
/* The most that `memory` may be set to; UINT64_MAX: anything. */
uint64_t config_memory_most(uint64_t limit, bool private);
/* The smallest memory limit of this process's control group and its ancestors, version 1 and 2. UINT64_MAX: none. root: "" on a
 * real machine, a folder in tests. */
uint64_t config_cgroup_limit(const char *root);
uint64_t config_cgroup_tasks(const char *root); /* likewise of tasks (pids.max) */
uint64_t config_machine_memory(void);

#endif
