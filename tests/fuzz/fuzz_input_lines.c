/* Any bytes as a text of lines; the first byte says how it is opened. */
#include <stdlib.h>
#include <string.h>

#include "fuzz_input.h"

static const char *const texts[] = {
	"\1acut-lines 1\nfeature 17 hard\nline\n1.25 2 3.5\n-4 5.5 6\nring\n0 0 1\n9 0 1\n9 9 1\n",
	"\2acut-lines 1\ncrs EPSG:2154\nunit m\nunit-z m\ndensify 5 m\nlake-level min\n# a row\nfeature 1 lake\nring\n"
	"583421.37 6512345.10 212.450\n583422.37 6512345.10 212.5\n583422.37 6512346.10 212.5\n",
	"\3acut-lines 1\r\ncrs a name, of its own\r\ndensify 16ftUS\r\nfeature 1 boundary\r\nring\r\n1e3 2 3\r\n4 5 6\r\n7 8 9",
	"\1acut-lines 1\nunit ft\nfeature 2 hole\nring\n1.12345678901234567890 0 0\n1 0 0\n0 1 0\n",
};

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	return fuzz_input_text(texts, sizeof texts / sizeof *texts, i, bytes, room);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	struct input_options options = {.format = NULL};

	if (!size)
		return 0;
	options.degrees = bytes[0] & 2;
	options.format = bytes[0] & 1 ? "lines" : NULL;
	fuzz_input_read(bytes + 1, size - 1, "fuzz.lines", &options);
	return 0;
}
