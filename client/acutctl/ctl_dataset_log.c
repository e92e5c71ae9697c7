/* dataset log NAME: what each generation did; dataset revert NAME [GENERATION]: undoes one. */
#include <string.h>

#include "ctl.h"
#include "ctl_dataset.h"

struct logging {
	struct console_list list;
	struct term_json json;
	bool files;
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
	{"LINES"},
	{"SOURCE", .right = true, .spare = true}, /* as views name it: weight=#4-9:50 */
};

static void row_json(struct logging *l, const struct acut_generation *g)
{
	struct term_json *j = &l->json;

	*j = console_json(l->list.console);
	term_json_u64(j, "generation", g->number);
	term_json_time(j, "time", g->time_us);
	term_json_known(j, "user", g->user);
	term_json_u64(j, "uid", g->uid);
	term_json_text(j, "kind", g->kind);
	term_json_known_u64(j, "undoes", g->undoes);
	term_json_u64(j, "files_added", g->files);
	term_json_u64(j, "files_removed", g->files_removed);
	term_json_u64(j, "points_added", g->points_added);
	term_json_u64(j, "points_removed", g->points_removed);
	term_json_text(j, "content", g->content);
	term_json_bool(j, "readable", g->readable);
	if (l->files)
		term_json_open(j, "files", '[');
	else
		term_json_null(j, "files");
}

static void row_text(struct logging *l, const struct acut_generation *g)
{
	struct term_table *t = l->list.table;

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
	if (l->list.console->json)
		row_json(l, g);
	else if (!l->files)
		row_text(l, g);
}

/* The path of a file; its name if it came through a pipe, whose path is made up (ctl_input_path). */
static const char *known_as(const struct acut_log_file *f)
{
	static const char made_up[] = "/dev/stdin/";

	return *f->path && (!*f->name || strncmp(f->path, made_up, sizeof(made_up) - 1)) ? f->path : f->name;
}

static void file(void *ctx, const struct acut_log_file *f)
{
	struct logging *l = ctx;
	struct term_json *j = &l->json;
	struct term_table *t = l->list.table;
	char lines[160] = "";

	if (!l->list.console->json) {
		term_table_id(t, l->generation);
		term_table_text(t, "%s", l->kind);
		term_table_text(t, f->removed ? "removed" : "added");
		term_table_text(t, "%s", known_as(f));
		if (f->of_lines)
			term_table_text(t, "%s", "");
		else
			term_table_count(t, f->points);
		term_table_text(t, "%s", f->hash);
		term_table_text(t, "%s", f->overridden);
		if (f->of_lines)
			ctl_report_lines_text(f->features, f->lines, f->vertices, lines, sizeof lines);
		term_table_text(t, "%s", lines);
		term_table_id(t, f->source);
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
	if (f->of_lines) {
		term_json_open(j, "lines", '{');
		ctl_report_lines_keys(j, f->features, f->lines, f->vertices);
		term_json_close(j, '}');
	} else {
		term_json_null(j, "lines");
	}
	term_json_close(j, '}');
}

static void end(void *ctx, const struct acut_generation *g)
{
	struct logging *l = ctx;

	if (!l->list.console->json)
		return;
	if (l->files)
		term_json_close(&l->json, ']');
	term_json_end(&l->json);
}

int ctl_dataset_log(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct logging l = {.list.console = &session->console, .files = ctl->opt.files};
	const struct acut_log_sink sink = {.generation = row, .file = l.files ? file : NULL, .end = end, .ctx = &l};
	int status = session_connect(session);

	if (status)
		return status;
	l.list.table = l.files ? CONSOLE_TABLE(&session->console, files) : CONSOLE_TABLE(&session->console, generations);
	status = acut_dataset_log(session->acut, ctl->line.word[0], &sink);
	term_table_free(l.list.table);
	return status ? session_error_acut(session) : SESSION_DONE;
}

static void reverted_json(const struct console *c, const char *name, const struct acut_reverted *r)
{
	struct term_json j = console_json(c);

	term_json_text(&j, "dataset", name);
	term_json_u64(&j, "generation", r->generation);
	term_json_u64(&j, "undone", r->undone);
	term_json_u64(&j, "points", r->points);
	term_json_u64(&j, "files_added", r->files);
	term_json_u64(&j, "files_removed", r->files_removed);
	term_json_u64(&j, "points_added", r->points_added);
	term_json_u64(&j, "points_removed", r->points_removed);
	term_json_end(&j);
}

/* Unless a generation is given, the newest. */
int ctl_dataset_revert(struct program *ctl)
{
	struct session *session = &ctl->session;
	const char *name = ctl->line.word[0], *generation = ctl->line.word[1];
	struct acut_reverted r;
	struct err err = ERR_INIT;
	char a[32], b[32], c[32];
	uint64_t n = 0;
	int status;

	if (generation && cli_number("the generation", generation, 1, UINT64_MAX, &n, &err))
		return session_error(session, &err);
	status = session_connect(session);
	if (!status && acut_dataset_revert(session->acut, name, n, &r))
		status = session_error_acut(session);
	if (status)
		return status;
	if (session->console.json)
		reverted_json(&session->console, name, &r);
	else
		console_line(&session->console,
			     "%s: generation %llu undoes generation %llu: %s points back, %s points gone, %s points now", name,
			     (unsigned long long)r.generation, (unsigned long long)r.undone, term_count(r.points_added, a),
			     term_count(r.points_removed, b), term_count(r.points, c));
	return SESSION_DONE;
}
