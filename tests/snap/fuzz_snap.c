/*
 * Snap rounding of small sets of segments, tens of thousands of sets. Sets of small numbers against brute force that
 * shares nothing with the product, of large numbers their crossings and heights alone; all sets in two orders and directions,
 * against the definition of each crossing, and by the kernel, which refuses pieces that cross.
 *
 *   fuzz-snap [CASES [SEED]]
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "err.h"
#include "geom.h"
#include "inputs.h"
#include "snap.h"
#include "repeat.h"

enum { SEGMENTS_MAX = 16, VERTICES_MAX = 2 * SEGMENTS_MAX, HOT_MAX = VERTICES_MAX + SEGMENTS_MAX * SEGMENTS_MAX };

struct set {
	struct mesh_vertex v[VERTICES_MAX];
	uint32_t segment[SEGMENTS_MAX][2], label[SEGMENTS_MAX];
	uint32_t nvertex, nsegment;
	bool highest; /* which heights are compared with brute force */
};

enum family { TINY, SMALL, PARALLEL, WIDE, FULL, EXTREME, FAMILIES };

static const int32_t extreme[6] = {INT32_MIN, INT32_MIN + 1, -1, 0, INT32_MAX - 1, INT32_MAX};

static int32_t draw_number(enum family family, uint32_t range, unsigned axis, uint64_t *state)
{
	uint32_t a = (uint32_t)(input_random(state) >> 32);

	switch (family) {
	case PARALLEL:
		return (int32_t)(a % (axis ? 3 : 50)) - 1;
	case FULL:
		return (int32_t)a;
	case EXTREME:
		return a % 4 ? extreme[a / 4 % 6] : (int32_t)(a ^ a << 9);
	default:
		return (int32_t)(a % range) - (int32_t)(range / 2);
	}
}

static void draw(struct set *s, enum family family, uint64_t *state)
{
	uint32_t range = family == TINY ? 2 + (uint32_t)(input_random(state) >> 33) % 8 : family == SMALL ? 60 : 1000000;

	memset(s, 0, sizeof(*s));
	s->highest = input_random(state) >> 63;
	s->nvertex = 2 + (uint32_t)(input_random(state) >> 33) % (VERTICES_MAX - 1);
	s->nsegment = 1 + (uint32_t)(input_random(state) >> 33) % SEGMENTS_MAX;
	for (uint32_t i = 0; i < s->nvertex; i++) {
		s->v[i].x = draw_number(family, range, 0, state);
		s->v[i].y = draw_number(family, range, 1, state);
		s->v[i].z = draw_number(family == PARALLEL ? SMALL : family, range, 0, state);
	}
	for (uint32_t i = 0; i < s->nsegment; i++)
		for (unsigned k = 0; k < 2; k++)
			s->segment[i][k] = (uint32_t)(input_random(state) >> 33) % s->nvertex;
	for (uint32_t i = 0; i < s->nsegment; i++)
		s->label[i] = (uint32_t)(input_random(state) >> 33) % 4;
}

/* The same set: vertices and segments in another order, segments in another direction. */
static void shuffle(const struct set *s, struct set *ret, uint64_t *state)
{
	uint32_t order[VERTICES_MAX], at[VERTICES_MAX];

	*ret = *s;
	for (uint32_t i = 0; i < s->nvertex; i++) {
		uint32_t j = (uint32_t)(input_random(state) >> 33) % (i + 1);

		order[i] = order[j];
		order[j] = i;
	}
	for (uint32_t i = 0; i < s->nvertex; i++) {
		ret->v[i] = s->v[order[i]];
		at[order[i]] = i;
	}
	for (uint32_t i = 0; i < s->nsegment; i++) {
		uint32_t j = (uint32_t)(input_random(state) >> 33) % (i + 1), turned = (uint32_t)(input_random(state) >> 63);

		memcpy(ret->segment[i], ret->segment[j], sizeof(ret->segment[i]));
		ret->label[i] = ret->label[j];
		ret->label[j] = s->label[i];
		ret->segment[j][turned] = at[s->segment[i][0]];
		ret->segment[j][!turned] = at[s->segment[i][1]];
	}
}

/* What brute force makes. */
struct brute {
	struct mesh_vertex hot[HOT_MAX];
	uint32_t nhot;
	struct mesh_vertex own[VERTICES_MAX]; /* distinct vertices of the input */
	uint32_t nown;
	uint32_t segment[SEGMENTS_MAX][2]; /* of these, distinct */
	unsigned label[SEGMENTS_MAX];      /* a bit for each that it has an odd number of times */
	uint32_t nsegment, ncrossing;
	bool is_piece[HOT_MAX][HOT_MAX];
	uint8_t odd[HOT_MAX][HOT_MAX]; /* a bit for each label */
};

static uint32_t put(struct mesh_vertex *list, uint32_t *n, int32_t x, int32_t y, int32_t z, bool highest)
{
	for (uint32_t i = 0; i < *n; i++)
		if (list[i].x == x && list[i].y == y) {
			if (highest ? z > list[i].z : z < list[i].z)
				list[i].z = z;
			return i;
		}
	list[*n] = (struct mesh_vertex){x, y, z};
	return (*n)++;
}

static geom_i128 cross(const struct mesh_vertex *a, const struct mesh_vertex *b, int64_t x, int64_t y, int64_t scale)
{
	return (geom_i128)((int64_t)b->x - a->x) * (y - scale * a->y) - (geom_i128)((int64_t)b->y - a->y) * (x - scale * a->x);
}

static int sign(geom_i128 v)
{
	return (v > 0) - (v < 0);
}

/* n / d, rounded to the nearest integer, halves up: by search. */
static int32_t nearest(geom_i128 n, geom_i128 d)
{
	geom_i128 v = n / d - 2;

	if (d < 0)
		n = -n, d = -d;
	while (2 * n >= (2 * v + 1) * d)
		v++;
	return (int32_t)v;
}

static void brute_crossing(const struct set *s, struct brute *b, const uint32_t i[2], const uint32_t k[2])
{
	const struct mesh_vertex *p = &b->own[i[0]], *q = &b->own[i[1]], *r = &b->own[k[0]], *t = &b->own[k[1]];
	geom_i128 pr = cross(r, t, p->x, p->y, 1), qr = cross(r, t, q->x, q->y, 1);
	geom_i128 rp = cross(p, q, r->x, r->y, 1), tp = cross(p, q, t->x, t->y, 1);
	int32_t x, y;

	if (sign(pr) * sign(qr) >= 0 || sign(rp) * sign(tp) >= 0)
		return;
	/* Weighted means of the ends. */
	x = nearest(p->x * qr - q->x * pr, qr - pr);
	y = nearest(p->y * qr - q->y * pr, qr - pr);
	put(b->hot, &b->nhot, x, y, nearest(p->z * qr - q->z * pr, qr - pr), s->highest);
	put(b->hot, &b->nhot, x, y, nearest(r->z * tp - t->z * rp, tp - rp), s->highest);
	b->ncrossing++;
}

/* Numbers are below 100, so a pixel without its upper sides is one that is smaller by 1/16384 there. */
static bool brute_meets(const struct mesh_vertex *p, const struct mesh_vertex *q, const struct mesh_vertex *c)
{
	const int64_t unit = 16384;
	int64_t x[2] = {c->x * unit - unit / 2, c->x * unit + unit / 2 - 1},
		y[2] = {c->y * unit - unit / 2, c->y * unit + unit / 2 - 1};
	int left = 0, right = 0;

	if ((p->x * unit < x[0] && q->x * unit < x[0]) || (p->x * unit > x[1] && q->x * unit > x[1]) ||
	    (p->y * unit < y[0] && q->y * unit < y[0]) || (p->y * unit > y[1] && q->y * unit > y[1]))
		return false;
	for (unsigned k = 0; k < 4; k++) {
		geom_i128 side = cross(p, q, x[k & 1], y[k >> 1], unit);

		left += side > 0;
		right += side < 0;
	}
	return left < 4 && right < 4;
}

static void brute_divide(struct brute *b, uint32_t from, uint32_t to, unsigned odd)
{
	const struct mesh_vertex *p = &b->hot[from], *q = &b->hot[to];

	for (uint32_t i = 0; i < b->nhot; i++) {
		int64_t before = ((int64_t)q->x - p->x) * ((int64_t)b->hot[i].x - p->x) +
				 ((int64_t)q->y - p->y) * ((int64_t)b->hot[i].y - p->y);
		int64_t all = ((int64_t)q->x - p->x) * ((int64_t)q->x - p->x) + ((int64_t)q->y - p->y) * ((int64_t)q->y - p->y);

		if (cross(p, q, b->hot[i].x, b->hot[i].y, 1) || before <= 0 || before >= all)
			continue;
		brute_divide(b, from, i, odd);
		brute_divide(b, i, to, odd);
		return;
	}
	b->is_piece[from][to] = b->is_piece[to][from] = true;
	b->odd[from][to] ^= odd;
	b->odd[to][from] ^= odd;
}

static void brute_segment(struct brute *b, const uint32_t ends[2], unsigned odd)
{
	const struct mesh_vertex *p = &b->own[ends[0]], *q = &b->own[ends[1]];
	int64_t dx = (int64_t)q->x - p->x, dy = (int64_t)q->y - p->y, last = INT64_MIN;
	uint32_t from = UINT32_MAX;

	for (;;) {
		uint32_t next = UINT32_MAX;
		int64_t nearest_along = INT64_MAX;

		for (uint32_t i = 0; i < b->nhot; i++) {
			int64_t along = dx * b->hot[i].x + dy * b->hot[i].y;

			if (along > last && along < nearest_along && brute_meets(p, q, &b->hot[i])) {
				nearest_along = along;
				next = i;
			}
		}
		if (next == UINT32_MAX)
			return;
		if (from != UINT32_MAX)
			brute_divide(b, from, next, odd);
		from = next;
		last = nearest_along;
	}
}

static void brute_round(const struct set *s, struct brute *b, bool pieces)
{
	uint32_t at[VERTICES_MAX];

	memset(b, 0, sizeof(*b));
	for (uint32_t i = 0; i < s->nvertex; i++)
		at[i] = put(b->own, &b->nown, s->v[i].x, s->v[i].y, s->v[i].z, s->highest);
	memcpy(b->hot, b->own, sizeof(b->own));
	b->nhot = b->nown;
	for (uint32_t i = 0; i < s->nsegment; i++) {
		uint32_t p = at[s->segment[i][0]], q = at[s->segment[i][1]], k = 0;

		while (k < b->nsegment && !(b->segment[k][0] == p && b->segment[k][1] == q) &&
		       !(b->segment[k][0] == q && b->segment[k][1] == p))
			k++;
		if (p == q)
			continue;
		b->label[k] ^= s->label[i] ? 1u << s->label[i] : 0;
		if (k < b->nsegment)
			continue;
		b->segment[k][0] = p;
		b->segment[k][1] = q;
		b->nsegment++;
	}
	for (uint32_t i = 0; i < b->nsegment; i++)
		for (uint32_t k = 0; k < i; k++)
			brute_crossing(s, b, b->segment[i], b->segment[k]);
	for (uint32_t i = 0; i < b->nsegment && pieces; i++)
		brute_segment(b, b->segment[i], b->label[i]);
}

static const char *brute_wrong(struct brute *b, const struct snap *l, bool highest, bool pieces)
{
	uint32_t at[HOT_MAX], npiece = 0;

	if (l->nvertex != b->nhot || l->ncrossing != b->ncrossing)
		return "the number of vertices or crossings";
	for (uint32_t i = 0; i < l->nvertex; i++) {
		for (at[i] = 0; at[i] < b->nhot; at[i]++)
			if (l->vertex[i].x == b->hot[at[i]].x && l->vertex[i].y == b->hot[at[i]].y &&
			    (highest ? l->highest[i] : l->vertex[i].z) == b->hot[at[i]].z)
				break;
		if (at[i] == b->nhot)
			return "a vertex or its height";
	}
	if (!pieces)
		return NULL;
	for (uint32_t i = 0; i < b->nhot; i++)
		for (uint32_t k = 0; k < i; k++)
			npiece += b->is_piece[i][k];
	if (npiece != l->npiece)
		return "the number of pieces";
	for (uint32_t i = 0, next = 0; i < l->npiece; i++) {
		if (!b->is_piece[at[l->piece[i][0]]][at[l->piece[i][1]]])
			return "a piece";
		for (uint32_t k = 0; k < l->nalong; k++)
			if (l->along[k][1] == i)
				b->odd[at[l->piece[i][0]]][at[l->piece[i][1]]] ^= 1u << l->along[k][0];
		next += b->odd[at[l->piece[i][0]]][at[l->piece[i][1]]];
		if (next)
			return "labels of a piece";
	}
	return NULL;
}

/* Sorted, nothing twice, and no crossing left: the kernel takes all pieces. */
static const char *result_wrong(const struct snap *l)
{
	const char *wrong = NULL;
	struct tri_pieces *p;
	struct tri *t;

	for (uint32_t i = 1; i < l->nvertex; i++)
		if (l->vertex[i].x < l->vertex[i - 1].x ||
		    (l->vertex[i].x == l->vertex[i - 1].x && l->vertex[i].y <= l->vertex[i - 1].y))
			return "vertices are not in order";
	for (uint32_t i = 0; i < l->npiece; i++)
		if (l->piece[i][0] >= l->piece[i][1] || (i && memcmp(l->piece[i], l->piece[i - 1], sizeof(l->piece[i])) == 0))
			return "pieces are not in order";
	for (uint32_t i = 0; i < l->ncrossing; i++) {
		const struct snap_crossing *c = &l->crossing[i], *before = c - (i > 0);

		if (c->lower > c->upper || before->x > c->x || (before->x == c->x && before->y > c->y))
			return "crossings are not in order";
	}
	t = check_tri(l->vertex, l->nvertex);
	if (!t)
		return NULL;
	p = check_pieces(t, 2 * l->nvertex);
	for (uint32_t i = 0; i < l->npiece && !wrong; i++) {
		uint32_t at;

		if (tri_piece_insert(p, l->piece[i][0], l->piece[i][1], &at))
			wrong = "pieces cross, or a vertex is on one";
	}
	free(p);
	free(t);
	return wrong;
}

static bool same(const struct snap *a, const struct snap *b)
{
	return a->nvertex == b->nvertex && a->npiece == b->npiece && a->ncrossing == b->ncrossing && a->points == b->points &&
	       a->doubled == b->doubled && a->nuneven == b->nuneven && a->nalong == b->nalong && a->widest == b->widest &&
	       !memcmp(a->widest_at, b->widest_at, sizeof(a->widest_at)) &&
	       !memcmp(a->highest, b->highest, a->nvertex * sizeof(*a->highest)) &&
	       (!a->nuneven || !memcmp(a->uneven, b->uneven, a->nuneven * sizeof(*a->uneven))) &&
	       (!a->nalong || !memcmp(a->along, b->along, a->nalong * sizeof(*a->along))) &&
	       !memcmp(a->vertex, b->vertex, a->nvertex * sizeof(*a->vertex)) &&
	       (!a->npiece || !memcmp(a->piece, b->piece, a->npiece * sizeof(*a->piece))) &&
	       (!a->ncrossing || !memcmp(a->crossing, b->crossing, a->ncrossing * sizeof(*a->crossing)));
}

static const char *run_case(const struct set *s, enum family family, uint64_t *state, uint64_t *crossings)
{
	static struct brute brute;
	static struct err err;
	struct set other;
	struct snap l, again;
	const char *wrong;

	err = ERR_INIT;
	if (snap_round(s->v, s->nvertex, (const uint32_t(*)[2])s->segment, s->label, s->nsegment, 1 << 20, &l, &err))
		return err.message;
	wrong = result_wrong(&l);
	*crossings += l.ncrossing;
	shuffle(s, &other, state);
	if (!wrong && snap_round(other.v, other.nvertex, (const uint32_t(*)[2])other.segment, other.label, other.nsegment,
				 1 << 20, &again, &err) == 0) {
		if (!same(&l, &again))
			wrong = "depends on the order";
		snap_done(&again);
	}
	brute_round(s, &brute, family <= PARALLEL);
	if (!wrong)
		wrong = brute_wrong(&brute, &l, s->highest, family <= PARALLEL);
	snap_done(&l);
	return wrong;
}

static int fail(const struct set *s, uint64_t number, const char *why)
{
	printf("case %" PRIu64 ": %s;", number, why);
	for (uint32_t i = 0; i < s->nsegment; i++) {
		const struct mesh_vertex *a = &s->v[s->segment[i][0]], *b = &s->v[s->segment[i][1]];

		printf(" (%" PRId32 ",%" PRId32 ")-(%" PRId32 ",%" PRId32 ")", a->x, a->y, b->x, b->y);
	}
	printf("\n");
	return 1;
}

int main(int argc, char **argv)
{
	uint64_t cases = repeat_cases(argc > 1 ? strtoull(argv[1], NULL, 10) : 500000), crossings = 0;
	uint64_t state = (argc > 2 ? strtoull(argv[2], NULL, 10) : repeat_first()) * 2 + 1;

	for (uint64_t i = 0; i < cases; i++) {
		enum family family = (enum family)(i % FAMILIES);
		const char *wrong;
		struct set s;

		draw(&s, family, &state);
		wrong = run_case(&s, family, &state, &crossings);
		if (wrong)
			return fail(&s, i, wrong);
	}
	printf("%" PRIu64 " sets, %" PRIu64 " crossings\n", cases, crossings);
	return 0;
}
