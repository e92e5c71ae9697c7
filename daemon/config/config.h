/*
 * What acutd was told: by its command line, by acutd.conf and the files beside it, or by nobody (then a default).
 * All settings stand in one table, config_table.def.
 */
#ifndef CONFIG_H
#define CONFIG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "log.h"
#include "space.h"

struct config_told;
struct err;

enum { CONFIG_PATH_SIZE = 512, CONFIG_GROUP_SIZE = 64 };

/* Numbers of the settings, in the table's order: CONFIG_socket, ... */
enum config_id {
#define SETTING(name, field, ...) CONFIG_##field,
#include "config_table.def"
	CONFIG_SETTINGS
};

/* Who said it. */
struct config_origin {
	enum { CONFIG_BY_DEFAULT, CONFIG_BY_ENVIRONMENT, CONFIG_BY_CGROUP, CONFIG_BY_FILE, CONFIG_BY_LINE } by;
	unsigned line;
	char file[CONFIG_PATH_SIZE];
};

struct config {
	char socket[CONFIG_PATH_SIZE]; /* "": handed over */
	char state[CONFIG_PATH_SIZE], cache[CONFIG_PATH_SIZE];
	bool init;       /* a new store may be made */
	bool init_first; /* --init-first, and the state folder is $STATE_DIRECTORY */
	uint64_t memory; /* resolved */
	unsigned threads;
	enum log_level level;
	double idle_exit; /* seconds; 0: never */
	struct space_limit disk, keep_free;
	double keep_removed; /* seconds that a removed dataset can be restored */
	double space_wait;   /* seconds that what a client waits for waits for room on the disk */

	/* Who may: names or numbers of groups, "": unset; and their numbers here, -1: unset. */
	char group[CONFIG_GROUP_SIZE], admin_group[CONFIG_GROUP_SIZE];
	int64_t group_gid, admin_group_gid;
	/* Of one user who is neither root, nor of the admin-group, nor the daemon's own. 0, SPACE_UNLIMITED: no limit. */
	unsigned user_jobs;           /* unfinished jobs */
	unsigned user_memory;         /* per cent of `memory` that the jobs hold */
	struct space_limit user_disk; /* data and pending pushes */
	unsigned user_datasets;       /* that he owns, removed ones too */
	unsigned user_connections;

	struct config_origin origin[CONFIG_SETTINGS];
	uint64_t cgroup_limit;       /* UINT64_MAX: none */
	char file[CONFIG_PATH_SIZE]; /* that is read, if it is there; "": none */
	int argc;                    /* of config_parse */
	char **argv;
};

/* CONFIG_EXIT: --help or --version was answered; CONFIG_CHECK: nothing is to be started. */
enum { CONFIG_RUN, CONFIG_EXIT, CONFIG_CHECK };
/*
 * Reads the command line, then the files, lets the first win, and finds out what nobody said. Errors and warnings go to
 * `told` as they come; err is what the whole fails with, -ERR_USAGE. The words are kept: config_again reads all again.
 */
int config_parse(int argc, char **argv, struct config *ret, int *ret_what, struct config_told *told, struct err *err);
/* The configuration as it would be if acutd were started now with the same words. */
int config_again(const struct config *, struct config *ret, struct config_told *told, struct err *err);
/* What --check-config says: what holds, on stdout, or all errors. Also looks at the folders, and writes nothing. Returns
 * the exit status. */
int config_check(const struct config *, struct config_told *told);
void config_check_tell(void *ctx, bool warning, const struct err *); /* config_told.tell of it */
void config_show(const struct config *, FILE *to);
/* "acutd.conf:3", "command line", "default", ... Returns buf, at least CONFIG_ORIGIN_SIZE bytes. */
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
	const char *preset_text; /* for people */
	enum config_scope scope;
	const char *argument; /* NULL: a flag */
	const char *help, *more;
};
extern const struct config_setting config_settings[CONFIG_SETTINGS];

/* From text; false: *ret_wanted says what is wanted instead, and nothing was changed. */
bool config_value_parse(const struct config_setting *, const char *text, struct config *to, const char **ret_wanted);
/* As it would be written in the file; "" where it is unset. Returns buf, at least CONFIG_PATH_SIZE bytes. */
char *config_value_text(const struct config_setting *, const struct config *, char *buf);
void config_value_copy(const struct config_setting *, const struct config *from, struct config *to);
bool config_value_equal(const struct config_setting *, const struct config *, const struct config *);

/* Nobody has said anything. */
void config_presets(struct config *ret);
/* Finds out what nobody said: folders, memory, threads, numbers of groups. */
void config_resolve(struct config *, struct config_told *);

/* What --help says. */
void config_help(FILE *to);

/* ---- memory ---- */

/* The memory for a daemon that was not told: `limit` is the smallest cgroup
 * limit (UINT64_MAX: none), `machine` its bytes of RAM. */
uint64_t config_memory(uint64_t limit, uint64_t machine, bool private);
/* The most that one that was told may have; UINT64_MAX: anything. */
uint64_t config_memory_most(uint64_t limit, bool private);
/* The smallest limit of this process's memory cgroup and its ancestors, version 1 and 2, under `root` ("" on
 * a real machine, a folder in tests). */
uint64_t config_cgroup_limit(const char *root);
uint64_t config_cgroup_tasks(const char *root); /* likewise, of tasks (pids.max) */
uint64_t config_machine_memory(void);

#endif
