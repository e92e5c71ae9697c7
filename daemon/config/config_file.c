/* The settings of acutd for the reader of files (conf.h): what a line sets, and where it came from. */
#include "config_file.h"

#include <stdio.h>
#include <string.h>

#include "conf.h"
#include "config.h"
#include "config_report.h"
#include "err.h"

struct reading {
	struct config *to;
	struct config_report *report;
};

static const char *name_of(size_t id)
{
	return config_settings[id].name;
}

static bool in_file(size_t id)
{
	return config_settings[id].scope != CONFIG_LINE;
}

static void reset_setting(struct config *to, size_t id)
{
	struct config presets;

	config_presets(&presets);
	config_value_copy(&config_settings[id], &presets, to);
	to->origin[id] = (struct config_origin){.by = CONFIG_BY_DEFAULT};
}

static int set(void *ctx, size_t id, const char *value, const char *path, unsigned line, struct err *err)
{
	const struct config_setting *s = &config_settings[id];
	struct config *to = ((struct reading *)ctx)->to;
	const char *wanted;

	if (!*value) {
		reset_setting(to, id);
		return 0;
	}
	if (s->type == CONFIG_TYPE_PATH && *value != '/') {
		err_set(err, ERR_USAGE, "%s = %.100s is not an absolute path", s->name, value);
		return err_add_hint(err, "begin it with /: a service has no folder of its own to start from");
	}
	if (!config_value_parse(s, value, to, &wanted))
		return err_set(err, ERR_USAGE, "%s = %.100s: %s is wanted", s->name, value, wanted);
	to->origin[id] = (struct config_origin){.by = CONFIG_BY_FILE, .line = line};
	snprintf(to->origin[id].file, sizeof to->origin[id].file, "%s", path);
	return 0;
}

static void report(void *ctx, bool warning, const struct err *err)
{
	struct config_report *to = ((struct reading *)ctx)->report;

	if (warning)
		config_report_warning(to, err);
	else
		config_report_error(to, err);
}

static struct conf conf_of(struct reading *r)
{
	return (struct conf){.n = CONFIG_SETTINGS,
			     .name = name_of,
			     .in_file = in_file,
			     .set = set,
			     .report = report,
			     .ctx = r,
			     .manual = "acutd --help and acutd.conf(5) list the settings",
			     .reader = "the user that acutd runs as must be able to read it"};
}

void config_text(const char *path, const char *text, size_t n, struct config *to, struct config_report *report)
{
	struct reading r = {to, report};
	const struct conf c = conf_of(&r);

	conf_text(&c, path, text, n);
}

bool config_file(const char *path, bool must, struct config *to, struct config_report *report)
{
	struct reading r = {to, report};
	const struct conf c = conf_of(&r);

	return conf_file(&c, path, must);
}

void config_folder(const char *path, struct config *to, struct config_report *report)
{
	struct reading r = {to, report};
	const struct conf c = conf_of(&r);

	conf_folder(&c, path);
}
