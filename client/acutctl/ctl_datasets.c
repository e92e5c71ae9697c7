/* datasets: one row a dataset. */
#include "ctl.h"
#include "ctl_dataset.h"
#include "ctl_names.h"
#include "mode.h"

static const struct term_column there[] = {
	{"NAME", .shrink = true},  {"GENERATION", .right = true},
	{"POINTS", .right = true}, {"FILES", .right = true, .spare = true},
	{"SIZE", .right = true},   {"PUSHED", .spare = true},
	{"MODE", .spare = true},   {"OWNER", .spare = true},
	{"GROUP", .spare = true},  {"NOTE", .tail = true, .spare = true},
};

static const struct term_column gone[] = {
	{"NUMBER", .right = true}, {"NAME", .shrink = true},
	{"POINTS", .right = true}, {"FILES", .right = true, .spare = true},
	{"SIZE", .right = true},   {"UNTIL"},
};

static void each(void *ctx, const struct acut_dataset *d)
{
	struct console_list *l = ctx;
	struct term_table *t = l->table;
	char name[CTL_NAME_SIZE], mode[MODE_TEXT_SIZE];

	if (l->console->json) {
		ctl_dataset_json(l->console, d);
		return;
	}
	term_table_text(t, "%s", d->name);
	term_table_id(t, d->generation);
	term_table_count(t, d->points);
	term_table_count(t, d->files);
	term_table_size(t, d->bytes);
	term_table_time(t, d->pushed_us);
	term_table_text(t, "%s", mode_text(d->mode, mode));
	term_table_text(t, "%s", ctl_user_text(d->uid, name));
	term_table_text(t, "%s", ctl_group_text(d->gid, name));
	term_table_text(t, "%s%s%s", d->pinned ? "pinned" : "", d->pinned && d->pending[0] ? ", " : "",
			d->pending[0] ? "push pending" : "");
}

static void each_removed(void *ctx, const struct acut_dataset *d)
{
	struct console_list *l = ctx;
	struct term_table *t = l->table;

	if (l->console->json) {
		ctl_dataset_json(l->console, d);
		return;
	}
	term_table_id(t, d->id);
	term_table_text(t, "%s", d->name);
	term_table_count(t, d->points);
	term_table_count(t, d->files);
	term_table_size(t, d->bytes);
	term_table_time(t, d->until_us);
}

int ctl_datasets_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct console_list l = {.console = &session->console};
	bool removed = ctl->opt.removed;
	int status = session_connect(session);

	console_begin_list(&session->console);
	if (status)
		return status;
	l.table = removed ? CONSOLE_TABLE(l.console, gone) : CONSOLE_TABLE(l.console, there);
	status = removed ? acut_datasets_removed(session->acut, each_removed, &l) : acut_datasets(session->acut, NULL, each, &l);
	term_table_free(l.table);
	return status ? session_error_acut(session) : SESSION_DONE;
}
