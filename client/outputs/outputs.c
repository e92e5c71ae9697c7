/*
 * One stream to several outputs.
 *
 * The order inside: triangles held back by --trim-hull, those left out by --mask and --erase, those by --max-edge, then each
 * output, through the canonical order if asked. What the hull is depends on the whole mesh, so it is found first; the others look
 * at a triangle alone, so that a triangle is written if no option leaves it out. The first failure is kept, ends the fetch, and
 * makes publishing impossible. Outputs are published one after the other when the stream has ended well: with several of them, a
 * failure between two leaves the earlier ones, each of them whole.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "outputs_change.h"
#include "outputs_priv.h"
#include "outputs_tile.h"

#define SORT_MEMORY (64ull << 20)

static size_t add_length(char *buf, size_t size, const char *name, const struct outputs_length *l)
{
	char number[DECIMAL_TEXT_SIZE];

	return !l->given ? 0 :
			   (size_t)snprintf(buf, size, "%s=%s%s%s ", name, decimal_text(l->value, number), l->unit ? "," : "",
					    l->unit ? l->unit : "");
}

/* What the run leaves out of each file. */
static void trimmed_text(const struct outputs *run, char *buf, size_t size)
{
	static const char *const cut[OUTPUTS_CUTS] = {"mask", "erase"};
	const struct outputs_options *opt = &run->opt;
	const struct outputs_length tile = {.given = opt->tiled, .value = opt->tile};
	size_t n = add_length(buf, size, "max-edge", &opt->max_edge);

	n += add_length(buf + n, size - n, "trim-hull", &opt->trim_hull);
	for (int i = 0; i < OUTPUTS_CUTS; i++)
		if (*outputs_mask_digest(run->mask, (enum outputs_cut)i))
			n += (size_t)snprintf(buf + n, size - n, "%s=%s ", cut[i],
					      outputs_mask_digest(run->mask, (enum outputs_cut)i));
	n += add_length(buf + n, size - n, "tile", &tile);
	if (opt->changes)
		n += (size_t)snprintf(buf + n, size - n, "changes ");
	buf[n ? n - 1 : 0] = 0;
}

int outputs_new(const struct outputs_options *opt, struct outputs **ret, struct err *err)
{
	struct outputs *run = calloc(1, sizeof(*run));

	if (!run)
		return err_set(err, ERR_NOMEM, "no memory for outputs");
	run->opt = *opt;
	if (!run->opt.sort_memory)
		run->opt.sort_memory = SORT_MEMORY;
	trimmed_text(run, run->trimmed, sizeof(run->trimmed));
	run->end = &run->target;
	run->err = ERR_INIT;
	*ret = run;
	return 0;
}

int outputs_cut(struct outputs *run, enum outputs_cut cut, const char *file, struct err *err)
{
	int r = outputs_mask_add(&run->mask, cut, file, err);

	trimmed_text(run, run->trimmed, sizeof(run->trimmed));
	return r;
}

static struct outputs_target *target_free(struct outputs_target *t)
{
	if (!t)
		return NULL;
	outputs_canonical_free(t->canonical);
	if (t->writer)
		t->format->free(t->writer);
	for (unsigned i = 0; i < t->nbeside; i++)
		outfile_free(t->beside[i]);
	outputs_stripes_free(t->stripes);
	outfile_free(t->out);
	free(t);
	return NULL;
}

static int target_check(const char *path, const struct format *format, const struct format_options *opt, bool changes,
			struct err *err)
{
	const char *refused = format_option_name(format_options_given(opt) & ~format->takes);

	if (refused)
		return err_set(err, ERR_USAGE, "--%s has no meaning for %s", refused, format->name);
	if (format->kind == FORMAT_RASTER && changes) {
		err_set(err, ERR_USAGE, "--changed-since has no meaning for %s: a raster needs all triangles", format->name);
		return err_add_hint(err, "fetch it of the whole mesh, or of a window with --bbox");
	}
	if (format->kind == FORMAT_LINES && changes) {
		err_set(err, ERR_USAGE, "--changed-since has no meaning for %s: lines need all triangles", format->name);
		return err_add_hint(err, "fetch them of the whole mesh, or of a window with --bbox");
	}
	if (opt->sidecar && (changes || !path)) {
		err_set(err, ERR_USAGE, "--sidecar has no meaning for %s", changes ? "changes" : format->name);
		return err_add_hint(err, changes ? "OUT" OUTPUTS_CHANGES " says what they are" : "leave it out");
	}
	if (format->kind == FORMAT_NOTHING && path) {
		err_set(err, ERR_USAGE, "%s writes nothing, and an output is given", format->name);
		return err_add_hint(err, "leave out -o, or give another --format");
	}
	if (format->kind != FORMAT_NOTHING && !path)
		return err_set(err, ERR_USAGE, "%s needs an output", format->name);
	return 0;
}

/* The trimmer of the run, once there is an output that its files may stand beside. */
static int trim(struct outputs *run, const struct outfile *beside, struct err *err)
{
	return run->opt.trim_hull.given && !run->hull ? outputs_hull_new(beside, &run->hull, err) : 0;
}

/* Where the files of a folder go when parts are joined. */
static int folder_of(struct outputs *run, const char *path, struct err *err)
{
	free(run->joined.folder);
	run->joined.folder = strdup(path);
	return run->joined.folder ? 0 : err_set(err, ERR_NOMEM, "no memory for a file name");
}

int outputs_add(struct outputs *run, const char *path, const struct format *format, const struct format_options *given,
		struct err *err)
{
	struct format_options own = *given, *opt = &own;
	int r = target_check(path, format, opt, run->opt.changes, err);
	struct outputs_target *t = r ? NULL : calloc(1, sizeof(*t));

	own.trimmed = run->trimmed[0] ? run->trimmed : NULL;
	run->joined.no_clobber |= opt->no_clobber;
	if (!r && run->opt.part && path && (run->opt.tiled || run->opt.levels))
		r = folder_of(run, path, err);
	if (!r && run->opt.joins && !run->opt.tiled) {
		free(t);
		return 0;
	}
	if (!r && run->opt.tiled)
		r = run->tiles ? err_set(err, ERR_USAGE, "tiles go into one folder, and two are given") :
				 outputs_tiles_new(path, format, opt, &run->opt, &run->tiles, err);
	if (!r && run->opt.levels)
		r = run->levels ? err_set(err, ERR_USAGE, "levels of detail go into one folder, and two are given") :
				  outputs_levels_new(path, format, opt, &run->opt, &run->levels, err);
	if (!r && run->tiles)
		run->tiles->moves = &run->joined.moves;
	if (!r && !run->opt.joins && (run->opt.tiled || run->opt.levels))
		r = trim(run, run->tiles ? run->tiles->index : outputs_levels_beside(run->levels), err);
	if (r || run->opt.tiled || run->opt.levels) {
		free(t);
		return r && path ? err_add_file(err, path) : r;
	}
	if (!t)
		return err_set(err, ERR_NOMEM, "no memory for an output");
	t->format = format;
	t->opt = *opt;
	t->part = run->opt.part;
	if (path)
		r = run->opt.share_of ? outfile_shared_open(path, t->part, &t->out, err) :
					outfile_new(path, opt->no_clobber, &t->out, err);
	if (!r && path && t->part && !run->opt.share_of)
		r = outfile_hold(t->out, t->part, err);
	if (!r && path)
		r = outputs_beside_open(t, path, err);
	if (!r && run->opt.changes && !run->change)
		r = outputs_change_new(t->out, path, opt, &run->change, err);
	if (!r)
		r = format->open(t->out, opt, &t->writer, err);
	if (r) {
		if (path)
			err_add_file(err, path);
		target_free(t);
		return r;
	}
	*run->end = t;
	run->end = &t->next;
	return trim(run, t->out, err);
}

static int target_head(const struct outputs *run, struct outputs_target *t, const struct acut_mesh_head *head, struct err *err)
{
	int r = t->format->head(t->writer, head, err);

	return r || !t->opt.canonical ? r :
					outputs_canonical_new(t->format, t->writer, t->out, &run->opt, run->opt.sort_memory,
							      head->lines ? OUTPUTS_LINES : 0, &t->canonical, err);
}

static int run_head(void *ctx, const struct acut_mesh_head *head)
{
	struct outputs *run = ctx;
	int r = outputs_edge_init(&run->edge, head, &run->opt, &run->err);

	if (!r && run->hull)
		r = outputs_hull_head(run->hull, head, &run->opt.trim_hull, &run->err);
	if (!r && run->mask)
		r = outputs_mask_head(run->mask, head, &run->err);
	if (!r)
		r = outputs_head_copy(&run->head, head, &run->err);
	if (!r && outputs_keep_goes_on(run))
		return outputs_keep_head(run, head, &run->err);
	if (!r && run->opt.share_of)
		return outputs_share_head(run, head, &run->err);
	for (struct outputs_target *t = run->target; t && !r; t = t->next)
		r = target_head(run, t, head, &run->err);
	if (!r && run->change)
		r = outputs_change_head(run->change, head, &run->err);
	if (!r && run->levels)
		r = outputs_levels_head(run->levels, head, &run->err);
	return r || !run->tiles ? r : outputs_tiles_head(run->tiles, head, &run->err);
}

/* Triangles to the outputs, without those that lie elsewhere or have long edges. */
static int run_write(void *ctx, const struct format_block *given)
{
	struct outputs *run = ctx;
	struct acut_mesh_block own, kept, inside;
	struct format_block block = *given;
	int r = 0;

	if (run->tiles && run->opt.part) {
		r = outputs_tiles_share(run->tiles, block.mesh, given->position, &own, &run->err);
		block.mesh = &own;
	}
	if (!r && run->mask) {
		r = outputs_mask_block(run->mask, block.mesh, given->position, &inside, &run->err);
		block.mesh = &inside;
	}
	if (!r && (run->edge.limited || run->edge.gather)) {
		r = outputs_edge_block(&run->edge, block.mesh, given->position, &kept, &run->err);
		block.mesh = &kept;
	}
	for (struct outputs_target *t = run->target; t && !r; t = t->next)
		r = t->canonical ? outputs_canonical_block(t->canonical, &block, &run->err) :
				   t->format->block(t->writer, &block, &run->err);
	if (!r && run->levels)
		r = outputs_levels_block(run->levels, &block, &run->err);
	return r || !run->tiles ? r : outputs_tiles_block(run->tiles, &block, &run->err);
}

static int run_block(void *ctx, const struct acut_mesh_block *b)
{
	struct outputs *run = ctx;
	struct acut_mesh_block kept;
	struct format_block block = {b, b->local};
	int r = 0;

	if (run->change)
		r = outputs_change_block(run->change, &block, &run->err);
	if (!r && run->hull) {
		r = outputs_hull_block(run->hull, b, block.position, &kept, &run->err);
		block.mesh = &kept;
	}
	return r ? r : run_write(run, &block);
}

struct outputs_left *outputs_left_by(struct outputs *run, enum outputs_reason reason)
{
	struct outputs_left *joined = run->opt.joins ? &run->joined.left[reason] : NULL;
	enum outputs_cut cut;

	switch (reason) {
	case OUTPUTS_BY_HULL:
		if (!run->opt.trim_hull.given)
			return NULL;
		return joined ? joined : run->hull ? (struct outputs_left *)outputs_hull_left(run->hull) : NULL;
	case OUTPUTS_BY_MASK:
	case OUTPUTS_BY_ERASE:
		cut = reason == OUTPUTS_BY_MASK ? OUTPUTS_MASK : OUTPUTS_ERASE;
		if (!*outputs_mask_digest(run->mask, cut))
			return NULL;
		return joined ? joined : outputs_mask_left(run->mask, cut);
	default:
		return run->opt.max_edge.given ? &run->edge.left : NULL;
	}
}

/* The same, to look at. */
static const struct outputs_left *left_by(const struct outputs *run, enum outputs_reason reason)
{
	return outputs_left_by((struct outputs *)run, reason);
}

/* All triangles that the run leaves out. */
static struct outputs_left left_out(const struct outputs *run)
{
	struct outputs_left sum = {.triangles = 0};

	for (enum outputs_reason i = 0; i < OUTPUTS_REASONS; i++)
		if (left_by(run, i))
			outputs_left_sum(&sum, left_by(run, i));
	return sum;
}

/* The tail of what is written. */
static int tail_of(struct outputs *run, const struct acut_mesh_tail *tail, struct acut_mesh_tail *ret)
{
	struct outputs_left left = left_out(run);
	struct digest sum;

	if (!digest_parse(tail->digest, &sum))
		return err_set(&run->err, ERR_PROTO, "the digest of the mesh is no digest");
	digest_sub(&sum, left.digest);
	run->all_triangles = tail->triangles;
	*ret = *tail;
	ret->digest = digest_hex(sum, run->written);
	ret->triangles -= left.triangles;
	return 0;
}

static int run_tail(void *ctx, const struct acut_mesh_tail *tail)
{
	struct outputs *run = ctx;
	struct acut_mesh_tail written;
	int r = 0;

	if (run->hull)
		r = outputs_hull_rest(run->hull, run_write, run, &run->err);
	if (!r)
		r = tail_of(run, tail, &written);
	for (struct outputs_target *t = run->target; t && !r && !run->opt.share_of; t = t->next) {
		if (t->canonical)
			r = outputs_canonical_finish(t->canonical, &run->err);
		t->canonical = outputs_canonical_free(t->canonical);
		if (!r)
			r = t->format->finish(t->writer, &written, &run->err);
	}
	if (!r && run->change)
		r = outputs_change_tail(run->change, &run->err);
	if (!r && run->tiles)
		outputs_tail_copy(&run->tiles->tail, tail);
	if (!r && run->levels)
		outputs_levels_tail(run->levels, &written);
	outputs_tail_copy(&run->tail, tail);
	run->finished = !r;
	return r;
}

static int run_base(void *ctx, const struct acut_mesh_base *base)
{
	struct outputs *run = ctx;

	return outputs_change_base(run->change, base, &run->err);
}

static int run_gone(void *ctx, const struct acut_mesh_region *region)
{
	struct outputs *run = ctx;

	return outputs_change_gone(run->change, region, &run->err);
}

struct acut_changes_sink outputs_changes(struct outputs *run)
{
	return (struct acut_changes_sink){.mesh = outputs_sink(run), .base = run_base, .gone = run_gone};
}

struct acut_mesh_sink outputs_sink(struct outputs *run)
{
	return (struct acut_mesh_sink){.head = run_head, .block = run_block, .tail = run_tail, .ctx = run};
}

const struct err *outputs_error(const struct outputs *run)
{
	return &run->err;
}

int outputs_publish(struct outputs *run, struct err *err)
{
	struct outputs_report report;

	if (run->err.code) {
		*err = run->err;
		return -err->code;
	}
	if (!run->finished)
		return err_set(err, ERR_INTERNAL, "outputs are published before the stream has ended");
	if (run->opt.joins)
		return outputs_part_publish(run, err);
	if (run->opt.share_of)
		return outputs_share_publish(run, err);
	if (run->change && outputs_change_publish(run->change, &run->origin, &run->bytes, err))
		return -err->code;
	for (struct outputs_target *t = run->target; t; t = t->next) {
		int r = outputs_beside_make(run, t, err);

		r = r ? r : outputs_beside_publish(t, &run->bytes, err);
		for (unsigned i = 0; i < t->nbeside && !r; i++)
			r = outputs_part_file(run, t->beside[i], err);
		if (!r && t->out)
			r = outfile_publish(t->out, err);
		if (!r && t->out)
			r = outputs_part_file(run, t->out, err);
		if (r)
			return r;
		run->bytes += t->out ? outfile_size(t->out) : 0;
	}
	outputs_keep_done(run);
	if (run->levels) {
		int r = outputs_levels_publish(run->levels, &run->bytes, err);

		return r || !run->opt.part ? r : outputs_levels_moves(run->levels, &run->joined.moves, err);
	}
	outputs_report(run, &report);
	return run->tiles ? outputs_tiles_publish(run->tiles, &run->origin, &report, &run->bytes, err) : 0;
}

void outputs_about(struct outputs *run, uint64_t job, const char *dataset, uint64_t generation)
{
	free(run->origin.dataset);
	run->origin = (struct outputs_origin){job, generation, dataset ? strdup(dataset) : NULL};
}

uint32_t outputs_no_lines(const struct outputs *run)
{
	uint32_t bits = run->joined.no_lines;
	unsigned i = 0;

	for (const struct outputs_target *t = run->target; t; t = t->next, i++)
		bits |= (uint32_t)(t->format->lines && !t->format->lines(t->writer)) << i;
	return run->tiles && run->tiles->format->lines && !run->tiles->ntile ? 1 : bits;
}

struct format_simplified outputs_simplified(const struct outputs *run)
{
	struct format_simplified sum = run->joined.simplified;

	for (const struct outputs_target *t = run->target; t; t = t->next) {
		struct format_simplified s = {0};

		if (t->opt.simplify.mantissa && t->format->simplified && t->writer)
			s = t->format->simplified(t->writer);
		sum.vertices += s.vertices;
		sum.left_out += s.left_out;
	}
	return sum;
}

static struct outputs_left_out count_of(const struct outputs *run, const struct outputs_left *left)
{
	return (struct outputs_left_out){left, left ? left->triangles : 0, outputs_edge_area(&run->edge, left ? left->area2 : 0)};
}

void outputs_report(const struct outputs *run, struct outputs_report *ret)
{
	const struct outputs_left left = left_out(run);

	*ret = (struct outputs_report){
		.bytes = run->bytes,
		.left_out = count_of(run, &left),
		.all_left_out = left.triangles && left.triangles == run->all_triangles,
		.tiles = run->tiles  ? run->tiles->ntile :
			 run->levels ? outputs_levels_count(run->levels) :
				       run->joined.tiles,
		.no_lines = outputs_no_lines(run),
		.longest_edge = outputs_edge_longest(&run->edge),
		.median_edge = outputs_edge_median(&run->edge),
		.long_share = outputs_edge_share(&run->edge, OUTPUTS_LONG_EDGE * outputs_edge_median(&run->edge)),
	};
	ret->simplified = outputs_simplified(run);
	if (run->change)
		ret->changes = *outputs_change_counts(run->change);
	for (enum outputs_reason i = 0; i < OUTPUTS_REASONS; i++)
		ret->left_out_by[i] = count_of(run, left_by(run, i));
	for (int i = 0; i < OUTPUTS_CUTS; i++)
		snprintf(ret->cut[i], sizeof(ret->cut[i]), "%s", outputs_mask_digest(run->mask, (enum outputs_cut)i));
	memcpy(ret->unit_xy, run->edge.unit, sizeof(ret->unit_xy));
	memcpy(ret->written, run->written, sizeof(run->written));
}

struct outputs *outputs_free(struct outputs *run)
{
	if (!run)
		return NULL;
	outputs_keep_discard(run);
	for (struct outputs_target *t = run->target, *next; t; t = next) {
		next = t->next;
		target_free(t);
	}
	outputs_tiles_free(run->tiles);
	outputs_levels_free(run->levels);
	outputs_change_free(run->change);
	outputs_hull_free(run->hull);
	outputs_mask_free(run->mask);
	outputs_edge_done(&run->edge);
	outputs_head_done(&run->head);
	outputs_keep_free(run->kept);
	outputs_joined_done(&run->joined);
	free(run->origin.dataset);
	free(run);
	return NULL;
}
