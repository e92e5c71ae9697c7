/*
 * Small degenerate sets, tens of thousands. Each against brute force over all triples (n <= 16), with in-circle signs
 * that share nothing with the kernel's; all against the checks of check.h, against the same set inserted in random
 * order, and against the general predicates.
 *
 *   fuzz-tri [CASES [SEED]]
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "inputs.h"
#include "oracle.h"
#include "tri_priv.h"

enum { BRUTE_MAX = 16, POINTS_MAX = 200 };

/* Coordinates in 0..5: lifts times 2^32 plus 256^rank, rank among the four. Cofactors are at most 25, so a higher power
 * always outweighs the lower ones, and nothing exceeds 2^45. */
static int small_incircle(const int32_t *const p[4])
{
	int64_t lift[4], det = 0;

	for (unsigned i = 0; i < 4; i++) {
		unsigned rank = 0;

		for (unsigned j = 0; j < 4; j++)
			rank += p[j][0] < p[i][0] || (p[j][0] == p[i][0] && p[j][1] < p[i][1]);
		lift[i] = ((int64_t)(p[i][0] * p[i][0] + p[i][1] * p[i][1]) << 32) + ((int64_t)1 << (8 * rank));
	}
	for (unsigned i = 0; i < 4; i++) {
		const int32_t *a = p[i == 0], *b = p[i <= 1 ? 2 : 1], *c = p[i <= 2 ? 3 : 2];
		int64_t minor = (int64_t)a[0] * (b[1] - c[1]) + (int64_t)b[0] * (c[1] - a[1]) + (int64_t)c[0] * (a[1] - b[1]);

		det += i % 2 ? -minor * lift[i] : minor * lift[i];
	}
	return (det > 0) - (det < 0);
}

static bool empty_circle(const int32_t xy[][2], uint32_t n, const uint32_t c[3], bool small)
{
	for (uint32_t l = 0; l < n; l++) {
		const int32_t *const p[4] = {xy[c[0]], xy[c[1]], xy[c[2]], xy[l]};

		if (l == c[0] || l == c[1] || l == c[2])
			continue;
		if (small ? small_incircle(p) > 0 : oracle_incircle(p[0], p[1], p[2], p[3], true) > 0)
			return false;
	}
	return true;
}

static struct check_sum brute_sum(const struct mesh_vertex *v, uint32_t n, bool small)
{
	struct check_sum sum = {0};
	int32_t xy[BRUTE_MAX][2];

	for (uint32_t i = 0; i < n; i++) {
		xy[i][0] = v[i].x;
		xy[i][1] = v[i].y;
	}
	for (uint32_t i = 0; i < n; i++)
		for (uint32_t j = i + 1; j < n; j++)
			for (uint32_t k = j + 1; k < n; k++) {
				int turn = oracle_orient(xy[i], xy[j], xy[k]);
				uint32_t c[3] = {i, turn > 0 ? j : k, turn > 0 ? k : j};

				if (turn && empty_circle((const int32_t(*)[2])xy, n, c, small))
					check_sum_add(&sum, xy[c[0]], xy[c[1]], xy[c[2]]);
			}
	return sum;
}

/* The same set in its given order, by the 64-bit or the general predicates. */
static struct check_sum sum_in_order(const struct mesh_vertex *v, uint32_t n, bool narrow)
{
	struct check_sum sum = {0};
	struct tri_result result;
	size_t bytes = (tri_bytes(n) + 63) / 64 * 64;
	struct tri *t = aligned_alloc(64, bytes);

	if (!t) {
		fprintf(stderr, "no memory for an arena of %zu bytes\n", bytes);
		exit(1);
	}
	t = tri_init(t, n);
	t->nvertex = n;
	for (uint32_t i = 0; i < n; i++) {
		t->xy[i][0] = v[i].x;
		t->xy[i][1] = v[i].y;
		t->z[i] = v[i].z;
		t->id[i] = i;
	}
	if (tri_build(t, narrow) == 0) {
		tri_result(t, &result);
		sum = check_sum_of(&result);
	}
	free(t);
	return sum;
}

static bool same(struct check_sum a, struct check_sum b)
{
	return a.n == b.n && a.lo == b.lo && a.hi == b.hi;
}

static const int32_t extreme[5] = {INT32_MIN, INT32_MIN + 1, 0, INT32_MAX - 1, INT32_MAX};
/* The widest range of the 64-bit predicates. */
static const int32_t widest[5] = {0, 1, INT32_MAX / 2, INT32_MAX - 1, INT32_MAX};

enum family { SMALL, LINES, STRIP, WIDEST, EXTREME, FULL, FAMILIES };

static uint32_t draw_set(struct mesh_vertex *v, uint32_t n, enum family family, uint64_t *s)
{
	uint32_t range = 2 + (uint32_t)(input_random(s) >> 33) % 5;

	for (uint32_t i = 0; i < n; i++) {
		uint32_t a = (uint32_t)(input_random(s) >> 32), b = (uint32_t)(input_random(s) >> 32);

		switch (family) {
		case SMALL:
			v[i].x = (int32_t)(a % range), v[i].y = (int32_t)(b % range);
			break;
		case LINES:
			v[i].x = (int32_t)(a % 6), v[i].y = b % 4 ? v[i].x : (int32_t)(b / 4 % 6);
			break;
		case STRIP:
			v[i].x = (int32_t)(a % 2), v[i].y = (int32_t)(b % 6);
			break;
		case WIDEST:
			v[i].x = widest[a % 5], v[i].y = widest[b % 5];
			break;
		case EXTREME:
			v[i].x = extreme[a % 5], v[i].y = extreme[b % 5];
			break;
		default:
			v[i].x = (int32_t)a, v[i].y = (int32_t)b;
			break;
		}
		v[i].z = (int32_t)i;
	}
	return input_unique(v, n);
}

static bool is_small(enum family family)
{
	return family < WIDEST;
}

static bool is_narrow(enum family family)
{
	return family != EXTREME && family != FULL;
}

static int fail(const struct mesh_vertex *v, uint32_t n, uint64_t number, const char *why)
{
	printf("case %" PRIu64 ": %s;", number, why);
	for (uint32_t i = 0; i < n; i++)
		printf(" (%" PRId32 ",%" PRId32 ")", v[i].x, v[i].y);
	printf("\n");
	return 1;
}

static int run_case(struct mesh_vertex *v, uint32_t n, enum family family, uint64_t number, uint64_t *s)
{
	struct tri_result result;
	struct check_sum sum;
	const char *wrong = NULL;
	void *arena;
	int status = check_run(v, n, &arena, &result);

	sum = check_sum_of(&result);
	if (status == 0)
		wrong = check_result(&result, v, n);
	else if (status != TRI_E_FLAT || result.ntriangle)
		wrong = "flat, but with triangles";
	if (!wrong && n <= BRUTE_MAX && !same(sum, brute_sum(v, n, is_small(family))))
		wrong = "not what brute force finds";
	input_shuffle(v, n, input_random(s) | 1);
	if (!wrong && is_narrow(family) && !same(sum, sum_in_order(v, n, true)))
		wrong = "depends on the order";
	if (!wrong && !same(sum, sum_in_order(v, n, false)))
		wrong = "the general predicates differ";
	free(arena);
	return wrong ? fail(v, n, number, wrong) : 0;
}

int main(int argc, char **argv)
{
	uint64_t cases = argc > 1 ? strtoull(argv[1], NULL, 10) : 250000;
	uint64_t state = (argc > 2 ? strtoull(argv[2], NULL, 10) : 1) * 2 + 1, brute = 0;

	for (uint64_t i = 0; i < cases; i++) {
		struct mesh_vertex v[POINTS_MAX];
		/* Large numbers are slow: one case in 16 each. */
		enum family family = i % 16 == 3 ? WIDEST : i % 16 == 7 ? EXTREME : i % 16 == 15 ? FULL : (enum family)(i % 3);
		uint32_t most = i % 10 == 9 ? POINTS_MAX : BRUTE_MAX;
		uint32_t n = draw_set(v, (uint32_t)(input_random(&state) >> 32) % (most + 1), family, &state);

		brute += n <= BRUTE_MAX;
		if (run_case(v, n, family, i, &state))
			return 1;
	}
	printf("%" PRIu64 " sets, %" PRIu64 " of them against brute force\n", cases, brute);
	return 0;
}
