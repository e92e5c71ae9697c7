/* The framer, as its files share it: framer.c feeds and holds, framer_cut.c has a function for each kind, framer_las.c
 * the one for LAS. */
#ifndef FRAMER_PARTS_H
#define FRAMER_PARTS_H

#include "framer.h"
#include "profile.h"

enum { FRAMER_PIECE = 64 << 10, FRAMER_MARKS = 32 };

struct las_file {
	bool inside;
	uint64_t at;    /* bytes of it that were cut already */
	uint64_t end;   /* end of the known part */
	uint32_t evlrs; /* whose heads were not read yet */
	uint64_t number;
	uint64_t start; /* offset in the stream */
};

struct framer {
	struct profile p;
	framer_sink sink;
	void *ctx;
	void (*on_bad)(void *ctx, enum framer_reason, uint64_t offset, uint64_t size);
	void *on_bad_ctx;
	size_t (*cut)(struct framer *, const uint8_t *at, size_t size);

	uint64_t at;     /* offset in the stream of the first byte passed to cut */
	size_t examined; /* from there on: cut has examined so many bytes, and they contain no end */
	bool skipping;   /* LINE: until the next line end */
	bool lost;       /* LENGTH without sync: no telegram was found since an impossible length */
	int result;      /* the result of the sink */
	struct las_file las;
	uint64_t garbage_at, garbage; /* garbage that has not ended */

	uint8_t *held;
	size_t n, room;
	/* When held bytes came: the time of those from `from` on, in order. */
	struct {
		uint64_t from;
		int64_t time_ns;
	} mark[FRAMER_MARKS];
	size_t marks;
	struct framer_counts counts;
};

/*
 * A cut: takes all complete telegrams from the front of these bytes, the first of which is at f->at in the stream.
 * Returns how many bytes are consumed; the others are incomplete and are passed again with more bytes. Its decisions
 * must not depend on bytes behind those that it needs.
 */
size_t framer_cut_stream(struct framer *, const uint8_t *, size_t);
size_t framer_cut_stx_etx(struct framer *, const uint8_t *, size_t);
size_t framer_cut_line(struct framer *, const uint8_t *, size_t);
size_t framer_cut_fixed(struct framer *, const uint8_t *, size_t);
size_t framer_cut_length(struct framer *, const uint8_t *, size_t);
size_t framer_cut_las(struct framer *, const uint8_t *, size_t);

/* Passes on a telegram: `size` bytes at `at`, in a frame of `frame` bytes at `offset` of the stream. false: the sink
 * wants no more. */
bool framer_emit(struct framer *, const uint8_t *at, size_t size, uint64_t offset, size_t frame);
void framer_bad(struct framer *, enum framer_reason, uint64_t offset, uint64_t size);
void framer_garbage(struct framer *, uint64_t offset, uint64_t size);
/* The current LAS file has no end; `left` bytes of it were not cut yet and are in no telegram. */
void framer_las_broken(struct framer *, enum framer_reason, uint64_t left);

#endif
