/* Any bytes as a LAS or LAZ file: header, records before and behind the points, chunk table, points, parts. The
 * last byte says how it is opened. */
#include <stdlib.h>
#include <string.h>

#include "fixture.h"
#include "fuzz_input.h"

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	static const char wkt[] = "PROJCS[\"x\",GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.2]],"
				  "PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174]],UNIT[\"metre\",1]]";
	const struct las_spec spec = {.minor = i % 6,
				      .format = i % 11,
				      .n = 3,
				      .extra = i % 3,
				      .gap = i % 5,
				      .wkt = i & 1 ? wkt : NULL,
				      .wkt_behind = (i & 1) && i % 6 > 3,
				      .encoding = i & 1 ? 16 : 0};
	struct bytes las;
	size_t n;

	if (i >= 32 || (i < 22 && i % 11 > 5 && i % 6 < 4))
		return 0;
	/* from 22 on points in compatibility mode */
	las = i < 22 ? fixture_las(&spec) :
		       fixture_compat(&(struct las_spec){.minor = 4, .format = 6 + i % 5, .n = 3, .extra = i % 2}, i >= 27);
	n = las.size < room ? las.size : 0;
	memcpy(bytes, las.at, n);
	free(las.at);
	return n;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	uint8_t how = size ? bytes[size - 1] : 0;
	const struct input_options options = {
		.accept_truncated = how & 1, .planar = !(how & 2), .has_crop = how & 4, .crop = {0, 0, 1000, 1000}};

	fuzz_input_read(bytes, size, "fuzz.laz", &options);
	return 0;
}
