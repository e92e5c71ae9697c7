/*
 * Files of lines: breaklines, shores, boundaries. A reader gives the features of a file one after the other, in the order of the
 * file, and holds one of them at a time: at most LINES_VERTICES_MOST vertices in at most LINES_PARTS_MOST lines.
 *
 * A feature that cannot be used (no z, an arc) is handed out as refused, with its reason and its place, so that the caller
 * decides: the first one is an error where lines are asked for, and `acutctl info` counts them. What is no file of its format is
 * an error, and ends the reading.
 */
#ifndef LINES_H
#define LINES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "decimal.h"

struct err;

enum {
	LINES_VERTICES_MOST = 1 << 19, /* of a feature */
	LINES_PARTS_MOST = 1 << 16,
	LINES_LAYERS_MOST = 4096, /* of a file */
	LINES_NAME_SIZE = 256,
};

struct lines_options {
	const char *layer;             /* NULL: all of them */
	const char *kind_field;        /* NULL: features have no kind */
	int (*interrupted)(void *ctx); /* NULL, or asked now and then: not 0 ends the reading, -ERR_CANCELLED */
	void *ctx;
	bool csv; /* a text that is no other format is CSV; without it such a text is not recognised */
};

/* As found in the file, not looked up. Texts are "" and numbers 0 where the file does not say. */
struct lines_crs {
	uint32_t epsg, epsg_z;
	const char *wkt;
	char name[LINES_NAME_SIZE];
	char unit[32];    /* metre, foot, us-survey-foot, or as the file has it */
	char unit_z[32];  /* only if the file says so apart from `unit` */
	bool degrees;     /* x and y are longitude and latitude; false without a unit: unknown */
	const char *from; /* a static text: where the file says it */
};

struct lines_layer {
	char name[LINES_NAME_SIZE];
	struct lines_crs crs;
	bool selected;
	unsigned index; /* in the order in which they were met */
};

enum lines_state {
	LINES_USABLE,
	LINES_EMPTY,   /* it has no geometry */
	LINES_NO_LINE, /* it is no line, so left out: `why` is what it is */
	LINES_REFUSED, /* it is a line that cannot be used */
};

/* A line, or a ring: its last vertex is joined with its first, which is not repeated. */
struct lines_part {
	size_t first, n;
	bool ring;
};

/* Valid until the next one is asked for. */
struct lines_feature {
	uint64_t number; /* from 1, in the layer or the file */
	uint64_t place;  /* where it begins: lines_info.place says in what */
	const struct lines_layer *layer;
	const char *geometry; /* as the format calls it: a static text */
	const char *kind;     /* the value of the kind field; NULL: it has none */
	enum lines_state state;
	const char *why; /* a static text, NULL if it is usable or empty */
	const struct lines_part *part;
	size_t nparts, nvertices;
	/* One of them: the digits of a text, or the doubles of a binary file. */
	const struct decimal (*exact)[3];
	const double (*number_of)[3];
};

struct lines_info {
	const char *format, *title; /* "shapefile", "Shapefile" */
	char variant[64];           /* version and kind, "" if there is none */
	const char *place;          /* of what lines_feature.place is a number: "byte", "line", "row" */
};

struct lines;

/* Whether the file is one of lines, by its first bytes; NULL: it is not. A static text, "GeoJSON". Files that cannot be read are
 * not. */
const char *lines_recognise(const char *path);
/* Whether a text that has points could as well be CSV of lines: a column of it has one name in rows that follow each other, and
 * points have no such names. Only the beginning is looked at. */
bool lines_may_be(const char *path);
int lines_open(const char *path, const struct lines_options *, struct lines **ret, struct err *);
const struct lines_info *lines_info(const struct lines *);
/* *ret NULL: there are no more. After a failure nothing else is read. */
int lines_next(struct lines *, const struct lines_feature **ret, struct err *);
/* The error of a refused feature: file, place, reason, what to do. */
int lines_refusal(const struct lines *, const struct lines_feature *, struct err *);
struct lines *lines_close(struct lines *);

/* A coordinate as a double, whichever the file has. */
static inline double lines_coordinate(const struct lines_feature *f, size_t vertex, unsigned axis)
{
	return f->exact ? decimal_double(f->exact[vertex][axis]) : f->number_of[vertex][axis];
}

#endif
