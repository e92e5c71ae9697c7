/*
 * acutd --check-config: everything that a start finds out before it opens a folder, and an examination of the folders. Errors go
 * to stderr, one a line. If there are none, the configuration goes to stdout.
 */
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "config.h"
#include "config_report.h"
#include "err.h"
#include "parse.h"
#include "place.h"

enum { STATUS_WRONG = 2 };

void config_check_print(void *ctx, bool warning, const struct err *err)
{
	char text[1600];

	fprintf(stderr, "%s: %s\n", warning ? "warning" : "error", err_format(err, text, sizeof text));
}

/* The parent folder of the socket must exist. */
static void check_parent(const char *path, struct config_report *report)
{
	char folder[CONFIG_PATH_SIZE];
	struct err err = ERR_INIT;
	struct stat st;
	char *slash;

	snprintf(folder, sizeof folder, "%s", path);
	slash = strrchr(folder, '/');
	if (!slash || slash == folder)
		return;
	*slash = 0;
	if (stat(folder, &st) == 0 && S_ISDIR(st.st_mode))
		return;
	err_set(&err, ERR_USAGE, "the folder of the socket does not exist");
	err_add_file(&err, folder);
	err_add_hint(&err, "make it (RuntimeDirectory= of a unit does), or choose another socket");
	config_report_error(report, &err);
}

/* The first start of a service makes its store, if the configuration does not set the folder. */
static bool may_make_store(const struct config *c)
{
	struct stat st;

	if (c->init)
		return true;
	if (c->origin[CONFIG_state].by == CONFIG_BY_FILE || c->origin[CONFIG_state].by == CONFIG_BY_LINE)
		return false;
	return place_cache_unused(c->cache) || (stat(c->cache, &st) != 0 && errno == ENOENT);
}

static void check_folders(const struct config *c, struct config_report *report, bool *ret_new)
{
	struct err err = ERR_INIT;
	struct stat st;

	*ret_new = false;
	if (*c->state && place_state_check(c->state, &err)) {
		*ret_new = err.code == ERR_IO && may_make_store(c);
		if (!*ret_new)
			config_report_error(report, &err);
	}
	err_clear(&err);
	if (*c->cache && stat(c->cache, &st) == 0 && !S_ISDIR(st.st_mode)) {
		err_set(&err, ERR_USAGE, "the cache must be a folder, and this is none");
		err_add_file(&err, c->cache);
		err_add_hint(&err, "choose another cache");
		config_report_error(report, &err);
	}
	err_clear(&err);
	if (place_check_separate(c->state, c->cache, false, &err))
		config_report_error(report, &err);
	if (*c->socket)
		check_parent(c->socket, report);
}

int config_check(const struct config *c, struct config_report *report)
{
	bool new_store;

	check_folders(c, report, &new_store);
	if (report->errors == 1)
		config_check_print(NULL, false, &report->first);
	if (report->errors)
		return STATUS_WRONG;
	config_show(c, stdout);
	if (new_store)
		printf("\n%s is no store yet: the first start makes it.\n", c->state);
	if (*c->file)
		printf("\nFiles: %s, and *.conf in %s.d. The configuration has no errors.\n", c->file, c->file);
	else
		printf("\nNo files. The configuration has no errors.\n");
	return 0;
}
