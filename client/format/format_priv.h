/* What the files of this room share and others do not see. */
#ifndef FORMAT_PRIV_H
#define FORMAT_PRIV_H

#include "format.h"

/* ---- outputs: format_output.c ---- */

/* Takes the place of `path` when published. Regular files are written under a temporary name beside it;
 * standard output ("-"), pipes and devices are written as they are. */
int format_output_new(const char *path, bool no_clobber, struct format_output **ret, struct err *err);
/* A nameless file on the same file system (for standard output: in $TMPDIR, else /var/tmp). */
int format_output_spool(const struct format_output *, struct format_output **ret, struct err *err);
/* A second place to append, for what comes after all of the output but is written meanwhile. */
int format_output_annex(struct format_output *, struct format_output **ret, struct err *err);
/* Room for n bytes at the end of the buffer (n <= FORMAT_BUFFER - FORMAT_BUFFER_KEPT), NULL on failure; then say
 * how many. FORMAT_BUFFER_BEHIND bytes behind them may be overwritten too. */
void *format_output_room(struct format_output *, size_t n, struct err *err);
void format_output_used(struct format_output *, size_t n);
/* Bytes that are free in the buffer: no more than these are taken without writing it. */
size_t format_output_left(const struct format_output *);
int format_output_write(struct format_output *, const void *bytes, size_t n, struct err *err);
/* Overwrite bytes written before; only if the output can seek. */
int format_output_patch(struct format_output *, uint64_t at, const void *bytes, size_t n, struct err *err);
/* Appends all of a spool or annex. Of an annex larger than FORMAT_BUFFER to an output that can seek, up to 4095
 * records of `record` bytes (an odd number) come from its end to its front. */
int format_output_join(struct format_output *, struct format_output *from, size_t record, struct err *err);
/* Reads back from a spool: n bytes at `at`. */
int format_output_read(struct format_output *, uint64_t at, void *bytes, size_t n, struct err *err);
/* What is written up to here may be patched later: it is not compared when a kept output goes on. */
int format_part_from_here(struct format_output *, struct err *err);
bool format_output_seekable(const struct format_output *);
uint64_t format_output_size(const struct format_output *);
const char *format_output_name(const struct format_output *);
/* Flush, fsync, rename, fsync of the folder. */
int format_output_publish(struct format_output *, struct err *err);
/* Removes what was not published. */
struct format_output *format_output_free(struct format_output *);

#define FORMAT_BUFFER (1u << 20)
#define FORMAT_BUFFER_KEPT 4096 /* what may stay in it when it was written */
#define FORMAT_BUFFER_BEHIND 16
#define FORMAT_ANNEX_AT (1ull << 37) /* an output with an annex stays below this size until they are joined */

/* ---- lattice numbers to coordinates: format_axis.c ---- */

/* (X * a + b) / q */
struct format_fraction {
	__int128 a, b, q;
};

/* value = (X * a + b) * 10^e, all exact; of a converted axis: format_unit.c */
struct format_axis {
	int64_t a, b;
	int32_t e;
	bool whole;   /* a, b, e hold; else scale and k, without origin */
	bool fast;    /* |X * a + b| < 2^53 and |e| <= 22: one rounding in doubles */
	double power; /* 10^|e| */
	struct decimal scale;
	int64_t k;
	bool converted;
	int decimals; /* of the text */
	struct format_fraction value, text;
};

#define FORMAT_COORDINATE 64 /* room for one coordinate as text */

/* Three axes of a stream; origin as the options say, rounded to the lattice if "auto". */
int format_axis_init(struct format_axis axis[3], const struct acut_mesh_head *, const struct format_options *, struct err *err);
double format_axis_value(const struct format_axis *, int32_t number);
/* n vertices to n * 3 doubles. */
void format_axis_values(const struct format_axis axis[3], const int32_t (*vertex)[3], size_t n, double *ret);
/* Exact text at `at`, as many decimals as the lattice has; returns the end. 8 bytes more may be overwritten. */
char *format_axis_text(const struct format_axis *, int32_t number, char *at);
/* "acut-origin X Y Z" text if one was taken, else "". */
char *format_axis_origin(const struct acut_mesh_head *, const struct format_options *, char *buf, size_t size);

/* ---- units of length: format_unit.c ---- */

/* One `from` is num/den of `to`; false unless both are names of lengths ("metre", "foot", "us-survey-foot"). */
bool format_unit_ratio(const char *from, const char *to, int64_t *num, int64_t *den);
/* Multiplies an axis whose a, b, e hold, and takes the origin off then. Negative: too many digits. */
int format_unit_axis(struct format_axis *, int64_t num, int64_t den, struct decimal origin);
double format_unit_value(const struct format_axis *, int32_t number); /* nearest double */
char *format_unit_text(const struct format_axis *, int32_t number, char *at);
/* "acut-z-unit ..." if heights are converted, else "". */
char *format_unit_comment(const struct acut_mesh_head *, const struct format_options *, char *buf, size_t size);

/* ---- comments of text headers: format_comment.c ---- */

/* Calls `line` for each comment: acut-lattice, acut-crs, acut-units, acut-origin. */
int format_comment_head(const struct acut_mesh_head *, const struct format_options *,
			int (*line)(void *ctx, const char *text, struct err *), void *ctx, struct err *err);
#define FORMAT_COMMENT 768

/* ---- positions of open vertices: format_open.c ---- */

struct format_open {
	struct format_open_slot {
		uint64_t number;
		int32_t at[3];
		uint32_t used;
	} * slot;
	size_t size, used;      /* size a power of two */
	int32_t (*position)[3]; /* of the current block */
	size_t room;
};
/* Positions of all local vertices of the block; afterwards the table holds what later blocks may use. */
int format_open_block(struct format_open *, const struct acut_mesh_block *, const int32_t (**ret)[3], struct err *err);
void format_open_done(struct format_open *);
enum { FORMAT_OPEN_SAVED = 20 }; /* bytes a vertex, and 8 */
void format_open_save(const struct format_open *, struct packer *);
/* Into an empty one. -ERR_NOMEM; the cursor is bad where it is damaged. */
int format_open_load(struct format_open *, struct cursor *, struct err *err);

/* ---- --max-edge and edge statistics: format_edge.c ---- */

#define FORMAT_EDGE_BUCKETS (70 * 16)
struct format_edge {
	bool limited, none_longer; /* none_longer: the limit is beyond every edge */
	unsigned __int128 limit;   /* squared lattice length: longer edges are left out */
	bool gather;
	double scale;
	char unit[16]; /* of x and y */
	uint64_t left_out;
	unsigned __int128 left_out_area2;            /* twice the area, lattice units */
	double longest;                              /* squared, lattice units */
	uint64_t count, bucket[FORMAT_EDGE_BUCKETS]; /* of the squared length, 16 from one power of two to the next */
	double area[FORMAT_EDGE_BUCKETS];            /* of triangles, lattice units, by their longest edge */
	uint32_t (*triangle)[3];
	size_t room;
};
/* limit * num / den / scale as p / q in lowest terms; false if it does not fit 64 bits. */
bool format_edge_ratio(struct decimal limit, int64_t num, int64_t den, struct decimal scale, uint64_t *ret_p, uint64_t *ret_q);
int format_edge_init(struct format_edge *, const struct acut_mesh_head *, const struct format_run_options *, struct err *err);
/* *ret is the block without the triangles left out; it points into the filter and the block. */
int format_edge_block(struct format_edge *, const struct acut_mesh_block *, const int32_t (*position)[3],
		      struct acut_mesh_block *ret, struct err *err);
double format_edge_median(const struct format_edge *);
double format_edge_longest(const struct format_edge *);
/* Of the area of all triangles, the part of those with an edge longer than `length` (file units): 0 to 1. */
double format_edge_share(const struct format_edge *, double length);
double format_edge_area(const struct format_edge *);
void format_edge_done(struct format_edge *);
void format_edge_save(const struct format_edge *, struct packer *); /* what was counted */
void format_edge_load(struct format_edge *, struct cursor *);
void format_edge_load_1(struct format_edge *, struct cursor *);

/* ---- external sort of small records of 64-bit words: format_sort.c ---- */

struct format_sort;
/* Records of `words` words; the first `keys` of them are the order. At most `memory` bytes. */
int format_sort_new(unsigned words, unsigned keys, uint64_t memory, const struct format_output *beside, struct format_sort **ret,
		    struct err *err);
int format_sort_add(struct format_sort *, const uint64_t *record, struct err *err);
int format_sort_start(struct format_sort *, struct err *err);
/* *ret: the next record, valid until the next call; NULL at the end. */
int format_sort_next(struct format_sort *, const uint64_t **ret, struct err *err);
struct format_sort *format_sort_free(struct format_sort *);

/* ---- --canonical: format_canonical.c ---- */

struct format_canonical;
int format_canonical_new(const struct format *, void *writer, const struct format_output *beside, uint64_t memory,
			 struct format_canonical **ret, struct err *err);
/* Vertices come once for each triangle that has them, and are written once. */
void format_canonical_merge(struct format_canonical *);
int format_canonical_block(struct format_canonical *, const struct format_block *, struct err *err);
/* Sends everything to the writer, in order, as blocks; the caller finishes the writer. */
int format_canonical_finish(struct format_canonical *, struct err *err);
struct format_canonical *format_canonical_free(struct format_canonical *);

/* ---- triangles to pixels: format_raster.c ---- */

struct format_raster {
	uint32_t w, h;
	float *z;         /* lattice numbers, row 0 is the north; NaN where nothing is */
	uint32_t *domain; /* NULL unless asked for; hash of the region */
	int32_t min[2];
	double factor; /* sub-pixels a lattice unit */
};
#define FORMAT_SUBPIXEL 256
/* For the box (min x y, max x y); the picture is `width` pixels wide, less if it would be very high. */
int format_raster_init(struct format_raster *, const int32_t min[2], const int32_t max[2], uint32_t width, bool domains,
		       struct err *err);
void format_raster_triangle(struct format_raster *, const int32_t *a, const int32_t *b, const int32_t *c, uint32_t domain);
void format_raster_done(struct format_raster *);

/* ---- pixels to colours: format_paint.c ---- */

struct format_paint {
	const struct format_raster *raster;
	enum format_color color;
	double cell, height; /* xy length of a pixel, z length of a number, in one unit */
	float low, high;     /* z numbers at the ends of the ramp */
};
void format_paint_init(struct format_paint *, const struct format_raster *, const struct acut_mesh_head *, enum format_color);
/* RGBA of the pixels x0 <= x < x1 of one row. */
void format_paint_row(const struct format_paint *, uint32_t y, uint32_t x0, uint32_t x1, uint8_t *ret);

extern const struct format format_ply, format_obj, format_png, format_null;

#endif
