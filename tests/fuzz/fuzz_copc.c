/* Any bytes as a COPC hierarchy: the first byte says how it is walked, the rest are entries and pages. */
#include <stdlib.h>
#include <string.h>

#include "fuzz_input.h"
#include "input_las_parts.h"

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	/* level, x, y, z; a page below (points -1) at byte 33, or points */
	const int32_t entry[4][8] = {{0, 0, 0, 0, 1000, 0, 50, 20},
				     {1, 1, 0, 0, 65, 0, 64, -1},
				     {1, 1, 0, 0, 2000, 0, 60, 20},
				     {2, 3, 1, 0, 3000, 0, 70, (int32_t)i}};

	if (i >= 4)
		return 0;
	bytes[0] = (uint8_t)(i | 64);
	memcpy(bytes + 1, entry, sizeof entry);
	return 1 + sizeof entry;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	static struct input *in;
	static struct input_copc_walk walk;
	struct input_copc copc = {.at = 1,
				  .bytes = size - 1,
				  .root_at = 1,
				  .side = 1000,
				  .crop = {200, 200, 700, 300},
				  .data_at = 0,
				  .data_end = 1 << 20};
	struct err err = ERR_INIT;
	struct laz_chunk chunk;
	bool meets, more = true;
	const char *why = NULL;
	size_t nodes = 0;
	int rc = 0;

	if (size < 33)
		return 0;
	if (!in)
		in = calloc(1, sizeof *in);
	if (!in)
		abort();
	in->fd = fuzz_input_fd(bytes, size);
	in->size = size;
	copc.bytes -= copc.bytes % 32;
	copc.root_bytes = bytes[0] & 64 && copc.bytes >= 64 ? 64 : copc.bytes;
	input_copc_walk_begin(&walk, &copc, bytes[0] & 1);
	while (!rc && !why && more) {
		rc = input_copc_walk_next(in, &walk, &chunk, &meets, &more, &why, &err);
		if (!rc && !why && more && (++nodes > size / 32 || chunk.at > copc.data_end || chunk.bytes > copc.data_end))
			abort();
	}
	fuzz_input_check(rc, &err);
	return 0;
}
