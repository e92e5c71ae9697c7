/*
 * The memory rule. The default is the smallest limit of the process's control group and its ancestors, less 48 MiB. Without a
 * limit, and for a private daemon (--idle-exit), it is the smaller of that and a quarter of the machine, and at most 2 GiB. A
 * value that is set may be at most the limit less 48 MiB for a service (32 MiB that the process has beside its memory, and the
 * kernel's pipes of its clients), or less 32 MiB for a private daemon, which has one client.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "config.h"
#include "parse.h"

static const uint64_t MEMORY_SPARE = UINT64_C(48) << 20, MEMORY_PROCESS = UINT64_C(32) << 20,
		      MEMORY_DEFAULT_MOST = UINT64_C(2) << 30;

uint64_t config_memory(uint64_t limit, uint64_t machine, bool private)
{
	uint64_t quarter = machine / 4, by_limit;

	by_limit = limit == UINT64_MAX ? UINT64_MAX : limit > MEMORY_SPARE ? limit - MEMORY_SPARE : 0;
	if (limit != UINT64_MAX && !private)
		return by_limit;
	if (quarter > MEMORY_DEFAULT_MOST)
		quarter = MEMORY_DEFAULT_MOST;
	return quarter < by_limit ? quarter : by_limit;
}

uint64_t config_memory_most(uint64_t limit, bool private)
{
	uint64_t spare = private ? MEMORY_PROCESS : MEMORY_SPARE;

	return limit == UINT64_MAX ? UINT64_MAX : limit > spare ? limit - spare : 0;
}

static uint64_t read_limit(const char *path)
{
	uint64_t limit = UINT64_MAX;
	char line[64];
	FILE *f = fopen(path, "re");

	if (!f)
		return UINT64_MAX;
	if (fgets(line, sizeof line, f)) {
		line[strcspn(line, "\n")] = 0;
		/* No limit: "max", or in version 1 the largest page-rounded number. */
		if (!parse_u64(line, &limit) || limit >= UINT64_C(1) << 62)
			limit = UINT64_MAX;
	}
	fclose(f);
	return limit;
}

/* The smallest limit of a group and its ancestors. */
static uint64_t smallest_limit(const char *root, const char *mount, const char *group, const char *file)
{
	char at[1024], path[2048];
	uint64_t least = UINT64_MAX, limit;

	snprintf(at, sizeof at, "%s", group);
	for (;;) {
		char *slash;

		snprintf(path, sizeof path, "%s%s%s/%s", root, mount, strcmp(at, "/") ? at : "", file);
		limit = read_limit(path);
		if (limit < least)
			least = limit;
		slash = strrchr(at, '/');
		if (!slash || !at[0])
			return least;
		*slash = 0;
	}
}

/* A controller of version 1, and its files. */
struct controller {
	const char *name, *mount, *file, *file1;
};

/* A line of /proc/self/cgroup: "number:controllers:group". */
static uint64_t limit_of_line(const char *root, char *line, const struct controller *what)
{
	char *controllers = strchr(line, ':'), *group, *c, *save = NULL;

	line[strcspn(line, "\n")] = 0;
	if (!controllers || !(group = strchr(controllers + 1, ':')))
		return UINT64_MAX;
	*controllers++ = 0;
	*group++ = 0;
	if (!*controllers)
		return smallest_limit(root, "/sys/fs/cgroup", group, what->file);
	for (c = strtok_r(controllers, ",", &save); c; c = strtok_r(NULL, ",", &save))
		if (!strcmp(c, what->name))
			return smallest_limit(root, what->mount, group, what->file1);
	return UINT64_MAX;
}

static uint64_t cgroup_limit(const char *root, const struct controller *what)
{
	char path[1024], line[1200];
	uint64_t least = UINT64_MAX;
	FILE *f;

	snprintf(path, sizeof path, "%s/proc/self/cgroup", root);
	f = fopen(path, "re");
	if (!f)
		return UINT64_MAX;
	while (fgets(line, sizeof line, f)) {
		uint64_t limit = limit_of_line(root, line, what);

		if (limit < least)
			least = limit;
	}
	fclose(f);
	return least;
}

uint64_t config_cgroup_limit(const char *root)
{
	static const struct controller memory = {"memory", "/sys/fs/cgroup/memory", "memory.max", "memory.limit_in_bytes"};

	return cgroup_limit(root, &memory);
}

uint64_t config_cgroup_tasks(const char *root)
{
	static const struct controller pids = {"pids", "/sys/fs/cgroup/pids", "pids.max", "pids.max"};

	return cgroup_limit(root, &pids);
}

uint64_t config_machine_memory(void)
{
	long pages = sysconf(_SC_PHYS_PAGES), size = sysconf(_SC_PAGESIZE);

	return pages > 0 && size > 0 ? (uint64_t)pages * (uint64_t)size : UINT64_C(1) << 30;
}
