/* Any bytes as a text of points. The first byte says which columns, and how it is opened: with decimal commas, as UTF-16,
 * for a lattice; and every number of it is read in both ways of the number reader, which must agree. */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "fuzz_input.h"
#include "input_text_parts.h"

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
	"\6"
	"1,5400073.9,500094.2,109.2,GND\n2,5400074.9,500095.1,109.3,GND\n3,5400073,500099.2,109.1,T\n",
	"\6"
	"Survey 9\nNr;H\xc3\xb6he [m];Rechtswert;Hochwert\n[a] [b] [c]\n1;2;3;4\n",
	"\6"
	"Y X H\n1 2 3\n",
	"\6"
	"lat\tlon\tz (US survey feet)\n1\t2\t3\n",
	"\14"
	"1,5;2,25;-,5\n1.234,5;6;7\n",
	"\14"
	"\"1,5\",\"2,5\",\"3\"\n",
	"\22"
	"1 2 3\r\n4 5 6~}\r\n",
	"\30"
	"X;Y;Z\n1,5;2;3~\n",
	"\0"
	"1 2 3\n1 2 nan\n1,2,\n1 2 1.#QNAN\n4 5 ***\n",
	"\36"
	"1 2 5.400123456789012345678901234567890123e+06\n",
	"\44"
	"1 2 1e-300\n",
	"\52"
	"1 2 3\n\"4\",\"5\",\"\"\n",
	"\0"
	"; a\n! b\n\"# c\"\n1'234.5 1,234.5 6\n",
	"\6"
	"1.0D+02 2.D1 -.5d-1\n",
	"\6"
	"id,x,y,z\n\"a\"!,1,2,3\n",
	"\6"
	"Survey of field\n2024 05 13\n4.5 5 6 GND\n7 8 9.5 GND\n",
	"\6"
	"2024,05,13,survey\nPoint Number,x,y,z,class\n,m,m,ft,-\n1,4,5,6,Ground\n!2,4,5,6,2\n",
	"\6"
	"Point Number Easting Northing Elevation Intensity\n1 2 3 4 5\n",
	"\6"
	"371,13.436,84.743,7.638,GND\n",
	"\6"
	"\"id\",\"E(X)\",\"N(Y)\",\"Z\"\n\"a\",1,2,3\n",
	"\6"
	"0 0 440750 3751290 107\n0 1 440760 3751290 108\n",
};
static const char *const columns[] = {NULL, "xyz", "_yxc", "zyxcrn", "xyzc", "_nez_"};

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	return fuzz_input_text(texts, sizeof texts / sizeof *texts, i, bytes, room);
}

static bool has_exponent(const char *at, const char *end)
{
	for (; at < end; at++)
		if (isalpha((unsigned char)*at))
			return true;
	return false;
}

/* With an exponent of nothing behind it, a number goes the long way. */
static void both_ways(const char *at, const char *end)
{
	struct input_number quick, slow;
	const char *p = at, *also;
	char copy[64];

	if (input_number_read(&p, end, &quick) != INPUT_NUMBER_OK || p - at > 60 || has_exponent(at, p))
		return;
	memcpy(copy, at, (size_t)(p - at));
	memcpy(copy + (p - at), "e0", 2);
	also = copy;
	if (input_number_read(&also, copy + (p - at) + 2, &slow) != INPUT_NUMBER_OK || quick.mantissa != slow.mantissa ||
	    quick.exponent != slow.exponent || quick.written != slow.written)
		abort();
}

enum { MODES = 8, WIDE_MOST = 1 << 16 };

/* What else there is to how a text is read: the first byte divided by the columns. */
static const struct mode {
	bool comma, strict;
	char wide; /* of UTF-16: which end comes first */
	const char *scale;
} modes[MODES] = {
	{.comma = false},
	{.comma = false},
	{.comma = true},
	{.wide = 'l'},
	{.wide = 'b', .comma = true},
	{.scale = "0.025"},
	{.scale = "99999999999999999e-18"},
	{.strict = true},
};

/* The bytes as characters of UTF-16; '~' and '}' become the halves of a pair, which may lack the other one. */
static const uint8_t *wide(const uint8_t *bytes, size_t size, char which, size_t *ret_n)
{
	static uint8_t text[2 * WIDE_MOST + 2];
	size_t n = 0;

	size = size < WIDE_MOST ? size : WIDE_MOST;
	for (size_t i = 0; i <= size; i++) {
		unsigned c = i ? bytes[i - 1] : 0xfeff;

		c = c == '~' ? 0xd8ff : c == '}' ? 0xdcff : c;
		text[n++] = (uint8_t)(which == 'l' ? c : c >> 8);
		text[n++] = (uint8_t)(which == 'l' ? c >> 8 : c);
	}
	*ret_n = n;
	return text;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	struct input_options options = {.planar = true};
	const struct mode *mode;
	size_t n = size - 1;

	if (!size)
		return 0;
	mode = &modes[(bytes[0] & 63) / (sizeof columns / sizeof *columns) % MODES];
	options.decimal_comma = mode->comma;
	options.strict = mode->strict;
	if (mode->scale && (!decimal_parse(mode->scale, &options.scale_xy) || !decimal_parse(mode->scale, &options.scale_z)))
		abort();
	options.accept_truncated = bytes[0] & 64;
	options.columns = columns[(bytes[0] & 63) % (sizeof columns / sizeof *columns)];
	options.format = bytes[0] & 128 ? "pts" : "xyz";
	for (size_t i = 1; i < size; i++)
		if (i == 1 || strchr(" ,;\n", bytes[i - 1]))
			both_ways((const char *)bytes + i, (const char *)bytes + size);
	bytes = mode->wide ? wide(bytes + 1, n, mode->wide, &n) : bytes + 1;
	fuzz_input_read(bytes, n, "fuzz.xyz", &options);
	return 0;
}
