/*
 * Files in LASzip's compatibility mode, made from records of formats 6 to 10 as its library does: an older record, and behind
 * its extra bytes what that has no room for.
 */
#include "fixture.h"

#include <stdlib.h>
#include <string.h>

#include "cursor.h"

enum { COMPATIBLE = 156, ATTRIBUTE = 192, VLR_HEAD = 54 };

struct target {
	unsigned minor, format, extra, length; /* extra: that the original record has */
	bool nir, rgb, wave;
};

static struct target target_of(const struct las_spec *s)
{
	static const unsigned format[] = {1, 3, 3, 4, 5};
	struct target t = {.minor = s->format < 9 ? 2 : 3, .format = format[s->format - 6], .extra = s->extra};

	t.nir = s->format == 8 || s->format == 10;
	t.rgb = s->format == 7 || t.nir;
	t.wave = s->format >= 9;
	t.length = fixture_length(t.format) + s->extra + 5 + (t.nir ? 2 : 0);
	return t;
}

/* The older return number: where it does not fit, its place before the last is kept as far as that goes. */
static unsigned older_return(unsigned number, unsigned of)
{
	if (of <= 7)
		return number <= 7 ? number : 7;
	if (number <= 4)
		return number;
	return number >= of ? 7 : of - number >= 3 ? 4 : 7 - (of - number);
}

static void put_record(struct packer *p, const struct las_spec *s, const struct target *t, uint64_t i)
{
	uint8_t in[400], *extra = in + fixture_length(s->format);
	unsigned number, of, older, older_of;

	fixture_record(s->format, fixture_length(s->format) + s->extra, i, in);
	number = in[14] & 15;
	of = in[14] >> 4;
	older = older_return(number, of);
	older_of = of <= 7 ? of : 7;
	packer_bytes(p, in, 14);
	packer_u8(p, (uint8_t)(older | older_of << 3 | (in[15] & 0xc0)));
	packer_u8(p, (uint8_t)((in[16] > 31 ? 0 : in[16]) | (in[15] & 7) << 5));
	packer_u8(p, in[19]); /* some angle */
	packer_u8(p, in[17]);
	packer_bytes(p, in + 20, 10);
	if (t->rgb)
		packer_bytes(p, in + 30, 6);
	if (t->wave)
		packer_bytes(p, in + (t->rgb ? 38 : 30), 29);
	packer_bytes(p, extra, t->extra);
	packer_u16(p, 0); /* rest of the angle */
	packer_u8(p, (uint8_t)((number - older) << 4 | (of - older_of)));
	packer_u8(p, in[16] > 31 ? in[16] : 0);
	packer_u8(p, (uint8_t)((in[15] >> 4 & 3) << 1 | (in[15] >> 3 & 1)));
	if (t->nir)
		packer_bytes(p, in + 36, 2);
}

static void put_head(struct packer *p, const char *user, unsigned id, unsigned size)
{
	char name[16] = "";

	memcpy(name, user, strlen(user));
	packer_u16(p, 0);
	packer_bytes(p, name, 16);
	packer_u16(p, (uint16_t)id);
	packer_u16(p, (uint16_t)size);
	packer_zero(p, 32);
}

static void put_attribute(struct packer *p, unsigned type, unsigned options, const char *name)
{
	packer_u16(p, 0);
	packer_u8(p, (uint8_t)type);
	packer_u8(p, (uint8_t)options);
	packer_bytes(p, name, strlen(name));
	packer_zero(p, ATTRIBUTE - 4 - strlen(name));
}

static unsigned attributes(const struct target *t)
{
	return (t->extra > 0) + 4u + t->nir;
}

static void put_compatible(struct packer *p, const struct las_spec *s, const struct target *t)
{
	put_head(p, "lascompatible", 22204, COMPATIBLE);
	packer_u16(p, 1);
	packer_u16(p, 3);
	packer_zero(p, 4 + 8 + 8 + 4);
	packer_u64(p, s->n);
	for (uint64_t r = 1; r <= 15; r++) {
		uint64_t n = 0;
		uint8_t in[400];

		for (uint64_t i = 0; i < s->n; i++) {
			fixture_record(s->format, fixture_length(s->format) + s->extra, i, in);
			n += (in[14] & 15u) == r;
		}
		packer_u64(p, n);
	}
	put_head(p, "LASF_Spec", 4, attributes(t) * ATTRIBUTE);
	if (t->extra)
		put_attribute(p, 0, t->extra, "of before");
	put_attribute(p, 4, 0, "LAS 1.4 scan angle");
	put_attribute(p, 1, 0, "LAS 1.4 extended returns");
	put_attribute(p, 1, 0, "LAS 1.4 classification");
	put_attribute(p, 1, 0, "LAS 1.4 flags and channel");
	if (t->nir)
		put_attribute(p, 3, 0, "LAS 1.4 NIR band");
}

static unsigned items(const struct target *t)
{
	return 3u + t->rgb + t->wave;
}

static void put_laszip(struct packer *p, const struct target *t)
{
	const uint16_t item[5][4] = {
		{6, 20, 2, 1},
		{7, 8, 2, 1},
		{8, 6, 2, t->rgb},
		{9, 29, 1, t->wave},
		{0, (uint16_t)(t->length - fixture_length(t->format)), 2, 1},
	};

	put_head(p, "laszip encoded", 22204, 34 + 6 * items(t));
	packer_u16(p, 2);
	packer_zero(p, 10);
	packer_u32(p, 1); /* points of a chunk */
	packer_zero(p, 16);
	packer_u16(p, (uint16_t)items(t));
	for (int i = 0; i < 5; i++) {
		for (int k = 0; item[i][3] && k < 3; k++)
			packer_u16(p, item[i][k]);
	}
}

struct bytes fixture_compat(const struct las_spec *s, bool laz)
{
	const struct target t = target_of(s);
	const struct las_spec older = {.minor = t.minor, .format = t.format};
	size_t header = fixture_header_size(t.minor), vlrs = 2 * VLR_HEAD + COMPATIBLE + attributes(&t) * ATTRIBUTE;
	size_t laszip = laz ? VLR_HEAD + 34 + 6 * items(&t) : 0, points = header + vlrs + laszip;
	struct bytes b = {.size = points + (laz ? 8 : 0) + s->n * (t.length + (laz ? 4 : 0))}, empty = fixture_las(&older);
	struct packer p;

	b.at = calloc(1, b.size);
	memcpy(b.at, empty.at, header);
	free(empty.at);
	p = packer_of(b.at + 96, 15);
	packer_u32(&p, (uint32_t)points);
	packer_u32(&p, 2 + laz);
	packer_u8(&p, (uint8_t)(t.format | (laz ? 0x80 : 0)));
	packer_u16(&p, (uint16_t)t.length);
	packer_u32(&p, (uint32_t)s->n);
	p = packer_of(b.at + header, b.size - header);
	put_compatible(&p, s, &t);
	if (laz) {
		put_laszip(&p, &t);
		packer_u64(&p, points); /* no table of chunks */
	}
	for (uint64_t i = 0; i < s->n; i++) {
		put_record(&p, s, &t, i);
		packer_zero(&p, laz ? 4 : 0);
	}
	if (p.bad || packer_size(&p) != b.size - header)
		abort();
	return b;
}
