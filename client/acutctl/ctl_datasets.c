/* datasets: one row a dataset. */
#include "ctl.h"
#include "ctl_dataset.h"
#include "ctl_names.h"
#include "term_table.h"
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

struct listing {
	struct program *ctl;
	struct term_table *table;
};

static void each(void *ctx, const struct acut_dataset *d)
{
	struct listing *l = ctx;
	struct term_table *t = l->table;
	char name[CTL_NAME_SIZE], mode[MODE_TEXT_SIZE];

	if (l->ctl->session.console.json) {
		ctl_dataset_json(l->ctl, d);
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
	struct listing *l = ctx;
	struct term_table *t = l->table;

	if (l->ctl->session.console.json) {
		ctl_dataset_json(l->ctl, d);
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
	struct listing l = {.ctl = ctl};
	bool removed = ctl->args.removed;
	int status = session_connect(&ctl->session);

	console_begin_list(&ctl->session.console);
	if (status)
		return status;
	if (!ctl->session.console.json)
		l.table = removed ? term_table_new(ctl->session.console.report, gone, sizeof(gone) / sizeof(*gone)) :
				    term_table_new(ctl->session.console.report, there, sizeof(there) / sizeof(*there));
	status = removed ? acut_datasets_removed(ctl->session.acut, each_removed, &l) :
			   acut_datasets(ctl->session.acut, NULL, each, &l);
	term_table_free(l.table);
	return status ? session_error_acut(&ctl->session) : SESSION_DONE;
}
