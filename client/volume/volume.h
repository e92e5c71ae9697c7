/*
 * Volumes between two meshes, or between a level and a mesh: cut and fill.
 *
 * The first surface is what was there before, the second one what is there now: fill is where the second is higher, cut where it
 * is lower. Only places that both cover are compared. Each pair of triangles is counted once and rounded once to a part of a
 * lattice cube; the rest is sums of whole numbers. So the result depends on the triangles alone, and with the sides exchanged
 * cut and fill are. Memory does not grow with the meshes.
 */
#ifndef VOLUME_H
#define VOLUME_H

#include "acut.h"
#include "ctl_area.h"
#include "decimal.h"

struct err;
struct outfile;

/* What must be known of a mesh before it comes, as jobs tell it. */
struct volume_side {
	const char *name; /* for messages: "job 12" */
	const char *lattice, *crs, *unit_xy, *unit_z;
	uint64_t triangles; /* about; 0: not known */
};

/* A picture or raster of the difference. */
struct volume_image {
	const char *path;
	bool tif, no_clobber; /* else PNG */
};

struct volume_options {
	struct volume_side side[2]; /* with a level the second is not used */
	bool has_level;
	struct decimal level;         /* in the unit of the heights: takes the place of the first surface */
	const struct ctl_area *areas; /* NULL: all; else a result for each of its features */
	const char *areas_file;       /* for messages */
	const char *unit;             /* of the results: "m", "ft", "ftUS", "yd"; NULL: that of the meshes */
	const struct volume_image *image;
	size_t nimage;
	struct decimal cell;                       /* side of a pixel; with images */
	const char *cell_unit;                     /* its name; NULL: that of the meshes */
	int (*interrupted)(void *ctx);             /* not 0: give up; may be NULL */
	void (*progress)(void *ctx, double share); /* of volume_finish, now and then; may be NULL */
	void *ctx;
};

/* Of a whole comparison, or inside of one polygon. Areas of the plane. */
struct volume_result {
	const char *name;
	double fill, cut, net, error; /* no volume is wrong by more than `error` */
	double area, fill_area, cut_area, same_area, only[2], area_error;
};
struct volume_total {
	const char *unit_volume, *unit_area, *unit; /* "m3", "m2", "m" */
	const char *unit_mesh;                      /* of the meshes, and of a level: "m" */
	uint64_t triangles[2], pairs;
	char digest[2][40], vertex_digest[2][40];
	double range; /* of the colours of a picture, in `unit`: cut from it, fill to it; 0: there is none */
};

/* "1", "1m", "3ft": a number above zero, and the name of its unit or NULL. */
bool volume_length(const char *text, struct decimal *ret, const char **ret_unit);

struct volume;
/* -ERR_USAGE: the two cannot be compared, or an option is wrong. Files that exist are refused, and nothing of them is written.
 * May come before the meshes are made. */
int volume_new(const struct volume_options *, struct volume **ret, struct err *err);
void volume_expect(struct volume *, unsigned side, uint64_t triangles); /* where they were not known then */
/* For a fetch of the mesh of side 0, then of side 1; with a level of side 0 alone. `progress` is NULL. */
struct acut_mesh_sink volume_sink(struct volume *, unsigned side);
/* In place of these, for two meshes of a dataset under one view, without areas and images: their changes from each other. Side 0
 * is the fetch of the first mesh since the second, side 1 the other way round; `job` made the other mesh. Then
 * the whole second mesh comes, of which only the area counts. All numbers are the same as of whole streams. */
struct acut_changes_sink volume_changes(struct volume *, unsigned side, uint64_t job);
struct acut_mesh_sink volume_whole(struct volume *);
bool volume_changes_fail(const struct volume *);       /* the changes are not those of these two jobs */
const struct err *volume_error(const struct volume *); /* of a callback; code ERR_NONE: none */
/* After the last tail: the pairs, and the images, which get their names. */
int volume_finish(struct volume *, struct err *err);
size_t volume_results(const struct volume *);
void volume_result(const struct volume *, size_t i, struct volume_result *ret);
void volume_total(const struct volume *, struct volume_total *ret);
struct volume *volume_free(struct volume *);

#endif
