/*
 * GeoJSON: a feature a contour. RFC 7946 is about degrees; for systems that have another number the older "crs" member names it,
 * as GDAL writes it and GDAL and QGIS read it. A system without a number is in a comment
 * member only; "crs" says then that it is unknown, since readers take a file without it for degrees, and GDAL one with null, too.
 */
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "format_lines.h"
#include "format_text.h"
#include "outfile.h"

enum { TEXT = 1024, POINT = 3 * FORMAT_LINES_NUMBER + 8, WGS84 = 4326 };

static int put(struct format_lines *w, const char *text, struct err *err)
{
	return outfile_write(w->out, text, strlen(text), err);
}

static int put_head(struct format_lines *w, struct err *err)
{
	char text[FORMAT_TEXT_GROWTH * TEXT], buf[FORMAT_TEXT_GROWTH * TEXT + 64];
	int r = put(w, "{\"type\":\"FeatureCollection\",\"name\":\"contours\",\n", err);

	if (!r && !w->epsg && !w->degrees)
		r = put(w, "\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"LOCAL_CS[\\\"unknown\\\"]\"}},\n", err);
	if (!r && w->epsg && w->epsg != WGS84) {
		snprintf(buf, sizeof(buf),
			 "\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"urn:ogc:def:crs:EPSG::%u\"}},\n", w->epsg);
		r = put(w, buf, err);
	}
	for (const char *at = w->comments; at && *at && !r;) {
		size_t n = strcspn(at, "\n"), word = strcspn(at, " \n");
		char line[TEXT];

		snprintf(line, sizeof(line), "%.*s", (int)(n > word ? n - word - 1 : 0), at + word + (n > word));
		snprintf(buf, sizeof(buf), "\"%.*s\":\"%s\",\n", (int)word, at,
			 format_text(FORMAT_TEXT_JSON, line, text, sizeof(text)));
		r = put(w, buf, err);
		at += n + (at[n] == '\n');
	}
	return r ? r : put(w, "\"features\":[", err);
}

static int put_points(struct format_lines *w, const char *height, struct err *err)
{
	const double(*point)[2];
	bool first = true;
	size_t n;
	int r;

	while (!(r = contour_points(w->contour, &point, &n, err)) && n) {
		for (size_t i = 0; i < n; i++) {
			char *start = outfile_room(w->out, POINT, err), *at = start;

			if (!start)
				return -err->code;
			at = stpcpy(at, first ? "[" : ",[");
			at = format_lines_text(w, point[i][0], at);
			*at++ = ',';
			at = format_lines_text(w, point[i][1], at);
			*at++ = ',';
			at = stpcpy(at, height);
			*at++ = ']';
			outfile_used(w->out, (size_t)(at - start));
			first = false;
		}
	}
	return r;
}

static int put_line(struct format_lines *w, const struct contour_line *line, bool first, struct err *err)
{
	char buf[TEXT], height[DECIMAL_TEXT_SIZE], length[FORMAT_LINES_NUMBER];
	int r;

	contour_height_text(w->contour, line->level, height);
	*format_lines_text(w, line->length, length) = 0;
	snprintf(buf, sizeof(buf),
		 "%s\n{\"type\":\"Feature\",\"properties\":{\"elevation\":%s,\"index\":%d,\"closed\":%d,\"length\":%s},"
		 "\"geometry\":{\"type\":\"LineString\",\"coordinates\":[",
		 first ? "" : ",", height, format_lines_is_index(w, line->level), line->closed, length);
	r = put(w, buf, err);
	if (!r)
		r = put_points(w, height, err);
	return r ? r : put(w, "]}}", err);
}

static int put_all(struct format_lines *w, struct err *err)
{
	struct contour_line line;
	bool first = true;
	int r = put_head(w, err);

	while (!r && !(r = format_lines_next(w, &line, err)) && line.points) {
		r = format_lines_room(w, err);
		if (!r)
			r = put_line(w, &line, first, err);
		first = false;
	}
	return r ? r : put(w, "\n]}\n", err);
}

static int geojson_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	return format_lines_open(out, opt, "geojson", put_all, ret, err);
}

const struct format format_geojson = {
	.name = "geojson",
	.extensions = ".geojson",
	.help = "GeoJSON: contours, in the coordinates of the mesh (--interval)",
	.purpose = "scripts, web: contours",
	.open = geojson_open,
	FORMAT_LINES_ROW,
};
