/* Reading all bytes of segments and runs, to report what is damaged. */
#ifndef GRID_VERIFY_H
#define GRID_VERIFY_H

#include <stddef.h>
#include <stdint.h>

struct err;
struct grid_manifest;

enum { GRID_VERIFY_BYTES = 256 << 10 };
struct grid_verify_params {
	int dirfd;
	void *memory; /* GRID_VERIFY_BYTES */
	/* Called for each damaged thing, with its file, place and fault, and for each of a newer version (-ERR_VERSION). */
	void (*damaged)(void *ctx, const struct err *);
	/* Bytes that were read since the last call; non-zero ends the verification (-ERR_CANCELLED). May be NULL. */
	int (*progress)(void *ctx, uint64_t bytes);
	void *ctx;
};
/* Checks every page and block of a segment of that manifest, and every number in them, whichever records are live.
 * Damage is reported by the callback and is not an error here. Charges some bytes for each source to the manifest's
 * ledger meanwhile: -ERR_BUSY if they are not free. */
int grid_verify_segment(const struct grid_verify_params *, const struct grid_manifest *, size_t segment, struct err *err);
/* Checks every block of the runs of a suspended stage of that name. */
int grid_verify_stage(const struct grid_verify_params *, const char *name, struct err *err);

#endif
