/* Options, properties and points of an input. */
#ifndef INPUT_TYPES_H
#define INPUT_TYPES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "crs.h"
#include "lattice.h"

struct input;

/* Where a vertex of lines belongs (format "lines"). */
enum input_line_kind { INPUT_HARD, INPUT_LAKE, INPUT_BOUNDARY, INPUT_HOLE, INPUT_LINE_KINDS };
enum {
	INPUT_FEATURE_BEGINS = 1, /* it is the first one of its feature, */
	INPUT_LINE_BEGINS = 2,    /* of its line or ring */
	INPUT_IN_RING = 4,
};
struct input_vertex {
	uint32_t feature;   /* number in the file that the text was made of */
	uint8_t kind, bits; /* enum input_line_kind; INPUT_FEATURE_BEGINS ... */
};

/* A raw point: coordinate = raw * scale + offset of the input's lattice_input. */
struct input_points {
	int64_t (*raw)[3];
	uint8_t *cls;   /* class */
	uint8_t *ret;   /* as point.ret */
	uint8_t *flags; /* POINT_WITHHELD ... */
	size_t n, cap;
	struct input_vertex *vertex; /* of lines; NULL: nobody wants them */
};

/* Vertices that the ring of a lake may have whose level is chosen; input_info.read_bytes counts them. */
enum { INPUT_RING_MOST = 3 << 16 };

/* What a text of lines says of all of its lines, and how many there are. */
struct input_lines {
	bool are;                            /* its points are vertices of lines */
	uint64_t features[INPUT_LINE_KINDS]; /* by kind */
	uint64_t lines;                      /* and rings */
	struct decimal densify;              /* the longest segment; zero: any */
	char densify_unit[CRS_UNIT_SIZE];    /* "metre" ...; "": the unit of whatever the lines go to */
	enum { INPUT_LEVEL_NONE, INPUT_LEVEL_MIN, INPUT_LEVEL_MAX, INPUT_LEVEL_MEAN } level; /* of lakes whose z differ */
};

struct input_info {
	const char *format; /* "las", "xyz" */
	char variant[128];  /* "LAS 1.2, point format 3, 34 bytes" */
	uint64_t claimed;   /* points the header claims, or of them those selected; for text: counted by the probe */
	uint64_t most;      /* points that its bytes can hold, whatever the header claims; 0: not known (compressed) */
	struct lattice_input coords;
	struct crs_info crs;            /* what its records say; of text, the units in the names of its columns, and degrees */
	bool miscounted;                /* the warning says how many points are there, and that the header says another number */
	char warning[256];              /* a header lie that does no harm, "" if none */
	uint64_t parts;                 /* it can be read in so many parts, in any order and at once; 1: only forwards */
	uint64_t first_point;           /* of a part, once something was read: points of the file before it */
	bool partial;                   /* only parts that meet the crop box are read */
	uint64_t bytes, bytes_selected; /* of the file; without the points that need not be read */
	bool has_returns;               /* the header counts points by return: */
	uint64_t returns[16];           /* of return numbers 1 to 15 */
	bool has_trailing;              /* it is known where the records end: */
	uint64_t trailing;              /* bytes behind them that belong to nothing */
	uint64_t accounted;             /* bytes from the beginning of the file that belong to something, at most; of compressed
					 * points without a table exact only when they were read; 0: not known */
	uint64_t left_out, left_out_line; /* text: lines without a value for a coordinate, and the first; of a pipe: so far */
	bool no_classes;                  /* text: it has no column of classes, so all are 0 */
	struct input_lines lines;
	size_t read_bytes; /* that reading takes beside input_bytes, for each input or part of it */
};

struct input_options {
	const char *format; /* forced format, or NULL: by content */
	bool accept_truncated;
	bool planar;    /* take degrees as a plane */
	bool degrees;   /* take degrees: whoever reads them projects them */
	bool any_plane; /* take whatever plane the records say: whoever reads it knows better what it is */
	/* Points outside of this box (x and y from, to; in the file's coordinates) need not be given. Formats
	 * that know where their points are read less (COPC); the others give all. */
	bool has_crop;
	double crop[4];
	/* The descriptor holds the first bytes of an input, at least those before its points; what follows comes
	 * from `pipe`, a non-blocking descriptor (borrowed). Formats that can be read forwards: LAS, and xyz where the
	 * lattice does not come from it (its digits and its box are not known then). */
	bool has_pipe;
	int pipe;
	/* Is shown each piece that was taken out of the pipe, in order, once; NULL. */
	void (*pipe_seen)(void *ctx, const void *bytes, size_t n);
	void *pipe_ctx;
	/* Is shown what is read of the points, and where it lies, upwards and each byte once: of files of uncompressed
	 * records. Others show nothing, and nor does one that is read in parts (input_open_part). NULL. */
	void (*seen)(void *ctx, uint64_t at, const void *bytes, size_t n);
	void *seen_ctx;
	/* Text: what the columns are, a letter each: x y z (or e n z), c class, r return, n number of returns, and to be
	 * skipped s _ - i t a u p R G B. NULL: as a line of names says, else the first three; refused where that is not sure. */
	const char *columns;
	/* Text: the lattice that its points go to has these scales, as far as they are known (zero: not known). Numbers that
	 * have more digits than can be kept are rounded to it once: raw numbers tell the sides of a half, and whether they are
	 * on the lattice. Without it such numbers are rounded to the finest scale that holds the file. */
	struct decimal scale_xy, scale_z;
	bool decimal_comma; /* text: 123,45 is a number, and columns are not separated by commas */
	/* Text: a line without a value for a coordinate is an error, and so are a comment with the numbers of a point, and a
	 * class or return that is no number. Else they are counted, and the line is left out, not read, or read without a class.
	 */
	bool strict;
	bool lattice_later; /* who opens it says so, not info.warning */
};

/* The last read gave no points because the pipe has no bytes now; read again when it has. */
bool input_dry(const struct input *);

#endif
