/*
 * acutd --check-config: everything that a start would find out before it touches a folder, and a look at the folders.
 * Errors go to stderr, one a line; without any, what holds goes to stdout.
 */
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "config.h"
#include "config_told.h"
#include "err.h"
#include "parse.h"
#include "place.h"

enum { STATUS_WRONG = 2 };

void config_check_tell(void *ctx, bool warning, const struct err *err)
{
	char text[1600];

	fprintf(stderr, "%s: %s\n", warning ? "warning" : "error", err_format(err, text, sizeof text));
}

/* The folder where something is to be made must be there. */
static void look_parent(const char *path, struct config_told *told)
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
	err_set(&err, ERR_USAGE, "the folder of the socket is not there");
	err_add_file(&err, folder);
	err_add_hint(&err, "make it (RuntimeDirectory= of a unit does), or choose another socket");
	config_told_error(told, &err);
}

/* The first start of a service makes its store, where nobody chose a folder. */
static bool may_be_made(const struct config *c)
{
	struct stat st;

	if (c->init)
		return true;
	if (c->origin[CONFIG_state].by == CONFIG_BY_FILE || c->origin[CONFIG_state].by == CONFIG_BY_LINE)
		return false;
	return place_cache_unused(c->cache) || (stat(c->cache, &st) != 0 && errno == ENOENT);
}

static void look_folders(const struct config *c, struct config_told *told, bool *ret_made)
{
	struct err err = ERR_INIT;
	struct stat st;

	*ret_made = false;
	if (*c->state && place_state_look(c->state, &err)) {
		*ret_made = err.code == ERR_IO && may_be_made(c);
		if (!*ret_made)
			config_told_error(told, &err);
	}
	err_clear(&err);
	if (*c->cache && stat(c->cache, &st) == 0 && !S_ISDIR(st.st_mode)) {
		err_set(&err, ERR_USAGE, "the cache is to be a folder, and this is none");
		err_add_file(&err, c->cache);
		err_add_hint(&err, "choose another cache");
		config_told_error(told, &err);
	}
	err_clear(&err);
	if (place_apart(c->state, c->cache, false, &err))
		config_told_error(told, &err);
	if (*c->socket)
		look_parent(c->socket, told);
}

int config_check(const struct config *c, struct config_told *told)
{
	bool made;

	look_folders(c, told, &made);
	if (told->errors == 1)
		config_check_tell(NULL, false, &told->first);
	if (told->errors)
		return STATUS_WRONG;
	config_show(c, stdout);
	if (made)
		printf("\n%s is no store yet: the first start makes it.\n", c->state);
	if (*c->file)
		printf("\nFiles: %s, and *.conf in %s.d. The configuration has no errors.\n", c->file, c->file);
	else
		printf("\nNo files. The configuration has no errors.\n");
	return 0;
}
