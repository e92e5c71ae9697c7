/*
 * The configuration of a start: the command line, then the files, then defaults. config_table.def has the settings; the options
 * that are no settings are here.
 */
#include "config.h"

#include <getopt.h>
#include <stdio.h>
#include <string.h>

#include "config_file.h"
#include "config_report.h"
#include "err.h"

/* Options that are no settings have the numbers after those. */
enum { OPTION_FILE = CONFIG_SETTINGS, OPTION_NO_FILE, OPTION_CHECK, OPTION_VERSION, OPTION_HELP, OPTIONS };

/* The parsed command line. It is applied after the files. */
struct command_line {
	const char *value[CONFIG_SETTINGS]; /* "" of a flag */
	const char *file;
	bool no_file, check;
	int print; /* OPTION_VERSION, OPTION_HELP, or 0 */
};

static void list_options(struct option *to)
{
	static const struct option more[] = {
		{"config", required_argument, NULL, OPTION_FILE},  {"no-config", no_argument, NULL, OPTION_NO_FILE},
		{"check-config", no_argument, NULL, OPTION_CHECK}, {"version", no_argument, NULL, OPTION_VERSION},
		{"help", no_argument, NULL, OPTION_HELP},          {0},
	};

	for (int i = 0; i < CONFIG_SETTINGS; i++) {
		const struct config_setting *s = &config_settings[i];

		to[i] = (struct option){s->name, s->argument ? required_argument : no_argument, NULL, i};
	}
	memcpy(to + CONFIG_SETTINGS, more, sizeof more);
}

static int parse_command_line(int argc, char **argv, struct command_line *ret, struct err *err)
{
	struct option options[OPTIONS + 1];
	int option;

	*ret = (struct command_line){0};
	list_options(options);
	optind = 0; /* restarts getopt: a reload parses again */
	while (!ret->print && (option = getopt_long(argc, argv, "", options, NULL)) != -1) {
		if (option == OPTION_VERSION || option == OPTION_HELP) {
			ret->print = option;
		} else if (option == OPTION_FILE) {
			ret->file = optarg;
		} else if (option == OPTION_NO_FILE) {
			ret->no_file = true;
		} else if (option == OPTION_CHECK) {
			ret->check = true;
		} else if (option >= 0 && option < CONFIG_SETTINGS) {
			ret->value[option] = optarg ? optarg : "";
		} else {
			err_set(err, ERR_USAGE, "the command line has an error");
			return err_add_hint(err, "acutd --help lists the options");
		}
	}
	if (!ret->print && optind < argc)
		return err_set(err, ERR_USAGE, "\"%.100s\" is not an option", argv[optind]);
	if (ret->file && ret->no_file)
		return err_set(err, ERR_USAGE, "--config and --no-config exclude each other");
	if (ret->file && strlen(ret->file) + 3 > CONFIG_PATH_SIZE)
		return err_set(err, ERR_USAGE, "--config %.100s...: the path is too long", ret->file);
	return 0;
}

static void read_files(const struct command_line *w, struct config *c, struct config_report *report)
{
	char folder[CONFIG_PATH_SIZE];

	if (w->no_file)
		return;
	snprintf(c->file, sizeof c->file - 2, "%s", w->file ? w->file : ACUT_CONFIG_FILE);
	snprintf(folder, sizeof folder, "%.*s.d", CONFIG_PATH_SIZE - 3, c->file);
	config_file(c->file, w->file, c, report);
	config_folder(folder, c, report);
}

static void apply_command_line(const struct command_line *w, struct config *c, struct config_report *report)
{
	const char *wanted;

	for (int i = 0; i < CONFIG_SETTINGS; i++) {
		struct err err = ERR_INIT;

		if (!w->value[i])
			continue;
		c->origin[i] = (struct config_origin){.by = CONFIG_BY_LINE};
		if (config_value_parse(&config_settings[i], w->value[i], c, &wanted))
			continue;
		err_set(&err, ERR_USAGE, "--%s %.100s: %s is wanted", config_settings[i].name, w->value[i], wanted);
		config_report_error(report, &err);
	}
}

int config_parse(int argc, char **argv, struct config *ret, int *ret_what, struct config_report *report, struct err *err)
{
	struct command_line words;
	int r = parse_command_line(argc, argv, &words, err);

	*ret_what = r ? CONFIG_RUN : words.print ? CONFIG_EXIT : words.check ? CONFIG_CHECK : CONFIG_RUN;
	if (r)
		return r;
	if (words.check)
		report->emit = config_check_print;
	if (words.print == OPTION_VERSION)
		printf("acutd %s\n", ACUT_VERSION);
	else if (words.print)
		config_help(stdout);
	if (words.print)
		return 0;
	config_presets(ret);
	ret->argc = argc;
	ret->argv = argv;
	read_files(&words, ret, report);
	apply_command_line(&words, ret, report);
	config_resolve(ret, report);
	return config_report_end(report, err);
}

int config_again(const struct config *c, struct config *ret, struct config_report *report, struct err *err)
{
	int what;

	return config_parse(c->argc, c->argv, ret, &what, report, err);
}
