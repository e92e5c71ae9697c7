/*
 * Numbers of text files, exactly: digits become an integer and a power of ten, nothing is rounded.
 *
 * Model: zeros are held back until a digit follows them, so that neither "0.000" nor "1.5000000000000000"
 * costs digits that mean nothing. What does not fit 18 digits, or has some below 10^-15, is deep: its first digits are
 * given, and all of them on request (input_number_digits), from the text. */
#include "input_text_parts.h"

enum { DIGITS_MAX = 18, DIGITS_DEEP = 36, PLACE_MIN = -15, PLACE_MAX = 18, EXPONENT_MAX = 9999 };

static const uint64_t power[DIGITS_MAX + 1] = {
	1ull,
	10ull,
	100ull,
	1000ull,
	10000ull,
	100000ull,
	1000000ull,
	10000000ull,
	100000000ull,
	1000000000ull,
	10000000000ull,
	100000000000ull,
	1000000000000ull,
	10000000000000ull,
	100000000000000ull,
	1000000000000000ull,
	10000000000000000ull,
	100000000000000000ull,
	1000000000000000000ull,
};

struct digits {
	uint64_t mantissa;
	unsigned n, held, fraction; /* significant digits, zeros held back, digits behind the point */
	unsigned dropped;           /* digits that did not fit */
	bool any;
};

static inline void digits_read(const char **at, const char *end, struct digits *d, bool fraction)
{
	const char *p = *at;

	for (; p < end && (unsigned char)(*p - '0') < 10; p++) {
		unsigned digit = (unsigned char)(*p - '0');

		if (!digit) {
			d->held += d->n != 0;
			continue;
		}
		if (d->dropped || d->n + d->held + 1 > DIGITS_MAX) {
			d->dropped += d->held + 1;
			d->held = 0;
			continue;
		}
		d->mantissa = d->mantissa * power[d->held + 1] + digit;
		d->n += d->held + 1;
		d->held = 0;
	}
	d->any |= p > *at;
	if (fraction)
		d->fraction = (unsigned)(p - *at);
	*at = p;
}

/* The letter, sign, digits. False if digits are missing. Clamped far outside of what is accepted. */
static bool exponent_read(const char **at, const char *end, int *ret)
{
	const char *p = *at + 1, *first;
	bool negative = false;
	int n = 0;

	if (p < end && (*p == '+' || *p == '-'))
		negative = *p++ == '-';
	first = p;
	for (; p < end && (unsigned char)(*p - '0') < 10; p++)
		n = n < EXPONENT_MAX ? n * 10 + (*p - '0') : n;
	if (p == first)
		return false;
	*at = p;
	*ret = negative ? -n : n;
	return true;
}

static bool word_is(const char *p, const char *end, const char *word)
{
	for (; *word; word++, p++)
		if (p == end || (*p | 0x20) != *word)
			return false;
	return true;
}

/* Most numbers: sign, at most 18 digits, a point among them, at most 15 behind it. False: read it the long
 * way, from the start. */
static inline bool read_plain(const char **at, const char *end, struct input_number *ret)
{
	const char *p = *at, *first, *point = NULL;
	bool negative = p < end && *p == '-';
	uint64_t m = 0;
	int places;

	p += negative;
	first = p;
	if (end - p > DIGITS_MAX + 1)
		end = p + DIGITS_MAX + 1; /* what goes on there is not plain */
	for (; p < end; p++) {
		unsigned digit = (unsigned char)(*p - '0');

		if (digit < 10)
			m = m * 10 + digit;
		else if (*p == '.' && !point)
			point = p;
		else
			break;
	}
	places = point ? (int)(p - point) - 1 : 0;
	if (p - first - (point != NULL) < 1 || p - first > DIGITS_MAX || places > -PLACE_MIN ||
	    (p < end && input_number_exponent_at(*p, point != NULL)))
		return false;
	ret->written = ret->exponent = -places;
	if (!m)
		ret->exponent = 0;
	for (; m && m % 10 == 0; m /= 10)
		ret->exponent++;
	ret->mantissa = negative ? -(int64_t)m : (int64_t)m;
	ret->deep = false;
	*at = p;
	return true;
}

enum input_number_state input_number_read(const char **at, const char *end, struct input_number *ret)
{
	const char *p = *at;
	struct digits d = {.mantissa = 0};
	bool negative = false, point = false;
	int exponent = 0, place;

	if (read_plain(at, end, ret))
		return INPUT_NUMBER_OK;
	if (p < end && (*p == '+' || *p == '-'))
		negative = *p++ == '-';
	digits_read(&p, end, &d, false);
	point = p < end && *p == '.';
	if (point) {
		p++;
		digits_read(&p, end, &d, true);
	}
	if (!d.any)
		return word_is(p, end, "nan") || word_is(p, end, "inf") ? INPUT_NUMBER_NOT_FINITE : INPUT_NUMBER_BAD;
	if (p < end && input_number_exponent_at(*p, point) && !exponent_read(&p, end, &exponent))
		return INPUT_NUMBER_BAD;
	place = exponent - (int)d.fraction;
	if (d.mantissa && place + (int)(d.held + d.dropped + d.n) > PLACE_MAX + 1)
		return INPUT_NUMBER_TOO_LONG;
	ret->mantissa = negative ? -(int64_t)d.mantissa : (int64_t)d.mantissa;
	ret->exponent = d.mantissa ? place + (int)(d.held + d.dropped) : 0;
	ret->written = place < 0 ? place : 0;
	ret->deep = d.dropped || (d.mantissa && place + (int)d.held < PLACE_MIN);
	ret->at = *at;
	ret->length = (uint16_t)(p - *at);
	*at = p;
	return INPUT_NUMBER_OK;
}

/* The digits of a deep number. The text was parsed before, so it has only digits and an exponent. */
static struct input_digits digits_of_text(const char *p, const char *end)
{
	struct input_digits d = {.negative = *p == '-'};
	bool fraction = false;
	unsigned n = 0;
	int e = 0;

	for (; p < end && !input_number_exponent_at(*p, true); p++) {
		unsigned digit = (unsigned char)(*p - '0');

		fraction |= *p == '.';
		if (digit > 9)
			continue;
		if (n < DIGITS_DEEP) {
			d.mantissa = d.mantissa * 10 + digit;
			n += n || digit;
			d.exponent -= fraction;
		} else {
			d.more |= digit != 0;
			d.exponent += !fraction;
		}
	}
	if (p < end)
		exponent_read(&p, end, &e);
	d.exponent += e;
	return d;
}

struct input_digits input_number_digits(const struct input_number *n)
{
	struct input_digits d = {.exponent = n->exponent, .negative = n->mantissa < 0};

	if (n->deep)
		return digits_of_text(n->at, n->at + n->length);
	d.mantissa = (uint64_t)(d.negative ? -n->mantissa : n->mantissa);
	return d;
}
