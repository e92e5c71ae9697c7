/*
 * From round to round. The points chosen are a grid whose segments are the seeds, and what each round added; more than a few
 * segments become one. Each round that tests regions plans them. With max_points an error is an attempt: the seeds for it, and
 * rounds until none adds a point, or until there are too many.
 */
#include "simplify_round.h"

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "geom.h"
#include "io.h"
#include "pipe.h"
#include "simplify_region.h"
#include "simplify_seed.h"

enum { STARS = 128 }; /* of a task, if there are enough tasks */

/* ---- a new round ---- */

static int write_plan(const struct simplify *s, const struct cut_plan *plan, struct err *err)
{
	struct simplify_out *out = malloc(sizeof *out);
	char name[GRID_NAME_MAX];
	int r;

	if (!out)
		return err_set(err, ERR_NOMEM, "no memory for a plan");
	simplify_name(name, "plan", s->at.attempt, s->at.round, 0);
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
	const struct grid *grid = simplify_tested(next);
	size_t reader_bytes = grid_reader_bytes(grid);
	struct grid_reader *reader;
	struct cut_plan plan = {.ledger = NULL};
	uint32_t load = next->load ? next->load : SIMPLIFY_REGION;
	void *memory = malloc(reader_bytes);
	int r;

	if (!memory)
		return err_set(err, ERR_NOMEM, "no memory for a plan");
	r = grid_reader_new(grid, memory, reader_bytes, &reader, err);
	if (!r) {
		r = cut_plan_make(reader, load, &plan, err);
		grid_reader_free(reader);
	}
	if (!r)
		r = write_plan(next, &plan, err);
	next->at.regions = plan.n;
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
	if (!r && next->at.edges && !next->at.round)
		r = simplify_grid(next, simplify_name(name, "strip", next->at.attempt, 0, 0), &next->strip, err);
	if (!r && !next->at.stars)
		r = make_plan(next, err);
	if (next->at.stars) {
		uint64_t tasks = (next->at.stars + STARS - 1) / STARS;

		next->at.tasks = tasks < SIMPLIFY_PARTS ? tasks : SIMPLIFY_PARTS;
		return r;
	}
	next->at.tasks = next->at.regions;
	/* Settled triangles are not tested again in the first round. */
	if (next->at.round || !next->at.edges)
		next->at.far = next->at.lost = 0;
	return r;
}

/* ---- an attempt ---- */

static int begin_attempt(struct simplify *next, struct err *err)
{
	struct grid_segment_info segment;
	char name[GRID_NAME_MAX];
	int r;

	simplify_name(name, "seed", next->at.attempt, 0, 0);
	r = simplify_seed_grid(next, &next->at, name, &segment, err);
	if (r)
		return r;
	next->at.round = next->at.rounds = next->at.added = next->at.stars = 0;
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

/* The points of a file of a task. */
static int collect_task(const struct simplify *s, const char *what, uint32_t task, struct simplify_stage *to,
			struct simplify_found *ret, struct err *err)
{
	char name[GRID_NAME_MAX];
	struct point pts[256];
	struct simplify_in in;
	size_t n = 0;
	int r = simplify_in_begin(&in, s->p.dirfd, simplify_name(name, what, s->at.attempt, s->at.round, task), sizeof *pts, err);

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

/* Writes the points of all tasks as a segment. A point may be in it twice. Adds to *ret_all the tests, and the greatest error. */
static int collect(const struct simplify *s, const char *what, const char *segment, struct grid_segment_info *ret,
		   struct simplify_found *ret_all, struct err *err)
{
	struct simplify_stage *to = malloc(sizeof *to);
	struct simplify_found one;
	int r;

	if (!to)
		return err_set(err, ERR_NOMEM, "no memory for the points of a round");
	r = simplify_stage_begin(to, s, segment, true, s->p.memory - sizeof *to, err);
	for (uint32_t i = 0; !r && i < s->at.tasks; i++) {
		r = collect_task(s, what, i, to, &one, err);
		if (!r)
			r = simplify_cancelled(s, err);
		ret_all->tests += one.tests;
		ret_all->full |= one.full;
		if (one.far > ret_all->far) {
			ret_all->far = one.far;
			memcpy(ret_all->corner, one.corner, sizeof one.corner);
		}
	}
	if (!r)
		r = simplify_stage_end(to, ret, err);
	simplify_stage_abort(to);
	free(to);
	return r;
}

/* The positions of a segment. */
struct positions {
	struct simplify_out out; /* their keys */
	struct simplify_sink sink;
	uint64_t n;
	int32_t corner[3][2]; /* of the triangle of the greatest error; */
	bool any, gone;       /* there is one; a position is in its circle */
};

static int take_position(void *ctx, const struct point *p, struct err *err)
{
	struct positions *w = ctx;
	const int32_t at[2] = {p->x, p->y};
	uint64_t key = point_morton(p->x, p->y);
	bool corner = false;

	w->n++;
	for (unsigned k = 0; k < 3; k++)
		corner = corner || !memcmp(w->corner[k], at, sizeof at);
	if (w->any && !corner && geom_incircle(w->corner[0], w->corner[1], w->corner[2], at) > 0)
		w->gone = true;
	return simplify_out_add(&w->out, &key, 1, err);
}

static void set_corners(const struct simplify_where *at, struct positions *w)
{
	const uint64_t place[3] = {at->corner0, at->corner1, at->corner2};

	w->n = 0;
	w->gone = false;
	w->any = at->far;
	for (unsigned k = 0; k < 3; k++) {
		uint64_t plain = place[k] ^ UINT64_C(0x8000000080000000);

		w->corner[k][0] = (int32_t)(uint32_t)(plain >> 32);
		w->corner[k][1] = (int32_t)(uint32_t)plain;
	}
}

static int scan_segment(const struct simplify *next, struct grid_segment_info *segment, struct positions *w, struct err *err)
{
	struct grid_reader *reader;
	struct grid *grid = NULL;
	void *memory = NULL;
	int r = simplify_manifest(next, "added", segment, 1, 0, err);

	if (!r)
		r = simplify_grid(next, "added", &grid, err);
	if (!r && !(memory = malloc(grid_reader_bytes(grid))))
		r = err_set(err, ERR_NOMEM, "no memory for the points of a round");
	if (!r)
		r = grid_reader_new(grid, memory, grid_reader_bytes(grid), &reader, err);
	if (!r) {
		simplify_sink_init(&w->sink, next, &next->rest);
		w->sink.ctx = w;
		w->sink.point = take_position;
		r = simplify_scan(&w->sink, reader, 0, UINT64_MAX, err);
		grid_reader_free(reader);
	}
	grid_close(grid);
	free(memory);
	return r;
}

/* Writes the keys of a segment's positions into a file of this name; *ret: how many. Notes if the triangle of the greatest error
 * is gone. */
static int write_positions(struct simplify *next, struct grid_segment_info *segment, const char *what, uint64_t *ret,
			   struct err *err)
{
	struct positions *w = malloc(sizeof *w);
	char name[GRID_NAME_MAX];
	int r;

	if (!w)
		return err_set(err, ERR_NOMEM, "no memory for the points of a round");
	set_corners(&next->at, w);
	r = simplify_out_begin(&w->out, next->p.dirfd, simplify_name(name, what, next->at.attempt, next->at.round, 0),
			       sizeof(uint64_t), err);
	if (!r) {
		r = scan_segment(next, segment, w, err);
		*ret = w->n;
		if (!r)
			r = simplify_out_end(&w->out, NULL, err);
		simplify_out_abort(&w->out);
	}
	next->at.lost |= w->gone;
	free(w);
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
	if (added)
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

/* The positions around which the next round is to test: those that were added around stars; else those at the edges of regions.
 */
static int find_stars(const struct simplify *s, struct simplify *next, struct err *err)
{
	struct simplify_found unused = {.tests = 0};
	struct grid_segment_info edge;
	char name[GRID_NAME_MAX];
	int r;

	if (s->at.stars) {
		next->at.stars = next->at.added;
		return 0;
	}
	r = collect(s, "edge", simplify_name(name, "edges", s->at.attempt, next->at.round, 0), &edge, &unused, err);
	next->at.stars = 0;
	return r || !edge.points ? r : write_positions(next, &edge, "star", &next->at.stars, err);
}

static void note_far(struct simplify_where *at, const struct simplify_found *found)
{
	if (found->far < at->far || (found->far == at->far && !at->lost))
		return;
	at->far = found->far;
	at->corner0 = found->corner[0];
	at->corner1 = found->corner[1];
	at->corner2 = found->corner[2];
	at->lost = 0;
}

/* All regions are tested again if that is the only way to know the greatest error, or if something did not fit. */
static int next_round(struct simplify *next, bool again, struct err *err)
{
	if (!again && !next->at.stars && !next->at.lost)
		return end_all(next, err);
	if (again || !next->at.stars) {
		next->at.stars = 0;
		if (next->again)
			atomic_fetch_add(next->again, 1);
	}
	return begin_round(next, err);
}

int simplify_end_round(const struct simplify *s, struct simplify *next, struct err *err)
{
	struct grid_segment_info added;
	struct simplify_found found = {.tests = 0};
	char name[GRID_NAME_MAX];
	int r = collect(s, "bad", simplify_name(name, "added", s->at.attempt, s->at.round + 1, 0), &added, &found, err);

	if (r)
		return r;
	next->at.tested += found.tests;
	note_far(&next->at, &found);
	next->at.added = 0;
	if (!added.points && !next->at.lost && !found.full)
		return end_all(next, err);
	next->at.round++;
	next->at.rounds += added.points > 0;
	if (added.points)
		r = write_positions(next, &added, s->at.stars ? "star" : "fresh", &next->at.added, err);
	next->at.chosen += next->at.added;
	if (r || (s->p.max_points && next->at.chosen > s->p.max_points))
		return r ? r : end_attempt(next, err);
	r = add_segment(s, next, added.points ? &added : NULL, err);
	if (!r)
		r = find_stars(s, next, err);
	return r ? r : next_round(next, found.full, err);
}
