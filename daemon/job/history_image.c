/*
 * The packed image of a job.
 *
 * Format: a bit for each word of struct job that is not zero. Then for each such word a byte with a bit for each of its bytes
 * that is not zero, and these bytes, lowest first. HISTORY_IMAGE_SLACK bytes follow, because unpacking reads whole words.
 */
#include <endian.h>
#include <string.h>

#include "history_image.h"

_Static_assert(sizeof(struct job) % 8 == 0, "packed by words");
enum { WORDS = HISTORY_IMAGE_WORDS, MAP = HISTORY_IMAGE_MAP, SLACK = HISTORY_IMAGE_SLACK };

/* A bit for each byte of the word that is not zero. */
static uint8_t bytes_set(uint64_t word)
{
	const uint64_t low = UINT64_C(0x7f7f7f7f7f7f7f7f);
	uint64_t high = (((word & low) + low) | word) & ~low;

	return (uint8_t)((high >> 7) * UINT64_C(0x0102040810204080) >> 56);
}

/* One of the next eight words is not zero. */
static bool any_word(const uint8_t *at)
{
	uint64_t w[8];

	memcpy(w, at, sizeof w);
	return (w[0] | w[1] | w[2] | w[3]) | (w[4] | w[5] | w[6] | w[7]);
}

size_t history_image_pack(const struct job *job, uint8_t out[HISTORY_IMAGE_MAX])
{
	size_t n = MAP;

	memset(out, 0, MAP);
	for (size_t i = 0; i < WORDS; i++) {
		uint64_t word;
		unsigned mask, first, run;

		if (i % 8 == 0 && i + 8 <= WORDS && !any_word((const uint8_t *)job + 8 * i)) {
			i += 7;
			continue;
		}
		memcpy(&word, (const uint8_t *)job + 8 * i, 8);
		if (!word)
			continue;
		word = htole64(word);
		out[i / 8] |= (uint8_t)(1u << i % 8);
		mask = out[n++] = bytes_set(word);
		first = (unsigned)__builtin_ctz(mask);
		run = mask >> first;
		if (!(run & (run + 1))) { /* they are adjacent, which is usual */
			word = htole64(word >> 8 * first);
			memcpy(out + n, &word, 8);
			n += (unsigned)__builtin_ctz(run + 1);
		} else {
			for (unsigned m = mask; m; m &= m - 1)
				out[n++] = (uint8_t)(word >> 8 * __builtin_ctz(m));
		}
	}
	memset(out + n, 0, SLACK);
	return n + SLACK;
}

void history_image_unpack(const uint8_t *in, struct job *ret)
{
	size_t n = MAP;

	memset(ret, 0, sizeof *ret);
	for (size_t g = 0; g < MAP; g++) {
		for (unsigned set = in[g]; set; set &= set - 1) {
			size_t i = 8 * g + (size_t)__builtin_ctz(set);
			uint64_t word = 0;

			unsigned m = in[n++], first = (unsigned)__builtin_ctz(m), run = m >> first;

			if (!(run & (run + 1))) { /* they are adjacent */
				unsigned bytes = (unsigned)__builtin_ctz(run + 1);

				memcpy(&word, in + n, 8);
				n += bytes;
				word = (le64toh(word) & (UINT64_MAX >> (64 - 8 * bytes))) << 8 * first;
			} else {
				for (; m; m &= m - 1)
					word |= (uint64_t)in[n++] << 8 * __builtin_ctz(m);
			}
			word = le64toh(word);
			memcpy((uint8_t *)ret + 8 * i, &word, 8);
		}
	}
}
