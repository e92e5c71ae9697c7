/*
 * Any bytes as one chunk of compressed points. The items are chosen when it is built: FUZZ_FORMAT, the point
 * format, FUZZ_EXTRA bytes behind it. The first byte says compressor, versions and what is read; unless its
 * highest bit is set, the number of points of a layered chunk is made right and its layers small, so that they
 * are decoded.
 */
#include <stdlib.h>
#include <string.h>

#include "fuzz_input.h"
#include "laz.h"

enum { RECORDS = 64, CHUNK = 50 };

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

static const struct {
	uint16_t type, size;
} items[] = {
	{FUZZ_FORMAT < 6 ? LAZ_POINT10 : LAZ_POINT14, FUZZ_FORMAT < 6 ? 20 : 30},
#if FUZZ_FORMAT == 1 || FUZZ_FORMAT == 3 || FUZZ_FORMAT == 4 || FUZZ_FORMAT == 5
	{LAZ_GPSTIME11, 8},
#endif
#if FUZZ_FORMAT == 2 || FUZZ_FORMAT == 3 || FUZZ_FORMAT == 5
	{LAZ_RGB12, 6},
#endif
#if FUZZ_FORMAT == 4 || FUZZ_FORMAT == 5
	{LAZ_WAVEPACKET13, 29},
#endif
#if FUZZ_FORMAT == 7
	{LAZ_RGB14, 6},
#endif
#if FUZZ_FORMAT == 8 || FUZZ_FORMAT == 10
	{LAZ_RGBNIR14, 8},
#endif
#if FUZZ_FORMAT == 9 || FUZZ_FORMAT == 10
	{LAZ_WAVEPACKET14, 29},
#endif
#if FUZZ_EXTRA
	{FUZZ_FORMAT < 6 ? LAZ_BYTE : LAZ_BYTE14, FUZZ_EXTRA},
#endif
};
enum { ITEMS = sizeof items / sizeof *items };

static void put16(uint8_t *to, unsigned v)
{
	to[0] = (uint8_t)v;
	to[1] = (uint8_t)(v >> 8);
}

/* The record that a writer would put into the file; false: it is none. */
static bool make_format(uint8_t how, struct laz_format *ret)
{
	uint8_t vlr[34 + 6 * ITEMS] = {0};
	unsigned length = 0;
	struct err err = ERR_INIT;
	int rc;

	put16(vlr, FUZZ_FORMAT > 5 ? 3 : 1 + (how & 1));
	put16(vlr + 12, CHUNK); /* points of a chunk */
	put16(vlr + 32, ITEMS);
	for (unsigned i = 0; i < ITEMS; i++) {
		put16(vlr + 34 + 6 * i, items[i].type);
		put16(vlr + 36 + 6 * i, items[i].size);
		put16(vlr + 38 + 6 * i, items[i].type == LAZ_WAVEPACKET13 ? 1 :
					FUZZ_FORMAT > 5                   ? 2 + (how >> 1 & 3) :
									    1 + (how >> 1 & 1));
		length += items[i].size;
	}
	rc = laz_format_parse(vlr, sizeof vlr, FUZZ_FORMAT, length, ret, &err);
	fuzz_input_check(rc, &err);
	return !rc;
}

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	uint64_t roll = 88172645463325252u + i;

	if (i >= 16)
		return 0;
	for (size_t k = 0; k < 600; k++) {
		roll ^= roll << 13;
		roll ^= roll >> 7;
		roll ^= roll << 17;
		bytes[k] = i & 8 ? (uint8_t)roll : 0;
	}
	bytes[0] = (uint8_t)i;
	return 600;
}

/* Behind the raw first record: the number of points, then how many bytes each layer has. */
static void make_layers(uint8_t *bytes, size_t size)
{
	enum { LAYERS = 9 + (FUZZ_FORMAT == 7) + 2 * (FUZZ_FORMAT == 8 || FUZZ_FORMAT == 10) + (FUZZ_FORMAT >= 9) + FUZZ_EXTRA };
	size_t at = 0;

	for (unsigned k = 0; k < ITEMS; k++)
		at += items[k].size;
	if (FUZZ_FORMAT < 6 || size < at + 4 * (LAYERS + 1))
		return;
	memset(bytes + at, 0, 4);
	bytes[at] = CHUNK;
	for (unsigned k = 1; k <= LAYERS; k++) {
		bytes[at + 4 * k] &= 63;
		memset(bytes + at + 4 * k + 1, 0, 3);
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	static uint8_t records[RECORDS * 256];
	uint8_t *copy = malloc(size + 1);
	struct text text = {copy + 1, size - 1};
	const struct laz_source source = {&text, read_text};
	struct laz_chunk chunk = {0, size - 1, FUZZ_FORMAT > 5 ? CHUNK : 60};
	struct laz_reader *reader;
	struct laz_format format;
	struct err err = ERR_INIT;
	size_t n = 1;
	void *memory;
	int rc;

	if (!copy)
		abort();
	memcpy(copy, bytes, size);
	if (!size || !make_format(bytes[0], &format)) {
		free(copy);
		return 0;
	}
	if (!(bytes[0] & 128))
		make_layers(copy + 1, size - 1);
	if (!(bytes[0] & 16))
		chunk = laz_table_whole(&format,
					&(struct laz_place){.begin = 0, .end = size - 1, .points = 120, .size = size - 1});
	memory = aligned_alloc(64, (laz_reader_bytes(&format, LAZ_ALL) + 63) & ~(size_t)63);
	if (!memory)
		abort();
	rc = laz_reader_new(memory, &format, bytes[0] & 8 ? LAZ_TERRAIN : LAZ_ALL, &source, &reader, &err);
	if (!rc)
		rc = laz_reader_chunk(reader, &chunk, &err);
	while (!rc && n) {
		rc = laz_reader_read(reader, records, RECORDS, &n, &err);
		if (n > RECORDS)
			abort();
	}
	fuzz_input_check(rc, &err);
	free(memory);
	free(copy);
	return 0;
}
