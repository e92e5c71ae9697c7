/*
 * The record "laszip encoded"/22204: compressor, chunk size, and the items that a point record is made of.
 *
 * Rule: its items must fit the point format and record length of the LAS header exactly, since the meaning of an item follows
 * from the point format. The number of special records and the options do not affect points and are ignored.
 */
#include "laz.h"

#include "cursor.h"
#include "err.h"
#include "laz_items.h"
#include "laz_parts.h"

/* Places in the record's body. */
enum { AT_COMPRESSOR = 0, AT_CODER = 2, AT_CHUNK_SIZE = 12, AT_ITEMS = 32, AT_ITEM = 34, ITEM_BYTES = 6 };

#define fail(err, code, at, field, ...) (err_set((err), (code), __VA_ARGS__), err_add_place((err), (at), (field)))

static const char *item_name(unsigned type)
{
	static const char *const names[] = {"BYTE",    "SHORT",   "INT",       "LONG",         "FLOAT",
					    "DOUBLE",  "POINT10", "GPSTIME11", "RGB12",        "WAVEPACKET13",
					    "POINT14", "RGB14",   "RGBNIR14",  "WAVEPACKET14", "BYTE14"};

	return type < sizeof names / sizeof *names ? names[type] : "unknown";
}

static unsigned item_size(unsigned type)
{
	switch (type) {
	case LAZ_POINT10:
		return 20;
	case LAZ_GPSTIME11:
		return 8;
	case LAZ_RGB12:
	case LAZ_RGB14:
		return 6;
	case LAZ_WAVEPACKET13:
	case LAZ_WAVEPACKET14:
		return 29;
	case LAZ_POINT14:
		return 30;
	case LAZ_RGBNIR14:
		return 8;
	default:
		return 0;
	}
}

/* The items of a point format, without extra bytes. */
static unsigned expected(unsigned point_format, uint16_t ret[LAZ_ITEMS])
{
	static const bool time[6] = {false, true, false, true, true, true};
	static const bool colour[6] = {false, false, true, true, false, true};
	unsigned n = 0;

	if (point_format < 6) {
		ret[n++] = LAZ_POINT10;
		if (time[point_format])
			ret[n++] = LAZ_GPSTIME11;
		if (colour[point_format])
			ret[n++] = LAZ_RGB12;
		if (point_format >= 4)
			ret[n++] = LAZ_WAVEPACKET13;
		return n;
	}
	ret[n++] = LAZ_POINT14;
	if (point_format == 7)
		ret[n++] = LAZ_RGB14;
	if (point_format == 8 || point_format == 10)
		ret[n++] = LAZ_RGBNIR14;
	if (point_format >= 9)
		ret[n++] = LAZ_WAVEPACKET14;
	return n;
}

static bool known_version(unsigned type, unsigned version)
{
	/* version 2 is LASzip's name for what its prototype wrote, the same as 3 */
	if (type >= LAZ_POINT14)
		return version == 3 || version == 4 || (version == 2 && type != LAZ_WAVEPACKET14);
	return laz_item_find(type, version) != NULL;
}

static int check_kind(const struct laz_format *f, unsigned coder, unsigned point_format, struct err *err)
{
	if (f->compressor < LAZ_COMPRESSOR_POINTWISE || f->compressor > LAZ_COMPRESSOR_LAYERED)
		return fail(err, ERR_INPUT, AT_COMPRESSOR, "compressor", "there is no compressor %u (1 to 3 exist)",
			    f->compressor);
	if (coder != 0)
		return fail(err, ERR_INPUT, AT_CODER, "coder", "there is no entropy coder %u (only 0 exists)", coder);
	if ((f->compressor == LAZ_COMPRESSOR_LAYERED) != (point_format >= 6))
		return fail(err, ERR_INPUT, AT_COMPRESSOR, "compressor", "compressor %u does not go with point format %u",
			    f->compressor, point_format);
	return 0;
}

static int check_item(const struct laz_format *f, unsigned i, unsigned type, uint64_t at, struct err *err)
{
	const struct laz_item *item = &f->item[i];
	unsigned size = item_size(type);

	if (item->type != type)
		return fail(err, ERR_INPUT, at, "item type", "item %u is %s (%u), where %s (%u) belongs", i + 1,
			    item_name(item->type), item->type, item_name(type), type);
	if (size ? item->size != size : !item->size)
		return fail(err, ERR_INPUT, at + 2, "item size", "item %s of %u bytes", item_name(type), item->size);
	if (type == LAZ_BYTE && item->size > LAZ_EXTRA_MAX)
		return fail(err, ERR_UNSUPPORTED, at + 2, "item size",
			    "%u extra bytes in a record: this version reads %d compressed ones at most", item->size,
			    LAZ_EXTRA_MAX);
	if (!known_version(type, item->version))
		return fail(err, ERR_UNSUPPORTED, at + 4, "item version",
			    "item %s in version %u, which this version does not know", item_name(type), item->version);
	return 0;
}

static int check_items(const struct laz_format *f, unsigned point_format, unsigned length, struct err *err)
{
	uint16_t want[LAZ_ITEMS];
	unsigned n = expected(point_format, want), sum = 0;

	if (f->nitems == n + 1)
		want[n++] = point_format < 6 ? LAZ_BYTE : LAZ_BYTE14;
	if (f->nitems != n)
		return fail(err, ERR_INPUT, AT_ITEMS, "number of items", "%u items; point format %u has %u", f->nitems,
			    point_format, n);
	for (unsigned i = 0; i < n; i++) {
		int rc = check_item(f, i, want[i], AT_ITEM + ITEM_BYTES * i, err);

		if (rc)
			return rc;
		sum += f->item[i].size;
	}
	if (sum != length)
		return fail(err, ERR_INPUT, AT_ITEM, "items", "the items make up records of %u bytes, the header says %u", sum,
			    length);
	return 0;
}

int laz_format_parse(const void *vlr, size_t n, unsigned point_format, unsigned length, struct laz_format *ret, struct err *err)
{
	struct cursor c = cursor_of(vlr, n);
	struct laz_format f = {0};
	unsigned coder;
	int rc;

	f.compressor = cursor_u16(&c);
	coder = cursor_u16(&c);
	cursor_skip(&c, AT_CHUNK_SIZE - AT_CODER - 2); /* version of the writer, options */
	f.chunk_size = cursor_u32(&c);
	cursor_skip(&c, AT_ITEMS - AT_CHUNK_SIZE - 4); /* special records */
	f.nitems = cursor_u16(&c);
	if (!c.bad) {
		rc = check_kind(&f, coder, point_format, err);
		if (rc)
			return rc;
		if (!f.nitems || f.nitems > LAZ_ITEMS)
			return fail(err, ERR_INPUT, AT_ITEMS, "number of items", "%u items in a record", f.nitems);
	}
	for (unsigned i = 0; i < f.nitems && i < LAZ_ITEMS; i++) {
		f.item[i].type = cursor_u16(&c);
		f.item[i].size = cursor_u16(&c);
		f.item[i].version = cursor_u16(&c);
	}
	if (c.bad)
		return fail(err, ERR_INPUT, n, "laszip record", "the record ends after %zu bytes, inside what it says", n);
	rc = check_items(&f, point_format, length, err);
	if (rc)
		return rc;
	f.length = length;
	*ret = f;
	return 0;
}
