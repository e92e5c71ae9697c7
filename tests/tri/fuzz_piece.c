/*
 * Pieces in small degenerate sets, tens of thousands of sets. Which pieces are refused, and why, against segments tested
 * by brute force; each result against the checks of check.h, against the same pieces in another order, and for few
 * vertices against the definition: a triangle is in the mesh if no piece crosses it and its circle contains no vertex
 * that can be seen from its inside. Some vertices are added when there are pieces already. Flags: who takes the place of a
 * flagged triangle has a flag.
 *
 *   fuzz-tri-piece [CASES [SEED]]
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "inputs.h"
#include "oracle.h"
#include "repeat.h"

enum { BRUTE_MAX = 11, POINTS_MAX = 120, PIECES_MAX = 3 * POINTS_MAX };

struct set {
	struct mesh_vertex v[POINTS_MAX];
	int32_t xy[POINTS_MAX][2];
	uint32_t n;
	uint32_t piece[PIECES_MAX][2];
	uint32_t npiece;
};

static const int32_t extreme[5] = {INT32_MIN, INT32_MIN + 1, 0, INT32_MAX - 1, INT32_MAX};

enum family { SMALL, LINES, STRIP, CURVE, EXTREME, FULL, FAMILIES };

static void draw_vertices(struct set *s, enum family family, uint32_t n, uint64_t *state)
{
	uint32_t range = 3 + (uint32_t)(input_random(state) >> 33) % 12;

	for (uint32_t i = 0; i < n; i++) {
		uint32_t a = (uint32_t)(input_random(state) >> 32), b = (uint32_t)(input_random(state) >> 32);
		int32_t x, y;

		switch (family) {
		case SMALL:
			x = (int32_t)(a % range), y = (int32_t)(b % range);
			break;
		case LINES:
			x = (int32_t)(a % 6), y = b % 4 ? x : (int32_t)(b / 4 % 6);
			break;
		case STRIP:
			x = (int32_t)(a % 3), y = (int32_t)(b % 40);
			break;
		case CURVE:
			x = (int32_t)(a % 41) - 20, y = b % 8 ? x * x / 4 : (int32_t)(b / 8 % 100);
			break;
		case EXTREME:
			x = extreme[a % 5], y = extreme[b % 5];
			break;
		default:
			x = (int32_t)a, y = (int32_t)b;
			break;
		}
		s->v[i] = (struct mesh_vertex){x, y, (int32_t)i};
	}
	s->n = input_unique(s->v, n);
	for (uint32_t i = 0; i < s->n; i++) {
		s->xy[i][0] = s->v[i].x;
		s->xy[i][1] = s->v[i].y;
	}
}

static int turn(const struct set *s, uint32_t a, uint32_t b, uint32_t c)
{
	return oracle_orient(s->xy[a], s->xy[b], s->xy[c]);
}

static bool crosses(const struct set *s, uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
	return turn(s, a, b, c) * turn(s, a, b, d) < 0 && turn(s, c, d, a) * turn(s, c, d, b) < 0;
}

/* Whether v is on the line through a and b, between them. */
static bool between(const struct set *s, uint32_t a, uint32_t b, uint32_t v)
{
	int64_t ax = s->v[a].x, ay = s->v[a].y, bx = s->v[b].x, by = s->v[b].y, x = s->v[v].x, y = s->v[v].y;

	return v != a && v != b && turn(s, a, b, v) == 0 && (x > ax) == (x < bx) && (y > ay) == (y < by) &&
	       (x == ax) == (x == bx) && (y == ay) == (y == by);
}

/* What is wrong with the answer to a piece. */
static const char *answer_wrong(const struct set *s, uint32_t a, uint32_t b, int answer, uint32_t at)
{
	bool vertex = false, crossing = false, named = false;

	for (uint32_t i = 0; i < s->n; i++)
		vertex |= between(s, a, b, i);
	for (uint32_t i = 0; i < s->npiece; i++)
		if (crosses(s, a, b, s->piece[i][0], s->piece[i][1])) {
			crossing = true;
			named |= at == s->piece[i][0] || at == s->piece[i][1];
		}
	switch (answer) {
	case 0:
		return vertex || crossing || a == b ? "a piece was not refused" : NULL;
	case TRI_E_END:
		return a == b ? NULL : "a piece was refused for its end";
	case TRI_E_VERTEX:
		return vertex && between(s, a, b, at) ? NULL : "a piece was refused for a vertex";
	case TRI_E_CROSSING:
		return crossing && named ? NULL : "a piece was refused for a crossing";
	default:
		return "a piece was refused";
	}
}

struct snapshot {
	struct tri_triangle triangle[2 * POINTS_MAX];
	bool flag[2 * POINTS_MAX];
};

static void snapshot_take(struct snapshot *s, const struct tri_result *r, const struct tri_pieces *p)
{
	memcpy(s->triangle, r->triangle, r->ntriangle * sizeof(*r->triangle));
	for (uint32_t i = 0; i < r->ntriangle; i++)
		s->flag[i] = tri_piece_flagged(p, i);
}

static bool is_real(const struct tri_triangle *t)
{
	return t->corner[0] != TRI_GHOST && t->corner[1] != TRI_GHOST && t->corner[2] != TRI_GHOST;
}

/* Whether a side of a has all of b outside of it. */
static bool separates(const struct tri_result *r, const struct tri_triangle *a, const struct tri_triangle *b)
{
	for (unsigned k = 0; k < 3; k++) {
		unsigned outside = 0;

		for (unsigned i = 0; i < 3; i++)
			outside += oracle_orient(r->xy[a->corner[k]], r->xy[a->corner[(k + 1) % 3]], r->xy[b->corner[i]]) <= 0;
		if (outside == 3)
			return true;
	}
	return false;
}

/* The flags after a piece: those of triangles that are the same stay; new ones have one if they overlap one that had. */
static const char *flags_wrong(const struct snapshot *old, const struct tri_result *r, const struct tri_pieces *p)
{
	for (uint32_t i = 0; i < r->ntriangle; i++) {
		const struct tri_triangle *t = &r->triangle[i];

		if (!memcmp(t->corner, old->triangle[i].corner, sizeof(t->corner))) {
			if (tri_piece_flagged(p, i) != old->flag[i])
				return "the flag of a triangle that stays has changed";
			continue;
		}
		for (uint32_t k = 0; k < r->ntriangle && !tri_piece_flagged(p, i); k++)
			if (old->flag[k] && is_real(&old->triangle[k]) && !separates(r, t, &old->triangle[k]) &&
			    !separates(r, &old->triangle[k], t))
				return "a triangle on a flagged one has no flag";
	}
	return NULL;
}

/* The piece is offered; if it is taken, it is added to the set. What is wrong, or NULL. */
static const char *offer(struct set *s, struct tri *t, struct tri_pieces *p, uint32_t a, uint32_t b)
{
	static struct snapshot old;
	struct tri_result r;
	uint32_t at = UINT32_MAX, n = 0;
	const char *wrong;
	int found = tri_piece_find(p, a, b, &n, &at), answer;

	tri_result(t, &r);
	snapshot_take(&old, &r, p);
	answer = tri_piece_insert(p, a, b, &at);
	if (found != answer)
		return "the search and the insertion answer differently";
	wrong = answer_wrong(s, a, b, answer, at);
	if (wrong)
		return wrong;
	if (answer)
		return memcmp(old.triangle, r.triangle, r.ntriangle * sizeof(*r.triangle)) ?
			       "a refused piece has changed the mesh" :
			       NULL;
	s->piece[s->npiece][0] = a;
	s->piece[s->npiece++][1] = b;
	return flags_wrong(&old, &r, p);
}

/* Whether v sees the inside of triangle c: for a direction between each two neighbouring vertices, as seen from v, the
 * ray meets the triangle and no piece before. */
static bool sees(const struct set *s, uint32_t v, const uint32_t c[3])
{
	for (uint32_t u = 0; u < s->n; u++) {
		uint32_t w = UINT32_MAX;
		int64_t dx, dy, en = INT64_MAX, ed = 1;
		bool blocked = false;

		for (uint32_t i = 0; i < s->n; i++)
			if (i != v && u != v && turn(s, v, u, i) > 0 && (w == UINT32_MAX || turn(s, v, i, w) > 0))
				w = i;
		if (w == UINT32_MAX)
			continue;
		dx = (int64_t)s->v[u].x + s->v[w].x - 2 * s->v[v].x;
		dy = (int64_t)s->v[u].y + s->v[w].y - 2 * s->v[v].y;
		/* First the sides of the triangle: the nearest one, at en / ed. Then the pieces. */
		for (uint32_t k = 0; k < 3 + s->npiece && !blocked; k++) {
			uint32_t a = k < 3 ? c[k] : s->piece[k - 3][0], b = k < 3 ? c[(k + 1) % 3] : s->piece[k - 3][1];
			int64_t ax = (int64_t)s->v[a].x - s->v[v].x, ay = (int64_t)s->v[a].y - s->v[v].y;
			int64_t bx = (int64_t)s->v[b].x - s->v[v].x, by = (int64_t)s->v[b].y - s->v[v].y;
			int64_t n = ax * (by - ay) - ay * (bx - ax), d = dx * (by - ay) - dy * (bx - ax);
			int64_t left = dx * ay - dy * ax, right = dx * by - dy * bx;

			if (d < 0)
				n = -n, d = -d;
			if (n <= 0 || d == 0 || (left > 0) == (right > 0) || left == 0 || right == 0)
				continue;
			if (k >= 3)
				blocked = en != INT64_MAX && n * ed <= en * d;
			else if (en == INT64_MAX || n * ed < en * d)
				en = n, ed = d;
		}
		if (en != INT64_MAX && !blocked)
			return true;
	}
	return false;
}

static bool by_definition(const struct set *s, const uint32_t c[3])
{
	for (uint32_t v = 0; v < s->n; v++) {
		if (v == c[0] || v == c[1] || v == c[2])
			continue;
		if (turn(s, c[0], c[1], v) >= 0 && turn(s, c[1], c[2], v) >= 0 && turn(s, c[2], c[0], v) >= 0)
			return false;
	}
	for (uint32_t i = 0; i < s->npiece; i++)
		for (unsigned k = 0; k < 3; k++)
			if (crosses(s, s->piece[i][0], s->piece[i][1], c[k], c[(k + 1) % 3]))
				return false;
	for (uint32_t v = 0; v < s->n; v++)
		if (v != c[0] && v != c[1] && v != c[2] &&
		    oracle_incircle(s->xy[c[0]], s->xy[c[1]], s->xy[c[2]], s->xy[v], true) > 0 && sees(s, v, c))
			return false;
	return true;
}

static struct check_sum brute_sum(const struct set *s)
{
	struct check_sum sum = {0};

	for (uint32_t i = 0; i < s->n; i++)
		for (uint32_t j = i + 1; j < s->n; j++)
			for (uint32_t k = j + 1; k < s->n; k++) {
				int left = turn(s, i, j, k);
				uint32_t c[3] = {i, left > 0 ? j : k, left > 0 ? k : j};

				if (left && by_definition(s, c))
					check_sum_add(&sum, s->xy[c[0]], s->xy[c[1]], s->xy[c[2]]);
			}
	return sum;
}

static uint64_t added;

static bool same(struct check_sum a, struct check_sum b)
{
	return a.n == b.n && a.lo == b.lo && a.hi == b.hi;
}

/* The sum of the same pieces, inserted in a random order and direction. */
static struct check_sum sum_in_order(const struct set *s, uint64_t *state)
{
	struct tri *t = check_tri(s->v, s->n);
	struct tri_pieces *p = check_pieces(t, 2 * s->n);
	uint32_t order[PIECES_MAX], at;
	struct check_sum sum = {0};
	struct tri_result r;

	for (uint32_t i = 0; i < s->npiece; i++) {
		uint32_t j = (uint32_t)(input_random(state) >> 32) % (i + 1);

		order[i] = order[j];
		order[j] = i;
	}
	for (uint32_t i = 0; i < s->npiece; i++) {
		bool turned = input_random(state) >> 63;

		if (tri_piece_insert(p, s->piece[order[i]][turned], s->piece[order[i]][!turned], &at))
			goto done;
	}
	tri_result(t, &r);
	sum = check_sum_of(&r);
done:
	free(p);
	free(t);
	return sum;
}

static bool is_end(const struct set *s, uint32_t v)
{
	for (uint32_t i = 0; i < s->npiece; i++)
		if (s->piece[i][0] == v || s->piece[i][1] == v)
			return true;
	return false;
}

/* The flags after a vertex: of the triangles that were there in other places they stay, and none is lost on a flagged one. */
static const char *added_wrong(const struct snapshot *old, uint32_t n, const struct tri_result *r, const struct tri_pieces *p)
{
	uint32_t new = 0;

	for (uint32_t i = 0; i < r->ntriangle; i++) {
		const struct tri_triangle *t = &r->triangle[i];

		if (i < n && !memcmp(t->corner, old->triangle[i].corner, sizeof(t->corner))) {
			if (tri_piece_flagged(p, i) != old->flag[i])
				return "the flag of a triangle beside a new vertex has changed";
			continue;
		}
		new ++;
		for (uint32_t k = 0; is_real(t) && k < n && !tri_piece_flagged(p, i); k++)
			if (old->flag[k] && is_real(&old->triangle[k]) && !separates(r, t, &old->triangle[k]) &&
			    !separates(r, &old->triangle[k], t))
				return "a triangle around a new vertex, on a flagged one, has no flag";
	}
	return new >= 3 ? NULL : "a vertex was added, and no triangle is new";
}

/* It is on no piece. And once it is there it is found. */
static const char *add_vertex(const struct set *s, struct tri *t, struct tri_pieces *p, uint32_t v, uint32_t near,
			      uint32_t *ret_at)
{
	static struct snapshot old;
	struct tri_result r;
	uint32_t n, found = 0, at = tri_walk(t, s->xy[v], near);
	const char *wrong;

	tri_result(t, &r);
	n = r.ntriangle;
	snapshot_take(&old, &r, p);
	if (tri_piece_add(p, &s->v[v], at, &found))
		return "a vertex was refused";
	tri_result(t, &r);
	wrong = added_wrong(&old, n, &r, p);
	for (uint32_t i = 0; i < found && !wrong; i++)
		if (i < n && tri_piece_found(p, i) >= r.ntriangle)
			wrong = "a triangle that is said to be new is not there";
	*ret_at = tri_walk(t, s->xy[v], near);
	for (unsigned k = 0; k < 3; k++)
		if (r.triangle[*ret_at].corner[k] == r.nvertex - 1)
			return wrong;
	return "the walk to a vertex does not find it";
}

/* The middle of a piece is refused. */
static const char *middle_wrong(const struct set *s, struct tri *t, struct tri_pieces *p)
{
	for (uint32_t i = 0; i < s->npiece; i++) {
		const struct mesh_vertex *a = &s->v[s->piece[i][0]], *b = &s->v[s->piece[i][1]];
		int64_t x = (int64_t)a->x + b->x, y = (int64_t)a->y + b->y;
		const int32_t at[2] = {(int32_t)(x / 2), (int32_t)(y / 2)};
		uint32_t n;

		if (x % 2 || y % 2)
			continue;
		if (tri_piece_add(p, &(struct mesh_vertex){at[0], at[1], 0}, tri_walk(t, at, 0), &n) != TRI_E_CROSSING)
			return "a vertex on a piece was not refused";
	}
	return NULL;
}

/* The same pieces with the vertices of none of them added afterwards. */
static const char *add_later(const struct set *s, struct check_sum want, uint64_t *state)
{
	static struct set first;
	uint32_t number[POINTS_MAX], least = 0, near = 0, at;
	const char *wrong = NULL;
	struct tri_pieces *p;
	struct tri_result r;
	struct tri *t;

	first.n = 0;
	for (uint32_t i = 0; i < s->n; i++) {
		number[i] = UINT32_MAX;
		if (!is_end(s, i) && input_random(state) >> 62)
			continue;
		number[i] = first.n;
		first.v[first.n++] = s->v[i];
	}
	least = first.n;
	t = first.n < 3 ? NULL : check_tri_room(first.v, first.n, s->n + 1);
	if (!t)
		return NULL;
	p = check_pieces_room(t, s->n + 1, 2 * s->n + 4);
	for (uint32_t i = 0; i < s->npiece && !wrong; i++) {
		tri_result(t, &r);
		for (unsigned k = 0; k < 2; k++) {
			near = tri_walk(t, s->xy[s->piece[i][k]], near);
			tri_piece_end(p, number[s->piece[i][k]], near);
		}
		if (tri_piece_insert(p, number[s->piece[i][0]], number[s->piece[i][1]], &at))
			wrong = "a piece was refused with fewer vertices";
	}
	tri_result(t, &r);
	for (uint32_t i = 0; i < r.ntriangle; i++)
		if (is_real(&r.triangle[i]) && input_random(state) >> 62 == 0)
			tri_piece_flag(p, i);
	for (uint32_t i = 0; i < s->n && !wrong; i++)
		if (number[i] == UINT32_MAX)
			wrong = add_vertex(s, t, p, i, (uint32_t)(input_random(state) >> 32) % (2 * least - 2), &near);
	if (!wrong)
		wrong = middle_wrong(s, t, p);
	tri_result(t, &r);
	if (!wrong && !same(want, check_sum_of(&r)))
		wrong = "vertices that are added to pieces make another mesh";
	added += !wrong;
	free(p);
	free(t);
	return wrong;
}

static const char *run_case(struct set *s, enum family family, uint64_t *state, bool *ret_brute)
{
	struct tri *t = check_tri(s->v, s->n);
	struct tri_pieces *p;
	uint32_t want = (uint32_t)(input_random(state) >> 32) % (2 * s->n + 1);
	const char *wrong = NULL;
	struct tri_result r;

	if (!t)
		return NULL;
	p = check_pieces(t, 2 * s->n);
	tri_result(t, &r);
	for (uint32_t i = 0; i < r.ntriangle; i++)
		if (input_random(state) >> 62 == 0)
			tri_piece_flag(p, i);
	for (uint32_t i = 0; i < want && !wrong; i++)
		wrong = offer(s, t, p, (uint32_t)(input_random(state) >> 32) % s->n,
			      (uint32_t)(input_random(state) >> 32) % s->n);
	if (!wrong)
		wrong = check_constrained(&r, s->v, s->n, (const uint32_t(*)[2])s->piece, s->npiece);
	if (!wrong && !same(check_sum_of(&r), sum_in_order(s, state)))
		wrong = "depends on the order of the pieces";
	if (!wrong)
		wrong = add_later(s, check_sum_of(&r), state);
	*ret_brute = s->n <= BRUTE_MAX && family != EXTREME && family != FULL;
	if (!wrong && *ret_brute && !same(check_sum_of(&r), brute_sum(s)))
		wrong = "not what the definition says";
	free(p);
	free(t);
	return wrong;
}

static int fail(const struct set *s, uint64_t number, const char *why)
{
	printf("case %" PRIu64 ": %s;", number, why);
	for (uint32_t i = 0; i < s->n; i++)
		printf(" (%" PRId32 ",%" PRId32 ")", s->v[i].x, s->v[i].y);
	printf("; pieces");
	for (uint32_t i = 0; i < s->npiece; i++)
		printf(" %" PRIu32 "-%" PRIu32, s->piece[i][0], s->piece[i][1]);
	printf("\n");
	return 1;
}

int main(int argc, char **argv)
{
	uint64_t cases = repeat_cases(argc > 1 ? strtoull(argv[1], NULL, 10) : 250000);
	uint64_t state = (argc > 2 ? strtoull(argv[2], NULL, 10) : repeat_first()) * 2 + 1, brute = 0, pieces = 0;
	static struct set s;

	for (uint64_t i = 0; i < cases; i++) {
		/* Large numbers are slow: one case in 16 each. */
		enum family family = i % 16 == 7 ? EXTREME : i % 16 == 15 ? FULL : (enum family)(i % 4);
		uint32_t most = i % 5 == 4 ? POINTS_MAX : BRUTE_MAX;
		bool by_brute = false;
		const char *wrong;

		memset(&s, 0, sizeof(s));
		draw_vertices(&s, family, 3 + (uint32_t)(input_random(&state) >> 32) % (most - 2), &state);
		wrong = run_case(&s, family, &state, &by_brute);
		if (wrong)
			return fail(&s, i, wrong);
		brute += by_brute;
		pieces += s.npiece;
	}
	printf("%" PRIu64 " sets, %" PRIu64 " of them against the definition, %" PRIu64 " pieces; in %" PRIu64
	       " vertices were added later\n",
	       cases, brute, pieces, added);
	return 0;
}
