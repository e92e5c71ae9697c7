/*
 * A coordinate system as WKT 1, for the record of a LAS file.
 *
 * engine/crs must read the text back as the same system: name, units and, if they are known, parameters; acutd compares
 * these when points are pushed. So what was written is read back. If the full parameters are not read back as the same
 * system, the text has only the code or the name.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "las.h"

struct text {
	char *at;
	size_t size, n;
};

static void put(struct text *t, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
static void put(struct text *t, const char *fmt, ...)
{
	va_list ap;
	int n;

	va_start(ap, fmt);
	n = vsnprintf(t->at + t->n, t->size - t->n, fmt, ap);
	va_end(ap);
	if (n < 0 || (size_t)n >= t->size - t->n)
		t->n = t->size - 1; /* not read back as the same */
	else
		t->n += (size_t)n;
}

static bool known(const char *text)
{
	return *text && strcmp(text, "unknown");
}

/* A name between quotes. */
static void put_name(struct text *t, const char *name)
{
	put(t, "\"");
	for (; *name; name++)
		put(t, *name == '"' ? "\"\"" : "%c", *name);
	put(t, "\"");
}

static unsigned code_of(const char *text)
{
	unsigned n = 0;
	int end = 0;

	return sscanf(text, "EPSG:%u%n", &n, &end) == 1 && !text[end] ? n : 0;
}

static void put_unit(struct text *t, const char *unit)
{
	double metres = crs_unit_metres(unit);

	if (!strcmp(unit, "metre"))
		put(t, ",UNIT[\"metre\",1,AUTHORITY[\"EPSG\",\"9001\"]]");
	else if (metres > 0)
		put(t, ",UNIT[\"%s\",%.15g]", !strcmp(unit, "foot") ? "foot" : "US survey foot", metres);
}

static void put_authority(struct text *t, unsigned code)
{
	if (code)
		put(t, ",AUTHORITY[\"EPSG\",\"%u\"]", code);
}

/* ---- the plane ---- */

static void put_base(struct text *t, const struct crs_system *s)
{
	put(t, ",GEOGCS[");
	put_name(t, *s->datum ? s->datum : "unknown");
	put(t, ",DATUM[");
	put_name(t, *s->datum ? s->datum : "unknown");
	put(t, ",SPHEROID[\"ellipsoid\",%.15g,%.15g]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]]", s->a,
	    s->inverse_flattening);
}

static void put_parameter(struct text *t, const char *name, double v)
{
	put(t, ",PARAMETER[\"%s\",%.17g]", name, v);
}

static void put_method(struct text *t, const struct crs_system *s)
{
	static const char *const names[] = {
		[CRS_METHOD_TRANSVERSE_MERCATOR] = "Transverse_Mercator",
		[CRS_METHOD_LAMBERT_CONIC] = "Lambert_Conformal_Conic_2SP",
		[CRS_METHOD_ALBERS] = "Albers_Conic_Equal_Area",
		[CRS_METHOD_POLAR_STEREOGRAPHIC] = "Polar_Stereographic",
	};
	bool conic = s->method == CRS_METHOD_LAMBERT_CONIC || s->method == CRS_METHOD_ALBERS;
	bool one = s->method == CRS_METHOD_LAMBERT_CONIC && s->lat1 == s->lat2;
	bool polar = s->method == CRS_METHOD_POLAR_STEREOGRAPHIC, at_pole = polar && (s->lat1 == s->lat0 || s->lat1 == 0);

	put(t, ",PROJECTION[\"%s\"]", one ? "Lambert_Conformal_Conic_1SP" : names[s->method]);
	put_parameter(t, "latitude_of_origin", polar && !at_pole ? s->lat1 : s->lat0);
	put_parameter(t, "central_meridian", s->lon0);
	if (conic && !one) {
		put_parameter(t, "standard_parallel_1", s->lat1);
		put_parameter(t, "standard_parallel_2", s->lat2);
	}
	if (!conic || one)
		put_parameter(t, "scale_factor", s->k0);
	put_parameter(t, "false_easting", s->x0 / s->unit);
	put_parameter(t, "false_northing", s->y0 / s->unit);
}

static void put_plane(struct text *t, const struct crs_info *c, const char *name, bool whole)
{
	bool plane = c->plane == CRS_PLANE_PROJECTED;

	put(t, plane ? "PROJCS[" : "LOCAL_CS[");
	put_name(t, name);
	if (plane && whole) {
		put_base(t, &c->system);
		put_method(t, &c->system);
	}
	put_unit(t, c->unit_xy);
	put(t, ",AXIS[\"Easting\",EAST],AXIS[\"Northing\",NORTH]");
	put_authority(t, code_of(name));
	put(t, "]");
}

/* ---- heights ---- */

static void put_heights(struct text *t, const char *name, const char *unit)
{
	unsigned code = code_of(name);
	bool ellipsoidal = code >= 5001 && code <= 5035;

	put(t, ",VERT_CS[");
	put_name(t, name);
	put(t, ",VERT_DATUM[\"%s\",%d]", ellipsoidal ? "ellipsoid" : "unknown", ellipsoidal ? 2002 : 2005);
	put_unit(t, unit);
	put(t, ",AXIS[\"Up\",UP]");
	put_authority(t, code);
	put(t, "]");
}

/* ---- both ---- */

static void put_all(struct text *t, const struct crs_info *c, bool whole)
{
	const char *plus = crs_text_heights(c->text), *heights = plus ? plus + 3 : "";
	char plane[CRS_TEXT_SIZE];
	bool compound = plus || known(c->unit_z);

	crs_text_plane(c->text, plane);
	t->n = 0;
	if (compound)
		put(t, "COMPD_CS[\"\",");
	put_plane(t, c, plane, whole);
	if (compound) {
		put_heights(t, heights, c->unit_z);
		put(t, "]");
	}
}

static bool same(const struct crs_info *a, const struct text *t, bool whole)
{
	struct crs_info b;

	return t->n + 1 < t->size && crs_read_wkt(t->at, t->n, &b) && !strcmp(a->text, b.text) &&
	       !strcmp(a->unit_xy, b.unit_xy) && !strcmp(a->unit_z, b.unit_z) && a->system.epsg_z == b.system.epsg_z &&
	       (!whole || crs_system_same(&a->system, &b.system));
}

int las_wkt(const struct crs_info *c, char ret[LAS_WKT_MAX], size_t *ret_size, struct err *err)
{
	bool whole = c->plane == CRS_PLANE_PROJECTED && c->system.method > CRS_METHOD_GEOGRAPHIC && c->system.unit > 0;
	struct text t = {.at = ret, .size = LAS_WKT_MAX};

	*ret_size = 0;
	if (!known(c->text) && !known(c->unit_xy) && !known(c->unit_z))
		return 0;
	if (whole) {
		put_all(&t, c, true);
		whole = same(c, &t, true);
	}
	if (!whole) {
		put_all(&t, c, false);
		if (!same(c, &t, false)) {
			err_set(err, ERR_UNSUPPORTED,
				"the coordinate system %.200s cannot be written into a LAS file so that it is read as the same",
				c->text);
			return err_add_hint(err, "name it with --crs EPSG:n");
		}
	}
	*ret_size = t.n + 1; /* with its terminating zero, as in LAS */
	return 0;
}
