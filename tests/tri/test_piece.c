/*
 * What pieces promise one by one: refusals that change nothing, the memory, flags, the whole range of coordinates, and
 * shapes in which a slow way would take minutes.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "check.h"
#include "inputs.h"

struct fixture {
	struct mesh_vertex *v;
	uint32_t n, npiece;
	struct tri *t;
	struct tri_pieces *p;
	struct tri_result r;
	uint32_t (*piece)[2];
};

/* Takes over v. */
static struct fixture begin(struct mesh_vertex *v, uint32_t n)
{
	struct fixture f = {.v = v, .n = n, .t = check_tri(v, n)};

	assert_non_null(f.t);
	f.p = check_pieces(f.t, 2 * n);
	f.piece = calloc(2 * (size_t)n, sizeof(*f.piece));
	assert_non_null(f.piece);
	tri_result(f.t, &f.r);
	return f;
}

static void insert(struct fixture *f, uint32_t a, uint32_t b)
{
	uint32_t at;

	assert_int_equal(tri_piece_insert(f->p, a, b, &at), 0);
	f->piece[f->npiece][0] = a;
	f->piece[f->npiece++][1] = b;
}

static void end(struct fixture *f)
{
	const char *wrong = check_constrained(&f->r, f->v, f->n, (const uint32_t(*)[2])f->piece, f->npiece);

	if (wrong)
		fail_msg("%s", wrong);
	free(f->piece);
	free(f->p);
	free(f->t);
	free(f->v);
}

static struct mesh_vertex *copy(const struct mesh_vertex *v, uint32_t n)
{
	struct mesh_vertex *copy = malloc(n * sizeof(*copy));

	assert_non_null(copy);
	memcpy(copy, v, n * sizeof(*copy));
	return copy;
}

/* A square with a vertex in its middle and one on a side. */
static const struct mesh_vertex square[] = {{0, 0, 0}, {4, 0, 0}, {4, 4, 0}, {0, 4, 0}, {2, 2, 0}, {2, 0, 0}};

static void refused_with_a_reason(void **unused)
{
	struct fixture f = begin(copy(square, 6), 6);
	struct tri_triangle before[16];
	uint32_t at = 99;

	insert(&f, 5, 3);
	memcpy(before, f.r.triangle, f.r.ntriangle * sizeof(*before));
	assert_int_equal(tri_piece_insert(f.p, 3, 3, &at), TRI_E_END);
	assert_int_equal(tri_piece_insert(f.p, 3, 6, &at), TRI_E_END);
	assert_int_equal(tri_piece_insert(f.p, UINT32_MAX, 0, &at), TRI_E_END);
	assert_int_equal(at, 99);
	assert_int_equal(tri_piece_insert(f.p, 1, 0, &at), TRI_E_VERTEX); /* along the hull */
	assert_int_equal(at, 5);
	assert_int_equal(tri_piece_insert(f.p, 1, 3, &at), TRI_E_VERTEX);
	assert_int_equal(at, 4);
	assert_int_equal(tri_piece_insert(f.p, 0, 4, &at), TRI_E_CROSSING);
	assert_true(at == 5 || at == 3);
	assert_memory_equal(before, f.r.triangle, f.r.ntriangle * sizeof(*before));
	end(&f);
}

/* An edge of the mesh and of the hull, again and in the other direction. */
static void an_edge_is_marked_once(void **unused)
{
	struct fixture f = begin(copy(square, 6), 6);

	insert(&f, 5, 1);
	insert(&f, 1, 5);
	insert(&f, 4, 2);
	insert(&f, 4, 2);
	insert(&f, 2, 3);
	end(&f);
}

/* What crosses more than `most` triangles is refused, and what crosses as many is not. */
static void most_is_a_bound(void **unused)
{
	enum { N = 40 };
	struct mesh_vertex v[2 * N];
	struct tri *t;
	uint32_t at, n;

	for (int32_t i = 0; i < N; i++) {
		v[2 * i] = (struct mesh_vertex){i * 10, i % 3, 0};
		v[2 * i + 1] = (struct mesh_vertex){i * 10 + 5, 20 + i % 2, 0};
	}
	t = check_tri(v, 2 * N);
	assert_non_null(t);
	for (uint32_t most = 1; most < 4 * N; most++) {
		size_t bytes = tri_pieces_bytes(2 * N, most), all = (bytes + 127) / 64 * 64;
		unsigned char *memory = aligned_alloc(64, all);
		struct tri_pieces *p;
		int wrong;

		assert_non_null(memory);
		memset(memory, 0x5a, all);
		p = tri_pieces_init(memory, t, most);
		wrong = tri_piece_find(p, 0, 2 * N - 1, &n, &at);
		if (wrong) {
			assert_int_equal(wrong, TRI_E_MOST);
			assert_int_equal(tri_piece_insert(p, 0, 2 * N - 1, &at), TRI_E_MOST);
		} else {
			assert_int_equal(n, most);
			assert_true(n > N);
			assert_int_equal(tri_piece_insert(p, 0, 2 * N - 1, &at), 0);
		}
		for (size_t i = bytes; i < all; i++)
			assert_int_equal(memory[i], 0x5a);
		free(memory);
		if (!wrong) {
			free(t);
			return;
		}
	}
	fail_msg("never inserted");
}

static void memory_is_stated(void **unused)
{
	assert_true(tri_pieces_bytes(0, 0) <= 4096);
	assert_true(tri_pieces_bytes(64000, 0) - tri_pieces_bytes(0, 0) <= 5 * 64000);
	assert_int_equal(tri_pieces_bytes(0, 1000) - tri_pieces_bytes(0, 0), 44 * 1000);
}

/* Flags stay where nothing is crossed, and spread only over what is. */
static void flags(void **unused)
{
	struct fixture f = begin(copy(square, 6), 6);
	uint32_t n, at, nflag = 0;

	for (uint32_t i = 0; i < f.r.ntriangle; i++)
		assert_false(tri_piece_flagged(f.p, i));
	assert_int_equal(tri_piece_find(f.p, 5, 3, &n, &at), 0);
	assert_true(n >= 2);
	tri_piece_flag(f.p, tri_piece_found(f.p, 0));
	insert(&f, 5, 3);
	for (uint32_t i = 0; i < f.r.ntriangle; i++)
		nflag += tri_piece_flagged(f.p, i);
	assert_true(nflag >= 1 && nflag <= n);
	end(&f);
}

/* From a vertex to all on a square around it, 1,000 of them, over a grid; then a second star through the first one's
 * gaps. */
static void star(void **unused)
{
	const int32_t side = 250, step = 7919;
	struct mesh_vertex *v = calloc(4 * (size_t)side + 1, sizeof(*v));
	uint32_t n = 0;
	struct fixture f;

	assert_non_null(v);
	for (int32_t i = 0; i < side; i++) {
		v[n++] = (struct mesh_vertex){i * step, 0, 0};
		v[n++] = (struct mesh_vertex){side * step, i * step, 0};
		v[n++] = (struct mesh_vertex){(side - i) * step, side * step, 0};
		v[n++] = (struct mesh_vertex){0, (side - i) * step, 0};
	}
	v[n++] = (struct mesh_vertex){side * step / 2 + 11, side * step / 2 - 13, 0};
	f = begin(v, n);
	for (uint32_t i = 0; i + 1 < n; i++)
		insert(&f, n - 1, i);
	end(&f);
}

/* One piece across a mesh of a million positions, and one across the other way that is refused. */
static void across_a_million(void **unused)
{
	uint32_t n, at, low = 0, high = 0, crossed;
	struct mesh_vertex *v = input_make("uniform", 1000000, 5, &n);
	struct fixture f;

	assert_non_null(v);
	for (uint32_t i = 0; i < n; i++) {
		if ((int64_t)v[i].x + v[i].y < (int64_t)v[low].x + v[low].y)
			low = i;
		if ((int64_t)v[i].x + v[i].y > (int64_t)v[high].x + v[high].y)
			high = i;
	}
	f = begin(v, n);
	assert_int_equal(tri_piece_find(f.p, low, high, &crossed, &at), 0);
	assert_true(crossed > 1000);
	insert(&f, low, high);
	end(&f);
}

/* Two rows of vertices, each along a curve, so that one piece between them crosses all triangles. `bend`: 1 if the rows
 * bend away from the piece, and each vertex of a row sees all others; -1 if they bend towards it; 0 for a zigzag. */
static void rows(uint32_t n, int bend)
{
	struct mesh_vertex *v = calloc(2 * (size_t)n + 2, sizeof(*v));
	struct fixture f;

	assert_non_null(v);
	for (uint32_t i = 0; i < n; i++) {
		int64_t x = 2 * (int64_t)i + 1 - n, y = bend ? bend * (((int64_t)n * n - x * x) / (4 * n)) : (int64_t)(i % 2 * n);

		y += bend < 0 ? n : 1;
		v[2 * i] = (struct mesh_vertex){(int32_t)x, (int32_t)y, 0};
		v[2 * i + 1] = (struct mesh_vertex){(int32_t)x, (int32_t)-y, 0};
	}
	v[2 * n] = (struct mesh_vertex){-2 * (int32_t)n, 0, 0};
	v[2 * n + 1] = (struct mesh_vertex){2 * (int32_t)n, 0, 0};
	f = begin(v, 2 * n + 2);
	insert(&f, 2 * n, 2 * n + 1);
	end(&f);
}

static void rows_along_the_piece(void **unused)
{
	for (int bend = -1; bend <= 1; bend++)
		for (uint32_t n = 3; n <= 300000; n *= 10)
			rows(n, bend);
}

/* All positions of a grid are on circles of four and on lines; pieces along its rows, diagonals and knight's moves. */
static void grid(void **unused)
{
	enum { SIDE = 60 };
	struct mesh_vertex *v = calloc(SIDE * SIDE, sizeof(*v));
	struct fixture f;
	uint32_t at;

	assert_non_null(v);
	for (int32_t i = 0; i < SIDE * SIDE; i++)
		v[i] = (struct mesh_vertex){i % SIDE, i / SIDE, 0};
	f = begin(v, SIDE * SIDE);
	assert_int_equal(tri_piece_insert(f.p, 0, 2, &at), TRI_E_VERTEX);
	assert_int_equal(at, 1);
	assert_int_equal(tri_piece_insert(f.p, 0, 2 * SIDE + 2, &at), TRI_E_VERTEX);
	assert_int_equal(at, SIDE + 1);
	for (uint32_t y = 0; y + 3 < SIDE; y += 3)
		for (uint32_t x = 0; x + 3 < SIDE; x += 3) {
			insert(&f, y * SIDE + x, (y + 1) * SIDE + x + 2);
			insert(&f, (y + 1) * SIDE + x, (y + 2) * SIDE + x + 1);
			insert(&f, y * SIDE + x, y * SIDE + x + 1);
		}
	end(&f);
}

static void whole_range(void **unused)
{
	const struct mesh_vertex v[] = {
		{INT32_MIN, INT32_MIN, 0},
		{INT32_MAX, INT32_MAX, 0},
		{INT32_MIN, INT32_MAX, 0},
		{INT32_MAX, INT32_MIN, 0},
		{1, 0, 0},
		{INT32_MAX, INT32_MAX - 1, 0},
		{INT32_MIN, 0, 0},
		{-1, 0, 0},
	};
	struct fixture f = begin(copy(v, 8), 8);

	insert(&f, 0, 1);
	insert(&f, 5, 0);
	insert(&f, 2, 7);
	insert(&f, 3, 4);
	end(&f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(refused_with_a_reason),
		cmocka_unit_test(an_edge_is_marked_once),
		cmocka_unit_test(most_is_a_bound),
		cmocka_unit_test(memory_is_stated),
		cmocka_unit_test(flags),
		cmocka_unit_test(star),
		cmocka_unit_test(across_a_million),
		cmocka_unit_test(rows_along_the_piece),
		cmocka_unit_test(grid),
		cmocka_unit_test(whole_range),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
