/*
 * Random windows: small point sets in random cells and segments, boxes and polygons of every kind, divided into pieces
 * by plans of random load and at random; half of them with pieces of lines. Together the pieces have exactly the triangles of the
 * whole mesh that meet the area, each once, with the heights of the whole mesh. The test finds these triangles by intersecting
 * segments and by a ray; the engine does not. A third has a metric: the engine gets mapped positions, while the area, and the
 * triangles that it gives, are in the plane before that. Of those without either half have weights; discs that are not
 * widened by the greatest weight are too small, which is tested as well.
 */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "brute.h"
#include "check.h"
#include "err.h"
#include "sets.h"
#include "view_area.h"
#include "window_area.h"
#include "repeat.h"
#include "tri_regular.h"

enum { MAX_TRIANGLES = 4 * BRUTE_POINTS, RINGS = 4, CORNERS = 7, CAP_MOST = 4096, PIECES = 40, PIECES_ROOM = 5 << 16 };

struct polygon {
	int64_t at[RINGS][CORNERS][2]; /* lattice numbers */
	unsigned n[RINGS], rings;
	bool shell[RINGS];
};

static struct sets set;
static struct mesh_vertex mapped[SETS_MAX_N]; /* set.pos, for the engine; without a metric the same */
static struct view view;
static struct polygon polygon;
static int32_t whole[MAX_TRIANGLES][6], want[MAX_TRIANGLES][6], got[2 * MAX_TRIANGLES][6];
static unsigned ngot;
static void *memory;
static struct lineset_piece line[PIECES];
static unsigned npiece;
static uint64_t lined, turned, weighted;
static int64_t most; /* no weight is greater */
static uint64_t cases, wanted, some, pieces, halvings, cells, all_cells, empties;

/* ---- the window ---- */

static int64_t near(uint64_t *seed, unsigned axis)
{
	int64_t low, high, span;

	if (set.n == 0)
		return (int64_t)sets_below(seed, 9) - 4;
	low = high = axis ? set.pos[0].y : set.pos[0].x;
	for (unsigned i = 1; i < set.n; i++) {
		int64_t v = axis ? set.pos[i].y : set.pos[i].x;

		low = v < low ? v : low;
		high = v > high ? v : high;
	}
	span = high - low;
	switch (sets_below(seed, 8)) {
	case 0: { /* of a point */
		const struct mesh_vertex *p = &set.pos[sets_below(seed, set.n)];

		return axis ? p->y : p->x;
	}
	case 1: /* outside, far or near */
		return sets_below(seed, 2) ? high + 1 + sets_below(seed, 4) : low - (INT64_C(1) << sets_below(seed, 42));
	case 2:
		return sets_below(seed, 2) ? low : high;
	default:
		return low + (int64_t)(random_next(seed) % (uint64_t)(span + 1));
	}
}

static void make_box(uint64_t *seed)
{
	view.window = VIEW_CROP_BOX;
	for (unsigned k = 0; k < 2; k++) {
		int64_t a = near(seed, k), b = sets_below(seed, 4) ? near(seed, k) : a + sets_below(seed, 3);

		view.window_box[k] = (a < b ? a : b) + view.k[k];
		view.window_box[2 + k] = (a < b ? b : a) + view.k[k];
	}
}

/* A hole that repeats corners until two are left is dropped. */
static void drop_hole(unsigned r)
{
	int64_t(*c)[2] = polygon.at[r];
	unsigned n = 0;

	for (unsigned i = 0; i < polygon.n[r]; i++)
		if (n == 0 || memcmp(c[i], c[n - 1], sizeof(c[i])))
			memmove(c[n++], c[i], sizeof(c[i]));
	while (n > 1 && !memcmp(c[0], c[n - 1], sizeof(c[0])))
		n--;
	polygon.n[r] = polygon.shell[r] || n >= 3 ? n : 0;
}

/* Rings of a few random corners: they cross themselves and each other, which the even-odd rule allows. */
static void make_polygon(uint64_t *seed)
{
	struct err err = ERR_INIT;
	struct view_area *a = view_area_new();

	assert_non_null(a);
	polygon.rings = 1 + sets_below(seed, RINGS);
	for (unsigned r = 0; r < polygon.rings; r++) {
		polygon.shell[r] = r == 0 || sets_below(seed, 2);
		polygon.n[r] = polygon.shell[r] ? 1 + sets_below(seed, CORNERS) : 3 + sets_below(seed, CORNERS - 2);
		assert_int_equal(view_area_ring(a, polygon.shell[r], &err), 0);
		for (unsigned i = 0; i < polygon.n[r]; i++) {
			for (unsigned k = 0; k < 2; k++)
				polygon.at[r][i][k] = near(seed, k);
			assert_int_equal(
				view_area_corner(a, polygon.at[r][i][0] + view.k[0], polygon.at[r][i][1] + view.k[1], &err), 0);
		}
		drop_hole(r);
	}
	assert_int_equal(view_area_end(a, &err), 0);
	view.window = VIEW_CROP_AREA;
	view.window_area = a;
	view_area_bounds(a, view.window_box);
}

/* ---- which triangles ---- */

typedef __int128 wide;

static int side(const int64_t a[2], const int64_t b[2], const int64_t p[2])
{
	wide v = (wide)(b[0] - a[0]) * (p[1] - a[1]) - (wide)(b[1] - a[1]) * (p[0] - a[0]);

	return (v > 0) - (v < 0);
}

static bool between(const int64_t a[2], const int64_t b[2], const int64_t p[2])
{
	for (unsigned k = 0; k < 2; k++)
		if ((p[k] < a[k] && p[k] < b[k]) || (p[k] > a[k] && p[k] > b[k]))
			return false;
	return true;
}

static bool crosses(const int64_t a[2], const int64_t b[2], const int64_t p[2], const int64_t q[2])
{
	int s = side(a, b, p), t = side(a, b, q), u = side(p, q, a), v = side(p, q, b);

	if (s * t < 0 && u * v < 0)
		return true;
	return (!s && between(a, b, p)) || (!t && between(a, b, q)) || (!u && between(p, q, a)) || (!v && between(p, q, b));
}

static bool in_triangle(const int64_t t[3][2], const int64_t p[2])
{
	return side(t[0], t[1], p) >= 0 && side(t[1], t[2], p) >= 0 && side(t[2], t[0], p) >= 0;
}

/* On the ring's edge: 2; else whether a ray leaves it an odd number of times. */
static int ring_has(unsigned r, const int64_t p[2])
{
	int odd = 0;

	for (unsigned i = 0; i < polygon.n[r]; i++) {
		const int64_t *a = polygon.at[r][i], *b = polygon.at[r][(i + 1) % polygon.n[r]];

		if (!side(a, b, p) && between(a, b, p))
			return 2;
		if ((a[1] > p[1]) != (b[1] > p[1]))
			odd ^= (side(a, b, p) > 0) == (b[1] > a[1]);
	}
	return odd;
}

static bool polygon_has(const int64_t p[2])
{
	bool in = false, any = false;

	for (unsigned r = 0; r < polygon.rings; r++) {
		int has = ring_has(r, p);

		if (polygon.shell[r]) {
			any = any || in;
			in = has != 0;
		} else {
			in = in && has != 1;
		}
	}
	return any || in;
}

static bool meets(const int32_t c[6])
{
	int64_t t[3][2];

	for (unsigned i = 0; i < 6; i++)
		t[i / 2][i % 2] = c[i];
	if (view.window == VIEW_CROP_BOX) {
		polygon = (struct polygon){.rings = 1, .n = {4}, .shell = {true}};
		for (unsigned i = 0; i < 4; i++) {
			polygon.at[0][i][0] = view.window_box[i == 1 || i == 2 ? 2 : 0] - view.k[0];
			polygon.at[0][i][1] = view.window_box[i >= 2 ? 3 : 1] - view.k[1];
		}
	}
	for (unsigned i = 0; i < 3; i++)
		if (polygon_has(t[i]))
			return true;
	for (unsigned r = 0; r < polygon.rings; r++) {
		for (unsigned i = 0; i < polygon.n[r]; i++) {
			const int64_t *a = polygon.at[r][i], *b = polygon.at[r][(i + 1) % polygon.n[r]];

			if (in_triangle((const int64_t(*)[2])t, a))
				return true;
			for (unsigned k = 0; k < 3; k++)
				if (crosses(a, b, t[k], t[(k + 1) % 3]))
					return true;
		}
	}
	return false;
}

/* ---- results ---- */

static int triangle_compare(const void *a, const void *b)
{
	return memcmp(a, b, 6 * sizeof(int32_t));
}

/* Counter-clockwise, the smallest corner first. */
static void normalize(int32_t c[6])
{
	while (c[0] > c[2] || (c[0] == c[2] && c[1] > c[3]) || c[0] > c[4] || (c[0] == c[4] && c[1] > c[5])) {
		int32_t x = c[0], y = c[1];

		memmove(c, c + 2, 4 * sizeof(*c));
		c[4] = x;
		c[5] = y;
	}
}

static void take_block(const struct mesh_domain *d)
{
	for (uint32_t i = 0; i < d->nvertex && d->ntriangle; i++) {
		const struct mesh_vertex *v = &d->vertex[i];
		unsigned k = 0;

		while (k < set.n && (set.pos[k].x != v->x || set.pos[k].y != v->y))
			k++;
		assert_true(k < set.n);
		assert_int_equal(v->z, set.pos[k].z);
	}
	for (uint32_t i = 0; i < d->ntriangle; i++) {
		assert_true(ngot < 2 * MAX_TRIANGLES);
		for (unsigned k = 0; k < 3; k++) {
			got[ngot][2 * k] = d->vertex[d->triangle[i][k]].x;
			got[ngot][2 * k + 1] = d->vertex[d->triangle[i][k]].y;
		}
		normalize(got[ngot++]);
	}
}

static int find(void *ctx, const int32_t box[4], lineset_piece_fn fn, void *sink, struct err *err)
{
	(void)ctx;
	for (unsigned i = 0; i < npiece; i++) {
		const struct lineset_piece *p = &line[i];
		int32_t low = p->a[1] < p->b[1] ? p->a[1] : p->b[1], high = p->a[1] < p->b[1] ? p->b[1] : p->a[1];
		int rc = p->a[0] > box[2] || p->b[0] < box[0] || low > box[3] || high < box[1] ? 0 : fn(sink, p, err);

		if (rc)
			return rc;
	}
	return 0;
}

static const struct constrain_lines lines = {.find = find};

/* So small that a second try, a second reading, the inner box and single units decide. */
static struct window_limits draw_limits(uint64_t *seed)
{
	struct window_limits l = {.round = sets_below(seed, 2) ? 1 + sets_below(seed, 4) : 0};

	if (sets_below(seed, 4) == 0)
		return l;
	l.guess = sets_below(seed, 2) ? 1 + sets_below(seed, 16) : 0;
	l.inner = sets_below(seed, 2) ? 1 + sets_below(seed, 16) : 0;
	l.spacings = sets_below(seed, 4) ? (1 + sets_below(seed, 16)) / 16.0 : 0;
	l.squares = sets_below(seed, 2) ? WINDOW_RASTER : 0;
	return l;
}

/* A piece. If it does not fit, it is halved, or gets a larger arena if halving does not help. */
static void piece(uint64_t *seed, const struct cut_source *src, const struct cut_region *region, unsigned depth, uint32_t cap)
{
	struct err err = ERR_INIT;
	struct mesh_domain d;
	struct cut_region half[2];
	uint64_t need;
	const struct window_from from = {.src = src,
					 .lines = npiece ? &lines : NULL,
					 .view = &view,
					 .region = region,
					 .limits = draw_limits(seed),
					 .weights = {.most = most},
					 .cap = cap,
					 .memory = memory,
					 .room = npiece || view.nweight ? tri_bytes(cap) + PIECES_ROOM : tri_bytes(cap)};
	int r = window_domain_from(&from, view.k, &d, &need, &err);

	pieces++;
	if (!r) {
		take_block(&d);
		cells += d.counts.cells_read;
		return;
	}
	assert_int_equal(r, WINDOW_E_SPLIT);
	assert_true(need > cap || cap > 16);
	halvings++;
	if (depth == 4 || !cut_region_split(region, half)) {
		assert_true(2 * cap <= CAP_MOST);
		piece(seed, src, region, depth, 2 * cap);
		return;
	}
	for (unsigned k = 0; k < 2; k++) {
		struct window_piece w;
		int32_t data[4];

		assert_true(src->box(src->ctx, data));
		if (window_piece_init(&w, &view, data, &half[k]))
			window_piece_tighten(&w, &half[k]);
		piece(seed, src, &half[k], depth + 1, cap);
	}
}

static void by_plan(uint64_t *seed, const struct cut_source *src, uint32_t cap)
{
	struct err err = ERR_INIT;
	struct cut_plan plan;

	assert_int_equal(window_plan_from(src, &view, cap, (unsigned)sets_below(seed, 9), &plan, &err), 0);
	for (size_t i = 0; i < plan.n; i++)
		piece(seed, src, &plan.leaf[i].region, 0, cap);
	cut_plan_done(&plan);
}

/* Halves at random, mostly where the piece is. */
static void at_random(uint64_t *seed, const struct cut_source *src, const struct cut_region *region, unsigned depth, uint32_t cap)
{
	struct cut_region half[2];

	if (depth == 0 || sets_below(seed, 8) == 0 || !cut_region_split(region, half)) {
		piece(seed, src, region, 0, cap);
		return;
	}
	for (unsigned k = 0; k < 2; k++) {
		struct window_piece w;
		int32_t data[4];

		if (!src->box(src->ctx, data) || !window_piece_init(&w, &view, data, &half[k]))
			continue;
		if (sets_below(seed, 4))
			window_piece_tighten(&w, &half[k]);
		at_random(seed, src, &half[k], depth - 1, cap);
	}
}

static bool is_wanted(uint64_t *seed, const struct cut_source *src, unsigned n)
{
	uint32_t cap = sets_below(seed, 3) ? 256 : 8 + sets_below(seed, 24);
	const struct cut_region plane = window_piece_plane();

	ngot = 0;
	if (sets_below(seed, 2))
		by_plan(seed, src, cap);
	else
		at_random(seed, src, &plane, sets_below(seed, 6), cap);
	qsort(got, ngot, sizeof(got[0]), triangle_compare);
	return ngot == n && (!n || !memcmp(got, want, n * sizeof(want[0])));
}

static int count_cell(void *ctx, const struct grid_cell *cell)
{
	*(uint64_t *)ctx += cell->count > 0;
	return 0;
}

static uint64_t cells_of(const struct cut_source *src)
{
	uint64_t n = 0;
	const struct grid_visitor v = {.ctx = &n, .cell = count_cell};
	struct err err = ERR_INIT;

	assert_int_equal(src->walk(src->ctx, 0, UINT64_MAX, &v, &err), 0);
	return n;
}

/* ---- lines ---- */

/* Offers pieces to the mesh of all positions, and keeps those that it takes. 0: the positions are flat. */
static unsigned make_lines(uint64_t *seed)
{
	struct tri *t = set.n < 3 ? NULL : check_tri(mapped, set.n);
	unsigned tries = 1 + sets_below(seed, 2 * PIECES), n = 0;
	struct tri_pieces *p;
	struct tri_result r;

	npiece = 0;
	if (!t)
		return 0;
	p = check_pieces(t, 2 * set.n);
	for (; tries > 0 && npiece < PIECES; tries--) {
		const struct mesh_vertex *a = &mapped[sets_below(seed, set.n)], *b = &mapped[sets_below(seed, set.n)];
		const int32_t ends[2][2] = {{a->x, a->y}, {b->x, b->y}};
		bool swap = ends[1][0] < ends[0][0] || (ends[1][0] == ends[0][0] && ends[1][1] < ends[0][1]);
		uint32_t at;

		if (tri_piece_insert(p, (uint32_t)(a - mapped), (uint32_t)(b - mapped), &at))
			continue;
		memcpy(line[npiece].a, ends[swap], sizeof(ends[0]));
		memcpy(line[npiece++].b, ends[!swap], sizeof(ends[0]));
	}
	tri_result(t, &r);
	for (uint32_t i = 0; i < r.ntriangle; i++) {
		const uint32_t *c = r.triangle[i].corner;

		if (c[0] == TRI_GHOST || c[1] == TRI_GHOST || c[2] == TRI_GHOST)
			continue;
		for (unsigned k = 0; k < 3; k++)
			memcpy(&whole[n][2 * k], r.xy[c[k]], sizeof(r.xy[0]));
		normalize(whole[n++]);
	}
	free(p);
	free(t);
	lined += npiece > 0;
	return n;
}

/* ---- weights ---- */

/* The mesh of all positions. 0: they are flat. */
static unsigned make_weights(uint64_t *seed)
{
	int64_t weight[VIEW_WEIGHTS + 1];
	struct tri_regular r = {.tri = tri_init(memory, SETS_MAX_N), .weight = weight};
	uint8_t kind[SETS_MAX_N];
	struct tri_result t;
	unsigned n = 0;

	sets_weights(seed, &set, &view);
	most = view_weights(&view, weight);
	for (unsigned i = 0; i < set.n; i++)
		kind[i] = sets_weight_of(&set, &view, &set.pos[i]);
	memcpy(tri_input(r.tri), set.pos, set.n * sizeof *set.pos);
	if (tri_regular_run(&r, set.n, kind))
		return 0;
	tri_result(r.tri, &t);
	for (uint32_t i = 0; i < t.ntriangle; i++) {
		const uint32_t *c = t.triangle[i].corner;

		if (c[0] == TRI_GHOST || c[1] == TRI_GHOST || c[2] == TRI_GHOST)
			continue;
		for (unsigned k = 0; k < 3; k++)
			memcpy(&whole[n][2 * k], t.xy[c[k]], sizeof(t.xy[0]));
		normalize(whole[n++]);
	}
	weighted += view.nweight > 0;
	return n;
}

/* ---- metrics ---- */

static bool map_point(const struct view_metric *m, const int64_t from[2], int32_t *x, int32_t *y)
{
	int64_t at[2];

	view_metric_image(m, *x, *y, at);
	for (unsigned k = 0; k < 2; k++)
		if (at[k] - from[k] < INT32_MIN || at[k] - from[k] > INT32_MAX)
			return false;
	*x = (int32_t)(at[0] - from[0]);
	*y = (int32_t)(at[1] - from[1]);
	return true;
}

static int by_place(const void *a, const void *b)
{
	return point_compare(a, b);
}

/* Maps the records of the set, and its positions into `mapped`, if they fit: otherwise there is no metric. */
static void make_metric(uint64_t *seed)
{
	const int64_t from[2] = {(int64_t)sets_below(seed, 1000) - 500, (int64_t)sets_below(seed, 2) << 20};
	struct view_metric m = view_metric_normal((struct view_metric){(int64_t)sets_below(seed, 13) - 6, 1 + sets_below(seed, 5),
								       2 + sets_below(seed, sets_below(seed, 4) ? 5 : 200)});
	static struct sets to;
	bool fits = sets_below(seed, 3) == 0 && !view_selects(&view); /* a selection has no such rule left */

	memcpy(mapped, set.pos, sizeof(mapped));
	view.metric = (struct view_metric){0};
	view.map = (struct view_map){0};
	to = set;
	for (unsigned s = 0; s < to.segments; s++)
		for (size_t i = 0; i < to.nrecord[s]; i++)
			fits = fits && map_point(&m, from, &to.record[s][i].x, &to.record[s][i].y);
	if (!fits)
		return;
	turned++;
	memcpy(set.record, to.record, sizeof(set.record));
	for (unsigned s = 0; s < set.segments; s++)
		qsort(set.record[s], set.nrecord[s], sizeof(set.record[s][0]), by_place);
	for (unsigned i = 0; i < set.n; i++)
		assert_true(map_point(&m, from, &mapped[i].x, &mapped[i].y));
	view.metric = m;
	view_bind_map(&view, from);
}

static void map_back(int32_t c[6])
{
	for (unsigned i = 0; i < 6 && view.map.is.k; i += 2) {
		const int32_t at[2] = {c[i], c[i + 1]};

		view_map_back(&view.map, at, &c[i]);
	}
	normalize(c);
}

/* `narrow`: with weights, discs without them; false: something is wrong then. */
static bool one_case(uint64_t seed, bool narrow)
{
	bool right = true, heavy;
	struct cut_source src;
	struct tiling t;
	unsigned m, n = 0;

	sets_make(&seed, &set, &view);
	if (sets_below(&seed, 10) == 0)
		for (unsigned s = 0; s < set.segments; s++)
			set.nrecord[s] = set.nrecord[s] < 2 ? set.nrecord[s] : sets_below(&seed, 3);
	for (unsigned k = 0; k < 3; k++)
		view.k[k] = sets_below(&seed, 3) ? 0 : (int64_t)(random_next(&seed) >> 5) - (INT64_C(1) << 58);
	sets_reduce(&set, &view);
	heavy = sets_below(&seed, 3) == 0;
	most = 0;
	if (heavy || narrow)
		view.metric = (struct view_metric){0};
	else
		make_metric(&seed);
	sets_tiling(&seed, &set, &t);
	tiling_source(&t, &src);
	if (sets_below(&seed, 2))
		make_box(&seed);
	else
		make_polygon(&seed);
	npiece = 0;
	m = heavy || narrow ? make_weights(&seed) : sets_below(&seed, 2) ? make_lines(&seed) : 0;
	if (narrow)
		most = 0;
	if (!m && !heavy && !narrow) {
		npiece = 0;
		m = brute_triangles(mapped, set.n, whole);
	}
	for (unsigned i = 0; i < m; i++)
		map_back(whole[i]);
	for (unsigned i = 0; i < m; i++)
		if (meets(whole[i]))
			memcpy(want[n++], whole[i], sizeof(whole[i]));
	qsort(want, n, sizeof(want[0]), triangle_compare);
	for (unsigned k = 0; k < 2; k++) {
		/* Twice, divided differently. */
		right = is_wanted(&seed, &src, n) && right;
		all_cells += cells_of(&src);
	}
	view_done(&view);
	cases++;
	wanted += n;
	some += n > 0 && n < m;
	empties += n == 0 && m > 0;
	return right;
}

static void fuzz(void **state)
{
	uint64_t n = repeat_cases(20000), from = repeat_first();

	(void)state;
	for (uint64_t i = 0; i < n; i++) {
		if (getenv("ACUT_FUZZ_TRACE"))
			fprintf(stderr, "case %llu\n", (unsigned long long)(from + i));
		if (!one_case((from + i) * UINT64_C(0x2545f4914f6cdd1d), false))
			fail_msg("case %llu: the pieces are not what meets the window", (unsigned long long)(from + i));
	}
	print_message("%llu cases, %llu triangles, %llu windows of a part, %llu without any, %llu pieces, %llu halved, "
		      "%llu cells read of %llu; %llu with pieces of lines, %llu with a metric, %llu with weights\n",
		      (unsigned long long)cases, (unsigned long long)wanted, (unsigned long long)some,
		      (unsigned long long)empties, (unsigned long long)pieces, (unsigned long long)halvings,
		      (unsigned long long)cells, (unsigned long long)all_cells, (unsigned long long)lined,
		      (unsigned long long)turned, (unsigned long long)weighted);
	if (n >= 1000)
		assert_true(some > n / 10 && empties > 0 && halvings > 0 && pieces > 2 * n && lined > n / 5 && turned > n / 20 &&
			    weighted > n / 5);
}

/* The control. */
static void widening_matters(void **state)
{
	uint64_t wrong = 0;

	(void)state;
	for (uint64_t i = 1; i <= 2000; i++)
		wrong += !one_case(i * UINT64_C(0x2545f4914f6cdd1d), true);
	print_message("%llu of 2000 are wrong\n", (unsigned long long)wrong);
	assert_true(wrong > 20);
}

/* The window `view` in the positions of set.record[0]. */
static bool is_right(uint64_t *seed, struct window_limits limits)
{
	const struct cut_region plane = window_piece_plane();
	struct window_from from = {.view = &view, .region = &plane, .limits = limits, .cap = 256, .memory = memory};
	struct err err = ERR_INIT;
	struct cut_source src;
	struct mesh_domain d;
	struct tiling t;
	unsigned m, n = 0;
	uint64_t need;

	set.segments = 1;
	qsort(set.record[0], set.nrecord[0], sizeof(set.record[0][0]), by_place);
	sets_reduce(&set, &view);
	sets_tiling(seed, &set, &t);
	tiling_source(&t, &src);
	from.src = &src;
	from.room = tri_bytes(from.cap);
	m = brute_triangles(set.pos, set.n, whole);
	for (unsigned i = 0; i < m; i++) {
		normalize(whole[i]);
		if (meets(whole[i]))
			memcpy(want[n++], whole[i], sizeof(whole[i]));
	}
	qsort(want, n, sizeof(want[0]), triangle_compare);
	ngot = 0;
	assert_int_equal(window_domain_from(&from, view.k, &d, &need, &err), 0);
	take_block(&d);
	qsort(got, ngot, sizeof(got[0]), triangle_compare);
	return ngot == n && (!n || !memcmp(got, want, n * sizeof(want[0])));
}

/* A window in a few positions, close together or not, with an inner box so small that the points just outside decide. */
static bool close_case(uint64_t seed)
{
	const unsigned range = sets_below(&seed, 2) ? 3 + sets_below(&seed, 4) : 40 + sets_below(&seed, 200);
	const struct window_limits limits = {.inner = 1 + sets_below(&seed, 8),
					     .spacings = 0.01 + sets_below(&seed, 100) / (sets_below(&seed, 8) ? 100.0 : 10.0),
					     .squares = sets_below(&seed, 2) ? WINDOW_RASTER : 0};

	view = VIEW_INIT;
	memset(&set, 0, sizeof(set));
	set.nrecord[0] = 6 + sets_below(&seed, 25);
	for (size_t i = 0; i < set.nrecord[0]; i++)
		set.record[0][i] = (struct point){
			.x = (int32_t)sets_below(&seed, range), .y = (int32_t)sets_below(&seed, range), .ret = 0x11};
	view.window = VIEW_CROP_BOX;
	for (unsigned k = 0; k < 2; k++) {
		view.window_box[k] = sets_below(&seed, range);
		view.window_box[2 + k] = view.window_box[k] + sets_below(&seed, sets_below(&seed, 2) ? range : range / 4 + 1);
	}
	return is_right(&seed, limits);
}

/* Positions around an empty disc of radius 1000, and a window with the disc but for a twentieth to the right. There are positions
 * in that part, too: the disc of a triangle that they destroy is nearly in the inner box. */
static bool disc_case(uint64_t seed)
{
	const struct window_limits limits = {.inner = 1 << 10, .spacings = 0.001, .squares = WINDOW_RASTER};
	const int64_t border = 900 + sets_below(&seed, 90), box[4] = {-1050, -1050, border, 1050};

	view = VIEW_INIT;
	memset(&set, 0, sizeof(set));
	while (set.nrecord[0] < 30) {
		const int32_t x = (int32_t)sets_below(&seed, 2400) - 1200, y = (int32_t)sets_below(&seed, 2400) - 1200;
		const int32_t far = x * x + y * y;

		if (far > 1000 * 1000 ? far < 1050 * 1050 || x > border : x > border && set.nrecord[0] < 2)
			set.record[0][set.nrecord[0]++] = (struct point){.x = x, .y = y, .ret = 0x11};
	}
	view.window = VIEW_CROP_BOX;
	memcpy(view.window_box, box, sizeof(box));
	return is_right(&seed, limits);
}

static void close_points(void **state)
{
	(void)state;
	for (uint64_t i = 1; i <= 20000; i++)
		if (!close_case(i * UINT64_C(0x2545f4914f6cdd1d)))
			fail_msg("case %llu: not what meets the window", (unsigned long long)i);
}

static void beside_disc(void **state)
{
	(void)state;
	for (uint64_t i = 1; i <= 2000; i++)
		if (!disc_case(i * UINT64_C(0x2545f4914f6cdd1d)))
			fail_msg("case %llu: not what meets the window", (unsigned long long)i);
}

static int by_key(const void *a, const void *b)
{
	return point_compare(a, b);
}

/* A row with a large radius, and a window far beside it, with few positions around: all cells of the row lie there. */
static void too_many_matter(void **state)
{
	enum { ROW = 1500, FEW = 4, CAP = 1024 };
	static struct point pts[ROW + FEW];
	const struct cut_region plane = window_piece_plane();
	const int64_t box[4] = {-50000, 0, -49990, ROW};
	struct tiling t = {.pts = {pts}, .n = {ROW + FEW}, .segments = 1, .cell_records = 1};
	struct cut_source src;
	struct err err = ERR_INIT;
	struct mesh_domain d;
	uint64_t need;
	struct window_from from = {.src = &src, .view = &view, .region = &plane, .cap = CAP, .memory = memory};

	(void)state;
	for (int i = 0; i < ROW; i++)
		pts[i] = (struct point){.x = 6000, .y = i, .cls = 2, .ret = 0x11};
	for (int i = 0; i < FEW; i++)
		pts[ROW + i] = (struct point){.x = i / 2 ? 5000 : -1000000, .y = i % 2 * ROW, .ret = 0x11};
	qsort(pts, ROW + FEW, sizeof(*pts), by_key);
	tiling_source(&t, &src);
	view = VIEW_INIT;
	assert_true(view_weight_set(&view, 2, 100000));
	view.window = VIEW_CROP_BOX;
	memcpy(view.window_box, box, sizeof(box));
	from.weights.most = INT64_C(100000) * 100000;
	from.room = tri_bytes(CAP) + PIECES_ROOM;
	assert_int_equal(window_domain_from(&from, view.k, &d, &need, &err), -ERR_LIMIT);
	assert_non_null(strstr(err.message, "because of the radii of --weight"));
	from.cap = 2 * CAP;
	from.room = tri_bytes(2 * CAP) + PIECES_ROOM;
	err = ERR_INIT;
	assert_int_equal(window_domain_from(&from, view.k, &d, &need, &err), 0);
	assert_true(d.ntriangle > ROW - 10);
}

static int set_up(void **state)
{
	(void)state;
	memory = aligned_alloc(64, (tri_bytes(CAP_MOST) + window_area_tables(CAP_MOST) + PIECES_ROOM + 4096) & ~(size_t)63);
	return memory ? 0 : -1;
}

static int tear_down(void **state)
{
	(void)state;
	free(memory);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(close_points), cmocka_unit_test(beside_disc), cmocka_unit_test(fuzz),
					   cmocka_unit_test(widening_matters), cmocka_unit_test(too_many_matter)};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
