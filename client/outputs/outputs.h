/*
 * The outputs of a mesh stream: one stream to several formats.
 *
 * The caller adds outputs, passes the sink to acut_fetch, and publishes after the fetch has succeeded. Until then no final
 * name exists; outputs that are freed unpublished leave nothing.
 */
#ifndef OUTPUTS_H
#define OUTPUTS_H

#include "format.h"

/* A length above zero, if it is given. */
struct outputs_length {
	bool given;
	struct decimal value;
	const char *unit; /* its name; NULL: that of the file */
};

/* Polygons in a file of GeoJSON or WKT. Of a mesh that is cut, triangles whose centroid is in an area of OUTPUTS_MASK stay, and
 * those in one of OUTPUTS_ERASE do not. */
enum outputs_cut { OUTPUTS_MASK, OUTPUTS_ERASE, OUTPUTS_CUTS };

/* What leaves triangles out, in this order: one that several would leave out counts for the first. */
enum outputs_reason { OUTPUTS_BY_HULL, OUTPUTS_BY_MASK, OUTPUTS_BY_ERASE, OUTPUTS_BY_EDGE, OUTPUTS_REASONS };

/* Of one of several processes that write the same files (outputs_share.c): its share of the mesh. */
struct outputs_share {
	uint32_t index, tasks;
	uint64_t vertices[2], triangles[2]; /* how many are before its share, and before the next one; the shares ascend */
	uint64_t block;                     /* bytes; nobody else writes into a block of the file in which it writes */
	struct acut_mesh_tail tail;         /* of the whole mesh */
};

struct outputs_options {
	struct outputs_length max_edge;  /* triangles with a longer xy edge are left out */
	struct outputs_length trim_hull; /* and those that are reached from outside through edges that are longer than this */
	bool edges;                      /* gather edge statistics */
	uint64_t sort_memory;            /* for canonical and tiles; 0 = 64 MiB */
	bool changes;                  /* the stream is one of changes: NAME.changes.geojson is written beside the first output */
	bool tiled;                    /* the one output is a folder of tiles */
	bool levels;                   /* the one output is a folder with a page and its tiles */
	struct decimal tile;           /* their side, in file units: above zero */
	uint64_t tiles_most;           /* more with triangles are refused; 0, and rasters and lines: OUTPUTS_TILES */
	int (*interrupted)(void *ctx); /* not 0: give up; may be NULL. Called while triangles are sorted and tiles made, and when
					* parts are joined, before the first file gets its name. */
	void *ctx;
	/* Several processes make the outputs, each a part of them, and one joins these (outputs_join). NULL: there are no parts.
	 * Else what the part of this run is called in the names that files have until they are joined: characters of file names.
	 */
	const char *part;
	bool joins;                           /* it joins the parts, and gets head and tail, but no blocks */
	const struct outputs_share *share_of; /* all parts write the same files, which outfile_shared_make has made; else NULL */
	uint64_t share[2]; /* of a part with tiles: from which tile on, and which is the last (outputs_tile_code) */
};

/* The most tiles that the triangles of a mesh may be in, unless tiles_most says another number. */
#define OUTPUTS_TILES 100000u
#define OUTPUTS_LONG_EDGE 50 /* times the median: not of the spacing of the survey any more */
#define OUTPUTS_CHANGES ".changes.geojson"
#define OUTPUTS_TILES_INDEX "index.geojson"
#define OUTPUTS_LEVELS_INDEX "index.html"

/* Regions with triangles. */
struct outputs_changes_counts {
	uint64_t since, old_job; /* generation and job of the old mesh; 0: none came */
	uint64_t gone, gone_triangles, kept, kept_triangles, new_regions, new_triangles;
};

struct outputs_left_out {
	bool given; /* the option was */
	uint64_t triangles;
	double area; /* NAN where the unit of x and y is no known length */
};

/* The result at the end of the stream. Lengths and areas are in file units. */
struct outputs_report {
	uint64_t bytes; /* of all outputs */
	struct outputs_left_out left_out, left_out_by[OUTPUTS_REASONS];
	bool all_left_out;          /* there were triangles, and none is left */
	char written[40];           /* digest of the triangles that the files have */
	char cut[OUTPUTS_CUTS][40]; /* digests of areas; "": not given */
	char unit_xy[16];           /* of the file */
	struct outputs_changes_counts changes;
	struct format_simplified simplified; /* of all outputs of contours with --simplify */
	uint64_t tiles;                      /* files of tiles, of levels, too; 0 without any */
	uint32_t no_lines;                   /* bits: outputs of lines that have none, in the order of the adds */
	double longest_edge, median_edge;    /* if edges were asked for; 0 without triangles */
	double long_share; /* of the area of all triangles, the part of those with an edge above OUTPUTS_LONG_EDGE medians */
};

struct outputs;
int outputs_new(const struct outputs_options *, struct outputs **ret, struct err *err);
/* Cuts by the polygons of a file, too; before the adds. Errors name it. */
int outputs_cut(struct outputs *, enum outputs_cut, const char *file, struct err *err);
/* Opens an output: "-" is standard output; for tiles, their folder, which is made; NULL for a format that writes nothing.
 * -ERR_USAGE: a wrong combination. */
int outputs_add(struct outputs *, const char *path, const struct format *, const struct format_options *, struct err *err);
/* The sink to hand to acut_fetch; valid as long as the run. `progress` is left NULL. */
struct acut_mesh_sink outputs_sink(struct outputs *);
/* The same of a run of changes, for acut_fetch_changes. */
struct acut_changes_sink outputs_changes(struct outputs *);
/* The failure of a callback of the sink; code ERR_NONE if none failed. */
const struct err *outputs_error(const struct outputs *);
/* Keeps the received part of the job's mesh in files beside the outputs (NAME.part, NAME.part.faces, and NAME.part.state
 * beside the first), so that later outputs with the same names and options can continue. After the adds, before the sink is
 * used. `on`: continues what was kept, or fails: -ERR_GONE: nothing is kept; -ERR_USAGE: it is of another job, or of other
 * outputs or options, or one of them cannot be kept; -ERR_CORRUPT: it is damaged; -ERR_BUSY: another process has it. Else
 * kept files are replaced, and nothing is kept if one output cannot be. */
int outputs_keep(struct outputs *, uint64_t job, bool on, struct err *err);
/* The kept state of the fetch; NULL: it starts at the beginning. */
const void *outputs_kept(const struct outputs *, size_t *ret_size);
/* It is time to save: after the first block, every 64 MiB ($ACUT_FETCH_SYNC) or 5 seconds. */
bool outputs_due(const struct outputs *);
/* Makes durable what the run has, with the state of the fetch (acut_fetch_state) as of the last block. Does nothing
 * where nothing is kept. */
int outputs_save(struct outputs *, const void *state, size_t size, struct err *err);
bool outputs_saved(const struct outputs *); /* a later run can go on */
/* The origin of the mesh, for the index of tiles or changes; before publishing. Copies `dataset`. */
void outputs_about(struct outputs *, uint64_t job, const char *dataset, uint64_t generation);
/* After the tail: makes all outputs durable and gives them their names. */
int outputs_publish(struct outputs *, struct err *err);

/* ---- outputs that several processes make (outputs_part.c) ---- */

/* Of a part that was published: what joining needs, to be freed. */
int outputs_part(const struct outputs *, uint8_t **ret, size_t *ret_size, struct err *err);
/* Between head and tail of the run that joins: a part, by these bytes. outputs_publish then gives all files their names, once
 * more if it was interrupted. */
int outputs_join(struct outputs *, const char *part, const void *bytes, size_t size, struct err *err);
/* The files of a part, by these bytes, that have their names already are named as parts again. `folder`: of tiles and levels;
 * else NULL. */
int outputs_part_take_back(const char *folder, const char *part, const void *bytes, size_t size, struct err *err);
/* Removes the files of a part that was published and counts for nothing. */
void outputs_part_drop(const struct outputs *);

/* With share_of: between head and tail, in place of blocks. Whether some of these are in the bytes of this process: the number of
 * the first, and how many. Then the caller gives them all, vertices with their numbers in the file. `count`: these triangles
 * belong to the statistics of this process. */
bool outputs_share_wants(const struct outputs *, const uint64_t vertices[2], const uint64_t triangles[2]);
int outputs_share_vertices(struct outputs *, uint64_t first, const int32_t (*)[3], uint64_t n, struct err *err);
int outputs_share_triangles(struct outputs *, uint64_t first, const struct format_piece *, uint32_t n, bool count,
			    struct err *err);

/* The place of a tile among all of a mesh: columns and rows from the first ones of the box of the head, their bits in turn, those
 * of columns first from below. Tiles with codes that follow each other lie close to each other. */
uint64_t outputs_tile_code(uint32_t column, uint32_t row);
/* The tiles of a head's box with sides of `tile`: *ret_count of columns and rows. -ERR_USAGE, as of outputs_tiles. `corner`,
 * lattice numbers, to the column and row of the tile that has the point. */
struct outputs_grid {
	uint64_t p, q;
	int64_t k[2], first[2];
	uint64_t count[2];
};
int outputs_grid_init(struct outputs_grid *, struct decimal tile, const struct acut_mesh_head *, struct err *err);
void outputs_grid_at(const struct outputs_grid *, const int32_t corner[2], uint32_t ret[2]);
/* Whether a tile with a code of `share` is among those between two. */
bool outputs_grid_meets(const uint32_t low[2], const uint32_t high[2], const uint64_t share[2]);
void outputs_report(const struct outputs *, struct outputs_report *ret);
struct outputs *outputs_free(struct outputs *);

#endif
