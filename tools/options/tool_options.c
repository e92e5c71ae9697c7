#include "tool_options.h"

#include <assert.h>
#include <getopt.h>
#include <stdio.h>
#include <string.h>

enum { HELP = 1 << 16, VERSION };

static void print_help(const struct tool *t)
{
	int width = 0;

	for (size_t i = 0; i < t->n; i++) {
		const struct tool_option *o = &t->option[i];
		int w = (int)(strlen(o->name) + (o->value ? strlen(o->value) + 1 : 0));

		width = w > width ? w : width;
	}
	printf("%s\n%s\n", t->usage, t->about);
	for (size_t i = 0; i < t->n; i++) {
		const struct tool_option *o = &t->option[i];

		printf("  --%s%s%-*s   %s\n", o->name, o->value ? " " : "", width - (int)strlen(o->name) - !!o->value,
		       o->value ? o->value : "", o->help);
	}
	printf("  --help, --version\n%s", t->end);
}

int tool_usage_error(const struct tool *t, const char *text)
{
	fprintf(stderr, "%s: %s\nTry '%s --help'.\n", t->name, text, t->name);
	return 2;
}

int tool_next(const struct tool *t, int argc, char **argv, const char **ret_value, int *ret_status)
{
	struct option longs[TOOL_OPTIONS + 3] = {{0}};
	int code;

	assert(t->n <= TOOL_OPTIONS);
	for (size_t i = 0; i < t->n; i++)
		longs[i] = (struct option){t->option[i].name, t->option[i].value ? required_argument : no_argument, NULL,
					   t->option[i].code};
	longs[t->n] = (struct option){"help", no_argument, NULL, HELP};
	longs[t->n + 1] = (struct option){"version", no_argument, NULL, VERSION};
	code = getopt_long(argc, argv, "+", longs, NULL);
	*ret_value = optarg;
	*ret_status = 0;
	switch (code) {
	case HELP:
		print_help(t);
		return TOOL_EXIT;
	case VERSION:
		printf("%s %s\n", t->name, ACUT_VERSION);
		return TOOL_EXIT;
	case '?':
		fprintf(stderr, "Try '%s --help'.\n", t->name);
		*ret_status = 2;
		return TOOL_EXIT;
	default:
		return code < 0 ? TOOL_END : code;
	}
}
