/*
 * index.geojson: a feature for each tile.
 *
 * Geometries are the squares of the grid in the plane of the dataset, exact decimals, not projected. GeoJSON means degrees by
 * its standard, so the system is named, in the old member "crs" if it has an EPSG number (which readers of files look for),
 * and as text. Each feature has the box of its vertices, since triangles cross the border of a tile; of rasters that of
 * its pixels, which is the square if its side is a multiple of the cell.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "outputs_geojson.h"
#include "outputs_tile.h"

static void put_head(FILE *f, const struct outputs_tiles *t, const struct outputs_report *report)
{
	const struct acut_mesh_head *h = &t->head;
	char size[DECIMAL_TEXT_SIZE];

	fputs("{\"type\":\"FeatureCollection\",\"name\":\"acut-tiles\",\n", f);
	outputs_geojson_crs(f, h->crs);
	fprintf(f, "\"acut\":{\"version\":1,\"job\":%llu,\"dataset\":", (unsigned long long)t->origin->job);
	outputs_geojson_text(f, t->origin->dataset);
	fprintf(f, ",\"generation\":%llu,\"size\":%s,\"format\":\"%s\",\"tiles\":%llu,\"triangles\":%llu,",
		(unsigned long long)t->origin->generation, decimal_scaled_text(t->size, 1, size), t->format->name,
		(unsigned long long)t->ntile, (unsigned long long)t->tail.is.triangles);
	outputs_geojson_left_out(f, report);
	fprintf(f, ",\"digest\":\"%s\",\"vertex_digest\":\"%s\",", t->tail.digest, t->tail.vertex_digest);
	outputs_geojson_head(f, h, &t->opt);
	outputs_geojson_origin(f, h, &t->opt);
	fputs("},\n\"features\":[", f);
}

static void put_square(FILE *f, const struct outputs_tiles *t, const int64_t at[2])
{
	char x[2][DECIMAL_TEXT_SIZE], y[2][DECIMAL_TEXT_SIZE];

	for (int i = 0; i < 2; i++) {
		decimal_scaled_text(t->size, at[0] + i, x[i]);
		decimal_scaled_text(t->size, at[1] + i, y[i]);
	}
	outputs_geojson_square(f, x[0], y[0], x[1], y[1]);
}

/* What the file of a tile has, from its box on. */
static void put_triangles(FILE *f, const struct outputs_tiles *t, const struct outputs_tile *tile)
{
	char number[DECIMAL_TEXT_SIZE], hex[DIGEST_HEX_SIZE];

	for (int k = 0; k < 6; k++)
		fprintf(f, "%s%s", k ? "," : "", acut_coordinate_text(&t->head, k % 3, tile->box[k], number));
	fprintf(f, "],\"vertices\":%llu,\"triangles\":%llu,\"bytes\":%llu,\"digest\":\"%s\"", (unsigned long long)tile->vertices,
		(unsigned long long)tile->triangles, (unsigned long long)tile->bytes, digest_hex(tile->digest, hex));
	fprintf(f, ",\"vertex_digest\":\"%s\"", digest_hex(tile->vertex_digest, hex));
}

static void put_tile(FILE *f, struct outputs_tiles *t, size_t i)
{
	const struct outputs_tile *tile = &t->tile[i];
	char name[OUTFILE_NAME];
	int64_t at[2];

	outputs_tiles_number(t, i, at);
	fputs("\n{\"type\":\"Feature\",\"geometry\":", f);
	put_square(f, t, at);
	fprintf(f, ",\"properties\":{\"file\":\"%s\",\"column\":%lld,\"row\":%lld,\"box\":[", outputs_tiles_name(t, i, name),
		(long long)at[0], (long long)at[1]);
	if (t->divides) {
		for (int k = 0; k < 4; k++)
			fprintf(f, "%s%.17g", k ? "," : "", tile->edge[k]);
		if (tile->lines)
			fprintf(f, "],\"lines\":%llu", (unsigned long long)tile->lines);
		else
			fprintf(f, "],\"pixels\":[%llu,%llu]", (unsigned long long)tile->pixels[0],
				(unsigned long long)tile->pixels[1]);
		fprintf(f, ",\"bytes\":%llu", (unsigned long long)tile->bytes);
	} else {
		put_triangles(f, t, tile);
	}
	fprintf(f, ",\"job\":%llu,\"generation\":%llu}}", (unsigned long long)t->origin->job,
		(unsigned long long)t->origin->generation);
}

int outputs_tiles_index(struct outputs_tiles *t, const struct outputs_report *report, struct err *err)
{
	struct outputs_page p;
	bool first = true;
	int r = outputs_page_start(&p, err);

	if (!r) {
		put_head(p.f, t, report);
		r = outputs_page_end(&p, t->index, err);
	}
	for (size_t i = 0; i < t->ntile && !r; i++) {
		r = outputs_page_start(&p, err);
		if (r)
			break;
		if (!first)
			fputc(',', p.f);
		first = false;
		put_tile(p.f, t, i);
		r = outputs_page_end(&p, t->index, err);
	}
	return r ? r : outfile_write(t->index, "\n]}\n", 4, err);
}
