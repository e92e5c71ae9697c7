/*
 * Snap rounding, step by step (docs/design/constraints.md, "Snap rounding"): vertices, segments, crossings, the pixels
 * that each segment meets, pieces. What a step hands on is sorted and has nothing twice, so the order of the input is
 * forgotten in the first two.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "geom.h"
#include "snap_priv.h"

/* Distinct positions, in order: as words, as positions, and the lowest and highest height at each. */
struct places {
	struct snap_array word, xy, z;
};

/* Sorts as two words. */
struct crossing {
	uint64_t place, heights;
};

struct round {
	struct snap_memory memory;
	bool highest;
	struct places vertex, hot; /* of the input; these and the crossings */
	struct snap_array number;  /* of each vertex of the input: its place */
	struct snap_array end;     /* of each segment: the places of its ends, the smaller one first */
	struct snap_array crossing;
	struct snap_array piece; /* two hot places, as a word */
	struct snap_set segments;
	struct snap *ret;
};

static struct places places_none(void)
{
	return (struct places){{.size = sizeof(uint64_t)}, {.size = 2 * sizeof(int32_t)}, {.size = 2 * sizeof(int32_t)}};
}

static void places_done(struct snap_memory *m, struct places *p)
{
	snap_array_done(m, &p->word);
	snap_array_done(m, &p->xy);
	snap_array_done(m, &p->z);
}

/* From the words in any order. There are no heights yet. */
static int places_make(struct snap_memory *m, struct places *p)
{
	int wrong = snap_sort_unique(m, &p->word);
	size_t n = p->word.n;

	if (!wrong && n >= UINT32_MAX)
		wrong = err_set(m->err, ERR_LIMIT, "the lines have more than %u vertices and crossings", UINT32_MAX);
	if (!wrong)
		wrong = snap_array_room(m, &p->xy, n);
	if (!wrong)
		wrong = snap_array_room(m, &p->z, n);
	for (size_t i = 0; !wrong && i < n; i++) {
		uint64_t word = ((const uint64_t *)p->word.at)[i];
		int32_t *xy = ((int32_t(*)[2])p->xy.at)[i], *z = ((int32_t(*)[2])p->z.at)[i];

		xy[0] = snap_word_x(word);
		xy[1] = snap_word_y(word);
		z[0] = INT32_MAX;
		z[1] = INT32_MIN;
	}
	p->xy.n = p->z.n = n;
	return wrong;
}

static uint32_t places_find(const struct places *p, uint64_t word)
{
	const uint64_t *at = p->word.at;
	uint32_t from = 0, to = (uint32_t)p->word.n;

	while (to - from > 1) {
		uint32_t middle = from + (to - from) / 2;

		if (at[middle] <= word)
			from = middle;
		else
			to = middle;
	}
	return from;
}

static void places_height(struct places *p, uint32_t i, int32_t z)
{
	int32_t *at = ((int32_t(*)[2])p->z.at)[i];

	at[0] = z < at[0] ? z : at[0];
	at[1] = z > at[1] ? z : at[1];
}

static int32_t height_at(const struct round *r, const struct places *p, uint32_t i)
{
	return ((const int32_t(*)[2])p->z.at)[i][r->highest];
}

static int take_vertices(struct round *r, const struct mesh_vertex *v, uint32_t n)
{
	int wrong = snap_array_room(&r->memory, &r->vertex.word, n);

	for (uint32_t i = 0; !wrong && i < n; i++)
		((uint64_t *)r->vertex.word.at)[i] = snap_word(v[i].x, v[i].y);
	r->vertex.word.n = wrong ? 0 : n;
	if (!wrong)
		wrong = places_make(&r->memory, &r->vertex);
	if (!wrong)
		wrong = snap_array_room(&r->memory, &r->number, n);
	for (uint32_t i = 0; !wrong && i < n; i++) {
		uint32_t place = places_find(&r->vertex, snap_word(v[i].x, v[i].y));

		((uint32_t *)r->number.at)[i] = place;
		places_height(&r->vertex, place, v[i].z);
	}
	for (size_t i = 0; !wrong && i < r->vertex.word.n; i++) {
		const int32_t *z = ((const int32_t(*)[2])r->vertex.z.at)[i];
		uint32_t wide = (uint32_t)z[1] - (uint32_t)z[0];

		r->ret->uneven += wide > 0;
		if (wide <= r->ret->widest)
			continue;
		r->ret->widest = wide;
		memcpy(r->ret->widest_at, ((const int32_t(*)[2])r->vertex.xy.at)[i], sizeof(r->ret->widest_at));
	}
	return wrong;
}

/* From words of two numbers to pairs. */
static int pairs_of_words(struct snap_memory *m, const struct snap_array *word, struct snap_array *ret)
{
	int wrong = snap_array_room(m, ret, word->n);

	if (!wrong && word->n >= UINT32_MAX)
		wrong = err_set(m->err, ERR_LIMIT, "the lines have more than %u pieces", UINT32_MAX);
	for (size_t i = 0; !wrong && i < word->n; i++) {
		uint64_t w = ((const uint64_t *)word->at)[i];

		((uint32_t(*)[2])ret->at)[i][0] = (uint32_t)(w >> 32);
		((uint32_t(*)[2])ret->at)[i][1] = (uint32_t)w;
	}
	ret->n = wrong ? 0 : word->n;
	return wrong;
}

static uint64_t pair_word(uint32_t a, uint32_t b)
{
	return a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
}

static int take_segments(struct round *r, const uint32_t (*segment)[2], uint32_t n)
{
	struct snap_array word = {.size = sizeof(uint64_t)};
	const uint32_t *number = r->number.at;
	int wrong = 0;

	for (uint32_t i = 0; !wrong && i < n; i++) {
		uint32_t a = number[segment[i][0]], b = number[segment[i][1]];
		uint64_t both = pair_word(a, b);

		if (a == b)
			r->ret->points++;
		else
			wrong = snap_array_add(&r->memory, &word, &both);
	}
	r->ret->doubled = (uint32_t)word.n;
	if (!wrong)
		wrong = snap_sort_unique(&r->memory, &word);
	r->ret->doubled -= (uint32_t)word.n;
	if (!wrong)
		wrong = pairs_of_words(&r->memory, &word, &r->end);
	snap_array_done(&r->memory, &word);
	snap_array_done(&r->memory, &r->number);
	r->segments = (struct snap_set){r->vertex.xy.at, r->end.at, (uint32_t)r->end.n};
	return wrong;
}

static int add_crossing(void *ctx, uint32_t i, uint32_t k, const int32_t at[2])
{
	struct round *r = ctx;
	struct snap_segment s = snap_segment_of(&r->segments, i), t = snap_segment_of(&r->segments, k);
	const uint32_t *si = r->segments.end[i], *ti = r->segments.end[k];
	int32_t a = snap_cross_height(&s, height_at(r, &r->vertex, si[0]), height_at(r, &r->vertex, si[1]), &t);
	int32_t b = snap_cross_height(&t, height_at(r, &r->vertex, ti[0]), height_at(r, &r->vertex, ti[1]), &s);
	struct crossing c = {snap_word(at[0], at[1]), a < b ? snap_word(a, b) : snap_word(b, a)};

	if (r->crossing.n >= UINT32_MAX)
		return err_set(r->memory.err, ERR_LIMIT, "the lines cross more than %u times", UINT32_MAX);
	return snap_array_add(&r->memory, &r->crossing, &c);
}

static int find_crossings(struct round *r)
{
	int wrong = snap_join_pairs(&r->memory, &r->segments, add_crossing, r);

	for (unsigned by = 2; by-- > 0 && !wrong;)
		wrong = snap_sort(&r->memory, r->crossing.at, r->crossing.n, 2, by);
	return wrong;
}

/* The vertices and the crossings, with their heights. */
static int make_hot(struct round *r)
{
	const struct crossing *c = r->crossing.at;
	size_t nvertex = r->vertex.word.n;
	int wrong = snap_array_room(&r->memory, &r->hot.word, nvertex + r->crossing.n);
	uint64_t *word = r->hot.word.at;

	if (wrong)
		return wrong;
	if (nvertex)
		memcpy(word, r->vertex.word.at, nvertex * sizeof(*word));
	for (size_t i = 0; i < r->crossing.n; i++)
		word[nvertex + i] = c[i].place;
	r->hot.word.n = nvertex + r->crossing.n;
	wrong = places_make(&r->memory, &r->hot);
	if (wrong)
		return wrong;
	for (uint32_t i = 0; i < nvertex; i++)
		places_height(&r->hot, places_find(&r->hot, ((const uint64_t *)r->vertex.word.at)[i]),
			      height_at(r, &r->vertex, i));
	for (size_t i = 0; i < r->crossing.n; i++) {
		uint32_t place = places_find(&r->hot, c[i].place);

		places_height(&r->hot, place, snap_word_x(c[i].heights));
		places_height(&r->hot, place, snap_word_y(c[i].heights));
	}
	return 0;
}

static int add_meeting(void *ctx, uint32_t i, uint32_t point)
{
	void *const *to = ctx;
	uint64_t word = (uint64_t)i << 32 | point;

	return snap_array_add(to[0], to[1], &word);
}

/* The places of one segment, in their order, to that along the segment: by x upwards already, and by y upwards, too. */
static void order_along(const struct round *r, uint64_t *word, size_t n)
{
	const int32_t(*xy)[2] = r->hot.xy.at;

	for (size_t from = 0, to; from < n; from = to) {
		for (to = from + 1; to < n && xy[(uint32_t)word[to]][0] == xy[(uint32_t)word[from]][0]; to++)
			;
		for (size_t a = from, b = to - 1; a < b; a++, b--) {
			uint64_t swap = word[a];

			word[a] = word[b];
			word[b] = swap;
		}
	}
}

/* From the pixels that each segment meets to pieces between neighbouring ones. No vertex is on a piece. */
static int make_pieces(struct round *r)
{
	struct snap_array met = {.size = sizeof(uint64_t)};
	void *to_met[2] = {&r->memory, &met};
	int wrong = snap_join_pixels(&r->memory, &r->segments, r->hot.xy.at, (uint32_t)r->hot.xy.n, add_meeting, to_met);
	uint64_t *word = met.at;

	if (!wrong)
		wrong = snap_sort(&r->memory, word, met.n, 1, 0);
	for (size_t from = 0, to; !wrong && from < met.n; from = to) {
		struct snap_segment s = snap_segment_of(&r->segments, (uint32_t)(word[from] >> 32));

		for (to = from; to < met.n && word[to] >> 32 == word[from] >> 32; to++)
			;
		if (s.b[1] < s.a[1])
			order_along(r, word + from, to - from);
		for (size_t i = from + 1; i < to && !wrong; i++) {
			uint64_t piece = pair_word((uint32_t)word[i - 1], (uint32_t)word[i]);

			wrong = snap_array_add(&r->memory, &r->piece, &piece);
		}
	}
	snap_array_done(&r->memory, &met);
	return wrong ? wrong : snap_sort_unique(&r->memory, &r->piece);
}

static int give_result(struct round *r)
{
	struct snap_array vertex = {.size = sizeof(struct mesh_vertex)}, piece = {.size = 2 * sizeof(uint32_t)};
	struct snap_array crossing = {.size = sizeof(struct snap_crossing)};
	size_t n = r->hot.word.n, ncrossing = r->crossing.n;
	const int32_t(*xy)[2] = r->hot.xy.at;
	int wrong = snap_array_room(&r->memory, &vertex, n);

	if (!wrong)
		wrong = snap_array_room(&r->memory, &crossing, ncrossing);
	if (!wrong)
		wrong = pairs_of_words(&r->memory, &r->piece, &piece);
	if (wrong) {
		snap_array_done(&r->memory, &crossing);
		snap_array_done(&r->memory, &vertex);
		return wrong;
	}
	r->ret->vertex = vertex.at;
	r->ret->crossing = crossing.at;
	r->ret->piece = piece.at;
	r->ret->nvertex = (uint32_t)n;
	r->ret->ncrossing = (uint32_t)ncrossing;
	r->ret->npiece = (uint32_t)piece.n;
	for (uint32_t i = 0; i < n; i++)
		r->ret->vertex[i] = (struct mesh_vertex){xy[i][0], xy[i][1], height_at(r, &r->hot, i)};
	for (size_t i = 0; i < ncrossing; i++) {
		const struct crossing *c = (const struct crossing *)r->crossing.at + i;

		r->ret->crossing[i] = (struct snap_crossing){snap_word_x(c->place), snap_word_y(c->place),
							     snap_word_x(c->heights), snap_word_y(c->heights)};
	}
	return 0;
}

int snap_round(const struct mesh_vertex *v, uint32_t nvertex, const uint32_t (*segment)[2], uint32_t nsegment, bool highest,
	       uint64_t memory, struct snap *ret, struct err *err)
{
	struct snap made = {0};
	struct round r = {.memory = {memory, memory, err},
			  .highest = highest,
			  .vertex = places_none(),
			  .hot = places_none(),
			  .number = {.size = sizeof(uint32_t)},
			  .end = {.size = 2 * sizeof(uint32_t)},
			  .crossing = {.size = sizeof(struct crossing)},
			  .piece = {.size = sizeof(uint64_t)},
			  .ret = &made};
	int wrong = take_vertices(&r, v, nvertex);

	if (!wrong)
		wrong = take_segments(&r, segment, nsegment);
	if (!wrong)
		wrong = find_crossings(&r);
	if (!wrong)
		wrong = make_hot(&r);
	if (!wrong)
		wrong = make_pieces(&r);
	if (!wrong)
		wrong = give_result(&r);
	places_done(&r.memory, &r.vertex);
	places_done(&r.memory, &r.hot);
	snap_array_done(&r.memory, &r.number);
	snap_array_done(&r.memory, &r.end);
	snap_array_done(&r.memory, &r.crossing);
	snap_array_done(&r.memory, &r.piece);
	if (!wrong)
		*ret = made;
	return wrong;
}

void snap_done(struct snap *l)
{
	free(l->vertex);
	free(l->piece);
	free(l->crossing);
	*l = (struct snap){0};
}
