/*
 * Converts the bytes of a text to what the reader of lines expects: UTF-8 with decimal points.
 *
 * Model: UTF-16 is recognised by its byte order mark. It is converted to UTF-8 piece by piece as it is read; half a character
 * is kept until the rest of it comes. Invalid characters become U+FFFD, which is not a digit, so that they are an error in place
 * of a number. With --decimal-comma a comma beside a digit becomes a point when its line is returned, and a point becomes MARK,
 * so that 1.234,5 is not read as a number. Messages convert both back. Not here: other encodings, which differ from ASCII in
 * letters only.
 */
#include "input_text_parts.h"

#include <ctype.h>
#include <string.h>

#include "io.h"

enum { MARK = 1, RAW = 64 * 1024 };

/* ---- UTF-16 ---- */

static enum input_encoding by_mark(const uint8_t *bytes, size_t n)
{
	if (n < 2)
		return INPUT_UTF8;
	if (bytes[0] == 0xff && bytes[1] == 0xfe)
		return n >= 4 && !bytes[2] && !bytes[3] ? INPUT_UTF32 : INPUT_UTF16_LE;
	if (bytes[0] == 0xfe && bytes[1] == 0xff)
		return INPUT_UTF16_BE;
	if (n >= 4 && !memcmp(bytes, "\0\0\xfe\xff", 4))
		return INPUT_UTF32;
	return n >= 4 && (bytes[0] ? !bytes[1] && bytes[2] && !bytes[3] : bytes[1] && !bytes[2] && bytes[3]) ?
		       INPUT_UTF16_UNMARKED :
		       INPUT_UTF8;
}

static unsigned unit_at(const uint8_t *p, enum input_encoding e)
{
	return e == INPUT_UTF16_LE ? p[0] | (unsigned)p[1] << 8 : p[1] | (unsigned)p[0] << 8;
}

static size_t put(uint8_t *to, unsigned c)
{
	if (c < 0x80) {
		to[0] = (uint8_t)c;
		return 1;
	}
	if (c < 0x800) {
		to[0] = (uint8_t)(0xc0 | c >> 6);
		to[1] = (uint8_t)(0x80 | (c & 63));
		return 2;
	}
	if (c < 0x10000) {
		to[0] = (uint8_t)(0xe0 | c >> 12);
		to[1] = (uint8_t)(0x80 | (c >> 6 & 63));
		to[2] = (uint8_t)(0x80 | (c & 63));
		return 3;
	}
	to[0] = (uint8_t)(0xf0 | c >> 18);
	to[1] = (uint8_t)(0x80 | (c >> 12 & 63));
	to[2] = (uint8_t)(0x80 | (c >> 6 & 63));
	to[3] = (uint8_t)(0x80 | (c & 63));
	return 4;
}

/* At most 3 bytes for 2. *ret_used: up to 3 bytes stay, unless it is the end. */
static size_t decode(enum input_encoding e, const uint8_t *from, size_t n, bool end, uint8_t *to, size_t *ret_used)
{
	size_t at = 0, out = 0;

	while (at + 2 <= n) {
		unsigned c = unit_at(from + at, e), low;

		if (c >= 0xd800 && c < 0xdc00) {
			if (at + 4 > n && !end)
				break;
			low = at + 4 <= n ? unit_at(from + at + 2, e) : 0;
			if (low >= 0xdc00 && low < 0xe000) {
				out += put(to + out, 0x10000 + ((c - 0xd800) << 10) + (low - 0xdc00));
				at += 4;
				continue;
			}
		}
		out += put(to + out, c >= 0xd800 && c < 0xe000 ? 0xfffd : c);
		at += 2;
	}
	if (end && at < n) {
		out += put(to + out, 0xfffd);
		at = n;
	}
	*ret_used = at;
	return out;
}

size_t input_encoding_sniff(uint8_t *buffer, size_t n)
{
	uint8_t raw[INPUT_SNIFF];
	enum input_encoding e = by_mark(buffer, n);
	size_t used;

	if (n > sizeof raw || (e != INPUT_UTF16_LE && e != INPUT_UTF16_BE))
		return n;
	memcpy(raw, buffer, n);
	return decode(e, raw, n, false, buffer, &used);
}

int input_encoding_look(struct input *in, struct err *err)
{
	struct input_xyz *xyz = input_xyz_of(in);
	uint8_t first[4];
	size_t n;
	int rc = io_read_some(in->fd, first, sizeof first, 0, in->name, &n, err);

	if (rc)
		return rc;
	xyz->encoding = by_mark(first, n);
	xyz->n_half = 0;
	if (xyz->encoding != INPUT_UTF32 && xyz->encoding != INPUT_UTF16_UNMARKED)
		return 0;
	input_fail(in, err, ERR_INPUT, 0, NULL,
		   xyz->encoding == INPUT_UTF32 ? "a text in UTF-32" : "a text in UTF-16 without a byte order mark");
	return err_add_hint(err, "write it as UTF-8, as with iconv -t UTF-8; UTF-16 is read if it begins with a byte order mark");
}

int input_encoding_fill(struct input *in, size_t kept, input_fill_fn *read, size_t *ret_raw, size_t *ret_n, struct err *err)
{
	struct input_xyz *xyz = input_xyz_of(in);
	uint8_t *raw = in->buffer + sizeof in->buffer - RAW, *to = in->buffer + kept;
	size_t n, used;
	int rc;

	if (xyz->encoding == INPUT_UTF8) {
		rc = read(in, to, sizeof in->buffer - kept, ret_raw, err);
		*ret_n = *ret_raw;
		return rc;
	}
	/* what is decoded ends before `raw` begins: a line kept, and 3 bytes for 2 */
	memcpy(raw, xyz->half, xyz->n_half);
	rc = read(in, raw + xyz->n_half, RAW - xyz->n_half, ret_raw, err);
	if (rc)
		return rc;
	n = xyz->n_half + *ret_raw;
	*ret_n = decode(xyz->encoding, raw, n, xyz->ended, to, &used);
	xyz->n_half = n - used;
	memcpy(xyz->half, raw + used, xyz->n_half);
	return 0;
}

/* ---- decimal commas ---- */

static bool is_digit(const char *p, const char *from, const char *end)
{
	return p >= from && p < end && isdigit((unsigned char)*p);
}

void input_encoding_commas(char *at, char *end)
{
	for (char *p = at; p < end; p++)
		if (*p == '.')
			*p = MARK;
		else if (*p == ',' && (is_digit(p - 1, at, end) || is_digit(p + 1, at, end)))
			*p = '.';
}

char input_encoding_shown(const struct input *in, char c)
{
	if (!in->decimal_comma)
		return c;
	return c == '.' ? ',' : c == MARK ? '.' : c;
}
