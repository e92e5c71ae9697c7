/* Files of settings, lines of `key = value`: the reader that all programs share. */
#ifndef CONF_H
#define CONF_H

#include <stdbool.h>
#include <stddef.h>

struct err;

/* The settings of a program. */
struct conf {
	size_t n;
	const char *(*name)(size_t id);
	bool (*in_file)(size_t id); /* false: it is an option of the command line alone */
	/* Takes a value from a line of a file; "" is the preset. -ERR_USAGE: with message and hint, not with the place. */
	int (*set)(void *ctx, size_t id, const char *value, const char *path, unsigned line, struct err *err);
	void (*report)(void *ctx, bool warning, const struct err *);
	void *ctx;
	const char *manual; /* hint: what lists the settings */
	const char *reader; /* hint: who must be able to read the files */
};

/* Reads the text of a file. Errors and warnings are reported with path and line; the other lines are used. */
void conf_text(const struct conf *, const char *path, const char *text, size_t n);
/* Reads one file. must: its absence is an error. False: it does not exist. */
bool conf_file(const struct conf *, const char *path, bool must);
/* Reads all *.conf of a folder in the order of their names, except hidden ones. The folder may be absent. */
void conf_folder(const struct conf *, const char *path);

#endif
