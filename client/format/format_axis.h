/* Lattice numbers to coordinates, exactly; units of length; comments that describe the numbers. */
#ifndef FORMAT_AXIS_H
#define FORMAT_AXIS_H

#include "format.h"

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

/* Three axes of a stream, with the origin of the options, rounded to the lattice if "auto". */
int format_axis_init(struct format_axis axis[3], const struct acut_mesh_head *, const struct format_options *, struct err *err);
double format_axis_value(const struct format_axis *, int32_t number);
/* n vertices to n * 3 doubles. */
void format_axis_values(const struct format_axis axis[3], const int32_t (*vertex)[3], size_t n, double *ret);
/* Exact text at `at`, as many decimals as the lattice has; returns the end. 8 bytes more may be overwritten. */
char *format_axis_text(const struct format_axis *, int32_t number, char *at);
/* "acut-origin X Y Z" text if one was taken, else "". */
char *format_axis_origin(const struct acut_mesh_head *, const struct format_options *, char *buf, size_t size);

/* ---- units of length: format_unit.c ---- */

const char *format_unit_known(const char *unit); /* "unknown" for none */
/* How long one `unit` is in that of x and y, if it is not NULL, and one of z in `to`. -ERR_USAGE: it cannot be converted;
 * `option` is its name in messages. */
int format_unit_xy(const char *option, const char *unit, const char *unit_xy, int64_t *num, int64_t *den, struct err *err);
int format_unit_z(const char *unit_z, const char *to, int64_t *num, int64_t *den, struct err *err);
/* A number with a point before its last `decimals` digits. */
char *format_unit_digits(unsigned __int128 n, int decimals, char *at);
/* Multiplies an axis whose a, b, e hold, and then subtracts the origin. Negative: too many digits. */
int format_unit_axis(struct format_axis *, int64_t num, int64_t den, struct decimal origin);
double format_unit_value(const struct format_axis *, int32_t number); /* nearest double */
char *format_unit_text(const struct format_axis *, int32_t number, char *at);
/* "acut-z-unit ..." if heights are converted, else "". */
char *format_unit_comment(const struct acut_mesh_head *, const struct format_options *, char *buf, size_t size);

/* ---- comments of text headers: format_comment.c ---- */

/* Not all triangles of a mesh are written. */
bool format_is_part(const struct acut_mesh_head *, const struct format_options *);
/* Calls `line` for each comment: acut-lattice, acut-crs, acut-geoid, acut-units, acut-origin, acut-trimmed. */
int format_comment_head(const struct acut_mesh_head *, const struct format_options *,
			int (*line)(void *ctx, const char *text, struct err *), void *ctx, struct err *err);
#define FORMAT_COMMENT 768
/* The file's name without its extension, or `without` where it has none. Returns `buf`. */
char *format_file_name(const struct outfile *, const char *without, char *buf, size_t size);

#endif
