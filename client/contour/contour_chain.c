/*
 * Segments to pieces of lines, in a table of crossings.
 *
 * A crossing is an edge at a level; of the segments that meet there one arrives and one leaves, so a crossing has one next and
 * one previous. The table is emptied into the annex when a block ends or when it is full: what is not joined then is joined at
 * the end (contour_join.c), whatever the reason. A segment that leaves the window ends at a place of its own, which is not in the
 * table.
 */
#include <stdlib.h>
#include <string.h>

#include "contour_priv.h"
#include "err.h"
#include "outfile.h"

enum { NONE = -1 };

struct crossing {
	uint64_t end[2];
	int64_t level;
	union {
		double cut[2]; /* of a place on the border of the window */
		int64_t part[2];
	};
	int32_t next, previous;
};

struct contour_chains {
	uint32_t most, used; /* crossings and cuts */
	uint32_t size;       /* of the table, a power of two */
	struct crossing *crossing;
	int32_t *slot, *start; /* start: a crossing of each piece */
	uint32_t *cut;         /* number of a cut; 0: a crossing */
	uint32_t pieces;
};

struct contour_chains *contour_chains_free(struct contour_chains *s)
{
	if (s) {
		free(s->crossing);
		free(s->slot);
		free(s->start);
		free(s->cut);
	}
	free(s);
	return NULL;
}

static void clear(struct contour_chains *s)
{
	s->used = s->pieces = 0;
	memset(s->slot, 0xff, s->size * sizeof(*s->slot));
}

int contour_chains_new(unsigned segments, struct contour_chains **ret, struct err *err)
{
	struct contour_chains *s = calloc(1, sizeof(*s));

	_Static_assert(CONTOUR_SEGMENTS < 1 << (64 - CONTOUR_COUNT_SHIFT), "points of a piece");
	if (s) {
		s->most = segments;
		for (s->size = 16; s->size < 2 * segments; s->size *= 2)
			;
		s->crossing = malloc(segments * sizeof(*s->crossing));
		s->slot = malloc(s->size * sizeof(*s->slot));
		s->start = malloc(segments * sizeof(*s->start));
		s->cut = malloc(segments * sizeof(*s->cut));
	}
	if (!s || !s->crossing || !s->slot || !s->start || !s->cut) {
		contour_chains_free(s);
		return err_set(err, ERR_NOMEM, "no memory for contours");
	}
	clear(s);
	*ret = s;
	return 0;
}

static int32_t add(struct contour_chains *s, const struct contour_crossing *c, int64_t level)
{
	s->crossing[s->used] = (struct crossing){
		.end = {c->end[0], c->end[1]}, .level = level, .part = {c->n, c->d}, .next = NONE, .previous = NONE};
	s->cut[s->used] = 0;
	return (int32_t)s->used++;
}

static int32_t find(struct contour_chains *s, const struct contour_crossing *c, int64_t level)
{
	uint64_t hash =
		(c->end[0] * 0x9e3779b97f4a7c15u ^ c->end[1]) * 0xc2b2ae3d27d4eb4fu + (uint64_t)level * 0x165667b19e3779f9u;
	uint32_t i = (uint32_t)((hash ^ hash >> 29) * 0x9e3779b97f4a7c15u >> 32) & (s->size - 1);

	for (; s->slot[i] >= 0; i = (i + 1) & (s->size - 1)) {
		const struct crossing *at = &s->crossing[s->slot[i]];

		if (at->end[0] == c->end[0] && at->end[1] == c->end[1] && at->level == level)
			return s->slot[i];
	}
	return s->slot[i] = add(s, c, level);
}

/* An end at the border of the window. A line that begins there has its place in the order by the edge before it and the number of
 * the cut. */
static int32_t add_end(struct contour *c, const struct contour_end *end, int64_t level)
{
	struct contour_chains *s = c->chains;
	int32_t i = end->cut ? add(s, end->edge, level) : find(s, end->edge, level);

	if (end->cut) {
		s->cut[i] = end->cut;
		memcpy(s->crossing[i].cut, end->at, sizeof(end->at));
	}
	return i;
}

static int make_room(struct contour *c, struct err *err)
{
	if (c->chains->used + 2 <= c->chains->most)
		return 0;
	return contour_interrupted(c) ? err_set(err, ERR_CANCELLED, "interrupted") : contour_chains_flush(c, err);
}

static int twice(struct err *err)
{
	return err_set(err, ERR_PROTO, "an edge of the mesh has more than two triangles, or two on one side");
}

int contour_chains_add(struct contour *c, const struct contour_end end[2], int64_t level, struct err *err)
{
	struct contour_chains *s = c->chains;
	int r = make_room(c, err);
	int32_t a, b;

	if (r)
		return r;
	a = add_end(c, &end[0], level);
	b = add_end(c, &end[1], level);
	if (s->crossing[a].next != NONE || s->crossing[b].previous != NONE)
		return twice(err);
	s->crossing[a].next = b;
	s->crossing[b].previous = a;
	return 0;
}

/* ---- pieces ---- */

static bool less(const uint64_t a[2], const uint64_t b[2])
{
	return a[0] != b[0] ? a[0] < b[0] : a[1] < b[1];
}

static struct contour_piece piece_of(const struct contour_chains *s, int32_t start, uint64_t at)
{
	const struct crossing *c = &s->crossing[start], *last = c, *first = c;
	struct contour_piece p = {.level = c->level, .at = at, .least = {UINT64_MAX, UINT64_MAX}};

	do {
		if (less(c->end, p.least)) {
			memcpy(p.least, c->end, sizeof(p.least));
			p.least_index = p.count;
		}
		p.count++;
		last = c;
		c = c->next == NONE ? NULL : &s->crossing[c->next];
	} while (c && c != first);
	memcpy(p.from, first->end, sizeof(p.from));
	memcpy(p.to, last->end, sizeof(p.to));
	p.flags = (c ? CONTOUR_CLOSED : 0) | (s->cut[start] ? CONTOUR_CUT_FROM : 0) |
		  (s->cut[last - s->crossing] ? CONTOUR_CUT_TO : 0);
	p.cut = s->cut[start];
	return p;
}

/* A start of each piece; closed ones are found when the others have been passed. */
static uint64_t find_starts(struct contour_chains *s)
{
	uint64_t points = 0;

	for (uint32_t closed = 0; closed < 2; closed++) {
		for (uint32_t i = 0; i < s->used; i++) {
			int32_t at = (int32_t)i;

			if (closed ? s->crossing[i].previous < NONE : s->crossing[i].previous != NONE)
				continue;
			s->start[s->pieces++] = at;
			do {
				points++;
				s->crossing[at].previous = NONE - 1; /* passed */
				at = s->crossing[at].next;
			} while (at != NONE && at != (int32_t)i);
		}
	}
	return points;
}

static int put_points(struct contour *c, int32_t start, struct err *err)
{
	const struct contour_chains *s = c->chains;
	int32_t i = start;

	do {
		const struct crossing *at = &s->crossing[i];
		double *to = outfile_room(c->annex, sizeof(double[2]), err);

		if (!to)
			return -err->code;
		if (s->cut[i])
			memcpy(to, at->cut, sizeof(at->cut));
		else
			contour_place(c->opt.axis, &(struct contour_crossing){{at->end[0], at->end[1]}, at->part[0], at->part[1]},
				      to);
		outfile_used(c->annex, sizeof(double[2]));
		i = at->next;
	} while (i != NONE && i != start);
	return 0;
}

int contour_chains_flush(struct contour *c, struct err *err)
{
	struct contour_chains *s = c->chains;
	struct contour_batch batch = {.points = find_starts(s)};
	uint64_t at;
	int r;

	if (!s->used)
		return 0;
	batch.pieces = s->pieces;
	r = outfile_write(c->annex, &batch, sizeof(batch), err);
	at = outfile_size(c->annex) + s->pieces * sizeof(struct contour_piece);
	for (uint32_t i = 0; i < s->pieces && !r; i++) {
		struct contour_piece p = piece_of(s, s->start[i], at);

		at += p.count * sizeof(double[2]);
		r = outfile_write(c->annex, &p, sizeof(p), err);
	}
	for (uint32_t i = 0; i < s->pieces && !r; i++)
		r = put_points(c, s->start[i], err);
	c->pieces += s->pieces;
	clear(s);
	return r;
}
