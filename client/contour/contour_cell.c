/*
 * The vertices of one cell: which of them stay.
 *
 * A vertex v between p and n leaves if all vertices that were between p and n are within the tolerance of the segment from p to
 * n, and the closed triangle p v n has no other vertex that is left, of any line. So nothing crosses the new segment that did not
 * meet the two old ones: docs/design/contours.md has the proof. What is least far off leaves first, and of equals what comes
 * first in the order of lines and points.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "contour_simplify.h"
#include "err.h"

#define NONE CONTOUR_NONE
enum {
	RING_LEAST = 4, /* places that a ring keeps, if it has them */
	CHAIN = 512,    /* vertices that one segment may replace: a long straight line costs no more than any other */
	TRIES = 32,     /* as often a vertex is looked at again since another one has left */
};

/* Vertices by their numbers: those of a line that follow each other do so here. */
struct contour_cell {
	double limit; /* the square of the tolerance */
	const struct contour_vertex *vertex;
	size_t n;
	struct order {
		uint64_t number;
		uint32_t slot; /* in `vertex` */
	} * order;
	double (*at)[2];
	uint32_t *previous, *next; /* NONE: in another cell; of the first of a ring, and the last, the other one of these two */
	double *far;               /* the square of the distance if it left */
	uint32_t *heap, *place;    /* place: NONE: not in the heap */
	size_t nheap;
	uint32_t *found;               /* slot of a vertex that was in the triangle */
	uint32_t *first;               /* by slot: who waits for it */
	uint32_t *before, *after;      /* in that list */
	uint8_t *waits, *tries, *gone; /* gone: by slot */
	struct contour_tree *tree;
};

struct contour_cell *contour_cell_free(struct contour_cell *c)
{
	if (c) {
		free(c->order);
		free(c->at);
		free(c->previous);
		free(c->next);
		free(c->far);
		free(c->heap);
		free(c->place);
		free(c->found);
		free(c->first);
		free(c->before);
		free(c->after);
		free(c->waits);
		free(c->tries);
		free(c->gone);
		contour_tree_free(c->tree);
	}
	free(c);
	return NULL;
}

int contour_cell_new(unsigned vertices, double tolerance, struct contour_cell **ret, struct err *err)
{
	struct contour_cell *c = calloc(1, sizeof(*c));
	double least = tolerance * (1 - 0x1p-30); /* more than roundings can add */

	if (c) {
		c->limit = least * least;
		c->order = malloc(vertices * sizeof(*c->order));
		c->at = malloc(vertices * sizeof(*c->at));
		c->previous = malloc(vertices * sizeof(*c->previous));
		c->next = malloc(vertices * sizeof(*c->next));
		c->far = malloc(vertices * sizeof(*c->far));
		c->heap = malloc(vertices * sizeof(*c->heap));
		c->place = malloc(vertices * sizeof(*c->place));
		c->found = malloc(vertices * sizeof(*c->found));
		c->first = malloc(vertices * sizeof(*c->first));
		c->before = malloc(vertices * sizeof(*c->before));
		c->after = malloc(vertices * sizeof(*c->after));
		c->waits = malloc(vertices);
		c->tries = malloc(vertices);
		c->gone = malloc(vertices);
	}
	if (!c || !c->order || !c->at || !c->previous || !c->next || !c->far || !c->heap || !c->place || !c->found || !c->first ||
	    !c->before || !c->after || !c->waits || !c->tries || !c->gone) {
		contour_cell_free(c);
		return err_set(err, ERR_NOMEM, "no memory to simplify contours");
	}
	if (contour_tree_new(vertices, &c->tree, err)) {
		contour_cell_free(c);
		return -err->code;
	}
	*ret = c;
	return 0;
}

/* ---- lines in the cell ---- */

static int by_number(const void *a, const void *b)
{
	const struct order *p = a, *q = b;

	return p->number < q->number ? -1 : p->number > q->number;
}

static bool is(const struct contour_cell *c, uint32_t i, unsigned mark)
{
	return (c->order[i].number & mark) != 0;
}

static void link(struct contour_cell *c)
{
	uint32_t ring = NONE;

	for (uint32_t i = 0; i < c->n; i++)
		c->previous[i] = c->next[i] = NONE;
	for (uint32_t i = 0; i < c->n; i++) {
		if (is(c, i, CONTOUR_RING) && is(c, i, CONTOUR_FIRST))
			ring = i;
		if (is(c, i, CONTOUR_RING) && is(c, i, CONTOUR_LAST) && ring != NONE) { /* one place, so both are in this cell */
			c->previous[ring] = i;
			c->next[i] = ring;
		}
		if (i + 1 == c->n || is(c, i, CONTOUR_LAST) ||
		    c->order[i].number / CONTOUR_MARKS + 1 != c->order[i + 1].number / CONTOUR_MARKS)
			continue;
		c->next[i] = i + 1;
		c->previous[i + 1] = i;
	}
}

static bool is_fixed(const struct contour_cell *c, uint32_t i)
{
	return is(c, i, CONTOUR_FIRST | CONTOUR_LAST) || c->previous[i] == NONE || c->next[i] == NONE;
}

/* Of the first vertex of a ring the last one, and the other way round. */
static uint32_t twin(const struct contour_cell *c, uint32_t i)
{
	if (!is(c, i, CONTOUR_RING))
		return NONE;
	return is(c, i, CONTOUR_FIRST) ? c->previous[i] : is(c, i, CONTOUR_LAST) ? c->next[i] : NONE;
}

static bool is_small_ring(const struct contour_cell *c, uint32_t i)
{
	uint32_t at = i;

	for (int k = 0; k < RING_LEAST && at != NONE; k++) {
		at = c->next[at];
		if (at != NONE && is(c, at, CONTOUR_LAST))
			at = twin(c, at);
		if (at == i)
			return true;
	}
	return false;
}

/* ---- the tolerance ---- */

static double square(const double *a, const double *b)
{
	double x = a[0] - b[0], y = a[1] - b[1];

	return x * x + y * y;
}

/* From the segment. */
static double distance(const double *from, const double *to, const double *at)
{
	double x = to[0] - from[0], y = to[1] - from[1], length = x * x + y * y;
	double ax = at[0] - from[0], ay = at[1] - from[1], along = ax * x + ay * y, across;

	if (along <= 0)
		return ax * ax + ay * ay;
	if (along >= length)
		return square(at, to);
	across = fabs(x * ay - y * ax) + 0x1p-50 * (fabs(x * ay) + fabs(y * ax));
	return across * across / length;
}

/* INFINITY: it has to stay. */
static double far_of(const struct contour_cell *c, uint32_t i)
{
	uint32_t from = c->previous[i], to = c->next[i];
	double most = 0;

	if (to - from > CHAIN || (c->at[from][0] == c->at[to][0] && c->at[from][1] == c->at[to][1]))
		return INFINITY;
	for (uint32_t k = from + 1; k < to; k++) {
		double d = distance(c->at[from], c->at[to], c->at[k]);

		most = d > most ? d : most;
		if (most > c->limit)
			return INFINITY;
	}
	return most;
}

/* ---- the heap ---- */

static bool sooner(const struct contour_cell *c, uint32_t a, uint32_t b)
{
	return c->far[a] != c->far[b] ? c->far[a] < c->far[b] : a < b;
}

static void put(struct contour_cell *c, size_t at, uint32_t i)
{
	c->heap[at] = i;
	c->place[i] = (uint32_t)at;
}

static void sift(struct contour_cell *c, size_t at)
{
	uint32_t i = c->heap[at];

	for (; at && sooner(c, i, c->heap[(at - 1) / 2]); at = (at - 1) / 2)
		put(c, at, c->heap[(at - 1) / 2]);
	for (size_t child; (child = 2 * at + 1) < c->nheap; at = child) {
		if (child + 1 < c->nheap && sooner(c, c->heap[child + 1], c->heap[child]))
			child++;
		if (!sooner(c, c->heap[child], i))
			break;
		put(c, at, c->heap[child]);
	}
	put(c, at, i);
}

static void drop(struct contour_cell *c, uint32_t i)
{
	size_t at = c->place[i];
	uint32_t last = c->heap[--c->nheap];

	c->place[i] = NONE;
	if (last == i)
		return;
	put(c, at, last);
	sift(c, at);
}

static void enter(struct contour_cell *c, uint32_t i)
{
	if (c->place[i] == NONE)
		put(c, c->nheap++, i);
	sift(c, c->place[i]);
}

/* ---- those that wait for a vertex in their triangle to leave: a list for each slot ---- */

static void wait_for(struct contour_cell *c, uint32_t i)
{
	uint32_t *first = &c->first[c->found[i]];

	c->after[i] = *first;
	c->before[i] = NONE;
	if (*first != NONE)
		c->before[*first] = i;
	*first = i;
	c->waits[i] = true;
}

static void wait_no_more(struct contour_cell *c, uint32_t i)
{
	if (!c->waits[i])
		return;
	*(c->before[i] == NONE ? &c->first[c->found[i]] : &c->after[c->before[i]]) = c->after[i];
	if (c->after[i] != NONE)
		c->before[c->after[i]] = c->before[i];
	c->waits[i] = false;
}

/* Its neighbours are others now. */
static void judge(struct contour_cell *c, uint32_t i)
{
	if (is_fixed(c, i))
		return;
	wait_no_more(c, i);
	c->far[i] = far_of(c, i);
	if (!isinf(c->far[i]))
		enter(c, i);
	else if (c->place[i] != NONE)
		drop(c, i);
}

/* ---- */

/* Whether the triangle of the vertex and its neighbours is empty; else what is in it is found[i]. */
static bool is_free(struct contour_cell *c, uint32_t i)
{
	uint32_t from = c->previous[i], to = c->next[i], other[2] = {twin(c, from), twin(c, to)};
	const double *const corner[3] = {c->at[from], c->at[i], c->at[to]};
	const uint32_t but[CONTOUR_BUT] = {c->order[from].slot, c->order[i].slot, c->order[to].slot,
					   other[0] == NONE ? NONE : c->order[other[0]].slot,
					   other[1] == NONE ? NONE : c->order[other[1]].slot};

	return !contour_tree_meets(c->tree, corner, but, &c->found[i]);
}

static void leave(struct contour_cell *c, uint32_t i)
{
	uint32_t from = c->previous[i], to = c->next[i], slot = c->order[i].slot, waits;

	c->gone[slot] = true;
	contour_tree_remove(c->tree, slot);
	while ((waits = c->first[slot]) != NONE) {
		wait_no_more(c, waits);
		if (++c->tries[waits] < TRIES)
			enter(c, waits);
	}
	c->next[from] = to;
	c->previous[to] = from;
	judge(c, from);
	judge(c, to);
}

void contour_cell_simplify(struct contour_cell *c, const struct contour_vertex *vertex, size_t n)
{
	c->vertex = vertex;
	c->n = n;
	c->nheap = 0;
	for (uint32_t i = 0; i < n; i++)
		c->order[i] = (struct order){vertex[i].number, i};
	qsort(c->order, n, sizeof(*c->order), by_number);
	for (size_t i = 0; i < n; i++) {
		memcpy(c->at[i], vertex[c->order[i].slot].at, sizeof(*c->at));
		c->place[i] = c->found[i] = c->first[i] = NONE;
		c->waits[i] = c->gone[i] = false;
		c->tries[i] = 0;
	}
	link(c);
	contour_tree_fill(c->tree, vertex, n);
	for (uint32_t i = 0; i < n; i++)
		judge(c, i);
	while (c->nheap) {
		uint32_t i = c->heap[0];

		drop(c, i);
		if (is_small_ring(c, i))
			continue;
		if (is_free(c, i))
			leave(c, i);
		else
			wait_for(c, i);
	}
}

bool contour_cell_keeps(const struct contour_cell *c, size_t vertex)
{
	return !c->gone[vertex];
}
