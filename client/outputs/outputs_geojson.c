/* See outputs_geojson.h. */
#include "outputs_geojson.h"

#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "format_axis.h"

int outputs_page_start(struct outputs_page *p, struct err *err)
{
	p->text = NULL;
	p->f = open_memstream(&p->text, &p->size);
	return p->f ? 0 : err_set(err, ERR_NOMEM, "no memory for an index");
}

int outputs_page_end(struct outputs_page *p, struct outfile *to, struct err *err)
{
	int r = fclose(p->f) ? err_set(err, ERR_NOMEM, "no memory for an index") : outputs_beside_write(to, p->text, err);

	free(p->text);
	return r;
}

void outputs_geojson_text(FILE *f, const char *text)
{
	if (!text || !*text) {
		fputs("null", f);
		return;
	}
	fputc('"', f);
	for (const unsigned char *at = (const unsigned char *)text; *at; at++) {
		if (*at == '"' || *at == '\\')
			fprintf(f, "\\%c", *at);
		else if (*at < ' ' || *at == 0x7f)
			fprintf(f, "\\u%04x", *at);
		else
			fputc(*at, f);
	}
	fputc('"', f);
}

void outputs_geojson_crs(FILE *f, const char *crs)
{
	unsigned n = 0;

	if (!crs || strncmp(crs, "EPSG:", 5))
		return;
	for (const char *at = crs + 5; isdigit((unsigned char)*at) && n < 100000000; at++)
		n = n * 10 + (unsigned)(*at - '0');
	if (n)
		fprintf(f, "\"crs\":{\"type\":\"name\",\"properties\":{\"name\":\"urn:ogc:def:crs:EPSG::%u\"}},\n", n);
}

void outputs_geojson_head(FILE *f, const struct acut_mesh_head *h, const struct format_options *opt)
{
	fputs("\"lattice\":", f);
	outputs_geojson_text(f, h->lattice);
	fputs(",\"crs\":", f);
	outputs_geojson_text(f, h->crs);
	fputs(",\"units\":[", f);
	outputs_geojson_text(f, h->unit_xy);
	fputc(',', f);
	outputs_geojson_text(f, opt->z_unit ? opt->z_unit : h->unit_z);
	fputc(']', f);
}

void outputs_geojson_origin(FILE *f, const struct acut_mesh_head *h, const struct format_options *opt)
{
	char text[FORMAT_COMMENT], x[64], y[64], z[64];

	if (sscanf(format_axis_origin(h, opt, text, sizeof(text)), "acut-origin %63s %63s %63s", x, y, z) == 3)
		fprintf(f, ",\"origin\":[%s,%s,%s]", x, y, z);
	else
		fputs(",\"origin\":null", f);
}

void outputs_geojson_left_out(FILE *f, const struct outputs_report *report)
{
	static const char *const names[OUTPUTS_REASONS] = {
		[OUTPUTS_BY_HULL] = "trim_hull",
		[OUTPUTS_BY_MASK] = "mask",
		[OUTPUTS_BY_ERASE] = "erase",
		[OUTPUTS_BY_EDGE] = "max_edge",
	};

	fprintf(f, "\"left_out\":%llu,\"left_out_by\":{", (unsigned long long)report->left_out.triangles);
	for (int i = 0; i < OUTPUTS_REASONS; i++) {
		const struct outputs_left_out *by = &report->left_out_by[i];

		fprintf(f, "%s\"%s\":", i ? "," : "", names[i]);
		if (!by->given)
			fputs("null", f);
		else if (isnan(by->area))
			fprintf(f, "{\"triangles\":%llu,\"area\":null}", (unsigned long long)by->triangles);
		else
			fprintf(f, "{\"triangles\":%llu,\"area\":%.17g}", (unsigned long long)by->triangles, by->area);
	}
	fputc('}', f);
}

void outputs_geojson_square(FILE *f, const char *x0, const char *y0, const char *x1, const char *y1)
{
	fprintf(f, "{\"type\":\"Polygon\",\"coordinates\":[[[%s,%s],[%s,%s],[%s,%s],[%s,%s],[%s,%s]]]}", x0, y0, x1, y0, x1, y1,
		x0, y1, x0, y0);
}
