/*
 * LAS as acut-synth writes it: 1.2 with point format 1, 1.4 with format 6 (and with format 1 beyond 2^32 - 1 points,
 * which 1.2 cannot count). Coordinates are raw numbers; the offset is the origin. The header has exact counts and
 * boxes, so the points are known before it is written (acut-synth.c).
 */
#include <assert.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cursor.h"
#include "err.h"
#include "point.h"
#include "synth.h"

enum { HEAD_12 = 227, HEAD_14 = 375, VLR_HEAD = 54, KEYS = 6, BUFFER = 1 << 20 };

static const char wkt[] = "COMPD_CS[\"WGS 84 / UTM zone 33N + ellipsoid height\",PROJCS[\"WGS 84 / UTM zone 33N\",GEOGCS[\"WGS "
			  "84\","
			  "DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563,AUTHORITY[\"EPSG\",\"7030\"]],"
			  "AUTHORITY[\"EPSG\",\"6326\"]],PRIMEM[\"Greenwich\",0,AUTHORITY[\"EPSG\",\"8901\"]],"
			  "UNIT[\"degree\",0.0174532925199433,AUTHORITY[\"EPSG\",\"9122\"]],AUTHORITY[\"EPSG\",\"4326\"]],"
			  "PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"latitude_of_origin\",0],PARAMETER[\"central_"
			  "meridian\",15],"
			  "PARAMETER[\"scale_factor\",0.9996],PARAMETER[\"false_easting\",500000],PARAMETER[\"false_northing\","
			  "0],"
			  "UNIT[\"metre\",1,AUTHORITY[\"EPSG\",\"9001\"]],AXIS[\"Easting\",EAST],AXIS[\"Northing\",NORTH],"
			  "AUTHORITY[\"EPSG\",\"32633\"]],VERT_CS[\"ellipsoid height\",VERT_DATUM[\"ellipsoid\",2002],"
			  "UNIT[\"metre\",1,AUTHORITY[\"EPSG\",\"9001\"]],AXIS[\"Up\",UP]]]";

static bool is_14(const struct synth_options *o)
{
	return o->format == 6 || o->points > UINT32_MAX;
}

static size_t vlr_size(const struct synth_options *o)
{
	if (o->no_crs)
		return 0;
	return VLR_HEAD + (o->format == 6 ? sizeof wkt : 8 * KEYS);
}

size_t synth_las_head_size(const struct synth_options *o)
{
	return (is_14(o) ? HEAD_14 : HEAD_12) + vlr_size(o);
}

static void put_text(struct packer *p, const char *text, size_t size)
{
	size_t n = strlen(text);

	packer_bytes(p, text, n);
	packer_zero(p, size - n);
}

static void put_vlr(struct packer *p, const struct synth_options *o)
{
	/* GeoTIFF keys: projected, EPSG:32633, metres; heights in metres. */
	static const uint16_t keys[KEYS][4] = {{1, 1, 0, KEYS - 1}, {1024, 0, 1, 1},    {1025, 0, 1, 1},
					       {3072, 0, 1, 32633}, {3076, 0, 1, 9001}, {4099, 0, 1, 9001}};

	packer_u16(p, 0);
	put_text(p, "LASF_Projection", 16);
	packer_u16(p, o->format == 6 ? 2112 : 34735);
	packer_u16(p, (uint16_t)(vlr_size(o) - VLR_HEAD));
	put_text(p, "WGS 84 / UTM zone 33N", 32);
	if (o->format == 6)
		packer_bytes(p, wkt, sizeof wkt);
	else
		packer_bytes(p, keys, sizeof keys);
}

static void put_counts(struct packer *p, const struct synth_las *las)
{
	bool legacy = las->options->format != 6 && las->count <= UINT32_MAX;

	packer_u32(p, legacy ? (uint32_t)las->count : 0);
	for (unsigned i = 0; i < 5; i++)
		packer_u32(p, legacy ? (uint32_t)las->by_return[i] : 0);
}

void synth_las_head(const struct synth_las *las, uint8_t *bytes)
{
	const struct synth_options *o = las->options;
	size_t size = synth_las_head_size(o);
	struct packer p = packer_of(bytes, size);
	double scale = decimal_double(o->scale);

	packer_bytes(&p, "LASF", 4);
	packer_u16(&p, 0);
	packer_u16(&p, o->format == 6 && !o->no_crs ? 17 : 1); /* WKT, adjusted standard GPS time */
	packer_zero(&p, 16);
	packer_u8(&p, 1);
	packer_u8(&p, is_14(o) ? 4 : 2);
	put_text(&p, "acut", 32);
	put_text(&p, "acut-synth " ACUT_VERSION, 32);
	packer_u16(&p, 1);
	packer_u16(&p, 2026);
	packer_u16(&p, is_14(o) ? HEAD_14 : HEAD_12);
	packer_u32(&p, (uint32_t)size);
	packer_u32(&p, o->no_crs ? 0 : 1);
	packer_u8(&p, (uint8_t)o->format);
	packer_u16(&p, (uint16_t)las->record);
	put_counts(&p, las);
	for (unsigned i = 0; i < 3; i++)
		packer_f64(&p, scale);
	for (unsigned i = 0; i < 3; i++)
		packer_f64(&p, decimal_double(o->origin[i]));
	for (unsigned i = 0; i < 3; i++) {
		packer_f64(&p, (las->count ? las->max[i] : 0) * scale + decimal_double(o->origin[i]));
		packer_f64(&p, (las->count ? las->min[i] : 0) * scale + decimal_double(o->origin[i]));
	}
	if (is_14(o)) {
		packer_zero(&p, 20); /* no waveforms, no extended records */
		packer_u64(&p, las->count);
		for (unsigned i = 0; i < 15; i++)
			packer_u64(&p, las->by_return[i]);
	}
	if (!o->no_crs)
		put_vlr(&p, o);
}

int synth_las_open(struct synth_las *las, const struct synth_options *o, int fd, const char *name, struct err *err)
{
	memset(las, 0, sizeof *las);
	las->options = o;
	las->fd = fd;
	las->name = name;
	las->cap = BUFFER;
	las->record = o->format == 6 ? 30 : 28;
	for (unsigned i = 0; i < 3; i++) {
		las->min[i] = INT32_MAX;
		las->max[i] = INT32_MIN;
	}
	las->buffer = malloc(las->cap);
	if (!las->buffer)
		return err_set(err, ERR_NOMEM, "no memory for a buffer");
	return 0;
}

int synth_write(int fd, const void *bytes, size_t n, const char *name, struct err *err)
{
	const uint8_t *b = bytes;

	while (n) {
		ssize_t put = write(fd, b, n);

		if (put < 0 && errno == EINTR)
			continue;
		if (put < 0) {
			err_sys(err, errno, "cannot write");
			return err_add_file(err, name);
		}
		b += put;
		n -= (size_t)put;
	}
	return 0;
}

int synth_las_flush(struct synth_las *las, struct err *err)
{
	size_t n = las->used;

	las->used = 0;
	return las->dry ? 0 : synth_write(las->fd, las->buffer, n, las->name, err);
}

/* Records as in LAS; the byte order of this machine is that of the file. */
struct place {
	int32_t x, y, z;
	uint16_t intensity;
} __attribute__((packed));

struct record_1 {
	struct place place;
	uint8_t returns, cls;
	int8_t angle;
	uint8_t user;
	uint16_t source;
	double time;
} __attribute__((packed));

struct record_6 {
	struct place place;
	uint8_t returns, flags, cls, user;
	int16_t angle;
	uint16_t source;
	double time;
} __attribute__((packed));

static_assert(sizeof(struct record_1) == 28 && sizeof(struct record_6) == 30, "records of LAS");
static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "LAS is little-endian");

static struct place place_of(const struct synth_point *q)
{
	return (struct place){q->x, q->y, q->z, q->intensity};
}

static void put_format_1(uint8_t *at, const struct synth_point *q)
{
	unsigned bits = (q->flags & POINT_SYNTHETIC ? 32u : 0) | (q->flags & POINT_KEY ? 64u : 0) |
			(q->flags & POINT_WITHHELD ? 128u : 0);
	const struct record_1 r = {
		.place = place_of(q),
		.returns = (uint8_t)(q->number | q->count << 3 | (q->forward ? 64 : 0) | (q->edge ? 128 : 0)),
		.cls = (uint8_t)(q->cls | bits),
		.angle = (int8_t)q->angle,
		.source = q->source,
		.time = q->time,
	};

	memcpy(at, &r, sizeof r);
}

static void put_format_6(uint8_t *at, const struct synth_point *q)
{
	unsigned bits = (q->flags & POINT_SYNTHETIC ? 1u : 0) | (q->flags & POINT_KEY ? 2u : 0) |
			(q->flags & POINT_WITHHELD ? 4u : 0) | (q->flags & POINT_OVERLAP ? 8u : 0);
	const struct record_6 r = {
		.place = place_of(q),
		.returns = (uint8_t)(q->number | q->count << 4),
		.flags = (uint8_t)(bits | (q->forward ? 64 : 0) | (q->edge ? 128 : 0)),
		.cls = q->cls,
		.angle = (int16_t)(q->angle / 0.006f),
		.source = q->source,
		.time = q->time,
	};

	memcpy(at, &r, sizeof r);
}

static void measure(struct synth_las *las, const struct synth_point *q)
{
	const int32_t v[3] = {q->x, q->y, q->z};

	for (unsigned i = 0; i < 3; i++) {
		las->min[i] = v[i] < las->min[i] ? v[i] : las->min[i];
		las->max[i] = v[i] > las->max[i] ? v[i] : las->max[i];
	}
	las->by_return[q->number - 1]++;
}

int synth_las_put(struct synth_las *las, const struct synth_point *q, unsigned n, struct err *err)
{
	int rc;

	for (unsigned i = 0; i < n; i++)
		measure(las, &q[i]);
	las->count += n;
	if (las->dry)
		return 0;
	if (las->cap - las->used < n * las->record && (rc = synth_las_flush(las, err)))
		return rc;
	for (unsigned i = 0; i < n; i++, las->used += las->record) {
		if (las->options->format == 6)
			put_format_6(las->buffer + las->used, &q[i]);
		else
			put_format_1(las->buffer + las->used, &q[i]);
	}
	return 0;
}
