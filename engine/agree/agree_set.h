/*
 * How the inputs of a dataset get one coordinate system, one plane and one lattice.
 *
 * The model: all of it is decided from the headers of all inputs together, whatever their order. What a person says of the
 * inputs, and what the dataset has already, binds the decision. The caller keeps the inputs, and the steps come in this order:
 * agree_init, agree_said, agree_plane_words; for each input agree_say; then agree_plane_choose, agree_crs, agree_lattice; and for
 * each input that is read, agree_step_of.
 *
 * Any thread, one at a time; functions that take a const struct agree, any number of threads.
 */
#ifndef AGREE_SET_H
#define AGREE_SET_H

#include <stdbool.h>
#include <stddef.h>

#include "agree.h"
#include "crs_geo.h"
#include "input_types.h"
#include "lattice.h"

struct err;

/* What a person says, as texts; NULL is "": nothing. System, unit of x and y, unit of z. */
struct agree_words {
	const char *assume[3], *override[3];
	const char *scale_xy, *scale_z;
	const char *utm; /* zone for degrees */
	const char *geoid, *geoid_way;
	bool planar; /* degrees are taken as a plane */
};

/* One input, by its header. */
struct agree_input {
	const char *name;
	struct lattice_input coords;
	const struct crs_info *crs;   /* what it says, after agree_say */
	const struct crs_info *plane; /* what it becomes in the dataset; NULL: not decided yet */
	bool on_plane;                /* `coords` are on the dataset's plane */
	bool lines;                   /* it is a file of lines */
};

struct agree_inputs {
	size_t n;
	struct agree_input *(*at)(void *ctx, size_t i); /* NULL: it is excluded */
	/* Excludes an input that does not fit the others. Non-zero: it stays, and all are refused. */
	int (*exclude)(void *ctx, size_t i, const struct err *why);
	/* A copy that lives as long as the inputs. NULL: no memory. */
	const struct crs_info *(*keep)(void *ctx, const struct crs_info *);
	void *ctx;
};

/* Sizes as in a manifest. */
enum { AGREE_GEOID = 128, AGREE_NOTE = 512 };

struct agree {
	/* What is asked. */
	char *scale_xy, *scale_z, *utm, *geoid, *geoid_way; /* never NULL */
	bool planar;
	bool grows;           /* other inputs may follow later */
	bool assumes;         /* `said` holds for inputs that say nothing, */
	bool overrides;       /* or replaces what inputs say */
	struct crs_info said; /* a person */
	char *said_wkt;       /* the same as WKT; NULL: none was given */

	/* The dataset. */
	const char *dataset;         /* its name, for messages */
	bool fixed;                  /* it has a system: that of crs, unit_xy, unit_z */
	char created[CRS_TEXT_SIZE]; /* the plane that it was created with; "": none */

	/* What is agreed. */
	bool has_crs, has_lattice;
	char crs[CRS_TEXT_SIZE], unit_xy[CRS_UNIT_SIZE], unit_z[CRS_UNIT_SIZE]; /* "unknown" at first */
	char crs_of[256];                                                       /* who says so: the dataset, or an input */
	struct lattice lattice;
	const struct lattice *near; /* agree_lattice chooses this one if all inputs lie on it; NULL: none */
	char note[AGREE_NOTE];      /* what the lattice does to inputs that did not ask for it; "" */
	bool projects;              /* some inputs are degrees, which are projected to `zone` */
	struct crs_zone zone, wanted;
	char datum[64];               /* of the degrees */
	char geoid_text[AGREE_GEOID]; /* as in a manifest; "": heights stay */
	char *geoid_path;             /* the grid's file; NULL: heights stay */
	enum crs_geoid_way way;
};

/* ---- what is asked, and what a dataset has (agree_set.c) ---- */

int agree_init(struct agree *, const struct agree_words *, struct err *err); /* -ERR_NOMEM */
void agree_done(struct agree *);
/* Reads the systems that a person says. -ERR_USAGE. */
int agree_said(struct agree *, const struct agree_words *, struct err *err);
/* Reads zone and way of a geoid. -ERR_USAGE. */
int agree_plane_words(struct agree *, struct err *err);
/* The grid that agree.geoid names. -ERR_NOMEM */
int agree_geoid_found(struct agree *, const char *path, const char *hash, struct err *err);
/* Two texts of geoids, as in manifests, mean the same. */
bool agree_geoid_same(const char *, const char *);
/* The dataset has this system. */
void agree_fix(struct agree *, const char *crs, const char *unit_xy, const char *unit_z);
void agree_unfix(struct agree *); /* it has neither system nor lattice */
/* What another process has agreed of the same words, as texts; `zone` is "" if nothing is projected. False: it is no zone. */
bool agree_take_up(struct agree *, const char *crs, const char *unit_xy, const char *unit_z, const char *zone,
		   const struct lattice *);
/* A dataset with this system has that of the set. */
bool agree_is(const struct agree *, const char *crs, const char *unit_xy, const char *unit_z);

/* ---- one input ---- */

/* An input that says this is projected. */
bool agree_projects(const struct agree *, const struct crs_info *);
/* How to open an input. `projects`: as above, if that is known already. */
void agree_input_options(const struct agree *, bool projects, struct input_options *ret);
/* Completes or replaces what an input says; `overridden`: what it said. -ERR_INPUT: it says something else. */
int agree_say(const struct agree *, const char *name, struct crs_info *, char overridden[AGREE_OVERRIDDEN], struct err *err);
/* How it is read, as a manifest keeps it. */
void agree_how_read(const struct agree *, const char *format, const char *columns, bool decimal_comma, const struct crs_info *,
		    char *ret, size_t size);

struct agree_step {
	struct crs_info from, to; /* params points to them, so the struct may not move */
	struct crs_info plane;    /* as the dataset has it, with the heights that a geoid makes */
	bool projects, needed;
	struct crs_step_params params;
};
/* What an input with that system becomes (agree_plane.c). */
int agree_plane_of(const struct agree *, const struct crs_info *, struct agree_step *ret, struct err *err);
/* The same, when the set has its system: -ERR_INPUT, the input has another. */
int agree_step_of(const struct agree *, const char *name, const struct crs_info *, struct agree_step *ret, struct err *err);

/* ---- all of them ---- */

/* The zone of degrees, and the plane of each input. */
int agree_plane_choose(struct agree *, const struct agree_inputs *, struct err *err);
/* All inputs, and the dataset, must have one system, which is set. The error names two inputs. */
int agree_crs(struct agree *, const struct agree_inputs *, struct err *err);
/* The lattice (agree_lattice.c). `has_lattice` is left to the caller. */
int agree_lattice(struct agree *, const struct agree_inputs *, struct err *err);

/* ---- WKT (agree_wkt.c) ---- */

/* That of an input with this one in its records, or of what was said of it; "": none. */
const char *agree_wkt_of(const struct agree *, const char *own);
/* The part of it that holds for the system of the set, allocated. NULL: none does, or no memory. */
char *agree_wkt_part(const struct agree *, const char *wkt);

#endif
