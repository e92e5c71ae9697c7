/*
 * Writers over the mesh stream: one row a format, and a run that feeds one stream to several of them.
 *
 * A run is given its outputs, hands a sink to acut_fetch, and publishes what was written once the fetch has
 * succeeded. Until then nothing stands under a final name; a run that is freed unpublished leaves nothing.
 */
#ifndef FORMAT_H
#define FORMAT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "acut.h"
#include "decimal.h"

struct cursor;
struct err;
struct format_output;
struct packer;

enum format_color { FORMAT_HILLSHADE, FORMAT_ELEVATION, FORMAT_DOMAIN };

struct format_options {
	bool canonical;  /* vertices by (x, y), triangles by their numbers */
	bool no_clobber; /* an output that exists is an error */
	bool origin_auto, has_origin;
	struct decimal origin[3]; /* subtracted from the coordinates, exactly; of z after its conversion */
	const char *z_unit;       /* name of a length ("metre", ...) that heights are converted to; NULL: as they are */
	uint32_t width;           /* pictures: pixels; 0 = FORMAT_WIDTH */
	enum format_color color;
};

#define FORMAT_WIDTH 1600
#define FORMAT_WIDTH_MAX 32768

/* A block as writers see it: `mesh` as it came (triangles left out are gone), and, for rows that ask for
 * them, the positions of all its local vertices, foreign ones first. */
struct format_block {
	const struct acut_mesh_block *mesh;
	const int32_t (*position)[3];
};

/* One format. `open` makes the writer; `head`, any number of `block`, `finish` follow in this order, `free`
 * comes last, also after a failure, and returns NULL. Writers write to their output and nowhere else. */
struct format {
	const char *name, *extensions, *help; /* extensions: ".a .b" */
	bool canonical;                       /* --canonical makes sense */
	bool origin;                          /* so does --origin */
	bool positions;                       /* blocks come with positions */
	bool nothing;                         /* writes nothing: added without a path, opened without an output */
	int (*open)(struct format_output *, const struct format_options *, void **ret, struct err *);
	int (*head)(void *writer, const struct acut_mesh_head *, struct err *);
	int (*block)(void *writer, const struct format_block *, struct err *);
	int (*finish)(void *writer, const struct acut_mesh_tail *, struct err *);
	void *(*free)(void *writer);
	/* To go on later; NULL: it cannot. `save` gives FORMAT_SAVED bytes at most; `resume` comes in place of head, its
	 * output stands behind the last byte then. */
	void (*save)(const void *writer, struct packer *);
	int (*resume)(void *writer, const struct acut_mesh_head *, struct cursor *, struct err *);
};
#define FORMAT_SAVED 64

const struct format *const *format_rows(size_t *ret_n);
const struct format *format_find(const char *name);    /* NULL: no such format */
const struct format *format_by_path(const char *path); /* by extension; NULL: unknown */
bool format_parse_color(const char *text, enum format_color *ret);

struct format_run_options {
	bool has_max_edge;
	struct decimal max_edge;       /* triangles with a longer xy edge are left out */
	const char *max_edge_unit;     /* name of its unit; NULL: that of the file */
	bool edges;                    /* gather edge statistics */
	uint64_t sort_memory;          /* for canonical and tiles; 0 = 64 MiB */
	bool changes;                  /* the stream is one of changes: NAME.changes.geojson stands beside the first output */
	bool tiled;                    /* the one output is a folder of tiles */
	struct decimal tile;           /* their side, in file units: above zero */
	int (*interrupted)(void *ctx); /* not 0: give up; asked while tiles are made; NULL: nobody is */
	void *ctx;
};

/* The most tiles that the triangles of a mesh may be in. */
#define FORMAT_TILES 100000u
#define FORMAT_LONG_EDGE 50 /* times the median: not of the spacing of the survey any more */
#define FORMAT_CHANGES ".changes.geojson"
#define FORMAT_TILES_INDEX "index.geojson"

/* "m", "ft", "ftUS" to the name of the unit; NULL: no such unit. */
const char *format_unit_of_word(const char *word, size_t n);

/* Regions with triangles. */
struct format_changes {
	uint64_t since, old_job; /* generation and job of the old mesh; 0: none came */
	uint64_t gone, gone_triangles, kept, kept_triangles, new_regions, new_triangles;
};

/* What a run has to say when the stream has ended. Lengths and areas are in file units. */
struct format_report {
	uint64_t bytes;       /* of all outputs */
	uint64_t left_out;    /* triangles, by max_edge */
	double left_out_area; /* NAN where the unit of x and y is no known length */
	char unit_xy[16];     /* of the file */
	struct format_changes changes;
	uint64_t tiles;                   /* files of tiles; 0 without tiles */
	double longest_edge, median_edge; /* if edges were asked for; 0 without triangles */
	double long_share; /* of the area of all triangles, the part of those with an edge above FORMAT_LONG_EDGE medians */
};

struct format_run;
int format_run_new(const struct format_run_options *, struct format_run **ret, struct err *err);
/* Opens the output: "-" is standard output; of tiles, the folder they will stand in, which is made; NULL for a format that writes
 * nothing. Wrong combinations are -ERR_USAGE. */
int format_run_add(struct format_run *, const char *path, const struct format *, const struct format_options *, struct err *err);
/* The sink to hand to acut_fetch; valid as long as the run. `progress` is left NULL. */
struct acut_mesh_sink format_run_sink(struct format_run *);
/* The same of a run of changes, for acut_fetch_changes. */
struct acut_changes_sink format_run_changes(struct format_run *);
/* What a callback of the sink failed with; code ERR_NONE if none did. */
const struct err *format_run_error(const struct format_run *);
/* Keeps what has come of the job's mesh in files beside the outputs (NAME.part, NAME.part.faces, and NAME.part.state
 * beside the first), so that a later run with the same outputs and options goes on with it. After the adds, before
 * the sink is used. `on`: this run goes on with what an earlier one has kept, or fails: -ERR_GONE nothing is kept,
 * -ERR_USAGE it is of another job or of other outputs or options, or one of them cannot be kept, -ERR_CORRUPT it is
 * damaged, -ERR_BUSY another process is at it. Else what is there is replaced, and nothing is kept where one output
 * cannot be. */
int format_run_keep(struct format_run *, uint64_t job, bool on, struct err *err);
/* The state of the fetch that this run goes on with; NULL: it starts. */
const void *format_run_kept(const struct format_run *, size_t *ret_size);
/* It is time to save: after the first block, every 64 MiB ($ACUT_FETCH_SYNC) or 5 seconds. */
bool format_run_due(const struct format_run *);
/* Makes durable what the run has, with the state of the fetch (acut_fetch_state) as of the last block. Does nothing
 * where nothing is kept. */
int format_run_save(struct format_run *, const void *state, size_t size, struct err *err);
bool format_run_saved(const struct format_run *); /* a later run can go on */
/* What the index of tiles or changes says of where the mesh comes from; before publishing. `dataset` is only read then. */
void format_run_about(struct format_run *, uint64_t job, const char *dataset, uint64_t generation);
/* After the tail: makes all outputs durable and gives them their names. */
int format_run_publish(struct format_run *, struct err *err);
void format_run_report(const struct format_run *, struct format_report *ret);
struct format_run *format_run_free(struct format_run *);

#endif
