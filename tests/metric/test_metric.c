/*
 * The mesh of a view with a metric, from points in a dataset on disk: selection, plan, domains, emission. Against brute force:
 * the triangles are those whose ellipse is empty of all positions, in integers, with ties by the order of the mapped positions;
 * each belongs to the region of its block; vertices, heights, box and digests are those of the lattice. Any load gives the same
 * mesh, and the verifier finds it good with the metric. Small coordinate ranges near any corner of the lattice, duplicates,
 * points on one line, views that crop or take some positions.
 *
 * ACUT_FUZZ_CASES sets the number of sets (default 1,500).
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "pipe.h"
#include "pipe_priv.h"
#include "repeat.h"
#include "selection_fixture.h"
#include "tri.h"
#include "verify.h"

enum { POINTS = 60, TRIANGLES = 4 * POINTS, CAP = 1 << 15 };

static uint64_t case_seed;
static uint64_t nplain, ntriangles, nregions, nties, norigins;

/* ---- the expected mesh ---- */

struct want {
	int64_t xy[POINTS][2], uv[POINTS][2];
	int32_t z[POINTS];
	unsigned n;
	int32_t triangle[TRIANGLES][6];
	unsigned ntriangle;
};

static int64_t turn(const int64_t a[2], const int64_t b[2], const int64_t c[2])
{
	return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

static bool later(const int64_t a[2], const int64_t b[2])
{
	return a[0] > b[0] || (a[0] == b[0] && a[1] > b[1]);
}

/* Whether d is in the ellipse through a, b, c. The form of the metric takes the place of x^2 + y^2 in the plane of the lattice;
 * the order of the mapped positions decides ties (algorithm.md 1). */
static bool in_ellipse(const struct want *w, const struct view_metric *m, unsigned a, unsigned b, unsigned c, unsigned d)
{
	const unsigned at[3] = {a, b, c};
	__int128 x[3], y[3], form[3], s;
	unsigned h;

	for (unsigned i = 0; i < 3; i++) {
		x[i] = w->xy[at[i]][0] - w->xy[d][0];
		y[i] = w->xy[at[i]][1] - w->xy[d][1];
		form[i] = (m->p * x[i] + m->q * y[i]) * (m->p * x[i] + m->q * y[i]) +
			  m->k * m->k * (m->p * y[i] - m->q * x[i]) * (m->p * y[i] - m->q * x[i]);
	}
	s = form[0] * (x[1] * y[2] - x[2] * y[1]) + form[1] * (x[2] * y[0] - x[0] * y[2]) + form[2] * (x[0] * y[1] - x[1] * y[0]);
	if (s)
		return s > 0;
	nties++;
	h = later(w->uv[a], w->uv[b]) ? a : b;
	h = later(w->uv[c], w->uv[h]) ? c : h;
	if (later(w->uv[d], w->uv[h]))
		return false;
	return (h == c ? turn(w->xy[a], w->xy[b], w->xy[d]) :
		h == b ? turn(w->xy[a], w->xy[d], w->xy[c]) :
			 turn(w->xy[d], w->xy[b], w->xy[c])) > 0;
}

/* The smallest corner first. */
static void normalize(int32_t c[6])
{
	while (c[0] > c[2] || (c[0] == c[2] && c[1] > c[3]) || c[0] > c[4] || (c[0] == c[4] && c[1] > c[5])) {
		int32_t x = c[0], y = c[1];

		memmove(c, c + 2, 4 * sizeof *c);
		c[4] = x;
		c[5] = y;
	}
}

static int by_corners(const void *a, const void *b)
{
	return memcmp(a, b, 6 * sizeof(int32_t));
}

static void triangulate(struct want *w, const struct view_metric *m)
{
	w->ntriangle = 0;
	for (unsigned a = 0; a < w->n; a++)
		for (unsigned b = a + 1; b < w->n; b++)
			for (unsigned c = a + 1; c < w->n; c++) {
				bool empty = b != c && turn(w->xy[a], w->xy[b], w->xy[c]) > 0;

				for (unsigned d = 0; d < w->n && empty; d++)
					empty = d == a || d == b || d == c || !in_ellipse(w, m, a, b, c, d);
				if (!empty)
					continue;
				const unsigned at[3] = {a, b, c};

				assert_true(w->ntriangle < TRIANGLES);
				for (unsigned k = 0; k < 3; k++) {
					w->triangle[w->ntriangle][2 * k] = (int32_t)w->xy[at[k]][0];
					w->triangle[w->ntriangle][2 * k + 1] = (int32_t)w->xy[at[k]][1];
				}
				normalize(w->triangle[w->ntriangle++]);
			}
	qsort(w->triangle, w->ntriangle, sizeof w->triangle[0], by_corners);
}

/* The positions that the view keeps, each with its lowest point. */
static void expected(struct want *w, const struct set *s, const struct view *v)
{
	w->n = 0;
	for (size_t i = 0; i < s->n; i++) {
		const struct point *p = &s->pts[i];
		unsigned k = 0;

		if (view_judge(v, p) != VIEW_KEPT)
			continue;
		while (k < w->n && (w->xy[k][0] != p->x || w->xy[k][1] != p->y))
			k++;
		if (k == w->n) {
			w->xy[k][0] = p->x;
			w->xy[k][1] = p->y;
			w->uv[k][0] = v->metric.p * p->x + v->metric.q * p->y;
			w->uv[k][1] = v->metric.k * (v->metric.p * p->y - v->metric.q * p->x);
			w->z[w->n++] = p->z;
		}
		w->z[k] = p->z < w->z[k] ? p->z : w->z[k];
	}
	triangulate(w, &v->metric);
}

/* ---- the mesh ---- */

struct mesh {
	int32_t vertex[POINTS][3];
	uint32_t triangle[TRIANGLES][3];
	int32_t corners[TRIANGLES][6];
	size_t nvertex, ntriangle;
	struct pipe_totals totals;
	const struct view_metric *metric;
};

static __int128 mapped(const struct mesh *m, unsigned axis, const int32_t *at)
{
	const struct view_metric *is = m->metric;

	return axis ? is->k * (is->p * (int64_t)at[1] - is->q * (int64_t)at[0]) : is->p * (int64_t)at[0] + is->q * (int64_t)at[1];
}

/* Where the circumcentre of the mapped triangle is: below, -1, or above, 1, a border of an axis (stream.md, "Changes"). */
static int side_of(const struct mesh *m, const int32_t *const t[3], unsigned axis, int64_t border)
{
	__int128 at[3][2], b[2], c[2], bb, cc, twice, over, n;
	unsigned first = 0;

	for (unsigned i = 0; i < 3; i++)
		for (unsigned k = 0; k < 2; k++)
			at[i][k] = mapped(m, k, t[i]);
	for (unsigned k = 0; k < 2; k++) {
		b[k] = at[1][k] - at[0][k];
		c[k] = at[2][k] - at[0][k];
	}
	bb = b[0] * b[0] + b[1] * b[1];
	cc = c[0] * c[0] + c[1] * c[1];
	twice = b[0] * c[1] - b[1] * c[0];
	over = axis ? cc * b[0] - bb * c[0] : bb * c[1] - cc * b[1];
	n = over + twice * (2 * at[0][axis] - border);
	if (n)
		return n > 0 ? 1 : -1;
	for (unsigned from = 0; from < 2; from++) {
		/* p is the greatest corner, then the greatest of the others. */
		unsigned p = 3;

		for (unsigned i = 0; i < 3; i++)
			if ((from == 0 || i != first) &&
			    (p == 3 || at[i][0] > at[p][0] || (at[i][0] == at[p][0] && at[i][1] > at[p][1])))
				p = i;
		const __int128 *q = at[(p + 1) % 3], *r = at[(p + 2) % 3];

		if (!axis && q[1] != r[1])
			return q[1] > r[1] ? 1 : -1;
		if (axis && q[0] != r[0])
			return q[0] < r[0] ? 1 : -1;
		first = p;
	}
	fail_msg("a triangle on a border is on neither side");
	return 0;
}

static void check_region(const struct mesh *m, const struct mesh_block *b, const int32_t *const t[3])
{
	for (unsigned i = 0; i < 4; i++) {
		if (b->box[i] == INT64_MIN || b->box[i] == INT64_MAX)
			continue;
		if (side_of(m, t, i & 1, b->box[i]) != (i < 2 ? 1 : -1))
			fail_msg("case %llu: a triangle is not in the region of its block", (unsigned long long)case_seed);
	}
}

static int collect(void *ctx, const struct mesh_block *b, struct err *err)
{
	struct mesh *m = ctx;

	(void)err;
	nregions++;
	for (uint32_t i = 0; i < b->nnew; i++, m->nvertex++) {
		assert_true(m->nvertex < POINTS);
		m->vertex[m->nvertex][0] = b->vertex[i].x;
		m->vertex[m->nvertex][1] = b->vertex[i].y;
		m->vertex[m->nvertex][2] = b->vertex[i].z;
	}
	for (uint32_t i = 0; i < b->ntriangle; i++, m->ntriangle++) {
		const int32_t *t[3];

		assert_true(m->ntriangle < TRIANGLES);
		for (unsigned k = 0; k < 3; k++) {
			uint32_t c = b->triangle[i][k],
				 v = (uint32_t)(c < b->nforeign ? b->foreign[c] : b->first + c - b->nforeign);

			m->triangle[m->ntriangle][k] = v;
			t[k] = m->vertex[v];
			memcpy(&m->corners[m->ntriangle][2 * k], t[k], 2 * sizeof(int32_t));
		}
		check_region(m, b, t);
		normalize(m->corners[m->ntriangle]);
	}
	return 0;
}

static void run_leaves(const struct grid *grid, const struct view *view, struct cut_plan *plan, const struct pipe_budget *budget,
		       struct grid_reader *reader, struct pipe_emitter *emitter[2], struct mesh *m)
{
	struct mesh_sink sink = {m, collect};
	void *memory = aligned_alloc(64, (budget->domain_bytes + 63) & ~(size_t)63);
	struct err err = ERR_INIT;

	for (size_t i = 0; i < plan->n;) {
		struct pipe_known known = {.flat = plan->leaf[i].flat};
		struct mesh_domain domain;
		uint64_t need;
		int r = pipe_domain(grid, view, &plan->leaf[i].region, &known, budget, memory, &domain, &need, &err);

		if (r == PIPE_E_SPLIT) {
			CHECK(cut_plan_split(plan, i, reader, need, budget->cap, &err));
			continue;
		}
		CHECK(r);
		CHECK(pipe_emit(emitter[1], &domain, &plan->leaf[i].region, NULL, &err));
		CHECK(pipe_emit(emitter[0], &domain, &plan->leaf[i].region, &sink, &err));
		i++;
	}
	free(memory);
}

static void mesh_make(const struct folder *f, struct reader *r, const struct view *view, uint32_t load, struct mesh *m)
{
	struct pipe_budget budget = {
		.load = load, .cap = CAP, .threads = 1, .domain_bytes = pipe_domain_bytes(CAP, grid_reader_bytes(r->grid))};
	struct pipe_emitter *emitter[2];
	struct pipe_totals sums;
	struct cut_plan plan = {0};
	struct mesh_counts counts;
	struct err err = ERR_INIT;
	bool flat;

	*m = (struct mesh){.metric = &view->metric};
	for (unsigned i = 0; i < 2; i++) {
		CHECK(pipe_emitter_new(&grid_manifest(r->grid)->lattice, 1 << 17, f->fd, &emitter[i], &err));
		pipe_emitter_map(emitter[i], view);
	}
	pipe_emitter_sums(emitter[1], true);
	CHECK(cut_plan_make(r->r, load, &plan, &err));
	CHECK(pipe_flat_scan(r->r, view, &flat, &counts, &err));
	if (flat)
		cut_plan_make_flat(&plan);
	run_leaves(r->grid, view, &plan, &budget, r->r, emitter, m);
	CHECK(pipe_emitter_finish(emitter[0], &m->totals, &err));
	CHECK(pipe_emitter_finish(emitter[1], &sums, &err));
	assert_memory_equal(&sums, &m->totals, sizeof sums);
	for (unsigned i = 0; i < 2; i++)
		pipe_emitter_free(emitter[i]);
	cut_plan_done(&plan);
	qsort(m->corners, m->ntriangle, sizeof m->corners[0], by_corners);
}

/* ---- comparing ---- */

static void check_digests(const struct mesh *m, const int64_t k[3])
{
	struct digest triangles = {0}, vertices = {0};

	for (size_t i = 0; i < m->nvertex; i++)
		digest_add_vertex(&vertices, m->vertex[i][0] + k[0], m->vertex[i][1] + k[1], m->vertex[i][2] + k[2]);
	for (size_t i = 0; i < m->ntriangle; i++) {
		int64_t corner[3][2];

		for (unsigned c = 0; c < 6; c++)
			corner[c / 2][c % 2] = m->corners[i][c] + k[c % 2];
		digest_add_triangle(&triangles, (const int64_t(*)[2])corner);
	}
	assert_true(digest_equal(triangles, m->totals.digest));
	assert_true(digest_equal(vertices, m->totals.vertex_digest));
}

static void check_vertices(const struct mesh *m, const struct want *w)
{
	int32_t box[6] = {INT32_MAX, INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN, INT32_MIN};

	assert_int_equal(m->nvertex, w->n);
	for (size_t i = 0; i < m->nvertex; i++) {
		unsigned k = 0;

		while (k < w->n && (w->xy[k][0] != m->vertex[i][0] || w->xy[k][1] != m->vertex[i][1]))
			k++;
		if (k == w->n || w->z[k] != m->vertex[i][2])
			fail_msg("case %llu: vertex %d %d %d is no point", (unsigned long long)case_seed, m->vertex[i][0],
				 m->vertex[i][1], m->vertex[i][2]);
		for (unsigned c = 0; c < 3; c++) {
			box[c] = m->vertex[i][c] < box[c] ? m->vertex[i][c] : box[c];
			box[3 + c] = m->vertex[i][c] > box[3 + c] ? m->vertex[i][c] : box[3 + c];
		}
	}
	if (m->nvertex)
		assert_memory_equal(box, m->totals.box, sizeof box);
}

static void check_verified(const struct mesh *m)
{
	struct verify_mesh mesh = {.vertex = (const int32_t(*)[3])m->vertex,
				   .triangle = (const uint32_t(*)[3])m->triangle,
				   .nvertex = m->nvertex,
				   .ntriangle = m->ntriangle,
				   .p = m->metric->p,
				   .q = m->metric->q,
				   .k = m->metric->k};
	struct verify_report report;
	struct err err = ERR_INIT;

	CHECK(verify_mesh(&mesh, &report, &err));
	if (report.fault)
		fail_msg("case %llu: %s", (unsigned long long)case_seed, report.text);
	mesh.k = 0;
	CHECK(verify_mesh(&mesh, &report, &err));
	nplain += report.fault == VERIFY_GOOD && m->ntriangle > 2;
}

static void check_mesh(const struct mesh *m, const struct want *w, const int64_t k[3])
{
	if (m->ntriangle != w->ntriangle || memcmp(m->corners, w->triangle, w->ntriangle * sizeof w->triangle[0]))
		fail_msg("case %llu: %zu triangles, not these %u", (unsigned long long)case_seed, m->ntriangle, w->ntriangle);
	check_vertices(m, w);
	check_digests(m, k);
	check_verified(m);
}

/* The position that most of the kept points share: of several the first as they are mapped. */
static void check_most(const struct mesh *m, const struct set *s, const struct view *v)
{
	const struct lattice l = {.scale_xy = {1, -2}, .k = {v->k[0], v->k[1]}};
	uint64_t most = 0;
	struct point best = {0};

	for (size_t i = 0; i < s->n; i++) {
		const struct point *p = &s->pts[i];
		uint64_t here = 0;

		for (size_t k = 0; k < s->n; k++)
			here += s->pts[k].x == p->x && s->pts[k].y == p->y && view_judge(v, &s->pts[k]) == VIEW_KEPT;
		const int64_t uv[2][2] = {{mapped(m, 0, &p->x), mapped(m, 1, &p->x)},
					  {mapped(m, 0, &best.x), mapped(m, 1, &best.x)}};

		if (here < 2 || view_judge(v, p) != VIEW_KEPT || here < most || (here == most && !later(uv[1], uv[0])))
			continue;
		most = here;
		best = *p;
	}
	assert_int_equal(m->totals.counts.most.points, most);
	if (!most)
		return;
	assert_true(m->totals.most_at[0] == lattice_coordinate(&l, 0, best.x));
	assert_true(m->totals.most_at[1] == lattice_coordinate(&l, 1, best.y));
}

/* ---- cases ---- */

static struct set random_points(unsigned sources)
{
	static const int32_t corner[] = {INT32_MIN, -1000000000, 0, 0, 0, INT32_MAX - 400};
	int32_t x0 = corner[rnd(6)], y0 = corner[rnd(6)], side = rnd(3) ? 1 + (int32_t)rnd(7) : 1 + (int32_t)rnd(400);
	bool line = rnd(8) == 0;
	struct set s = {.n = 1 + rnd(rnd(3) ? 24 : POINTS)};

	s.pts = calloc(s.n, sizeof *s.pts);
	s.ids = calloc(s.n, sizeof *s.ids);
	for (size_t i = 0; i < s.n; i++) {
		int32_t x = (int32_t)rnd((uint64_t)side), y = line ? side / 2 : (int32_t)rnd((uint64_t)side);

		s.pts[i] =
			(struct point){.x = x0 + x, .y = y0 + y, .z = (int32_t)rnd(9), .cls = (uint8_t)(1 + rnd(3)), .ret = 0x11};
		s.ids[i] = 1 + (uint32_t)rnd(sources);
	}
	return s;
}

static struct view random_metric_view(const struct set *s)
{
	int64_t most = rnd(4) ? 6 : rnd(2) ? 300 : VIEW_METRIC_MOST;
	struct view v = VIEW_INIT;

	v.metric = view_metric_normal((struct view_metric){(int64_t)rnd((uint64_t)(2 * most + 1)) - most,
							   1 + (int64_t)rnd((uint64_t)most),
							   2 + (int64_t)rnd((uint64_t)(rnd(2) ? 8 : most))});
	if (rnd(4) == 0)
		v.every = 2;
	if (rnd(4) == 0)
		v.has_zmax = true, v.zmax = 5;
	if (rnd(3) == 0) {
		const struct point *p = &s->pts[rnd(s->n)];

		v.crop = VIEW_CROP_BOX;
		for (unsigned i = 0; i < 4; i++)
			v.crop_box[i] = (i & 1 ? p->y : p->x) + (i < 2 ? -(int64_t)rnd(200) : (int64_t)rnd(200));
	}
	return v;
}

/* The view's numbers are absolute. */
static void shift_view(struct view *v, const int64_t k[3])
{
	v->zmax += k[2];
	for (unsigned i = 0; i < 4; i++)
		v->crop_box[i] += k[i & 1];
}

/* Whether the mapped points fit. */
static bool fits(const struct want *w)
{
	int64_t low, high;

	for (unsigned axis = 0; axis < 2; axis++) {
		low = high = w->n ? w->uv[0][axis] : 0;
		for (unsigned i = 1; i < w->n; i++) {
			low = w->uv[i][axis] < low ? w->uv[i][axis] : low;
			high = w->uv[i][axis] > high ? w->uv[i][axis] : high;
		}
		if (high - low > UINT32_MAX)
			return false;
	}
	return true;
}

static void check_counts(const struct selection_counts *c, const struct want *w)
{
	assert_true(c->mapped);
	norigins += c->origin[0] || c->origin[1];
	for (unsigned i = 0; i < 4 && w->n; i++) {
		int64_t side = w->xy[0][i & 1];

		for (unsigned k = 1; k < w->n; k++)
			side = (w->xy[k][i & 1] < side) == (i < 2) && w->xy[k][i & 1] != side ? w->xy[k][i & 1] : side;
		assert_int_equal(c->box[i], side);
	}
}

static void mesh_case(struct dataset *d, const struct set *s, struct view *v, const struct want *w)
{
	struct folder to = folder_new();
	struct selection_counts c = select_into(&to, d->reader.grid, v, selection_memory_min(d->reader.grid, v) + rnd(1 << 20));
	struct view rest = view_rest(v);
	struct reader r = reader_open(&to, SELECTION_MANIFEST, GRID_NEWEST, 1 << 20);
	struct mesh m;

	check_counts(&c, w);
	view_bind_map(&rest, c.origin);
	for (unsigned turn = 0; turn < 3; turn++) {
		mesh_make(&to, &r, &rest, turn == 0 ? 1 + (uint32_t)rnd(5) : turn == 1 ? 6 + (uint32_t)rnd(20) : 1000, &m);
		check_mesh(&m, w, d->m.lattice.k);
		check_most(&m, s, v);
	}
	ntriangles += w->ntriangle;
	reader_close(&r);
	folder_remove(&to);
}

static void one_case(uint64_t seed)
{
	static struct want w;
	unsigned sources = 1 + (unsigned)(seed % 3);
	struct dataset d;
	struct set s;
	struct view v;

	case_seed = seed;
	rng = seed * UINT64_C(0x2545f4914f6cdd1d);
	s = random_points(sources);
	v = random_metric_view(&s);
	d = dataset_of(&s, sources, 1 + (unsigned)rnd(2), false);
	shift_view(&v, d.m.lattice.k);
	view_bind(&v, &d.m.lattice);
	expected(&w, &s, &v);
	if (fits(&w))
		mesh_case(&d, &s, &v, &w);
	dataset_end(&d);
	set_free(&s);
}

static void test_fuzz(void **unused)
{
	uint64_t n = repeat_cases(1500), from = repeat_first();

	(void)unused;
	no_sync();
	for (uint64_t i = 0; i < n; i++)
		one_case(from + i);
	print_message(
		"%llu cases: %llu triangles, %llu ellipses with another position on them, %llu regions, %llu origins that are not "
		"zero, %llu meshes equal to plain ones\n",
		(unsigned long long)n, (unsigned long long)ntriangles, (unsigned long long)nties, (unsigned long long)nregions,
		(unsigned long long)norigins, (unsigned long long)nplain);
	if (n >= 1000)
		assert_true(nties > n / 2 && norigins > n / 2 && nregions > 6 * n && nplain < n / 3);
}

/* A selection of two points and one between them, by this metric; what refuses it. */
static int select_three(int32_t x, int32_t y, struct view_metric metric, struct err *err)
{
	struct point pts[] = {{0, 0, 1, 2, 0x11, 0}, {x, y, 2, 2, 0x11, 0}, {x / 2 + 1, y / 2, 3, 2, 0x11, 0}};
	uint32_t ids[] = {1, 1, 1};
	struct set s = {pts, ids, 3};
	struct dataset d = dataset_of(&s, 1, 1, false);
	struct view v = VIEW_INIT;
	struct folder to = folder_new();
	struct selection_params p = {.grid = d.reader.grid, .view = &v, .memory = 4 << 20, .dirfd = to.fd};
	struct selection_counts c = {0};
	int r;

	*err = ERR_INIT;
	view_bind(&v, &d.m.lattice);
	v.metric = metric;
	r = selection_make(&p, &c, err);
	assert_true(r || (c.mapped && c.kept == 3));
	folder_remove(&to);
	dataset_end(&d);
	return r;
}

/* A box of points may not fit although the points do, if they lie on its diagonal. If they do not fit, the error says what does.
 */
static void test_range(void **unused)
{
	struct err err;

	(void)unused;
	assert_int_equal(select_three(2000000000, 2000000000, (struct view_metric){1, 1, 1000}, &err), 0);
	assert_int_equal(select_three(2000000000, 2000000000, (struct view_metric){1, -1, 3}, &err), -ERR_LIMIT);
	assert_non_null(strstr(err.message, " 1 along the direction and 12000000000 across it"));
	assert_non_null(strstr(err.hint, "--crop"));
	assert_int_equal(select_three(2000000000, 1999000000, (struct view_metric){1, 1, 10000}, &err), -ERR_LIMIT);
	assert_string_equal(err.hint, "K is too large: --metric 1,1,4294 fits");
	assert_int_equal(select_three(2000000000, 1999000000, (struct view_metric){1, 1, 4294}, &err), 0);
	assert_int_equal(select_three(50000000, 3000000, (struct view_metric){997, 410, 7}, &err), -ERR_LIMIT);
	assert_string_equal(err.hint, "P and Q are too large: --metric 17,7,7 has nearly that direction, and fits");
	assert_int_equal(select_three(50000000, 3000000, (struct view_metric){17, 7, 7}, &err), 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_fuzz), cmocka_unit_test(test_range)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
