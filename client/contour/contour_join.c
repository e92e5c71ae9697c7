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
enum { END_WORDS = 4, LINE_WORDS = 6, NEXT_WORDS = 2, KEYS = 3, LINE_KEYS = 4, CHUNK = 256, SEEN_PAGES = 256 };

static int interrupted(const struct contour *c, uint64_t i, struct err *err)
{
	return i % 4096 == 0 && contour_interrupted(c) ? err_set(err, ERR_CANCELLED, "interrupted") : 0;
}

int contour_link(struct contour *c, uint64_t number, bool change, uint64_t **ret, struct err *err)
{
	return contour_array_at(c->link, number * CONTOUR_LINKS, change, ret, err);
}

static int get_piece(struct contour *c, uint64_t number, struct contour_piece *ret, struct err *err)
{
	uint64_t *link;
	int r = contour_link(c, number, false, &link, err);

	return r ? r : outfile_read(c->annex, link[CONTOUR_AT], ret, sizeof(*ret), err);
}

static int add_line(struct contour *c, const uint64_t rec[LINE_WORDS], struct err *err)
{
	int64_t key = (int64_t)(rec[0] ^ SIGN), level = contour_tiles_level(&c->tiles, key);
	struct contour_tile *t = contour_tiles_tile(&c->tiles, key);

	if (t) {
		t->range[0] = !t->any || level < t->range[0] ? level : t->range[0];
		t->range[1] = !t->any || level > t->range[1] ? level : t->range[1];
		t->any = true;
	}
	c->range[0] = !c->any || level < c->range[0] ? level : c->range[0];
	c->range[1] = !c->any || level > c->range[1] ? level : c->range[1];
	c->any = true;
	return sort_add(c->lines, rec, err);
}

static int mark(struct contour *c, uint64_t number, struct err *err)
{
	uint64_t *at;
	int r = contour_array_at(c->seen, number / 64, true, &at, err);

	if (!r)
		*at |= 1ull << number % 64;
	return r;
}

/* A closed line begins in its least edge. */
static int add_closed(struct contour *c, const struct contour_piece *p, uint64_t number, struct err *err)
{
	return add_line(
		c,
		(uint64_t[LINE_WORDS]){(uint64_t)p->level ^ SIGN, p->least[0], p->least[1], 0, number << 1 | 1, p->least_index},
		err);
}

/* ---- ends ---- */

/* A piece that is a closed line is complete: it is not read again. */
static int add_ends(struct contour *c, const struct contour_piece *p, uint64_t number, struct sort *ends, struct err *err)
{
	const uint64_t from[END_WORDS] = {(uint64_t)p->level ^ SIGN, p->from[0], p->from[1], number << 1};
	const uint64_t to[END_WORDS] = {(uint64_t)p->level ^ SIGN, p->to[0], p->to[1], number << 1 | 1};
	int r = 0;

	if (p->flags & CONTOUR_CLOSED) {
		r = mark(c, number, err);
		return r ? r : add_closed(c, p, number, err);
	}
	if (!(p->flags & CONTOUR_CUT_FROM))
		r = sort_add(ends, from, err);
	return r || p->flags & CONTOUR_CUT_TO ? r : sort_add(ends, to, err);
}

static int add_pieces(struct contour *c, uint64_t at, const struct contour_piece *p, uint64_t n, uint64_t first,
		      struct sort *ends, struct err *err)
{
	int r = 0;

	for (uint64_t i = 0; i < n && !r; i++) {
		uint64_t number = first + i, *link;

		r = interrupted(c, number, err);
		if (!r)
			r = contour_link(c, number, true, &link, err);
		if (r)
			return r;
		link[CONTOUR_NEXT] = (uint64_t)p[i].count << CONTOUR_COUNT_SHIFT |
				     (p[i].flags & CONTOUR_CLOSED ? (number + 1) | CONTOUR_HAS_PREVIOUS : 0);
		link[CONTOUR_AT] = at + i * sizeof(*p);
		link[CONTOUR_POINTS_AT] = p[i].at;
		link[CONTOUR_LEAST] = p[i].least[0];
		r = add_ends(c, &p[i], number, ends, err);
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
		r = contour_link(c, rec[0], true, &link, err);
		if (r)
			return r;
		link[CONTOUR_NEXT] |= rec[1];
		r = interrupted(c, n++, err);
	}
	return r;
}

static int new_sort(const struct contour *c, unsigned words, unsigned keys, uint64_t memory, struct sort **ret, struct err *err)
{
	int r = sort_new(words, keys, memory, c->out, ret, err);

	if (!r)
		sort_interrupt(*ret, c->opt.interrupted, c->opt.ctx);
	return r;
}

static int link_pieces(struct contour *c, struct err *err)
{
	struct sort *ends = NULL, *next = NULL;
	int r = new_sort(c, END_WORDS, KEYS, ENDS_MEMORY, &ends, err);

	if (!r)
		r = scan(c, ends, err);
	if (!r)
		r = new_sort(c, NEXT_WORDS, 1, SORT_MEMORY, &next, err);
	if (!r)
		r = match(c, ends, next, err);
	sort_free(ends);
	if (!r)
		r = put_next(c, next, err);
	sort_free(next);
	return r;
}

/* ---- lines ---- */

/* Marks a piece; *ret: the next one, from 1; *ret_least: the first word of its least edge. */
static int pass(struct contour *c, uint64_t number, uint64_t *ret, uint64_t *ret_least, struct err *err)
{
	uint64_t *at;
	int r = interrupted(c, c->passed++, err);

	if (!r)
		r = mark(c, number, err);
	if (!r)
		r = contour_link(c, number, false, &at, err);
	if (!r) {
		*ret = at[CONTOUR_NEXT] & CONTOUR_NUMBER;
		*ret_least = at[CONTOUR_LEAST];
	}
	return r;
}

static int open_line(struct contour *c, uint64_t number, struct err *err)
{
	struct contour_piece p;
	uint64_t next = number + 1, least;
	int r = get_piece(c, number, &p, err);

	if (!r)
		r = add_line(c, (uint64_t[LINE_WORDS]){(uint64_t)p.level ^ SIGN, p.from[0], p.from[1], p.cut, number << 1, 0},
			     err);
	while (!r && next)
		r = pass(c, next - 1, &next, &least, err);
	return r;
}

static bool is_less(const struct contour_piece *a, const struct contour_piece *b)
{
	return a->least[0] != b->least[0] ? a->least[0] < b->least[0] : a->least[1] < b->least[1];
}

/* Pieces are read if the first words of theirs are alike, and of the line the one that
 * has it. */
static int closed_line(struct contour *c, uint64_t number, struct err *err)
{
	uint64_t next = number + 1, first = number, lowest = UINT64_MAX;
	struct contour_piece best, p;
	bool read = false; /* `best` is the piece `first` */
	int r;

	do {
		uint64_t at = next - 1, least;

		r = pass(c, at, &next, &least, err);
		if (r)
			return r;
		if (at == number || least < lowest) {
			lowest = least;
			first = at;
			read = false;
		} else if (least == lowest) {
			r = read ? 0 : get_piece(c, first, &best, err);
			r = r ? r : get_piece(c, at, &p, err);
			if (r)
				return r;
			read = true;
			if (is_less(&p, &best)) {
				best = p;
				first = at;
			}
		}
	} while (next && next != number + 1);
	if (!next)
		return err_set(err, ERR_INTERNAL, "a closed contour has an end");
	r = read ? 0 : get_piece(c, first, &best, err);
	return r ? r : add_closed(c, &best, first, err);
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
			r = closed ? 0 : contour_link(c, i, false, &at, err);
			if (!r && (closed || !(at[CONTOUR_NEXT] & CONTOUR_HAS_PREVIOUS)))
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
		r = contour_array_new(c->out, pages < SEEN_PAGES ? pages : SEEN_PAGES, &c->seen, err);
	if (!r)
		r = new_sort(c, LINE_WORDS, LINE_KEYS, SORT_MEMORY, &c->lines, err);
	if (!r)
		r = link_pieces(c, err);
	if (!r)
		r = find_lines(c, err);
	c->seen = contour_array_free(c->seen);
	if (!r)
		r = sort_start(c->lines, err);
	return r || !(c->opt.simplify > 0) ? r : contour_simplify(c, err);
}

bool contour_range(const struct contour *c, int64_t ret[2])
{
	const int64_t *range = c->tile ? c->tile->range : c->range;

	for (int i = 0; i < 2 && c->any; i++)
		ret[i] = range[i] - c->levels.shift;
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
