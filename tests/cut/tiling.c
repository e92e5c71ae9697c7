#include "tiling.h"

#include "cut_valid.h"
#include "err.h"

static size_t lower(const struct point *p, size_t n, uint64_t key)
{
	size_t lo = 0, hi = n;

	while (lo < hi) {
		size_t mid = lo + (hi - lo) / 2;

		if (point_morton(p[mid].x, p[mid].y) < key)
			lo = mid + 1;
		else
			hi = mid;
	}
	return lo;
}

static void make_cell(const struct point *p, size_t n, uint64_t lo, uint64_t hi, unsigned segment, size_t place,
		      struct grid_cell *ret)
{
	*ret = (struct grid_cell){
		.lo = lo, .hi = hi, .count = n, .segment = segment, .place = place, .blocks = 1, .box = {p->x, p->y, p->x, p->y}};
	for (size_t i = 0; i < n; i++) {
		ret->box[0] = p[i].x < ret->box[0] ? p[i].x : ret->box[0];
		ret->box[1] = p[i].y < ret->box[1] ? p[i].y : ret->box[1];
		ret->box[2] = p[i].x > ret->box[2] ? p[i].x : ret->box[2];
		ret->box[3] = p[i].y > ret->box[3] ? p[i].y : ret->box[3];
		ret->distinct += i == 0 || p[i].x != p[i - 1].x || p[i].y != p[i - 1].y;
	}
}

struct walk {
	const struct tiling *t;
	const struct grid_visitor *v;
	uint64_t lo, hi;
	unsigned segment;
};

static int walk_node(const struct walk *w, size_t from, size_t to, uint64_t lo, uint64_t hi)
{
	const struct point *p = w->t->pts[w->segment];
	uint64_t state = w->t->salt ^ lo * 3 ^ hi * 5 ^ w->segment, dice, mid;
	struct grid_cell cell;
	size_t cut;
	int rc;

	if (from == to || hi < w->lo || lo > w->hi)
		return 0;
	dice = random_next(&state);
	if (lo == hi || to - from <= w->t->cell_records || (to - from <= 4 * w->t->cell_records && dice % 4 == 0)) {
		make_cell(p + from, to - from, lo, hi, w->segment, from, &cell);
		return w->v->cell(w->v->ctx, &cell);
	}
	if (dice % 3 == 0 && w->v->enter) {
		make_cell(p + from, to - from, lo, hi, w->segment, from, &cell);
		if (!w->v->enter(w->v->ctx, &cell))
			return 0;
	}
	mid = lo + (hi - lo) / 2;
	cut = from + lower(p + from, to - from, mid + 1);
	rc = walk_node(w, from, cut, lo, mid);
	return rc ? rc : walk_node(w, cut, to, mid + 1, hi);
}

static int tiling_walk(void *ctx, uint64_t lo, uint64_t hi, const struct grid_visitor *v, struct err *err)
{
	const struct tiling *t = ctx;

	for (unsigned s = 0; s < t->segments; s++) {
		const struct walk w = {t, v, lo, hi, s};

		struct grid_cell whole = {.segment = s};

		if (t->n[s])
			make_cell(t->pts[s], t->n[s], 0, 0, s, 0, &whole);
		whole.lo = point_morton(whole.box[0], whole.box[1]);
		whole.hi = point_morton(whole.box[2], whole.box[3]);
		if (v->segment && !v->segment(v->ctx, &whole))
			continue;
		int rc = walk_node(&w, 0, t->n[s], 0, UINT64_MAX);

		if (rc)
			return rc;
	}
	return 0;
}

static bool live(const struct tiling *t, unsigned segment, size_t i)
{
	return !t->dead[segment] || !t->dead[segment][i];
}

static int hand_out(const struct tiling *t, unsigned segment, size_t from, size_t n, grid_points_fn fn, void *sink,
		    struct err *err)
{
	const struct point *p = t->pts[segment];
	const size_t most = t->salt % 2 ? 7 : GRID_CELL_RECORDS; /* at the same time */

	for (size_t i = from, end = from + n; i < end;) {
		size_t k = i;
		int rc;

		while (k < end && k < i + most && live(t, segment, k))
			k++;
		rc = k > i ? fn(sink, p + i, k - i, err) : 0;
		if (rc)
			return rc;
		i = k < end && !live(t, segment, k) ? k + 1 : k;
	}
	return 0;
}

static int tiling_read(void *ctx, const struct grid_cell *cell, grid_points_fn fn, void *sink, struct err *err)
{
	struct tiling *t = ctx;

	t->reads++;
	t->read_points += cell->count;
	return hand_out(t, cell->segment, cell->place, cell->count, fn, sink, err);
}

static int tiling_scan(void *ctx, uint64_t lo, uint64_t hi, grid_points_fn fn, void *sink, struct err *err)
{
	const struct tiling *t = ctx;
	size_t at[TILING_SEGMENTS];

	for (unsigned s = 0; s < t->segments; s++)
		at[s] = lower(t->pts[s], t->n[s], lo);
	for (;;) {
		const struct point *best = NULL;
		unsigned from = 0;
		int rc;

		for (unsigned s = 0; s < t->segments; s++) {
			const struct point *p;

			while (at[s] < t->n[s] && !live(t, s, at[s]))
				at[s]++;
			p = t->pts[s] + at[s];
			if (at[s] < t->n[s] && point_morton(p->x, p->y) <= hi && (!best || point_compare(p, best) < 0)) {
				best = p;
				from = s;
			}
		}
		if (!best)
			return 0;
		at[from]++;
		rc = fn(sink, best, 1, err);
		if (rc)
			return rc;
	}
}

static int tiling_count(void *ctx, uint64_t lo, uint64_t hi, uint64_t *ret_count, bool *ret_exact, struct err *err)
{
	const struct tiling *t = ctx;

	*ret_count = 0;
	*ret_exact = true;
	for (unsigned s = 0; s < t->segments; s++) {
		size_t end = hi == UINT64_MAX ? t->n[s] : lower(t->pts[s], t->n[s], hi + 1);

		*ret_count += end - lower(t->pts[s], t->n[s], lo);
		*ret_exact = *ret_exact && !t->dead[s];
	}
	return 0;
}

static bool tiling_all_live(void *ctx)
{
	const struct tiling *t = ctx;
	bool all = true;

	for (unsigned s = 0; s < t->segments; s++)
		all = all && !t->dead[s];
	return all;
}

static int tiling_sums(void *ctx, struct grid_sum *range, size_t n, struct err *err)
{
	const struct tiling *t = ctx;

	for (size_t k = 0; k < n; k++) {
		range[k].sum = (struct digest){0, 0};
		for (unsigned s = 0; s < t->segments; s++)
			for (size_t i = lower(t->pts[s], t->n[s], range[k].lo); i < t->n[s]; i++) {
				if (point_morton(t->pts[s][i].x, t->pts[s][i].y) > range[k].hi)
					break;
				if (live(t, s, i))
					digest_add(&range[k].sum, digest_hash(&t->pts[s][i], sizeof(struct point)));
			}
	}
	return 0;
}

static size_t tiling_parts(void *ctx, struct cut_live_part *ret, struct cut_segment *ret_segment, size_t most)
{
	const struct tiling *t = ctx;
	size_t n = 0;

	for (unsigned s = 0; s < t->segments; s++) {
		struct cut_segment segment = {.number = s, .box = {INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN}};
		struct cut_live_part part = {0};

		for (size_t i = 0; i < t->n[s]; i++)
			if (live(t, s, i)) {
				const int32_t at[2] = {t->pts[s][i].x, t->pts[s][i].y};

				for (unsigned k = 0; k < 2; k++) {
					segment.box[k] = at[k] < segment.box[k] ? at[k] : segment.box[k];
					segment.box[k + 2] = at[k] > segment.box[k + 2] ? at[k] : segment.box[k + 2];
				}
				digest_add(&part.sum, digest_hash(&t->pts[s][i], sizeof(struct point)));
				part.points++;
			}
		if (!part.points)
			continue;
		if (n < most) {
			ret[n] = part;
			ret_segment[n] = segment;
		}
		n++;
	}
	return n;
}

static bool tiling_box(void *ctx, int32_t ret_box[4])
{
	const struct tiling *t = ctx;
	bool any = false;

	for (unsigned s = 0; s < t->segments; s++)
		for (size_t i = 0; i < t->n[s]; i++) {
			const int32_t at[2] = {t->pts[s][i].x, t->pts[s][i].y};

			for (unsigned k = 0; k < 2; k++) {
				ret_box[k] = any && ret_box[k] < at[k] ? ret_box[k] : at[k];
				ret_box[2 + k] = any && ret_box[2 + k] > at[k] ? ret_box[2 + k] : at[k];
			}
			any = true;
		}
	return any;
}

void tiling_source(struct tiling *t, struct cut_source *ret)
{
	ret->ctx = t;
	ret->walk = tiling_walk;
	ret->read = tiling_read;
	ret->scan = tiling_scan;
	ret->count = tiling_count;
	ret->all_live = tiling_all_live;
	ret->sums = tiling_sums;
	ret->box = tiling_box;
	ret->parts = tiling_parts;
	ret->line_sum = NULL;
	ret->lines = NULL;
	ret->ledger = NULL;
}
