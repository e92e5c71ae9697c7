/*
 * Small degenerate sets with weights, tens of thousands. Each against brute force over all triples (n <= 16), with the signs of
 * oracle.h; all against structure (links, Euler's count, regular across every edge, hidden positions above the surface), against
 * the same set in random order, and added one after the other. Equal weights give the Delaunay triangulation.
 *
 *   fuzz-tri-regular [CASES [SEED]]
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "inputs.h"
#include "oracle.h"
#include "tri_regular.h"

enum { BRUTE_MAX = 14, POINTS_MAX = 150, KINDS = 6 };

struct set {
	struct mesh_vertex v[POINTS_MAX];
	uint8_t kind[POINTS_MAX]; /* by z, which stays with the position */
	int64_t weight[TRI_WEIGHTS];
	uint32_t n;
};

static uint64_t hidden, all, flat;

static int64_t weight_at(const struct set *s, uint32_t i)
{
	return s->weight[s->kind[s->v[i].z]];
}

/* ---- brute force ---- */

static int power_of(const struct set *s, const uint32_t c[3], uint32_t l)
{
	int32_t xy[4][2];
	int64_t w[4];
	const int32_t *const p[4] = {xy[0], xy[1], xy[2], xy[3]};

	for (unsigned i = 0; i < 4; i++) {
		uint32_t at = i < 3 ? c[i] : l;

		xy[i][0] = s->v[at].x;
		xy[i][1] = s->v[at].y;
		w[i] = weight_at(s, at);
	}
	return oracle_power(p, w, true);
}

static bool is_regular(const struct set *s, const uint32_t c[3])
{
	for (uint32_t l = 0; l < s->n; l++)
		if (l != c[0] && l != c[1] && l != c[2] && power_of(s, c, l) > 0)
			return false;
	return true;
}

static struct check_sum brute_sum(const struct set *s)
{
	struct check_sum sum = {0};

	for (uint32_t i = 0; i < s->n; i++)
		for (uint32_t j = i + 1; j < s->n; j++)
			for (uint32_t k = j + 1; k < s->n; k++) {
				const int32_t a[2] = {s->v[i].x, s->v[i].y}, b[2] = {s->v[j].x, s->v[j].y};
				const int32_t c[2] = {s->v[k].x, s->v[k].y};
				int turn = oracle_orient(a, b, c);
				const uint32_t t[3] = {i, turn > 0 ? j : k, turn > 0 ? k : j};

				if (turn && is_regular(s, t))
					check_sum_add(&sum, a, turn > 0 ? b : c, turn > 0 ? c : b);
			}
	return sum;
}

/* ---- the kernel ---- */

/* Runs the first `first` positions, and adds the others if these are not flat; then all are run. Freed with free(). */
static struct tri *run(const struct set *s, uint32_t first, struct tri_regular *r)
{
	size_t bytes = (tri_bytes(s->n + 1) + 63) / 64 * 64;
	struct tri *t = aligned_alloc(64, bytes);
	uint8_t kind[POINTS_MAX];

	if (!t)
		exit(1);
	memset(t, 0xa5, bytes);
	for (uint32_t i = 0; i < s->n; i++)
		kind[i] = s->kind[s->v[i].z];
	*r = (struct tri_regular){.tri = tri_init(t, s->n + 1), .weight = s->weight};
	memcpy(tri_input(t), s->v, first * sizeof *s->v);
	if (tri_regular_run(r, first, kind)) {
		memcpy(tri_input(t), s->v, s->n * sizeof *s->v);
		tri_regular_run(r, s->n, kind);
	} else {
		tri_regular_add(r, s->v + first, kind + first, s->n - first);
	}
	return t;
}

static bool is_ghost(const struct tri_triangle *t)
{
	return t->corner[0] == TRI_GHOST || t->corner[1] == TRI_GHOST || t->corner[2] == TRI_GHOST;
}

static struct check_sum sum_of(const struct tri_regular *r)
{
	struct check_sum sum = {0};
	struct tri_result t;

	tri_result(r->tri, &t);
	for (uint32_t i = 0; i < t.ntriangle; i++) {
		const uint32_t *c = t.triangle[i].corner;

		if (!is_ghost(&t.triangle[i]))
			check_sum_add(&sum, t.xy[c[0]], t.xy[c[1]], t.xy[c[2]]);
	}
	return sum;
}

static uint32_t triangles_of(const struct tri *tri)
{
	struct tri_result t;

	tri_result(tri, &t);
	return t.ntriangle;
}

static const char *check_side(const struct tri_regular *r, const struct tri_result *t, uint32_t at, unsigned k)
{
	const struct tri_triangle *tri = &t->triangle[at], *o;
	uint32_t link = tri->link[k], side = link >> 1 & 3, apex;

	if (link & 1 || link >> 3 >= t->ntriangle || side > 2)
		return "a link leads nowhere";
	o = &t->triangle[link >> 3];
	if (o->link[side] != (at << 3 | k << 1) || o->corner[(side + 1) % 3] != tri->corner[(k + 2) % 3] ||
	    o->corner[(side + 2) % 3] != tri->corner[(k + 1) % 3])
		return "a link is not mutual";
	apex = o->corner[side];
	if (apex != TRI_GHOST && tri_regular_conflict(r, at, tri_regular_vertex(r, apex)))
		return "an edge is not regular";
	return NULL;
}

static bool is_in_conflict(const struct tri_regular *r, const struct tri_result *t, uint32_t v)
{
	for (uint32_t i = 0; i < t->ntriangle; i++) {
		const uint32_t *c = t->triangle[i].corner;

		if (tri_regular_used(&t->triangle[i]) && v != c[0] && v != c[1] && v != c[2] &&
		    tri_regular_conflict(r, i, tri_regular_vertex(r, v)))
			return true;
	}
	return false;
}

static const char *check_structure(const struct tri_regular *r, uint32_t n)
{
	bool seen[POINTS_MAX] = {false};
	uint32_t used = 0, visible = 0;
	struct tri_result t;
	const char *wrong;

	tri_result(r->tri, &t);
	for (uint32_t i = 0; i < t.ntriangle; i++) {
		const uint32_t *c = t.triangle[i].corner;

		if (!tri_regular_used(&t.triangle[i]))
			continue;
		used++;
		for (unsigned k = 0; k < 3; k++) {
			if (c[k] != TRI_GHOST)
				seen[c[k]] = true;
			if ((wrong = check_side(r, &t, i, k)))
				return wrong;
		}
		if (!is_ghost(&t.triangle[i]) && geom_orient(t.xy[c[0]], t.xy[c[1]], t.xy[c[2]]) <= 0)
			return "a triangle is not counter-clockwise";
	}
	for (uint32_t i = 0; i < n; i++) {
		visible += seen[i];
		if (!seen[i] && is_in_conflict(r, &t, i))
			return "a hidden position is below the surface";
	}
	hidden += n - visible;
	all += n;
	if (used + r->nfree != t.ntriangle || used != 2 * visible - 2)
		return "the number of triangles is not 2 n - 2";
	return t.ntriangle <= 2 * n ? NULL : "more triangles than fit";
}

/* ---- a position that is not added ---- */

struct visits {
	uint32_t triangle[2 * POINTS_MAX], n;
};

static bool visit(void *ctx, uint32_t triangle)
{
	struct visits *v = ctx;

	v->triangle[v->n++] = triangle;
	return false;
}

/* tri_regular_search finds exactly the triangles in conflict with the last position, before it is added. */
static const char *check_search(const struct set *s)
{
	struct set less = *s;
	struct visits found = {.n = 0};
	const int32_t at[2] = {s->v[s->n - 1].x, s->v[s->n - 1].y};
	const struct geom_weighted p = {at, weight_at(s, s->n - 1)};
	struct tri_regular r;
	struct tri_result t;
	struct tri *tri;
	uint32_t want = 0, have;

	less.n--;
	tri = run(&less, less.n, &r);
	tri_result(tri, &t);
	if (t.ntriangle)
		tri_regular_search(&r, p, visit, &found);
	for (uint32_t i = 0; i < t.ntriangle; i++)
		want += tri_regular_used(&t.triangle[i]) && tri_regular_conflict(&r, i, p);
	have = found.n;
	for (uint32_t i = 0; i < found.n; i++)
		have -= !tri_regular_conflict(&r, found.triangle[i], p);
	free(tri);
	return want == have ? NULL : "the search finds other triangles";
}

/* ---- cases ---- */

static bool same(struct check_sum a, struct check_sum b)
{
	return a.n == b.n && a.lo == b.lo && a.hi == b.hi;
}

static const int32_t extreme[5] = {INT32_MIN, INT32_MIN + 1, 0, INT32_MAX - 1, INT32_MAX};

enum family { SMALL, LINES, STRIP, WIDE, EXTREME, FULL, FAMILIES };

static void draw_position(struct mesh_vertex *v, enum family family, uint32_t range, uint32_t a, uint32_t b)
{
	switch (family) {
	case SMALL:
		v->x = (int32_t)(a % range), v->y = (int32_t)(b % range);
		break;
	case LINES:
		v->x = (int32_t)(a % 6), v->y = b % 4 ? v->x : (int32_t)(b / 4 % 6);
		break;
	case STRIP:
		v->x = (int32_t)(a % 2), v->y = (int32_t)(b % 6);
		break;
	case WIDE:
		v->x = (int32_t)(a % 1000), v->y = (int32_t)(b % 1000);
		break;
	case EXTREME:
		v->x = extreme[a % 5], v->y = extreme[b % 5];
		break;
	default:
		v->x = (int32_t)a, v->y = (int32_t)b;
		break;
	}
}

static void draw_set(struct set *s, uint32_t n, enum family family, uint64_t *seed)
{
	uint32_t range = 2 + (uint32_t)(input_random(seed) >> 33) % 7, most = 1 + (uint32_t)(input_random(seed) >> 33) % 8;
	bool equal = input_random(seed) >> 60 == 0;

	most = family == WIDE ? most * 40 : family >= EXTREME ? UINT32_C(1) << (24 + most % 7) : most;
	for (unsigned i = 0; i < TRI_WEIGHTS; i++) {
		int64_t radius = (int64_t)((input_random(seed) >> 30) % (most + 1));

		s->weight[i] = i && !equal ? radius * radius : 4;
	}
	for (uint32_t i = 0; i < n; i++) {
		draw_position(&s->v[i], family, range, (uint32_t)(input_random(seed) >> 32),
			      (uint32_t)(input_random(seed) >> 32));
		s->v[i].z = (int32_t)i;
		s->kind[i] = (uint8_t)((input_random(seed) >> 40) % KINDS);
	}
	s->n = input_unique(s->v, n);
	if (equal)
		s->weight[63] = -1;
}

static int fail(const struct set *s, uint64_t number, const char *why)
{
	printf("case %" PRIu64 ": %s;", number, why);
	for (uint32_t i = 0; i < s->n; i++)
		printf(" (%" PRId32 ",%" PRId32 ":%" PRId64 ")", s->v[i].x, s->v[i].y, weight_at(s, i));
	printf("\n");
	return 1;
}

static const char *run_case(struct set *s, uint64_t *seed)
{
	struct tri_regular r;
	struct tri *t = run(s, s->n, &r);
	struct check_sum sum = sum_of(&r);
	const char *wrong = NULL;
	struct tri_result plain;
	void *arena;

	if (triangles_of(t))
		wrong = check_structure(&r, s->n);
	else
		flat++;
	if (!wrong && s->n <= BRUTE_MAX && !same(sum, brute_sum(s)))
		wrong = "not what brute force finds";
	if (!wrong && s->weight[63] < 0) {
		check_run(s->v, s->n, &arena, &plain);
		if (!same(sum, check_sum_of(&plain)))
			wrong = "equal weights are not the Delaunay triangulation";
		free(arena);
	}
	free(t);
	for (unsigned turn = 0; turn < 2 && !wrong; turn++) {
		input_shuffle(s->v, s->n, input_random(seed) | 1);
		t = run(s, turn ? s->n / 2 : s->n, &r);
		if (triangles_of(t))
			wrong = check_structure(&r, s->n);
		if (!wrong && !same(sum, sum_of(&r)))
			wrong = "depends on the order";
		free(t);
	}
	return wrong || !s->n ? wrong : check_search(s);
}

int main(int argc, char **argv)
{
	uint64_t cases = argc > 1 ? strtoull(argv[1], NULL, 10) : 250000;
	uint64_t state = (argc > 2 ? strtoull(argv[2], NULL, 10) : 1) * 2 + 1;

	for (uint64_t i = 0; i < cases; i++) {
		/* Large numbers are slow: one case in 16 each. */
		enum family family = i % 16 == 7 ? EXTREME : i % 16 == 15 ? FULL : (enum family)(i % 4);
		uint32_t most = i % 10 == 9 ? POINTS_MAX : BRUTE_MAX;
		const char *wrong;
		struct set s;

		draw_set(&s, (uint32_t)(input_random(&state) >> 32) % (most + 1), family, &state);
		wrong = run_case(&s, &state);
		if (wrong)
			return fail(&s, i, wrong);
	}
	printf("%" PRIu64 " sets, %" PRIu64 " flat; %" PRIu64 " of %" PRIu64 " positions hidden\n", cases, flat, hidden, all);
	return hidden ? 0 : 1;
}
