/*
 * What is visible from a triangle in its disc (constrain_sight.c), against segments: random triangulations with many pieces, all
 * lattice positions around. If a segment from a position in the disc to some point of the triangle meets no piece, then the
 * position is visible, and so is each box around it.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "check.h"
#include "constrain_priv.h"
#include "random.h"
#include "repeat.h"

enum { MAX_N = 60, PIECES = 60, WEIGHT = 5, MARGIN = 3 };

static struct mesh_vertex pos[MAX_N];
static unsigned npos, npiece;
static unsigned piece[PIECES][2];
static struct constrain_work work;
static uint64_t triangles, positions, visible, hidden;

static void make_positions(uint64_t *seed, int32_t range)
{
	unsigned want = 4 + (unsigned)random_below(seed, MAX_N - 3);

	npos = 0;
	for (unsigned i = 0; i < want; i++) {
		struct mesh_vertex v = {(int32_t)random_below(seed, (uint64_t)range),
					(int32_t)random_below(seed, (uint64_t)range), 0};
		unsigned k = 0;

		while (k < npos && (pos[k].x != v.x || pos[k].y != v.y))
			k++;
		if (k == npos)
			pos[npos++] = v;
	}
}

static int64_t turn(const int64_t a[2], const int64_t b[2], const int64_t c[2])
{
	int64_t v = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);

	return (v > 0) - (v < 0);
}

static bool between(const int64_t a[2], const int64_t b[2], const int64_t p[2])
{
	return turn(a, b, p) == 0 && (p[0] - a[0]) * (p[0] - b[0]) <= 0 && (p[1] - a[1]) * (p[1] - b[1]) <= 0;
}

static bool meets_piece(const int64_t from[2], const int64_t to[2], int64_t scale)
{
	for (unsigned i = 0; i < npiece; i++) {
		const int64_t a[2] = {pos[piece[i][0]].x * scale, pos[piece[i][0]].y * scale};
		const int64_t b[2] = {pos[piece[i][1]].x * scale, pos[piece[i][1]].y * scale};

		if ((turn(from, to, a) * turn(from, to, b) < 0 && turn(a, b, from) * turn(a, b, to) < 0) ||
		    between(from, to, a) || between(from, to, b) || between(a, b, from) || between(a, b, to))
			return true;
	}
	return false;
}

/* From some inner points of the triangle. */
static bool is_visible(const struct tri_result *r, const uint32_t corner[3], int64_t x, int64_t y)
{
	for (int64_t i = 1; i < 3 * WEIGHT; i++)
		for (int64_t k = 1; i + k < 3 * WEIGHT; k++) {
			const int64_t weight[3] = {i, k, 3 * WEIGHT - i - k}, to[2] = {x * 3 * WEIGHT, y * 3 * WEIGHT};
			int64_t from[2] = {0, 0};

			for (unsigned c = 0; c < 3; c++)
				for (unsigned a = 0; a < 2; a++)
					from[a] += weight[c] * r->xy[corner[c]][a];
			if (!meets_piece(from, to, 3 * WEIGHT))
				return true;
		}
	return false;
}

static void check_list(const struct constrain_disc *d, const int32_t box[4], const int32_t at[2])
{
	static struct constrain_hit hit[SIGHT];
	uint32_t n = constrain_sight_list(&work, d, box, hit, SIGHT), i = 0;

	assert_true(constrain_sight_box(&work, d, box));
	while (i < n && !constrain_sight_in(&work, d, hit[i].sight, at))
		i++;
	assert_true(i < n || !d->nsight);
}

static void check_position(uint64_t *seed, const struct constrain_disc *d, int32_t x, int32_t y)
{
	const uint32_t *corner = work.r.triangle[d->triangle].corner;
	const int32_t at[2] = {x, y};
	const int32_t box[4] = {x - (int32_t)random_below(seed, 3), y - (int32_t)random_below(seed, 3),
				x + (int32_t)random_below(seed, 3), y + (int32_t)random_below(seed, 3)};
	bool sees;

	for (unsigned i = 0; i < npos; i++)
		if (pos[i].x == x && pos[i].y == y)
			return;
	if (geom_incircle_plain(work.r.xy[corner[0]], work.r.xy[corner[1]], work.r.xy[corner[2]], at) < 0)
		return;
	sees = x >= d->box[0] && x <= d->box[2] && y >= d->box[1] && y <= d->box[3] && constrain_sight_point(&work, d, at);
	positions++;
	hidden += !sees;
	if (sees)
		check_list(d, box, at);
	if (!is_visible(&work.r, corner, x, y))
		return;
	visible++;
	if (!sees)
		fail_msg("(%d, %d) is visible", x, y);
}

static struct constrain_sight sight[SIGHT];

static void check_triangle(uint64_t *seed, uint32_t i, int32_t range)
{
	const uint32_t *corner = work.r.triangle[i].corner;
	struct constrain_disc d = {.triangle = i};

	cut_disc_init(&d.disc, work.r.xy[corner[0]], work.r.xy[corner[1]], work.r.xy[corner[2]]);
	cut_disc_box(&d.disc, d.box);
	work.sight = sight;
	work.nsight = 0;
	constrain_sight_follow(&work, &d);
	triangles++;
	for (unsigned n = 0; n < 60; n++)
		check_position(seed, &d, (int32_t)random_below(seed, (uint64_t)range + 2 * MARGIN) - MARGIN,
			       (int32_t)random_below(seed, (uint64_t)range + 2 * MARGIN) - MARGIN);
}

static void one_case(uint64_t seed)
{
	static const int32_t ranges[] = {8, 16, 40, 100};
	int32_t range = ranges[random_below(&seed, 4)];
	struct tri_pieces *p;
	struct tri *t;

	make_positions(&seed, range);
	t = check_tri(pos, npos);
	if (!t)
		return;
	p = check_pieces(t, 2 * npos);
	npiece = 0;
	for (unsigned i = (unsigned)random_below(&seed, 3 * PIECES); i > 0 && npiece < PIECES; i--) {
		unsigned a = (unsigned)random_below(&seed, npos), b = (unsigned)random_below(&seed, npos);
		uint32_t at;

		if (tri_piece_insert(p, a, b, &at))
			continue;
		piece[npiece][0] = a;
		piece[npiece++][1] = b;
	}
	tri_result(t, &work.r);
	for (uint32_t i = 0; i < work.r.ntriangle; i++)
		if (constrain_real(&work.r.triangle[i]))
			check_triangle(&seed, i, range);
	free(p);
	free(t);
}

static void visible_positions_are_seen(void **unused)
{
	uint64_t n = repeat_cases(400);

	for (uint64_t i = 0; i < n; i++)
		one_case((repeat_first() + i) * UINT64_C(0x2545f4914f6cdd1d));
	print_message("%llu triangles, %llu positions in their discs: %llu visible from some points, %llu said to be hidden\n",
		      (unsigned long long)triangles, (unsigned long long)positions, (unsigned long long)visible,
		      (unsigned long long)hidden);
	assert_true(visible > positions / 20 && hidden > positions / 4);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(visible_positions_are_seen)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
