/* What writer and reader of the mesh stream share (stream.md). Internal. */
#ifndef STREAM_BYTES_H
#define STREAM_BYTES_H

#include <stdint.h>

#define STREAM_MAGIC 0x53554341u /* "ACUS" */
#define STREAM_VERSION 1u

enum stream_type {
	STREAM_TYPE_HEAD = 1,
	STREAM_TYPE_BLOCK = 2,
	STREAM_TYPE_TAIL = 3,
	STREAM_TYPE_BASE = 4,
	STREAM_TYPE_GONE = 5
};

enum {
	STREAM_HEADER_SIZE = 32,     /* magic, version, type, length, payload checksum, header checksum */
	STREAM_HEADER_CHECKED = 24,  /* bytes that the header checksum covers */
	STREAM_BLOCK_SIZE = 64,      /* index, box, first, counts, flags; the arrays follow */
	STREAM_REGION_SIZE = 56,     /* box, triangles, digest */
	STREAM_BLOCK_FLAG_BYTES = 1, /* the block has a flags byte for each triangle */
	STREAM_BLOCK_ORIGINS = 2,    /* and 8 bytes for each new vertex */
};

/* Bytes of a block's payload before padding. */
static inline uint64_t stream_block_bytes(uint64_t nforeign, uint64_t nnew, uint64_t ntriangle, unsigned flags)
{
	return STREAM_BLOCK_SIZE + nforeign * 8 + nnew * 12 + ntriangle * 12 + (flags & STREAM_BLOCK_FLAG_BYTES ? ntriangle : 0) +
	       (flags & STREAM_BLOCK_ORIGINS ? nnew * 8 : 0) + (nforeign + nnew + 7) / 8;
}

static inline uint64_t stream_padded(uint64_t n)
{
	return (n + 7) & ~(uint64_t)7;
}

#endif
