/* Frames of a stream to a client (stream_out.c), and those of changes between head and blocks (stream_changes.c). */
#ifndef STREAM_CHANGES_H
#define STREAM_CHANGES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "run.h"
#include "stream.h"

struct err;
struct ledger;

struct out_frame {
	bool ready;
	struct stream_piece piece[STREAM_PIECES];
	unsigned n, at; /* piece being written */
	size_t done;    /* bytes of it */
	uint8_t scratch[STREAM_SCRATCH];
};

/* A base, then lists of regions that are gone. */
struct out_changes {
	struct out_frame frame;
	uint64_t n, at; /* regions; of these, in frames so far */
	struct stream_region region[];
};

/* A copy of these, whose first frame is ready to be written; *charged grows by what it takes of LEDGER_PIPE. free() does
 * for what is not sent. */
int out_changes_new(const struct run_changes *, struct ledger *, size_t *charged, struct out_changes **ret, struct err *err);
/* The frame is written: the next one, or NULL, and it is freed. */
struct out_changes *out_changes_next(struct out_changes *);

#endif
