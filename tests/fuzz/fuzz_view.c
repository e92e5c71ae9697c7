/* Any text as a view: canonical (what is taken is written again as it was) and as a request. */
#include <stdlib.h>
#include <string.h>

#include "fuzz_input.h"
#include "lattice.h"
#include "view.h"

static const char *const texts[] = {
	"", "class=2,8", "class=2 keep=withheld,noise", "zmin=1.5 zmax=200", "crop=0,0,100.5,200", "every=10",
	"thin=10m thin-pick=median", "area@-2:0,0,100,0,100,100;", "duplicates=highest", "returns=last",
};

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	struct view view;
	char *text;
	size_t n;

	if (i != 32) {
		return fuzz_input_text(texts, sizeof texts / sizeof *texts, i, bytes, room);
	}
	memset(&view, 0, sizeof view);
	text = view_text(&view);
	n = text && strlen(text) < room ? strlen(text) : 0;
	memcpy(bytes, text ? text : "", n);
	free(text);
	return n;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	static const struct lattice lattice = { .scale_xy = { 1, -2 }, .scale_z = { 1, -3 }, .k = { 43500000, -5, 0 } };
	char *text = malloc(size + 1), *again;
	struct err err = ERR_INIT;
	struct view view;
	int rc;

	if (!text)
		abort();
	memcpy(text, bytes, size);
	text[size] = 0;
	rc = view_parse(text, &view, &err);
	fuzz_input_check(rc, &err);
	if (!rc) {
		again = view_text(&view);
		if (!again || strcmp(again, text))
			abort();
		free(again);
		view_done(&view);
	}
	err = ERR_INIT;
	rc = view_resolve(text, &lattice, size & 1 ? "metre" : "unknown", &view, &err);
	fuzz_input_check(rc, &err);
	if (!rc) {
		struct view same;

		again = view_text(&view);
		if (!again || view_parse(again, &same, &err))
			abort();
		view_done(&same);
		free(again);
		view_done(&view);
	}
	free(text);
	return 0;
}
