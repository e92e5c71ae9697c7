/*
 * Selections of datasets with lines: vertices of lines are kept but for the crop, never thinned, and are a source of their own;
 * what lines remove is not selected, and counted. Against a sort over the whole set; the marks are those that the grid gives
 * (tests/grid).
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "lineset.h"
#include "repeat.h"
#include "selection_fixture.h"

enum { POINTS = 3000, LINES = 25, LINE_SOURCE = 3, SIDE = 500 };

static struct err err;

/* ---- a dataset ---- */

static const struct grid_lines totals = {.lines = LINES, .vertices = 3 * LINES, .bytes = 4096};

/* Triangles in squares of their own; some are lakes. */
static size_t make_lines(struct lineset_piece *piece)
{
	size_t n = 0;

	for (int32_t i = 0; i < LINES; i++) {
		int32_t at[3][2];
		unsigned turns = (unsigned)rnd(2) * LINESET_LAKE;

		for (unsigned k = 0; k < 3; k++) {
			at[k][0] = i % 5 * 100 + (k == 1 ? 60 : 10) + (int32_t)rnd(30);
			at[k][1] = i / 5 * 100 + (k == 2 ? 60 : 10) + (int32_t)rnd(30);
		}
		for (unsigned k = 0; k < 3; k++) {
			const int32_t *a = at[k], *b = at[(k + 1) % 3];
			bool less = a[0] < b[0] || (a[0] == b[0] && a[1] < b[1]);
			struct lineset_piece *p = &piece[n++];

			memcpy(p->a, less ? a : b, sizeof p->a);
			memcpy(p->b, less ? b : a, sizeof p->b);
			p->turns = turns;
		}
	}
	return n;
}

static struct set make_set(const struct lineset_piece *piece, size_t n)
{
	struct set s = survey(POINTS, SIDE, 50);

	s.pts = realloc(s.pts, (s.n + n) * sizeof *s.pts);
	s.ids = realloc(s.ids, (s.n + n) * sizeof *s.ids);
	for (size_t i = 0; i < s.n; i++)
		s.ids[i] = 1 + (uint32_t)rnd(2);
	for (size_t i = 0; i < n; i += 3)
		for (unsigned k = 0; k < 3; k++) {
			const int32_t *at = k < 2 ? piece[i + k].a : piece[i + k].b;

			s.pts[s.n] = (struct point){.x = at[0], .y = at[1], .z = (int32_t)rnd(100)};
			s.ids[s.n++] = LINE_SOURCE;
		}
	return s;
}

static void write_dataset(const struct folder *f, const struct set *s, struct lineset_piece *piece, size_t n, unsigned segments)
{
	struct grid_segment_info info[3];
	struct grid_manifest m;

	stage_sources(f, s, segments, info);
	m = manifest_of(info, segments, LINE_SOURCE);
	m.sources[LINE_SOURCE - 1].kind = GRID_LINE_VERTICES;
	m.sources[LINE_SOURCE - 1].name = "";
	m.sources[LINE_SOURCE - 1].lines = &totals;
	manifest_count(&m, s);
	CHECK(grid_manifest_write(f->fd, "m", &m, &err));
	free(m.sources);
	CHECK(lineset_write(f->fd, "lineset-3", piece, n, 0, &err));
}

static struct reader open_with(const struct folder *f, const char *name, const struct grid_use *use)
{
	struct reader r;

	CHECK(grid_open_use(f->fd, name, GRID_NEWEST, use, NULL, 1 << 20, &r.grid, &err));
	r.memory = malloc(grid_reader_bytes(r.grid));
	CHECK(grid_reader_new(r.grid, r.memory, grid_reader_bytes(r.grid), &r.r, &err));
	return r;
}

static struct gather all_of(struct reader *r)
{
	struct gather g = {0};

	CHECK(grid_scan(r->r, 0, UINT64_MAX, gather_sink, &g, &err));
	return g;
}

/* ---- the expected result ---- */

static const struct view *sorting;

static int by_cell_and_rank(const void *a, const void *b)
{
	const struct point *p = a, *q = b;
	int64_t x[2], y[2];
	bool line = p->tag & POINT_LINE, other = q->tag & POINT_LINE;

	if (line || other)
		return line && other ? point_compare(p, q) : other - line;
	if (sorting->thin.cell) {
		view_thin_cell(sorting, p, x);
		view_thin_cell(sorting, q, y);
		for (unsigned k = 0; k < 2; k++)
			if (x[k] != y[k])
				return x[k] < y[k] ? -1 : 1;
	}
	return view_thin_compare(&sorting->thin, p, q);
}

static bool one_cell(const struct view *v, const struct point *p, const struct point *q)
{
	int64_t x[2], y[2];

	if (!v->thin.cell || (p->tag & POINT_LINE) || (q->tag & POINT_LINE))
		return false;
	view_thin_cell(v, p, x);
	view_thin_cell(v, q, y);
	return x[0] == y[0] && x[1] == y[1];
}

static int by_all(const void *a, const void *b)
{
	int r = point_compare(a, b);

	return r ? r : memcmp(a, b, sizeof(struct point));
}

static size_t brute(const struct gather *all, const struct view *v, struct point *out, struct selection_counts *ret)
{
	struct point *p = calloc(all->n + 1, sizeof *p);
	size_t n = 0, kept = 0, group;

	*ret = (struct selection_counts){.points = all->n};
	for (size_t i = 0; i < all->n; i++) {
		enum view_rule rule = view_judge(v, &all->pts[i]);

		if (rule == VIEW_KEPT)
			p[n++] = all->pts[i];
		else
			ret->removed[rule]++;
	}
	sorting = v;
	qsort(p, n, sizeof *p, by_cell_and_rank);
	for (size_t i = 0; i < n; i += group) {
		for (group = 1; i + group < n && one_cell(v, &p[i], &p[i + group]); group++)
			;
		out[kept++] = p[v->thin.pick == VIEW_PICK_MEDIAN ? i + (group - 1) / 2 : i];
		ret->removed[VIEW_BY_THIN] += group - 1;
	}
	ret->kept = kept;
	qsort(out, kept, sizeof *out, by_all);
	free(p);
	return kept;
}

/* ---- cases ---- */

static struct view random_view(const struct lattice *lattice)
{
	struct view v = VIEW_INIT;

	view_bind(&v, lattice);
	if (rnd(2)) {
		v.crop = VIEW_CROP_BOX;
		for (unsigned k = 0; k < 2; k++) {
			v.crop_box[k] = v.k[k] + (int64_t)rnd(SIDE / 2);
			v.crop_box[k + 2] = v.crop_box[k] + (int64_t)rnd(SIDE);
		}
	}
	if (rnd(2))
		v.every = 2 + rnd(5);
	if (rnd(2) || !view_selects(&v)) {
		v.thin.cell = 1 + (int64_t)rnd(rnd(2) ? 20 : 400);
		v.thin.pick = (uint8_t)rnd(3);
	}
	v.breakline_clear = (int64_t)rnd(6);
	v.no_breaklines = !v.breakline_clear && !rnd(4);
	return v;
}

static void one_case(uint64_t seed)
{
	struct lineset_piece piece[3 * LINES];
	struct folder f = folder_new(), to = folder_new();
	struct selection_counts want, got;
	struct grid_use use;
	struct reader r, selected;
	struct gather all, found;
	struct point *points;
	struct view v;
	struct set s;
	size_t n;

	rng = seed;
	err = ERR_INIT;
	n = make_lines(piece);
	s = make_set(piece, n);
	write_dataset(&f, &s, piece, n, 1 + (unsigned)rnd(3));
	r = open_with(&f, "m", NULL);
	v = random_view(&grid_manifest(r.grid)->lattice);
	reader_close(&r);
	use = (struct grid_use){.no_lines = v.no_breaklines, .clear = v.breakline_clear};
	r = open_with(&f, "m", &use);
	all = all_of(&r);
	points = calloc(all.n + 1, sizeof *points);
	n = brute(&all, &v, points, &want);
	got = select_into(&to, r.grid, &v, selection_memory_min(r.grid, &v) + (rnd(2) ? 0 : 1 << 20));
	assert_memory_equal(&got, &want, sizeof got);
	use = (struct grid_use){.no_lines = v.no_breaklines, .lines = "lineset-3", .linesfd = f.fd};
	selected = open_with(&to, SELECTION_MANIFEST, &use);
	found = all_of(&selected);
	qsort(found.pts, found.n, sizeof *found.pts, by_all);
	assert_int_equal(found.n, n);
	assert_memory_equal(found.pts, points, n * sizeof *points);
	for (size_t i = 0; i < n; i++)
		if (points[i].tag & POINT_LINE)
			assert_non_null(grid_lines(selected.grid));
	reader_close(&selected);
	reader_close(&r);
	free(found.pts);
	free(all.pts);
	free(points);
	set_free(&s);
	folder_remove(&f);
	folder_remove(&to);
}

static void test_random(void **state)
{
	uint64_t first = repeat_first();

	no_sync();
	for (uint64_t i = first; i < first + repeat_cases(200); i++)
		one_case(i);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_random)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
