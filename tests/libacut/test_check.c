/*
 * The checks of a stream: digests of a mesh cut into blocks are those of the mesh counted directly; one
 * moved vertex, one turned or missing triangle, one early final mark is found; the table holds only what is
 * open, and gives the position of each vertex of a block.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "err.h"

/* A strip of W columns and H rows of squares, two triangles each; one block a column. */
enum { W = 300, H = 40 };

static const int64_t offset[3] = {1000000007, -5, 1LL << 40};

struct strip {
	struct stream_block block;
	uint64_t foreign[H + 1];
	int32_t room[H + 1][3]; /* before the vertices, as a reader may have it */
	int32_t vertex[2 * (H + 1)][3];
	uint32_t triangle[2 * H][3];
	uint8_t final[(2 * (H + 1) + 7) / 8];
};

static void position(unsigned column, unsigned row, int32_t to[3])
{
	to[0] = (int32_t)column * 10 - 77;
	to[1] = (int32_t)(row * 10 + column % 3);
	to[2] = (int32_t)(column * row);
}

/* The left column of points is foreign but for the first block; vertex number = column * (H + 1) + row. */
static void strip_make(struct strip *s, unsigned column)
{
	struct stream_block *b = &s->block;
	uint32_t n = H + 1, left = 0, right = n;

	memset(s, 0, sizeof *s);
	b->index = column;
	b->foreign = s->foreign;
	b->vertex = s->vertex;
	b->triangle = s->triangle;
	b->final = s->final;
	b->nforeign = column > 0 ? n : 0;
	b->nnew = column > 0 ? n : 2 * n;
	b->first = column > 0 ? (column + 1) * (uint64_t)n : 0;
	for (unsigned row = 0; row <= H; row++) {
		if (column > 0)
			s->foreign[row] = column * (uint64_t)n + row;
		else
			position(0, row, s->vertex[row]);
		position(column + 1, row, s->vertex[b->nnew - n + row]);
		/* Inner points of the left column are done with this block. */
		if (column > 0 && row > 0 && row < H)
			s->final[row / 8] |= (uint8_t)(1u << row % 8);
	}
	for (unsigned row = 0; row < H; row++) {
		uint32_t a = left + row, c = right + row;
		uint32_t t[2][3] = {{a, c, a + 1}, {c + 1, a + 1, c}};

		memcpy(s->triangle[b->ntriangle], t, sizeof t);
		b->ntriangle += 2;
	}
}

/* The same digests, straight from the positions. */
static void expect(struct stream_tail *tail)
{
	memset(tail, 0, sizeof *tail);
	for (unsigned column = 0; column <= W; column++)
		for (unsigned row = 0; row <= H; row++) {
			int32_t p[3];

			position(column, row, p);
			digest_add_vertex(&tail->vertex_digest, p[0] + offset[0], p[1] + offset[1], p[2] + offset[2]);
		}
	for (unsigned column = 0; column < W; column++)
		for (unsigned row = 0; row < H; row++) {
			int32_t p[4][3];
			int64_t q[4][2];

			for (unsigned i = 0; i < 4; i++) {
				position(column + i % 2, row + i / 2, p[i]);
				q[i][0] = p[i][0] + offset[0];
				q[i][1] = p[i][1] + offset[1];
			}
			/* Corners in another order than the blocks have them. */
			digest_add_triangle(&tail->digest,
					    (const int64_t[3][2]){{q[2][0], q[2][1]}, {q[0][0], q[0][1]}, {q[1][0], q[1][1]}});
			digest_add_triangle(&tail->digest,
					    (const int64_t[3][2]){{q[1][0], q[1][1]}, {q[3][0], q[3][1]}, {q[2][0], q[2][1]}});
		}
	tail->triangles = 2 * W * H;
	tail->hull = 2 * (W + H);
}

_Static_assert(offsetof(struct strip, vertex) == offsetof(struct strip, room) + sizeof(((struct strip *)NULL)->room),
	       "one array");

static void expect_positions(const struct strip *s, unsigned column, const int32_t (*at)[3])
{
	const unsigned n = H + 1, from = s->block.nforeign ? column : 0;

	for (unsigned i = 0; i < s->block.nforeign + s->block.nnew; i++) {
		int32_t p[3];

		position(from + i / n, i % n, p);
		assert_memory_equal(at[i], p, sizeof p);
	}
}

enum fault { NONE, MOVED, HEIGHT, TURNED, MISSING, EARLY_FINAL, LATE_FINAL };

static int run(enum fault fault, struct err *err)
{
	struct check *c = check_new(offset);
	struct stream_tail tail;
	const int32_t(*at)[3];
	struct strip s;
	int r = 0;

	assert_non_null(c);
	for (unsigned column = 0; column < W && r == 0; column++) {
		strip_make(&s, column);
		if (column == 7 && fault == MOVED)
			s.vertex[3][1]++;
		if (column == 7 && fault == HEIGHT)
			s.vertex[3][2]++;
		if (column == 7 && fault == TURNED) {
			uint32_t t = s.triangle[4][0];

			s.triangle[4][0] = s.triangle[4][1];
			s.triangle[4][1] = t;
		}
		if (column == 7 && fault == MISSING)
			s.block.ntriangle--;
		if (column == 7 && fault == EARLY_FINAL)
			s.final[(H + 4) / 8] |= (uint8_t)(1u << (H + 4) % 8);
		if (column == 7 && fault == LATE_FINAL)
			s.final[0] &= 0xf7;
		memset(s.room, 0x55, sizeof s.room);
		if (column % 2)
			s.block.local = s.room;
		r = check_block(c, &s.block, &at, err);
		if (r == 0 && fault == NONE)
			expect_positions(&s, column, at);
		assert_true(check_open(c) <= 2 * (column + 2) + 2 * (H + 1) + 1);
	}
	expect(&tail);
	if (r == 0)
		r = check_tail(c, &tail, true, err);
	check_free(c);
	return r;
}

/* The right column's inner points stay open in this strip: they are the hull. */
static void test_agrees(void **state)
{
	struct err err = ERR_INIT;

	assert_int_equal(run(NONE, &err), 0);
}

static void test_faults(void **state)
{
	static const struct {
		enum fault fault;
		enum err_code code;
		const char *text;
	} row[] = {
		{MOVED, ERR_DIGEST, "the digest"},           {HEIGHT, ERR_DIGEST, "the vertex digest"},
		{TURNED, ERR_DIGEST, "the digest"},          {MISSING, ERR_DIGEST, "the digest"},
		{EARLY_FINAL, ERR_PROTO, "which was final"}, {LATE_FINAL, ERR_PROTO, "never became final"},
	};

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		struct err err = ERR_INIT;

		assert_int_equal(run(row[i].fault, &err), -(int)row[i].code);
		if (!strstr(err.message, row[i].text))
			fail_msg("row %zu: %s", i, err.message);
	}
}

/* Random open and close against a plain array; numbers collide and wrap around the table. */
static void test_table(void **state)
{
	enum { N = 20000 };
	struct check *c = check_new(offset);
	struct err err = ERR_INIT;
	uint8_t *open = calloc(1, N);
	uint64_t seed = 88172645463325252u, alive = 0;

	for (uint64_t n = 0; n < N; n++) {
		int32_t v[1][3] = {{(int32_t)n, (int32_t)(3 * n), -(int32_t)n}};
		uint8_t none = 0, all = 1;
		const int32_t(*at)[3];
		struct stream_block b = {.first = n, .nnew = 1, .vertex = v, .final = &none};

		assert_int_equal(check_block(c, &b, &at, &err), 0);
		open[n] = 1;
		alive++;
		for (unsigned k = 0; k < 3 && n > 0; k++) {
			uint64_t old;

			seed ^= seed << 13, seed ^= seed >> 7, seed ^= seed << 17;
			old = seed % n;
			b = (struct stream_block){.first = n + 1, .nforeign = 1, .foreign = &old, .final = &all};
			assert_int_equal(check_block(c, &b, &at, &err), open[old] ? 0 : -ERR_PROTO);
			if (open[old])
				assert_true(at[0][0] == (int32_t)old && at[0][1] == 3 * (int32_t)old &&
					    at[0][2] == -(int32_t)old);
			alive -= open[old];
			open[old] = 0;
			err_clear(&err);
		}
		assert_int_equal(check_open(c), alive);
	}
	check_free(c);
	free(open);
}

static size_t most_bytes = SIZE_MAX; /* that calloc gives */

void *__real_calloc(size_t n, size_t size);
void *__wrap_calloc(size_t n, size_t size);

void *__wrap_calloc(size_t n, size_t size)
{
	return n * size > most_bytes ? NULL : __real_calloc(n, size);
}

/* One error when the table cannot grow, after which it still has all vertices. */
static void test_no_memory(void **state)
{
	struct check *c = check_new(offset);
	uint64_t n = 0, first = 0;
	uint8_t none = 0, all = 1;
	int32_t v[1][3] = {{1, 2, 3}};
	const int32_t(*at)[3];
	struct err err = ERR_INIT;
	int r = 0;

	most_bytes = 1 << 20;
	for (; r == 0; n += r == 0)
		r = check_block(c, &(struct stream_block){.first = n, .nnew = 1, .vertex = v, .final = &none}, &at, &err);
	most_bytes = SIZE_MAX;
	assert_int_equal(r, -ERR_NOMEM);
	assert_non_null(strstr(err.message, "open vertices"));
	assert_string_equal(err.hint, ""); /* what to do depends on the caller */
	assert_in_range(n, (1 << 20) / 72, (1 << 20) / 36);
	assert_int_equal(check_open(c), n);
	for (; first < n; first++)
		assert_int_equal(check_block(c,
					     &(struct stream_block){.first = n, .nforeign = 1, .foreign = &first, .final = &all},
					     &at, &err),
				 0);
	assert_int_equal(check_open(c), 0);
	check_free(c);
}

/* Which vertices stay open, whatever the bits and wherever in a byte they begin. */
static void test_bits(void **state)
{
	for (unsigned round = 0; round < 300; round++) {
		enum { MOST = 90 };
		const unsigned nforeign = round % 9, nnew = round % MOST, total = nforeign + nnew;
		uint8_t final[(MOST + 9 + 7) / 8] = {0};
		int32_t vertex[MOST + 9][3] = {{0}};
		uint64_t foreign[9];
		struct stream_block b = {.nnew = nforeign, .vertex = (const int32_t(*)[3])vertex, .final = final};
		struct check *c = check_new(offset);
		const int32_t(*at)[3];
		struct err err = ERR_INIT;
		uint64_t open = 0;

		assert_non_null(c);
		assert_int_equal(check_block(c, &b, &at, &err), 0);
		assert_int_equal(check_open(c), nforeign);
		for (unsigned i = 0; i < nforeign; i++)
			foreign[i] = i;
		for (unsigned i = 0; i < total; i++) {
			/* whole bytes of ones, bytes with one hole, and noise */
			bool is = round % 3 == 0 || (round % 3 == 1 ? i % 19 != round % 19 : rand() % 2);

			final[i / 8] |= (uint8_t)(is << i % 8);
			open += !is;
		}
		b = (struct stream_block){.first = nforeign,
					  .nforeign = nforeign,
					  .nnew = nnew,
					  .foreign = foreign,
					  .vertex = (const int32_t(*)[3])vertex,
					  .final = final};
		assert_int_equal(check_block(c, &b, &at, &err), 0);
		assert_int_equal(check_open(c), open);
		check_free(c);
	}
	(void)state;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_bits),  cmocka_unit_test(test_agrees),    cmocka_unit_test(test_faults),
		cmocka_unit_test(test_table), cmocka_unit_test(test_no_memory),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
