/* acutd --help: settings from the table, the other options from here. Lines of at most 110 columns. */
#include <stdio.h>
#include <string.h>

#include "config.h"

enum { LEFT = 23, RIGHT = 110 };

/* Wraps `text` right of the left column. at: the column that the first line has reached. */
static void put_text(FILE *to, int at, const char *text)
{
	while (*text) {
		size_t n = strcspn(text, " ");

		if (at > LEFT && at + 1 + (int)n > RIGHT) {
			fputc('\n', to);
			at = 0;
		}
		if (at < LEFT)
			at += fprintf(to, "%*s", LEFT - at, "");
		else if (at > LEFT)
			at += fprintf(to, " ");
		at += fprintf(to, "%.*s", (int)n, text);
		text += n + (text[n] == ' ');
	}
	fputc('\n', to);
}

static void put_option(FILE *to, const char *name, const char *argument, const char *text)
{
	int at = fprintf(to, "  --%s%s%s", name, argument ? " " : "", argument ? argument : "");

	if (at >= LEFT) {
		fputc('\n', to);
		at = 0;
	}
	put_text(to, at, text);
}

static void put_setting(FILE *to, const struct config_setting *s)
{
	const char *preset = s->preset ? s->preset : s->argument ? s->preset_text : NULL;
	char text[512];
	size_t n = strlen(s->help);

	if (preset)
		snprintf(text, sizeof text, "%.*s (default: %s)", (int)(n - (s->help[n - 1] == '.')), s->help, preset);
	else
		snprintf(text, sizeof text, "%.*s", (int)(n - (s->help[n - 1] == '.')), s->help);
	put_option(to, s->name, s->argument, text);
}

void config_help(FILE *to)
{
	fputs("acutd: terrain meshes from points, out of core\n"
	      "\n"
	      "usage: acutd [--socket PATH] [OPTION...]\n"
	      "\n",
	      to);
	for (int i = 0; i < CONFIG_SETTINGS; i++)
		put_setting(to, &config_settings[i]);
	fputc('\n', to);
	put_option(to, "config", "FILE", "Read this file, and *.conf in the folder FILE.d");
	put_option(to, "no-config", NULL, "Read no file");
	put_option(to, "check-config", NULL, "Read the configuration as a start would, and print it, or its errors (status 2)");
	put_option(to, "version", NULL, "Print and exit");
	put_option(to, "help", NULL, "Print and exit");
}
