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

/* Sorts as three words. Heights between the lowest heights of vertices, and between the highest. */
struct crossing {
	uint64_t place, lowest, highest;
};

/* What has a label: a segment or a piece as a word. Sorts as two words. */
struct labelled {
	uint64_t label, word;
};

struct round {
	struct snap_memory memory;
	struct places vertex, hot; /* of the input; these and the crossings */
	struct snap_array number;  /* of each vertex of the input: its place */
	struct snap_array end;     /* of each segment: the places of its ends, the smaller one first */
	struct snap_array ring;    /* segments with labels: number and label as a word, in order */
	struct snap_array crossing;
	struct snap_array piece; /* two hot places, as a word */
	struct snap_array along; /* pieces with labels */
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

static const int32_t *heights_at(const struct places *p, uint32_t i)
{
	return ((const int32_t(*)[2])p->z.at)[i];
}

static int take_uneven(struct round *r)
{
	struct snap_array list = {.size = sizeof(struct snap_crossing)};
	int wrong = 0;

	for (uint32_t i = 0; !wrong && i < r->vertex.word.n; i++) {
		const int32_t *z = heights_at(&r->vertex, i), *xy = ((const int32_t(*)[2])r->vertex.xy.at)[i];
		struct snap_crossing at = {xy[0], xy[1], z[0], z[1]};
		uint32_t wide = (uint32_t)z[1] - (uint32_t)z[0];

		if (wide)
			wrong = snap_array_add(&r->memory, &list, &at);
		if (wide <= r->ret->widest)
			continue;
		r->ret->widest = wide;
		memcpy(r->ret->widest_at, xy, sizeof(r->ret->widest_at));
	}
	r->ret->uneven = list.at; /* freed with the result */
	r->ret->nuneven = (uint32_t)list.n;
	return wrong;
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
	return wrong ? wrong : take_uneven(r);
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

/* Sorts, and keeps one of each that is there an odd number of times. */
static int labelled_odd(struct snap_memory *m, struct snap_array *list)
{
	struct labelled *l = list->at;
	size_t left = 0;
	int wrong = snap_sort(m, list->at, list->n, 2, 1);

	if (!wrong)
		wrong = snap_sort(m, list->at, list->n, 2, 0);
	for (size_t from = 0, to; !wrong && from < list->n; from = to) {
		for (to = from + 1; to < list->n && l[to].label == l[from].label && l[to].word == l[from].word; to++)
			;
		if ((to - from) & 1)
			l[left++] = l[from];
	}
	list->n = left;
	return wrong;
}

static uint32_t word_find(const struct snap_array *sorted, uint64_t word)
{
	const struct places p = {.word = *sorted};

	return places_find(&p, word);
}

/* `word`: all segments, in order. */
static int take_labels(struct round *r, const uint32_t (*segment)[2], const uint32_t *label, uint32_t n,
		       const struct snap_array *word)
{
	struct snap_array list = {.size = sizeof(struct labelled)};
	const uint32_t *number = r->number.at;
	int wrong = 0;

	for (uint32_t i = 0; !wrong && i < n; i++) {
		uint32_t a = number[segment[i][0]], b = number[segment[i][1]];
		struct labelled one = {label[i], pair_word(a, b)};

		if (label[i] && a != b)
			wrong = snap_array_add(&r->memory, &list, &one);
	}
	if (!wrong)
		wrong = labelled_odd(&r->memory, &list);
	for (size_t i = 0; !wrong && i < list.n; i++) {
		const struct labelled *l = (const struct labelled *)list.at + i;
		uint64_t both = (uint64_t)word_find(word, l->word) << 32 | l->label;

		wrong = snap_array_add(&r->memory, &r->ring, &both);
	}
	snap_array_done(&r->memory, &list);
	return wrong ? wrong : snap_sort(&r->memory, r->ring.at, r->ring.n, 1, 0);
}

static int take_segments(struct round *r, const uint32_t (*segment)[2], const uint32_t *label, uint32_t n)
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
	if (!wrong && label)
		wrong = take_labels(r, segment, label, n, &word);
	if (!wrong)
		wrong = pairs_of_words(&r->memory, &word, &r->end);
	snap_array_done(&r->memory, &word);
	snap_array_done(&r->memory, &r->number);
	r->segments = (struct snap_set){r->vertex.xy.at, r->end.at, (uint32_t)r->end.n};
	return wrong;
}

/* The heights of both lines, the lower one first, as a word. */
static uint64_t crossing_heights(const struct round *r, uint32_t i, uint32_t k, unsigned highest)
{
	struct snap_segment s = snap_segment_of(&r->segments, i), t = snap_segment_of(&r->segments, k);
	const uint32_t *si = r->segments.end[i], *ti = r->segments.end[k];
	int32_t a = snap_cross_height(&s, heights_at(&r->vertex, si[0])[highest], heights_at(&r->vertex, si[1])[highest], &t);
	int32_t b = snap_cross_height(&t, heights_at(&r->vertex, ti[0])[highest], heights_at(&r->vertex, ti[1])[highest], &s);

	return a < b ? snap_word(a, b) : snap_word(b, a);
}

static int add_crossing(void *ctx, uint32_t i, uint32_t k, const int32_t at[2])
{
	struct round *r = ctx;
	struct crossing c = {snap_word(at[0], at[1]), crossing_heights(r, i, k, 0), crossing_heights(r, i, k, 1)};

	if (r->crossing.n >= UINT32_MAX)
		return err_set(r->memory.err, ERR_LIMIT, "the lines cross more than %u times", UINT32_MAX);
	return snap_array_add(&r->memory, &r->crossing, &c);
}

static int find_crossings(struct round *r)
{
	int wrong = snap_join_pairs(&r->memory, &r->segments, add_crossing, r);

	for (unsigned by = 3; by-- > 0 && !wrong;)
		wrong = snap_sort(&r->memory, r->crossing.at, r->crossing.n, 3, by);
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
	for (uint32_t i = 0; i < nvertex; i++) {
		uint32_t place = places_find(&r->hot, ((const uint64_t *)r->vertex.word.at)[i]);

		places_height(&r->hot, place, heights_at(&r->vertex, i)[0]);
		places_height(&r->hot, place, heights_at(&r->vertex, i)[1]);
	}
	for (size_t i = 0; i < r->crossing.n; i++) {
		uint32_t place = places_find(&r->hot, c[i].place);

		/* Heights between the highest are not below those between the lowest: the lowest and the highest of all. */
		places_height(&r->hot, place, snap_word_x(c[i].lowest));
		places_height(&r->hot, place, snap_word_y(c[i].highest));
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

/* The pieces of one segment, which met these places in this order. */
static int add_pieces(struct round *r, const uint64_t *met, size_t n, const uint64_t *ring, size_t nring)
{
	int wrong = 0;

	for (size_t i = 1; i < n && !wrong; i++) {
		uint64_t piece = pair_word((uint32_t)met[i - 1], (uint32_t)met[i]);

		wrong = snap_array_add(&r->memory, &r->piece, &piece);
		for (size_t k = 0; k < nring && !wrong; k++) {
			struct labelled one = {(uint32_t)ring[k], piece};

			wrong = snap_array_add(&r->memory, &r->along, &one);
		}
	}
	return wrong;
}

/* From the pixels that each segment meets to pieces between neighbouring ones. No vertex is on a piece. */
static int make_pieces(struct round *r)
{
	struct snap_array met = {.size = sizeof(uint64_t)};
	void *to_met[2] = {&r->memory, &met};
	int wrong = snap_join_pixels(&r->memory, &r->segments, r->hot.xy.at, (uint32_t)r->hot.xy.n, add_meeting, to_met);
	uint64_t *word = met.at;
	const uint64_t *ring = r->ring.at, *end = ring + r->ring.n;

	if (!wrong)
		wrong = snap_sort(&r->memory, word, met.n, 1, 0);
	for (size_t from = 0, to; !wrong && from < met.n; from = to) {
		uint32_t i = (uint32_t)(word[from] >> 32);
		struct snap_segment s = snap_segment_of(&r->segments, i);
		size_t nring = 0;

		for (to = from; to < met.n && word[to] >> 32 == i; to++)
			;
		if (s.b[1] < s.a[1])
			order_along(r, word + from, to - from);
		for (; ring + nring < end && ring[nring] >> 32 == i; nring++)
			;
		wrong = add_pieces(r, word + from, to - from, ring, nring);
		ring += nring;
	}
	snap_array_done(&r->memory, &met);
	if (!wrong)
		wrong = snap_sort_unique(&r->memory, &r->piece);
	return wrong ? wrong : labelled_odd(&r->memory, &r->along);
}

/* Labels and numbers of pieces. */
static int give_along(struct round *r)
{
	struct snap_array along = {.size = 2 * sizeof(uint32_t)};
	int wrong = snap_array_room(&r->memory, &along, r->along.n);

	if (!wrong && r->along.n >= UINT32_MAX)
		wrong = err_set(r->memory.err, ERR_LIMIT, "the rings have more than %u pieces", UINT32_MAX);
	for (size_t i = 0; !wrong && i < r->along.n; i++) {
		const struct labelled *l = (const struct labelled *)r->along.at + i;
		uint32_t *to = ((uint32_t(*)[2])along.at)[i];

		to[0] = (uint32_t)l->label;
		to[1] = word_find(&r->piece, l->word);
	}
	r->ret->along = along.at;
	r->ret->nalong = (uint32_t)r->along.n;
	snap_array_done(&r->memory, &r->along);
	return wrong;
}

static int give_crossings(struct round *r)
{
	struct snap_array crossing = {.size = sizeof(struct snap_crossing)};
	size_t n = r->crossing.n;
	int wrong = snap_array_room(&r->memory, &crossing, n);

	for (size_t i = 0; !wrong && i < n; i++) {
		const struct crossing *c = (const struct crossing *)r->crossing.at + i;

		((struct snap_crossing *)crossing.at)[i] = (struct snap_crossing){snap_word_x(c->place), snap_word_y(c->place),
										  snap_word_x(c->lowest), snap_word_y(c->lowest)};
	}
	r->ret->crossing = crossing.at;
	r->ret->ncrossing = (uint32_t)n;
	return wrong;
}

static int give_vertices(struct round *r)
{
	struct snap_array vertex = {.size = sizeof(struct mesh_vertex)}, highest = {.size = sizeof(int32_t)};
	size_t n = r->hot.word.n;
	const int32_t(*xy)[2] = r->hot.xy.at;
	int wrong = snap_array_room(&r->memory, &vertex, n);

	r->ret->vertex = vertex.at;
	r->ret->nvertex = (uint32_t)n;
	if (!wrong)
		wrong = snap_array_room(&r->memory, &highest, n);
	r->ret->highest = highest.at;
	for (uint32_t i = 0; !wrong && i < n; i++) {
		const int32_t *z = heights_at(&r->hot, i);

		r->ret->vertex[i] = (struct mesh_vertex){xy[i][0], xy[i][1], z[0]};
		r->ret->highest[i] = z[1];
	}
	return wrong;
}

/* Whatever is made belongs to the result, also if something fails. */
static int give_result(struct round *r)
{
	struct snap_array piece = {.size = 2 * sizeof(uint32_t)};
	int wrong = give_along(r);

	if (!wrong)
		wrong = give_crossings(r);
	if (!wrong)
		wrong = give_vertices(r);
	if (!wrong)
		wrong = pairs_of_words(&r->memory, &r->piece, &piece);
	r->ret->piece = piece.at;
	r->ret->npiece = (uint32_t)piece.n;
	return wrong;
}

int snap_round(const struct mesh_vertex *v, uint32_t nvertex, const uint32_t (*segment)[2], const uint32_t *label,
	       uint32_t nsegment, uint64_t memory, struct snap *ret, struct err *err)
{
	struct snap made = {0};
	struct round r = {.memory = {memory, memory, err},
			  .vertex = places_none(),
			  .hot = places_none(),
			  .number = {.size = sizeof(uint32_t)},
			  .end = {.size = 2 * sizeof(uint32_t)},
			  .ring = {.size = sizeof(uint64_t)},
			  .crossing = {.size = sizeof(struct crossing)},
			  .piece = {.size = sizeof(uint64_t)},
			  .along = {.size = sizeof(struct labelled)},
			  .ret = &made};
	int wrong = take_vertices(&r, v, nvertex);

	if (!wrong)
		wrong = take_segments(&r, segment, label, nsegment);
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
	snap_array_done(&r.memory, &r.ring);
	snap_array_done(&r.memory, &r.piece);
	snap_array_done(&r.memory, &r.along);
	if (!wrong)
		*ret = made;
	else
		snap_done(&made);
	return wrong;
}

uint64_t snap_bytes(const struct snap *l)
{
	return (uint64_t)l->nvertex * (sizeof(*l->vertex) + sizeof(*l->highest)) + (uint64_t)l->npiece * sizeof(*l->piece) +
	       (uint64_t)l->nalong * sizeof(*l->along) + ((uint64_t)l->ncrossing + l->nuneven) * sizeof(*l->crossing);
}

void snap_done(struct snap *l)
{
	free(l->vertex);
	free(l->highest);
	free(l->piece);
	free(l->along);
	free(l->crossing);
	free(l->uneven);
	*l = (struct snap){0};
}
