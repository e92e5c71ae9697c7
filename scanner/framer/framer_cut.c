/* A cut for each kind except LAS (framer_parts.h). Each byte is read once or twice, however the transfers are divided. */
#include <string.h>

#include "framer_parts.h"

enum { STX = 2, ETX = 3 };

size_t framer_cut_stream(struct framer *f, const uint8_t *at, size_t size)
{
	framer_emit(f, at, size, f->at, size);
	return size;
}

/* Index of the byte in [from, to); `to`: not found. */
static size_t find(const uint8_t *at, uint8_t byte, size_t from, size_t to)
{
	const uint8_t *p = from < to ? memchr(at + from, byte, to - from) : NULL;

	return p ? (size_t)(p - at) : to;
}

size_t framer_cut_stx_etx(struct framer *f, const uint8_t *at, size_t size)
{
	size_t pos = 0, etx = 0, examined = f->examined;

	f->examined = 0;
	while (pos < size) {
		size_t from = pos + (examined ? examined : 1), limit, stx;

		examined = 0;
		if (at[pos] != STX) {
			stx = find(at, STX, pos, size);
			framer_garbage(f, f->at + pos, stx - pos);
			pos = stx;
			continue;
		}
		if (etx < from) /* the next one, whichever telegram it ends: searched only once */
			etx = find(at, ETX, from, size);
		limit = size - pos > f->p.telegram_max + 2ULL ? pos + f->p.telegram_max + 2 : size;
		stx = find(at, STX, from, etx < limit ? etx : limit);
		if (stx < etx && stx < limit) {
			framer_bad(f, FRAMER_CUT, f->at + pos, stx - pos);
			pos = stx;
		} else if (etx < limit) {
			size_t frame = etx + 1 - pos;

			pos = etx + 1;
			if (!framer_emit(f, at + pos - frame + 1, frame - 2, f->at + pos - frame, frame))
				return pos;
		} else if (limit - pos == f->p.telegram_max + 2ULL) {
			framer_bad(f, FRAMER_LONG, f->at + pos, limit - pos);
			pos = limit;
		} else {
			f->examined = size - pos;
			return pos;
		}
	}
	return size;
}

size_t framer_cut_line(struct framer *f, const uint8_t *at, size_t size)
{
	size_t pos = 0, examined = f->examined, most = (size_t)f->p.telegram_max + 2;

	f->examined = 0;
	while (pos < size) {
		size_t limit = size - pos > most && !f->skipping ? pos + most : size;
		size_t end = find(at, '\n', pos + examined, limit), start = pos, length;

		examined = 0;
		if (f->skipping) {
			pos = end < size ? end + 1 : size;
			f->skipping = end == size;
			framer_garbage(f, f->at + start, pos - start);
			continue;
		}
		if (end == limit && limit - pos < most) {
			f->examined = size - pos;
			return pos;
		}
		pos = end < limit ? end + 1 : limit;
		length = end - start;
		if (length && end < limit && at[end - 1] == '\r')
			length--;
		if (length > f->p.telegram_max) {
			framer_bad(f, FRAMER_LONG, f->at + start, pos - start);
			f->skipping = end == limit;
		} else if (!framer_emit(f, at + start, length, f->at + start, pos - start)) {
			return pos;
		}
	}
	return size;
}

/* Index of the next sync in [from, size), or of its beginning at the end; `size`: not found. */
static size_t find_sync(const struct framer *f, const uint8_t *at, size_t from, size_t size)
{
	while ((from = find(at, f->p.sync[0], from, size)) < size) {
		size_t left = size - from;

		if (!memcmp(at + from, f->p.sync, left < f->p.sync_size ? left : f->p.sync_size))
			break;
		from++;
	}
	return from;
}

size_t framer_cut_fixed(struct framer *f, const uint8_t *at, size_t size)
{
	size_t pos = 0, frame = f->p.fixed_size;

	while (pos < size) {
		size_t next = f->p.sync_size ? find_sync(f, at, pos, size) : pos;

		framer_garbage(f, f->at + pos, next - pos);
		pos = next;
		if (size - pos < frame)
			return pos;
		pos += frame;
		if (!framer_emit(f, at + pos - frame, frame, f->at + pos - frame, frame))
			return pos;
	}
	return size;
}

static uint64_t length_of(const struct profile *p, const uint8_t *at)
{
	uint64_t v = 0;

	at += p->length_offset;
	for (uint32_t i = 0; i < p->length_size; i++)
		v |= (uint64_t)at[i] << 8 * (p->length_big_endian ? p->length_size - 1 - i : i);
	return v + p->length_add;
}

size_t framer_cut_length(struct framer *f, const uint8_t *at, size_t size)
{
	size_t pos = 0, head = f->p.length_offset + f->p.length_size;

	while (pos < size) {
		size_t next = f->p.sync_size ? find_sync(f, at, pos, size) : pos;
		uint64_t frame;

		framer_garbage(f, f->at + pos, next - pos);
		pos = next;
		if (size - pos < head)
			return pos;
		frame = length_of(&f->p, at + pos);
		if (frame < head || frame > f->p.telegram_max) { /* no sync, or a false one: continue with the next byte */
			if (f->lost)
				framer_garbage(f, f->at + pos, 1);
			else
				framer_bad(f, FRAMER_LENGTH, f->at + pos, 1);
			f->lost = !f->p.sync_size;
			pos++;
			continue;
		}
		if (size - pos < frame)
			return pos;
		f->lost = false;
		pos += frame;
		if (!framer_emit(f, at + pos - frame, frame, f->at + pos - frame, frame))
			return pos;
	}
	return size;
}
