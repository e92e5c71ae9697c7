/*
 * The LAS header (ASPRS LAS 1.4 R15, table 3, and its predecessors), and how wrong fields are handled.
 *
 * Rule: a field that is needed to read the points is checked against the size of the file before it is used; the error names the
 * byte and the field. Other fields (box, counts of other records, texts) are never trusted; wrong ones lead at most to a warning.
 * The memory that is allocated never depends on sizes and counts of the file.
 */
#include "input_las_parts.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "cursor.h"
#include "io.h"

/* Byte offsets of the fields that errors name. */
enum {
	AT_SIGNATURE = 0,
	AT_ENCODING = 6,
	AT_VERSION = 24,
	AT_HEADER_SIZE = 94,
	AT_POINT_OFFSET = 96,
	AT_FORMAT = 104,
	AT_LENGTH = 105,
	AT_SCALE = 131,
	AT_OFFSET = 155,
	AT_WAVEFORM = 227,
};

/* No survey is beyond these limits; decimals of such numbers only take time. */
static const double SCALE_MIN = 1e-15, SCALE_MAX = 1e15, OFFSET_MAX = 1e18;

enum { HEADER_MAX = 393 };

bool input_las_matches(const uint8_t *bytes, size_t n)
{
	return n >= 4 && !memcmp(bytes, "LASF", 4);
}

static unsigned min_header_size(unsigned minor)
{
	return minor >= 5 ? 393 : minor == 4 ? 375 : minor == 3 ? 235 : 227;
}

static int short_header(struct input *in, uint64_t need, struct err *err)
{
	return input_fail(in, err, ERR_TRUNCATED, in->size, "header",
			  "the file ends inside its header: %" PRIu64 " of %" PRIu64 " bytes", in->size, need);
}

/* Checks signature and version: whether this is a LAS file of a known version. */
static int check_kind(struct input *in, size_t n, struct err *err)
{
	struct input_las *las = input_las_of(in);
	const uint8_t *b = in->buffer;

	if (n == 0)
		return input_fail(in, err, ERR_TRUNCATED, 0, "header", "the file is empty: no LAS header");
	if (memcmp(b, "LASF", n < 4 ? n : 4))
		return input_fail(in, err, ERR_INPUT, AT_SIGNATURE, "file signature",
				  "not a LAS file: it does not begin with LASF");
	if (n < AT_VERSION + 2)
		return short_header(in, min_header_size(0), err);
	las->major = b[AT_VERSION];
	las->minor = b[AT_VERSION + 1];
	if (las->major != 1)
		return input_fail(in, err, ERR_INPUT, AT_VERSION, "version", "LAS version %u.%u does not exist", las->major,
				  las->minor);
	if (las->minor > 5) {
		input_fail(in, err, ERR_UNSUPPORTED, AT_VERSION, "version", "LAS version 1.%u is not in this version",
			   las->minor);
		return err_add_hint(err, "LAS 1.0 to 1.5 can be read");
	}
	if (n < min_header_size(0))
		return short_header(in, min_header_size(las->minor), err);
	return 0;
}

/* LAS 1.4 counts fifteen returns. If a writer filled only the five older fields, these are used. */
static void parse_returns(struct cursor *c, struct input_las_header *h)
{
	uint64_t many[16] = {0}, all = 0;

	for (int i = 1; i <= 15; i++)
		all |= many[i] = cursor_u64(c);
	if (all)
		memcpy(h->returns, many, sizeof h->returns);
}

/* Fields of newer versions are read where the header is long enough to have them, whatever its version. */
static void parse(const uint8_t *bytes, size_t n, struct input_las *las, struct input_las_header *h)
{
	unsigned minor = las->minor;
	struct cursor c = cursor_of(bytes, n);

	memset(h, 0, sizeof *h);
	cursor_skip(&c, AT_ENCODING);
	h->encoding = las->encoding = cursor_u16(&c);
	cursor_skip(&c, AT_HEADER_SIZE - AT_ENCODING - 2);
	las->header_size = cursor_u16(&c);
	h->point_offset = cursor_u32(&c);
	h->n_vlrs = cursor_u32(&c);
	h->format_byte = cursor_u8(&c);
	las->length = cursor_u16(&c);
	h->legacy_count = cursor_u32(&c);
	for (int i = 1; i <= 5; i++)
		h->returns[i] = cursor_u32(&c);
	for (int i = 0; i < 3; i++)
		h->scale[i] = cursor_f64(&c);
	for (int i = 0; i < 3; i++)
		h->offset[i] = cursor_f64(&c);
	for (int i = 0; i < 3; i++) {
		h->max[i] = cursor_f64(&c);
		h->min[i] = cursor_f64(&c);
	}
	h->count = h->legacy_count;
	while (minor > 2 && las->header_size < min_header_size(minor))
		minor--;
	if (minor >= 3)
		h->waveform = cursor_u64(&c);
	if (minor >= 4) {
		h->evlr_offset = cursor_u64(&c);
		h->n_evlrs = cursor_u32(&c);
		h->count = cursor_u64(&c);
		parse_returns(&c, h);
	}
	las->point_offset = h->point_offset;
	las->compressed = h->format_byte & 0x80;
	las->format = h->format_byte & 0x7f;
}

/* Some writers of LAS 1.3 and 1.4 leave the header as it was in LAS 1.2. */
static int check_header_size(struct input *in, size_t n, struct err *err)
{
	const struct input_las *las = input_las_of(in);
	unsigned least = min_header_size(0), full = min_header_size(las->minor);

	if (las->header_size < least)
		return input_fail(in, err, ERR_INPUT, AT_HEADER_SIZE, "header size",
				  "a header of %u bytes; LAS 1.%u has at least %u", las->header_size, las->minor, full);
	if (n < full && n < las->header_size)
		return short_header(in, las->header_size < full ? las->header_size : full, err);
	if (las->header_size < full)
		input_warn(in, "the header has %u bytes, that of LAS 1.%u has %u: the fields behind are not read",
			   las->header_size, las->minor, full);
	return 0;
}

static int check_layout(struct input *in, const struct input_las_header *h, struct err *err)
{
	const struct input_las *las = input_las_of(in);

	if (las->format > 10)
		return input_fail(in, err, ERR_INPUT, AT_FORMAT, "point format", "point format %u does not exist",
				  h->format_byte);
	if (las->length < input_las_min_length(las->format))
		return input_fail(in, err, ERR_INPUT, AT_LENGTH, "record length",
				  "records of %u bytes; point format %u has at least %u", las->length, las->format,
				  input_las_min_length(las->format));
	if (las->point_offset < las->header_size)
		return input_fail(in, err, ERR_INPUT, AT_POINT_OFFSET, "point offset",
				  "points begin at byte %" PRIu64 ", inside the header of %u bytes", las->point_offset,
				  las->header_size);
	if (las->point_offset > in->size && (h->count || h->legacy_count))
		return input_fail(in, err, ERR_INPUT, AT_POINT_OFFSET, "point offset",
				  "points begin at byte %" PRIu64 ", but the file has only %" PRIu64 " bytes", las->point_offset,
				  in->size);
	return 0;
}

static int check_numbers(struct input *in, const struct input_las_header *h, struct err *err)
{
	static const char *const scale_name[] = {"x scale", "y scale", "z scale"};
	static const char *const offset_name[] = {"x offset", "y offset", "z offset"};
	struct lattice_input *coords = &in->info.coords;

	coords->has_offset = true;
	for (unsigned i = 0; i < 3; i++) {
		/* written so that NaN fails */
		if (!(h->scale[i] >= SCALE_MIN && h->scale[i] <= SCALE_MAX) ||
		    !decimal_from_double(h->scale[i], &coords->scale[i]))
			return input_fail(in, err, ERR_INPUT, AT_SCALE + 8 * i, scale_name[i], "a scale of %g cannot be used",
					  h->scale[i]);
		if (!(fabs(h->offset[i]) <= OFFSET_MAX) || !decimal_from_double(h->offset[i], &coords->offset[i]))
			return input_fail(in, err, ERR_INPUT, AT_OFFSET + 8 * i, offset_name[i], "an offset of %g cannot be used",
					  h->offset[i]);
		coords->min[i] = h->min[i];
		coords->max[i] = h->max[i];
	}
	for (unsigned i = 0; i < 3; i++) {
		if (isfinite(h->min[i]) && isfinite(h->max[i]) && h->min[i] <= h->max[i])
			continue;
		input_warn(in, "the header's box is not one (%c from %.10g to %.10g)", "xyz"[i], h -> min[i], h -> max[i]);
		break;
	}
	return 0;
}

/* LAS 1.4 has two counts. The 64-bit one is used, or the 32-bit one if a writer filled only that. */
static void settle_count(struct input *in, struct input_las_header *h)
{
	if (input_las_of(in)->minor >= 4 && h->count != h->legacy_count && h->legacy_count) {
		if (!h->count)
			h->count = h->legacy_count;
		else
			input_warn(in, "the header's two point counts differ (%" PRIu64 " and %" PRIu32 ")", h->count,
				   h->legacy_count);
	}
	in->info.claimed = h->count;
}

void input_las_tell_uncounted(struct input *in, const char *how, uint64_t n, const char *of)
{
	input_las_of(in)->uncounted = in->info.miscounted = true;
	input_warn(in, "the header counts no points, but %s%" PRIu64 "%s are there, which --accept-truncated reads", how, n, of);
}

/* A writer that was interrupted, or could not go back, leaves the count at 0. */
static void settle_uncounted(struct input *in, struct input_las_header *h, uint64_t found)
{
	if (in->has_pipe || input_las_of(in)->has_laszip || !found)
		return;
	input_las_tell_uncounted(in, "", found, "");
	if (in->accept_truncated)
		input_las_of(in)->left = in->info.claimed = h->count = found;
}

static int check_count(struct input *in, struct input_las_header *h, struct err *err)
{
	struct input_las *las = input_las_of(in);
	uint64_t end = input_las_points_end(in, h), found;

	found = end > las->point_offset ? (end - las->point_offset) / las->length : 0;
	las->at = las->point_offset;
	las->left = h->count;
	if (!h->count)
		settle_uncounted(in, h, found);
	if (h->count <= found)
		return 0;
	if (las->has_laszip)
		return input_fail(in, err, ERR_INPUT, AT_FORMAT, "point format",
				  "the points are compressed (LAZ), but the point format does not say so");
	las->left = found;
	if (in->accept_truncated) {
		in->info.miscounted = true;
		input_warn(in, "%" PRIu64 " of %" PRIu64 " points are there", found, h->count);
		return 0;
	}
	input_fail(in, err, ERR_TRUNCATED, las->point_offset + found * las->length, "points",
		   "%s holds %" PRIu64 " whole points, but its header says %" PRIu64,
		   end < in->size ? "the part for points" : "the file", found, h->count);
	return err_add_hint(err, "copy it again, or take what is there with --accept-truncated");
}

static void settle_variant(struct input *in)
{
	const struct input_las *las = input_las_of(in);
	char compressor[24] = "", compat[64] = "";

	if (las->compressed)
		snprintf(compressor, sizeof compressor, ", compressor %u", las->laz.compressor);
	if (las->compat.format)
		snprintf(compat, sizeof compat, ": LAS 1.%u point format %u in compatibility mode", las->compat.minor,
			 las->compat.format);
	snprintf(in->info.variant, sizeof in->info.variant, "LA%c 1.%u, point format %u, %u bytes%s%s",
		 las->compressed ? 'Z' : 'S', las->minor, las->format, las->length, compressor, compat);
}

int input_las_open(struct input *in, struct err *err)
{
	struct input_las *las = input_las_of(in);
	struct input_las_header h;
	size_t n;
	int rc = io_read_some(in->fd, in->buffer, HEADER_MAX, 0, in->name, &n, err);

	in->info.accounted = 0;
	if (rc)
		return rc;
	rc = check_kind(in, n, err);
	if (rc)
		return rc;
	parse(in->buffer, n, las, &h);
	rc = check_header_size(in, n, err);
	if (!rc)
		rc = check_layout(in, &h, err);
	if (!rc)
		rc = check_numbers(in, &h, err);
	if (rc)
		return rc;
	settle_count(in, &h);
	rc = input_las_check_behind(in, &h, err);
	if (rc)
		return rc;
	rc = input_las_read_vlrs(in, h.n_vlrs, h.evlr_offset, h.n_evlrs, err);
	if (!rc)
		rc = input_las_compat_open(in, &h, err);
	if (!rc)
		rc = las->compressed ? input_laz_open(in, h.count, input_las_points_end(in, &h), err) : check_count(in, &h, err);
	if (!rc)
		rc = input_check_plane(in, err);
	if (!rc)
		rc = input_las_settle_behind(in, &h, err);
	if (!las->compressed && !in->has_pipe && las->left > INPUT_LAS_PART)
		in->info.parts = (las->left + INPUT_LAS_PART - 1) / INPUT_LAS_PART;
	in->info.has_returns = true;
	memcpy(in->info.returns, h.returns, sizeof in->info.returns);
	settle_variant(in);
	return rc;
}
