/* Any bytes as the points of a compressed file, from the place of the chunk table's address on, and as the record
 * that says how they are compressed (the first 46 bytes, if the first one is odd). Of a header that counts no points, which the
 * first byte makes of some, those that the table counts are those that it then gives. */
#include <stdlib.h>
#include <string.h>

#include "fuzz_input.h"
#include "laz.h"

struct text {
	const uint8_t *at;
	size_t n;
};

static int read_text(void *ctx, uint64_t at, void *buf, size_t n, size_t *ret_n, struct err *err)
{
	const struct text *t = ctx;
	size_t left = at < t->n ? t->n - (size_t)at : 0;

	*ret_n = n < left ? n : left;
	memcpy(buf, t->at + (left ? at : 0), *ret_n);
	return 0;
}

static const uint8_t point10[] = {2,   0,   0,   0,   2,   2,   0,   0,   0,   0,   0,   0,   50, 0, 0, 0, 255, 255, 255, 255,
				  255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 1,  0, 6, 0, 20,  0,   2,   0};

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	if (i >= 8)
		return 0;
	memset(bytes, 0, 128);
	bytes[0] = (uint8_t)i;
	memcpy(bytes + 1, point10, sizeof point10);
	if (i & 2) /* chunks of any size */
		memset(bytes + 13, 255, 4);
	bytes[41] = 60 + (uint8_t)i; /* where the table is: version, chunks */
	bytes[41 + 60 + i + 4] = (uint8_t)(1 + i);
	return 41 + 80;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	enum { HEAD = 1 + sizeof point10 };
	struct text text = {bytes + HEAD, size - HEAD};
	const struct laz_source source = {&text, read_text};
	struct laz_place place = {.begin = 0, .end = size - HEAD, .points = 200, .size = size - HEAD};
	uint64_t chunks = 0, sum = 0, seen = 0, counted = 0;
	struct laz_table *table;
	struct laz_format format;
	struct laz_chunk chunk;
	struct err err = ERR_INIT;
	const char *why = NULL;
	bool more = true;
	void *memory;
	int rc;

	if (size < HEAD)
		return 0;
	rc = laz_format_parse(bytes[0] & 1 ? bytes + 1 : point10, sizeof point10, 0, 20, &format, &err);
	fuzz_input_check(rc, &err);
	if (rc)
		return 0;
	place.points = bytes[0] >> 1 ? (uint64_t)bytes[0] << (bytes[0] >> 3) : 200;
	memory = aligned_alloc(64, (laz_table_bytes() + 63) & ~(size_t)63);
	if (!memory)
		abort();
	if (bytes[0] >> 1 == 1) {
		place.points = 0;
		rc = laz_table_count(memory, &format, &source, &place, &err);
		fuzz_input_check(rc, &err);
		counted = place.points != LAZ_UNCOUNTED ? place.points : 0;
	}
	if (!rc)
		rc = laz_table_open(memory, &format, &source, &place, &table, &chunks, &why, &err);
	if (counted && (rc || why || !chunks))
		abort();
	while (!rc && !why && chunks && more) {
		rc = laz_table_next(table, &chunk, &more, &err);
		if (rc || !more)
			break;
		sum += chunk.points;
		if (chunk.at_most != (place.at_most && seen + 1 == chunks))
			abort();
		if (++seen > chunks || chunk.at > size || chunk.bytes > size)
			abort();
	}
	fuzz_input_check(rc, &err);
	if (!rc && !why && chunks && (seen != chunks || sum != place.points))
		abort();
	free(memory);
	return 0;
}
