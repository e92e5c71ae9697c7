/* Any text as a view: canonical (what is taken is written again as it was) and as a request. */
#include <stdlib.h>
#include <string.h>

#include "fuzz_input.h"
#include "lattice.h"
#include "view.h"

static const char *const texts[] = {
	"",
	"view 1",
	"ask 1",
	"view 1 class=2-5,9 returns=last keep-withheld keep-noise drop-overlap",
	"view 1 not-class=7 ground zmin=-5 zmax=12346 every=10 thin=100:median duplicates=highest",
	"view 1 crop=box:63500000,685300001,63510000,685320000",
	"view 1 crop=area:+AAUATU",
	"view 1 crop=area:+AA.CA.CAABC-BBCAAC",
	"ask 1 crop=box:635000.2,-3,635100,4e2",
	"ask 1 crop=area@-2:+AAUATU thin=10ft:lowest every=3",
	"ask 1 not-class=3 class=2-4 zmax=12.3455 zmin=-0.0005",
	"ask 1 thin=0.5:highest returns=first",
	"ask 1 zmin=1e-4000",
};

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	return fuzz_input_text(texts, sizeof texts / sizeof *texts, i, bytes, room);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	static const struct lattice lattice = {.scale_xy = {1, -2}, .scale_z = {1, -3}, .k = {43500000, -5, 0}};
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
	rc = view_resolve(text, &lattice, size & 1 ? "metre" : "unknown", size & 2 ? "foot" : "unknown", &view, &err);
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
