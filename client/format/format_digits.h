/*
 * Decimal digits of whole numbers, eight at a time without a loop: a word is split into halves of four digits, these into
 * pairs, these into digits, all parts at once by a multiplication. Up to 8 bytes after the text may be overwritten.
 */
#ifndef FORMAT_DIGITS_H
#define FORMAT_DIGITS_H

#include <stdint.h>
#include <string.h>

/* The digits of n < 10^8, the first in the lowest byte, as numbers. */
static inline uint64_t format_digits_8(uint32_t n)
{
	uint64_t halves = n / 10000 | (uint64_t)(n % 10000) << 32;
	uint64_t high = (halves * 10486) >> 20 & 0x7f0000007f; /* of 100, exact below 10^4 */
	uint64_t pairs = high | (halves - 100 * high) << 16;
	uint64_t tens = (pairs * 103) >> 10 & 0x000f000f000f000f; /* of 10, exact below 100 */

	return tens | (pairs - 10 * tens) << 8;
}

/* The last n digits of a number below 10^8; 1 <= n <= 8. */
static inline char *format_digits_last(uint32_t number, int n, char *at)
{
	uint64_t text = (format_digits_8(number) | 0x3030303030303030) >> (64 - 8 * n);

	memcpy(at, &text, 8);
	return at + n;
}

static inline char *format_digits_put(uint64_t n, char *at)
{
	uint64_t digits;
	int zeros;

	if (n >= 100000000) {
		at = format_digits_put(n / 100000000, at);
		return format_digits_last((uint32_t)(n % 100000000), 8, at);
	}
	digits = format_digits_8((uint32_t)n);
	zeros = digits ? __builtin_ctzll(digits) / 8 : 7;
	digits = (digits | 0x3030303030303030) >> 8 * zeros;
	memcpy(at, &digits, 8);
	return at + 8 - zeros;
}

#endif
