/*
 * Files of lines, and what all lines of a generation become: areas against brute force, any order of files and lines, heights,
 * counts, memory.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <fcntl.h>
#include <unistd.h>
#include <cmocka.h>

#include "area.h"
#include "breakline.h"
#include "err.h"
#include "io.h"
#include "lineset.h"
#include "no_sync.h"
#include "random.h"
#include "repeat.h"
#include "snap.h"

static char path[128];
static int dirfd = -1;
static struct err err;

static int make_folder(void **state)
{
	no_sync();
	repeat_folder(path, sizeof path, "breakline");
	dirfd = open(path, O_RDONLY | O_DIRECTORY);
	return dirfd < 0;
}

static int remove_folder(void **state)
{
	close(dirfd);
	return repeat_remove(path);
}

static void ok(int rc)
{
	if (rc)
		fail_msg("%d: %s", rc, err.message);
}

/* ---- features ---- */

enum { FEATURES = 8, LINES = 3, CORNERS = 7, FILES = 3 };

struct line {
	int32_t at[CORNERS][3];
	unsigned n;
	bool ring;
};

struct feature {
	enum breakline_kind kind;
	struct line line[LINES];
	unsigned n;
};

struct input {
	struct feature feature[FEATURES];
	unsigned n;
};

static void draw(struct input *in, uint64_t *seed, uint64_t range)
{
	in->n = 1 + (unsigned)random_below(seed, FEATURES);
	for (unsigned i = 0; i < in->n; i++) {
		struct feature *f = &in->feature[i];

		f->kind = (enum breakline_kind)random_below(seed, BREAKLINE_KINDS);
		/* With a boundary in most sets, only few would be seen without one. */
		if (f->kind == BREAKLINE_BOUNDARY && random_below(seed, 2))
			f->kind = BREAKLINE_LAKE;
		f->n = 1 + (unsigned)random_below(seed, LINES);
		for (unsigned k = 0; k < f->n; k++) {
			struct line *l = &f->line[k];

			l->ring = f->kind != BREAKLINE_HARD ? random_below(seed, 8) != 0 : random_below(seed, 8) == 0;
			l->n = 2 + (unsigned)random_below(seed, CORNERS - 1);
			for (unsigned c = 0; c < l->n; c++)
				for (unsigned a = 0; a < 3; a++)
					l->at[c][a] = (int32_t)((int64_t)random_below(seed, range) - (int64_t)(range / 2));
		}
	}
}

/* The same lines in another order, rings from another corner and in another direction. */
static struct input shuffled(const struct input *in, uint64_t *seed)
{
	struct input out = *in;

	for (unsigned i = out.n; i > 1; i--) {
		unsigned k = (unsigned)random_below(seed, i);
		struct feature swap = out.feature[k];

		out.feature[k] = out.feature[i - 1];
		out.feature[i - 1] = swap;
	}
	for (unsigned i = 0; i < out.n; i++)
		for (unsigned k = 0; k < out.feature[i].n; k++) {
			struct line *l = &out.feature[i].line[k], old = *l;
			unsigned from = l->ring ? (unsigned)random_below(seed, l->n) : 0;
			bool back = random_below(seed, 2);

			for (unsigned c = 0; c < l->n; c++)
				memcpy(l->at[c], old.at[(from + (back ? l->n - 1 - c : c)) % l->n], sizeof l->at[c]);
		}
	return out;
}

static const char *const NAME[FILES] = {"lines-1", "lines-2", "lines-3"};

static void write_feature(struct breakline_writer *w, const struct feature *f, uint32_t number)
{
	for (unsigned k = 0; k < f->n; k++)
		for (unsigned c = 0; c < f->line[k].n; c++) {
			const int32_t *at = f->line[k].at[c];
			unsigned bits = (k + c ? 0 : BREAKLINE_FEATURE) | (c ? 0 : BREAKLINE_LINE) |
					(!c && f->line[k].ring ? BREAKLINE_RING : 0);
			const struct breakline_vertex v = {.x = at[0],
							   .y = at[1],
							   .z = at[2],
							   .bits = (uint8_t)bits,
							   .kind = (uint8_t)f->kind,
							   .number = number};

			ok(breakline_write(w, &v, 1, &err));
		}
}

static void write_files(const struct input *in, uint64_t *seed)
{
	struct breakline_writer *w[FILES];
	struct breakline_totals t;

	for (unsigned i = 0; i < FILES; i++)
		ok(breakline_writer_new(dirfd, NAME[i], &w[i], &err));
	for (unsigned i = 0; i < in->n; i++)
		write_feature(w[random_below(seed, FILES)], &in->feature[i], i);
	for (unsigned i = 0; i < FILES; i++) {
		ok(breakline_writer_finish(w[i], &t, &err));
		breakline_writer_free(w[i]);
	}
}

/* ---- what is built ---- */

enum { MOST = 4000 };

struct built {
	struct point pts[MOST];
	size_t npts;
	struct lineset_piece piece[MOST];
	size_t npiece;
	struct breakline_counts counts;
	uint64_t events[BREAKLINE_EVENTS];
	struct lineset_info info;
	struct lineset *set;
	struct lineset_reader *reader;
	void *memory;
};

static int take_points(void *ctx, const struct point *pts, size_t n, struct err *e)
{
	struct built *b = ctx;

	assert_true(b->npts + n <= MOST);
	memcpy(b->pts + b->npts, pts, n * sizeof *pts);
	b->npts += n;
	return 0;
}

static int take_event(void *ctx, enum breakline_event event, int32_t x, int32_t y, int32_t lower, int32_t upper, struct err *e)
{
	struct built *b = ctx;

	assert_true(lower < upper || event == BREAKLINE_CROSSING);
	b->events[event]++;
	return 0;
}

static int take_piece(void *ctx, const struct lineset_piece *p, struct err *e)
{
	struct built *b = ctx;

	assert_true(b->npiece < MOST);
	b->piece[b->npiece++] = *p;
	return 0;
}

static void build(struct built *b, uint64_t memory)
{
	const int32_t all[4] = {INT32_MIN, INT32_MIN, INT32_MAX, INT32_MAX};
	const struct breakline_params p = {.dirfd = dirfd,
					   .file = NAME,
					   .nfiles = FILES,
					   .lineset = "lineset",
					   .memory = memory,
					   .vertices = take_points,
					   .event = take_event,
					   .ctx = b};

	*b = (struct built){.npts = 0};
	ok(breakline_build(&p, &b->counts, &err));
	ok(lineset_open(dirfd, "lineset", NULL, 0, &b->set, &err));
	b->info = *lineset_info(b->set);
	b->memory = malloc(lineset_reader_bytes());
	b->reader = lineset_reader_init(b->memory, b->set);
	ok(lineset_find(b->reader, all, take_piece, b, &err));
}

static void built_done(struct built *b)
{
	free(b->memory);
	lineset_close(b->set);
}

/* ---- brute force: the pieces of each feature by a snap rounding of its own, and even-odd for each position ---- */

struct brute {
	struct snap lines;
	enum breakline_kind kind[FEATURES];
	bool boundary;
};

static void brute_make(struct brute *b, const struct input *in)
{
	enum { N = FEATURES * LINES * CORNERS };
	struct mesh_vertex v[N];
	uint32_t segment[N][2], label[N], nv = 0, ns = 0;

	*b = (struct brute){.boundary = false};
	for (unsigned i = 0; i < in->n; i++) {
		const struct feature *f = &in->feature[i];

		b->kind[i] = f->kind;
		for (unsigned k = 0; k < f->n; k++) {
			const struct line *l = &f->line[k];

			b->boundary = b->boundary || (f->kind == BREAKLINE_BOUNDARY && l->ring);
			for (unsigned c = 0; c < l->n; c++) {
				v[nv + c] = (struct mesh_vertex){l->at[c][0], l->at[c][1], l->at[c][2]};
				if (c + 1 == l->n && !l->ring)
					continue;
				segment[ns][0] = nv + c;
				segment[ns][1] = c + 1 < l->n ? nv + c + 1 : nv;
				label[ns++] = l->ring && f->kind != BREAKLINE_HARD ? i + 1 : 0;
			}
			nv += l->n;
		}
	}
	ok(snap_round(v, nv, (const uint32_t(*)[2])segment, label, ns, 1 << 24, &b->lines, &err));
}

/* Of a position times `scale`. */
static unsigned brute_state(const struct brute *b, int64_t x, int64_t y, int64_t scale)
{
	bool in[FEATURES] = {false}, of[BREAKLINE_KINDS] = {false};

	for (uint32_t i = 0; i < b->lines.nalong; i++) {
		const uint32_t *end = b->lines.piece[b->lines.along[i][1]];
		const struct mesh_vertex *p = &b->lines.vertex[end[0]], *q = &b->lines.vertex[end[1]];
		const struct mesh_vertex *low = p->y <= q->y ? p : q, *high = p->y <= q->y ? q : p;

		area_edge_holds(scale * low->x, scale * low->y, scale * high->x, scale * high->y, x, y,
				&in[b->lines.along[i][0] - 1]);
	}
	for (unsigned i = 0; i < FEATURES; i++)
		of[b->kind[i]] = of[b->kind[i]] || in[i];
	if (of[BREAKLINE_HOLE] || (b->boundary && !of[BREAKLINE_BOUNDARY]))
		return LINESET_OUT;
	return of[BREAKLINE_LAKE] ? LINESET_LAKE : 0;
}

/* The states very near to the middle of a piece, on both sides. */
static void brute_sides(const struct brute *b, uint32_t i, unsigned state[2])
{
	const int64_t scale = 1 << 21;
	const struct mesh_vertex *p = &b->lines.vertex[b->lines.piece[i][0]], *q = &b->lines.vertex[b->lines.piece[i][1]];
	int64_t x = ((int64_t)p->x + q->x) * (scale / 2), y = ((int64_t)p->y + q->y) * (scale / 2);

	for (int k = 0; k < 2; k++) {
		int64_t way = k ? 8 : -8;

		state[k] = brute_state(b, x + way * (q->y - p->y), y - way * (q->x - p->x), scale);
	}
}

static bool piece_is(const struct lineset_piece *p, const struct mesh_vertex *a, const struct mesh_vertex *b)
{
	return p->a[0] == a->x && p->a[1] == a->y && p->b[0] == b->x && p->b[1] == b->y;
}

static void check_pieces(const struct brute *b, const struct built *m)
{
	size_t kept = 0, records = 0;
	bool used[MOST] = {false};

	for (uint32_t i = 0; i < b->lines.npiece; i++) {
		const uint32_t *end = b->lines.piece[i];
		unsigned state[2];
		size_t k = 0;

		brute_sides(b, i, state);
		while (k < m->npiece && !piece_is(&m->piece[k], &b->lines.vertex[end[0]], &b->lines.vertex[end[1]]))
			k++;
		if (state[0] & state[1] & LINESET_OUT) {
			assert_int_equal(k, m->npiece);
			continue;
		}
		assert_true(k < m->npiece);
		assert_int_equal(m->piece[k].turns, state[0] ^ state[1]);
		used[end[0]] = used[end[1]] = true;
		kept++;
	}
	assert_int_equal(kept, m->npiece);
	assert_int_equal(m->counts.pieces, kept);
	assert_int_equal(m->counts.left_out, b->lines.npiece - kept);
	for (uint32_t i = 0; i < b->lines.nvertex; i++)
		for (unsigned k = 0; used[i] && k < 1u + (b->lines.vertex[i].z != b->lines.highest[i]); k++, records++) {
			const struct point want = {.x = b->lines.vertex[i].x,
						   .y = b->lines.vertex[i].y,
						   .z = k ? b->lines.highest[i] : b->lines.vertex[i].z,
						   .tag = POINT_LINE};
			size_t at = 0;

			while (at < m->npts && memcmp(&m->pts[at], &want, sizeof want))
				at++;
			assert_true(at < m->npts);
		}
	assert_int_equal(records, m->npts);
	for (size_t i = 1; i < m->npts; i++)
		assert_true(point_compare(&m->pts[i - 1], &m->pts[i]) < 0);
}

static void check_states(const struct brute *b, const struct built *m, uint64_t *seed, uint64_t range)
{
	for (unsigned i = 0; i < 20; i++) {
		unsigned den = 1 + (unsigned)random_below(seed, 3), state;
		int64_t x = ((int64_t)random_below(seed, range + 2) - (int64_t)(range / 2) - 1) * den;
		int64_t y = ((int64_t)random_below(seed, range + 2) - (int64_t)(range / 2) - 1) * den;

		x += (int64_t)random_below(seed, den);
		y += (int64_t)random_below(seed, den);
		ok(lineset_state(m->reader, x, y, den, &state, &err));
		assert_int_equal(state, brute_state(b, x, y, den));
	}
}

static void compare(uint64_t seed, uint64_t range)
{
	static struct input in, other;
	static struct built one, two;
	struct brute b;

	err = ERR_INIT;
	draw(&in, &seed, range);
	write_files(&in, &seed);
	build(&one, 1 << 24);
	brute_make(&b, &in);
	if (range < 1000)
		check_pieces(&b, &one);
	check_states(&b, &one, &seed, range < 1000 ? range : range - 4);
	assert_int_equal(one.info.far, b.boundary ? LINESET_OUT : 0);
	assert_int_equal(one.events[BREAKLINE_CROSSING], b.lines.ncrossing);
	assert_int_equal(one.events[BREAKLINE_UNEVEN], b.lines.nuneven);
	other = shuffled(&in, &seed);
	write_files(&other, &seed);
	build(&two, 1 << 24);
	assert_true(digest_equal(one.info.content, two.info.content));
	assert_int_equal(one.npts, two.npts);
	assert_memory_equal(one.pts, two.pts, one.npts * sizeof *one.pts);
	assert_memory_equal(one.piece, two.piece, one.npiece * sizeof *one.piece);
	assert_memory_equal(&one.counts, &two.counts, sizeof one.counts);
	snap_done(&b.lines);
	built_done(&one);
	built_done(&two);
}

static void test_tiny(void **state)
{
	uint64_t first = repeat_first();

	for (uint64_t i = first; i < first + repeat_cases(1500); i++)
		compare(i, 3 + i % 20);
}

static void test_small(void **state)
{
	uint64_t first = repeat_first();

	for (uint64_t i = first; i < first + repeat_cases(300); i++)
		compare(i, 40 + i % 100);
}

static void test_full_range(void **state)
{
	uint64_t first = repeat_first();

	for (uint64_t i = first; i < first + repeat_cases(300); i++)
		compare(i, UINT64_C(1) << 32);
}

/* ---- one by one ---- */

static void set_square(struct line *l, int32_t x, int32_t y, int32_t side, int32_t z)
{
	const int32_t at[4][3] = {{x, y, z}, {x + side, y, z}, {x + side, y + side, z}, {x, y + side, z}};

	*l = (struct line){.n = 4, .ring = true};
	memcpy(l->at, at, sizeof at);
}

static unsigned state_at(struct built *b, int64_t x, int64_t y)
{
	unsigned state;

	ok(lineset_state(b->reader, x, y, 1, &state, &err));
	return state;
}

/* A lake with an island, one beside it with a border in common, and one over it; a boundary around, with a hole; a line that
 * leaves the boundary, and one outside. */
static void test_areas(void **state)
{
	static struct input in = {.n = 7};
	static struct built b;
	uint64_t seed = 1;

	in.feature[0] = (struct feature){.kind = BREAKLINE_LAKE, .n = 2};
	set_square(&in.feature[0].line[0], 0, 0, 100, 7);
	set_square(&in.feature[0].line[1], 20, 20, 20, 7);
	in.feature[1] = (struct feature){.kind = BREAKLINE_LAKE, .n = 1};
	set_square(&in.feature[1].line[0], 100, 0, 100, 7);
	in.feature[2] = (struct feature){.kind = BREAKLINE_LAKE, .n = 1};
	set_square(&in.feature[2].line[0], 30, 30, 40, 7);
	in.feature[3] = (struct feature){.kind = BREAKLINE_BOUNDARY, .n = 1};
	set_square(&in.feature[3].line[0], -500, -500, 1000, 9);
	in.feature[4] = (struct feature){.kind = BREAKLINE_HOLE, .n = 1};
	set_square(&in.feature[4].line[0], 150, 50, 200, 8);
	in.feature[5] = (struct feature){.kind = BREAKLINE_HARD, .n = 1};
	in.feature[5].line[0] = (struct line){.n = 2, .at = {{-400, -400, 1}, {-600, -400, 5}}};
	in.feature[6] = (struct feature){.kind = BREAKLINE_HARD, .n = 1};
	in.feature[6].line[0] = (struct line){.n = 2, .at = {{-700, -400, 1}, {-600, -400, 6}}};
	write_files(&in, &seed);
	build(&b, 1 << 20);
	assert_int_equal(state_at(&b, 10, 10), LINESET_LAKE);
	assert_int_equal(state_at(&b, 25, 25), 0);
	assert_int_equal(state_at(&b, 35, 35), LINESET_LAKE); /* the island is under water of the third one */
	assert_int_equal(state_at(&b, 99, 10), LINESET_LAKE);
	assert_int_equal(state_at(&b, 101, 10), LINESET_LAKE);
	assert_int_equal(state_at(&b, 180, 90), LINESET_OUT); /* a hole is no lake */
	assert_int_equal(state_at(&b, 340, 240), LINESET_OUT);
	assert_int_equal(state_at(&b, 360, 240), 0);
	assert_int_equal(state_at(&b, -501, 0), LINESET_OUT);
	assert_int_equal(state_at(&b, -499, 0), 0);
	assert_int_equal(state_at(&b, INT32_MAX, INT32_MIN), LINESET_OUT);
	/* Outside: a part of one line, and the other one. In the hole: a corner of the second lake. */
	assert_int_equal(b.counts.left_out, 4);
	assert_int_equal(b.counts.features[BREAKLINE_LAKE], 3);
	assert_int_equal(b.counts.features[BREAKLINE_HARD], 2);
	assert_int_equal(b.counts.lines, 8);
	/* On the boundary, at 1 and 2: halfway the line has 3, the boundary 9. */
	assert_int_equal(b.counts.widest, 6);
	assert_int_equal(b.counts.widest_at[0], -500);
	assert_int_equal(b.counts.uneven, 1);
	for (size_t i = 0; i < b.npts; i++)
		assert_true(b.pts[i].x >= -500);
	built_done(&b);
}

static void test_nothing(void **state)
{
	static struct input in = {.n = 0};
	static struct built b;
	uint64_t seed = 1;

	write_files(&in, &seed);
	build(&b, 1000);
	assert_int_equal(b.npts + b.npiece, 0);
	assert_false(b.info.areas);
	built_done(&b);
	/* A line without length gives no vertex. */
	in.n = 1;
	in.feature[0] = (struct feature){.kind = BREAKLINE_HARD, .n = 1};
	in.feature[0].line[0] = (struct line){.n = 2, .at = {{5, 5, 5}, {5, 5, 6}}};
	write_files(&in, &seed);
	build(&b, 10000);
	assert_int_equal(b.npts + b.npiece, 0);
	assert_int_equal(b.counts.points, 1);
	built_done(&b);
}

static int no_points(void *ctx, const struct point *pts, size_t n, struct err *e)
{
	return 0;
}

static void test_memory(void **state)
{
	enum { N = 3000 };
	const struct breakline_params p = {
		.dirfd = dirfd, .file = NAME, .nfiles = 1, .lineset = "lineset", .memory = 1000, .vertices = no_points};
	struct breakline_writer *w;
	struct breakline_totals t;
	struct breakline_counts counts;
	unsigned failed = 0;
	uint64_t memory = 1000;

	ok(breakline_writer_new(dirfd, NAME[0], &w, &err));
	for (int32_t i = 0; i < N; i++) {
		const struct breakline_vertex v = {.x = i % 4 < 2 ? i : i + 9,
						   .y = (i % 4 == 1 || i % 4 == 2) ? 4 : 0,
						   .bits = i % 4 ? 0 : BREAKLINE_FEATURE | BREAKLINE_LINE | BREAKLINE_RING,
						   .kind = BREAKLINE_LAKE};

		ok(breakline_write(w, &v, 1, &err));
	}
	ok(breakline_writer_finish(w, &t, &err));
	breakline_writer_free(w);
	for (;; memory += memory / 4) {
		struct breakline_params less = p;
		int rc;

		less.memory = memory;
		err = ERR_INIT;
		rc = breakline_build(&less, &counts, &err);
		if (rc == 0)
			break;
		assert_int_equal(rc, -ERR_LIMIT);
		assert_true(err.need > memory);
		failed++;
	}
	err = ERR_INIT;
	assert_true(failed > 10);
	assert_true(memory < 1200 * N); /* each lake crosses the next ones */
}

/* ---- files ---- */

static int count_vertices(void *ctx, const struct breakline_vertex *v, size_t n, struct err *e)
{
	*(uint64_t *)ctx += n;
	return 0;
}

static int read_all(struct err *e)
{
	uint64_t n = 0;

	return breakline_read(dirfd, NAME[0], count_vertices, &n, e);
}

/* What cannot follow is refused, and leaves no file. */
static void test_writer(void **state)
{
	static const struct breakline_vertex bad[] = {
		{.bits = BREAKLINE_LINE},
		{.bits = BREAKLINE_FEATURE},
		{.bits = 0},
		{.bits = BREAKLINE_FEATURE | BREAKLINE_RING},
		{.bits = 8},
		{.bits = BREAKLINE_FEATURE | BREAKLINE_LINE, .kind = BREAKLINE_KINDS},
		{.bits = BREAKLINE_FEATURE | BREAKLINE_LINE, .reserved = 1},
	};

	unlinkat(dirfd, NAME[0], 0);
	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
		struct breakline_writer *w;

		ok(breakline_writer_new(dirfd, NAME[0], &w, &err));
		assert_int_equal(breakline_write(w, &bad[i], 1, &err), -ERR_INTERNAL);
		err = ERR_INIT;
		breakline_writer_free(w);
		assert_int_equal(faccessat(dirfd, NAME[0], F_OK, 0), -1);
		assert_int_equal(faccessat(dirfd, "lines-1.tmp", F_OK, 0), -1);
	}
}

static void test_totals(void **state)
{
	static struct input in;
	struct breakline_totals t, sum = {.vertices = 0};
	uint64_t seed = 4, n = 0, vertices = 0, lines = 0;

	draw(&in, &seed, 1000);
	write_files(&in, &seed);
	for (unsigned i = 0; i < FILES; i++) {
		ok(breakline_totals(dirfd, NAME[i], &t, &err));
		ok(breakline_read(dirfd, NAME[i], count_vertices, &n, &err));
		sum.vertices += t.vertices;
		sum.lines += t.lines;
		for (unsigned k = 0; k < BREAKLINE_KINDS; k++)
			sum.features[k] += t.features[k];
	}
	for (unsigned i = 0; i < in.n; i++) {
		lines += in.feature[i].n;
		for (unsigned k = 0; k < in.feature[i].n; k++)
			vertices += in.feature[i].line[k].n;
		sum.features[in.feature[i].kind]--;
	}
	assert_int_equal(n, vertices);
	assert_int_equal(sum.vertices, vertices);
	assert_int_equal(sum.lines, lines);
	for (unsigned k = 0; k < BREAKLINE_KINDS; k++)
		assert_int_equal(sum.features[k], 0);
}

static void test_damage(void **state)
{
	enum { N = 1000 };
	struct breakline_writer *w;
	struct breakline_totals t;
	struct stat st;
	struct err e = ERR_INIT;
	int fd;

	ok(breakline_writer_new(dirfd, NAME[0], &w, &err));
	for (int32_t i = 0; i < N; i++) {
		const struct breakline_vertex v = {.x = i, .y = -i, .bits = i ? 0 : BREAKLINE_FEATURE | BREAKLINE_LINE};

		ok(breakline_write(w, &v, 1, &err));
	}
	ok(breakline_writer_finish(w, &t, &err));
	breakline_writer_free(w);
	assert_int_equal(t.box[1], 1 - N);
	assert_int_equal(t.box[2], N - 1);
	fd = openat(dirfd, NAME[0], O_RDWR);
	assert_int_equal(fstat(fd, &st), 0);
	assert_int_equal(read_all(&e), 0);
	for (off_t at = 0; at < st.st_size; at += at < 128 || at % 4096 < 64 ? 1 : 61) {
		uint8_t was, now;

		assert_int_equal(pread(fd, &was, 1, at), 1);
		now = was ^ (uint8_t)(1u << at % 8);
		assert_int_equal(pwrite(fd, &now, 1, at), 1);
		e = ERR_INIT;
		assert_int_equal(read_all(&e), -ERR_CORRUPT);
		assert_string_equal(e.file, NAME[0]);
		assert_int_equal(pwrite(fd, &was, 1, at), 1);
	}
	assert_int_equal(ftruncate(fd, st.st_size - 4096), 0);
	e = ERR_INIT;
	assert_int_equal(read_all(&e), -ERR_CORRUPT);
	close(fd);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_tiny),   cmocka_unit_test(test_small),   cmocka_unit_test(test_full_range),
		cmocka_unit_test(test_areas),  cmocka_unit_test(test_nothing), cmocka_unit_test(test_memory),
		cmocka_unit_test(test_writer), cmocka_unit_test(test_totals),  cmocka_unit_test(test_damage),
	};

	return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
