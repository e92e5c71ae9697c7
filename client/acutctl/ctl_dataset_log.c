/* dataset log NAME: what each generation did; dataset revert NAME [GENERATION]: undoes one. */
#include <string.h>

#include "ctl.h"
#include "ctl_dataset.h"
#include "term_table.h"

struct logging {
	struct program *ctl;
	struct term_json json;
	struct term_table *table;
	uint64_t generation; /* that files are of */
	char kind[40];
};

static const struct term_column generations[] = {
	{"GENERATION", .right = true}, {"KIND"},
	{"TIME", .spare = true},       {"USER", .shrink = true, .spare = true},
	{"POINTS+", .right = true},    {"FILES+", .right = true, .spare = true},
	{"POINTS-", .right = true},    {"FILES-", .right = true, .spare = true},
	{"CONTENT", .spare = true},    {"NOTE", .spare = true},
};

/* With --files: a row a file. */
static const struct term_column files[] = {
	{"GENERATION", .right = true},
	{"KIND"},
	{"CHANGE"},
	{"FILE", .shrink = true},
	{"POINTS", .right = true},
	{"HASH", .spare = true},
	{"OVERRIDDEN", .spare = true},
};

static void row_json(struct logging *l, const struct acut_generation *g)
{
	struct term_json *j = &l->json;

	*j = (struct term_json){.out = l->ctl->session.console.report};
	term_json_open(j, NULL, '{');
	term_json_u64(j, "generation", g->number);
	term_json_time(j, "time", g->time_us);
	term_json_known(j, "user", g->user);
	term_json_u64(j, "uid", g->uid);
	term_json_text(j, "kind", g->kind);
	if (g->undoes)
		term_json_u64(j, "undoes", g->undoes);
	else
		term_json_text(j, "undoes", NULL);
	term_json_u64(j, "files_added", g->files);
	term_json_u64(j, "files_removed", g->files_removed);
	term_json_u64(j, "points_added", g->points_added);
	term_json_u64(j, "points_removed", g->points_removed);
	term_json_text(j, "content", g->content);
	term_json_bool(j, "readable", g->readable);
	if (l->ctl->args.files)
		term_json_open(j, "files", '[');
	else
		term_json_literal(j, "files", "null");
}

static void row_text(struct logging *l, const struct acut_generation *g)
{
	struct term_table *t = l->table;

	term_table_id(t, g->number);
	term_table_text(t, "%s", l->kind);
	term_table_time(t, g->time_us);
	if (*g->user || !g->time_us)
		term_table_text(t, "%s", g->user);
	else
		term_table_text(t, "%u", g->uid);
	term_table_count(t, g->points_added);
	term_table_count(t, g->files);
	term_table_count(t, g->points_removed);
	term_table_count(t, g->files_removed);
	term_table_text(t, "%s", g->content);
	term_table_text(t, "%s", g->readable ? "" : "pruned");
}

static void row(void *ctx, const struct acut_generation *g)
{
	struct logging *l = ctx;

	l->generation = g->number;
	if (g->undoes)
		snprintf(l->kind, sizeof(l->kind), "%s of %llu", g->kind, (unsigned long long)g->undoes);
	else
		snprintf(l->kind, sizeof(l->kind), "%s", g->kind);
	if (l->ctl->session.console.json)
		row_json(l, g);
	else if (!l->ctl->args.files)
		row_text(l, g);
}

/* By its path, where it had one: that of what came through a pipe was made up (ctl_input_path), and says no more than its name.
 */
static const char *known_as(const struct acut_log_file *f)
{
	static const char made_up[] = "/dev/stdin/";

	return *f->path && (!*f->name || strncmp(f->path, made_up, sizeof(made_up) - 1)) ? f->path : f->name;
}

static void file(void *ctx, const struct acut_log_file *f)
{
	struct logging *l = ctx;
	struct term_json *j = &l->json;
	struct term_table *t = l->table;

	if (!l->ctl->session.console.json) {
		term_table_id(t, l->generation);
		term_table_text(t, "%s", l->kind);
		term_table_text(t, f->removed ? "removed" : "added");
		term_table_text(t, "%s", known_as(f));
		term_table_count(t, f->points);
		term_table_text(t, "%s", f->hash);
		term_table_text(t, "%s", f->overridden);
		return;
	}
	term_json_open(j, NULL, '{');
	term_json_text(j, "name", f->name);
	term_json_known(j, "path", f->path);
	term_json_u64(j, "points", f->points);
	term_json_u64(j, "bytes", f->size);
	term_json_known(j, "hash", f->hash);
	term_json_bool(j, "removed", f->removed);
	term_json_known(j, "overridden", f->overridden);
	term_json_u64(j, "source", f->source);
	term_json_close(j, '}');
}

static void end(void *ctx, const struct acut_generation *g)
{
	struct logging *l = ctx;

	if (!l->ctl->session.console.json)
		return;
	if (l->ctl->args.files)
		term_json_close(&l->json, ']');
	term_json_close(&l->json, '}');
	term_json_line(&l->json);
}

int ctl_dataset_log(struct program *ctl, const char *name)
{
	struct logging l = {.ctl = ctl};
	const struct acut_log_sink sink = {.generation = row, .file = ctl->args.files ? file : NULL, .end = end, .ctx = &l};
	int status = session_connect(&ctl->session);

	if (status)
		return status;
	if (!ctl->session.console.json)
		l.table = ctl->args.files ? term_table_new(ctl->session.console.report, files, sizeof(files) / sizeof(*files)) :
					    term_table_new(ctl->session.console.report, generations,
							   sizeof(generations) / sizeof(*generations));
	status = acut_dataset_log(ctl->session.acut, name, &sink);
	term_table_free(l.table);
	return status ? session_error_acut(&ctl->session) : SESSION_DONE;
}

int ctl_dataset_revert(struct program *ctl, const char *name, const char *generation)
{
	struct acut_reverted r;
	struct term_json j = {.out = ctl->session.console.report};
	struct err err = ERR_INIT;
	char a[32], b[32], c[32];
	uint64_t n = 0;
	int status;

	if (generation && cli_number("the generation", generation, 1, UINT64_MAX, &n, &err))
		return session_error(&ctl->session, &err);
	status = session_connect(&ctl->session);
	if (!status && acut_dataset_revert(ctl->session.acut, name, n, &r))
		status = session_error_acut(&ctl->session);
	if (status)
		return status;
	if (!ctl->session.console.json) {
		console_line(&ctl->session.console,
			     "%s: generation %llu undoes generation %llu: %s points back, %s points gone, %s points now", name,
			     (unsigned long long)r.generation, (unsigned long long)r.undone, term_count(r.points_added, a),
			     term_count(r.points_removed, b), term_count(r.points, c));
		return SESSION_DONE;
	}
	term_json_open(&j, NULL, '{');
	term_json_text(&j, "dataset", name);
	term_json_u64(&j, "generation", r.generation);
	term_json_u64(&j, "undone", r.undone);
	term_json_u64(&j, "points", r.points);
	term_json_u64(&j, "files_added", r.files);
	term_json_u64(&j, "files_removed", r.files_removed);
	term_json_u64(&j, "points_added", r.points_added);
	term_json_u64(&j, "points_removed", r.points_removed);
	term_json_close(&j, '}');
	term_json_line(&j);
	return SESSION_DONE;
}
