/*
 * Numbers of text files as multiples of a fixed decimal place. Numbers with more digits are rounded once.
 *
 * Model: the digits up to the place are the integer. The first digit after it decides how the integer is rounded, half away
 * from zero. No double is used, so the result depends on the number alone, however it is written ("0.1", "1e-1",
 * "0.10000000000000001"). Numbers that are too large are an error, never clamped.
 */
#include "input_text_parts.h"

enum { EXPONENT_MOST = 9999 };

/* The part before an exponent: digits from `first` to `end`, the point among them at `point` or behind them. */
struct digits {
	const char *first, *end, *point;
	unsigned n;
};

static bool is_digit(char c)
{
	return (unsigned char)(c - '0') < 10;
}

static struct digits find_digits(const char *p, const char *end)
{
	struct digits d = {.first = p};

	for (; p < end && (is_digit(*p) || (*p == '.' && !d.point)); p++) {
		d.n += *p != '.';
		if (*p == '.')
			d.point = p;
	}
	d.end = p;
	if (!d.point)
		d.point = p;
	return d;
}

/* False: there are no digits behind the letter. */
static bool read_exponent(const char **at, const char *end, bool point, int *ret)
{
	const char *p = *at;
	bool negative = false;
	int n = 0;

	if (p == end || !input_number_exponent_at(*p, point))
		return true;
	if (++p < end && (*p == '+' || *p == '-'))
		negative = *p++ == '-';
	if (p == end || !is_digit(*p))
		return false;
	for (; p < end && is_digit(*p); p++)
		n = n < EXPONENT_MOST ? 10 * n + (*p - '0') : n;
	*at = p;
	*ret = negative ? -n : n;
	return true;
}

static bool append(int64_t *v, int digit, int64_t most)
{
	return !__builtin_mul_overflow(*v, 10, v) && !__builtin_add_overflow(*v, digit, v) && *v <= most;
}

/* The digits times 10^exponent, in units of 10^-places. False: more than `most`. */
static bool compose(struct digits d, int exponent, int places, int64_t most, int64_t *ret)
{
	int place = (int)(d.point - d.first) + exponent; /* of the next digit, plus one */
	int64_t v = 0;
	bool up = false;

	for (const char *p = d.first; p < d.end; p++) {
		if (*p == '.')
			continue;
		if (--place < -places) {
			up = place == -places - 1 && *p >= '5';
			break;
		}
		if (!append(&v, *p - '0', most))
			return false;
	}
	for (; v && place > -places; place--)
		if (!append(&v, 0, most))
			return false;
	*ret = v + up;
	return *ret <= most;
}

static bool is_word(const char *p, const char *end, const char *word)
{
	for (; *word; word++, p++)
		if (p == end || (*p | 0x20) != *word)
			return false;
	return true;
}

enum input_number_state input_fixed_read(const char **at, const char *end, int places, int64_t most, int64_t *ret)
{
	const char *p = *at;
	bool negative = false;
	struct digits d;
	int exponent = 0;

	if (p < end && (*p == '+' || *p == '-'))
		negative = *p++ == '-';
	d = find_digits(p, end);
	if (!d.n)
		return is_word(p, end, "nan") || is_word(p, end, "inf") ? INPUT_NUMBER_NOT_FINITE : INPUT_NUMBER_BAD;
	p = d.end;
	if (!read_exponent(&p, end, d.point < d.end, &exponent))
		return INPUT_NUMBER_BAD;
	if (!compose(d, exponent, places, most, ret))
		return INPUT_NUMBER_TOO_LONG;
	if (negative)
		*ret = -*ret;
	*at = p;
	return INPUT_NUMBER_OK;
}
