/*
 * Runs a fuzz target without a fuzzer: on valid inputs of the target itself, changed at random. With clang the same
 * targets are linked with -fsanitize=fuzzer instead.
 *
 *   fuzz_X RUNS [SEED]
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fuzz.h"

enum { ROOM = 1 << 17 };

static uint64_t state = 1;

static uint32_t roll(size_t n)
{
	state ^= state << 13;
	state ^= state >> 7;
	state ^= state << 17;
	return n > 0 ? (uint32_t)((state >> 32) % n) : 0;
}

static size_t change(uint8_t *bytes, size_t n)
{
	static const uint8_t edge[] = {0, 1, 0x7f, 0x80, 0xff};
	size_t at = roll(n), span = 1 + roll(8);

	if (n == 0 || at + span > n)
		return n;
	switch (roll(6)) {
	case 0:
		bytes[at] ^= (uint8_t)(1u << roll(8));
		break;
	case 1:
		bytes[at] = (uint8_t)roll(256);
		break;
	case 2:
		memset(bytes + at, edge[roll(sizeof edge)], span);
		break;
	case 3: /* removed */
		memmove(bytes + at, bytes + at + span, n - at - span);
		return n - span;
	case 4: /* repeated */
		if (n + span > ROOM)
			return n;
		memmove(bytes + at + span, bytes + at, n - at);
		return n + span;
	default: /* truncated */
		return roll(8) == 0 ? at : n;
	}
	return n;
}

int main(int argc, char **argv)
{
	static uint8_t bytes[ROOM];
	unsigned long runs = argc > 1 ? strtoul(argv[1], NULL, 10) : 10000;

	state = argc > 2 ? strtoull(argv[2], NULL, 10) : 88172645463325252u;
	for (unsigned long i = 0; i < runs; i++) {
		size_t n = fuzz_seed((unsigned)i, bytes, ROOM);

		for (unsigned k = roll(6); k > 0; k--)
			n = change(bytes, n);
		LLVMFuzzerTestOneInput(bytes, n);
	}
	printf("%lu inputs\n", runs);
	return 0;
}
