/*
 * The configuration of a start: defaults, and over them what the command line says. config_table.def has the settings.
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

static const uint64_t MEMORY_LEAST = UINT64_C(24) << 20;
enum { THREADS_MAX = 256 };

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
		c->memory = config_memory(config_cgroup_limit(""), config_machine_memory(), c->idle_exit > 0);
	if (c->memory < MEMORY_LEAST) {
		err_set(err, ERR_USAGE, "%s of memory are too little, acutd needs 24 MB at least",
			parse_size_text(c->memory, text));
		return err_add_hint(err, "give --memory, or the service a higher limit");
	}
	/* Not told: no more than an eighth of the memory for their stacks. */
	if (!c->threads)
		for (c->threads = processors(); c->threads > 1 && sched_thread_bytes(c->threads) > c->memory / 8;)
			c->threads--;
	return 0;
}

/* ---- options ---- */

/* Numbers of what is no setting, after those. */
enum { OPTION_FILE = CONFIG_SETTINGS, OPTION_NO_FILE, OPTION_VERSION, OPTION_HELP, OPTIONS };

static void list_options(struct option *to)
{
	static const struct option more[] = {
		{"config", required_argument, NULL, OPTION_FILE},
		{"no-config", no_argument, NULL, OPTION_NO_FILE},
		{"version", no_argument, NULL, OPTION_VERSION},
		{"help", no_argument, NULL, OPTION_HELP},
		{0},
	};

	for (int i = 0; i < CONFIG_SETTINGS; i++) {
		const struct config_setting *s = &config_settings[i];

		to[i] = (struct option){s->name, s->argument ? required_argument : no_argument, NULL, i};
	}
	memcpy(to + CONFIG_SETTINGS, more, sizeof more);
}

static int set_option(struct config *c, int id, const char *value, struct err *err)
{
	const char *wanted;

	if (!config_value_parse(&config_settings[id], value, c, &wanted))
		return err_set(err, ERR_USAGE, "--%s %.100s: %s is wanted", config_settings[id].name, value, wanted);
	c->origin[id] = (struct config_origin){.by = CONFIG_BY_LINE};
	return 0;
}

static void set_presets(struct config *c)
{
	const char *wanted;

	*c = (struct config){.group_gid = -1, .admin_group_gid = -1};
	for (int i = 0; i < CONFIG_SETTINGS; i++)
		if (config_settings[i].preset)
			config_value_parse(&config_settings[i], config_settings[i].preset, c, &wanted);
}

int config_parse(int argc, char **argv, struct config *ret, int *ret_what, struct err *err)
{
	struct option options[OPTIONS + 1];
	int option, r = 0;

	list_options(options);
	set_presets(ret);
	*ret_what = CONFIG_RUN;
	optind = 0; /* from the start */
	while (!r && (option = getopt_long(argc, argv, "", options, NULL)) != -1) {
		if (option == OPTION_VERSION || option == OPTION_HELP) {
			if (option == OPTION_VERSION)
				printf("acutd %s\n", ACUT_VERSION);
			else
				config_help(stdout);
			*ret_what = CONFIG_EXIT;
			return 0;
		}
		if (option == OPTION_FILE || option == OPTION_NO_FILE)
			continue;
		if (option < 0 || option >= CONFIG_SETTINGS) {
			err_set(err, ERR_USAGE, "the command line is not understood");
			return err_add_hint(err, "acutd --help lists the options");
		}
		r = set_option(ret, option, optarg, err);
	}
	if (!r && optind < argc)
		r = err_set(err, ERR_USAGE, "\"%.100s\" is not an option", argv[optind]);
	return r ? r : fill_in(ret, err);
}
