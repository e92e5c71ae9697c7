/*
 * Line sets against brute force: what meets a box, states of positions, marks of records, sums; and files that are damaged.
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
#include "err.h"
#include "geom.h"
#include "io.h"
#include "ledger.h"
#include "lineset.h"
#include "no_sync.h"
#include "random.h"
#include "repeat.h"

static char path[128];
static int dirfd = -1;

static int make_folder(void **state)
{
	no_sync();
	repeat_folder(path, sizeof path, "lineset");
	dirfd = open(path, O_RDONLY | O_DIRECTORY);
	return dirfd < 0;
}

static int remove_folder(void **state)
{
	close(dirfd);
	return repeat_remove(path);
}

/* ---- a line set, in a file and in memory ---- */

enum { MOST = 400 };

struct made {
	struct lineset_piece piece[MOST];
	size_t n;
	unsigned far;
	struct lineset *set;
	struct lineset_reader *reader;
	void *memory;
};

static struct err err;

static void ok(int rc)
{
	if (rc)
		fail_msg("%d: %s", rc, err.message);
}

static void add(struct made *m, const int32_t a[2], const int32_t b[2], unsigned turns)
{
	struct lineset_piece *p = &m->piece[m->n];
	bool less = geom_less(a, b);

	if (!memcmp(a, b, sizeof p->a) || m->n == MOST)
		return;
	memcpy(p->a, less ? a : b, sizeof p->a);
	memcpy(p->b, less ? b : a, sizeof p->b);
	p->turns = turns;
	m->n++;
}

static void draw(uint64_t *seed, uint64_t range, int32_t ret[2])
{
	for (unsigned k = 0; k < 2; k++)
		ret[k] = (int32_t)((int64_t)random_below(seed, range) - (int64_t)(range / 2));
}

/* Closed rings, which may cross: states are by parity. Lines between them. */
static void fill(struct made *m, uint64_t *seed, uint64_t range, size_t rings, size_t lines)
{
	for (size_t i = 0; i < rings; i++) {
		unsigned turns = 1 + (unsigned)random_below(seed, 3), corners = 3 + (unsigned)random_below(seed, 5);
		int32_t first[2], at[2], next[2];

		if (m->n + corners > MOST)
			return;
		draw(seed, range, first);
		memcpy(at, first, sizeof at);
		for (unsigned k = 1; k <= corners; k++) {
			draw(seed, range, next);
			if (k == corners)
				memcpy(next, first, sizeof next);
			add(m, at, next, turns);
			memcpy(at, next, sizeof at);
		}
	}
	for (size_t i = 0; i < lines; i++) {
		int32_t a[2], b[2];

		draw(seed, range, a);
		draw(seed, range, b);
		add(m, a, b, 0);
	}
}

static void open_made(struct made *m, size_t memory)
{
	struct lineset_piece copy[MOST];

	err = ERR_INIT;
	memcpy(copy, m->piece, sizeof copy);
	ok(lineset_write(dirfd, "set", copy, m->n, m->far, &err));
	ok(lineset_open(dirfd, "set", NULL, memory, &m->set, &err));
	m->memory = malloc(lineset_reader_bytes());
	m->reader = lineset_reader_init(m->memory, m->set);
}

static void close_made(struct made *m)
{
	free(m->memory);
	m->set = lineset_close(m->set);
}

/* ---- brute force ---- */

static bool segments_meet(const int32_t a[2], const int32_t b[2], const int32_t c[2], const int32_t d[2])
{
	int oc = geom_orient(a, b, c), od = geom_orient(a, b, d), oa = geom_orient(c, d, a), ob = geom_orient(c, d, b);

	if (oc * od < 0 && oa * ob < 0)
		return true;
	for (unsigned i = 0; i < 4; i++) {
		const int32_t *p = i == 0 ? a : i == 1 ? b : i == 2 ? c : d, *q = i < 2 ? c : a, *r = i < 2 ? d : b;

		if ((i == 0 ? oa :
		     i == 1 ? ob :
		     i == 2 ? oc :
			      od) == 0 &&
		    p[0] >= (q[0] < r[0] ? q[0] : r[0]) && p[0] <= (q[0] < r[0] ? r[0] : q[0]) &&
		    p[1] >= (q[1] < r[1] ? q[1] : r[1]) && p[1] <= (q[1] < r[1] ? r[1] : q[1]))
			return true;
	}
	return false;
}

static bool in_box(const int32_t at[2], const int32_t box[4])
{
	return at[0] >= box[0] && at[0] <= box[2] && at[1] >= box[1] && at[1] <= box[3];
}

static bool meets(const struct lineset_piece *p, const int32_t box[4])
{
	const int32_t c[4][2] = {{box[0], box[1]}, {box[2], box[1]}, {box[2], box[3]}, {box[0], box[3]}};

	if (in_box(p->a, box) || in_box(p->b, box))
		return true;
	for (unsigned i = 0; i < 4; i++)
		if (segments_meet(p->a, p->b, c[i], c[(i + 1) % 4]))
			return true;
	return false;
}

static unsigned state_at(const struct made *m, int64_t x, int64_t y, int64_t den)
{
	unsigned state = m->far;

	for (size_t i = 0; i < m->n; i++) {
		const struct lineset_piece *p = &m->piece[i];
		const int32_t *low = p->a[1] <= p->b[1] ? p->a : p->b, *high = p->a[1] <= p->b[1] ? p->b : p->a;
		bool crosses = false;

		area_edge_holds(den * low[0], den * low[1], den * high[0], den * high[1], x, y, &crosses);
		state ^= crosses ? p->turns : 0;
	}
	return state;
}

/* Exact for clear = quarters / 4 and small numbers. */
static bool is_near(const struct lineset_piece *p, const struct point *at, int64_t quarters)
{
	int64_t dx = (int64_t)p->b[0] - p->a[0], dy = (int64_t)p->b[1] - p->a[1];
	int64_t x = (int64_t)at->x - p->a[0], y = (int64_t)at->y - p->a[1];
	geom_i128 along = (geom_i128)x * dx + (geom_i128)y * dy, length = (geom_i128)dx * dx + (geom_i128)dy * dy;
	geom_i128 across = (geom_i128)x * dy - (geom_i128)y * dx;

	if (across == 0 && along >= 0 && along <= length)
		return true;
	if (!quarters)
		return false;
	if (along <= 0 || along >= length) {
		if (along > 0) {
			x = (int64_t)at->x - p->b[0];
			y = (int64_t)at->y - p->b[1];
		}
		return 16 * ((geom_i128)x * x + (geom_i128)y * y) <= quarters * quarters;
	}
	return 16 * across * across <= quarters * quarters * length;
}

/* ---- comparisons ---- */

struct found {
	struct digest sum;
	uint64_t n;
};

static int take_found(void *ctx, const struct lineset_piece *p, struct err *e)
{
	struct found *f = ctx;

	digest_add(&f->sum, digest_hash(p, sizeof *p));
	f->n++;
	return 0;
}

static void draw_box(uint64_t *seed, uint64_t range, int32_t box[4])
{
	int32_t a[2], b[2];

	draw(seed, range, a);
	draw(seed, random_below(seed, 2) ? range : range / 8 + 1, b);
	if (random_below(seed, 2))
		for (unsigned k = 0; k < 2; k++) {
			int64_t v = (int64_t)a[k] + b[k];

			b[k] = (int32_t)(v < INT32_MIN ? INT32_MIN : v > INT32_MAX ? INT32_MAX : v);
		}
	for (unsigned k = 0; k < 2; k++) {
		box[k] = a[k] < b[k] ? a[k] : b[k];
		box[k + 2] = a[k] < b[k] ? b[k] : a[k];
	}
}

static void check_box(struct made *m, const int32_t box[4])
{
	struct found want = {0}, got = {0};
	struct digest sum;
	uint64_t n;

	for (size_t i = 0; i < m->n; i++)
		if (meets(&m->piece[i], box))
			take_found(&want, &m->piece[i], &err);
	ok(lineset_find(m->reader, box, take_found, &got, &err));
	assert_int_equal(got.n, want.n);
	assert_true(digest_equal(got.sum, want.sum));
	ok(lineset_count(m->reader, box, UINT64_MAX, &n, &err));
	assert_int_equal(n, want.n);
	ok(lineset_count(m->reader, box, 2, &n, &err));
	assert_int_equal(n, want.n < 2 ? want.n : 2);
	ok(lineset_sum(m->reader, box, &sum, &err));
	if (!state_at(m, box[0], box[1], 1))
		assert_true(digest_equal(sum, want.sum));
	else
		assert_false(digest_equal(sum, want.sum));
}

static void check_state(struct made *m, uint64_t *seed, uint64_t range)
{
	unsigned den = 1 + (unsigned)random_below(seed, 3), got;
	int64_t x = 0, y = 0;

	for (unsigned i = 0; i < den; i++) {
		int32_t at[2];

		draw(seed, range, at);
		x += at[0];
		y += at[1];
	}
	ok(lineset_state(m->reader, x, y, den, &got, &err));
	assert_int_equal(got, state_at(m, x, y, den));
}

static void check_marks(struct made *m, uint64_t *seed, const int32_t box[4], unsigned quarters)
{
	enum { MOST_POINTS = 1500 };
	static struct point pts[MOST_POINTS], before[MOST_POINTS];
	const size_t count = random_below(seed, 400) ? 24 : 100 + random_below(seed, MOST_POINTS - 100);

	for (size_t i = 0; i < count; i++)
		pts[i] = (struct point){
			.x = (int32_t)(box[0] + (int64_t)random_below(seed, (uint64_t)((int64_t)box[2] - box[0]) + 1)),
			.y = (int32_t)(box[1] + (int64_t)random_below(seed, (uint64_t)((int64_t)box[3] - box[1]) + 1)),
			.tag = (uint16_t)(random_below(seed, 16) | (random_below(seed, 8) ? 0 : POINT_LINE)),
		};
	/* In the order of a cell, so that groups have small boxes. */
	if (random_below(seed, 2))
		point_sort(pts, before, count);
	memcpy(before, pts, sizeof pts);
	ok(lineset_mark(m->reader, box, quarters / 4.0, pts, count, &err));
	for (size_t i = 0; i < count; i++) {
		unsigned want = before[i].tag;
		bool near = false;

		for (size_t k = 0; k < m->n; k++)
			near = near || is_near(&m->piece[k], &before[i], quarters);
		if (!(want & POINT_LINE))
			want |= near ? POINT_NEAR_LINE : state_at(m, before[i].x, before[i].y, 1) ? POINT_IN_AREA : 0;
		assert_int_equal(pts[i].tag, want);
		assert_int_equal(pts[i].x, before[i].x);
	}
}

static void compare(uint64_t seed, uint64_t range, size_t rings, size_t lines, size_t memory, unsigned repeat, bool clear)
{
	static struct made m;

	m = (struct made){.far = random_below(&seed, 3) ? 0 : LINESET_OUT};
	fill(&m, &seed, range, rings, lines);
	open_made(&m, memory);
	for (unsigned i = 0; i < repeat; i++) {
		int32_t box[4];

		draw_box(&seed, range, box);
		check_box(&m, box);
		check_state(&m, &seed, range);
		check_marks(&m, &seed, box, clear ? (unsigned)random_below(&seed, 9) : 0);
	}
	close_made(&m);
}

static void test_tiny(void **state)
{
	uint64_t first = repeat_first();

	for (uint64_t i = first; i < first + repeat_cases(10000); i++)
		compare(i, 3 + i % 14, i % 4, i / 4 % 3, i % 2 ? 0 : 1 << 16, 4, true);
}

static void test_many(void **state)
{
	uint64_t first = repeat_first();

	for (uint64_t i = first; i < first + repeat_cases(400); i++)
		compare(i, 100 + i % 3000, i % 40, 250, i % 2 ? 0 : 1 << 16, 20, true);
}

static void test_full_range(void **state)
{
	uint64_t first = repeat_first();

	for (uint64_t i = first; i < first + repeat_cases(1000); i++)
		compare(i, UINT64_C(1) << 32, i % 5, i % 7, 1 << 16, 8, false);
}

/* ---- sums ---- */

static struct digest range_of(struct made *m, uint64_t lo, uint64_t hi)
{
	struct digest d;

	ok(lineset_sum_range(m->reader, lo, hi, 0, &d, &err));
	return d;
}

/* A piece beside the box counts within the clearance. */
static void test_sums_clear(void **state)
{
	const uint64_t lo = point_morton(0, 0), hi = point_morton(15, 15);
	const int32_t a[2] = {20, 3}, b[2] = {25, 9};
	static struct made m;
	struct digest near, far;

	m = (struct made){.n = 0};
	add(&m, a, b, 0);
	open_made(&m, 0);
	ok(lineset_sum_range(m.reader, lo, hi, 4, &far, &err));
	ok(lineset_sum_range(m.reader, lo, hi, 5, &near, &err));
	assert_true(digest_is_zero(far));
	assert_false(digest_is_zero(near));
	ok(lineset_sum_range(m.reader, 0, UINT64_MAX, INT64_C(1) << 33, &near, &err));
	assert_false(digest_is_zero(near));
	close_made(&m);
}

/* Sums of a range and its box see what meets it, and nothing else. */
static void test_sums(void **state)
{
	const uint64_t lo = point_morton(0, 0), hi = point_morton(15, 15);
	const int32_t box[4] = {0, 0, 15, 15};
	static struct made m, other;
	struct digest sum, range, changed;

	for (unsigned i = 0; i < 64; i++) {
		int32_t a[2] = {(int32_t)(i % 8) * 4 - 8, (int32_t)(i / 8) * 4 - 8}, b[2] = {a[0] + 2, a[1] + 1};
		bool inside = a[0] >= 0 && a[1] >= 0 && a[0] < 16 && a[1] < 16;

		m = (struct made){.n = 0};
		for (unsigned k = 0; k < 64; k++) {
			int32_t c[2] = {(int32_t)(k % 8) * 4 - 8, (int32_t)(k / 8) * 4 - 8}, d[2] = {c[0] + 2, c[1] + 1};

			add(&m, c, d, 0);
		}
		other = m;
		open_made(&m, 0);
		ok(lineset_sum(m.reader, box, &sum, &err));
		range = range_of(&m, lo, hi);
		assert_false(digest_is_zero(range));
		close_made(&m);
		other.piece[i].b[1]++;
		assert_int_equal(other.piece[i].b[0], b[0]);
		open_made(&other, 0);
		ok(lineset_sum(other.reader, box, &changed, &err));
		assert_int_equal(digest_equal(sum, changed), !inside);
		assert_int_equal(digest_equal(range, range_of(&other, lo, hi)), !inside);
		close_made(&other);
	}
}

static void add_square(struct made *m, int32_t from, int32_t to, unsigned turns)
{
	const int32_t c[4][2] = {{from, from}, {to, from}, {to, to}, {from, to}};

	for (unsigned i = 0; i < 4; i++)
		add(m, c[i], c[(i + 1) % 4], turns);
}

/* Deep in a lake no piece is near, but the sum is not zero; far from it it is. A lake at one place and one at another place do
 * not have the same sum. */
static void test_sums_of_states(void **state)
{
	static struct made m;
	const uint64_t key = point_morton(64, 64), other = point_morton(320, 64);
	struct digest in, one, two, all;
	struct digest far;

	add_square(&m, -1000, 200, LINESET_LAKE);
	open_made(&m, 0);
	in = range_of(&m, key, key + 1000);
	far = range_of(&m, other, other + 1000);
	assert_false(digest_is_zero(in));
	assert_true(digest_is_zero(far));
	assert_true(digest_is_zero(range_of(&m, 9, 8)));
	/* All aligned cells of a range, and no other. */
	one = range_of(&m, key, key + 15);
	two = range_of(&m, key + 16, key + 18);
	all = range_of(&m, key, key + 18);
	digest_add(&one, two);
	assert_true(digest_equal(one, all));
	close_made(&m);
	m = (struct made){.far = LINESET_OUT};
	open_made(&m, 0);
	assert_false(digest_is_zero(range_of(&m, other, other)));
	assert_false(digest_equal(range_of(&m, other, other), range_of(&m, key, key)));
	assert_false(digest_is_zero(range_of(&m, 0, UINT64_MAX)));
	close_made(&m);
	m = (struct made){.n = 0};
	open_made(&m, 0);
	assert_true(digest_is_zero(range_of(&m, 0, UINT64_MAX)));
	assert_false(lineset_info(m.set)->areas);
	close_made(&m);
}

/* ---- the file ---- */

/* The same pieces in any order give the same bytes. */
static void test_order(void **state)
{
	static struct made m, other;
	static uint8_t bytes[2][1 << 16];
	uint64_t seed = 5;
	ssize_t size[2];

	fill(&m, &seed, 500, 20, 250);
	other = m;
	for (size_t i = other.n; i > 1; i--) {
		size_t k = random_below(&seed, i);
		struct lineset_piece swap = other.piece[k];

		other.piece[k] = other.piece[i - 1];
		other.piece[i - 1] = swap;
	}
	for (unsigned i = 0; i < 2; i++) {
		struct made *one = i ? &other : &m;
		int fd;

		ok(lineset_write(dirfd, "set", one->piece, one->n, 0, &err));
		fd = openat(dirfd, "set", O_RDONLY);
		size[i] = read(fd, bytes[i], sizeof bytes[i]);
		close(fd);
	}
	assert_true(size[0] > 3 * 4096);
	assert_int_equal(size[0], size[1]);
	assert_memory_equal(bytes[0], bytes[1], (size_t)size[0]);
}

static void test_info(void **state)
{
	static struct made m;
	const int32_t a[2] = {-5, 7}, b[2] = {9, -3};
	const struct lineset_info *info;
	struct ledger *ledger = ledger_new(1 << 20);
	struct digest content;

	add(&m, b, a, LINESET_LAKE);
	open_made(&m, 0);
	info = lineset_info(m.set);
	assert_int_equal(info->pieces, 1);
	assert_true(info->areas);
	assert_int_equal(info->far, 0);
	assert_int_equal(info->box[0], -5);
	assert_int_equal(info->box[1], -3);
	assert_int_equal(info->box[2], 9);
	assert_int_equal(info->box[3], 7);
	content = info->content;
	close_made(&m);
	m.far = LINESET_OUT;
	open_made(&m, 0);
	assert_false(digest_equal(content, lineset_info(m.set)->content));
	close_made(&m);
	/* Memory that is not there. */
	assert_true(ledger_take(ledger, LEDGER_DOMAIN, (1 << 20) - 64));
	assert_int_equal(lineset_open(dirfd, "set", ledger, 1 << 16, &m.set, &err), -ERR_BUSY);
	ledger_give(ledger, LEDGER_DOMAIN, (1 << 20) - 64);
	err = ERR_INIT;
	ok(lineset_open(dirfd, "set", ledger, 1 << 16, &m.set, &err));
	assert_int_equal(ledger_held(ledger, LEDGER_INDEX), lineset_charged(m.set));
	m.set = lineset_close(m.set);
	ledger_free(ledger);
}

static int read_all(struct err *e)
{
	const int32_t box[4] = {INT32_MIN, INT32_MIN, INT32_MAX, INT32_MAX};
	struct found f = {0};
	struct lineset *set = NULL;
	void *memory = malloc(lineset_reader_bytes());
	int rc = lineset_open(dirfd, "set", NULL, 0, &set, e);

	if (rc == 0)
		rc = lineset_find(lineset_reader_init(memory, set), box, take_found, &f, e);
	lineset_close(set);
	free(memory);
	return rc;
}

/* Each byte of the file is guarded, and its end. */
static void test_damage(void **state)
{
	static struct made m;
	uint64_t seed = 9;
	struct stat st;
	struct err e = ERR_INIT;
	int fd;

	fill(&m, &seed, 500, 20, 250);
	ok(lineset_write(dirfd, "set", m.piece, m.n, 0, &err));
	fd = openat(dirfd, "set", O_RDWR);
	assert_int_equal(fstat(fd, &st), 0);
	assert_int_equal(read_all(&e), 0);
	for (off_t at = 0; at < st.st_size; at += at < 128 || at % 4096 < 128 ? 1 : 61) {
		uint8_t was, now;

		assert_int_equal(pread(fd, &was, 1, at), 1);
		now = was ^ (uint8_t)(1u << at % 8);
		assert_int_equal(pwrite(fd, &now, 1, at), 1);
		e = ERR_INIT;
		assert_int_equal(read_all(&e), -ERR_CORRUPT);
		assert_string_equal(e.file, "set");
		assert_true(e.message[0]);
		assert_int_equal(pwrite(fd, &was, 1, at), 1);
	}
	assert_int_equal(ftruncate(fd, st.st_size - 1), 0);
	e = ERR_INIT;
	assert_int_equal(read_all(&e), -ERR_CORRUPT);
	assert_int_equal(ftruncate(fd, 100), 0);
	e = ERR_INIT;
	assert_int_equal(read_all(&e), -ERR_CORRUPT);
	close(fd);
	assert_int_equal(unlinkat(dirfd, "set", 0), 0);
	e = ERR_INIT;
	assert_int_equal(read_all(&e), -ERR_CORRUPT);
}

/* A page that is intact, and of another file. */
static void test_exchanged(void **state)
{
	static struct made m;
	uint8_t page[4096];
	uint64_t seed = 9;
	struct err e = ERR_INIT;
	int fd;

	fill(&m, &seed, 500, 20, 250);
	m.piece[7].turns ^= LINESET_OUT;
	ok(lineset_write(dirfd, "set", m.piece, m.n, 0, &err));
	fd = openat(dirfd, "set", O_RDONLY);
	assert_int_equal(pread(fd, page, sizeof page, 4096), sizeof page);
	close(fd);
	m.piece[7].turns ^= LINESET_OUT;
	m.piece[300].turns ^= LINESET_OUT;
	ok(lineset_write(dirfd, "set", m.piece, m.n, 0, &err));
	assert_int_equal(read_all(&e), 0);
	fd = openat(dirfd, "set", O_RDWR);
	assert_int_equal(pwrite(fd, page, sizeof page, 4096), sizeof page);
	close(fd);
	assert_int_equal(read_all(&e), -ERR_CORRUPT);
}

/* Three levels, and shared pages in less memory than they need, by two readers in turn. */
static void test_cache(void **state)
{
	enum { N = 40000 };
	static struct lineset_piece p[N];
	uint64_t seed = 3, n;
	struct lineset *set;
	struct lineset_reader *r[2];
	void *memory[2];

	for (size_t i = 0; i < N; i++) {
		p[i].a[0] = (int32_t)(i % 200) * 10;
		p[i].a[1] = (int32_t)(i / 200) * 10;
		p[i].b[0] = p[i].a[0] + 3;
		p[i].b[1] = p[i].a[1] + 3;
	}
	ok(lineset_write(dirfd, "set", p, N, 0, &err));
	for (size_t pages = 0; pages < 300; pages = pages * 3 + 1) {
		ok(lineset_open(dirfd, "set", NULL, pages * 4200, &set, &err));
		assert_true(lineset_charged(set) <= pages * 4200 + 1024);
		assert_true(lineset_charged(set) + 4 * 4200 >= (pages < 200 ? pages : 200) * 4112);
		for (unsigned k = 0; k < 2; k++)
			r[k] = lineset_reader_init(memory[k] = malloc(lineset_reader_bytes()), set);
		for (unsigned i = 0; i < 2000; i++) {
			int32_t x = (int32_t)random_below(&seed, 190), y = (int32_t)random_below(&seed, 190);
			const int32_t box[4] = {x * 10, y * 10, x * 10 + 35, y * 10 + 24};

			ok(lineset_count(r[i % 2], box, 100, &n, &err));
			assert_int_equal(n, 12);
		}
		for (unsigned k = 0; k < 2; k++)
			free(memory[k]);
		lineset_close(set);
	}
}

/* Three levels of states: lakes side by side, with islands. */
static void test_states(void **state)
{
	enum { N = 100 };
	static struct lineset_piece p[N * N * 8];
	struct made m = {.n = 0};
	uint64_t seed = 3;
	struct lineset *set;
	void *memory = malloc(lineset_reader_bytes());
	struct lineset_reader *r;
	size_t n = 0;

	for (int32_t i = 0; i < N * N; i++) {
		int32_t x = i % N * 10, y = i / N * 10;

		m.n = 0;
		add_square(&m, 0, 8, LINESET_LAKE);
		add_square(&m, 3, 5, LINESET_LAKE);
		for (size_t k = 0; k < m.n; k++) {
			p[n] = m.piece[k];
			p[n].a[0] += x, p[n].b[0] += x;
			p[n].a[1] += y, p[n++].b[1] += y;
		}
	}
	ok(lineset_write(dirfd, "set", p, n, 0, &err));
	ok(lineset_open(dirfd, "set", NULL, 1 << 18, &set, &err));
	r = lineset_reader_init(memory, set);
	for (unsigned i = 0; i < 200000; i++) {
		unsigned den = 1 + i % 3, got;
		int64_t x = (int64_t)random_below(&seed, den * 1010) - 5, y = (int64_t)random_below(&seed, den * 1010) - 5;
		int64_t in_x = (x + 10 * den) % (10 * den), in_y = (y + 10 * den) % (10 * den);
		bool far = x < 0 || y < 0 || x >= den * 1000 || y >= den * 1000;
		bool island = in_x >= 3 * den && in_x < 5 * den && in_y >= 3 * den && in_y < 5 * den;

		ok(lineset_state(r, x, y, den, &got, &err));
		assert_int_equal(got, !far && in_x < 8 * den && in_y < 8 * den && !island ? LINESET_LAKE : 0);
	}
	lineset_close(set);
	free(memory);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_tiny),      cmocka_unit_test(test_many),       cmocka_unit_test(test_full_range),
		cmocka_unit_test(test_sums),      cmocka_unit_test(test_sums_clear), cmocka_unit_test(test_sums_of_states),
		cmocka_unit_test(test_order),     cmocka_unit_test(test_info),       cmocka_unit_test(test_damage),
		cmocka_unit_test(test_exchanged), cmocka_unit_test(test_cache),      cmocka_unit_test(test_states),
	};

	return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
