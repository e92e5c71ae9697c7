/*
 * config-doc: makes documents from the table of settings. Part of the build, not installed.
 *
 *	config-doc conf               etc/acutd.conf
 *	config-doc options < PAGE     a manual page whose line @SETTINGS@ becomes the options of acutd
 *	config-doc keys < PAGE        likewise, the keys of acutd.conf
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "config.h"

enum { WIDTH = 112 };

/* Settings of the installed file: on a machine with several users the groups decide. */
static const struct {
	enum config_id id;
	const char *value;
} shipped[] = {{CONFIG_group, "acut"}, {CONFIG_admin_group, "acut-admin"}};

static const char *shipped_value(int id)
{
	for (size_t i = 0; i < sizeof shipped / sizeof shipped[0]; i++)
		if ((int)shipped[i].id == id)
			return shipped[i].value;
	return NULL;
}

/* Wraps `text` into lines that begin with `head`. */
static void put_lines(const char *head, const char *text)
{
	size_t at = 0;

	while (*text) {
		size_t n = strcspn(text, " ");

		if (at && at + 1 + n > WIDTH) {
			putchar('\n');
			at = 0;
		}
		at += (size_t)printf("%s%.*s", at ? " " : head, (int)n, text);
		text += n + (text[n] == ' ');
	}
	putchar('\n');
}

/* ---- the file ---- */

static void put_conf_setting(int id)
{
	const struct config_setting *s = &config_settings[id];
	char text[1024];

	snprintf(text, sizeof text, "%s%s%s%s%s", s->help, s->preset ? "" : " Unset: ", s->preset ? "" : s->preset_text,
		 s->preset ? "" : ".", s->scope == CONFIG_RELOAD ? "" : " Changed by a restart only.");
	putchar('\n');
	put_lines("# ", text);
	if (shipped_value(id))
		printf("%s = %s\n", s->name, shipped_value(id));
	else
		printf("#%s =%s%s\n", s->name, s->preset ? " " : "", s->preset ? s->preset : "");
}

static void put_conf(void)
{
	puts("# The configuration of acutd, see acutd.conf(5). Settings that are commented out show the default.");
	puts("# Put own settings into a file of their own, acutd.conf.d/NAME.conf beside this one. If a setting is set twice, the last");
	puts("# value holds, with the files in the order of their names. acutd --check-config checks them, systemctl reload acutd applies");
	puts("# them, acutctl config show --origin shows the values in use and where they come from.");
	for (int i = 0; i < CONFIG_SETTINGS; i++)
		if (config_settings[i].scope != CONFIG_LINE)
			put_conf_setting(i);
}

/* ---- manual pages ---- */

/* Escapes plain text for scdoc. */
static void put_plain(const char *text)
{
	for (; *text; text++) {
		if (strchr("*_\\", *text))
			putchar('\\');
		putchar(*text);
	}
}

/* "SIZE|N%": underlines the words in capitals. */
static void put_argument(const char *argument)
{
	bool word = false;

	for (; *argument; argument++) {
		bool capital = *argument >= 'A' && *argument <= 'Z';

		if (capital != word)
			putchar('_');
		word = capital;
		putchar(*argument);
	}
	if (word)
		putchar('_');
}

/* Indents each line of `more`. */
static void put_more(const char *more)
{
	while (*more) {
		size_t n = strcspn(more, "\n");

		printf("%s%.*s\n", n ? "\t" : "", (int)n, more);
		more += n + 1;
	}
}

static void put_setting(const struct config_setting *s, bool key)
{
	printf("*%s%s*%s", key ? "" : "--", s->name, key ? " = " : s->argument ? " " : "");
	if (s->argument)
		put_argument(s->argument);
	printf("\n\t");
	put_plain(s->help);
	putchar('\n');
	put_more(s->more);
	if (s->argument) {
		printf("\n\tDefault: ");
		put_plain(s->preset ? s->preset : s->preset_text);
		printf(".");
		if (key)
			printf(" Changed by a %s.", s->scope == CONFIG_RELOAD ? "reload" : "restart only");
		putchar('\n');
	}
	putchar('\n');
}

static void put_page(bool key)
{
	char line[4096];

	while (fgets(line, sizeof line, stdin)) {
		if (strcmp(line, "@SETTINGS@\n")) {
			fputs(line, stdout);
			continue;
		}
		for (int i = 0; i < CONFIG_SETTINGS; i++)
			if (!key || config_settings[i].scope != CONFIG_LINE)
				put_setting(&config_settings[i], key);
	}
}

int main(int argc, char **argv)
{
	if (argc == 2 && !strcmp(argv[1], "conf"))
		put_conf();
	else if (argc == 2 && !strcmp(argv[1], "options"))
		put_page(false);
	else if (argc == 2 && !strcmp(argv[1], "keys"))
		put_page(true);
	else
		return 2;
	return fflush(stdout) ? 1 : 0;
}
