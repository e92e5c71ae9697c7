/*
 * The data after the points of a LAS file: extended records, waveform packets, and bytes that belong to nothing.
 *
 * Model: the header has a pointer to each. A pointer into the points is only valid if it leads to a record: programs that rewrite
 * the points often leave the old pointer in the header, and it would cut the points. Compressed points end before their chunk
 * table. Without a valid table, a sequence of records up to a known place in the file proves the pointer, whatever their names.
 * An invalid pointer leads to a warning, and its data is not read.
 *
 * Not here: the content of the records (input_las_vlr.c).
 */
#include "input_las_parts.h"

#include <inttypes.h>
#include <string.h>

#include "cursor.h"
#include "io.h"

enum { EVLR_HEAD = 60, USER = 2, USER_BYTES = 16, USER_LEAST = 3, LENGTH = 20, CHAIN_MAX = 4096 };

/* The bytes that are read for the head of a record. */
struct record {
	bool whole, named,
		filled; /* its head is in the file; its user ID is text, up to the end or a zero; and zeros from there on */
	uint64_t begin, length; /* of its body, as claimed */
};

/* Text of a few letters. 16 bytes of points seldom look like that, and hardly ever with only zeros after it. */
static void judge_user(const uint8_t *user, struct record *r)
{
	size_t n = 0;

	while (n < USER_BYTES && user[n] >= ' ' && user[n] < 127)
		n++;
	r->named = n >= USER_LEAST && (n == USER_BYTES || !user[n]);
	r->filled = r->named;
	for (size_t i = n; i < USER_BYTES; i++)
		if (user[i])
			r->filled = false;
}

static int read_record(struct input *in, uint64_t at, struct record *ret, struct err *err)
{
	uint8_t head[EVLR_HEAD] = {0};
	struct cursor c = cursor_of(head, sizeof head);
	size_t n = 0;
	int rc = at < in->size ? io_read_some(in->fd, head, sizeof head, at, in->name, &n, err) : 0;

	*ret = (struct record){.whole = n == sizeof head, .begin = at + EVLR_HEAD};
	if (rc || !ret->whole)
		return rc;
	judge_user(head + USER, ret);
	cursor_skip(&c, LENGTH);
	ret->length = cursor_u64(&c);
	return 0;
}

static bool fits(const struct input *in, const struct record *r)
{
	return r->whole && r->length <= in->size - r->begin;
}

/* The end of the record that begins at byte `at`, its claim cut at the end of the file; 0: there is none. */
static int record_end(struct input *in, uint64_t at, uint64_t *ret, struct err *err)
{
	struct record r;
	int rc = read_record(in, at, &r, err);

	*ret = !rc && r.filled ? fits(in, &r) ? r.begin + r.length : in->size : 0;
	return rc;
}

/* Whether n records begin at byte `at`. Uncompressed points may be zeros, which would be records without name and length. */
static int has_records(struct input *in, uint64_t at, uint32_t n, bool *ret, struct err *err)
{
	struct record r;
	int rc = read_record(in, at, &r, err);

	*ret = r.filled;
	if (rc || *ret || !(r.named || input_las_of(in)->compressed))
		return rc;
	for (uint32_t i = 1; !rc && fits(in, &r) && i < n && i < CHAIN_MAX; i++)
		rc = read_record(in, r.begin + r.length, &r, err);
	*ret = fits(in, &r);
	return rc;
}

/* The end of the points by the count of the header; 0: the file is too small for so many. */
static uint64_t counted_end(const struct input *in, const struct input_las_header *h)
{
	const struct input_las *las = input_las_of(in);

	if (in->size < las->point_offset || h->count > (in->size - las->point_offset) / las->length)
		return 0;
	return las->point_offset + h->count * las->length;
}

/* The last possible end of compressed points: their chunk table, or without a valid address of it the end of the file. */
static int compressed_end(struct input *in, uint64_t *ret, struct err *err)
{
	uint64_t begin = input_las_of(in)->point_offset, address;
	uint8_t bytes[8] = {0};
	struct cursor c = cursor_of(bytes, sizeof bytes);
	size_t n = 0;
	int rc = begin < in->size ? io_read_some(in->fd, bytes, sizeof bytes, begin, in->name, &n, err) : 0;

	address = cursor_u64(&c);
	if (!rc && address == UINT64_MAX && in->size >= sizeof bytes) {
		rc = io_read_some(in->fd, bytes, sizeof bytes, in->size - sizeof bytes, in->name, &n, err);
		c = cursor_of(bytes, sizeof bytes);
		address = cursor_u64(&c);
	}
	*ret = n == sizeof bytes && address > begin + sizeof bytes && address < in->size ? address : in->size;
	return rc;
}

/* Whether the points may go on at byte `at`, which the header says is behind them. */
static int may_hold_points(struct input *in, const struct input_las_header *h, uint64_t at, bool *ret, struct err *err)
{
	const struct input_las *las = input_las_of(in);
	uint64_t end = counted_end(in, h);
	int rc = las->compressed && !in->has_pipe ? compressed_end(in, &end, err) : 0;

	*ret = at >= las->point_offset && at < end;
	return rc;
}

/* *ret_stale: `at` leads into the points, and no record begins there. A pipe cannot be checked. */
static int look(struct input *in, const struct input_las_header *h, uint64_t at, uint32_t n, bool *ret_stale, struct err *err)
{
	bool found = false;
	int rc = may_hold_points(in, h, at, ret_stale, err);

	if (rc || !*ret_stale || in->has_pipe)
		return rc;
	rc = has_records(in, at, n, &found, err);
	*ret_stale = !found;
	return rc;
}

static bool has_waveforms(const struct input *in, const struct input_las_header *h)
{
	return input_las_of(in)->format >= 4 && (h->encoding & 2) && h->waveform;
}

int input_las_check_behind(struct input *in, struct input_las_header *h, struct err *err)
{
	bool stale = false;
	int rc = h->n_evlrs ? look(in, h, h->evlr_offset, h->n_evlrs, &stale, err) : 0;

	if (rc)
		return rc;
	if (stale) {
		input_warn(in,
			   "byte %" PRIu64 ", where the header says that extended records begin, is in the points: "
			   "no extended record (%" PRIu32 ") is read",
			   h->evlr_offset, h->n_evlrs);
		h->n_evlrs = 0;
	}
	stale = false;
	rc = has_waveforms(in, h) ? look(in, h, h->waveform, 1, &stale, err) : 0;
	if (rc || !stale)
		return rc;
	input_warn(in, "byte %" PRIu64 ", where the header says that waveforms begin, is in the points", h->waveform);
	h->waveform = 0;
	return 0;
}

uint64_t input_las_points_end(const struct input *in, const struct input_las_header *h)
{
	uint64_t end = in->size, begin = input_las_of(in)->point_offset;

	if (h->n_evlrs && h->evlr_offset >= begin && h->evlr_offset < end)
		end = h->evlr_offset;
	if (has_waveforms(in, h) && h->waveform > begin && h->waveform < end)
		end = h->waveform;
	return end;
}

void input_las_account(struct input *in, uint64_t points_end)
{
	uint64_t end = input_las_of(in)->records_end;

	end = points_end > end ? points_end : end;
	in->info.accounted = end < in->size ? end : in->size;
}

/* Packets without a head are supposed to go on to the end of the file. */
static int add_waveforms(struct input *in, const struct input_las_header *h, struct err *err)
{
	struct input_las *las = input_las_of(in);
	uint64_t end;
	int rc;

	if (!has_waveforms(in, h) || h->waveform >= in->size)
		return 0;
	rc = record_end(in, h->waveform, &end, err);
	end = end ? end : in->size;
	las->records_end = end > las->records_end ? end : las->records_end;
	return rc;
}

/* Without a chunk table: an upper bound of the end of the points, for the worst compression. input_laz_finish finds the end. */
static uint64_t most_compressed(const struct input *in)
{
	const struct input_las *las = input_las_of(in);
	uint64_t each = 2 * (uint64_t)las->length, few = 1 << 16;

	if (las->uncounted)
		return in->size;
	if (in->info.claimed > in->size / each)
		return in->size;
	return las->point_offset + few + in->info.claimed * each;
}

int input_las_settle_behind(struct input *in, const struct input_las_header *h, struct err *err)
{
	const struct input_las *las = input_las_of(in);
	uint64_t left = in->size >= las->point_offset ? in->size - las->point_offset : 0, room = left / las->length;
	uint64_t points = (h->count < room ? h->count : room) * las->length;
	int rc = in->has_pipe ? 0 : add_waveforms(in, h, err);

	if (rc || in->has_pipe)
		return rc;
	if (las->compressed) {
		input_las_account(in, las->chunks ? las->chunks_end : most_compressed(in));
		return 0;
	}
	input_las_account(in, las->point_offset + points);
	in->info.most = room ? room : 1;
	/* Bytes after other records are not checked; there was a warning about points that are not counted already. */
	in->info.has_trailing = !h->n_evlrs && !h->waveform && h->count <= room && !las->uncounted;
	in->info.trailing = in->info.has_trailing ? left - points : 0;
	return 0;
}
