/* From what a stream says of a mesh to what a sink gets, checked on the way. Of a fetch, and of a program that makes a mesh
 * itself. */
#ifndef FEED_H
#define FEED_H

#include "acut.h"
#include "check.h"
#include "decimal.h"
#include "digest.h"
#include "stream.h"

struct feed {
	const struct acut_mesh_sink *sink; /* set by the caller; its `progress` is not called */
	struct check *check;
	struct acut_mesh_head head;
	char lattice[192], scale[2][DECIMAL_TEXT_SIZE], stream_id[DIGEST_HEX_SIZE];
};

/* Makes `check`, and what of `head` the lattice says. -ERR_PROTO: it is no lattice. */
int feed_begin(struct feed *, const struct stream_head *, struct err *err);
/* The rest of `head`, for the sink. All texts of the stream's head are borrowed. These three give -ERR_CANCELLED if the sink
 * gives up. */
int feed_head(struct feed *, const struct stream_head *, struct err *err);
int feed_block(struct feed *, const struct stream_block *, struct err *err);
/* After check_tail. */
int feed_tail(struct feed *, const struct stream_tail *, struct err *err);
void feed_done(struct feed *);

#endif
