/*
 * Layered points (compressor 3) beside what the real files have: version 2 of the items, the memory that many
 * extra bytes take, the bound on them.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "cursor.h"
#include "fixture.h"
#include "laz.h"

/* The record of point format 6 with so many extra bytes. */
static int parse(unsigned extra, unsigned version, struct laz_format *ret, struct err *err)
{
	uint8_t vlr[64];
	struct packer p = packer_of(vlr, sizeof vlr);

	packer_u16(&p, LAZ_COMPRESSOR_LAYERED);
	packer_zero(&p, 10);
	packer_u32(&p, 50000);
	packer_zero(&p, 16);
	packer_u16(&p, extra ? 2 : 1);
	packer_u16(&p, LAZ_POINT14);
	packer_u16(&p, 30);
	packer_u16(&p, (uint16_t)version);
	if (extra) {
		packer_u16(&p, LAZ_BYTE14);
		packer_u16(&p, (uint16_t)extra);
		packer_u16(&p, (uint16_t)version);
	}
	return laz_format_parse(vlr, packer_size(&p), 6, 30 + extra, ret, err);
}

static void memory_follows_from_the_items(void **state)
{
	struct laz_format none, many;
	struct err err = ERR_INIT;
	size_t terrain;

	assert_int_equal(parse(0, 3, &none, &err), 0);
	assert_int_equal(parse(1024, 3, &many, &err), 0);
	terrain = laz_reader_bytes(&none, LAZ_TERRAIN);
	assert_true(terrain < 2 << 20);
	/* what is not decoded takes the room of one record */
	assert_true(laz_reader_bytes(&many, LAZ_TERRAIN) <= terrain + 1024 + 64);
	assert_true(laz_reader_bytes(&none, LAZ_ALL) < 3 << 20);
	assert_true(laz_reader_bytes(&many, LAZ_ALL) < 16 << 20);
}

static void too_many_extra_bytes(void **state)
{
	struct laz_format f;
	struct err err = ERR_INIT;

	struct laz_source source = {0};
	struct laz_reader *reader;
	void *memory;

	/* they are stepped over, or else refused */
	assert_int_equal(parse(60000, 3, &f, &err), 0);
	assert_true(laz_reader_bytes(&f, LAZ_TERRAIN) < 2 << 20);
	memory = aligned_alloc(64, (laz_reader_bytes(&f, LAZ_TERRAIN) + 63) & ~(size_t)63);
	assert_int_equal(laz_reader_new(memory, &f, LAZ_TERRAIN, &source, &reader, &err), 0);
	assert_int_equal(laz_reader_new(memory, &f, LAZ_ALL, &source, &reader, &err), -ERR_UNSUPPORTED);
	assert_string_equal(err.field, "item size");
	free(memory);
}

static void versions(void **state)
{
	static const unsigned good[] = {2, 3, 4}, bad[] = {0, 1, 5, 65535};
	struct laz_format f;

	for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
		struct err err = ERR_INIT;

		assert_int_equal(parse(3, good[i], &f, &err), 0);
		assert_int_equal(f.item[0].version, good[i]);
	}
	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
		struct err err = ERR_INIT;

		assert_int_equal(parse(3, bad[i], &f, &err), -ERR_UNSUPPORTED);
	}
}

struct memory_file {
	const uint8_t *at;
	size_t size;
};

static int read_memory(void *ctx, uint64_t at, void *buf, size_t n, size_t *ret_n, struct err *err)
{
	const struct memory_file *f = ctx;
	size_t left = at < f->size ? f->size - (size_t)at : 0;

	(void)err;
	*ret_n = n < left ? n : left;
	memcpy(buf, f->at + (at < f->size ? at : 0), *ret_n);
	return 0;
}

/* No encoder writes four bytes of 255 first: the value is not below the length, and would leave it ever further
 * behind, out of the models. Refused before a symbol is decoded. */
static void stream_of_ones(void **state)
{
	enum { HEAD = 30 + 4 + 9 * 4, LAYER = 64 };
	struct laz_format f;
	struct err err = ERR_INIT;
	uint8_t chunk[HEAD + 2 * LAYER], *records = malloc(2000 * 30);
	struct memory_file file = {chunk, sizeof chunk};
	struct laz_source source = {&file, read_memory};
	struct laz_chunk place = {.at = 0, .bytes = sizeof chunk, .points = 2000};
	struct packer p = packer_of(chunk, sizeof chunk);
	struct laz_reader *reader;
	size_t n, bytes;
	void *memory;

	memset(chunk, 0xff, sizeof chunk);
	packer_zero(&p, 30);
	packer_u32(&p, 2000);
	packer_u32(&p, LAYER);
	packer_u32(&p, LAYER);
	packer_zero(&p, 7 * 4);
	assert_int_equal(parse(0, 3, &f, &err), 0);
	bytes = (laz_reader_bytes(&f, LAZ_ALL) + 63) & ~(size_t)63;
	memory = aligned_alloc(64, bytes);
	assert_int_equal(laz_reader_new(memory, &f, LAZ_ALL, &source, &reader, &err), 0);
	assert_int_equal(laz_reader_chunk(reader, &place, &err), 0);
	assert_int_equal(laz_reader_read(reader, records, 2000, &n, &err), -ERR_INPUT);
	assert_int_equal(err.offset, HEAD + 4);
	assert_string_equal(err.field, "x and y");
	free(memory);
	free(records);
}

/* The real file of version 3, told to be of version 2. */
static void version_2_is_3(void **state)
{
	static const struct input_options options = {.planar = true};
	const char *folder = fixture_data();
	struct input_info info[2];
	struct input_points pts[2];
	struct bytes b = {0};
	struct stat st;
	char path[4400];
	uint8_t *vlr;
	int fd;

	snprintf(path, sizeof path, "%s/lidar/las14_pdrf6.laz", folder);
	fd = *folder ? open(path, O_RDONLY | O_CLOEXEC) : -1;
	if (fd < 0)
		skip();
	assert_int_equal(fstat(fd, &st), 0);
	b = (struct bytes){malloc((size_t)st.st_size), (size_t)st.st_size};
	assert_int_equal(pread(fd, b.at, b.size, 0), b.size);
	close(fd);
	vlr = memmem(b.at, 2000, "laszip encoded", 14);
	assert_non_null(vlr);
	for (int version = 3; version >= 2; version--) {
		struct err err = ERR_INIT;
		struct input *in;

		vlr[52 + 34 + 4] = vlr[52 + 40 + 4] = (uint8_t)version;
		fd = fixture_fd(b.at, b.size);
		assert_int_equal(input_open(fd, "a.laz", &options, &in, &err), 0);
		info[version - 2] = *input_info(in);
		fixture_points_new(&pts[version - 2], 1024);
		assert_int_equal(input_read(in, &pts[version - 2], &err), 0);
		input_close(in);
		close(fd);
	}
	assert_int_equal(info[0].claimed, info[1].claimed);
	assert_true(pts[0].n == pts[1].n && pts[0].n > 0);
	assert_memory_equal(pts[0].raw, pts[1].raw, pts[0].n * sizeof *pts[0].raw);
	assert_memory_equal(pts[0].cls, pts[1].cls, pts[0].n);
	fixture_points_free(&pts[0]);
	fixture_points_free(&pts[1]);
	free(b.at);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(memory_follows_from_the_items),
		cmocka_unit_test(too_many_extra_bytes),
		cmocka_unit_test(versions),
		cmocka_unit_test(stream_of_ones),
		cmocka_unit_test(version_2_is_3),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
