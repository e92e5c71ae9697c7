/*
 * The mesh stream: the bytes that acutd writes into a pipe and a client reads (STREAM.md describes them).
 * Encoding hands out pieces to be written one after the other, so that nothing large is copied; decoding is
 * incremental. No descriptors here: bytes only.
 */
#ifndef STREAM_H
#define STREAM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "area_code.h"
#include "digest.h"

struct err;

enum stream_kind { STREAM_WHOLE = 1, STREAM_AREA = 2, STREAM_CHANGES = 3 };

struct stream_head {
	uint8_t kind;
	char lattice[192]; /* "SXY SZ KX KY KZ" */
	char crs[512], unit_xy[16], unit_z[16];
	const char *view; /* canonical text; NULL: ""; at most AREA_TEXT_MAX bytes, which outlive the pieces */
	struct digest id; /* generation, view, plan, kernel version */
	int32_t box[6];   /* holds all vertices: min x y z, max x y z; lattice numbers */
};

/* STREAM_CHANGES: what the changes are against, right behind the head. Regions count where they have triangles. */
struct stream_base {
	uint64_t generation, job;                    /* whose mesh the reader has */
	struct digest old_digest, old_vertex_digest; /* of that mesh, whole */
	struct digest digest, vertex_digest;         /* of the mesh that it becomes, whole */
	uint64_t gone, gone_triangles;               /* regions that no longer hold */
	uint64_t kept, kept_triangles;               /* that both have */
};
/* A region that no longer holds; as it goes on the wire. */
struct stream_region {
	int64_t box[4]; /* as stream_block */
	uint64_t triangles;
	struct digest digest; /* of these */
};

struct stream_block {
	uint64_t index; /* of its domain in the plan; never falls; pieces of one domain share it */
	int64_t box[4]; /* of its region: doubled odd lattice borders; INT64_MIN/MAX: infinite */
	uint64_t first; /* number of vertex[0]: the count of all vertices before */
	uint32_t nforeign, nnew, ntriangle;
	const uint64_t *foreign;
	const int32_t (*vertex)[3];
	const uint32_t (*triangle)[3];
	const uint8_t *flags; /* one byte a triangle, or NULL */
	const uint8_t *final; /* bit set over nforeign + nnew, low bits first; bits beyond are zero */
};

struct stream_tail {
	bool failed; /* the job ended with an error; `error` is what acutctl prints */
	char error_code[32], error_message[512], error_hint[384];
	uint64_t blocks, vertices, triangles, hull;
	int32_t box[6];
	struct digest digest, vertex_digest;
	char report[4096]; /* JSON object of the daemon's report: removed counts, domains, times */
};

/* Encoding. A frame is written as pieces; `scratch` holds head, tail and block headers. */
struct stream_piece {
	const void *bytes;
	size_t size;
};
#define STREAM_PIECES 8
#define STREAM_SCRATCH 16384
/* Each returns the number of pieces (<= STREAM_PIECES); pieces point into scratch and the argument. */
unsigned stream_put_head(const struct stream_head *, uint8_t scratch[STREAM_SCRATCH], struct stream_piece *);
unsigned stream_put_base(const struct stream_base *, uint8_t scratch[STREAM_SCRATCH], struct stream_piece *);
/* 1 <= n <= STREAM_REGIONS; the regions go out from where they lie. */
#define STREAM_REGIONS 65536u
unsigned stream_put_gone(const struct stream_region *, uint32_t n, uint8_t scratch[STREAM_SCRATCH], struct stream_piece *);
unsigned stream_put_block(const struct stream_block *, uint8_t scratch[STREAM_SCRATCH], struct stream_piece *);
unsigned stream_put_tail(const struct stream_tail *, uint8_t scratch[STREAM_SCRATCH], struct stream_piece *);

/* Decoding: feed bytes as they come; events come out one at a time. Checks magic, version, lengths,
 * checksums, order of frames and blocks, counts of regions that are gone, numbering (first == vertices so far, foreign < first),
 * index bounds, boxes, and the tail's counts and box. Not checked here: geometry and digests. Every breach is -ERR_PROTO with the
 * offset in the stream (-ERR_VERSION: another version; -ERR_UNSUPPORTED: a kind that this build cannot read). Takes as much
 * memory as the largest frame, at most STREAM_FRAME_MAX. */
#define STREAM_FRAME_MAX (1u << 30)
struct stream_reader;
enum stream_event { STREAM_MORE, STREAM_HEAD, STREAM_BLOCK, STREAM_TAIL, STREAM_BASE, STREAM_GONE };
struct stream_reader *stream_reader_new(void);
/* What came before the next block, for a reader that goes on where another one was. */
struct stream_reader_state {
	uint64_t blocks, vertices, triangles, last_index;
	int32_t box[6]; /* of the vertices */
};
void stream_reader_state(const struct stream_reader *, struct stream_reader_state *ret);
/* Right after new: after the head comes the block behind these. */
void stream_reader_start(struct stream_reader *, const struct stream_reader_state *);
struct stream_reader *stream_reader_free(struct stream_reader *);
/* Where to put the next bytes, and how many at most (never 0). -ERR_NOMEM. */
int stream_reader_space(struct stream_reader *, void **ret, size_t *ret_size, struct err *err);
/* n bytes were put there. *ret_event says what is whole now; valid until the next call of _space. A failed
 * reader fails for ever. */
int stream_reader_feed(struct stream_reader *, size_t n, enum stream_event *ret_event, struct err *err);
const struct stream_head *stream_reader_head(const struct stream_reader *);
const struct stream_block *stream_reader_block(const struct stream_reader *);
const struct stream_base *stream_reader_base(const struct stream_reader *);
const struct stream_region *stream_reader_gone(const struct stream_reader *, size_t *ret_n);
const struct stream_tail *stream_reader_tail(const struct stream_reader *);
bool stream_reader_done(const struct stream_reader *);       /* the tail was read */
uint64_t stream_reader_offset(const struct stream_reader *); /* bytes fed so far */

#endif
