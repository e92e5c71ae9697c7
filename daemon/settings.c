/*
 * The configuration of a running daemon. A reload reads the command line and the files as a start would. Settings that can change
 * while jobs run go to the rooms that use them. The others stay as they are, and a warning names them.
 */
#include "settings.h"

#include <stdio.h>
#include <string.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>

#include "clock.h"
#include "config.h"
#include "config_report.h"
#include "err.h"
#include "service.h"
#include "log.h"
#include "rights.h"
#include "server.h"

/* ---- reporting ---- */

static const char *origin_name(const struct config_origin *o)
{
	static const char *const names[] = {
		[CONFIG_BY_DEFAULT] = "default", [CONFIG_BY_ENVIRONMENT] = "environment", [CONFIG_BY_CGROUP] = "control_group",
		[CONFIG_BY_FILE] = "file",       [CONFIG_BY_LINE] = "command_line",
	};

	return names[o->by];
}

bool settings_get(void *ctx, unsigned i, struct server_setting *ret)
{
	const struct config *c = ctx;
	const struct config_setting *s = &config_settings[i];

	if (i >= CONFIG_SETTINGS)
		return false;
	*ret = (struct server_setting){
		.name = s->name,
		.preset = s->preset ? s->preset : "",
		.preset_text = s->preset ? "" : s->preset_text,
		.unit = s->unit,
		.help = s->help,
		.origin = origin_name(&c->origin[i]),
		.line = c->origin[i].line,
		.reload = s->scope == CONFIG_RELOAD,
	};
	config_value_text(s, c, ret->value);
	snprintf(ret->file, sizeof ret->file, "%s", c->origin[i].file);
	return true;
}

void settings_rights(const struct config *c, struct rights *ret)
{
	*ret = (struct rights){
		.self = geteuid(),
		.gid = c->group_gid < 0 ? RIGHTS_NOBODY : (uint32_t)c->group_gid,
		.admin_gid = c->admin_group_gid < 0 ? RIGHTS_NOBODY : (uint32_t)c->admin_group_gid,
	};
	snprintf(ret->group, sizeof ret->group, "%s", c->group);
}

void settings_limits(const struct config *c, struct core_limits *ret)
{
	*ret = (struct core_limits){
		.disk = c->disk,
		.keep_free = c->keep_free,
		.keep_removed = c->keep_removed,
		.space_wait = c->space_wait,
		.user = {.jobs = c->user_jobs, .memory = c->user_memory, .datasets = c->user_datasets, .disk = c->user_disk},
	};
}

/* ---- reading again ---- */

/* Restores in `next` what a reload cannot change. Returns how many settings change. */
static unsigned merge_changes(const struct config *running, struct config *next)
{
	char was[CONFIG_PATH_SIZE], is[CONFIG_PATH_SIZE], where[CONFIG_ORIGIN_SIZE];
	unsigned changed = 0;

	for (int i = 0; i < CONFIG_SETTINGS; i++) {
		const struct config_setting *s = &config_settings[i];

		if (config_value_equal(s, running, next))
			continue;
		config_value_text(s, running, was);
		config_value_text(s, next, is);
		config_origin_text(next, (enum config_id)i, where);
		if (s->scope == CONFIG_RELOAD) {
			log_notice("%s is %s now (%s), it was %s", s->name, *is ? is : "unset", where, *was ? was : "unset");
			changed++;
			continue;
		}
		log_warning("%s needs a restart of acutd to become %s (%s); until then it is %s", s->name, *is ? is : "unset",
			    where, *was ? was : "unset");
		config_value_copy(s, running, next);
		next->origin[i] = running->origin[i];
	}
	return changed;
}

static void apply_settings(const struct config *c, struct service *service, struct server *server)
{
	struct core_limits limits;
	struct rights rights;

	settings_rights(c, &rights);
	settings_limits(c, &limits);
	log_set_level(c->level);
	service_set_limits(service, &limits);
	server_set_rights(server, &rights, c->user_connections);
}

void settings_reload(struct config *c, struct service *service, struct server *server)
{
	struct config_report report = {.emit = config_report_log};
	struct err err = ERR_INIT;
	struct config next;
	unsigned changed;

	sd_notifyf(0, "RELOADING=1\nMONOTONIC_USEC=%llu", (unsigned long long)(clock_mono_ns() / 1000));
	if (config_again(c, &next, &report, &err)) {
		log_event_err(LOG_EVENT_CONFIG_REFUSED, NULL, "the configuration stays as it was", &err);
	} else {
		changed = merge_changes(c, &next);
		apply_settings(&next, service, server);
		*c = next;
		log_event(LOG_EVENT_CONFIG_RELOADED, NULL, "the configuration was read again: %u settings changed", changed);
	}
	sd_notify(0, "READY=1");
}
