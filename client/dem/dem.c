/* One elevation model, from the head of the stream to the file. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "area.h"
#include "dem_priv.h"
#include "err.h"

int dem_new(struct outfile *out, struct dem **ret, struct err *err)
{
	struct dem *d = calloc(1, sizeof(*d));

	if (!d)
		return err_set(err, ERR_NOMEM, "no memory for a writer");
	d->out = out;
	*ret = d;
	return 0;
}

struct dem *dem_free(struct dem *d)
{
	if (d) {
		dem_store_free(d->store);
		area_free(d->grid.polygon);
		free(d->description);
		free(d->wkt);
	}
	free(d);
	return NULL;
}

static int scale_init(struct dem_scale *s, const struct acut_mesh_head *head, const struct dem_options *opt, struct err *err)
{
	*s = (struct dem_scale){.k = head->k[2], .num = opt->z_num, .den = opt->z_den};
	if (!decimal_parse(head->scale_z, &s->z) || s->z.mantissa <= 0 || abs(s->z.exponent) > 40 || s->k > 1ll << 61 ||
	    s->k < -(1ll << 61))
		return err_set(err, ERR_PROTO, "the stream's z scale is not a number above zero");
	s->factor = dem_big_double((dem_i128)s->z.mantissa * s->num, s->z.exponent, (uint64_t)s->den);
	return 0;
}

int dem_head(struct dem *d, const struct acut_mesh_head *head, const struct dem_options *opt, struct err *err)
{
	int r = dem_grid_init(&d->grid, head, opt, err);

	d->opt = *opt;
	d->from[0] = d->from[1] = INT64_MAX;
	d->to[0] = d->to[1] = INT64_MIN;
	if (!r)
		r = scale_init(&d->scale, head, opt, err);
	if (!r)
		r = dem_store_new(d->out, opt->cache ? opt->cache : DEM_CACHE, &d->store, err);
	if (!r && head->wkt && *head->wkt && !(d->wkt = strdup(head->wkt)))
		r = err_set(err, ERR_NOMEM, "no memory for a coordinate system");
	if (r)
		return r;
	d->steep = opt->steep * decimal_double(d->scale.z) / decimal_double(d->grid.scale);
	snprintf(d->crs, sizeof(d->crs), "%.*s", head->crs ? (int)strcspn(head->crs, "\n") : 0, head->crs ? head->crs : "");
	snprintf(d->unit_xy, sizeof(d->unit_xy), "%s", opt->unit_xy ? opt->unit_xy : "");
	snprintf(d->unit_z, sizeof(d->unit_z), "%s", opt->unit_z ? opt->unit_z : "");
	d->opt.unit_xy = d->unit_xy;
	d->opt.unit_z = d->unit_z;
	return 0;
}

int dem_describe(struct dem *d, const char *line, struct err *err)
{
	char *text;

	if (asprintf(&text, "%s%s%s", d->description ? d->description : "", d->description ? "\n" : "", line) < 0)
		return err_set(err, ERR_NOMEM, "no memory for the description of a raster");
	free(d->description);
	d->description = text;
	return 0;
}

int dem_too_many(const struct dem *d, struct err *err)
{
	return err->code == ERR_USAGE ?
		       err_add_hint(err, "give a larger --cell than %.6g, or a part with --bbox", dem_grid_side(&d->grid)) :
		       -(int)err->code;
}

/* Tiles without pixels count, too: the file has an entry for each. The side that fits is 1, 2 or 5 times a power of ten. */
int dem_check_size(const struct dem *d, const struct dem_rect *rect, struct err *err)
{
	double tiles = ceil((double)rect->w / DEM_TILE) * ceil((double)rect->h / DEM_TILE);
	double side = dem_grid_side(&d->grid) * 1.01 * sqrt(tiles / DEM_TILES_MAX), ten;

	if (tiles <= DEM_TILES_MAX)
		return 0;
	ten = pow(10, floor(log10(side)));
	side = side / ten <= 2 ? 2 * ten : side / ten <= 5 ? 5 * ten : 10 * ten;
	err_set(err, ERR_USAGE, "the raster would have %llu x %llu pixels, and at most %llu million are written",
		(unsigned long long)rect->w, (unsigned long long)rect->h,
		(unsigned long long)DEM_TILES_MAX * DEM_TILE * DEM_TILE / 1000000);
	return err_add_hint(err, "--cell %.10g fits (units of the file), or a part with --bbox", side);
}

void dem_tiled(struct dem *d)
{
	d->tiled = true;
}

int dem_finish(struct dem *d, const int32_t box[6], struct err *err)
{
	struct dem_rect rect = dem_grid_rect(&d->grid, box);
	struct dem_pyramid p = {0};
	int r = dem_check_size(d, &rect, err);

	if (!r)
		r = dem_pyramid_make(&p, d, &rect, err);
	if (!r)
		r = dem_tiff_write(d, &p, &rect, err);
	dem_pyramid_done(&p);
	return r;
}
