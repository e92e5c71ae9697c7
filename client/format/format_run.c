/*
 * One stream to several outputs.
 *
 * The order inside: positions of local vertices (only if somebody needs them), triangles left out by
 * --max-edge, then each output, through the canonical order if asked. The first failure is kept, ends the
 * fetch, and makes publishing impossible. Outputs are published one after the other when the stream has
 * ended well: with several of them, a failure between two leaves the earlier ones, each of them whole.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "format_run.h"

#define SORT_MEMORY (64ull << 20)

int format_run_new(const struct format_run_options *opt, struct format_run **ret, struct err *err)
{
	struct format_run *run = calloc(1, sizeof(*run));

	if (!run)
		return err_set(err, ERR_NOMEM, "no memory for outputs");
	run->opt = *opt;
	if (!run->opt.sort_memory)
		run->opt.sort_memory = SORT_MEMORY;
	run->positions = opt->has_max_edge;
	run->end = &run->target;
	run->err = ERR_INIT;
	*ret = run;
	return 0;
}

static struct format_target *target_free(struct format_target *t)
{
	if (!t)
		return NULL;
	format_canonical_free(t->canonical);
	if (t->writer)
		t->format->free(t->writer);
	format_output_free(t->out);
	free(t);
	return NULL;
}

static int target_check(const char *path, const struct format *format, const struct format_options *opt, struct err *err)
{
	if (opt->canonical && !format->canonical)
		return err_set(err, ERR_USAGE, "--canonical has no meaning for %s", format->name);
	if ((opt->has_origin || opt->origin_auto) && !format->origin)
		return err_set(err, ERR_USAGE, "--origin has no meaning for %s", format->name);
	if (opt->z_unit && !format->origin)
		return err_set(err, ERR_USAGE, "--z-unit has no meaning for %s", format->name);
	if (format->nothing && path) {
		err_set(err, ERR_USAGE, "%s writes nothing, and an output is given", format->name);
		return err_add_hint(err, "leave out -o, or give another --format");
	}
	if (!format->nothing && !path)
		return err_set(err, ERR_USAGE, "%s needs an output", format->name);
	return 0;
}

int format_run_add(struct format_run *run, const char *path, const struct format *format, const struct format_options *opt,
		   struct err *err)
{
	int r = target_check(path, format, opt, err);
	struct format_target *t = r ? NULL : calloc(1, sizeof(*t));

	if (!r && run->opt.tiled)
		r = run->tiles ? err_set(err, ERR_USAGE, "tiles go into one folder, and two are given") :
				 format_tiles_new(path, format, opt, &run->opt, &run->tiles, err);
	run->positions |= run->opt.tiled;
	if (r || run->opt.tiled) {
		free(t);
		return r && path ? err_add_file(err, path) : r;
	}
	if (!t)
		return err_set(err, ERR_NOMEM, "no memory for an output");
	t->format = format;
	t->opt = *opt;
	if (path)
		r = format_output_new(path, opt->no_clobber, &t->out, err);
	if (!r && run->opt.changes && !run->change) {
		r = format_change_new(t->out, path, opt, &run->change, err);
		run->positions |= !r && path;
	}
	if (!r)
		r = format->open(t->out, opt, &t->writer, err);
	if (!r && opt->canonical)
		r = format_canonical_new(format, t->writer, t->out, run->opt.sort_memory, &t->canonical, err);
	if (r) {
		if (path)
			err_add_file(err, path);
		target_free(t);
		return r;
	}
	run->positions |= format->positions || opt->canonical;
	*run->end = t;
	run->end = &t->next;
	return 0;
}

static int run_head(void *ctx, const struct acut_mesh_head *head)
{
	struct format_run *run = ctx;
	int r = format_edge_init(&run->edge, head, &run->opt, &run->err);

	if (!r && format_keep_goes_on(run))
		return format_keep_head(run, head, &run->err);
	for (struct format_target *t = run->target; t && !r; t = t->next)
		r = t->format->head(t->writer, head, &run->err);
	if (!r && run->change)
		r = format_change_head(run->change, head, &run->err);
	return r || !run->tiles ? r : format_tiles_head(run->tiles, head, &run->err);
}

static int run_block(void *ctx, const struct acut_mesh_block *b)
{
	struct format_run *run = ctx;
	struct acut_mesh_block kept;
	struct format_block block = {b, NULL};
	int r = 0;

	if (run->positions || run->edge.gather)
		r = format_open_block(&run->open, b, &block.position, &run->err);
	if (!r && run->change)
		r = format_change_block(run->change, &block, &run->err);
	if (!r && (run->edge.limited || run->edge.gather)) {
		r = format_edge_block(&run->edge, b, block.position, &kept, &run->err);
		block.mesh = &kept;
	}
	for (struct format_target *t = run->target; t && !r; t = t->next)
		r = t->canonical ? format_canonical_block(t->canonical, &block, &run->err) :
				   t->format->block(t->writer, &block, &run->err);
	return r || !run->tiles ? r : format_tiles_block(run->tiles, &block, &run->err);
}

static int run_tail(void *ctx, const struct acut_mesh_tail *tail)
{
	struct format_run *run = ctx;
	int r = 0;

	format_open_done(&run->open);
	for (struct format_target *t = run->target; t && !r; t = t->next) {
		if (t->canonical)
			r = format_canonical_finish(t->canonical, &run->err);
		t->canonical = format_canonical_free(t->canonical);
		if (!r)
			r = t->format->finish(t->writer, tail, &run->err);
	}
	if (!r && run->change)
		r = format_change_tail(run->change, &run->err);
	if (!r && run->tiles)
		r = format_tiles_tail(run->tiles, tail, &run->err);
	run->finished = !r;
	return r;
}

static int run_base(void *ctx, const struct acut_mesh_base *base)
{
	struct format_run *run = ctx;

	return format_change_base(run->change, base, &run->err);
}

static int run_gone(void *ctx, const struct acut_mesh_region *region)
{
	struct format_run *run = ctx;

	return format_change_gone(run->change, region, &run->err);
}

struct acut_changes_sink format_run_changes(struct format_run *run)
{
	return (struct acut_changes_sink){.mesh = format_run_sink(run), .base = run_base, .gone = run_gone};
}

struct acut_mesh_sink format_run_sink(struct format_run *run)
{
	return (struct acut_mesh_sink){.head = run_head, .block = run_block, .tail = run_tail, .ctx = run};
}

const struct err *format_run_error(const struct format_run *run)
{
	return &run->err;
}

int format_run_publish(struct format_run *run, struct err *err)
{
	if (run->err.code) {
		*err = run->err;
		return -err->code;
	}
	if (!run->finished)
		return err_set(err, ERR_INTERNAL, "outputs are published before the stream has ended");
	if (run->change && format_change_publish(run->change, &run->bytes, err))
		return -err->code;
	for (struct format_target *t = run->target; t; t = t->next) {
		int r = t->out ? format_output_publish(t->out, err) : 0;
		if (r)
			return r;
		run->bytes += t->out ? format_output_size(t->out) : 0;
	}
	format_keep_done(run);
	return run->tiles ? format_tiles_publish(run->tiles, run->edge.left_out, &run->bytes, err) : 0;
}

void format_run_about(struct format_run *run, uint64_t job, const char *dataset, uint64_t generation)
{
	if (run->tiles)
		format_tiles_about(run->tiles, job, dataset, generation);
	if (run->change)
		format_change_about(run->change, job, dataset, generation);
}

void format_run_report(const struct format_run *run, struct format_report *ret)
{
	*ret = (struct format_report){
		.bytes = run->bytes,
		.left_out = run->edge.left_out,
		.left_out_area = format_edge_area(&run->edge),
		.tiles = run->tiles ? format_tiles_count(run->tiles) : 0,
		.longest_edge = format_edge_longest(&run->edge),
		.median_edge = format_edge_median(&run->edge),
		.long_share = format_edge_share(&run->edge, FORMAT_LONG_EDGE * format_edge_median(&run->edge)),
	};
	if (run->change)
		ret->changes = *format_change_counts(run->change);
	memcpy(ret->unit_xy, run->edge.unit, sizeof(ret->unit_xy));
}

struct format_run *format_run_free(struct format_run *run)
{
	if (!run)
		return NULL;
	format_keep_discard(run);
	for (struct format_target *t = run->target, *next; t; t = next) {
		next = t->next;
		target_free(t);
	}
	format_tiles_free(run->tiles);
	format_change_free(run->change);
	format_open_done(&run->open);
	format_edge_done(&run->edge);
	format_keep_free(run->kept);
	free(run);
	return NULL;
}
