/*
 * Variable length records of LAS, before the points (54-byte heads) and after them (60-byte heads). Only the records that
 * describe the coordinate system are read; the others are skipped.
 *
 * Model: the read buffer, which is not yet needed for points, is divided into one slot for each kind of record. A record larger
 * than its slot is not read. The header's number of records is not trusted: reading ends when a record does not fit before the
 * points (or the end of the file), and after VLR_MAX records at the latest.
 */
#include "input_las_parts.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "crs.h"
#include "cursor.h"
#include "io.h"

enum slot { SLOT_KEYS, SLOT_DOUBLES, SLOT_ASCII, SLOT_WKT, SLOTS };

enum { SLOT_SIZE = 65536, VLR_MAX = 65536, VLR_HEAD = 54, EVLR_HEAD = 60 };

_Static_assert(SLOTS *SLOT_SIZE <= INPUT_BUFFER, "one slot of each kind fits the buffer");

struct walk {
	struct input *in;
	size_t size[SLOTS];
	unsigned rank[SLOTS]; /* 0: empty; a record of higher rank replaces one of lower */
};

static uint8_t *slot_bytes(struct walk *w, enum slot slot)
{
	return w->in->buffer + (size_t)slot * SLOT_SIZE;
}

static bool user_is(const uint8_t *user, const char *name)
{
	size_t n = strlen(name);

	return !memcmp(user, name, n) && (n == 16 || !user[n]);
}

/* The slot of the record and its rank: the user id of the standard ranks above that of libLAS. If several have the same rank, the
 * first is kept. */
static bool wanted(const uint8_t *user, unsigned id, enum slot *ret_slot, unsigned *ret_rank)
{
	unsigned rank = user_is(user, "LASF_Projection") ? 2 : user_is(user, "liblas") && id == 2112 ? 1 : 0;

	if (!rank)
		return false;
	switch (id) {
	case 34735:
		*ret_slot = SLOT_KEYS;
		break;
	case 34736:
		*ret_slot = SLOT_DOUBLES;
		break;
	case 34737:
		*ret_slot = SLOT_ASCII;
		break;
	case 2112:
		*ret_slot = SLOT_WKT;
		break;
	default:
		return false;
	}
	*ret_rank = rank;
	return true;
}

/* Reads how the points are compressed. The slot has room for all items that a record can have. */
static int take_laszip(struct input *in, uint64_t at, uint64_t size, struct err *err)
{
	struct input_las *las = input_las_of(in);
	size_t n = size < sizeof las->laszip ? (size_t)size : sizeof las->laszip;

	las->has_laszip = true;
	las->laszip_at = at;
	return io_read_some(in->fd, las->laszip, n, at, in->name, &las->laszip_size, err);
}

static void take_copc(struct input_copc *copc, const uint8_t *user, unsigned id, uint64_t at, uint64_t size)
{
	if (!user_is(user, "copc"))
		return;
	if (id == 1 && size == 160 && !copc->info_at)
		copc->info_at = at;
	if (id == 1000 && !copc->at) {
		copc->at = at;
		copc->bytes = size;
	}
}

static void take_compat(struct input_las_compat *compat, const uint8_t *user, unsigned id, uint64_t at, uint64_t size)
{
	if (user_is(user, "lascompatible") && id == 22204 && input_las_compat_is(size) && !compat->record_at)
		compat->record_at = at;
	if (user_is(user, "LASF_Spec") && id == 4 && size <= INPUT_BUFFER && !compat->extra_at) {
		compat->extra_at = at;
		compat->extra_size = (size_t)size;
	}
}

static int take(struct walk *w, const uint8_t *head, uint64_t at, uint64_t size, struct err *err)
{
	struct cursor c = cursor_of(head, VLR_HEAD);
	const uint8_t *user;
	enum slot slot;
	unsigned rank, id;
	size_t got;
	int rc;

	cursor_skip(&c, 2);
	user = cursor_bytes(&c, 16);
	id = cursor_u16(&c);
	if (user_is(user, "laszip encoded") && id == 22204 && !input_las_of(w->in)->has_laszip)
		return take_laszip(w->in, at, size, err);
	take_copc(&input_las_of(w->in)->copc, user, id, at, size);
	take_compat(&input_las_of(w->in)->compat, user, id, at, size);
	if (!wanted(user, id, &slot, &rank) || rank <= w->rank[slot] || !size)
		return 0;
	if (size > SLOT_SIZE) {
		input_warn(w->in, "a coordinate system record of %" PRIu64 " bytes was not read", size);
		return 0;
	}
	rc = io_read_some(w->in->fd, slot_bytes(w, slot), (size_t)size, at, w->in->name, &got, err);
	if (rc)
		return rc;
	w->size[slot] = got;
	w->rank[slot] = rank;
	return 0;
}

/* `n` records from `at` to at most `end`. `*ret_seen` is how many are there, `*ret_end` where they end. */
static int walk_records(struct walk *w, uint64_t at, uint64_t end, uint64_t n, bool extended, uint64_t *ret_seen,
			uint64_t *ret_end, struct err *err)
{
	size_t head_size = extended ? EVLR_HEAD : VLR_HEAD, got;
	uint8_t head[EVLR_HEAD];
	uint64_t i;

	*ret_end = at;
	for (i = 0; i < n && i < VLR_MAX && at <= end && end - at >= head_size; i++) {
		struct cursor c = cursor_of(head, sizeof head);
		uint64_t size;
		int rc = io_read_some(w->in->fd, head, head_size, at, w->in->name, &got, err);

		if (rc)
			return rc;
		if (got < head_size)
			break;
		cursor_skip(&c, 20);
		size = extended ? cursor_u64(&c) : cursor_u16(&c);
		at += head_size;
		*ret_end = size > end - at ? end : at + size;
		if (size > end - at)
			break;
		rc = take(w, head, at, size, err);
		if (rc)
			return rc;
		at += size;
	}
	*ret_seen = i;
	return 0;
}

/* The points will need the buffer. */
static int keep_wkt(struct walk *w, struct err *err)
{
	struct input *in = w->in;
	char *text = (char *)slot_bytes(w, SLOT_WKT);
	size_t n = w->size[SLOT_WKT] ? crs_wkt_normal(text, w->size[SLOT_WKT], text) : 0;

	if (n && !(in->wkt = strdup(text)))
		return input_fail(in, err, ERR_NOMEM, ERR_NO_OFFSET, NULL, "no memory for a coordinate system");
	return 0;
}

static int settle_crs(struct walk *w, struct err *err)
{
	const struct crs_records records = {
		.keys = {slot_bytes(w, SLOT_KEYS), w->size[SLOT_KEYS]},
		.doubles = {slot_bytes(w, SLOT_DOUBLES), w->size[SLOT_DOUBLES]},
		.ascii = {slot_bytes(w, SLOT_ASCII), w->size[SLOT_ASCII]},
		.wkt = {slot_bytes(w, SLOT_WKT), w->size[SLOT_WKT]},
		/* compatibility mode clears the bit and leaves the record */
		.prefer_wkt = input_las_of(w->in)->encoding & 0x10 || input_las_of(w->in)->compat.record_at,
	};

	crs_read(&records, &w->in->info.crs);
	return keep_wkt(w, err);
}

int input_las_read_vlrs(struct input *in, uint32_t n_vlrs, uint64_t evlr_offset, uint32_t n_evlrs, struct err *err)
{
	struct input_las *las = input_las_of(in);
	struct walk w = {.in = in};
	uint64_t end = las->point_offset < in->size ? las->point_offset : in->size, seen, last;
	int rc = walk_records(&w, las->header_size, end, n_vlrs, false, &seen, &last, err);

	if (rc)
		return rc;
	if (seen < n_vlrs)
		input_warn(in, "%" PRIu32 " variable length records claimed, %" PRIu64 " read", n_vlrs, seen);
	if (n_evlrs && in->has_pipe) {
		input_warn(in, "records behind the points are not read from a pipe");
	} else if (n_evlrs) {
		rc = walk_records(&w, evlr_offset, in->size, n_evlrs, true, &seen, &las->records_end, err);
		if (rc)
			return rc;
		if (seen < n_evlrs)
			input_warn(in, "%" PRIu32 " extended variable length records claimed, %" PRIu64 " read", n_evlrs, seen);
	}
	return settle_crs(&w, err);
}
