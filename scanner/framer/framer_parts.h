/* Shared by the files of the framer: framer.c feeds and holds, framer_cut.c has a function a kind, framer_las.c that
 * of LAS. */
#ifndef FRAMER_PARTS_H
#define FRAMER_PARTS_H

#include "framer.h"
#include "profile.h"

enum { FRAMER_PIECE = 64 << 10, FRAMER_MARKS = 32 };

struct las_file {
	bool inside;
	uint64_t at;    /* bytes of it that were cut off already */
	uint64_t end;   /* of what is known of it */
	uint32_t evlrs; /* whose heads were not read yet */
	uint64_t number;
	uint64_t start; /* in the stream */
};

struct framer {
	struct profile p;
	framer_sink sink;
	void *ctx;
	void (*told)(void *ctx, enum framer_reason, uint64_t offset, uint64_t size);
	void *told_ctx;
	size_t (*cut)(struct framer *, const uint8_t *at, size_t size);

	uint64_t at;   /* in the stream: of the first byte that is handed to cut */
	size_t looked; /* from there on: cut has looked at as many and they hold no end */
	bool skipping; /* LINE: until the next line end */
	bool lost;     /* LENGTH without sync: since a length that cannot be, no telegram was found */
	int result;    /* what the sink answered */
	struct las_file las;
	uint64_t garbage_at, garbage; /* a stretch of it that is not over */

	uint8_t *held;
	size_t n, room;
	/* When held bytes came: those from `from` on, in order. */
	struct {
		uint64_t from;
		int64_t time_ns;
	} mark[FRAMER_MARKS];
	size_t marks;
	struct framer_counts counts;
};

/*
 * A cut: telegrams from the front of these bytes, of which the first has the place f->at in the stream, as many as are
 * whole. Gives how many bytes are done with; the others are the beginning of something and come again with more behind
 * them. What it decides must not depend on how many bytes there are behind what it needs.
 */
size_t framer_cut_stream(struct framer *, const uint8_t *, size_t);
size_t framer_cut_stx_etx(struct framer *, const uint8_t *, size_t);
size_t framer_cut_line(struct framer *, const uint8_t *, size_t);
size_t framer_cut_fixed(struct framer *, const uint8_t *, size_t);
size_t framer_cut_length(struct framer *, const uint8_t *, size_t);
size_t framer_cut_las(struct framer *, const uint8_t *, size_t);

/* A good telegram: `size` bytes at `at`, in a frame of `frame` bytes that begins at place `offset` of the stream.
 * false: the sink wants no more. */
bool framer_give(struct framer *, const uint8_t *at, size_t size, uint64_t offset, size_t frame);
void framer_bad(struct framer *, enum framer_reason, uint64_t offset, uint64_t size);
void framer_garbage(struct framer *, uint64_t offset, uint64_t size);
/* The LAS file that was begun has no end; `left` bytes of it were not cut off yet and are in no telegram. */
void framer_las_broken(struct framer *, enum framer_reason, uint64_t left);

#endif
