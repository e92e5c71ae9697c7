/* Any bytes as a text of points. The first byte says which columns, and how it is opened; and every number of it
 * is read in both ways of the number reader, which must agree. */
#include <stdlib.h>
#include <string.h>

#include "fuzz_input.h"
#include "input_parts.h"

static const char *const texts[] = {
	"\1"
	"1 2 3\n4.5 -5 6e2\n",
	"\2"
	"x,y,z\r\n1,2,3\r\n",
	"\3"
	"7 2.25 1.5 18 3\n",
	"\4"
	"# a\n//X Y Z C\n1 2 3 4\n",
	"\5"
	"2\n1 2 3 -5 1 2 3\n4 5 6\n",
	"\6"
	"\xef\xbb\xbf"
	"id;Northing [m];Easting [m];Height;Class\n7;2;1;3;9\n",
	"\7"
	"123,45 67,8 9,1\n",
	"\10"
	"1, 2, 3\n1,5, 2,5, 3,5\n",
	"\11"
	"\"a, b\",1,2,3\n",
	"\12"
	"0.1234567890123456789 1e-15 1e18\n",
	"\13"
	"1 2 3 2 5 2\n",
};
static const char *const columns[] = {NULL, "xyz", "_yxc", "zyxcrn", "xyzc", "__xyz"};

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	return fuzz_input_text(texts, sizeof texts / sizeof *texts, i, bytes, room);
}

/* With an exponent of nothing behind it, a number goes the long way. */
static void both_ways(const char *at, const char *end)
{
	struct input_number quick, slow;
	const char *p = at, *also;
	char copy[64];

	if (input_number_read(&p, end, &quick) != INPUT_NUMBER_OK || p - at > 60 || memchr(at, 'e', (size_t)(p - at)) ||
	    memchr(at, 'E', (size_t)(p - at)))
		return;
	memcpy(copy, at, (size_t)(p - at));
	memcpy(copy + (p - at), "e0", 2);
	also = copy;
	if (input_number_read(&also, copy + (p - at) + 2, &slow) != INPUT_NUMBER_OK || quick.mantissa != slow.mantissa ||
	    quick.exponent != slow.exponent || quick.written != slow.written)
		abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	struct input_options options = {.planar = true};

	if (!size)
		return 0;
	options.accept_truncated = bytes[0] & 64;
	options.columns = columns[(bytes[0] & 63) % (sizeof columns / sizeof *columns)];
	options.format = bytes[0] & 128 ? "pts" : "xyz";
	for (size_t i = 1; i < size; i++)
		if (i == 1 || strchr(" ,;\n", bytes[i - 1]))
			both_ways((const char *)bytes + i, (const char *)bytes + size);
	fuzz_input_read(bytes + 1, size - 1, "fuzz.xyz", &options);
	return 0;
}
