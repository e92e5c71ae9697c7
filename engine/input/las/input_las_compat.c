/*
 * LASzip's compatibility mode: points of formats 6 to 10 in records of formats 1, 3, 4 and 5, for readers that know no LAS 1.4
 * (LASzip 2.5 and later; described by what its library writes).
 *
 * Model: a record "lascompatible" identifies such a file, and counts the points by all 15 returns. Values that do not fit the
 * older record are in extra bytes after it, which the record of extra bytes names: the excess of return number and number of
 * returns over the older fields, classes above 31, and the overlap flag. A class or return is the sum of both.
 *
 * Not here: scan angle, scanner channel and near infrared, which are also there but not needed for a terrain.
 */
#include "input_las_parts.h"

#include <inttypes.h>
#include <string.h>

#include "cursor.h"
#include "io.h"
#include "point.h"

enum { VLR_14 = 156, VLR_15 = 174, AT_RETURNS = 8 + 8 + 8 + 4 + 8, ATTRIBUTE = 192, NAME_BYTES = 32 };
enum { COMPATIBLE_15 = 4 };

enum { ANGLE, RETURNS, CLASS, FLAGS, NEEDED, NIR = NEEDED, FIELDS };

bool input_las_compat_is(uint64_t size)
{
	return size == VLR_14 || size == VLR_15;
}

/* Bytes of an attribute; types 11 to 30 are those of 1 to 10 two and three times. */
static unsigned attribute_bytes(unsigned type, unsigned options)
{
	static const uint8_t bytes[10] = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};

	if (!type)
		return options;
	return type > 30 ? 0 : bytes[(type - 1) % 10] * (1 + (type - 1) / 10);
}

static bool name_is(const uint8_t *name, const char *wanted)
{
	size_t n = strlen(wanted);

	return !memcmp(name, wanted, n) && !name[n];
}

/* The offset of the fields in a record; 0: it has no fields of that name. */
static void find_fields(const struct input_las *las, const uint8_t *attributes, size_t n, unsigned ret[FIELDS])
{
	static const char *const names[FIELDS] = {
		"LAS 1.4 scan angle",        "LAS 1.4 extended returns", "LAS 1.4 classification",
		"LAS 1.4 flags and channel", "LAS 1.4 NIR band",
	};
	static const uint8_t size[FIELDS] = {2, 1, 1, 1, 2};
	unsigned at = input_las_min_length(las->format);

	memset(ret, 0, FIELDS * sizeof *ret);
	for (; n >= ATTRIBUTE; n -= ATTRIBUTE, attributes += ATTRIBUTE) {
		struct cursor c = cursor_of(attributes, ATTRIBUTE);
		unsigned type, bytes;
		const uint8_t *name;

		cursor_skip(&c, 2);
		type = cursor_u8(&c);
		bytes = attribute_bytes(type, cursor_u8(&c));
		name = cursor_bytes(&c, NAME_BYTES);
		for (unsigned i = 0; i < FIELDS; i++)
			if (!ret[i] && name_is(name, names[i]) && bytes == size[i] && at + bytes <= las->length)
				ret[i] = at;
		at += bytes;
	}
}

/* The newer format, without near infrared, which the next one has. 0: no newer format is stored in this one. */
static unsigned original_format(unsigned format)
{
	static const uint8_t original[6] = {0, 6, 0, 7, 9, 9};

	return original[format];
}

/* The counts by return of the original header, of which the older one has five. */
static int take_record(struct input *in, struct input_las_header *h, struct err *err)
{
	struct input_las *las = input_las_of(in);
	uint64_t many[16] = {0}, all = 0;
	uint8_t body[VLR_14] = {0};
	struct cursor c = cursor_of(body, sizeof body);
	size_t n;
	int rc = io_read_some(in->fd, body, sizeof body, las->compat.record_at, in->name, &n, err);

	cursor_skip(&c, 2);
	las->compat.minor = cursor_u16(&c) == COMPATIBLE_15 ? 5 : 4;
	cursor_skip(&c, AT_RETURNS - 4);
	for (int i = 1; i <= 15; i++)
		all |= many[i] = cursor_u64(&c);
	if (all)
		memcpy(h->returns, many, sizeof many);
	return rc;
}

int input_las_compat_open(struct input *in, struct input_las_header *h, struct err *err)
{
	struct input_las *las = input_las_of(in);
	struct input_las_compat *compat = &las->compat;
	unsigned at[FIELDS];
	size_t n = 0;
	int rc;

	if (!compat->record_at || las->format > 5) /* newer points have all of it themselves */
		return 0;
	if (compat->extra_at) {
		rc = io_read_some(in->fd, in->buffer, compat->extra_size, compat->extra_at, in->name, &n, err);
		if (rc)
			return rc;
	}
	find_fields(las, in->buffer, n, at);
	for (unsigned i = 0; i < NEEDED; i++) {
		if (at[i] && original_format(las->format))
			continue;
		input_warn(in, "LAS 1.4 points in compatibility mode, but where their fields are is not said: read as format %u",
			   las->format);
		return 0;
	}
	compat->format = original_format(las->format) + (at[NIR] && las->format != 1);
	compat->returns = at[RETURNS];
	compat->cls = at[CLASS];
	compat->flags = at[FLAGS];
	return take_record(in, h, err);
}

void input_las_compat_restore(const struct input_las *las, const uint8_t *records, size_t n, struct input_points *pts)
{
	const struct input_las_compat *compat = &las->compat;
	uint8_t *cls = pts->cls + pts->n - n, *ret = pts->ret + pts->n - n, *flags = pts->flags + pts->n - n;

	for (size_t i = 0; i < n; i++, records += las->length) {
		unsigned more = records[compat->returns], number = (ret[i] & 15) + (more >> 4), of = (ret[i] >> 4) + (more & 15);

		ret[i] = (uint8_t)((number & 15) | (of & 15) << 4);
		cls[i] = (uint8_t)(cls[i] + records[compat->cls]);
		/* class 12 means overlap in older points only */
		flags[i] = (uint8_t)((flags[i] & ~POINT_OVERLAP) | (records[compat->flags] & 1 ? POINT_OVERLAP : 0));
	}
}
