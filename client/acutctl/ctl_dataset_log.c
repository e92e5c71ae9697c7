/* dataset log NAME: what each generation did; dataset revert NAME [GENERATION]: undoes one. */
#include <string.h>

#include "ctl.h"
#include "ctl_dataset.h"
#include "ctl_table.h"

struct logging {
	struct ctl *ctl;
	struct ctl_json json;
	struct ctl_table *table;
	uint64_t generation; /* that files are of */
	char kind[40];
};

static const struct ctl_column generations[] = {
	{"GENERATION", .right = true}, {"KIND"},
	{"TIME", .spare = true},       {"USER", .shrink = true, .spare = true},
	{"POINTS+", .right = true},    {"FILES+", .right = true, .spare = true},
	{"POINTS-", .right = true},    {"FILES-", .right = true, .spare = true},
	{"CONTENT", .spare = true},    {"NOTE", .spare = true},
};

/* With --files: a row a file. */
static const struct ctl_column files[] = {
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
	struct ctl_json *j = &l->json;

	*j = (struct ctl_json){.out = l->ctl->report};
	ctl_json_open(j, NULL, '{');
	ctl_json_u64(j, "generation", g->number);
	ctl_job_time(j, "time", g->time_us);
	ctl_json_known(j, "user", g->user);
	ctl_json_u64(j, "uid", g->uid);
	ctl_json_text(j, "kind", g->kind);
	if (g->undoes)
		ctl_json_u64(j, "undoes", g->undoes);
	else
		ctl_json_text(j, "undoes", NULL);
	ctl_json_u64(j, "files_added", g->files);
	ctl_json_u64(j, "files_removed", g->files_removed);
	ctl_json_u64(j, "points_added", g->points_added);
	ctl_json_u64(j, "points_removed", g->points_removed);
	ctl_json_text(j, "content", g->content);
	ctl_json_bool(j, "readable", g->readable);
	if (l->ctl->args.files)
		ctl_json_open(j, "files", '[');
	else
		ctl_json_literal(j, "files", "null");
}

static void row_text(struct logging *l, const struct acut_generation *g)
{
	struct ctl_table *t = l->table;

	ctl_table_id(t, g->number);
	ctl_table_text(t, "%s", l->kind);
	ctl_table_time(t, g->time_us);
	if (*g->user || !g->time_us)
		ctl_table_text(t, "%s", g->user);
	else
		ctl_table_text(t, "%u", g->uid);
	ctl_table_count(t, g->points_added);
	ctl_table_count(t, g->files);
	ctl_table_count(t, g->points_removed);
	ctl_table_count(t, g->files_removed);
	ctl_table_text(t, "%s", g->content);
	ctl_table_text(t, "%s", g->readable ? "" : "pruned");
}

static void row(void *ctx, const struct acut_generation *g)
{
	struct logging *l = ctx;

	l->generation = g->number;
	if (g->undoes)
		snprintf(l->kind, sizeof(l->kind), "%s of %llu", g->kind, (unsigned long long)g->undoes);
	else
		snprintf(l->kind, sizeof(l->kind), "%s", g->kind);
	if (l->ctl->args.json)
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
	struct ctl_json *j = &l->json;
	struct ctl_table *t = l->table;

	if (!l->ctl->args.json) {
		ctl_table_id(t, l->generation);
		ctl_table_text(t, "%s", l->kind);
		ctl_table_text(t, f->removed ? "removed" : "added");
		ctl_table_text(t, "%s", known_as(f));
		ctl_table_count(t, f->points);
		ctl_table_text(t, "%s", f->hash);
		ctl_table_text(t, "%s", f->overridden);
		return;
	}
	ctl_json_open(j, NULL, '{');
	ctl_json_text(j, "name", f->name);
	ctl_json_known(j, "path", f->path);
	ctl_json_u64(j, "points", f->points);
	ctl_json_u64(j, "bytes", f->size);
	ctl_json_known(j, "hash", f->hash);
	ctl_json_bool(j, "removed", f->removed);
	ctl_json_known(j, "overridden", f->overridden);
	ctl_json_u64(j, "source", f->source);
	ctl_json_close(j, '}');
}

static void end(void *ctx, const struct acut_generation *g)
{
	struct logging *l = ctx;

	if (!l->ctl->args.json)
		return;
	if (l->ctl->args.files)
		ctl_json_close(&l->json, ']');
	ctl_json_close(&l->json, '}');
	ctl_json_line(&l->json);
}

int ctl_dataset_log(struct ctl *ctl, const char *name)
{
	struct logging l = {.ctl = ctl};
	const struct acut_log_sink sink = {.generation = row, .file = ctl->args.files ? file : NULL, .end = end, .ctx = &l};
	int status = ctl_connect(ctl);

	if (status)
		return status;
	if (!ctl->args.json)
		l.table = ctl->args.files ? ctl_table_new(ctl->report, files, sizeof(files) / sizeof(*files)) :
					    ctl_table_new(ctl->report, generations, sizeof(generations) / sizeof(*generations));
	status = acut_dataset_log(ctl->acut, name, &sink);
	ctl_table_free(l.table);
	return status ? ctl_error_acut(ctl) : CTL_DONE;
}

int ctl_dataset_revert(struct ctl *ctl, const char *name, const char *generation)
{
	struct acut_reverted r;
	struct ctl_json j = {.out = ctl->report};
	struct err err = ERR_INIT;
	char a[32], b[32], c[32];
	uint64_t n = 0;
	int status;

	if (generation && ctl_option_number("the generation", generation, 1, UINT64_MAX, &n, &err))
		return ctl_error(ctl, &err);
	status = ctl_connect(ctl);
	if (!status && acut_dataset_revert(ctl->acut, name, n, &r))
		status = ctl_error_acut(ctl);
	if (status)
		return status;
	if (!ctl->args.json) {
		ctl_note(ctl, "%s: generation %llu undoes generation %llu: %s points back, %s points gone, %s points now", name,
			 (unsigned long long)r.generation, (unsigned long long)r.undone, ctl_job_count(r.points_added, a),
			 ctl_job_count(r.points_removed, b), ctl_job_count(r.points, c));
		return CTL_DONE;
	}
	ctl_json_open(&j, NULL, '{');
	ctl_json_text(&j, "dataset", name);
	ctl_json_u64(&j, "generation", r.generation);
	ctl_json_u64(&j, "undone", r.undone);
	ctl_json_u64(&j, "points", r.points);
	ctl_json_u64(&j, "files_added", r.files);
	ctl_json_u64(&j, "files_removed", r.files_removed);
	ctl_json_u64(&j, "points_added", r.points_added);
	ctl_json_u64(&j, "points_removed", r.points_removed);
	ctl_json_close(&j, '}');
	ctl_json_line(&j);
	return CTL_DONE;
}
