/*
 * The area of --crop or --polygon as it is read from a file: polygons with holes, every number as the exact decimal that was
 * written. The areas of a file, all of its polygons together, go into the view that is asked for.
 */
#ifndef CTL_AREA_H
#define CTL_AREA_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include "decimal.h"

struct err;
struct json_reader;
struct text_source;

/* Bytes of a name; of a longer one the beginning is kept, with a mark. */
enum { CTL_AREA_NAME = 1024, CTL_AREA_FIELDS = 16 };
#define CTL_AREA_CUT "\u2026"

struct ctl_area {
	struct ctl_area_ring {
		size_t first;
		bool shell;
	} * ring;
	struct decimal (*corner)[2];
	size_t nring, ncorner, rings_room, corners_room;
	char crs[128]; /* the name of the system that the file declares; "": none */
	/* What the file has as one thing: a feature of GeoJSON, or a geometry that is in none. */
	struct ctl_area_feature {
		size_t ring; /* its first */
		size_t name; /* in `names`, which begins with an empty one */
	} * feature;
	size_t nfeature, features_room;
	const char *name_field; /* the property that names a feature; NULL: none */
	char *names;
	size_t names_size, names_room;
	/* Properties that are a text or a number, in the order in which they come first, if there is a name_field. */
	char *field[CTL_AREA_FIELDS];
	unsigned nfield;
	bool more_fields; /* than these */
};

/* Reads a file of GeoJSON or WKT. Errors name the file and the place in it. */
int ctl_area_read(const char *file, struct ctl_area *ret, struct err *err);
/* The same with the names of features: of the property `name_field`, a text or a number. */
int ctl_area_read_named(const char *file, const char *name_field, struct ctl_area *ret, struct err *err);
void ctl_area_done(struct ctl_area *);
/* Of feature i; "": it has none. */
const char *ctl_area_name(const struct ctl_area *, size_t i);
/* The EPSG number that the file declares; 0: none. */
unsigned long ctl_area_epsg(const struct ctl_area *);
/* The corners of ring i, without one at its end that repeats the first. */
size_t ctl_area_corners(const struct ctl_area *, size_t i);

/* For the readers. A shell begins a polygon; a ring ends where the next one begins. */
int ctl_area_ring(struct ctl_area *, bool shell, struct err *err);
int ctl_area_feature(struct ctl_area *, struct err *err); /* the next ring begins one */
int ctl_area_corner(struct ctl_area *, struct decimal x, struct decimal y, struct err *err);
/* Of feature i; `name` may be changed. More than CTL_AREA_NAME bytes are cut at a character. */
int ctl_area_set_name(struct ctl_area *, size_t i, char *name, struct err *err);
int ctl_area_field(struct ctl_area *, const char *name, struct err *err);

/* "area@EXPONENT:" and the rings (protocol.md, "Views"). -ERR_LIMIT: too long for a view. */
int ctl_area_print(const struct ctl_area *, FILE *out, struct err *err);

/* Behind a byte order mark, if there is one. */
int ctl_area_json(struct json_reader *, struct ctl_area *, struct err *err);
int ctl_area_wkt(struct text_source *, struct ctl_area *, struct err *err);

#endif
