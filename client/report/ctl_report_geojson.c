/* What all files of places have in common: GeoJSON in the plane of the dataset (format_geojson.c has more on "crs"). */
#include <stdio.h>
#include <string.h>

#include "ctl_report.h"
#include "outfile.h"

enum { WGS84 = 4326 };

int ctl_report_geojson_head(struct outfile *out, unsigned epsg, const char *unit_xy, struct err *err)
{
	char crs[128] = "", text[256];
	int n;

	/* Readers take a file without "crs" for degrees. */
	if (epsg && epsg != WGS84)
		snprintf(crs, sizeof crs, "\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"urn:ogc:def:crs:EPSG::%u\"}},\n",
			 epsg);
	else if (!epsg && strcmp(unit_xy, "degree"))
		snprintf(crs, sizeof crs,
			 "\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"LOCAL_CS[\\\"unknown\\\"]\"}},\n");
	n = snprintf(text, sizeof text, "{\"type\":\"FeatureCollection\",\n%s\"features\":[", crs);
	return outfile_write(out, text, (size_t)n, err);
}
