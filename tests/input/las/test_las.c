/*
 * LAS files made here: every point format, the quirks of headers that do no harm, and the lies that do.
 */
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "fixture.h"
#include "input_las_parts.h"
#include "point.h"

static const struct input_options defaults, truncated = {.accept_truncated = true}, planar = {.planar = true};

#define GEOGRAPHIC "GEOGCS[\"WGS 84\",UNIT[\"degree\",0.0174532925199433],AUTHORITY[\"EPSG\",\"4326\"]]"
#define GEOCENTRIC "GEOCCS[\"here\",UNIT[\"metre\",1]]"
#define PROJECTED "PROJCS[\"utm\",UNIT[\"metre\",1],AUTHORITY[\"EPSG\",\"32632\"]]"

static int32_t i32(const uint8_t *b)
{
	return (int32_t)(b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24);
}

/* The record taken apart field by field, as the tables of the standard have it. */
static void assert_point(const struct input_points *pts, size_t i, unsigned format, const uint8_t *record)
{
	unsigned flags = 0, returns, cls;

	for (int k = 0; k < 3; k++)
		assert_int_equal(pts->raw[i][k], i32(record + 4 * k));
	if (format < 6) {
		returns = (record[14] & 7) | ((record[14] >> 3) & 7) << 4;
		cls = record[15] & 0x1f;
		flags |= record[15] & 0x20 ? POINT_SYNTHETIC : 0;
		flags |= record[15] & 0x40 ? POINT_KEY : 0;
		flags |= record[15] & 0x80 ? POINT_WITHHELD : 0;
		flags |= cls == 12 ? POINT_OVERLAP : 0; /* the class of that name before there was a flag */
	} else {
		returns = (record[14] & 15) | (record[14] >> 4) << 4;
		cls = record[16];
		flags |= record[15] & 1 ? POINT_SYNTHETIC : 0;
		flags |= record[15] & 2 ? POINT_KEY : 0;
		flags |= record[15] & 4 ? POINT_WITHHELD : 0;
		flags |= record[15] & 8 ? POINT_OVERLAP : 0;
	}
	assert_int_equal(pts->ret[i], returns);
	assert_int_equal(pts->cls[i], cls);
	assert_int_equal(pts->flags[i], flags);
}

static void check_all_points(const struct las_spec *s, size_t batch)
{
	struct bytes b = fixture_las(s);
	int fd = fixture_fd(b.at, b.size);
	struct err err = ERR_INIT;
	struct input_points pts;
	struct input *in;
	uint8_t record[400];
	uint64_t n = 0;

	assert_int_equal(input_open(fd, "a.las", &defaults, &in, &err), 0);
	assert_int_equal(input_info(in)->claimed, s->n);
	fixture_points_new(&pts, batch);
	for (;;) {
		assert_int_equal(input_read(in, &pts, &err), 0);
		if (!pts.n)
			break;
		assert_true(pts.n <= batch);
		for (size_t i = 0; i < pts.n; i++, n++) {
			fixture_record(s->format, fixture_length(s->format) + s->extra, n, record);
			assert_point(&pts, i, s->format, record);
		}
	}
	assert_int_equal(n, s->n);
	assert_int_equal(input_read(in, &pts, &err), 0); /* the end stays the end */
	assert_int_equal(pts.n, 0);
	fixture_points_free(&pts);
	input_close(in);
	close(fd);
	free(b.at);
}

static void every_format(void **state)
{
	for (unsigned format = 0; format <= 10; format++) {
		for (unsigned minor = format < 4 ? 0 : format < 6 ? 3 : 4; minor <= 5; minor++) {
			struct las_spec s = {.minor = minor, .format = format, .n = 300};

			check_all_points(&s, 300);
			s.extra = 7;
			check_all_points(&s, 64);
		}
	}
}

/* More than one buffer, batches that do not divide it. */
static void many_points(void **state)
{
	for (unsigned format = 0; format <= 10; format++) {
		struct las_spec s = {.minor = 4, .format = format, .n = 33333, .extra = format % 3};

		check_all_points(&s, 4097);
	}
}

static void coordinates(void **state)
{
	struct las_spec s = {.minor = 2, .n = 5};
	struct bytes b = fixture_las(&s);
	struct outcome out = fixture_read(b.at, b.size, "a.las", &defaults, 10);
	const struct lattice_input *c = &out.info.coords;

	assert_int_equal(out.code, 0);
	assert_string_equal(out.info.format, "las");
	assert_string_equal(out.info.variant, "LAS 1.2, point format 0, 20 bytes");
	assert_true(c->has_offset);
	assert_int_equal(c->scale[0].mantissa, 1);
	assert_int_equal(c->scale[0].exponent, -2);
	assert_int_equal(c->scale[2].exponent, -3);
	assert_int_equal(c->offset[0].mantissa, 5);
	assert_int_equal(c->offset[0].exponent, 5);
	assert_true(c->min[0] == -1000 && c->max[2] == 1000);
	assert_int_equal(out.info.crs.plane, CRS_PLANE_UNKNOWN);
	assert_string_equal(out.info.crs.text, "unknown");
	assert_string_equal(out.info.crs.unit_xy, "unknown");
	assert_string_equal(out.info.warning, "");
	free(b.at);
}

static void harmless_quirks(void **state)
{
	const struct las_spec specs[] = {
		{.minor = 2, .n = 50, .header_extra = 2},
		{.minor = 4, .format = 6, .n = 50, .header_extra = 18, .gap = 1000},
		{.minor = 0, .n = 50, .gap = 2},
		{.minor = 2, .n = 50, .vlrs_more = 1},
		{.minor = 2, .n = 50, .vlrs_more = UINT32_MAX},
		{.minor = 2, .format = 6, .n = 50}, /* a format that is newer than the file */
		{.minor = 3, .n = 0},
		{.minor = 2, .n = 50, .extra = 300},
	};

	for (size_t i = 0; i < sizeof specs / sizeof *specs; i++)
		check_all_points(&specs[i], 16);
}

static void coordinate_systems(void **state)
{
	struct las_spec s = {.minor = 4, .format = 6, .n = 9, .encoding = 16};
	struct outcome out;
	struct bytes b;

	for (int behind = 0; behind < 2; behind++) {
		s.wkt_behind = behind;
		s.wkt = PROJECTED;
		b = fixture_las(&s);
		out = fixture_read(b.at, b.size, "a.las", &defaults, 10);
		assert_int_equal(out.code, 0);
		assert_int_equal(out.info.crs.plane, CRS_PLANE_PROJECTED);
		assert_string_equal(out.info.crs.text, "EPSG:32632");
		assert_string_equal(out.info.crs.unit_xy, "metre");
		assert_string_equal(out.info.crs.unit_z, "unknown");
		free(b.at);

		s.wkt = GEOGRAPHIC;
		b = fixture_las(&s);
		out = fixture_read(b.at, b.size, "a.las", &defaults, 10);
		assert_int_equal(out.code, ERR_UNSUPPORTED);
		assert_non_null(strstr(out.err.message, "degrees"));
		assert_non_null(strstr(out.err.hint, "--planar"));
		out = fixture_read(b.at, b.size, "a.las", &planar, 10);
		assert_int_equal(out.code, 0);
		assert_int_equal(out.points, 9);
		assert_string_equal(out.info.crs.unit_xy, "degree");
		free(b.at);

		s.wkt = GEOCENTRIC;
		b = fixture_las(&s);
		out = fixture_read(b.at, b.size, "a.las", &defaults, 10);
		assert_int_equal(out.code, ERR_UNSUPPORTED);
		assert_non_null(strstr(out.err.message, "geocentric"));
		free(b.at);
	}
}

/* It outlives the reading of points, which needs the buffer; none of what cannot be read. */
static void wkt_kept(void **state)
{
	struct las_spec s = {.minor = 4, .format = 6, .n = 9, .encoding = 16};
	const char *const wkts[] = {PROJECTED, "PROJCS[\"no end\"", NULL};
	struct input_points pts;
	struct err err = ERR_INIT;

	fixture_points_new(&pts, 16);
	for (int k = 0; k < 6; k++) {
		struct input *in;
		struct bytes b;
		int fd;

		s.wkt = wkts[k % 3];
		s.wkt_behind = s.wkt && k / 3;
		b = fixture_las(&s);
		fd = fixture_fd(b.at, b.size);
		assert_int_equal(input_open(fd, "a.las", &defaults, &in, &err), 0);
		assert_int_equal(input_read(in, &pts, &err), 0);
		assert_string_equal(input_wkt(in), k % 3 ? "" : PROJECTED);
		input_close(in);
		close(fd);
		free(b.at);
	}
	fixture_points_free(&pts);
}

/* Writes a record of WKT at `at`; returns the byte behind it. */
static size_t put_record(struct bytes b, size_t at, const char *user, uint16_t size, const char *wkt)
{
	memset(b.at + at, 0, 54);
	memcpy(b.at + at + 2, user, strlen(user));
	b.at[at + 18] = 2112 & 255;
	b.at[at + 19] = 2112 >> 8;
	b.at[at + 20] = (uint8_t)size;
	b.at[at + 21] = (uint8_t)(size >> 8);
	memcpy(b.at + at + 54, wkt, strlen(wkt));
	return at + 54 + strlen(wkt);
}

/* The standard's own record goes before libLAS' and others', the first before the second. */
static void several_records(void **state)
{
	struct las_spec s = {.minor = 2, .n = 9, .gap = 2000, .vlrs_more = 4};
	struct bytes b = fixture_las(&s);
	size_t at = 227;
	struct outcome out;

	at = put_record(b, at, "liblas", sizeof GEOCENTRIC - 1, GEOCENTRIC);
	at = put_record(b, at, "somebody", sizeof GEOGRAPHIC - 1, GEOGRAPHIC);
	at = put_record(b, at, "LASF_Projection", sizeof PROJECTED - 1, PROJECTED);
	put_record(b, at, "LASF_Projection", sizeof GEOGRAPHIC - 1, GEOGRAPHIC);
	out = fixture_read(b.at, b.size, "a.las", &defaults, 10);
	assert_int_equal(out.code, 0);
	assert_string_equal(out.info.crs.text, "EPSG:32632");
	assert_string_equal(out.info.warning, "");
	free(b.at);
}

/* A record that does not fit before the points, or behind them, or is too large for any text: not read. */
static void records_that_lie_of_their_size(void **state)
{
	struct las_spec s = {.minor = 2, .n = 9, .gap = 500, .vlrs_more = 1};
	struct bytes b = fixture_las(&s);
	size_t size = 70000;
	char *wkt = malloc(size + 1);
	struct outcome out;

	put_record(b, 227, "LASF_Projection", 447, PROJECTED);
	out = fixture_read(b.at, b.size, "a.las", &defaults, 10);
	assert_int_equal(out.code, 0);
	assert_string_equal(out.info.crs.text, "unknown");
	assert_non_null(strstr(out.info.warning, "1 variable length records claimed, 0 read"));
	put_record(b, 227, "LASF_Projection", 446, PROJECTED);
	out = fixture_read(b.at, b.size, "a.las", &defaults, 10);
	assert_string_equal(out.info.crs.text, "EPSG:32632");
	free(b.at);

	memset(wkt, ' ', size);
	memcpy(wkt, PROJECTED, sizeof PROJECTED - 1);
	wkt[size] = 0;
	for (int lie = 0; lie < 3; lie++) {
		s = (struct las_spec){.minor = 4, .format = 6, .n = 9, .wkt_behind = true};
		s.wkt = lie < 2 ? wkt : PROJECTED;
		wkt[lie ? 65536 : size] = 0;
		b = fixture_las(&s);
		if (lie == 2)
			memset(b.at + 375 + 9 * 30 + 20, 0xff, 8); /* 2^64 - 1 bytes */
		out = fixture_read(b.at, b.size, "a.las", &defaults, 10);
		assert_int_equal(out.code, 0);
		assert_int_equal(out.points, 9);
		assert_string_equal(out.info.crs.text, lie == 1 ? "EPSG:32632" : "unknown");
		assert_true(lie == 1 || strstr(out.info.warning, lie ? "claimed, 0 read" : "70000 bytes was not read"));
		free(b.at);
	}
	free(wkt);
}

struct lie {
	unsigned minor, format;
	size_t at;
	unsigned char bytes[8];
	size_t n;
	enum err_code code;
	uint64_t offset;
	const char *field;
};

static const struct lie lies[] = {
	{2, 0, 0, "LASX", 4, ERR_INPUT, 0, "file signature"},
	{2, 0, 24, "\x02", 1, ERR_INPUT, 24, "version"},
	{2, 0, 25, "\x06", 1, ERR_UNSUPPORTED, 24, "version"},
	{2, 0, 25, "\x09", 1, ERR_UNSUPPORTED, 24, "version"},
	{2, 0, 94, "\x0a\0", 2, ERR_INPUT, 94, "header size"},
	{2, 0, 94, "\xe2\0", 2, ERR_INPUT, 94, "header size"},
	{4, 6, 94, "\xe2\0", 2, ERR_INPUT, 94, "header size"},
	{2, 0, 94, "\xff\xff", 2, ERR_INPUT, 96, "point offset"},
	{2, 0, 96, "\x0a\0\0\0", 4, ERR_INPUT, 96, "point offset"},
	{2, 0, 96, "\xff\xff\xff\x7f", 4, ERR_INPUT, 96, "point offset"},
	{2, 0, 104, "\x0b", 1, ERR_INPUT, 104, "point format"},
	{2, 0, 104, "\x40", 1, ERR_INPUT, 104, "point format"},
	{2, 0, 104, "\x80", 1, ERR_INPUT, 104, "point format"},
	{4, 6, 104, "\x86", 1, ERR_INPUT, 104, "point format"},
	{2, 0, 105, "\0\0", 2, ERR_INPUT, 105, "record length"},
	{2, 0, 105, "\x13\0", 2, ERR_INPUT, 105, "record length"},
	{2, 0, 105, "\x15\0", 2, ERR_TRUNCATED, 227 + 47 * 21, "points"},
	{2, 0, 107, "\x33\0\0\0", 4, ERR_TRUNCATED, 227 + 50 * 20, "points"},
	{2, 0, 107, "\xff\xff\xff\xff", 4, ERR_TRUNCATED, 227 + 50 * 20, "points"},
	{4, 6, 247, "\0\0\0\0\0\0\0\x80", 8, ERR_TRUNCATED, 375 + 50 * 30, "points"},
	{4, 6, 247, "\xff\xff\xff\xff\xff\xff\xff\xff", 8, ERR_TRUNCATED, 375 + 50 * 30, "points"},
	{2, 0, 131, "\0\0\0\0\0\0\0\0", 8, ERR_INPUT, 131, "x scale"},
	{2, 0, 139, "\0\0\0\0\0\0\xf8\x7f", 8, ERR_INPUT, 139, "y scale"},
	{2, 0, 147, "\0\0\0\0\0\0\xf0\x7f", 8, ERR_INPUT, 147, "z scale"},
	{2, 0, 138, "\xbf", 1, ERR_INPUT, 131, "x scale"},
	{2, 0, 131, "\x9c\x75\0\x88\x3c\xe4\x37\x7e", 8, ERR_INPUT, 131, "x scale"}, /* 1e300 */
	{2, 0, 155, "\0\0\0\0\0\0\xf0\x7f", 8, ERR_INPUT, 155, "x offset"},
	{2, 0, 171, "\0\0\0\0\0\0\xf8\xff", 8, ERR_INPUT, 171, "z offset"},
};

static void lies_that_matter(void **state)
{
	for (size_t i = 0; i < sizeof lies / sizeof *lies; i++) {
		const struct lie *lie = &lies[i];
		struct las_spec s = {.minor = lie->minor, .format = lie->format, .n = 50};
		struct bytes b = fixture_las(&s);
		struct outcome out;

		memcpy(b.at + lie->at, lie->bytes, lie->n);
		out = fixture_read(b.at, b.size, "lie.las", &defaults, 100);
		assert_int_equal(out.code, lie->code);
		assert_int_equal(out.err.code, lie->code);
		assert_int_equal(out.err.offset, lie->offset);
		assert_string_equal(out.err.field, lie->field);
		assert_string_equal(out.err.file, "lie.las");
		assert_true(out.err.message[0]);
		free(b.at);
	}
}

static void lies_that_do_not_matter(void **state)
{
	static const struct {
		unsigned minor, format;
		size_t at;
		unsigned char bytes[9];
		size_t n;
		const char *warning;
	} harmless[] = {
		{2, 0, 179, "\0\0\0\0\0\0\xf8\x7f", 8, "box"}, /* max x NaN */
		{2, 0, 187, "\0\0\0\0\0\0\xf0\x7f", 8, "box"}, /* min x infinite */
		{2, 0, 100, "\xff\xff\xff\xff", 4, "variable length records claimed"},
		{4, 6, 243, "\x03\0\0\0", 4, "extended variable length records claimed"},
		{4, 6, 107, "\x07\0\0\0", 4, "two point counts"},
		{2, 0, 25, "\x03", 1, "the header has 227 bytes, that of LAS 1.3 has 235"},
		{2, 0, 25, "\x04", 1, "the header has 227 bytes, that of LAS 1.4 has 375"},
		{2, 0, 25, "\x05", 1, "the header has 227 bytes, that of LAS 1.5 has 393"},
	};

	for (size_t i = 0; i < sizeof harmless / sizeof *harmless; i++) {
		struct las_spec s = {.minor = harmless[i].minor, .format = harmless[i].format, .n = 50};
		struct bytes b = fixture_las(&s);
		struct outcome out;

		memcpy(b.at + harmless[i].at, harmless[i].bytes, harmless[i].n);
		if (harmless[i].at == 243)
			b.at[240] = 1; /* 2^40, past the end */
		out = fixture_read(b.at, b.size, "a.las", &defaults, 100);
		assert_int_equal(out.code, 0);
		assert_int_equal(out.points, 50);
		assert_non_null(strstr(out.info.warning, harmless[i].warning));
		free(b.at);
	}
}

static void truncation_accepted(void **state)
{
	struct las_spec s = {.minor = 2, .format = 1, .n = 50};
	struct bytes b = fixture_las(&s);
	struct outcome out = fixture_read(b.at, b.size - 1, "a.las", &defaults, 100);

	assert_int_equal(out.code, ERR_TRUNCATED);
	assert_int_equal(out.err.offset, 227 + 49 * 28);
	assert_non_null(strstr(out.err.message, "49 whole points"));
	assert_non_null(strstr(out.err.message, "says 50"));
	assert_non_null(strstr(out.err.hint, "--accept-truncated"));
	out = fixture_read(b.at, b.size - 1, "a.las", &truncated, 100);
	assert_int_equal(out.code, 0);
	assert_int_equal(out.points, 49);
	assert_int_equal(out.info.claimed, 50);
	assert_non_null(strstr(out.info.warning, "49 of 50"));
	free(b.at);
}

/* What follows the points is not points, even where a wrong count says so. */
static void points_end_at_the_records_behind(void **state)
{
	struct las_spec s = {.minor = 4, .format = 6, .n = 50, .wkt = PROJECTED, .wkt_behind = true};
	struct bytes b = fixture_las(&s);
	struct outcome out;

	b.at[247] = 51;
	out = fixture_read(b.at, b.size, "a.las", &defaults, 100);
	assert_int_equal(out.code, ERR_TRUNCATED);
	assert_int_equal(out.err.offset, 375 + 50 * 30);
	out = fixture_read(b.at, b.size, "a.las", &truncated, 100);
	assert_int_equal(out.points, 50);
	free(b.at);
}

static void legacy_count_alone(void **state)
{
	struct las_spec s = {.minor = 4, .format = 1, .n = 50};
	struct bytes b = fixture_las(&s);
	struct outcome out;

	b.at[247] = 0;
	out = fixture_read(b.at, b.size, "a.las", &defaults, 100);
	assert_int_equal(out.code, 0);
	assert_int_equal(out.points, 50);
	free(b.at);
}

static void changes_while_read(void **state)
{
	struct las_spec s = {.minor = 2, .n = 50000};
	struct bytes b = fixture_las(&s);

	for (int how = 0; how < 3; how++) {
		int fd = fixture_fd(b.at, b.size);
		struct err err = ERR_INIT;
		struct input_points pts;
		struct input *in;
		int rc;

		fixture_points_new(&pts, 1000);
		assert_int_equal(input_open(fd, "a.las", &defaults, &in, &err), 0);
		assert_int_equal(input_read(in, &pts, &err), 0);
		if (how == 0)
			assert_int_equal(ftruncate(fd, 300000), 0);
		else if (how == 1)
			assert_int_equal(ftruncate(fd, (off_t)b.size + 1), 0);
		else
			assert_int_equal(futimens(fd, (struct timespec[]){{.tv_sec = 1}, {.tv_sec = 1}}), 0);
		do
			rc = input_read(in, &pts, &err);
		while (!rc && pts.n);
		assert_int_equal(rc, -ERR_CHANGED);
		assert_string_equal(err.file, "a.las");
		fixture_points_free(&pts);
		input_close(in);
		close(fd);
	}
	free(b.at);
}

/* Each part by a reader of its own, the last one first: the points of the whole, each once. */
static void parts(void **state)
{
	struct las_spec s = {.minor = 4, .format = 6, .n = 2 * INPUT_LAS_PART + 77};
	struct bytes b = fixture_las(&s);
	int fd = fixture_fd(b.at, b.size);
	struct err err = ERR_INIT;
	struct input_points pts;
	struct input *whole;

	assert_int_equal(input_open(fd, "a.las", &defaults, &whole, &err), 0);
	assert_int_equal(input_info(whole)->parts, 3);
	fixture_points_new(&pts, 5000);
	for (uint64_t last = 3; last > 0; last -= last == 3 ? 2 : 1) {
		uint64_t first = last == 3 ? 1 : 0, i = first * INPUT_LAS_PART;
		uint8_t record[64];
		struct input *part;

		assert_int_equal(input_open_part(whole, first, last, &part, &err), 0);
		do {
			assert_int_equal(input_read(part, &pts, &err), 0);
			for (size_t k = 0; k < pts.n; k++, i++) {
				fixture_record(6, fixture_length(6), i, record);
				assert_point(&pts, k, 6, record);
			}
		} while (pts.n);
		assert_int_equal(i, last == 3 ? s.n : INPUT_LAS_PART);
		input_close(part);
	}
	fixture_points_free(&pts);
	input_close(whole);
	close(fd);
	free(b.at);
}

/* What was shown of a file's bytes. */
struct shown {
	uint64_t at, n;
	const uint8_t *file;
};

static void show(void *ctx, uint64_t at, const void *bytes, size_t n)
{
	struct shown *s = ctx;

	assert_int_equal(at, s->at);
	assert_memory_equal(bytes, s->file + at, n);
	s->at += n;
	s->n += n;
}

static uint64_t read_through(struct input *in)
{
	struct input_points pts;
	struct err err = ERR_INIT;
	uint64_t n = 0;

	fixture_points_new(&pts, 5000);
	do {
		assert_int_equal(input_read(in, &pts, &err), 0);
		n += pts.n;
	} while (pts.n);
	fixture_points_free(&pts);
	return n;
}

/* The whole: each byte of the points once, upwards. Parts, which are read at once and in any order: nothing. */
static void shows_what_it_reads(void **state)
{
	struct las_spec s = {.minor = 2, .format = 1, .n = INPUT_LAS_PART + 77};
	struct bytes b = fixture_las(&s);
	int fd = fixture_fd(b.at, b.size);
	struct shown shown = {.at = b.size - s.n * fixture_length(1), .file = b.at};
	struct input_options options = {.seen = show, .seen_ctx = &shown};
	struct err err = ERR_INIT;
	struct input *whole, *part;

	assert_int_equal(input_open(fd, "a.las", &options, &whole, &err), 0);
	assert_int_equal(input_info(whole)->parts, 2);
	assert_int_equal(input_open_part(whole, 1, 2, &part, &err), 0);
	assert_int_equal(read_through(part), 77);
	input_close(part);
	assert_int_equal(input_open_part(whole, 0, 1, &part, &err), 0);
	assert_int_equal(read_through(part), INPUT_LAS_PART);
	input_close(part);
	assert_int_equal(shown.n, 0);
	assert_int_equal(read_through(whole), s.n);
	assert_int_equal(shown.n, s.n * fixture_length(1));
	input_close(whole);
	close(fd);
	free(b.at);
}

/* What fills the pipe never stops: the reader comes back now and then, so that it can be told to. */
static void endless_pipe(void **state)
{
	struct las_spec s = {.minor = 2, .format = 1, .n = 100};
	struct bytes b = fixture_las(&s);
	int fd = fixture_fd(b.at, b.size), zero = open("/dev/zero", O_RDONLY | O_CLOEXEC);
	struct input_options options = {.has_pipe = true, .pipe = zero};
	struct err err = ERR_INIT;
	struct input_points pts;
	struct input *in;

	assert_true(zero >= 0);
	alarm(300); /* or for ever */
	assert_int_equal(input_open(fd, "a.las", &options, &in, &err), 0);
	fixture_points_new(&pts, 1000);
	assert_int_equal(input_read(in, &pts, &err), 0);
	assert_int_equal(pts.n, 100);
	for (int i = 0; i < 3; i++) {
		assert_int_equal(input_read(in, &pts, &err), 0);
		assert_int_equal(pts.n, 0);
		assert_true(input_dry(in));
	}
	alarm(0);
	fixture_points_free(&pts);
	input_close(in);
	close(zero);
	close(fd);
	free(b.at);
}

static void only_regular_files(void **state)
{
	int fds[2];

	assert_int_equal(pipe(fds), 0);
	assert_int_equal(fixture_read_fd(fds[0], "pipe", &defaults, 9).code, ERR_INPUT);
	close(fds[0]);
	close(fds[1]);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_format),
		cmocka_unit_test(many_points),
		cmocka_unit_test(coordinates),
		cmocka_unit_test(harmless_quirks),
		cmocka_unit_test(coordinate_systems),
		cmocka_unit_test(wkt_kept),
		cmocka_unit_test(several_records),
		cmocka_unit_test(records_that_lie_of_their_size),
		cmocka_unit_test(lies_that_matter),
		cmocka_unit_test(lies_that_do_not_matter),
		cmocka_unit_test(truncation_accepted),
		cmocka_unit_test(points_end_at_the_records_behind),
		cmocka_unit_test(legacy_count_alone),
		cmocka_unit_test(changes_while_read),
		cmocka_unit_test(parts),
		cmocka_unit_test(shows_what_it_reads),
		cmocka_unit_test(endless_pipe),
		cmocka_unit_test(only_regular_files),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
