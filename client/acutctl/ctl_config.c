/* config show: the settings of the daemon and their origins. */
#include <string.h>

#include "ctl.h"

static const struct term_column columns[] = {{"SETTING"}, {"VALUE", .shrink = true}, {"FROM", .tail = true}};

struct listing {
	struct console_list list;
	bool origins;
};

static void setting_json(const struct console *c, const struct acut_setting *s)
{
	struct term_json j = console_json(c);

	term_json_text(&j, "name", s->name);
	term_json_known(&j, "value", s->value);
	term_json_known(&j, "default", s->preset);
	term_json_known(&j, "unit", s->unit);
	term_json_bool(&j, "reload", s->reload);
	term_json_text(&j, "origin", s->origin);
	term_json_known(&j, "file", s->file);
	term_json_known_u64(&j, "line", s->line);
	term_json_end(&j);
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
	struct term_table *t = l->list.table;

	if (!t) {
		setting_json(l->list.console, s);
		return;
	}
	term_table_text(t, "%s", s->name);
	term_table_text(t, "%s", s->value);
	if (l->origins)
		put_origin(t, s);
}

static int show_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct listing l = {.list.console = &session->console, .origins = ctl->opt.origin_of};
	int r, status;

	console_begin_list(&session->console);
	status = session_connect(session);
	if (status)
		return status;
	l.list.table = console_table(&session->console, columns, l.origins ? 3 : 2);
	r = acut_config(session->acut, show, &l);
	term_table_free(l.list.table);
	return r ? session_error_acut(session) : SESSION_DONE;
}

const struct cli_verb ctl_config_verbs[] = {
	{"show", "show", "each setting of the daemon, and its value", 0, 0, "origin", show_run},
	{0},
};
