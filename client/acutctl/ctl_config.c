/* config show: the settings of the daemon, and where each comes from. */
#include <string.h>

#include "ctl.h"
#include "term_table.h"

static const struct term_column columns[] = {{"SETTING"}, {"VALUE", .shrink = true}, {"FROM", .tail = true}};

struct listing {
	struct program *ctl;
	struct term_table *table;
};

static void setting_json(struct program *ctl, const struct acut_setting *s)
{
	struct term_json j = {.out = ctl->session.console.report};

	term_json_open(&j, NULL, '{');
	term_json_text(&j, "name", s->name);
	term_json_known(&j, "value", s->value);
	term_json_known(&j, "default", s->preset);
	term_json_known(&j, "unit", s->unit);
	term_json_literal(&j, "reload", s->reload ? "true" : "false");
	term_json_text(&j, "origin", s->origin);
	term_json_known(&j, "file", s->file);
	if (s->line)
		term_json_u64(&j, "line", s->line);
	else
		term_json_literal(&j, "line", "null");
	term_json_close(&j, '}');
	term_json_line(&j);
}

static void put_origin(struct term_table *t, const struct acut_setting *s)
{
	if (!strcmp(s->origin, "file"))
		term_table_text(t, "%s:%u", s->file, s->line);
	else if (!strcmp(s->origin, "command_line"))
		term_table_text(t, "command line");
	else if (!strcmp(s->origin, "control_group"))
		term_table_text(t, "limit of the control group");
	else if (!*s->value)
		term_table_text(t, "default: %s", s->preset_told);
	else
		term_table_text(t, "%s", s->origin);
}

static void show(void *ctx, const struct acut_setting *s)
{
	struct listing *l = ctx;

	if (l->ctl->session.console.json) {
		setting_json(l->ctl, s);
		return;
	}
	term_table_text(l->table, "%s", s->name);
	if (*s->value)
		term_table_text(l->table, "%s", s->value);
	else
		term_table_none(l->table);
	if (l->ctl->args.origin_of)
		put_origin(l->table, s);
}

static int show_run(struct program *ctl)
{
	struct listing l = {.ctl = ctl};
	int r, status;

	console_begin_list(&ctl->session.console);
	status = session_connect(&ctl->session);
	if (status)
		return status;
	if (!ctl->session.console.json)
		l.table = term_table_new(ctl->session.console.report, columns, ctl->args.origin_of ? 3 : 2);
	r = acut_config(ctl->session.acut, show, &l);
	term_table_free(l.table);
	return r ? session_error_acut(&ctl->session) : SESSION_DONE;
}

const struct cli_verb ctl_config_verbs[] = {
	{"show", "show", "each setting of the daemon, and its value", 0, 0, "origin", show_run},
	{0},
};
