/* Any text as the file of --crop: GeoJSON and WKT. */
#include <stdlib.h>
#include <string.h>

#include "ctl_area.h"
#include "fuzz_input.h"
#include "json_reader.h"

static const char *const texts[] = {
	"{\"type\":\"Polygon\",\"coordinates\":[[[0,0],[10,0],[10,10.5],[0,0]],[[1,1],[2,1],[2,2],[1,1]]]}",
	"{\"type\":\"FeatureCollection\",\"features\":[{\"type\":\"Feature\",\"properties\":{\"a\":[1,null,true]},"
	"\"geometry\":{\"type\":\"MultiPolygon\",\"coordinates\":[[[[0,0],[1e2,0],[1,-1.5E-3],[0,0]]]]}}]}",
	"{\"type\":\"GeometryCollection\",\"geometries\":[]}",
	"{\"type\":\"FeatureCollection\",\"features\":[{\"type\":\"Feature\",\"properties\":{\"a\":\"x\"},\"geometry\":null},"
	"{\"geometry\":{\"type\":\"Polygon\",\"coordinates\":[[[0,0],[1,0],[1,1]]]},\"properties\":{\"a\":12},\"type\":\"Feature\"}]}",
	"POLYGON((0 0, 10 0, 10 10, 0 0),(1 1,2 1,2 2,1 1))",
	"MULTIPOLYGON (((0 0,1 0,1 1,0 0)),((5 5,6 5,6 6,5 5)))",
	"POLYGON Z((0 0 1,1 0 2,1 1 3,0 0 1))",
	"POLYGON EMPTY",
	"GEOMETRYCOLLECTION(POLYGON((0 0,1 0,1 1,0 0)))",
	"{\"type\":\"Polygon\",\"coordinates\":[[]]}",
};

size_t fuzz_seed(unsigned i, uint8_t *bytes, size_t room)
{
	return fuzz_input_text(texts, sizeof texts / sizeof *texts, i, bytes, room);
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size)
{
	static struct json_reader json;
	static FILE *sink;
	char *text = malloc(size ? size : 1);

	if (!sink)
		sink = fopen("/dev/null", "w");
	if (!text || !sink)
		abort();
	memcpy(text, bytes, size);
	for (int wkt = 0; wkt < 2; wkt++) {
		struct ctl_area area = {.name_field = "a"};
		struct err err = ERR_INIT;
		int rc;

		text_source_memory(&json.source, text, size, &err);
		rc = wkt ? ctl_area_wkt(&json.source, &area, &err) : ctl_area_json(&json, &area, &err);

		if (!rc)
			rc = ctl_area_print(&area, sink, &err);
		fuzz_input_check(rc, &err);
		/* each ring is of a feature */
		if (!rc && area.nring && (!area.nfeature || area.feature[0].ring))
			abort();
		for (size_t i = 1; i < area.nfeature; i++)
			if (area.feature[i].ring < area.feature[i - 1].ring || area.feature[i].ring > area.nring)
				abort();
		for (size_t i = 0; i < area.nfeature; i++)
			if (strlen(ctl_area_name(&area, i)) > CTL_AREA_NAME)
				abort();
		ctl_area_done(&area);
	}
	free(text);
	return 0;
}
