/*
 * The points of a line, from its pieces in the annex: read once to count and measure them, and once to hand them out, unless the
 * buffer has them all. Points that are equal to the one before are left out: where a line passes through vertices at the level,
 * several edges have it there.
 */
#include <math.h>
#include <string.h>

#include "contour_priv.h"
#include "err.h"
#include "outfile.h"
#include "sort.h"

static int at_piece(struct contour *c, uint64_t number, uint32_t from, uint32_t to, struct err *err)
{
	struct contour_reader *d = &c->reader;
	uint64_t *link;
	int r = contour_link(c, number, false, &link, err);

	if (r)
		return r;
	d->piece = number;
	d->at = link[CONTOUR_POINTS_AT] + from * sizeof(double[2]);
	d->left = (to ? to : (uint32_t)(link[CONTOUR_NEXT] >> CONTOUR_COUNT_SHIFT)) - from;
	return 0;
}

static int rewind_to(struct contour *c, struct err *err)
{
	struct contour_reader *d = &c->reader;

	d->phase = 0;
	d->ended = d->any = d->whole = false;
	return at_piece(c, d->first, d->closed ? d->start : 0, 0, err);
}

/* Past the end of a piece. */
static int step(struct contour *c, struct err *err)
{
	struct contour_reader *d = &c->reader;
	uint64_t next = 0, *link;
	int r = d->phase ? 0 : contour_link(c, d->piece, false, &link, err);

	if (r)
		return r;
	if (!d->phase)
		next = link[CONTOUR_NEXT] & CONTOUR_NUMBER;
	if (d->phase || !next) {
		d->ended = d->phase == 2 || !d->closed;
		d->phase = 2;
		return 0;
	}
	if (!d->closed || next - 1 != d->first)
		return at_piece(c, next - 1, 0, 0, err);
	d->phase = 1;
	return d->start ? at_piece(c, d->first, 0, d->start, err) : 0;
}

/* Adds one point if it is not that before. */
static void take(struct contour_reader *d, const double at[2])
{
	if (!d->any)
		memcpy(d->first_point, at, sizeof(d->first_point));
	if (d->any && at[0] == d->last[0] && at[1] == d->last[1])
		return;
	memcpy(d->last, at, sizeof(d->last));
	d->any = true;
	memmove(d->buffer[d->n++], at, sizeof(d->last));
}

static int fill(struct contour *c, struct err *err)
{
	struct contour_reader *d = &c->reader;
	int r = 0;

	d->n = 0;
	while (!r && !d->ended && d->n < CONTOUR_POINTS) {
		size_t n = CONTOUR_POINTS - d->n, from = d->n;

		if (d->phase == 2) {
			take(d, d->first_point);
			d->ended = true;
			break;
		}
		n = n < d->left ? n : d->left;
		if (!n) {
			r = step(c, err);
			continue;
		}
		r = outfile_read(c->annex, d->at, d->buffer[from], n * sizeof(double[2]), err);
		for (size_t i = 0; i < n && !r; i++)
			take(d, d->buffer[from + i]);
		d->at += n * sizeof(double[2]);
		d->left -= (uint32_t)n;
	}
	return r;
}

static int measure(struct contour *c, struct contour_line *ret, struct err *err)
{
	struct contour_reader *d = &c->reader;
	double last[2] = {0, 0};
	int r = rewind_to(c, err);

	ret->points = 0;
	ret->length = 0;
	ret->box[0] = ret->box[1] = INFINITY;
	ret->box[2] = ret->box[3] = -INFINITY;
	while (!r && !d->ended) {
		bool first = !ret->points;

		r = fill(c, err);
		for (size_t i = 0; i < d->n && !r; i++) {
			double x = d->buffer[i][0], y = d->buffer[i][1], dx = x - last[0], dy = y - last[1];

			ret->length += ret->points++ ? sqrt(dx * dx + dy * dy) : 0;
			last[0] = x;
			last[1] = y;
			ret->box[0] = x < ret->box[0] ? x : ret->box[0];
			ret->box[1] = y < ret->box[1] ? y : ret->box[1];
			ret->box[2] = x > ret->box[2] ? x : ret->box[2];
			ret->box[3] = y > ret->box[3] ? y : ret->box[3];
		}
		if (!r && contour_interrupted(c))
			r = err_set(err, ERR_CANCELLED, "interrupted");
		d->whole = first && d->ended;
	}
	return r || d->whole ? r : rewind_to(c, err);
}

static int64_t key_of(const uint64_t *rec)
{
	return (int64_t)(rec[0] ^ 1ull << 63);
}

/* *ret: the record of the next line, which stays it until c->next is NULL; NULL: there is none. */
static int look(struct contour *c, const uint64_t **ret, struct err *err)
{
	int r = c->next ? 0 : sort_next(c->lines, &c->next, err);

	*ret = c->next;
	return r;
}

int contour_next(struct contour *c, struct contour_line *ret, struct err *err)
{
	struct contour_reader *d = &c->reader;
	const uint64_t *rec;
	int r;

	if (c->simple)
		return contour_simple_next(c->simple, ret, err);
	if (c->waits) {
		c->waits = false;
		*ret = c->first;
		return 0;
	}
	do {
		r = look(c, &rec, err);
		if (r)
			return r;
		if (!rec || contour_tiles_tile(&c->tiles, key_of(rec)) != c->tile) {
			*ret = (struct contour_line){0};
			return 0;
		}
		c->next = NULL;
		d->first = rec[4] >> 1;
		d->closed = rec[4] & 1;
		d->start = (uint32_t)rec[5];
		ret->level = contour_tiles_level(&c->tiles, key_of(rec)) - c->levels.shift;
		ret->closed = d->closed;
		r = measure(c, ret, err);
	} while (!r && ret->points < 2); /* around a vertex at the level, or in the corner of a window */
	return r;
}

int contour_next_tile(struct contour *c, int64_t ret[2], bool *ret_any, struct err *err)
{
	const uint64_t *rec;
	int r = 0;

	*ret_any = false;
	while (!r && !*ret_any && !(r = look(c, &rec, err)) && rec) {
		c->tile = contour_tiles_tile(&c->tiles, key_of(rec));
		r = contour_next(c, &c->first, err);
		*ret_any = c->waits = !r && c->first.points;
	}
	for (int i = 0; i < 2 && *ret_any; i++)
		ret[i] = c->tile->at[i];
	return r;
}

int contour_points(struct contour *c, const double (**ret)[2], size_t *ret_n, struct err *err)
{
	struct contour_reader *d = &c->reader;
	int r = 0;

	if (c->simple)
		return contour_simple_points(c->simple, ret, ret_n, err);
	if (d->whole)
		d->whole = false;
	else if (d->ended)
		d->n = 0;
	else
		r = fill(c, err);
	*ret = (const double(*)[2])d->buffer;
	*ret_n = d->n;
	return r;
}
