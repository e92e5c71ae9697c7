/* Any bytes as PTX; the first byte says how it is opened. And every number of it is read as one of fixed places, which must be
 * what the reader of exact numbers says, where that reads it. */
#include <stdlib.h>
#include <string.h>

#include "fuzz_input.h"
#include "input_text_parts.h"

#define AXES "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
#define SAME AXES "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"

static const char *const texts[] = {
	"\1"
	"2\n2\n" SAME "1 2 3 0.5\n0 0 0 0.5\n4 5 6 0.5 1 2 3\n1e3 -2.5 .5 0\n",
	"\2"
	"1\n2\n" AXES "0 1 0 0\n-1 0 0 0\n0 0 1 0\n1000 2000.5 -3 1\n"
	"1.23456789012 2 3 0\nnan nan nan 0\n1\n1\n" SAME "7 8 9 0\n",
	"\1"
	"2\n2\n" SAME "1 2 3 0.5\n4 5 6",
	"\2"
	"2\r\n2\r\n" SAME "1 2 3 0.5\r\n1\n1\n" SAME "7 8 9 0\n1\n1\n0 0",
	"\3"
	"0\n0\n" SAME,
};

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	return fuzz_input_text(texts, sizeof texts / sizeof *texts, i, bytes, room);
}

static void same_number(const char *at, const char *end)
{
	struct input_number exact;
	const char *p = at, *also = at;
	int64_t fixed, v;

	if (input_number_read(&p, end, &exact) != INPUT_NUMBER_OK || exact.deep || exact.exponent < -9)
		return;
	v = exact.mantissa;
	for (int i = exact.exponent; i > -9; i--)
		if (__builtin_mul_overflow(v, 10, &v))
			return;
	if (input_fixed_read(&also, end, 9, INT64_MAX, &fixed) != INPUT_NUMBER_OK || also != p || fixed != v)
		abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	struct input_options options = {.format = NULL};

	if (!size)
		return 0;
	options.accept_truncated = bytes[0] & 2;
	options.format = bytes[0] & 1 ? "ptx" : NULL;
	for (size_t i = 1; i < size; i++)
		if (i == 1 || strchr(" ,\n", bytes[i - 1]))
			same_number((const char *)bytes + i, (const char *)bytes + size);
	fuzz_input_read(bytes + 1, size - 1, "fuzz.ptx", &options);
	return 0;
}
