/*
 * Writing the mesh stream. A frame is returned as pieces, in wire order, that point into the caller's arrays; only
 * headers, texts and padding are written, into the caller's scratch. The arrays are sent as in memory, so this builds
 * on little-endian machines only.
 */
#include "stream.h"

#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "cursor.h"
#include "stream_bytes.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "arrays are written as they lie in memory");

static unsigned add_piece(struct stream_piece *piece, unsigned n, const void *bytes, uint64_t size)
{
	if (size == 0)
		return n;
	piece[n] = (struct stream_piece){bytes, size};
	return n + 1;
}

/* Sets the header at the start of the first piece; the payload is the rest of all pieces. */
static void put_header(enum stream_type type, uint8_t *scratch, const struct stream_piece *piece, unsigned n)
{
	struct packer p = packer_of(scratch, STREAM_HEADER_SIZE);
	XXH3_state_t state;
	uint64_t length = 0;

	XXH3_64bits_reset(&state);
	for (unsigned i = 0; i < n; i++) {
		size_t skip = i == 0 ? STREAM_HEADER_SIZE : 0;

		XXH3_64bits_update(&state, (const uint8_t *)piece[i].bytes + skip, piece[i].size - skip);
		length += piece[i].size - skip;
	}
	packer_u32(&p, STREAM_MAGIC);
	packer_u16(&p, STREAM_VERSION);
	packer_u16(&p, type);
	packer_u64(&p, length);
	packer_u64(&p, XXH3_64bits_digest(&state));
	packer_u64(&p, XXH3_64bits(scratch, STREAM_HEADER_CHECKED));
}

static void put_text(struct packer *p, const char *text, size_t size)
{
	size_t n = strnlen(text, size - 1);

	packer_u16(p, (uint16_t)n);
	packer_bytes(p, text, n);
}

#define PUT_TEXT(p, array) put_text((p), (array), sizeof(array))

static void put_box(struct packer *p, const int32_t box[6])
{
	for (unsigned i = 0; i < 6; i++)
		packer_i32(p, box[i]);
}

static void put_digest(struct packer *p, struct digest d)
{
	packer_u64(p, d.hi);
	packer_u64(p, d.lo);
}

/* A frame that is in scratch entirely. */
static unsigned put_small(enum stream_type type, struct packer *p, struct stream_piece *piece)
{
	packer_zero(p, stream_padded(packer_size(p)) - packer_size(p));
	add_piece(piece, 0, p->start, packer_size(p));
	put_header(type, p->start, piece, 1);
	return 1;
}

unsigned stream_put_head(const struct stream_head *head, uint8_t scratch[STREAM_SCRATCH], struct stream_piece *piece)
{
	static const uint8_t zeros[8];
	struct packer p = packer_of(scratch, STREAM_SCRATCH);
	size_t view = head->view ? strnlen(head->view, AREA_TEXT_MAX) : 0, size;
	unsigned n = 0;

	packer_zero(&p, STREAM_HEADER_SIZE);
	packer_u8(&p, head->kind);
	packer_u8(&p, (uint8_t)(head->lines | head->bounded << 1));
	packer_zero(&p, 6);
	put_digest(&p, head->id);
	put_box(&p, head->box);
	PUT_TEXT(&p, head->lattice);
	PUT_TEXT(&p, head->crs);
	PUT_TEXT(&p, head->unit_xy);
	PUT_TEXT(&p, head->unit_z);
	packer_u16(&p, (uint16_t)view);
	/* View and WKT may be long, so they are not copied. */
	n = add_piece(piece, n, scratch, packer_size(&p));
	n = add_piece(piece, n, head->view, view);
	size = packer_size(&p) + view;
	if (head->system) {
		size_t wkt = head->wkt ? strnlen(head->wkt, STREAM_WKT_MAX) : 0, before = packer_size(&p);

		PUT_TEXT(&p, head->geoid);
		packer_u16(&p, (uint16_t)wkt);
		n = add_piece(piece, n, scratch + before, packer_size(&p) - before);
		n = add_piece(piece, n, head->wkt, wkt);
		size += packer_size(&p) - before + wkt;
	}
	n = add_piece(piece, n, zeros, stream_padded(size) - size);
	put_header(STREAM_TYPE_HEAD, scratch, piece, n);
	return n;
}

unsigned stream_put_base(const struct stream_base *base, uint8_t scratch[STREAM_SCRATCH], struct stream_piece *piece)
{
	struct packer p = packer_of(scratch, STREAM_SCRATCH);

	packer_zero(&p, STREAM_HEADER_SIZE);
	packer_u64(&p, base->generation);
	packer_u64(&p, base->job);
	put_digest(&p, base->old_digest);
	put_digest(&p, base->old_vertex_digest);
	put_digest(&p, base->digest);
	put_digest(&p, base->vertex_digest);
	packer_u64(&p, base->gone);
	packer_u64(&p, base->gone_triangles);
	packer_u64(&p, base->kept);
	packer_u64(&p, base->kept_triangles);
	return put_small(STREAM_TYPE_BASE, &p, piece);
}

_Static_assert(sizeof(struct stream_region) == STREAM_REGION_SIZE, "regions go out as they lie in memory");

unsigned stream_put_gone(const struct stream_region *region, uint32_t n, uint8_t scratch[STREAM_SCRATCH],
			 struct stream_piece *piece)
{
	struct packer p = packer_of(scratch, STREAM_SCRATCH);
	unsigned pieces;

	packer_zero(&p, STREAM_HEADER_SIZE);
	pieces = add_piece(piece, 0, scratch, packer_size(&p));
	pieces = add_piece(piece, pieces, region, n * sizeof *region);
	put_header(STREAM_TYPE_GONE, scratch, piece, pieces);
	return pieces;
}

unsigned stream_put_block(const struct stream_block *b, uint8_t scratch[STREAM_SCRATCH], struct stream_piece *piece)
{
	static const uint8_t zeros[8];
	struct packer p = packer_of(scratch, STREAM_SCRATCH);
	unsigned flags = (b->flags ? STREAM_BLOCK_FLAG_BYTES : 0) | (b->origin ? STREAM_BLOCK_ORIGINS : 0);
	uint64_t locals = (uint64_t)b->nforeign + b->nnew;
	uint64_t bytes = stream_block_bytes(b->nforeign, b->nnew, b->ntriangle, flags);
	unsigned n = 0;

	packer_zero(&p, STREAM_HEADER_SIZE);
	packer_u64(&p, b->index);
	for (unsigned i = 0; i < 4; i++)
		packer_i64(&p, b->box[i]);
	packer_u64(&p, b->first);
	packer_u32(&p, b->nforeign);
	packer_u32(&p, b->nnew);
	packer_u32(&p, b->ntriangle);
	packer_u32(&p, flags);
	n = add_piece(piece, n, scratch, packer_size(&p));
	n = add_piece(piece, n, b->foreign, b->nforeign * sizeof *b->foreign);
	n = add_piece(piece, n, b->vertex, b->nnew * sizeof *b->vertex);
	n = add_piece(piece, n, b->triangle, b->ntriangle * sizeof *b->triangle);
	n = add_piece(piece, n, b->origin, b->origin ? b->nnew * sizeof *b->origin : 0);
	n = add_piece(piece, n, b->flags, b->flags ? b->ntriangle : 0);
	n = add_piece(piece, n, b->final, (locals + 7) / 8);
	n = add_piece(piece, n, zeros, stream_padded(bytes) - bytes);
	put_header(STREAM_TYPE_BLOCK, scratch, piece, n);
	return n;
}

unsigned stream_put_tail(const struct stream_tail *tail, uint8_t scratch[STREAM_SCRATCH], struct stream_piece *piece)
{
	struct packer p = packer_of(scratch, STREAM_SCRATCH);

	packer_zero(&p, STREAM_HEADER_SIZE);
	packer_u8(&p, tail->failed);
	packer_zero(&p, 7);
	packer_u64(&p, tail->blocks);
	packer_u64(&p, tail->vertices);
	packer_u64(&p, tail->triangles);
	packer_u64(&p, tail->hull);
	put_box(&p, tail->box);
	put_digest(&p, tail->digest);
	put_digest(&p, tail->vertex_digest);
	PUT_TEXT(&p, tail->error_code);
	PUT_TEXT(&p, tail->error_message);
	PUT_TEXT(&p, tail->error_hint);
	PUT_TEXT(&p, tail->report);
	return put_small(STREAM_TYPE_TAIL, &p, piece);
}
