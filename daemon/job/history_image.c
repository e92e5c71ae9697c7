/*
 * The packed image of a job.
 *
 * Format: a bit for each word of struct job that is not zero. Then for each such word a byte (how many zero bytes it begins with,
 * times 16, and how many follow up to its last byte that is not zero), and these, lowest first. HISTORY_IMAGE_SLACK bytes follow,
 * because whole words are written and read.
 */
#include <endian.h>
#include <string.h>

#include "history_image.h"

_Static_assert(sizeof(struct job) % 8 == 0, "packed by words");
enum { WORDS = HISTORY_IMAGE_WORDS, MAP = HISTORY_IMAGE_MAP, SLACK = HISTORY_IMAGE_SLACK };

/* Packs up to eight words. Returns the end of what it wrote. */
static inline uint8_t *pack_words(const void *at, size_t n, uint8_t *map, uint8_t *out)
{
	uint64_t w[8], any = 0;
	unsigned set = 0;

	memcpy(w, at, 8 * n);
	for (size_t i = 0; i < n; i++)
		any |= w[i];
	for (size_t i = 0; any && i < n; i++)
		set |= (unsigned)(w[i] != 0) << i;
	*map = (uint8_t)set;
	for (; set; set &= set - 1) {
		uint64_t word = htole64(w[__builtin_ctz(set)]);
		unsigned first = (unsigned)__builtin_ctzll(word) / 8, bytes = 8 - first - (unsigned)__builtin_clzll(word) / 8;

		*out++ = (uint8_t)(first << 4 | bytes);
		word = htole64(word >> 8 * first);
		memcpy(out, &word, 8);
		out += bytes;
	}
	return out;
}

size_t history_image_pack(const struct job *job, uint8_t out[HISTORY_IMAGE_MAX])
{
	const uint64_t *words = (const void *)job;
	uint8_t *end = out + MAP;
	size_t i = 0;

	for (; i + 8 <= WORDS; i += 8)
		end = pack_words(words + i, 8, &out[i / 8], end);
	if (WORDS % 8)
		end = pack_words(words + i, WORDS % 8, &out[i / 8], end);
	memset(end, 0, SLACK);
	return (size_t)(end - out) + SLACK;
}

void history_image_unpack(const uint8_t *in, struct job *ret)
{
	size_t n = MAP;

	memset(ret, 0, sizeof *ret);
	for (size_t g = 0; g < MAP; g++) {
		for (unsigned set = in[g]; set; set &= set - 1) {
			size_t i = 8 * g + (size_t)__builtin_ctz(set);
			unsigned first = in[n] >> 4, bytes = in[n] & 15;
			uint64_t word;

			memcpy(&word, in + n + 1, 8);
			n += 1 + bytes;
			word = le64toh((le64toh(word) & (UINT64_MAX >> (64 - 8 * bytes))) << 8 * first);
			memcpy((uint8_t *)ret + 8 * i, &word, 8);
		}
	}
}
