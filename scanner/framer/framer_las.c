/*
 * A stream of consecutive LAS files. The end of each follows from its header and from those of its EVLRs (LAS 1.4 R15,
 * tables 3, 4, 22; for 1.3 its waveform record). Pieces have 64 KiB, so a file may be larger than memory.
 *
 * Only lengths are parsed. Compressed files (LAZ) do not have their length and are reported as such.
 */
#include <string.h>

#include "cursor.h"
#include "framer_parts.h"

enum { HEAD_SOME = 105, EVLR_HEAD = 60 };
static const uint64_t FILE_MOST = UINT64_C(1) << 48;

static uint64_t number(const uint8_t *at, size_t offset, size_t size)
{
	struct cursor c = cursor_of(at + offset, size);

	return size == 2 ? cursor_u16(&c) : size == 4 ? cursor_u32(&c) : cursor_u64(&c);
}

/* Bytes of the header that this version needs. */
static size_t head_size(const uint8_t *at)
{
	return at[25] >= 4 ? 375 : at[25] == 3 ? 235 : 227;
}

/* The file's length as far as the header has it; false: not the header of a file that can be cut. */
static bool read_head(const uint8_t *at, struct las_file *ret)
{
	static const uint8_t record_least[] = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
	static const uint8_t format_most[] = {1, 1, 3, 5, 10};
	unsigned minor = at[25], format = at[104];
	uint64_t offset = number(at, 96, 4), record = number(at, 105, 2), count = number(at, 107, 4), evlr_at = 0, evlrs = 0;

	if (at[24] != 1 || minor > 4 || format > format_most[minor] || record < record_least[format] ||
	    number(at, 94, 2) < head_size(at) || offset < number(at, 94, 2))
		return false;
	if (minor == 4) {
		count = number(at, 247, 8) ? number(at, 247, 8) : count;
		evlr_at = number(at, 235, 8);
		evlrs = number(at, 243, 4);
	} else if (minor == 3 && number(at, 6, 2) & 2) { /* waveforms in this file */
		evlr_at = number(at, 227, 8);
		evlrs = evlr_at != 0;
	}
	if (count > (FILE_MOST - offset) / record)
		return false;
	ret->end = offset + count * record;
	ret->evlrs = (uint32_t)evlrs;
	if (evlrs && (evlr_at < ret->end || evlr_at > FILE_MOST))
		return false;
	if (evlrs)
		ret->end = evlr_at;
	return true;
}

/* LASzip sets the highest bit of the point format; the rest of the header is that of LAS. */
static bool is_laz(const uint8_t *at)
{
	return at[24] == 1 && at[25] <= 4 && at[104] & 0x80;
}

void framer_las_broken(struct framer *f, enum framer_reason reason, uint64_t left)
{
	framer_bad(f, reason, f->las.start, f->las.at + left);
	f->counts.skipped -= f->las.at; /* these bytes are in earlier pieces */
	f->las.inside = false;
	f->las.number++;
}

/* Searches for the next file and returns its place. false: more bytes are needed from there on. */
static bool find_file(struct framer *f, const uint8_t *at, size_t size, size_t *pos)
{
	static const uint8_t magic[] = "LASF";

	while (*pos < size) {
		const uint8_t *p = memchr(at + *pos, 'L', size - *pos);
		size_t next = p ? (size_t)(p - at) : size, left = size - next;
		struct las_file las = {.inside = true, .number = f->las.number, .start = f->at + next};

		framer_garbage(f, f->at + *pos, next - *pos);
		*pos = next;
		if (memcmp(at + next, magic, left < 4 ? left : 4)) {
			framer_garbage(f, f->at + next, 1);
			++*pos;
			continue;
		}
		if (left < HEAD_SOME || left < head_size(at + next))
			return false;
		if (read_head(at + next, &las)) {
			f->las = las;
			return true;
		}
		framer_bad(f, is_laz(at + next) ? FRAMER_LAZ : FRAMER_HEADER, f->at + next, 4);
		*pos += 4;
	}
	return false;
}

enum step { STEP_MORE, STEP_WAIT, STEP_END };

/* The next piece of the file. */
static enum step cut_piece(struct framer *f, const uint8_t *at, size_t size, size_t *pos)
{
	struct las_file *las = &f->las;
	size_t left = size - *pos, piece;

	while (las->evlrs && las->end - las->at + EVLR_HEAD <= FRAMER_PIECE) {
		size_t known = (size_t)(las->end - las->at);
		uint64_t length;

		if (left < known + EVLR_HEAD)
			return STEP_WAIT;
		length = number(at + *pos + known, 20, 8);
		if (length > FILE_MOST || las->end > FILE_MOST) {
			framer_las_broken(f, FRAMER_HEADER, 4);
			*pos += 4; /* continue after its magic number */
			return STEP_MORE;
		}
		las->end += EVLR_HEAD + length;
		las->evlrs--;
	}
	piece = las->end - las->at < FRAMER_PIECE ? (size_t)(las->end - las->at) : FRAMER_PIECE;
	if (left < piece)
		return STEP_WAIT;
	*pos += piece;
	framer_emit(f, at + *pos - piece, piece, f->at + *pos - piece, piece);
	las->at += piece;
	if (las->at == las->end && !las->evlrs) {
		las->inside = false;
		las->number++;
		f->counts.files++;
	}
	return f->result ? STEP_END : STEP_MORE;
}

size_t framer_cut_las(struct framer *f, const uint8_t *at, size_t size)
{
	size_t pos = 0;
	enum step step = STEP_MORE;

	while (pos < size && step == STEP_MORE) {
		if (!f->las.inside && !find_file(f, at, size, &pos))
			break;
		step = cut_piece(f, at, size, &pos);
	}
	return pos;
}
