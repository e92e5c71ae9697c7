/* geoid add FILE, geoid list, geoid rm NAME: the geoid grids that the daemon keeps for --geoid. */
#include <math.h>

#include "ctl.h"

static void geoid_json(const struct console *c, const struct acut_geoid *g)
{
	struct term_json j = console_json(c);

	term_json_text(&j, "name", g->name);
	term_json_text(&j, "hash", g->hash);
	term_json_known(&j, "description", g->description);
	term_json_known(&j, "date", g->date);
	term_json_u64(&j, "width", g->width);
	term_json_u64(&j, "height", g->height);
	term_json_u64(&j, "bytes", g->bytes);
	term_json_number(&j, "min", g->min);
	term_json_number(&j, "max", g->max);
	term_json_number(&j, "rms_error", g->rms_error);
	term_json_number(&j, "max_error", g->max_error);
	term_json_u64(&j, "uid", g->uid);
	term_json_end(&j);
}

static const struct term_column columns[] = {
	{"NAME", .shrink = true}, {"POSTS", .right = true, .spare = true},
	{"SIZE", .right = true},  {"LEAST", .right = true},
	{"MOST", .right = true},  {"RMS ERROR", .right = true, .spare = true},
	{"HASH", .spare = true},  {"DESCRIPTION", .tail = true, .spare = true},
};

static void show(void *ctx, const struct acut_geoid *g)
{
	struct console_list *l = ctx;
	struct term_table *t = l->table;

	if (l->console->json) {
		geoid_json(l->console, g);
		return;
	}
	term_table_text(t, "%s", g->name);
	term_table_text(t, "%ux%u", g->width, g->height);
	term_table_size(t, g->bytes);
	term_table_text(t, "%.3f", g->min);
	term_table_text(t, "%.3f", g->max);
	if (isfinite(g->rms_error))
		term_table_text(t, "%.3g", g->rms_error);
	else
		term_table_none(t);
	term_table_text(t, "%s", g->hash);
	term_table_text(t, "%s%s%s", g->description, *g->description && *g->date ? ", " : "", g->date);
}

static int add_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct console_list l = {.console = &session->console};
	const struct acut_geoid *g;
	char name[128];
	int status = session_connect(session);

	if (!status)
		status = ctl_stage_geoid(session, ctl->line.word[0], ctl->input.name, name, &g);
	if (status)
		return status;
	l.table = CONSOLE_TABLE(l.console, columns);
	show(&l, g);
	term_table_free(l.table);
	return SESSION_DONE;
}

static int list_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct console_list l = {.console = &session->console};
	int status = session_connect(session);

	if (status)
		return status;
	l.table = CONSOLE_TABLE(l.console, columns);
	status = acut_geoids(session->acut, show, &l);
	term_table_free(l.table);
	return status ? session_error_acut(session) : SESSION_DONE;
}

static int rm_run(struct program *ctl)
{
	int status = session_connect(&ctl->session);

	if (!status && acut_geoid_remove(ctl->session.acut, ctl->line.word[0]))
		status = session_error_acut(&ctl->session);
	return status;
}

const struct cli_verb ctl_geoid_verbs[] = {
	{"add", "add FILE.pgm", "keep a geoid grid with the daemon", 1, 1, "name", add_run},
	{"list", "list", "the grids that are kept", 0, 0, NULL, list_run},
	{"rm", "rm GEOID", "remove one", 1, 1, NULL, rm_run},
	{0},
};
