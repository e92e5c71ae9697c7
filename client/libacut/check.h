/* Inside libacut: what a stream claims of its mesh, computed again from its blocks. */
#ifndef CHECK_H
#define CHECK_H

#include "digest.h"
#include "stream.h"

struct cursor;
struct err;
struct packer;
struct check;

/* k: the lattice's offsets; absolute number = number + k. NULL: no memory. */
struct check *check_new(const int64_t k[3]);
struct check *check_free(struct check *);
/* *ret: the positions of the block's vertices, foreign ones first; valid until the next call, or as long as the block.
 * -ERR_PROTO: a vertex is used after it was final; -ERR_NOMEM. */
int check_block(struct check *, const struct stream_block *, const int32_t (**ret)[3], struct err *err);
/* After the last block. -ERR_DIGEST: a digest differs from the tail's; -ERR_PROTO: the number of vertices that never became
 * final is not the hull's (whole meshes only). */
int check_tail(const struct check *, const struct stream_tail *, bool whole, struct err *err);
/* For a stream of changes, after check_tail: the old mesh without the regions that are gone, with those that came, is the new
 * one. -ERR_DIGEST if the sums differ. */
void check_gone(struct check *, const struct stream_region *, size_t n);
int check_changes(const struct check *, const struct stream_base *, const struct stream_tail *, struct err *err);
uint64_t check_open(const struct check *); /* vertices in the table now */

/* The state after the last block, as bytes, and a new check that continues from it. -ERR_CORRUPT, -ERR_NOMEM. */
size_t check_packed_size(const struct check *);
void check_pack(const struct check *, struct packer *);
int check_unpack(struct check *, struct cursor *, struct err *err);

#endif
