/*
 * LAS points: from the buffer to points (ASPRS LAS 1.4 R15, tables 7 to 17).
 *
 * Model: the buffer is filled with whole records, directly from the file, and each record is read once. Only xyz, class, returns
 * and flags of a record are used; the other fields (time, colour, waveform, extra bytes) are skipped by the record length of the
 * header.
 *
 * The class byte of formats 0 to 5 is read as LAS 1.1 defines it (5 bits of class, 3 of flags), also in LAS 1.0, as all readers
 * do. Class 12 ("overlap" there) stays class 12 and sets the overlap flag.
 *
 * Compressed points (input_laz.c) are put into the same buffer, as the same records.
 */
#include "input_las_parts.h"

#include <endian.h>
#include <inttypes.h>
#include <string.h>

#include "cursor.h"
#include "io.h"
#include "point.h"

enum { AT_POINT_OFFSET = 96, AT_FORMAT = 104 };

unsigned input_las_min_length(unsigned format)
{
	static const uint8_t length[] = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};

	return format < sizeof length ? length[format] : 0;
}

static inline int32_t load_i32(const uint8_t *at)
{
	uint32_t v;

	memcpy(&v, at, 4);
	return (int32_t)le32toh(v);
}

/* Inlined into one loop for each record length, so that the step is a constant. */
static inline __attribute__((always_inline)) void decode(const uint8_t *restrict at, size_t length, bool extended, size_t n,
							 int64_t (*restrict raw)[3], uint8_t *restrict cls, uint8_t *restrict ret,
							 uint8_t *restrict flags)
{
	for (size_t i = 0; i < n; i++, at += length) {
		unsigned r = at[14], c = at[15];

		raw[i][0] = load_i32(at);
		raw[i][1] = load_i32(at + 4);
		raw[i][2] = load_i32(at + 8);
		if (extended) {
			/* bits: 0 synthetic, 1 key-point, 2 withheld, 3 overlap */
			cls[i] = at[16];
			ret[i] = (uint8_t)r;
			flags[i] = (uint8_t)((c & 3) << 1 | (c >> 2 & 1) | (c & 8));
		} else {
			/* bits: 5 synthetic, 6 key-point, 7 withheld */
			cls[i] = c & 31;
			ret[i] = (uint8_t)((r & 7) | (r >> 3 & 7) << 4);
			flags[i] = (uint8_t)((c >> 4 & 6) | c >> 7 | ((c & 31) == 12) << 3);
		}
	}
}

_Static_assert(POINT_WITHHELD == 1 && POINT_SYNTHETIC == 2 && POINT_KEY == 4 && POINT_OVERLAP == 8,
	       "decode() moves the bits of LAS to these places");

/* n records to points, by format and record length (at least the minimum of the format). */
static void decode_all(unsigned format, unsigned length, const uint8_t *records, size_t n, struct input_points *pts)
{
	int64_t(*raw)[3] = pts->raw + pts->n;
	uint8_t *cls = pts->cls + pts->n, *ret = pts->ret + pts->n, *flags = pts->flags + pts->n;

#define STEP(bytes, extended)                                              \
	case bytes:                                                        \
		decode(records, bytes, extended, n, raw, cls, ret, flags); \
		break
	if (format < 6) {
		switch (length) {
			STEP(20, false);
			STEP(28, false);
			STEP(26, false);
			STEP(34, false);
		default:
			decode(records, length, false, n, raw, cls, ret, flags);
		}
	} else {
		switch (length) {
			STEP(30, true);
			STEP(36, true);
			STEP(38, true);
		default:
			decode(records, length, true, n, raw, cls, ret, flags);
		}
	}
#undef STEP
	pts->n += n;
}

/* The next whole records of a pipe, maybe none (in->dry). */
static int refill_forward(struct input *in, struct err *err)
{
	struct input_las *las = input_las_of(in);
	size_t room = sizeof in->buffer / las->length * las->length, got;
	uint8_t *rest = in->buffer + las->n_buffered * las->length;
	int rc;

	if (room > las->left * las->length)
		room = (size_t)las->left * las->length;
	memmove(in->buffer, rest, las->rest);
	las->n_buffered = las->i_buffered = 0;
	rc = input_pipe_read(in, las->at, in->buffer + las->rest, room - las->rest, &got, err);
	if (rc)
		return rc;
	las->at += got;
	las->rest += got;
	las->n_buffered = las->rest / las->length;
	las->rest -= las->n_buffered * las->length;
	if (got || in->dry)
		return 0;
	if (in->accept_truncated) {
		input_warn(in, "%" PRIu64 " of %" PRIu64 " points are there", in->info.claimed - las->left, in->info.claimed);
		las->left = 0;
		return 0;
	}
	input_fail(in, err, ERR_TRUNCATED, las->at, "points",
		   "the pipe ended after %" PRIu64 " whole points, but the header says %" PRIu64, in->info.claimed - las->left,
		   in->info.claimed);
	return err_add_hint(err, "look at what fills the pipe, or take what is there with --accept-truncated");
}

enum { DRAIN_BUFFERS = 64 };

/* Reads the bytes after the points, up to the end, so that the writer of the pipe gets no SIGPIPE. From time to time it behaves
 * as if the pipe had no bytes, so that a pipe without an end can be cancelled. */
static int drain(struct input *in, struct err *err)
{
	struct input_las *las = input_las_of(in);
	unsigned buffers = 0;
	size_t got;
	int rc;

	do {
		if (buffers++ == DRAIN_BUFFERS) {
			in->dry = true;
			return 0;
		}
		rc = input_pipe_read(in, las->at, in->buffer, sizeof in->buffer, &got, err);
		las->at += got;
		if (!rc && got && !in->info.claimed) {
			input_fail(in, err, ERR_INPUT, las->point_offset, "number of points",
				   "the header says that there are no points, but bytes follow it");
			return err_add_hint(err, "a writer to a pipe cannot know the count: write a file first");
		}
	} while (!rc && got);
	return rc;
}

/* The next whole records of a file that is not compressed. A short read means that the file shrank: its size was checked at open.
 */
static int refill(struct input *in, struct err *err)
{
	struct input_las *las = input_las_of(in);
	size_t n = sizeof in->buffer / las->length, got;
	int rc;

	if (n > las->left)
		n = (size_t)las->left;
	rc = io_read_some(in->fd, in->buffer, n * las->length, las->at, in->name, &got, err);
	if (rc)
		return rc;
	if (got < n * las->length) {
		rc = input_check_unchanged(in, err);
		if (rc)
			return rc;
		return input_fail(in, err, ERR_TRUNCATED, las->at + got, "points", "the file ends in the middle of its points");
	}
	if (in->seen)
		in->seen(in->seen_ctx, las->at, in->buffer, got);
	las->at += got;
	in->bytes_read += got;
	las->n_buffered = n;
	las->i_buffered = 0;
	return 0;
}

static int read_points(struct input *in, struct input_points *pts, struct err *err)
{
	struct input_las *las = input_las_of(in);
	int rc;

	while (pts->n < pts->cap && las->left) {
		const uint8_t *records;
		size_t n;

		if (las->i_buffered == las->n_buffered) {
			rc = las->compressed ? input_laz_refill(in, err) :
			     in->has_pipe    ? refill_forward(in, err) :
					       refill(in, err);
			if (rc)
				return rc;
			if (!las->left)
				break;
			if (!las->n_buffered && in->dry)
				return 0;
			if (!las->n_buffered)
				continue;
		}
		n = las->n_buffered - las->i_buffered;
		if (n > pts->cap - pts->n)
			n = pts->cap - pts->n;
		records = in->buffer + las->i_buffered * las->length;
		if (las->watch)
			las->watch(las->watch_arg, records, n, las->length);
		decode_all(las->format, las->length, records, n, pts);
		if (las->compat.format)
			input_las_compat_restore(las, records, n, pts);
		las->i_buffered += n;
		las->left -= n;
	}
	if (!las->left && !in->checked) {
		rc = in->has_pipe ? drain(in, err) : input_check_unchanged(in, err);
		if (!rc && input_dry(in))
			return 0;
		if (rc)
			return rc;
		if (las->compressed)
			input_laz_finish(in);
		in->checked = true;
	}
	return 0;
}

static void take_part(struct input *in, uint64_t first, uint64_t last)
{
	struct input_las *las = input_las_of(in);
	uint64_t from = first * INPUT_LAS_PART, to = last * INPUT_LAS_PART;

	if (las->compressed) {
		input_laz_part(in, first, last);
		return;
	}
	if (to > las->left)
		to = las->left;
	in->info.first_point = from;
	las->at += from * las->length;
	las->left = to - from;
}

uint64_t input_las_forward_head(const uint8_t *bytes, size_t n)
{
	struct cursor c = cursor_of(bytes, n);
	uint64_t offset;
	unsigned format;

	if (n < INPUT_LAS_LOOK)
		return n >= 4 && memcmp(bytes, "LASF", 4) ? 0 : INPUT_LAS_LOOK;
	if (memcmp(bytes, "LASF", 4))
		return 0;
	cursor_skip(&c, AT_POINT_OFFSET);
	offset = cursor_u32(&c);
	cursor_skip(&c, AT_FORMAT - AT_POINT_OFFSET - 4);
	format = cursor_u8(&c);
	if (format & 0xc0)
		return 0;
	return offset > INPUT_LAS_LOOK ? offset : INPUT_LAS_LOOK;
}

const struct input_reader input_las_reader = {
	.state_bytes = sizeof(struct input_las),
	.forwards = true,
	.matches = input_las_matches,
	.open = input_las_open,
	.read = read_points,
	.part = take_part,
	.close = input_laz_close,
};
