/*
 * DXF of release 12, ASCII: a contour is a POLYLINE in space, on a layer of its height: CONTOUR_12_5, or INDEX_15. Release 12 has
 * neither units nor coordinate systems: comments (code 999) name them. Names of layers have letters, digits, "$", "-" and "_"
 * only, so a decimal point is "_".
 */
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "format_lines.h"
#include "format_text.h"
#include "outfile.h"

enum { LAYER = DECIMAL_TEXT_SIZE + 16, VERTEX = 3 * FORMAT_LINES_NUMBER + LAYER + 64 };

static int put(struct format_lines *w, const char *text, struct err *err)
{
	return outfile_write(w->out, text, strlen(text), err);
}

static int put_comments(struct format_lines *w, struct err *err)
{
	char line[FORMAT_COMMENT], text[FORMAT_COMMENT];
	int r = 0;

	for (const char *at = w->comments; at && *at && !r;) {
		size_t n = strcspn(at, "\n");

		snprintf(line, sizeof(line), "%.*s", (int)n, at);
		r = put(w, "999\n", err);
		if (!r)
			r = put(w, format_text(FORMAT_TEXT_ASCII, line, text, sizeof(text)), err);
		if (!r)
			r = put(w, "\n", err);
		at += n + (at[n] == '\n');
	}
	return r;
}

static char *layer_of(const struct format_lines *w, int64_t level, char buf[LAYER])
{
	char height[DECIMAL_TEXT_SIZE];

	snprintf(buf, LAYER, "%s_%s", format_lines_is_index(w, level) ? "INDEX" : "CONTOUR",
		 contour_height_text(w->contour, level, height));
	for (char *at = buf; *at; at++)
		*at = *at == '.' ? '_' : *at;
	return buf;
}

static int put_layers(struct format_lines *w, struct err *err)
{
	int64_t range[2] = {0, -1};
	char buf[LAYER + 128], layer[LAYER];
	int r;

	contour_range(w->contour, range);
	snprintf(buf, sizeof(buf), "0\nTABLE\n2\nLAYER\n70\n%lld\n0\nLAYER\n2\n0\n70\n64\n62\n7\n6\nCONTINUOUS\n",
		 (long long)(range[1] - range[0] < 32765 ? range[1] - range[0] + 2 : 32767)); /* "at most", 16 bits */
	r = put(w, buf, err);
	for (int64_t i = range[0]; i <= range[1] && !r; i++) {
		snprintf(buf, sizeof(buf), "0\nLAYER\n2\n%s\n70\n64\n62\n%d\n6\nCONTINUOUS\n", layer_of(w, i, layer),
			 format_lines_is_index(w, i) ? 1 : 7);
		r = put(w, buf, err);
	}
	return r ? r : put(w, "0\nENDTAB\n", err);
}

static int put_points(struct format_lines *w, const struct contour_line *line, const char *layer, const char *height,
		      struct err *err)
{
	uint64_t most = line->points - line->closed; /* the flag closes it */
	const double(*point)[2];
	size_t n;
	int r;

	while (!(r = contour_points(w->contour, &point, &n, err)) && n) {
		for (size_t i = 0; i < n && most; i++, most--) {
			char *start = outfile_room(w->out, VERTEX, err), *at = start;

			if (!start)
				return -err->code;
			at = stpcpy(stpcpy(at, "0\nVERTEX\n8\n"), layer);
			at = format_lines_text(w, point[i][0], stpcpy(at, "\n10\n"));
			at = format_lines_text(w, point[i][1], stpcpy(at, "\n20\n"));
			at = stpcpy(stpcpy(at, "\n30\n"), height);
			at = stpcpy(at, "\n70\n32\n");
			outfile_used(w->out, (size_t)(at - start));
		}
	}
	return r;
}

static int put_line(struct format_lines *w, const struct contour_line *line, struct err *err)
{
	char buf[2 * LAYER + 128], layer[LAYER], height[DECIMAL_TEXT_SIZE];
	int r;

	layer_of(w, line->level, layer);
	contour_height_text(w->contour, line->level, height);
	snprintf(buf, sizeof(buf), "0\nPOLYLINE\n8\n%s\n66\n1\n10\n0.0\n20\n0.0\n30\n%s\n70\n%d\n", layer, height,
		 8 + line->closed);
	r = put(w, buf, err);
	if (!r)
		r = put_points(w, line, layer, height, err);
	snprintf(buf, sizeof(buf), "0\nSEQEND\n8\n%s\n", layer);
	return r ? r : put(w, buf, err);
}

static int put_all(struct format_lines *w, struct err *err)
{
	struct contour_line line;
	int r = put_comments(w, err);

	if (!r)
		r = put(w,
			"0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1009\n0\nENDSEC\n0\nSECTION\n2\nTABLES\n0\nTABLE\n2\nLTYPE\n70\n1\n0\n"
			"LTYPE\n2\nCONTINUOUS\n70\n64\n3\nSolid line\n72\n65\n73\n0\n40\n0.0\n0\nENDTAB\n",
			err);
	if (!r)
		r = put_layers(w, err);
	if (!r)
		r = put(w, "0\nENDSEC\n0\nSECTION\n2\nENTITIES\n", err);
	while (!r && !(r = format_lines_next(w, &line, err)) && line.points) {
		r = format_lines_room(w, err);
		if (!r)
			r = put_line(w, &line, err);
	}
	return r ? r : put(w, "0\nENDSEC\n0\nEOF\n", err);
}

static int dxf_contours_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	return format_lines_open(out, opt, "dxf-contours", put_all, ret, err);
}

const struct format format_dxf_contours = {
	.name = "dxf-contours",
	.extensions = "",
	.help = "DXF R12: contours, a POLYLINE each, on layers by height; of a .dxf with --interval",
	.purpose = "CAD: contours",
	.open = dxf_contours_open,
	FORMAT_LINES_ROW,
};
