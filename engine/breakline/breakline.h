/*
 * Lines of sources, and what they become: files of lines on the lattice, one a source, which are kept; and of all lines of a
 * generation the pieces (lineset.h) and the records of line vertices (POINT_LINE).
 */
#ifndef BREAKLINE_H
#define BREAKLINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "digest.h"
#include "point.h"

struct err;

/* ---- a file of lines: one source, in the order of its input ---- */

enum breakline_kind { BREAKLINE_HARD, BREAKLINE_LAKE, BREAKLINE_BOUNDARY, BREAKLINE_HOLE, BREAKLINE_KINDS };
const char *breakline_kind_text(enum breakline_kind); /* "hard" ... */

/* A feature has lines or rings; the last vertex of a ring is joined with its first, which is not repeated. */
enum {
	BREAKLINE_FEATURE = 1, /* the first vertex of a feature */
	BREAKLINE_LINE = 2,    /* the first vertex of a line or ring */
	BREAKLINE_RING = 4,    /* of a ring */
};
struct breakline_vertex {
	int32_t x, y, z; /* lattice numbers */
	uint8_t bits;    /* BREAKLINE_FEATURE ... */
	uint8_t kind;    /* enum breakline_kind */
	uint16_t reserved;
	uint32_t number; /* of the feature in the input, for messages */
};

struct breakline_totals { /* of one source */
	uint64_t features[BREAKLINE_KINDS], lines, vertices;
	int32_t box[4];
	struct digest content;
};

struct breakline_writer;
int breakline_writer_new(int dirfd, const char *name, struct breakline_writer **ret, struct err *);
int breakline_write(struct breakline_writer *, const struct breakline_vertex *, size_t n, struct err *);
/* Also fsyncs. */
int breakline_writer_finish(struct breakline_writer *, struct breakline_totals *ret, struct err *);
struct breakline_writer *breakline_writer_free(struct breakline_writer *); /* removes a file that is not finished; NULL is fine */
int breakline_totals(int dirfd, const char *name, struct breakline_totals *ret, struct err *);
/* Passes all vertices in order, in pieces; checks the file's checksum. */
int breakline_read(int dirfd, const char *name, int (*each)(void *ctx, const struct breakline_vertex *, size_t n, struct err *),
		   void *ctx, struct err *);

/* The feature whose segment is nearest to both ends of a piece, and the greater distance of these from it, in lattice numbers.
 * Pieces lie near the segment that they were made of, not on it. INFINITY: the file has no segment. */
int breakline_find(int dirfd, const char *name, const int32_t a[2], const int32_t b[2], double *ret_distance,
		   uint32_t *ret_number, struct err *);

/* ---- all lines of a generation ---- */

/* A place that the report names. */
enum breakline_event {
	BREAKLINE_CROSSING, /* two lines cross; heights of both there */
	BREAKLINE_UNEVEN,   /* vertices of different heights at one position */
	BREAKLINE_EVENTS
};

struct breakline_counts {
	uint64_t features[BREAKLINE_KINDS], lines, vertices; /* of the sources */
	uint64_t positions, pieces;                          /* of the result */
	uint64_t crossings, uneven;
	uint32_t widest;          /* the largest difference of heights at one of these, in lattice numbers */
	int32_t widest_at[2];     /* and where */
	uint64_t left_out;        /* pieces that are out: outside of the boundary, or in a hole */
	uint64_t doubled, points; /* segments that were there before; segments without length */
};

struct breakline_params {
	int dirfd;
	const char *const *file; /* files of lines, one a source; their order does not matter */
	size_t nfiles;
	const char *lineset; /* name of the file that is written */
	uint64_t memory; /* bytes that may be in use at a time. -ERR_LIMIT if that is not enough; err->need: what may suffice */
	/* Takes the records of line vertices, with POINT_LINE, class 0, sorted by point_compare. Two at a position whose lowest
	 * and highest heights differ. */
	int (*vertices)(void *ctx, const struct point *, size_t n, struct err *);
	int (*event)(void *ctx, enum breakline_event, int32_t x, int32_t y, int32_t lower, int32_t upper,
		     struct err *); /* NULL */
	void *ctx;
};
int breakline_build(const struct breakline_params *, struct breakline_counts *ret, struct err *);

#endif
