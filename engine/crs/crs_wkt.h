/* Shared by crs_wkt.c, which reads the brackets, and crs_wkt_system.c, which knows what is in a system. */
#ifndef CRS_WKT_H
#define CRS_WKT_H

#include "crs_parts.h"

enum wkt_kind {
	WKT_OTHER,
	WKT_PROJECTED,
	WKT_DERIVED, /* from a projected one, by a conversion that is not known here */
	WKT_GEOGRAPHIC,
	WKT_GEODETIC, /* WKT 2: geographic or geocentric, its CS says which */
	WKT_GEOCENTRIC,
	WKT_VERTICAL,
	WKT_LOCAL,
	WKT_COMPOUND,
	WKT_AROUND, /* a keyword that only wraps a system */
	WKT_BASE,   /* the geographic system under a projected one */
	WKT_CS,
	WKT_AXIS,
	WKT_LENGTH,
	WKT_ANGLE,
	WKT_SCALE,
	WKT_UNIT, /* WKT 1: of length or of angle, by what it belongs to */
	WKT_ID,
	WKT_DATUM,
	WKT_ELLIPSOID,
	WKT_MERIDIAN,
	WKT_METHOD,
	WKT_PARAMETER,
	WKT_DERIVING,
};

enum { WKT_DEPTH = 32, WKT_AXES = 3, WKT_ARGUMENTS = 3, WKT_PARAMETERS = 12 };

struct wkt_unit {
	bool said, angle;
	double factor;    /* metres or radians; 0: cannot be read */
	const char *name; /* "metre", ..., "unknown" */
};

struct wkt_node {
	enum wkt_kind kind;
	const char *from; /* of its keyword */
	unsigned n_args, n_axes;
	struct crs_span arg[WKT_ARGUMENTS]; /* the first ones, quotes taken off */
	struct wkt_unit unit, axis[WKT_AXES];
	unsigned epsg; /* 0: not said */
	bool cartesian, ellipsoidal;
};

/* Properties of a horizontal system other than its unit and number. */
struct wkt_system {
	bool has_ellipsoid, has_meridian, has_datum, has_method, derived, odd;
	double a, inverse_flattening;
	struct crs_span datum, method;
	unsigned datum_epsg, base_epsg, method_epsg;
	struct crs_span base; /* name of the geographic system under it */
	struct wkt_unit base_unit, meridian_unit;
	double meridian;
	struct {
		struct crs_span name;
		unsigned epsg;
		double value;
		struct wkt_unit unit;
	} parameter[WKT_PARAMETERS];
	unsigned n_parameters;
};

/* crs_read_wkt, and where in the text it stands: all of it, and the horizontal system alone (size 0: there is none). */
bool wkt_read(const void *text, size_t size, struct crs_info *ret, struct crs_span *ret_all, struct crs_span *ret_plane);

bool wkt_span_is(struct crs_span, const char *word);
unsigned wkt_span_code(struct crs_span);
/* Reads a unit keyword; `unit->angle` must be set. */
void wkt_unit_read(const struct wkt_node *, struct wkt_unit *unit);
/* The name of a length (an angle for angular systems), "unknown" where none or the other kind is said. */
const char *wkt_unit_name(const struct wkt_unit *, enum wkt_kind system);
/* A keyword inside the system closes. */
void wkt_system_part(struct wkt_system *, const struct wkt_node *);
/* The system itself closes: plane, units, datum, method and number go to `info`, the number also to its node. */
void wkt_system_settle(struct wkt_system *, struct wkt_node *, struct crs_info *info);

#endif
