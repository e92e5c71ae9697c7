/* A configuration as text: each setting as it would be written in the file, and where it comes from. */
#include <stdio.h>
#include <string.h>

#include "config.h"
#include "parse.h"

char *config_origin_text(const struct config *c, enum config_id id, char *buf)
{
	const struct config_origin *o = &c->origin[id];
	char limit[32];

	switch (o->by) {
	case CONFIG_BY_FILE:
		snprintf(buf, CONFIG_ORIGIN_SIZE, "%s:%u", o->file, o->line);
		break;
	case CONFIG_BY_LINE:
		strcpy(buf, "command line");
		break;
	case CONFIG_BY_ENVIRONMENT:
		strcpy(buf, id == CONFIG_state ? "$STATE_DIRECTORY" : "$CACHE_DIRECTORY");
		break;
	case CONFIG_BY_CGROUP:
		snprintf(buf, CONFIG_ORIGIN_SIZE, "limit of the control group, %s, less 48 MB",
			 parse_size_text(c->cgroup_limit, limit));
		break;
	default:
		strcpy(buf, "default");
	}
	return buf;
}

void config_show(const struct config *c, FILE *to)
{
	char value[CONFIG_PATH_SIZE], origin[CONFIG_ORIGIN_SIZE];

	for (int i = 0; i < CONFIG_SETTINGS; i++) {
		const struct config_setting *s = &config_settings[i];

		config_value_text(s, c, value);
		if (s->scope == CONFIG_LINE && c->origin[i].by != CONFIG_BY_LINE)
			continue;
		if (*value)
			fprintf(to, "%s = %s  (%s)\n", s->name, value, config_origin_text(c, (enum config_id)i, origin));
		else
			fprintf(to, "%s is unset: %s\n", s->name, s->preset_text);
	}
}
