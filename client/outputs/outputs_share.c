/*
 * One file that several processes write: each owns some of its bytes, and writes all records, and parts of records, in them.
 *
 * The model: a file is a front, its vertices, its triangles, each record at a place that is known from its number. The mesh is
 * cut into shares, and so are vertices and triangles of the file; each border is then moved up to the next multiple of a block.
 * So no two processes write into one block, as two clients of a shared file system must not. The block with the end of the
 * vertices and the first triangle is of the first process. A process is given every domain that has a record in its bytes; who is
 * given one twice, or writes twice, writes the same bytes.
 *
 * Nothing is left out here and nothing put in order: what needs more than a record at a time is not written this way.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "outputs_priv.h"

enum { BUFFER = 1 << 20, RECORDS = 2048, BEHIND = 16, FRONT = 0, VERTICES = 1, TRIANGLES = 2, KINDS = 3 };

/* Bytes [from, to) of the file, through a buffer whose first byte is at `at`. */
struct stripe {
	uint64_t from, to, at;
	size_t used;
	uint8_t *buf;
};
struct outputs_stripes {
	struct stripe stripe[2];
	uint64_t begin[KINDS + 1]; /* where the kinds of records begin; the end of the file */
	size_t record[KINDS];      /* bytes */
	uint8_t *front, *some;     /* some: records that are made */
};

struct outputs_stripes *outputs_stripes_free(struct outputs_stripes *s)
{
	if (!s)
		return NULL;
	free(s->stripe[0].buf);
	free(s->stripe[1].buf);
	free(s->front);
	free(s->some);
	free(s);
	return NULL;
}

/* ---- which bytes are whose ---- */

static uint64_t up(uint64_t at, uint64_t block, uint64_t low, uint64_t high)
{
	uint64_t to = at % block ? at - at % block + block : at;

	return to < low ? low : to > high ? high : to;
}

static void divide(struct outputs_stripes *s, const struct outputs_share *of)
{
	const uint64_t middle = s->begin[TRIANGLES] - s->begin[TRIANGLES] % of->block, end = s->begin[KINDS];

	for (int i = 0; i < 2; i++) {
		uint64_t v = s->begin[VERTICES] + of->vertices[i] * s->record[VERTICES],
			 t = s->begin[TRIANGLES] + of->triangles[i] * s->record[TRIANGLES], low, high;

		low = of->index + (uint32_t)i == 0         ? 0 :
		      of->index + (uint32_t)i == of->tasks ? middle :
							     up(v, of->block, 0, middle);
		high = of->index + (uint32_t)i == 0         ? middle :
		       of->index + (uint32_t)i == of->tasks ? end :
							      up(t, of->block, middle, end);
		*(i ? &s->stripe[0].to : &s->stripe[0].from) = low;
		*(i ? &s->stripe[1].to : &s->stripe[1].from) = high;
	}
}

static int begin(struct outputs_target *t, const struct outputs_share *of, const struct acut_mesh_head *head, struct err *err)
{
	const struct format_fixed *fixed = t->format->fixed;
	struct outputs_stripes *s = t->stripes = calloc(1, sizeof(*s));
	size_t front = 0, triangle = 0;
	int r = s ? 0 : err_set(err, ERR_NOMEM, "no memory for an output");

	if (!r)
		r = fixed->front(t->writer, head, &of->tail, &s->front, &front, &triangle, err);
	if (r)
		return r;
	s->record[FRONT] = 1;
	s->record[VERTICES] = fixed->vertex;
	s->record[TRIANGLES] = triangle;
	s->begin[VERTICES] = front;
	s->begin[TRIANGLES] = front + of->tail.vertices * fixed->vertex;
	s->begin[KINDS] = s->begin[TRIANGLES] + of->tail.triangles * triangle;
	divide(s, of);
	s->some = malloc(RECORDS * (fixed->vertex > triangle ? fixed->vertex : triangle) + BEHIND);
	for (int i = 0; i < 2; i++)
		s->stripe[i].buf = malloc(BUFFER);
	return s->some && s->stripe[0].buf && s->stripe[1].buf ? 0 : err_set(err, ERR_NOMEM, "no memory for an output");
}

/* ---- bytes ---- */

static int flush(struct outputs_target *t, struct stripe *p, struct err *err)
{
	int r = p->used ? outfile_patch(t->out, p->at, p->buf, p->used, err) : 0;

	p->at += p->used;
	p->used = 0;
	return r;
}

static int put(struct outputs_target *t, struct stripe *p, uint64_t at, const uint8_t *bytes, size_t n, struct err *err)
{
	uint64_t end = at + n < p->to ? at + n : p->to;
	int r = 0;

	if (at < p->from) {
		bytes += p->from - at < n ? p->from - at : n;
		at = p->from;
	}
	while (at < end && !r) {
		size_t some = end - at < BUFFER - p->used ? (size_t)(end - at) : BUFFER - p->used;

		if (at != p->at + p->used || p->used == BUFFER) {
			r = flush(t, p, err);
			p->at = at;
			continue;
		}
		memcpy(p->buf + p->used, bytes, some);
		p->used += some;
		bytes += some;
		at += some;
	}
	return r;
}

/* Of records [first, first + n) of a kind those that have bytes in the stripe: from *ret on; returns how many. */
static uint64_t meet(const struct outputs_stripes *s, const struct stripe *p, int kind, uint64_t first, uint64_t n, uint64_t *ret)
{
	const uint64_t base = s->begin[kind], size = s->record[kind];
	uint64_t low, high;

	*ret = first;
	if (!size || p->to <= base || p->from >= p->to)
		return 0;
	low = p->from > base ? (p->from - base) / size : 0;
	high = (p->to - base + size - 1) / size;
	low = low < first ? first : low;
	high = high > first + n ? first + n : high;
	*ret = low;
	return low < high ? high - low : 0;
}

/* Makes records, in pieces, and puts them. `make`: n of them, from number `at` of those that were given on. */
struct making {
	const struct outputs_target *t;
	const int32_t (*vertex)[3];
	const struct format_piece *piece;
};

static int make(const struct making *m, uint64_t at, uint32_t n, uint8_t *to, struct err *err)
{
	const struct format_fixed *fixed = m->t->format->fixed;

	if (m->piece)
		return fixed->triangles(m->t->writer, m->piece, (uint32_t)at, n, to, err);
	fixed->vertices(m->t->writer, m->vertex + at, n, to);
	return 0;
}

static int put_records(struct outputs_target *t, int kind, const struct making *m, uint64_t first, uint64_t n, struct err *err)
{
	struct outputs_stripes *s = t->stripes;
	int r = 0;

	for (int i = 0; i < 2; i++) {
		uint64_t at, left = meet(s, &s->stripe[i], kind, first, n, &at);

		for (uint32_t some; left && !r; left -= some, at += some) {
			some = left < RECORDS ? (uint32_t)left : RECORDS;
			r = make(m, at - first, some, s->some, err);
			if (!r)
				r = put(t, &s->stripe[i], s->begin[kind] + at * s->record[kind], s->some, some * s->record[kind],
					err);
		}
	}
	return r;
}

/* ---- the run ---- */

int outputs_share_head(struct outputs *run, const struct acut_mesh_head *head, struct err *err)
{
	int r = 0;

	for (struct outputs_target *t = run->target; t && !r; t = t->next) {
		r = begin(t, run->opt.share_of, head, err);
		for (int i = 0; i < 2 && !r; i++)
			r = put(t, &t->stripes->stripe[i], 0, t->stripes->front, t->stripes->begin[VERTICES], err);
		if (r)
			err_add_file(err, outfile_name(t->out));
	}
	return r;
}

bool outputs_share_wants(const struct outputs *run, const uint64_t vertices[2], const uint64_t triangles[2])
{
	uint64_t at;

	for (const struct outputs_target *t = run->target; t; t = t->next)
		for (int i = 0; i < 2; i++)
			if (meet(t->stripes, &t->stripes->stripe[i], VERTICES, vertices[0], vertices[1], &at) ||
			    meet(t->stripes, &t->stripes->stripe[i], TRIANGLES, triangles[0], triangles[1], &at))
				return true;
	return false;
}

int outputs_share_vertices(struct outputs *run, uint64_t first, const int32_t (*vertex)[3], uint64_t n, struct err *err)
{
	int r = 0;

	for (struct outputs_target *t = run->target; t && !r; t = t->next)
		r = put_records(t, VERTICES, &(struct making){t, vertex, NULL}, first, n, err);
	return r;
}

int outputs_share_triangles(struct outputs *run, uint64_t first, const struct format_piece *piece, uint32_t n, bool count,
			    struct err *err)
{
	const struct acut_mesh_block block = {.triangle = piece->triangle, .flags = piece->flags, .ntriangle = n};
	struct acut_mesh_block ignored;
	int r = count && run->edge.gather ? outputs_edge_block(&run->edge, &block, piece->position, &ignored, err) : 0;

	for (struct outputs_target *t = run->target; t && !r; t = t->next)
		r = put_records(t, TRIANGLES, &(struct making){t, NULL, piece}, first, n, err);
	return r;
}

/* Files with their sizes are in the list of the first process; none of the others knows more. */
int outputs_share_publish(struct outputs *run, struct err *err)
{
	int r = 0;

	for (struct outputs_target *t = run->target; t && !r; t = t->next) {
		struct outfile_held held;

		for (int i = 0; i < 2 && !r; i++)
			r = flush(t, &t->stripes->stripe[i], err);
		if (!r)
			r = outfile_shared_sync(t->out, err);
		if (!r)
			r = outfile_held(t->out, &held, err);
		if (r || run->opt.share_of->index)
			continue;
		held.size = t->stripes->begin[KINDS];
		run->bytes += held.size;
		r = outputs_moves_add(&run->joined.moves, outfile_name(t->out), run->opt.part, &held, err);
	}
	return r;
}
