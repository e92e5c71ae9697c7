/*
 * The configuration of a start: what the command line says, below it what the files say, below that defaults.
 * config_table.def has the settings; the options that are none stand here.
 */
#include "config.h"

#include <getopt.h>
#include <stdio.h>
#include <string.h>

#include "config_file.h"
#include "config_told.h"
#include "err.h"

/* Numbers of what is no setting, after those. */
enum { OPTION_FILE = CONFIG_SETTINGS, OPTION_NO_FILE, OPTION_CHECK, OPTION_VERSION, OPTION_HELP, OPTIONS };

/* The command line, read and not applied yet: files go first. */
struct words {
	const char *value[CONFIG_SETTINGS]; /* "" of a flag */
	const char *file;
	bool no_file, check;
	int answer; /* OPTION_VERSION, OPTION_HELP, or 0 */
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

static int read_words(int argc, char **argv, struct words *ret, struct err *err)
{
	struct option options[OPTIONS + 1];
	int option;

	*ret = (struct words){0};
	list_options(options);
	optind = 0; /* from the start: they are read again at a reload */
	while (!ret->answer && (option = getopt_long(argc, argv, "", options, NULL)) != -1) {
		if (option == OPTION_VERSION || option == OPTION_HELP) {
			ret->answer = option;
		} else if (option == OPTION_FILE) {
			ret->file = optarg;
		} else if (option == OPTION_NO_FILE) {
			ret->no_file = true;
		} else if (option == OPTION_CHECK) {
			ret->check = true;
		} else if (option >= 0 && option < CONFIG_SETTINGS) {
			ret->value[option] = optarg ? optarg : "";
		} else {
			err_set(err, ERR_USAGE, "the command line is not understood");
			return err_add_hint(err, "acutd --help lists the options");
		}
	}
	if (!ret->answer && optind < argc)
		return err_set(err, ERR_USAGE, "\"%.100s\" is not an option", argv[optind]);
	if (ret->file && ret->no_file)
		return err_set(err, ERR_USAGE, "--config and --no-config exclude each other");
	if (ret->file && strlen(ret->file) + 3 > CONFIG_PATH_SIZE)
		return err_set(err, ERR_USAGE, "--config %.100s...: the path is too long", ret->file);
	return 0;
}

static void read_files(const struct words *w, struct config *c, struct config_told *told)
{
	char folder[CONFIG_PATH_SIZE];

	if (w->no_file)
		return;
	snprintf(c->file, sizeof c->file - 2, "%s", w->file ? w->file : ACUT_CONFIG_FILE);
	snprintf(folder, sizeof folder, "%.*s.d", CONFIG_PATH_SIZE - 3, c->file);
	config_file(c->file, w->file, c, told);
	config_folder(folder, c, told);
}

static void apply_words(const struct words *w, struct config *c, struct config_told *told)
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
		config_told_error(told, &err);
	}
}

int config_parse(int argc, char **argv, struct config *ret, int *ret_what, struct config_told *told, struct err *err)
{
	struct words words;
	int r = read_words(argc, argv, &words, err);

	*ret_what = r ? CONFIG_RUN : words.answer ? CONFIG_EXIT : words.check ? CONFIG_CHECK : CONFIG_RUN;
	if (r)
		return r;
	if (words.check)
		told->tell = config_check_tell;
	if (words.answer == OPTION_VERSION)
		printf("acutd %s\n", ACUT_VERSION);
	else if (words.answer)
		config_help(stdout);
	if (words.answer)
		return 0;
	config_presets(ret);
	ret->argc = argc;
	ret->argv = argv;
	read_files(&words, ret, told);
	apply_words(&words, ret, told);
	config_resolve(ret, told);
	return config_told_end(told, err);
}

int config_again(const struct config *c, struct config *ret, struct config_told *told, struct err *err)
{
	int what;

	return config_parse(c->argc, c->argv, ret, &what, told, err);
}
