/*
 * Values that are not set: folders, memory, threads; and the numbers of groups. Errors are reported with the place where the
 * setting is set.
 */
#include <errno.h>
#include <grp.h>
#include <sched.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "config.h"
#include "config_report.h"
#include "err.h"
#include "parse.h"
#include "sched_pool.h"

static const uint64_t MEMORY_LEAST = UINT64_C(24) << 20;
enum { THREADS_MAX = 256, GROUP_BUFFER = 64 << 10 };

/* Reports an error about a setting, with file and line if it comes from a file. */
__attribute__((format(printf, 5, 6))) static void report_error(const struct config *c, struct config_report *report,
							       enum config_id id, const char *hint, const char *fmt, ...)
{
	const struct config_origin *o = &c->origin[id];
	struct err err = ERR_INIT;
	char place[CONFIG_ORIGIN_SIZE], text[sizeof err.message];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(text, sizeof text, fmt, ap);
	va_end(ap);
	err_set(&err, ERR_USAGE, "%s", text);
	if (o->by == CONFIG_BY_FILE)
		err_add_file(&err, config_origin_text(c, id, place));
	err_add_hint(&err, "%s", hint);
	config_report_error(report, &err);
}

/* ---- folders ---- */

static bool default_folder(char *to, const char *by_systemd, const char *system, const char *xdg, const char *home_part,
			   struct config_origin *origin)
{
	const char *dir = getenv(by_systemd), *home = getenv("HOME");
	const size_t size = CONFIG_PATH_SIZE;

	*origin = (struct config_origin){.by = CONFIG_BY_DEFAULT};
	if (dir && *dir) {
		origin->by = CONFIG_BY_ENVIRONMENT;
		snprintf(to, size, "%s", dir);
	} else if (geteuid() == 0) {
		snprintf(to, size, "%s", system);
	} else if ((dir = getenv(xdg)) && *dir == '/') {
		snprintf(to, size, "%s/acut", dir);
	} else if (home && *home == '/') {
		snprintf(to, size, "%s/%s/acut", home, home_part);
	} else {
		return false;
	}
	return true;
}

/* The default folder is the user's own: it is made when it is needed. */
static bool is_own_folder(void)
{
	const char *dir = getenv("STATE_DIRECTORY");

	return geteuid() != 0 && !(dir && *dir);
}

static void resolve_folders(struct config *c, struct config_report *report)
{
	/* --init-first is only for the default folder of a service. */
	if (*c->state || !getenv("STATE_DIRECTORY"))
		c->init_first = false;
	if (!*c->state && is_own_folder())
		c->init = true;
	if (!*c->state && !default_folder(c->state, "STATE_DIRECTORY", "/var/lib/acut", "XDG_STATE_HOME", ".local/state",
					  &c->origin[CONFIG_state]))
		report_error(c, report, CONFIG_state, "give --state", "there is no home folder to keep data in");
	if (!*c->cache &&
	    !default_folder(c->cache, "CACHE_DIRECTORY", "/var/cache/acut", "XDG_CACHE_HOME", ".cache", &c->origin[CONFIG_cache]))
		report_error(c, report, CONFIG_cache, "give --cache", "there is no home folder for the cache");
}

/* ---- memory and threads ---- */

static void resolve_memory(struct config *c, struct config_report *report)
{
	bool is_set = c->memory, private = c->idle_exit > 0;
	uint64_t most;
	char text[32], limit[32], left[32];

	c->cgroup_limit = config_cgroup_limit("");
	most = config_memory_most(c->cgroup_limit, private);
	if (!is_set) {
		c->memory = config_memory(c->cgroup_limit, config_machine_memory(), private);
		c->origin[CONFIG_memory].by =
			c->memory == config_memory_most(c->cgroup_limit, false) ? CONFIG_BY_CGROUP : CONFIG_BY_DEFAULT;
	}
	if (c->memory < MEMORY_LEAST)
		report_error(c, report, CONFIG_memory, "set memory, or give the service a higher limit",
			     "%s of memory are too little, acutd needs 24 MB at least", parse_size_text(c->memory, text));
	else if (is_set && c->memory > most)
		report_error(c, report, CONFIG_memory,
			     private ? "give less --memory, or the control group a higher limit" :
				       "do not set memory, only the limit (MemoryMax= of the unit): acutd takes what it leaves",
			     "memory is %s, but the control group has a limit of %s, which leaves %s",
			     parse_size_text(c->memory, text), parse_size_text(c->cgroup_limit, limit),
			     parse_size_text(most, left));
}

static unsigned count_processors(void)
{
	cpu_set_t set;

	if (sched_getaffinity(0, sizeof set, &set) != 0)
		return 1;
	return CPU_COUNT(&set) > THREADS_MAX ? THREADS_MAX : (unsigned)CPU_COUNT(&set);
}

static void resolve_threads(struct config *c, struct config_report *report)
{
	char need[32], have[32], hint[96];
	uint64_t stacks;

	/* The default: their stacks take no more than an eighth of the memory. */
	if (!c->threads)
		for (c->threads = count_processors(); c->threads > 1 && sched_thread_bytes(c->threads) > c->memory / 8;)
			c->threads--;
	stacks = sched_thread_bytes(c->threads + 1); /* with the catalogue's thread */
	if (c->memory < MEMORY_LEAST || stacks <= c->memory / 4)
		return;
	snprintf(hint, sizeof hint, "give fewer threads, or memory = %s", parse_size_text(4 * stacks, need));
	report_error(c, report, CONFIG_threads, hint, "%u threads take %s of stacks, more than a quarter of the memory, %s",
		     c->threads, parse_size_text(stacks, need), parse_size_text(c->memory, have));
}

/* ---- groups ---- */

static void resolve_group(struct config *c, enum config_id id, const char *name, int64_t *gid, struct config_report *report)
{
	struct group group, *found = NULL;
	char *buffer, hint[160];
	uint64_t number;
	int r;

	*gid = -1;
	if (!*name)
		return;
	buffer = malloc(GROUP_BUFFER);
	r = buffer ? getgrnam_r(name, &group, buffer, GROUP_BUFFER, &found) : ENOMEM;
	if (found)
		*gid = group.gr_gid;
	else if (parse_u64(name, &number) && number < UINT32_MAX)
		*gid = (int64_t)number;
	free(buffer);
	if (*gid >= 0)
		return;
	snprintf(hint, sizeof hint, "make it (groupadd --system %.64s, or systemd-sysusers), or set %s to one that is there",
		 name, config_settings[id].name);
	if (r && r != ENOENT && r != ESRCH)
		report_error(c, report, id, "getent group tells whether groups can be read", "group %s cannot be looked up: %s",
			     name, strerror(r));
	else
		report_error(c, report, id, hint, "there is no group %s", name);
}

void config_resolve(struct config *c, struct config_report *report)
{
	resolve_folders(c, report);
	resolve_memory(c, report);
	resolve_threads(c, report);
	resolve_group(c, CONFIG_group, c->group, &c->group_gid, report);
	resolve_group(c, CONFIG_admin_group, c->admin_group, &c->admin_group_gid, report);
}
