/*
 * From round to round. The points chosen are a grid whose segments are the seeds, and what each round added; more than a few
 * segments become one. The regions are planned once, for the seeds. With max_points an error is an attempt: the seeds for it, and
 * rounds until none adds a point, or until there are too many.
 */
#include "simplify_round.h"

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "io.h"
#include "pipe.h"
#include "simplify_region.h"
#include "simplify_seed.h"

/* ---- a new round ---- */

static int write_plan(const struct simplify *s, const struct cut_plan *plan, struct err *err)
{
	struct simplify_out *out = malloc(sizeof *out);
	char name[GRID_NAME_MAX];
	int r;

	if (!out)
		return err_set(err, ERR_NOMEM, "no memory for a plan");
	simplify_name(name, "plan", s->at.attempt, 0, 0);
	r = simplify_out_begin(out, s->p.dirfd, name, sizeof plan->leaf->region, err);
	if (!r) {
		for (size_t i = 0; !r && i < plan->n; i++)
			r = simplify_out_add(out, &plan->leaf[i].region, 1, err);
		if (!r)
			r = simplify_out_end(out, NULL, err);
		simplify_out_abort(out);
	}
	free(out);
	return r;
}

static int make_plan(struct simplify *next, struct err *err)
{
	size_t reader_bytes = grid_reader_bytes(next->chosen);
	struct grid_reader *reader;
	struct cut_plan plan = {.ledger = NULL};
	uint32_t load = next->load ? next->load : SIMPLIFY_REGION;
	void *memory = malloc(reader_bytes);
	int r;

	if (!memory)
		return err_set(err, ERR_NOMEM, "no memory for a plan");
	r = grid_reader_new(next->chosen, memory, reader_bytes, &reader, err);
	if (!r) {
		r = cut_plan_make(reader, load, &plan, err);
		grid_reader_free(reader);
	}
	if (!r)
		r = write_plan(next, &plan, err);
	next->at.tasks = plan.n;
	cut_plan_done(&plan);
	free(memory);
	return r;
}

static char *chosen_name(const struct simplify *next, char name[GRID_NAME_MAX])
{
	return simplify_name(name, "chosen", next->at.attempt, next->at.round, 0);
}

/* The points of next->at are these segments. */
static int write_chosen(const struct simplify *next, struct grid_segment_info *segments, size_t n, struct err *err)
{
	char name[GRID_NAME_MAX];

	return simplify_manifest(next, chosen_name(next, name), segments, n, next->at.lines, err);
}

static int begin_round(struct simplify *next, struct err *err)
{
	char name[GRID_NAME_MAX];
	int r = simplify_grid(next, chosen_name(next, name), &next->chosen, err);

	next->at.step = SIMPLIFY_CHECK;
	return r || next->at.round ? r : make_plan(next, err);
}

/* ---- an attempt ---- */

static int begin_attempt(struct simplify *next, struct err *err)
{
	struct grid_segment_info segment;
	char name[GRID_NAME_MAX];
	int r;

	simplify_name(name, "seed", next->at.attempt, 0, 0);
	r = simplify_seed_grid(next, next->at.error, name, &segment, err);
	if (r)
		return r;
	next->at.round = next->at.rounds = next->at.added = 0;
	next->at.chosen = next->at.seeds = segment.points;
	r = write_chosen(next, &segment, 1, err);
	if (!next->at.flat)
		return r ? r : begin_round(next, err);
	/* There are no triangles to test. */
	if (!r)
		r = simplify_finish(next, chosen_name(next, name), &next->at, err);
	next->at.step = SIMPLIFY_DONE;
	next->at.tasks = 0;
	return r;
}

/* The points that any error leaves. */
static uint64_t least_points(const struct simplify_where *at)
{
	return at->flat ? at->points : at->lines + at->hull;
}

static int first_error(struct simplify *next, struct err *err)
{
	uint64_t most = next->p.max_points, least = least_points(&next->at);
	uint64_t *histogram;
	int r;

	if (!most)
		return 0;
	if (least > most) {
		err_set(err, ERR_LIMIT, "%llu points are fewer than the %llu that any mesh of this view has: %s",
			(unsigned long long)most, (unsigned long long)least,
			next->at.flat ? "all points are on one line" : "corners of the hull, and vertices of lines");
		return err_add_hint(err, "ask for at least %llu points", (unsigned long long)least);
	}
	histogram = malloc(SIMPLIFY_BUCKETS * sizeof *histogram);
	if (!histogram)
		return err_set(err, ERR_NOMEM, "no memory for a histogram");
	r = simplify_seed_histogram(next, histogram, err);
	/* The rounds add about a twentieth. */
	next->at.target = (most - least) - (most - least) / 20;
	if (!r)
		next->at.error = simplify_seeds_error(histogram, next->at.target);
	free(histogram);
	return r;
}

int simplify_end_blocks(const struct simplify *s, struct simplify *next, struct err *err)
{
	int r = simplify_seed_hull(s, &next->at, err);

	if (!r)
		r = first_error(next, err);
	return r ? r : begin_attempt(next, err);
}

/* ---- the end of an attempt ---- */

/* Keeps what was chosen as the best so far. */
static int keep_best(struct simplify *next, struct err *err)
{
	struct simplify_where *at = &next->at;
	struct grid_segment_info segment;
	char name[GRID_NAME_MAX], from[GRID_NAME_MAX];
	int r;

	simplify_name(name, "kept", at->attempt, 0, 0);
	r = simplify_rewrite(next, chosen_name(next, from), name, true, &segment, err);
	if (!r)
		r = simplify_manifest(next, simplify_name(name, "best", at->attempt, 0, 0), &segment, 1, at->lines, err);
	at->best = at->attempt + 1;
	at->best_error = at->error;
	at->best_far = at->far;
	at->best_chosen = at->chosen;
	at->best_seeds = at->seeds;
	at->best_rounds = at->rounds;
	return r;
}

/* The next error to try, between those that are known to give too many and few enough points. */
static int next_error(struct simplify *next, struct err *err)
{
	struct simplify_where *at = &next->at;
	uint64_t *histogram = malloc(SIMPLIFY_BUCKETS * sizeof *histogram), guess;
	uint64_t least = least_points(at), most = next->p.max_points;
	int r;

	if (!histogram)
		return err_set(err, ERR_NOMEM, "no memory for a histogram");
	r = simplify_seed_histogram(next, histogram, err);
	if (!r) {
		/* In proportion to what the rounds made of the last target, a hundredth below. */
		double share = (double)(most - least) * 0.99 / (double)(at->chosen > least ? at->chosen - least : 1);

		at->target = (uint64_t)((double)at->target * (share < 0.25 ? 0.25 : share > 4 ? 4 : share));
		guess = simplify_seeds_error(histogram, at->target);
		if (at->best && (guess < at->low || guess >= at->best_error))
			guess = at->low + (at->best_error - at->low) / 2;
		else if (!at->best && guess < at->low)
			guess = 2 * at->low;
		at->error = guess > (uint64_t)SIMPLIFY_ERROR_MOST ? (uint64_t)SIMPLIFY_ERROR_MOST : guess;
	}
	free(histogram);
	return r;
}

static int finish_best(struct simplify *next, struct err *err)
{
	struct simplify_where *at = &next->at;
	char name[GRID_NAME_MAX];
	int r;

	at->error = at->best_error;
	at->far = at->best_far;
	at->seeds = at->best_seeds;
	at->rounds = at->best_rounds;
	at->chosen = at->best_chosen;
	r = simplify_finish(next, simplify_name(name, "best", at->best - 1, 0, 0), at, err);
	at->step = SIMPLIFY_DONE;
	at->tasks = 0;
	return r;
}

/* An attempt for max_points is over: with too many points, or with all of them tested. */
static int end_attempt(struct simplify *next, struct err *err)
{
	struct simplify_where *at = &next->at;
	uint64_t most = next->p.max_points;
	int r = 0;

	if (at->chosen > most)
		at->low = at->error + 1 > at->low ? at->error + 1 : at->low;
	else if (!at->best || at->error < at->best_error)
		r = keep_best(next, err);
	if (r)
		return r;
	if (at->best && (at->best_chosen >= most - most / 50 || at->low >= at->best_error || at->best_chosen == at->points ||
			 at->attempt + 1 >= SIMPLIFY_ATTEMPTS))
		return finish_best(next, err);
	r = next_error(next, err);
	at->attempt++;
	return r ? r : begin_attempt(next, err);
}

static int end_all(struct simplify *next, struct err *err)
{
	char name[GRID_NAME_MAX];
	int r;

	if (next->p.max_points)
		return end_attempt(next, err);
	r = simplify_finish(next, chosen_name(next, name), &next->at, err);
	next->at.step = SIMPLIFY_DONE;
	next->at.tasks = 0;
	return r;
}

/* ---- what a round added ---- */

/* The points of one task. */
static int collect_task(const struct simplify *s, uint32_t task, struct simplify_stage *to, struct simplify_found *ret,
			struct err *err)
{
	char name[GRID_NAME_MAX];
	struct point pts[256];
	struct simplify_in in;
	size_t n = 0;
	int r = simplify_in_begin(&in, s->p.dirfd, simplify_name(name, "bad", s->at.attempt, s->at.round, task), sizeof *pts,
				  err);

	if (r)
		return r;
	memcpy(ret, in.info, sizeof *ret);
	do {
		r = simplify_in_read(&in, pts, 256, &n, err);
		for (size_t k = 0; !r && k < n; k++)
			r = simplify_stage_add(to, &pts[k], err);
	} while (!r && n);
	simplify_in_end(&in);
	return r;
}

/* Writes the points of all tasks as a segment. A point may be in it twice. Adds to *ret_all the tests, the flags, and the
 * greatest error. */
static int collect(const struct simplify *s, const char *segment, struct grid_segment_info *ret, struct simplify_found *ret_all,
		   struct err *err)
{
	struct simplify_stage *to = malloc(sizeof *to);
	struct simplify_found one;
	int r;

	if (!to)
		return err_set(err, ERR_NOMEM, "no memory for the points of a round");
	r = simplify_stage_begin(to, s, segment, true, s->p.memory - sizeof *to, err);
	for (uint32_t i = 0; !r && i < s->at.tasks; i++) {
		r = collect_task(s, i, to, &one, err);
		if (!r)
			r = simplify_cancelled(s, err);
		ret_all->tests += one.tests;
		ret_all->far = one.far > ret_all->far ? one.far : ret_all->far;
		ret_all->is |= one.is;
	}
	if (!r)
		r = simplify_stage_end(to, ret, err);
	simplify_stage_abort(to);
	free(to);
	return r;
}

struct fresh {
	struct simplify_out out;
	struct simplify_sink sink;
};

static int write_key(void *ctx, const struct point *p, struct err *err)
{
	struct fresh *f = ctx;
	uint64_t key = point_morton(p->x, p->y);

	return simplify_out_add(&f->out, &key, 1, err);
}

/* The keys of a segment's points, for the next round; *ret: how many. */
static int write_fresh(const struct simplify *next, struct grid_segment_info *segment, uint64_t *ret, struct err *err)
{
	struct fresh *f = malloc(sizeof *f);
	struct grid_reader *reader;
	char name[GRID_NAME_MAX];
	struct grid *grid = NULL;
	void *memory = NULL;
	int r = f ? 0 : err_set(err, ERR_NOMEM, "no memory for the points of a round");

	if (!r)
		r = simplify_manifest(next, "added", segment, 1, 0, err);
	if (!r)
		r = simplify_grid(next, "added", &grid, err);
	if (!r && !(memory = malloc(grid_reader_bytes(grid))))
		r = err_set(err, ERR_NOMEM, "no memory for the points of a round");
	if (!r)
		r = simplify_out_begin(&f->out, next->p.dirfd, simplify_name(name, "fresh", next->at.attempt, next->at.round, 0),
				       sizeof(uint64_t), err);
	if (r)
		goto out;
	simplify_sink_init(&f->sink, next, &next->rest);
	f->sink.ctx = f;
	f->sink.point = write_key;
	r = grid_reader_new(grid, memory, grid_reader_bytes(grid), &reader, err);
	if (!r) {
		r = simplify_scan(&f->sink, reader, 0, UINT64_MAX, err);
		grid_reader_free(reader);
	}
	*ret = f->out.n;
	if (!r)
		r = simplify_out_end(&f->out, NULL, err);
	simplify_out_abort(&f->out);
out:
	grid_close(grid);
	free(memory);
	free(f);
	return r;
}

/* The segments of the next round: those of this one and `added`; one of all if they are many. */
static int next_segments(const struct simplify *s, const struct simplify *next, const struct grid_segment_info *added,
			 struct grid_segment_info *segments, size_t *ret_n, struct err *err)
{
	const struct grid_manifest *m = grid_manifest(s->chosen);
	char name[GRID_NAME_MAX];
	size_t n = m->nsegments;
	int r;

	memcpy(segments, m->segments, n * sizeof *segments);
	segments[n++] = *added;
	*ret_n = n;
	if (n <= (s->segments ? s->segments : SIMPLIFY_SEGMENTS))
		return 0;
	r = simplify_manifest(next, "all", segments, n, next->at.lines, err);
	if (!r)
		r = simplify_rewrite(next, "all", simplify_name(name, "merged", next->at.attempt, next->at.round, 0), true,
				     segments, err);
	*ret_n = 1;
	return r;
}

/* The grid of the next round, from that of this one and what it added. */
static int add_segment(const struct simplify *s, struct simplify *next, struct grid_segment_info *added, struct err *err)
{
	struct grid_segment_info *segments = malloc((SIMPLIFY_SEGMENTS + 1) * sizeof *segments);
	size_t n;
	int r;

	if (!segments)
		return err_set(err, ERR_NOMEM, "no memory for the points of a round");
	r = next_segments(s, next, added, segments, &n, err);
	if (!r)
		r = write_chosen(next, segments, n, err);
	free(segments);
	return r;
}

int simplify_end_round(const struct simplify *s, struct simplify *next, struct err *err)
{
	struct grid_segment_info added;
	struct simplify_found found = {.tests = 0};
	char name[GRID_NAME_MAX];
	int r = collect(s, simplify_name(name, "added", s->at.attempt, s->at.round + 1, 0), &added, &found, err);

	if (r)
		return r;
	next->at.tested += found.tests;
	next->at.far = found.far;
	if (!added.points)
		return end_all(next, err);
	next->at.round++;
	next->at.rounds++;
	r = write_fresh(next, &added, &next->at.added, err);
	next->at.chosen += next->at.added;
	if (r || (s->p.max_points && next->at.chosen > s->p.max_points))
		return r ? r : end_attempt(next, err);
	r = add_segment(s, next, &added, err);
	if (r)
		return r;
	return found.is & SIMPLIFY_CLOSED ? end_all(next, err) : begin_round(next, err);
}
