/*
 * Grids with lines: which records are of line vertices, which are marked, in scans and cells, against brute force; contents and
 * sums with lines; opening without them, and for a selection.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "area.h"
#include "grid_fixture.h"
#include "ledger.h"
#include "lineset.h"
#include "repeat.h"

enum { POINTS = 6000, PIECES = 60, LINE_SOURCE = 4, RANGE = 400 };

static struct folder f;
static struct err err;

struct lines {
	struct lineset_piece piece[PIECES];
	size_t n;
	unsigned far;
};

static int make_folder(void **state)
{
	no_sync();
	f = folder_new();
	return 0;
}

static int remove_folder(void **state)
{
	folder_remove(&f);
	return 0;
}

/* ---- a dataset: survey points of three sources, and vertices of closed rings and lines ---- */

static int32_t draw(uint64_t *seed)
{
	return (int32_t)random_below(seed, RANGE) - RANGE / 2;
}

static void add_piece(struct lines *l, const int32_t a[2], const int32_t b[2], unsigned turns)
{
	bool less = a[0] < b[0] || (a[0] == b[0] && a[1] < b[1]);
	struct lineset_piece *p = &l->piece[l->n++];

	memcpy(p->a, less ? a : b, sizeof p->a);
	memcpy(p->b, less ? b : a, sizeof p->b);
	p->turns = turns;
}

/* Triangles, each in a square of its own, so that nothing is crossed. */
static void make_lines(struct lines *l, uint64_t *seed)
{
	*l = (struct lines){.far = random_below(seed, 2) ? LINESET_OUT : 0};
	for (int32_t i = 0; i < 16; i++) {
		int32_t at[3][2], x = i % 4 * 100 - 200, y = i / 4 * 100 - 200;
		unsigned turns = (unsigned)random_below(seed, 4);

		for (unsigned k = 0; k < 3; k++) {
			at[k][0] = x + (k == 1 ? 60 : 10) + (int32_t)random_below(seed, 30);
			at[k][1] = y + (k == 2 ? 60 : 10) + (int32_t)random_below(seed, 30);
		}
		for (unsigned k = 0; k < 3; k++)
			add_piece(l, at[k], at[(k + 1) % 3], turns);
	}
}

/* Many positions twice, many on lines. */
static struct set make_set(const struct lines *l, uint64_t *seed)
{
	struct set s = {.pts = calloc(POINTS + 2 * PIECES, sizeof *s.pts), .ids = calloc(POINTS + 2 * PIECES, sizeof *s.ids)};

	for (; s.n < POINTS; s.n++) {
		const struct lineset_piece *p = &l->piece[random_below(seed, l->n)];
		bool on = random_below(seed, 20) == 0;

		s.pts[s.n] = (struct point){.x = on ? p->a[0] : draw(seed),
					    .y = on ? p->a[1] : draw(seed),
					    .z = draw(seed),
					    .cls = 2,
					    .tag = (uint16_t)random_below(seed, 16)};
		s.ids[s.n] = 1 + (uint32_t)random_below(seed, 3);
	}
	for (size_t i = 0; i < 2 * l->n; i++) {
		const int32_t *at = i % 2 ? l->piece[i / 2].b : l->piece[i / 2].a;

		s.pts[s.n] = (struct point){.x = at[0], .y = at[1], .z = (int32_t)i};
		s.ids[s.n++] = LINE_SOURCE;
	}
	return s;
}

static const struct grid_lines totals = {.lines = 16, .vertices = 48, .bytes = 4096};

/* Each source in a segment, or all in one. */
static void write_set(const struct set *s, const struct lines *l, unsigned segments, const char *name)
{
	static unsigned made;
	struct grid_segment_info info[4];
	struct grid_manifest m;
	struct lineset_piece copy[PIECES];

	for (unsigned i = 0; i < segments; i++) {
		struct set part = {.pts = calloc(s->n, sizeof *part.pts), .ids = calloc(s->n, sizeof *part.ids)};
		char stem[32];

		for (size_t k = 0; k < s->n; k++) {
			if (s->ids[k] % segments != i)
				continue;
			part.pts[part.n] = s->pts[k];
			part.ids[part.n++] = s->ids[k];
		}
		snprintf(stem, sizeof stem, "seg%u", made++);
		CHECK(stage_set(&f, stem, &part, 0, &info[i], &err));
		set_free(&part);
	}
	m = manifest_of(info, segments, LINE_SOURCE);
	m.sources[LINE_SOURCE - 1].kind = GRID_LINE_VERTICES;
	m.sources[LINE_SOURCE - 1].name = "";
	m.sources[LINE_SOURCE - 1].lines = &totals;
	manifest_count(&m, s);
	CHECK(grid_manifest_write(f.fd, name, &m, &err));
	free(m.sources);
	memcpy(copy, l->piece, sizeof copy);
	CHECK(lineset_write(f.fd, "lineset-4", copy, l->n, l->far, &err));
}

static struct reader open_with(const char *name, const struct grid_use *use)
{
	struct reader r;

	err = ERR_INIT;
	CHECK(grid_open_use(f.fd, name, GRID_NEWEST, use, NULL, 1 << 20, &r.grid, &err));
	r.memory = malloc(grid_reader_bytes(r.grid));
	CHECK(grid_reader_new(r.grid, r.memory, grid_reader_bytes(r.grid), &r.r, &err));
	return r;
}

/* ---- brute force ---- */

static unsigned mark_of(const struct lines *l, const struct point *p, int64_t clear)
{
	unsigned state = l->far;

	for (size_t i = 0; i < l->n; i++) {
		const int32_t *a = l->piece[i].a, *b = l->piece[i].b, *low = a[1] <= b[1] ? a : b, *high = a[1] <= b[1] ? b : a;
		int64_t dx = b[0] - a[0], dy = b[1] - a[1], x = p->x - a[0], y = p->y - a[1], along = x * dx + y * dy;
		int64_t length = dx * dx + dy * dy, across = x * dy - y * dx, bx = p->x - b[0], by = p->y - b[1];
		bool crosses = false;

		if (along >= 0 && along <= length ? across * across <= clear * clear * length :
						    x * x + y * y <= clear * clear || bx * bx + by * by <= clear * clear)
			return POINT_NEAR_LINE;
		area_edge_holds(low[0], low[1], high[0], high[1], p->x, p->y, &crosses);
		state ^= crosses ? l->piece[i].turns : 0;
	}
	return state ? POINT_IN_AREA : 0;
}

/* The records that shall be read, with their marks, in order. */
static struct set expected(const struct set *s, const struct lines *l, const struct grid_use *use)
{
	struct set e = {.pts = calloc(s->n, sizeof *e.pts), .ids = calloc(s->n, sizeof *e.ids)};

	for (size_t i = 0; i < s->n; i++) {
		struct point p = s->pts[i];

		if (s->ids[i] == LINE_SOURCE && use->no_lines)
			continue;
		if (s->ids[i] == LINE_SOURCE)
			p.tag |= POINT_LINE;
		else if (!use->no_lines && !use->lines)
			p.tag |= (uint16_t)mark_of(l, &p, use->clear);
		e.pts[e.n] = p;
		e.ids[e.n++] = 1;
	}
	set_sort(&e);
	return e;
}

static int by_all(const void *a, const void *b)
{
	const struct point *p = a, *q = b;
	int r = point_compare(p, q);

	return r ? r : memcmp(p, q, sizeof *p);
}

static int gather_cell(void *ctx, const struct grid_cell *cell)
{
	void *const *to = ctx;

	return grid_cell_read(to[0], cell, gather_sink, to[1], &err);
}

static void check_records(const struct set *s, const struct lines *l, const struct grid_use *use, const char *name)
{
	struct set want = expected(s, l, use);
	struct reader r = open_with(name, use);
	struct gather scan = {0}, cells = {0};
	void *to[2] = {r.r, &cells};
	const struct grid_visitor v = {.ctx = to, .cell = gather_cell};

	CHECK(grid_scan(r.r, 0, UINT64_MAX, gather_sink, &scan, &err));
	CHECK(grid_walk(r.r, 0, UINT64_MAX, &v, &err));
	assert_int_equal(scan.n, want.n);
	assert_int_equal(cells.n, want.n);
	assert_int_equal(grid_points(r.grid), want.n);
	qsort(want.pts, want.n, sizeof *want.pts, by_all);
	qsort(scan.pts, scan.n, sizeof *scan.pts, by_all);
	qsort(cells.pts, cells.n, sizeof *cells.pts, by_all);
	assert_memory_equal(scan.pts, want.pts, want.n * sizeof *want.pts);
	assert_memory_equal(cells.pts, want.pts, want.n * sizeof *want.pts);
	free(scan.pts);
	free(cells.pts);
	set_free(&want);
	reader_close(&r);
}

static void test_marks(void **state)
{
	uint64_t first = repeat_first();

	for (uint64_t i = first; i < first + repeat_cases(40); i++) {
		uint64_t seed = i;
		struct lines l;
		struct set s;

		make_lines(&l, &seed);
		s = make_set(&l, &seed);
		write_set(&s, &l, 1 + i % 4, "m");
		check_records(&s, &l, &(struct grid_use){.clear = 0}, "m");
		check_records(&s, &l, &(struct grid_use){.clear = (int64_t)(1 + i % 9)}, "m");
		check_records(&s, &l, &(struct grid_use){.no_lines = true}, "m");
		check_records(&s, &l, &(struct grid_use){.lines = "lineset-4", .linesfd = f.fd}, "m");
		set_free(&s);
	}
}

/* ---- contents and sums ---- */

static struct digest content_of(const char *name, const struct grid_use *use)
{
	struct reader r = open_with(name, use);
	struct digest d = grid_content(r.grid);

	reader_close(&r);
	return d;
}

static struct digest sum_of(const char *name, const struct grid_use *use, int32_t x, int32_t y, int32_t side)
{
	struct reader r = open_with(name, use);
	struct digest d;

	CHECK(grid_sum(r.r, point_morton(x, y), point_morton(x + side - 1, y + side - 1), &d, &err));
	reader_close(&r);
	return d;
}

/* The same lines and records have the same content, however divided. Other lines have another one, also if all records are the
 * same, and so have the sums near them, and no others. */
static void test_contents(void **state)
{
	const struct grid_use use = {0}, none = {.no_lines = true}, wide = {.clear = 200};
	uint64_t seed = 77;
	struct lines l, other;
	struct set s;
	struct digest with, without, near, far, wider;

	do
		make_lines(&l, &seed);
	while (l.far || l.piece[0].turns);
	for (size_t i = 3; i < l.n; i++)
		l.piece[i].turns = 0;
	s = make_set(&l, &seed);
	write_set(&s, &l, 1, "m");
	with = content_of("m", &use);
	without = content_of("m", &none);
	near = sum_of("m", &use, -192, -192, 64);
	far = sum_of("m", &use, 128, 128, 64);
	wider = sum_of("m", &wide, -64, -192, 64);
	assert_false(digest_equal(with, without));
	write_set(&s, &l, 4, "m");
	assert_true(digest_equal(with, content_of("m", &use)));
	assert_true(digest_equal(without, content_of("m", &none)));
	assert_true(digest_equal(near, sum_of("m", &use, -192, -192, 64)));
	other = l;
	for (size_t i = 0; i < 3; i++)
		other.piece[i].turns = LINESET_LAKE;
	write_set(&s, &other, 4, "m");
	assert_false(digest_equal(with, content_of("m", &use)));
	assert_true(digest_equal(without, content_of("m", &none)));
	assert_false(digest_equal(near, sum_of("m", &use, -192, -192, 64)));
	assert_true(digest_equal(far, sum_of("m", &use, 128, 128, 64)));
	/* The first ring is beyond that range, but within the clearance. */
	assert_false(digest_equal(wider, sum_of("m", &wide, -64, -192, 64)));
	assert_true(digest_equal(
		sum_of("m", &none, -192, -192, 64),
		sum_of("m", &(struct grid_use){.lines = "lineset-4", .linesfd = f.fd, .no_lines = true}, -192, -192, 64)));
	set_free(&s);
}

/* ---- opening ---- */

static void test_opening(void **state)
{
	struct ledger *ledger = ledger_new(1 << 24);
	struct reader r;
	struct grid *g;
	uint64_t seed = 5;
	struct lines l;
	struct set s;

	make_lines(&l, &seed);
	s = make_set(&l, &seed);
	write_set(&s, &l, 2, "m");
	CHECK(grid_open(f.fd, "m", GRID_NEWEST, ledger, 1 << 16, &g, &err));
	assert_non_null(grid_lines(g));
	assert_int_equal(grid_charged(g), ledger_held(ledger, LEDGER_INDEX));
	assert_false(digest_is_zero(grid_lines_content(g)));
	grid_close(g);
	assert_int_equal(ledger_held(ledger, LEDGER_INDEX), 0);
	r = open_with("m", &(struct grid_use){.no_lines = true});
	assert_null(grid_lines(r.grid));
	assert_null(grid_reader_lines(r.r));
	assert_true(digest_is_zero(grid_lines_content(r.grid)));
	reader_close(&r);
	unlinkat(f.fd, "lineset-4", 0);
	assert_int_equal(grid_open(f.fd, "m", GRID_NEWEST, ledger, 1 << 16, &g, &err), -ERR_CORRUPT);
	assert_string_equal(err.file, "lineset-4");
	ledger_free(ledger);
	set_free(&s);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_marks),
		cmocka_unit_test(test_contents),
		cmocka_unit_test(test_opening),
	};

	return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
