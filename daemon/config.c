/*
 * The command line of acutd, and the defaults of what it leaves out.
 *
 * The memory rule: told, it is what was told (24 MiB at least). Not told: the smallest limit of the own
 * cgroup and its ancestors, less 48 MiB; where there is none, or for a private daemon (--idle-exit), the
 * lesser of that and a quarter of the machine, at most 2 GiB.
 */
#include "config.h"

#include <errno.h>
#include <getopt.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "err.h"
#include "parse.h"
#include "sched_pool.h"

static const uint64_t MEMORY_LEAST = UINT64_C(24) << 20, MEMORY_SPARE = UINT64_C(48) << 20,
		      MEMORY_DEFAULT_MOST = UINT64_C(2) << 30;
enum { THREADS_MAX = 256, DISK_PERCENT = 80, KEEP_FREE_PERCENT = 5, SPACE_WAIT = 60, KEEP_REMOVED_SECONDS = 7 * 86400 };

static const char help[] =
	"acutd: terrain meshes from points, out of core\n"
	"\n"
	"usage: acutd [--socket PATH] [OPTION...]\n"
	"\n"
	"  --socket PATH        listen here (default: the sockets that systemd hands over)\n"
	"  --state FOLDER       datasets and the catalogue (default: $STATE_DIRECTORY, as root "
	"/var/lib/acut,\n"
	"                       else $XDG_STATE_HOME/acut)\n"
	"  --cache FOLDER       what can be made again (default: $CACHE_DIRECTORY, as root /var/cache/acut,\n"
	"                       else $XDG_CACHE_HOME/acut)\n"
	"  --init               make a new store where the state folder is empty or absent\n"
	"  --init-first         for a service: make the store in $STATE_DIRECTORY at the very first start, which is\n"
	"                       when the cache folder has never served a store either\n"
	"  --memory SIZE        budget, as 256M or 4G, at least 24M (default: by cgroup and machine)\n"
	"  --threads N          workers (default: one a processor)\n"
	"  --disk SIZE|N%       what state and cache may hold together, as 200G or 80% of the file system\n"
	"                       (default: 80%)\n"
	"  --keep-free SIZE|N%  of the file system stays free (default: 5%)\n"
	"  --keep-removed TIME  a dataset that was removed can be restored for so long (default: 7d)\n"
	"  --space-wait SECONDS what a client waits for ends when it has lacked disk space for so long (default: 60)\n"
	"  --log-level LEVEL    error, warning, notice, info, debug (default: info)\n"
	"  --idle-exit SECONDS  end when nobody is connected and nothing is to be done for so long\n"
	"  --version, --help\n";

/* ---- memory ---- */

uint64_t config_memory(uint64_t limit, uint64_t machine, bool private)
{
	uint64_t quarter = machine / 4, mine;

	mine = limit == UINT64_MAX ? UINT64_MAX : limit > MEMORY_SPARE ? limit - MEMORY_SPARE : 0;
	if (limit != UINT64_MAX && !private)
		return mine;
	if (quarter > MEMORY_DEFAULT_MOST)
		quarter = MEMORY_DEFAULT_MOST;
	return quarter < mine ? quarter : mine;
}

static uint64_t limit_of(const char *path)
{
	uint64_t limit = UINT64_MAX;
	char line[64];
	FILE *f = fopen(path, "re");

	if (!f)
		return UINT64_MAX;
	if (fgets(line, sizeof line, f)) {
		line[strcspn(line, "\n")] = 0;
		/* "max", and what version 1 writes for none (the largest page-rounded number). */
		if (!parse_u64(line, &limit) || limit >= UINT64_C(1) << 62)
			limit = UINT64_MAX;
	}
	fclose(f);
	return limit;
}

/* The group's folder, then each above it. */
static uint64_t climb(const char *root, const char *mount, const char *group, const char *file)
{
	char at[1024], path[2048];
	uint64_t least = UINT64_MAX, limit;

	snprintf(at, sizeof at, "%s", group);
	for (;;) {
		char *slash;

		snprintf(path, sizeof path, "%s%s%s/%s", root, mount, strcmp(at, "/") ? at : "", file);
		limit = limit_of(path);
		if (limit < least)
			least = limit;
		slash = strrchr(at, '/');
		if (!slash || !at[0])
			return least;
		*slash = 0;
	}
}

/* A line of /proc/self/cgroup: "number:controllers:group". */
static uint64_t limit_of_line(const char *root, char *line)
{
	char *controllers = strchr(line, ':'), *group, *c, *save = NULL;

	line[strcspn(line, "\n")] = 0;
	if (!controllers || !(group = strchr(controllers + 1, ':')))
		return UINT64_MAX;
	*controllers++ = 0;
	*group++ = 0;
	if (!*controllers)
		return climb(root, "/sys/fs/cgroup", group, "memory.max");
	for (c = strtok_r(controllers, ",", &save); c; c = strtok_r(NULL, ",", &save))
		if (!strcmp(c, "memory"))
			return climb(root, "/sys/fs/cgroup/memory", group, "memory.limit_in_bytes");
	return UINT64_MAX;
}

uint64_t config_cgroup_limit(const char *root)
{
	char path[1024], line[1200];
	uint64_t least = UINT64_MAX;
	FILE *f;

	snprintf(path, sizeof path, "%s/proc/self/cgroup", root);
	f = fopen(path, "re");
	if (!f)
		return UINT64_MAX;
	while (fgets(line, sizeof line, f)) {
		uint64_t limit = limit_of_line(root, line);

		if (limit < least)
			least = limit;
	}
	fclose(f);
	return least;
}

static uint64_t machine_memory(void)
{
	long pages = sysconf(_SC_PHYS_PAGES), size = sysconf(_SC_PAGESIZE);

	return pages > 0 && size > 0 ? (uint64_t)pages * (uint64_t)size : UINT64_C(1) << 30;
}

/* ---- defaults ---- */

static unsigned processors(void)
{
	cpu_set_t set;

	if (sched_getaffinity(0, sizeof set, &set) != 0)
		return 1;
	return CPU_COUNT(&set) > THREADS_MAX ? THREADS_MAX : (unsigned)CPU_COUNT(&set);
}

static int default_folder(char *to, size_t size, const char *by_systemd, const char *system, const char *xdg,
			  const char *home_part, struct err *err)
{
	const char *dir = getenv(by_systemd), *home = getenv("HOME");

	if (dir && *dir) {
		snprintf(to, size, "%s", dir);
	} else if (geteuid() == 0) {
		snprintf(to, size, "%s", system);
	} else if ((dir = getenv(xdg)) && *dir == '/') {
		snprintf(to, size, "%s/acut", dir);
	} else if (home && *home == '/') {
		snprintf(to, size, "%s/%s/acut", home, home_part);
	} else {
		err_set(err, ERR_USAGE, "there is no home folder to keep data in");
		return err_add_hint(err, "give --state and --cache");
	}
	return 0;
}

/* A folder that nobody configured is the user's own: it is made when it is needed. */
static bool own_folder(void)
{
	const char *dir = getenv("STATE_DIRECTORY");

	return geteuid() != 0 && !(dir && *dir);
}

static int fill_in(struct config *c, struct err *err)
{
	char text[32];
	int r = 0;

	/* A folder that somebody chose is no first one. */
	if (*c->state || !getenv("STATE_DIRECTORY"))
		c->init_first = false;
	if (!*c->state && own_folder())
		c->init = true;
	if (!*c->state)
		r = default_folder(c->state, sizeof c->state, "STATE_DIRECTORY", "/var/lib/acut",
				   "XDG_STATE_HOME", ".local/state", err);
	if (!r && !*c->cache)
		r = default_folder(c->cache, sizeof c->cache, "CACHE_DIRECTORY", "/var/cache/acut",
				   "XDG_CACHE_HOME", ".cache", err);
	if (r)
		return r;
	if (!c->memory)
		c->memory = config_memory(config_cgroup_limit(""), machine_memory(), c->idle_exit > 0);
	if (c->memory < MEMORY_LEAST) {
		err_set(err, ERR_USAGE, "%s of memory are too little, acutd needs 24 MB at least",
			parse_size_text(c->memory, text));
		return err_add_hint(err, "give --memory, or the service a higher limit");
	}
	if (!c->disk.unit)
		c->disk = (struct space_limit){SPACE_PERCENT, DISK_PERCENT};
	if (!c->keep_free.unit)
		c->keep_free = (struct space_limit){SPACE_PERCENT, KEEP_FREE_PERCENT};
	/* Not told: no more than an eighth of the memory for their stacks. */
	if (!c->threads)
		for (c->threads = processors(); c->threads > 1 && sched_thread_bytes(c->threads) > c->memory / 8;)
			c->threads--;
	return 0;
}

/* ---- options ---- */

enum which { SOCKET = 1, STATE, CACHE, INIT, INIT_FIRST, MEMORY, THREADS, LOG_LEVEL, IDLE_EXIT, DISK, KEEP_FREE, SPACE_PATIENCE, KEEP_REMOVED, VERSION, HELP };

static const struct option options[] = {
	{"socket", required_argument, NULL, SOCKET},
	{"state", required_argument, NULL, STATE},
	{"cache", required_argument, NULL, CACHE},
	{"init", no_argument, NULL, INIT},
	{"init-first", no_argument, NULL, INIT_FIRST},
	{"memory", required_argument, NULL, MEMORY},
	{"threads", required_argument, NULL, THREADS},
	{"log-level", required_argument, NULL, LOG_LEVEL},
	{"idle-exit", required_argument, NULL, IDLE_EXIT},
	{"disk", required_argument, NULL, DISK},
	{"keep-free", required_argument, NULL, KEEP_FREE},
	{"space-wait", required_argument, NULL, SPACE_PATIENCE},
	{"keep-removed", required_argument, NULL, KEEP_REMOVED},
	{"version", no_argument, NULL, VERSION},
	{"help", no_argument, NULL, HELP},
	{0},
};

static int bad(const char *option, const char *value, const char *wanted, struct err *err)
{
	return err_set(err, ERR_USAGE, "--%s %.100s: %s is wanted", option, value, wanted);
}

static int set_folder(char *to, size_t size, const char *option, const char *value, struct err *err)
{
	if (!*value || strlen(value) >= size)
		return bad(option, value, "a folder", err);
	snprintf(to, size, "%s", value);
	return 0;
}

static int set_option(struct config *c, int option, const char *value, struct err *err)
{
	uint64_t n;

	switch (option) {
	case SOCKET:
		c->socket = value;
		return *value ? 0 : bad("socket", value, "a path", err);
	case STATE:
		return set_folder(c->state, sizeof c->state, "state", value, err);
	case CACHE:
		return set_folder(c->cache, sizeof c->cache, "cache", value, err);
	case INIT:
		c->init = true;
		return 0;
	case INIT_FIRST:
		c->init_first = true;
		return 0;
	case MEMORY:
		return parse_size(value, &c->memory) && c->memory
			       ? 0
			       : bad("memory", value, "a size as 256M", err);
	case THREADS:
		if (!parse_u64(value, &n) || !n || n > THREADS_MAX)
			return bad("threads", value, "a number from 1 to 256", err);
		c->threads = (unsigned)n;
		return 0;
	case LOG_LEVEL:
		return log_parse_level(value, &c->level)
			       ? 0
			       : bad("log-level", value, "error, warning, notice, info or debug", err);
	case IDLE_EXIT:
		return parse_seconds(value, &c->idle_exit) && c->idle_exit > 0
			       ? 0
			       : bad("idle-exit", value, "a time in seconds", err);
	case DISK:
		return space_limit_parse(value, 100, &c->disk) && c->disk.n
			       ? 0
			       : bad("disk", value, "a size as 200G, or a percentage from 1% to 100%,", err);
	case KEEP_FREE:
		return space_limit_parse(value, 99, &c->keep_free)
			       ? 0
			       : bad("keep-free", value, "a size as 10G, or a percentage from 0% to 99%,", err);
	case SPACE_PATIENCE:
		return parse_seconds(value, &c->space_wait) ? 0 : bad("space-wait", value, "a time in seconds", err);
	case KEEP_REMOVED:
		return parse_seconds(value, &c->keep_removed) && c->keep_removed > 0
			       ? 0
			       : bad("keep-removed", value, "a time as 7d", err);
	default:
		err_set(err, ERR_USAGE, "the command line is not understood");
		return err_add_hint(err, "acutd --help lists the options");
	}
}

int config_parse(int argc, char **argv, struct config *ret, int *ret_what, struct err *err)
{
	int option, r = 0;

	*ret = (struct config){.level = LOG_LEVEL_INFO, .space_wait = SPACE_WAIT, .keep_removed = KEEP_REMOVED_SECONDS};
	*ret_what = CONFIG_RUN;
	while (!r && (option = getopt_long(argc, argv, "", options, NULL)) != -1) {
		if (option == VERSION || option == HELP) {
			if (option == VERSION)
				printf("acutd %s\n", ACUT_VERSION);
			else
				fputs(help, stdout);
			*ret_what = CONFIG_EXIT;
			return 0;
		}
		r = set_option(ret, option, optarg, err);
	}
	if (!r && optind < argc)
		r = err_set(err, ERR_USAGE, "\"%.100s\" is not an option", argv[optind]);
	return r ? r : fill_in(ret, err);
}
