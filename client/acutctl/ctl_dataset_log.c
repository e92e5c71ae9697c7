/* dataset log NAME: what each generation did; dataset revert NAME [GENERATION]: undoes one. */
#include <string.h>

#include "ctl.h"
#include "ctl_dataset.h"

struct logging {
	struct ctl *ctl;
	struct ctl_json json;
	bool any;
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
	FILE *out = l->ctl->report;
	char a[32], b[32], who[32];

	snprintf(who, sizeof(who), "%u", g->uid);
	fprintf(out, "%6llu  %s  %-12s  %s", (unsigned long long)g->number,
		g->time_us ? ctl_job_time_text(g->time_us, a) : "-                   ", *g->user ? g->user : g->time_us ? who : "-",
		g->kind);
	if (g->undoes)
		fprintf(out, " of %llu", (unsigned long long)g->undoes);
	if (g->files || !g->files_removed)
		fprintf(out, "  +%s points in %u file%s", ctl_job_count(g->points_added, a), g->files, g->files == 1 ? "" : "s");
	if (g->files_removed)
		fprintf(out, "  -%s points in %u file%s", ctl_job_count(g->points_removed, b), g->files_removed,
			g->files_removed == 1 ? "" : "s");
	fprintf(out, "  %s%s\n", g->content, g->readable ? "" : "  (pruned)");
}

static void row(void *ctx, const struct acut_generation *g)
{
	struct logging *l = ctx;

	l->any = true;
	if (l->ctl->args.json)
		row_json(l, g);
	else
		row_text(l, g);
}

static void file(void *ctx, const struct acut_log_file *f)
{
	struct logging *l = ctx;
	struct ctl_json *j = &l->json;
	char count[32];

	if (!l->ctl->args.json) {
		fprintf(l->ctl->report, "        %s %s  %s points  %s\n", f->removed ? "-" : "+", *f->path ? f->path : f->name,
			ctl_job_count(f->points, count), *f->hash ? f->hash : "-");
		return;
	}
	ctl_json_open(j, NULL, '{');
	ctl_json_text(j, "name", f->name);
	ctl_json_known(j, "path", f->path);
	ctl_json_u64(j, "points", f->points);
	ctl_json_u64(j, "bytes", f->size);
	ctl_json_known(j, "hash", f->hash);
	ctl_json_bool(j, "removed", f->removed);
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

	if (!status && acut_dataset_log(ctl->acut, name, &sink))
		status = ctl_error_acut(ctl);
	return status;
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
