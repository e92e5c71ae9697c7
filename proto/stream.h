/*
 * The mesh stream: the bytes that acutd writes to a pipe and a client reads (stream.md). Encoding returns pieces to be
 * written one after the other, so that nothing large is copied; decoding is incremental. Only bytes, no descriptors.
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
	/* Only for a reader that asked for it (Fetch.system): WAY HASH NAME of the geoid, and the WKT, which outlives the pieces;
	 * NULL: "". */
	bool system;
	char geoid[128];
	const char *wkt;
	/* Only for a reader that asked for it (Fetch.lines): the mesh has lines, so blocks may have flags; it ends at boundaries
	 * or holes, so that its hull is not known. */
	bool lines, bounded;
	struct digest id; /* generation, view, plan, kernel version */
	int32_t box[6];   /* of all vertices: min x y z, max x y z; lattice numbers */
};

/* STREAM_CHANGES, directly after the head: the mesh to which the changes apply. Regions count if they have triangles. */
struct stream_base {
	uint64_t generation, job;                    /* of the mesh that the reader has */
	struct digest old_digest, old_vertex_digest; /* of that whole mesh */
	struct digest digest, vertex_digest;         /* of the whole new mesh */
	uint64_t gone, gone_triangles;               /* regions that are no longer valid */
	uint64_t kept, kept_triangles;               /* regions of both meshes */
};
/* A region that is no longer valid; as on the wire. */
struct stream_region {
	int64_t box[4]; /* as stream_block */
	uint64_t triangles;
	struct digest digest; /* of these */
};

/* The record of a vertex, as on the wire. */
struct stream_origin {
	uint32_t source;
	uint8_t cls, zero[3];
};

struct stream_block {
	uint64_t index; /* of its domain in the plan; never decreases; pieces of one domain share it */
	int64_t box[4]; /* of its region: doubled lattice borders (odd); INT64_MIN/MAX: infinite */
	uint64_t first; /* number of vertex[0]: the number of all vertices before */
	uint32_t nforeign, nnew, ntriangle;
	const uint64_t *foreign;
	const int32_t (*vertex)[3];
	const uint32_t (*triangle)[3];
	const uint8_t *flags;               /* one byte for each triangle, or NULL */
	const uint8_t *final;               /* bit set over nforeign + nnew, low bits first; bits beyond are zero */
	const struct stream_origin *origin; /* of each new vertex; NULL: not of this view */
	/* Of a reader, NULL if it has no room: nforeign free places, then the new vertices, so that positions of all need no
	 * copy. */
	int32_t (*local)[3];
};

struct stream_tail {
	bool failed; /* the job failed; acutctl prints `error` */
	char error_code[32], error_message[512], error_hint[384];
	uint64_t blocks, vertices, triangles, hull;
	int32_t box[6];
	struct digest digest, vertex_digest;
	char report[4096]; /* JSON object of the daemon's report: removed counts, domains, times */
};

/* Encoding. A frame is written as pieces; `scratch` holds the headers of head, tail and block. */
struct stream_piece {
	const void *bytes;
	size_t size;
};
#define STREAM_PIECES 9
#define STREAM_WKT_MAX 32768u
#define STREAM_SCRATCH 16384
/* Each returns the number of pieces (<= STREAM_PIECES), which point into scratch and the argument. */
unsigned stream_put_head(const struct stream_head *, uint8_t scratch[STREAM_SCRATCH], struct stream_piece *);
unsigned stream_put_base(const struct stream_base *, uint8_t scratch[STREAM_SCRATCH], struct stream_piece *);
/* 1 <= n <= STREAM_REGIONS; the regions are not copied. */
#define STREAM_REGIONS 65536u
unsigned stream_put_gone(const struct stream_region *, uint32_t n, uint8_t scratch[STREAM_SCRATCH], struct stream_piece *);
unsigned stream_put_block(const struct stream_block *, uint8_t scratch[STREAM_SCRATCH], struct stream_piece *);
unsigned stream_put_tail(const struct stream_tail *, uint8_t scratch[STREAM_SCRATCH], struct stream_piece *);

/* Decoding: bytes are fed as they come; events are returned one at a time. It checks magic, version, lengths,
 * checksums, the order of frames and blocks, the number of invalid regions, numbering (first == vertices so far,
 * foreign < first), index bounds, boxes, and the tail's counts and box. It does not check geometry and digests. Every
 * violation is -ERR_PROTO with the offset in the stream (-ERR_VERSION: another version; -ERR_UNSUPPORTED: a kind that
 * this build cannot read). Uses as much memory as the largest frame, at most STREAM_FRAME_MAX. */
#define STREAM_FRAME_MAX (1u << 30)
struct stream_reader;
enum stream_event { STREAM_MORE, STREAM_HEAD, STREAM_BLOCK, STREAM_TAIL, STREAM_BASE, STREAM_GONE };
struct stream_reader *stream_reader_new(void);
/* What came before the next block, for a reader that continues another one. */
struct stream_reader_state {
	uint64_t blocks, vertices, triangles, last_index;
	int32_t box[6]; /* of the vertices */
};
void stream_reader_state(const struct stream_reader *, struct stream_reader_state *ret);
/* Call it directly after _new: after the head the next block is the one behind these. */
void stream_reader_start(struct stream_reader *, const struct stream_reader_state *);
struct stream_reader *stream_reader_free(struct stream_reader *);
/* Memory for the next bytes, and the most that fit (never 0). -ERR_NOMEM. */
int stream_reader_space(struct stream_reader *, void **ret, size_t *ret_size, struct err *err);
/* n bytes were written there. *ret_event: what is complete now; valid until the next call of _space. A failed reader
 * stays failed. */
int stream_reader_feed(struct stream_reader *, size_t n, enum stream_event *ret_event, struct err *err);
const struct stream_head *stream_reader_head(const struct stream_reader *);
const struct stream_block *stream_reader_block(const struct stream_reader *);
const struct stream_base *stream_reader_base(const struct stream_reader *);
const struct stream_region *stream_reader_gone(const struct stream_reader *, size_t *ret_n);
const struct stream_tail *stream_reader_tail(const struct stream_reader *);
bool stream_reader_done(const struct stream_reader *);       /* the tail was read */
uint64_t stream_reader_offset(const struct stream_reader *); /* bytes fed so far */

#endif
