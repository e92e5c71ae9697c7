/*
 * The table of settings, and their values: from a text, to a text, and compared. A value has the same text on the command line,
 * in a file, and in reports.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "config.h"
#include "parse.h"

void config_presets(struct config *ret)
{
	const char *wanted;

	*ret = (struct config){.group_gid = -1, .admin_group_gid = -1, .cgroup_limit = UINT64_MAX};
	for (int i = 0; i < CONFIG_SETTINGS; i++)
		if (config_settings[i].preset)
			config_value_parse(&config_settings[i], config_settings[i].preset, ret, &wanted);
}

const struct config_setting config_settings[CONFIG_SETTINGS] = {
#define SETTING(name, field, type, least, most, unit, preset, report, scope, argument, help, more) \
	{name,                                                                                     \
	 CONFIG_TYPE_##type,                                                                       \
	 offsetof(struct config, field),                                                           \
	 least,                                                                                    \
	 most,                                                                                     \
	 unit,                                                                                     \
	 preset,                                                                                   \
	 report,                                                                                   \
	 CONFIG_##scope,                                                                           \
	 argument,                                                                                 \
	 help,                                                                                     \
	 more},
#include "config_table.def"
};

static void *mutable_field(const struct config_setting *s, struct config *c)
{
	return (char *)c + s->offset;
}

static const void *field_of(const struct config_setting *s, const struct config *c)
{
	return (const char *)c + s->offset;
}

static bool parse_text(const char *text, size_t size, char *to)
{
	if (!*text || strlen(text) >= size)
		return false;
	memcpy(to, text, strlen(text) + 1);
	return true;
}

static bool parse_count(const struct config_setting *s, const char *text, unsigned *ret)
{
	uint64_t n;

	if (!parse_u64(text, &n) || n < s->least || n > s->most)
		return false;
	*ret = (unsigned)n;
	return true;
}

static bool parse_percent(const struct config_setting *s, const char *text, unsigned *ret)
{
	char digits[8];
	size_t n = strlen(text);

	if (n < 2 || n > sizeof digits || text[n - 1] != '%')
		return false;
	memcpy(digits, text, n - 1);
	digits[n - 1] = 0;
	return parse_count(s, digits, ret);
}

/* 0 means no limit if the preset of the setting is 0. */
static bool parse_limit(const struct config_setting *s, const char *text, struct space_limit *ret)
{
	struct space_limit limit;

	if (!space_limit_parse(text, (unsigned)s->most, &limit) || (s->least && limit.n < s->least))
		return false;
	if (s->preset && !strcmp(s->preset, "0") && !limit.n)
		limit = (struct space_limit){SPACE_UNLIMITED, 0};
	*ret = limit;
	return true;
}

static bool parse_time(const struct config_setting *s, const char *text, double *ret)
{
	double seconds;

	if (!parse_seconds(text, &seconds) || (s->least && !(seconds > 0)))
		return false;
	*ret = seconds;
	return true;
}

static bool parse_bytes(const struct config_setting *s, const char *text, uint64_t *ret)
{
	uint64_t bytes;

	if (!parse_size(text, &bytes) || bytes < s->least)
		return false;
	*ret = bytes;
	return true;
}

static const char *expected(const struct config_setting *s)
{
	switch (s->type) {
	case CONFIG_TYPE_PATH:
		return !strcmp(s->argument, "PATH") ? "a path" : "a folder";
	case CONFIG_TYPE_GROUP:
		return "the name or number of a group";
	case CONFIG_TYPE_SIZE:
		return "a size as 256M";
	case CONFIG_TYPE_COUNT:
		return s->least ? "a number from 1 to 256" : "a number from 0 to 1000000";
	case CONFIG_TYPE_PERCENT:
		return "a percentage from 0% to 100%";
	case CONFIG_TYPE_SECONDS:
		return s->least ? "a time above 0, as 90s, 5m, 2h or 7d," : "a time as 90s, 5m, 2h or 7d";
	case CONFIG_TYPE_LIMIT:
		return s->most < 100 ? "a size as 10G, or a percentage from 0% to 99%," :
		       s->least      ? "a size as 200G, or a percentage from 1% to 100%," :
				       "a size as 200G, or a percentage from 0% to 100%,";
	case CONFIG_TYPE_LEVEL:
		return "error, warning, notice, info or debug";
	default:
		return "yes or no";
	}
}

bool config_value_parse(const struct config_setting *s, const char *text, struct config *to, const char **ret_wanted)
{
	void *at = mutable_field(s, to);

	*ret_wanted = expected(s);
	switch (s->type) {
	case CONFIG_TYPE_PATH:
		return parse_text(text, CONFIG_PATH_SIZE, at);
	case CONFIG_TYPE_GROUP:
		return parse_text(text, CONFIG_GROUP_SIZE, at);
	case CONFIG_TYPE_FLAG:
		*(bool *)at = true;
		return true;
	case CONFIG_TYPE_SIZE:
		return parse_bytes(s, text, at);
	case CONFIG_TYPE_COUNT:
		return parse_count(s, text, at);
	case CONFIG_TYPE_PERCENT:
		return parse_percent(s, text, at);
	case CONFIG_TYPE_SECONDS:
		return parse_time(s, text, at);
	case CONFIG_TYPE_LIMIT:
		return parse_limit(s, text, at);
	case CONFIG_TYPE_LEVEL:
		return log_parse_level(text, at);
	}
	return false;
}

/* With the largest unit that is exact. */
static void size_text(uint64_t bytes, char *buf, size_t size)
{
	static const char units[] = {0, 'K', 'M', 'G', 'T', 'P', 0};
	unsigned u = 0;

	for (; bytes && bytes % 1024 == 0 && u < 5; u++)
		bytes /= 1024;
	snprintf(buf, size, "%llu%.1s", (unsigned long long)bytes, units + u);
}

static void seconds_text(double seconds, char *buf, size_t size)
{
	static const struct {
		double in;
		char unit;
	} units[] = {{86400, 'd'}, {3600, 'h'}, {60, 'm'}};

	for (size_t i = 0; seconds > 0 && i < sizeof units / sizeof units[0]; i++)
		if (fmod(seconds, units[i].in) == 0) {
			snprintf(buf, size, "%.0f%c", seconds / units[i].in, units[i].unit);
			return;
		}
	/* The shortest text that reads back as the same number: 5000.1 days need all digits. */
	snprintf(buf, size, "%.15gs", seconds);
	if (strtod(buf, NULL) != seconds)
		snprintf(buf, size, "%.17gs", seconds);
}

char *config_value_text(const struct config_setting *s, const struct config *c, char *buf)
{
	static const char *const levels[] = {"error", "warning", "notice", "info", "debug"};
	const void *at = field_of(s, c);
	const struct space_limit *limit = at;

	buf[0] = 0;
	switch (s->type) {
	case CONFIG_TYPE_PATH:
		return strcpy(buf, at);
	case CONFIG_TYPE_GROUP:
		return strcpy(buf, at);
	case CONFIG_TYPE_FLAG:
		return strcpy(buf, *(const bool *)at ? "yes" : "no");
	case CONFIG_TYPE_SIZE:
		size_text(*(const uint64_t *)at, buf, CONFIG_PATH_SIZE);
		break;
	case CONFIG_TYPE_COUNT:
		snprintf(buf, CONFIG_PATH_SIZE, "%u", *(const unsigned *)at);
		break;
	case CONFIG_TYPE_PERCENT:
		snprintf(buf, CONFIG_PATH_SIZE, "%u%%", *(const unsigned *)at);
		break;
	case CONFIG_TYPE_SECONDS:
		/* 0 means unset if the setting must be larger. */
		if (*(const double *)at > 0 || !s->least)
			seconds_text(*(const double *)at, buf, CONFIG_PATH_SIZE);
		break;
	case CONFIG_TYPE_LIMIT:
		if (limit->unit == SPACE_PERCENT)
			snprintf(buf, CONFIG_PATH_SIZE, "%llu%%", (unsigned long long)limit->n);
		else
			size_text(limit->n, buf, CONFIG_PATH_SIZE);
		break;
	case CONFIG_TYPE_LEVEL:
		return strcpy(buf, levels[*(const enum log_level *)at]);
	}
	return buf;
}

void config_value_copy(const struct config_setting *s, const struct config *from, struct config *to)
{
	static const size_t sizes[] = {
		[CONFIG_TYPE_PATH] = CONFIG_PATH_SIZE,
		[CONFIG_TYPE_GROUP] = CONFIG_GROUP_SIZE,
		[CONFIG_TYPE_FLAG] = sizeof(bool),
		[CONFIG_TYPE_SIZE] = sizeof(uint64_t),
		[CONFIG_TYPE_COUNT] = sizeof(unsigned),
		[CONFIG_TYPE_PERCENT] = sizeof(unsigned),
		[CONFIG_TYPE_SECONDS] = sizeof(double),
		[CONFIG_TYPE_LIMIT] = sizeof(struct space_limit),
		[CONFIG_TYPE_LEVEL] = sizeof(enum log_level),
	};

	memcpy(mutable_field(s, to), field_of(s, from), sizes[s->type]);
}

bool config_value_equal(const struct config_setting *s, const struct config *a, const struct config *b)
{
	char one[CONFIG_PATH_SIZE], two[CONFIG_PATH_SIZE];

	return !strcmp(config_value_text(s, a, one), config_value_text(s, b, two));
}
