/*
 * Feeds bytes to the profile's kind of cut, and holds incomplete telegrams.
 *
 * `f->at` is the offset in the stream of the first undecided byte. While nothing is held, a cut works on the transfer
 * itself, without a copy, and what it leaves is held. The next transfer is appended to the held bytes piece by piece
 * until the cut is past them; then the rest is cut in place again.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "framer_parts.h"

const char *framer_reason_name(enum framer_reason reason)
{
	static const char *const names[] = {
#define R(name, text) text,
		FRAMER_REASONS(R)
#undef R
	};

	return (unsigned)reason < FRAMER_REASON_COUNT ? names[reason] : "unknown";
}

int framer_new(const struct profile *p, framer_sink sink, void *ctx, struct framer **ret, struct err *err)
{
	static size_t (*const cuts[])(struct framer *, const uint8_t *, size_t) = {
		[PROFILE_FRAMER_STREAM] = framer_cut_stream, [PROFILE_FRAMER_STX_ETX] = framer_cut_stx_etx,
		[PROFILE_FRAMER_LINE] = framer_cut_line,     [PROFILE_FRAMER_FIXED] = framer_cut_fixed,
		[PROFILE_FRAMER_LENGTH] = framer_cut_length, [PROFILE_FRAMER_LAS] = framer_cut_las,
	};
	struct framer *f = calloc(1, sizeof *f);

	if (!f)
		return err_set(err, ERR_NOMEM, "no memory for a framer");
	f->p = *p;
	f->sink = sink;
	f->ctx = ctx;
	f->cut = cuts[p->framer];
	f->skipping = p->framer == PROFILE_FRAMER_LINE && p->starts_torn;
	/* The longest frame, and more, so that appending is worthwhile. */
	f->room = (p->framer == PROFILE_FRAMER_LAS ? FRAMER_PIECE : p->telegram_max) + 8192;
	f->held = malloc(f->room);
	if (!f->held) {
		framer_free(f);
		return err_set(err, ERR_NOMEM, "no memory for a telegram of %u bytes", p->telegram_max);
	}
	*ret = f;
	return 0;
}

struct framer *framer_free(struct framer *f)
{
	if (f)
		free(f->held);
	free(f);
	return NULL;
}

void framer_on_bad(struct framer *f, void (*on_bad)(void *, enum framer_reason, uint64_t, uint64_t), void *ctx)
{
	f->on_bad = on_bad;
	f->on_bad_ctx = ctx;
}

/* ---- results of a cut ---- */

static void report_garbage(struct framer *f)
{
	if (!f->garbage)
		return;
	f->counts.by[FRAMER_GARBAGE]++;
	if (f->on_bad)
		f->on_bad(f->on_bad_ctx, FRAMER_GARBAGE, f->garbage_at, f->garbage);
	f->garbage = 0;
}

void framer_garbage(struct framer *f, uint64_t offset, uint64_t size)
{
	if (!size)
		return;
	if (!f->garbage)
		f->garbage_at = offset;
	f->garbage += size;
	f->counts.skipped += size;
}

void framer_bad(struct framer *f, enum framer_reason reason, uint64_t offset, uint64_t size)
{
	report_garbage(f);
	f->counts.by[reason]++;
	f->counts.bad++;
	f->counts.skipped += size;
	if (f->on_bad)
		f->on_bad(f->on_bad_ctx, reason, offset, size);
}

/* The time of the byte at this offset. */
static int64_t time_of(const struct framer *f, uint64_t place)
{
	size_t i = f->marks;

	while (i > 1 && f->mark[i - 1].from > place)
		i--;
	return f->mark[i - 1].time_ns;
}

bool framer_emit(struct framer *f, const uint8_t *at, size_t size, uint64_t offset, size_t frame)
{
	struct telegram t = {
		.at = at,
		.size = size,
		.offset = offset,
		.number = f->counts.telegrams,
		.first_ns = time_of(f, offset),
		.time_ns = time_of(f, offset + frame - (frame > 0)),
	};

	report_garbage(f);
	if (f->p.framer == PROFILE_FRAMER_LAS) {
		t.file = f->las.number;
		t.file_begins = !f->las.at;
		t.file_ends = f->las.at + size == f->las.end && !f->las.evlrs;
	}
	f->counts.telegrams++;
	f->counts.framed += frame;
	f->result = f->sink ? f->sink(f->ctx, &t) : 0;
	return !f->result;
}

/* ---- feeding ---- */

/* Bytes from `from` on have this time. If too many times are still needed, every second one is dropped. */
static void add_mark(struct framer *f, uint64_t from, int64_t time_ns)
{
	if (f->marks == FRAMER_MARKS) {
		for (size_t i = 1; i < FRAMER_MARKS / 2; i++)
			f->mark[i] = f->mark[2 * i];
		f->marks = FRAMER_MARKS / 2;
	}
	f->mark[f->marks].from = from;
	f->mark[f->marks++].time_ns = time_ns;
}

/* Drops the times of bytes that are decided. */
static void drop_marks(struct framer *f)
{
	size_t gone = 0;

	while (gone + 1 < f->marks && f->mark[gone + 1].from <= f->at)
		gone++;
	memmove(f->mark, f->mark + gone, (f->marks - gone) * sizeof *f->mark);
	f->marks -= gone;
}

/* Appends as much as it takes to get past the held bytes; returns how much of the feed is consumed. */
static size_t feed_held(struct framer *f, const uint8_t *at, size_t size)
{
	size_t before = f->n, take = f->room - f->n, done;

	if (take > size)
		take = size;
	if (take > before + 4096)
		take = before + 4096;
	memcpy(f->held + f->n, at, take);
	f->n += take;
	done = f->cut(f, f->held, f->n);
	f->at += done;
	if (done >= before) { /* the rest is also in the feed */
		f->n = 0;
		return done - before;
	}
	memmove(f->held, f->held + done, f->n - done);
	f->n -= done;
	return take;
}

int framer_feed(struct framer *f, const void *bytes, size_t size, int64_t time_ns)
{
	const uint8_t *at = bytes;

	if (!size)
		return 0;
	add_mark(f, f->at + f->n, time_ns);
	f->counts.bytes += size;
	f->result = 0;
	while (size && !f->result) {
		size_t done;

		if (f->n) {
			done = feed_held(f, at, size);
		} else {
			done = f->cut(f, at, size);
			f->at += done;
			if (!f->result && done < size) { /* an incomplete telegram: at most a frame */
				memcpy(f->held, at + done, size - done);
				f->n = size - done;
				done = size;
			}
		}
		at += done;
		size -= done;
	}
	if (f->result) { /* the rest is not seen */
		f->at += f->n + size;
		f->counts.skipped += f->n + size;
		f->n = 0;
		f->examined = 0;
	}
	drop_marks(f);
	return f->result;
}

/* The incomplete telegram is bad, for this reason. */
static void drop_begun(struct framer *f, enum framer_reason reason)
{
	if (f->las.inside) {
		framer_las_broken(f, reason, f->n);
	} else if (f->n) {
		framer_bad(f, reason, f->at, f->n);
	}
	f->at += f->n;
	f->n = 0;
	f->examined = 0;
	f->lost = false;
	report_garbage(f);
}

int framer_gap(struct framer *f)
{
	drop_begun(f, FRAMER_GAP);
	f->skipping = f->p.framer == PROFILE_FRAMER_LINE;
	return 0;
}

int framer_end(struct framer *f)
{
	f->result = 0;
	if (f->p.framer == PROFILE_FRAMER_LINE && f->n && !f->skipping) {
		size_t size = f->n - (f->held[f->n - 1] == '\r');

		if (size <= f->p.telegram_max) {
			framer_emit(f, f->held, size, f->at, f->n);
			f->at += f->n;
			f->n = 0;
			f->examined = 0;
		}
	}
	drop_begun(f, FRAMER_END);
	return f->result;
}

void framer_counts(const struct framer *f, struct framer_counts *ret)
{
	*ret = f->counts;
	ret->held = f->n;
}
