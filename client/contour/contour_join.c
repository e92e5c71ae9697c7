/*
 * Pieces to lines.
 *
 * The ends of all pieces are sorted by level and edge: two that are alike are joined, one that is alone is at the border of the
 * mesh. What they tell of pieces is sorted by piece, and so goes from the front to the end into an array of numbers on the disk,
 * which has the next piece of each. It is followed once from each piece that has none before it, and then around each loop that
 * is left. The marks of pieces that were passed are apart, so that following changes no page of the array. A line is then a
 * record in a second sort, by level and by its first edge: of an open line the one where it begins, of a closed one the least of
 * all. No two lines of a level share an edge, so the order is complete.
 */
#include <string.h>

#include "contour_priv.h"
#include "err.h"
#include "outfile.h"
#include "sort.h"

#define ENDS_MEMORY (4ull << 20) /* the blocks' memory is free, and outputs are finished one after the other */
#define SORT_MEMORY (2ull << 20)
#define SIGN (1ull << 63) /* levels as unsigned numbers, in their order */
enum { END_WORDS = 4, LINE_WORDS = 5, NEXT_WORDS = 2, KEYS = 3, CHUNK = 256, SEEN_PAGES = 256 };

static int interrupted(const struct contour *c, uint64_t i, struct err *err)
{
	return i % 4096 == 0 && contour_interrupted(c) ? err_set(err, ERR_CANCELLED, "interrupted") : 0;
}

int contour_link(struct contour *c, uint64_t number, int which, bool change, uint64_t **ret, struct err *err)
{
	return contour_array_at(c->link, number * CONTOUR_LINKS + (uint64_t)which, change, ret, err);
}

static int get_piece(struct contour *c, uint64_t number, struct contour_piece *ret, struct err *err)
{
	uint64_t *at;
	int r = contour_link(c, number, CONTOUR_AT, false, &at, err);

	return r ? r : outfile_read(c->annex, *at, ret, sizeof(*ret), err);
}

/* ---- ends ---- */

static int add_ends(const struct contour_piece *p, uint64_t number, struct sort *ends, struct err *err)
{
	const uint64_t from[END_WORDS] = {(uint64_t)p->level ^ SIGN, p->from[0], p->from[1], number << 1};
	const uint64_t to[END_WORDS] = {(uint64_t)p->level ^ SIGN, p->to[0], p->to[1], number << 1 | 1};
	int r = p->flags & (CONTOUR_CLOSED | CONTOUR_CUT_FROM) ? 0 : sort_add(ends, from, err);

	return r || p->flags & (CONTOUR_CLOSED | CONTOUR_CUT_TO) ? r : sort_add(ends, to, err);
}

static int add_pieces(struct contour *c, uint64_t at, const struct contour_piece *p, uint64_t n, uint64_t first,
		      struct sort *ends, struct err *err)
{
	int r = 0;

	for (uint64_t i = 0; i < n && !r; i++) {
		uint64_t number = first + i, *link;

		r = interrupted(c, number, err);
		if (!r)
			r = contour_link(c, number, CONTOUR_AT, true, &link, err); /* and the three after it: a page has all */
		if (r)
			return r;
		link[CONTOUR_AT] = at + i * sizeof(*p);
		link[CONTOUR_NEXT] = p[i].flags & CONTOUR_CLOSED ? (number + 1) | CONTOUR_HAS_PREVIOUS : 0;
		link[CONTOUR_POINTS_AT] = p[i].at;
		link[CONTOUR_COUNT] = p[i].count;
		r = add_ends(&p[i], number, ends, err);
	}
	return r;
}

static int scan(struct contour *c, struct sort *ends, struct err *err)
{
	uint64_t at = 0, number = 0, size = outfile_size(c->annex);
	struct contour_piece p[CHUNK];
	int r = 0;

	while (at < size && !r) {
		struct contour_batch batch;

		r = outfile_read(c->annex, at, &batch, sizeof(batch), err);
		at += sizeof(batch);
		for (uint64_t i = 0, n; i < batch.pieces && !r; i += n, number += n) {
			n = batch.pieces - i < CHUNK ? batch.pieces - i : CHUNK;
			r = outfile_read(c->annex, at, p, n * sizeof(*p), err);
			if (!r)
				r = add_pieces(c, at, p, n, number, ends, err);
			at += n * sizeof(*p);
		}
		at += batch.points * sizeof(double[2]);
	}
	return r || number == c->pieces ? r : err_set(err, ERR_INTERNAL, "pieces of contours are missing");
}

/* Of two ends that are alike, one piece ends there and the other one begins. */
static int link_ends(uint64_t a, uint64_t b, struct sort *next, struct err *err)
{
	uint64_t to = a & 1 ? a >> 1 : b >> 1, from = a & 1 ? b >> 1 : a >> 1;
	int r;

	if ((a & 1) == (b & 1))
		return err_set(err, ERR_PROTO, "two triangles are on the same side of an edge of the mesh");
	r = sort_add(next, (uint64_t[NEXT_WORDS]){to, from + 1}, err);
	return r ? r : sort_add(next, (uint64_t[NEXT_WORDS]){from, CONTOUR_HAS_PREVIOUS}, err);
}

static int match(struct contour *c, struct sort *ends, struct sort *next, struct err *err)
{
	uint64_t last[END_WORDS], n = 0;
	const uint64_t *rec;
	unsigned alike = 0; /* of the last ones */
	int r = sort_start(ends, err);

	while (!r && !(r = sort_next(ends, &rec, err)) && rec) {
		alike = alike && !memcmp(rec, last, KEYS * sizeof(*rec)) ? alike + 1 : 1;
		if (alike > 2)
			return err_set(err, ERR_PROTO, "an edge of the mesh has more than two triangles");
		if (alike == 2)
			r = link_ends(last[KEYS], rec[KEYS], next, err);
		memcpy(last, rec, sizeof(last));
		r = r ? r : interrupted(c, n++, err);
	}
	return r;
}

static int put_next(struct contour *c, struct sort *next, struct err *err)
{
	const uint64_t *rec;
	uint64_t n = 0, *link;
	int r = sort_start(next, err);

	while (!r && !(r = sort_next(next, &rec, err)) && rec) {
		r = contour_link(c, rec[0], CONTOUR_NEXT, true, &link, err);
		if (r)
			return r;
		*link |= rec[1];
		r = interrupted(c, n++, err);
	}
	return r;
}

static int link_pieces(struct contour *c, struct err *err)
{
	struct sort *ends = NULL, *next = NULL;
	int r = sort_new(END_WORDS, KEYS, ENDS_MEMORY, c->out, &ends, err);

	if (!r)
		r = scan(c, ends, err);
	if (!r)
		r = sort_new(NEXT_WORDS, 1, SORT_MEMORY, c->out, &next, err);
	if (!r)
		r = match(c, ends, next, err);
	sort_free(ends);
	if (!r)
		r = put_next(c, next, err);
	sort_free(next);
	return r;
}

/* ---- lines ---- */

static int add_line(struct contour *c, const uint64_t rec[LINE_WORDS], struct err *err)
{
	int64_t level = (int64_t)(rec[0] ^ SIGN);

	c->range[0] = !c->any || level < c->range[0] ? level : c->range[0];
	c->range[1] = !c->any || level > c->range[1] ? level : c->range[1];
	c->any = true;
	return sort_add(c->lines, rec, err);
}

/* Marks a piece; *ret: the next one, from 1. */
static int pass(struct contour *c, uint64_t number, uint64_t *ret, struct err *err)
{
	uint64_t *at;
	int r = contour_array_at(c->seen, number / 64, true, &at, err);

	if (r)
		return r;
	*at |= 1ull << number % 64;
	r = contour_link(c, number, CONTOUR_NEXT, false, &at, err);
	if (!r)
		*ret = *at & CONTOUR_NUMBER;
	return r;
}

static int open_line(struct contour *c, uint64_t number, struct err *err)
{
	struct contour_piece p;
	uint64_t next = number + 1;
	int r = get_piece(c, number, &p, err);

	if (!r)
		r = add_line(c, (uint64_t[LINE_WORDS]){(uint64_t)p.level ^ SIGN, p.from[0], p.from[1], number << 1, 0}, err);
	while (!r && next)
		r = pass(c, next - 1, &next, err);
	return r;
}

static int closed_line(struct contour *c, uint64_t number, struct err *err)
{
	uint64_t rec[LINE_WORDS] = {0}, next = number + 1;
	int r = 0;

	do {
		struct contour_piece p;
		uint64_t at = next - 1;

		r = get_piece(c, at, &p, err);
		if (r)
			return r;
		if (at == number || p.least[0] < rec[1] || (p.least[0] == rec[1] && p.least[1] < rec[2]))
			memcpy(rec,
			       (uint64_t[LINE_WORDS]){(uint64_t)p.level ^ SIGN, p.least[0], p.least[1], at << 1 | 1,
						      p.least_index},
			       sizeof(rec));
		r = pass(c, at, &next, err);
	} while (!r && next && next != number + 1);
	return r ? r : next ? add_line(c, rec, err) : err_set(err, ERR_INTERNAL, "a closed contour has an end");
}

static int find_lines(struct contour *c, struct err *err)
{
	int r = 0;

	for (int closed = 0; closed < 2; closed++) {
		for (uint64_t i = 0; i < c->pieces && !r; i++) {
			uint64_t *at;

			r = interrupted(c, i, err);
			if (!r)
				r = contour_array_at(c->seen, i / 64, false, &at, err);
			if (r || *at >> i % 64 & 1)
				continue;
			r = closed ? 0 : contour_link(c, i, CONTOUR_NEXT, false, &at, err);
			if (!r && (closed || !(*at & CONTOUR_HAS_PREVIOUS)))
				r = closed ? closed_line(c, i, err) : open_line(c, i, err);
		}
	}
	return r;
}

int contour_join(struct contour *c, struct err *err)
{
	unsigned pages = c->opt.pages ? c->opt.pages : CONTOUR_PAGES;
	int r = contour_array_new(c->out, pages, &c->link, err);

	if (!r)
		r = link_pieces(c, err);
	if (!r)
		r = contour_array_new(c->out, pages < SEEN_PAGES ? pages : SEEN_PAGES, &c->seen, err);
	if (!r)
		r = sort_new(LINE_WORDS, KEYS, SORT_MEMORY, c->out, &c->lines, err);
	if (!r)
		r = find_lines(c, err);
	c->seen = contour_array_free(c->seen);
	if (!r)
		r = sort_start(c->lines, err);
	return r || !(c->opt.simplify > 0) ? r : contour_simplify(c, err);
}

bool contour_range(const struct contour *c, int64_t ret[2])
{
	for (int i = 0; i < 2 && c->any; i++)
		ret[i] = c->range[i] - c->levels.shift;
	return c->any;
}

void contour_joined_free(struct contour *c)
{
	c->lines = sort_free(c->lines);
	c->link = contour_array_free(c->link);
}

int contour_done(struct contour *c, struct err *err)
{
	contour_joined_free(c);
	c->simple = contour_simple_free(c->simple);
	return outfile_annex_drop(c->annex, err);
}
