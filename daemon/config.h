/* What acutd was told: options, folders, and the memory that it may use. */
#ifndef CONFIG_H
#define CONFIG_H

#include <stdbool.h>
#include <stdint.h>

#include "log.h"
#include "space.h"

struct err;

struct config {
	const char *socket; /* NULL: handed over */
	char state[512], cache[512];
	bool init;       /* a new store may be made */
	bool init_first; /* --init-first, and the state folder is $STATE_DIRECTORY */
	uint64_t memory; /* resolved */
	unsigned threads;
	enum log_level level;
	double idle_exit; /* seconds; 0: never */
	struct space_limit disk, keep_free;
	double keep_removed; /* seconds that a removed dataset can be restored */
	double space_wait; /* seconds that what a client waits for waits for room on the disk */
};

enum { CONFIG_RUN, CONFIG_EXIT }; /* CONFIG_EXIT: --help or --version was answered */
int config_parse(int argc, char **argv, struct config *ret, int *ret_what, struct err *err);

/* The memory for a daemon that was not told (DESIGN of the command line): `limit` is the smallest cgroup
 * limit (UINT64_MAX: none), `machine` its bytes of RAM. */
uint64_t config_memory(uint64_t limit, uint64_t machine, bool private);
/* The smallest limit of this process's memory cgroup and its ancestors, version 1 and 2, under `root` ("" on
 * a real machine, a folder in tests). */
uint64_t config_cgroup_limit(const char *root);

#endif
