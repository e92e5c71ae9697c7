/*
 * The options of a program without commands, as a table: it parses by it, and its help is made of it.
 */
#ifndef TOOL_OPTIONS_H
#define TOOL_OPTIONS_H

#include <stddef.h>

struct tool_option {
	const char *name, *value, *help; /* value: what follows, "SIZE"; NULL: nothing */
	int code;                        /* above 0 */
};

/* --help and --version are options of all. */
struct tool {
	const char *name, *usage, *about, *end; /* usage: lines, each with its end; end: what follows the options, or "" */
	const struct tool_option *option;
	size_t n; /* at most TOOL_OPTIONS */
};
enum { TOOL_OPTIONS = 16, TOOL_END = -1, TOOL_EXIT = -2 };

/* The code of the next option, with *ret_value if it has one; TOOL_END: there are no more, and optind is the first word;
 * TOOL_EXIT: end with *ret_status (help, version, an unknown option). Options come before words. */
int tool_next(const struct tool *, int argc, char **argv, const char **ret_value, int *ret_status);
/* "NAME: TEXT", and where the help is; 2. */
int tool_usage_error(const struct tool *, const char *text);

#endif
