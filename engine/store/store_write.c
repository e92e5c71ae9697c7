/*
 * Writing the bytes of a stored domain into a file, from a place on: a file of the store, where the place is 0, or a pack.
 */
#include <string.h>
#define XXH_STATIC_LINKING_ONLY /* for the hash state on the stack */
#include <xxhash.h>

#include "err.h"
#include "io.h"
#include "store_format.h"

/* ---- checksums ---- */

/* The checksum of two arrays as if they were one. */
static uint64_t two_sum(const void *a, size_t na, const void *b, size_t nb)
{
	XXH3_state_t state;

	XXH3_64bits_reset(&state);
	XXH3_64bits_update(&state, a, na);
	XXH3_64bits_update(&state, b, nb);
	return XXH3_64bits_digest(&state);
}

uint64_t store_open_sum(const struct mesh_domain *d)
{
	return two_sum(d->link, (size_t)d->nopen * sizeof *d->link, d->vertex, (size_t)d->nopen * sizeof *d->vertex);
}

/* ---- writing ---- */

/* What is written behind the header. Places count from the start of the domain, which is at `base` of the file. `sum`: of packed
 * bytes. */
struct piece {
	int fd;
	const char *name;
	uint64_t base, at;
	size_t used;
	XXH3_state_t sum;
	uint8_t buf[32 << 10];
};

static int piece_flush(struct piece *p, struct err *err)
{
	int r = io_write_at(p->fd, p->buf, p->used, p->base + p->at, p->name, err);

	p->at += p->used;
	p->used = 0;
	return r;
}

static int piece_put(struct piece *p, const void *bytes, size_t n, struct err *err)
{
	int r = 0;

	for (const uint8_t *from = bytes; !r && n;) {
		size_t room = sizeof p->buf - p->used, some = n < room ? n : room;

		memcpy(p->buf + p->used, from, some);
		p->used += some;
		from += some;
		n -= some;
		if (p->used == sizeof p->buf)
			r = piece_flush(p, err);
	}
	return r;
}

/* Writes zeros up to `end`. */
static int piece_pad(struct piece *p, uint64_t end, struct err *err)
{
	static const uint8_t zero[8];

	return piece_put(p, zero, (size_t)(end - p->at - p->used), err);
}

/* How many elements of that size fit the buffer; writes the buffer out if none fits. */
static int piece_room(struct piece *p, size_t row, size_t *ret, struct err *err)
{
	int r = sizeof p->buf - p->used < row ? piece_flush(p, err) : 0;

	*ret = (sizeof p->buf - p->used) / row;
	return r;
}

static void piece_packed(struct piece *p, size_t n)
{
	XXH3_64bits_update(&p->sum, p->buf + p->used, n);
	p->used += n;
}

static int put_rest(struct piece *p, const struct mesh_domain *d, const struct store_code *c, const struct store_extent *e,
		    struct err *err)
{
	size_t some;
	int r = 0;

	for (size_t i = d->nopen; !r && i < d->nvertex; i += some) {
		r = piece_room(p, store_vertex_bytes(c), &some, err);
		some = some < d->nvertex - i ? some : d->nvertex - i;
		if (!r)
			piece_packed(p, store_pack_vertices(c, d->vertex + i, some, p->buf + p->used));
	}
	if (!r)
		r = piece_pad(p, e->triangle_at, err);
	for (size_t i = 0; !r && i < d->ntriangle; i += some) {
		r = piece_room(p, store_triangle_bytes(c), &some, err);
		some = some < d->ntriangle - i ? some : d->ntriangle - i;
		if (!r)
			piece_packed(p, store_pack_triangles(c, (const uint32_t(*)[3])d->triangle + i, some, p->buf + p->used));
	}
	if (!r && d->nedges) {
		XXH3_64bits_update(&p->sum, d->edges, d->nedges);
		r = piece_put(p, d->edges, d->nedges, err);
	}
	return r ? r : piece_pad(p, e->end, err);
}

/* Everything behind the header, then the header. */
int store_write(int fd, const char *name, uint64_t at, const struct store_id *id, struct store_front *f, struct err *err)
{
	const struct mesh_domain *d = &f->domain;
	struct store_header h = {.code = store_code_of(d)};
	const struct store_extent e = store_extent_of(d, &h.code, f->beside.proof_size);
	struct piece p;
	uint8_t header[STORE_HEADER];
	int r;

	p.fd = fd;
	p.name = name;
	p.base = at;
	p.at = STORE_HEADER;
	p.used = 0;
	XXH3_64bits_reset(&p.sum);
	r = piece_put(&p, f->beside.proof, f->beside.proof_size, err);
	if (!r)
		r = piece_pad(&p, e.open_at, err);
	if (!r)
		r = piece_put(&p, d->link, (size_t)d->nopen * sizeof *d->link, err);
	if (!r)
		r = piece_put(&p, d->vertex, (size_t)d->nopen * sizeof *d->vertex, err);
	if (!r)
		r = put_rest(&p, d, &h.code, &e, err);
	if (!r)
		r = piece_flush(&p, err);
	if (r)
		return r;
	h.sums = (struct store_sums){XXH3_64bits(f->beside.proof, f->beside.proof_size), store_open_sum(d),
				     XXH3_64bits_digest(&p.sum)};
	store_sizes(f, &h);
	store_header_pack(f, id, &h, header);
	return io_write_at(fd, header, STORE_HEADER, at, name, err);
}
