/* Shared by the files of this room; nobody else includes it. */
#ifndef CRS_PARTS_H
#define CRS_PARTS_H

#include "crs.h"

extern const char crs_unknown[]; /* "unknown" */

enum { CRS_EPSG_MAX = 32766 }; /* above: user-defined, private */

/* ---- units ---- */

/* Name of the length unit of `factor` metres, or of the angle unit of `factor` radians. */
const char *crs_unit_of_length(double factor);
const char *crs_unit_of_angle(double factor);
/* Name of the unit with this EPSG code (9001 metre, 9002 foot, 9003 US survey foot, 9102 degree, ...). */
const char *crs_unit_of_epsg(unsigned code);
void crs_set_unit(char unit[CRS_UNIT_SIZE], const char *name);
bool crs_is_unknown(const char *text);
/* The unit that a name or remark speaks of beyond doubt; "unknown" for plain feet, which are two. */
const char *crs_unit_of_remark(const char *text, size_t size);

/* ---- texts ---- */

struct crs_span {
	const char *at;
	size_t size;
};

/* Append to info->text, leaving out what is not printable ASCII; "unknown" and "" are overwritten. */
void crs_text_append(struct crs_info *info, const char *text, size_t size);
void crs_text_append_epsg(struct crs_info *info, unsigned code);
/* Lower-case letters and digits alone, so that the spellings of one name compare. Returns buf. */
char *crs_text_plain(struct crs_span name, char *buf, size_t size);

/* ---- ellipsoids and datums ---- */

struct crs_ellipsoid {
	double a, inverse_flattening;
};

/* The ellipsoid of a system whose `a` is known, for messages: "the ellipsoid 6378137 m, 1/298.25" or "a sphere of 6371000 m". */
enum { CRS_ELLIPSOID_TEXT = 80 };
char *crs_ellipsoid_text(const struct crs_system *, char buf[CRS_ELLIPSOID_TEXT]);
bool crs_ellipsoid_of_epsg(unsigned code, struct crs_ellipsoid *ret);
/* Sets system->datum, by the name of a datum or of a geographic system; the ellipsoid of a datum that is known
 * here is filled in where `system` has none, and taken away where it has another. */
void crs_datum_of_name(struct crs_system *, struct crs_span name);
void crs_datum_of_epsg(struct crs_system *, unsigned code); /* of the datum; not known here: nothing */

/* ---- methods ---- */

enum crs_role { CRS_LAT0, CRS_LON0, CRS_LAT1, CRS_LAT2, CRS_K0, CRS_X0, CRS_Y0, CRS_ROLES };

struct crs_params {
	double value[CRS_ROLES]; /* degrees, metres */
	bool said[CRS_ROLES], bad;
};

enum crs_way {                /* how a record names a method */
	       CRS_WAY_NONE,  /* none is named */
	       CRS_WAY_OTHER, /* one that is not known here */
	       CRS_WAY_TM,
	       CRS_WAY_LCC_1SP,
	       CRS_WAY_LCC_2SP,
	       CRS_WAY_LCC, /* one or two parallels, by its parameters */
	       CRS_WAY_ALBERS,
	       CRS_WAY_POLAR,       /* the origin is a pole, or it is the latitude of true scale */
	       CRS_WAY_POLAR_A,     /* the origin is a pole, with a scale */
	       CRS_WAY_POLAR_B,     /* latitude of true scale */
	       CRS_WAY_POLAR_NORTH, /* the same, with the pole in its name */
	       CRS_WAY_POLAR_SOUTH,
};

/* Said twice, differently: bad. */
void crs_param_set(struct crs_params *, enum crs_role, double value);
/* Sets method and parameters if all are there and make sense; else the method stays unknown. */
void crs_method_settle(struct crs_system *, enum crs_way, const struct crs_params *);

/* ---- systems by number ---- */

/* What EPSG says of a projected, geographic or geocentric system: plane, units, datum; ellipsoid and method where they
 * are known here. False: not one of them, *ret untouched. */
bool crs_epsg_known(unsigned code, bool vertical); /* as a system of any kind, or as what files put in place of one of heights */
bool crs_epsg_system(unsigned code, struct crs_info *ret);
const char *crs_epsg_height_unit(unsigned code); /* of a vertical system */
/* The parts of a compound system. False: it is none. */
bool crs_epsg_compound(unsigned code, unsigned *ret_horizontal, unsigned *ret_vertical);
/* The number of a system by the name that EPSG or ESRI gives it; 0: none that is known here. */
unsigned crs_epsg_of_name(const char *name, size_t size);
/* Gives a projected system that is told by its parameters the number that it has. */
unsigned crs_epsg_of_system(const struct crs_system *);

#endif
