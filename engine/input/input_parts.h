/*
 * Shared by the files of this room; nobody else includes it, but for the tests, which look at the raw
 * records as the reader steps through them.
 */
#ifndef INPUT_PARTS_H
#define INPUT_PARTS_H

#include <stdalign.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <time.h>

#include "crs.h"
#include "err.h"
#include "input.h"
#include "laz.h"

enum { INPUT_BUFFER = 256 * 1024 };

/* One format. `matches` looks at the first bytes (up to INPUT_SNIFF); `open` reads header or text and
 * fills in->info; `read` goes on where it was. None keeps anything outside of struct input, but for what
 * `close` (or NULL) frees. `part` (or NULL: only one) turns a copy of the whole input into a reader of parts. */
enum { INPUT_SNIFF = 4096 };

struct input_row {
	const struct input_format_row *text; /* extensions: ".las .laz" */
	bool (*matches)(const uint8_t *bytes, size_t n);
	int (*open)(struct input *in, struct err *err);
	int (*read)(struct input *in, struct input_points *pts, struct err *err);
	void (*part)(struct input *in, uint64_t first, uint64_t last);
	void (*close)(struct input *in);
};

extern const struct input_row input_rows[];
extern const size_t input_n_rows;

/* Of a COPC file; see input_copc.c. */
struct input_copc {
	uint64_t info_at;   /* body of the record copc/1; 0: the file is no COPC file */
	uint64_t at, bytes; /* body of the record copc/1000, the hierarchy; 0: there is none */
	bool selects;       /* only nodes that meet the crop box are read */
	uint64_t nodes;     /* so many */
	uint64_t root_at, root_bytes;
	uint64_t data_at, data_end; /* where points may be */
	double low[2], side;        /* the cube, in x and y */
	double crop[4], margin;
};

struct input_copc_page {
	uint64_t at, end;
	int32_t key[4]; /* of the node that it belongs to: level, x, y, z */
};

struct input_copc_walk {
	const struct input_copc *copc;
	bool whole; /* all nodes, not only those that meet the box */
	unsigned depth;
	uint64_t left;     /* entries, at most */
	uint64_t block_at; /* place in the file */
	size_t block_n;
	struct input_copc_page page[33];
	uint8_t block[2048];
};

typedef void input_watch_fn(void *arg, const uint8_t *records, size_t n, size_t length);

/* Of points in LASzip's compatibility mode; see input_las_compat.c. */
struct input_las_compat {
	uint64_t record_at; /* body of the record "lascompatible"; 0: there is none */
	uint64_t extra_at;  /* body of the record of extra bytes; 0: there is none */
	size_t extra_size;
	unsigned minor, format;       /* of the original points; format 0: they are what the header says */
	unsigned returns, cls, flags; /* places in a record */
};

struct input_las {
	unsigned format, length; /* point data record format, bytes of a record */
	unsigned major, minor, encoding, header_size;
	uint64_t point_offset;
	uint64_t left;                 /* records still to be handed out */
	uint64_t at;                   /* file offset of the next record to be read into the buffer */
	size_t n_buffered, i_buffered; /* records in the buffer; the next one to be handed out */
	bool has_laszip;               /* a record says how the points are compressed: its body and place */
	uint8_t laszip[80];
	size_t laszip_size;
	uint64_t laszip_at;
	bool compressed;
	bool uncounted;       /* the header counts no points, but there are some */
	uint64_t records_end; /* of what lies behind the points, as far as it is there; 0: nothing */
	uint64_t chunks_end;  /* of compressed points and their table, where there is one */
	struct laz_format laz;
	struct laz_place place; /* `end` is where the points end, for the reader of points */
	uint64_t chunks;        /* in the table; 0: there is none, or it cannot be used */
	struct input_copc copc;
	struct input_las_compat compat;
	uint64_t part_first, part_last;    /* chunks to be read */
	void *memory;                      /* from the first read on */
	struct input_laz_reading *reading; /* in it */
	size_t rest;                       /* of a pipe: bytes of a record begun, behind the records in the buffer */
	input_watch_fn *watch;             /* tests: sees every record that is handed out, in order */
	void *watch_arg;
};

/* Of a LAS header what is wanted only while the file is opened. */
struct input_las_header {
	unsigned encoding, format_byte;
	uint32_t point_offset, n_vlrs, n_evlrs, legacy_count;
	uint64_t count, evlr_offset, waveform;
	uint64_t returns[16];
	double scale[3], offset[3], min[3], max[3];
};

/* What a column of a text is; roles up to INPUT_ROLES are read. */
enum input_role { INPUT_X, INPUT_Y, INPUT_Z, INPUT_CLASS, INPUT_RETURN, INPUT_RETURNS, INPUT_ROLES, INPUT_SKIPPED = INPUT_ROLES };
enum { INPUT_COLUMNS = 64 };

struct input_columns {
	uint8_t role[INPUT_COLUMNS];
	unsigned n;        /* up to the last one that is read */
	bool cls, returns; /* there are columns of them */
	bool named;        /* a line of names says so, and not --columns */
};

/* What raw numbers are multiples of, and how what lies between becomes one (input_place.c): nothing does; to the nearest, half
 * upwards; or to the odd one of the two beside it, so that rounding it once more to a hundred units or more is rounding once. */
struct input_place {
	enum { INPUT_EXACT, INPUT_NEAREST, INPUT_ODD } rounding;
	struct decimal scale;
};

enum input_encoding { INPUT_UTF8, INPUT_UTF16_LE, INPUT_UTF16_BE, INPUT_UTF16_UNMARKED, INPUT_UTF32 };

struct input_xyz {
	struct input_columns columns;
	enum input_encoding encoding;
	uint8_t half[4]; /* of UTF-16: bytes read, but no whole character yet */
	size_t n_half;
	struct input_place place[2]; /* of x and y, of z */
	uint64_t at;                 /* file offset of the next byte to be read into the buffer */
	uint64_t line;               /* of the line handed out last, from 1 */
	uint64_t head;               /* lines before the points: up to this one they are not read again */
	size_t i_buffered, n_buffered;
	uint64_t points; /* handed out so far */
	bool ended;
	bool head_only;  /* of a pipe: while opening, what is there already is all */
	bool counts;     /* .pts: a line of one number says how many points follow */
	unsigned commas; /* columns of the first point, if commas separate them; else 0 */
	uint64_t first;  /* line that should be the first point; 0: there is none */
	bool guesses;    /* neither names nor --columns say what the columns are */
	uint64_t names;  /* the line of names; 0: there is none */
	bool counting;   /* of what is told at the end: of a file while it is opened, of a pipe while it is read */
	bool begun;      /* since then a point was seen */
	uint64_t commented, commented_line; /* comments that may be points, and the first (input_comment.c) */
	uint64_t unread, unread_line;       /* lines whose class or return is none */
};

/* Of a PTX file; see input_ptx.c. */
struct input_ptx {
	struct input_xyz text;        /* first: the reader of lines keeps its place in as.xyz */
	int64_t turn[3][3];           /* of the scan's matrix, in 1e-15: a row for x, y, z of a cell */
	int64_t shift[3];             /* in nanometres */
	uint64_t scans;               /* begun so far */
	uint64_t scan_line;           /* where the last one begins */
	uint64_t columns, rows, left; /* of that scan; cells still to come */
	uint64_t cells, empty;        /* read so far; those without a return */
	bool begun;                   /* the line with the columns of the next scan was read: */
	uint64_t begun_columns, begun_line;
	bool probing;
};

struct input {
	int fd;
	char name[1024];
	bool accept_truncated, planar, degrees, any_plane, has_crop;
	double crop[4];
	bool has_pipe, dry; /* dry: the pipe has no bytes now */
	int pipe;
	void (*pipe_seen)(void *ctx, const void *bytes, size_t n);
	void (*seen)(void *ctx, uint64_t at, const void *bytes, size_t n);
	void *seen_ctx;
	void *pipe_ctx;
	uint64_t head;             /* bytes of the descriptor, before those of the pipe */
	uint64_t size;             /* of a pipe: more than any file has */
	const char *columns;       /* of input_options, while opening */
	struct decimal lattice[2]; /* of input_options: scales of x and y, of z; zero: not known */
	bool lattice_later, decimal_comma, strict;
	struct timespec mtime;
	const struct input_row *row;
	struct input_info info;
	uint64_t bytes_read; /* since it was opened */
	bool checked;        /* the end was reached, and the file is still the one that was opened */
	union {
		struct input_las las;
		struct input_xyz xyz;
		struct input_ptx ptx;
	} as;
	alignas(16) uint8_t buffer[INPUT_BUFFER];
};

/* -code, with place and file filled in. */
#define input_fail(in, err, code, offset, field, ...) \
	(err_set((err), code, __VA_ARGS__), err_add_place((err), (offset), (field)), err_add_file((err), (in)->name))

/* Degrees that nobody projects, and geocentric coordinates, are no plane. -ERR_UNSUPPORTED. */
int input_check_plane(struct input *in, struct err *err);
/* A lie that does no harm: said once, in info.warning. */
void input_warn(struct input *in, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
/* -ERR_CHANGED if size or time of the file are not those of input_open. */
int input_check_unchanged(struct input *in, struct err *err);

/* Up to n bytes of a pipe's input at place `at`, which only goes forwards. *ret_n 0: its end, or in->dry. */
int input_forward_read(struct input *in, uint64_t at, void *buf, size_t n, size_t *ret_n, struct err *err);

bool input_las_matches(const uint8_t *bytes, size_t n);
int input_las_open(struct input *in, struct err *err);
int input_las_read(struct input *in, struct input_points *pts, struct err *err);
/* Reads the variable length records, before and after the points, and fills in the CRS. */
int input_las_read_vlrs(struct input *in, uint32_t n_vlrs, uint64_t evlr_offset, uint32_t n_evlrs, struct err *err);
/* Whether a record "lascompatible" can have that size. */
bool input_las_compat_is(uint64_t size);
/* Where the fields of the original points are, once the records were read. Uses the read buffer. */
int input_las_compat_open(struct input *in, struct input_las_header *h, struct err *err);
/* The last n points of `pts`, made of these records as older ones, become the original ones. */
void input_las_compat_restore(const struct input_las *, const uint8_t *records, size_t n, struct input_points *pts);
/* Forgets, with a warning, what the header says that begins behind the points where that is inside of them. */
int input_las_check_behind(struct input *in, struct input_las_header *h, struct err *err);
/* How many bytes of the file are accounted for, and of the others whether they belong to nothing. */
int input_las_settle_behind(struct input *in, const struct input_las_header *h, struct err *err);
/* The points end at byte `points_end`: what is accounted for ends there, or at the end of the records behind. */
void input_las_account(struct input *in, uint64_t points_end);
/* `how`: "" or "up to "; `of`: "", if n are points. */
void input_las_tell_uncounted(struct input *in, const char *how, uint64_t n, const char *of);
/* Where the points must end: at what follows them, if the header says where that begins. */
uint64_t input_las_points_end(const struct input *in, const struct input_las_header *h);
unsigned input_las_min_length(unsigned format); /* 0: no such format */
/* Compressed: `points` that the header claims, up to byte `end` of the file. Looks at the chunk table. */
int input_laz_open(struct input *in, uint64_t points, uint64_t end, struct err *err);
/* The next records to the buffer; none are left when n_buffered is 0, and then `left` is. */
int input_laz_refill(struct input *in, struct err *err);
/* All was read: without a table it shows only now how far the points go. */
void input_laz_finish(struct input *in);
void input_laz_part(struct input *in, uint64_t first, uint64_t last);
/* Of LAS that is not compressed, so many records are a part; compressed, its chunks are. */
enum { INPUT_LAS_PART = 1 << 18 };
void input_las_part(struct input *in, uint64_t first, uint64_t last);
void input_laz_close(struct input *in);

/* Of a COPC file, with a crop box: selects the nodes to be read (copc.selects). `table` is at its first chunk. */
int input_copc_open(struct input *in, struct laz_table *table, struct err *err);
void input_copc_walk_begin(struct input_copc_walk *, const struct input_copc *, bool whole);
/* The next node with points. *ret_why: the hierarchy cannot be used, static text. */
int input_copc_walk_next(struct input *in, struct input_copc_walk *, struct laz_chunk *ret, bool *ret_meets, bool *ret_more,
			 const char **ret_why, struct err *err);

/* Whether a name ends in one of ".las .laz", in any case. */
bool input_has_extension(const char *name, const char *extensions);
/* -ERR_INPUT if the first n bytes, in the buffer, are those of a format of other programs: names it, and what converts it. */
int input_foreign_check(struct input *in, size_t n, struct err *err);

/* NULL is fine. -ERR_USAGE. */
int input_columns_check(const char *text, struct err *err);
bool input_pts_matches(const uint8_t *bytes, size_t n);
bool input_xyz_matches(const uint8_t *bytes, size_t n);
int input_xyz_open(struct input *in, struct err *err);
int input_xyz_read(struct input *in, struct input_points *pts, struct err *err);
bool input_ptx_matches(const uint8_t *bytes, size_t n);
int input_ptx_open(struct input *in, struct err *err);
int input_ptx_read(struct input *in, struct input_points *pts, struct err *err);

/* value = mantissa * 10^exponent, no trailing zero in the mantissa; `written` is the place of the last
 * digit that stands in the text, zero or not, at most 0. */
struct input_number {
	int64_t mantissa;
	int exponent, written;
	bool deep;       /* there are more digits than that, or below 10^-15: all of them are in the text */
	uint16_t length; /* of a deep one: its text, */
	const char *at;  /* valid as long as its line */
};

/* TOO_LONG: 10^19 or more. */
enum input_number_state { INPUT_NUMBER_OK, INPUT_NUMBER_BAD, INPUT_NUMBER_NOT_FINITE, INPUT_NUMBER_TOO_LONG };

/* Whether a letter behind digits begins an exponent: e, or behind digits with a point the d of Fortran (1.0D+02); without one
 * "3D1" is more likely a name. */
static inline bool input_number_exponent_at(char c, bool point)
{
	return (c | 0x20) == 'e' || (point && (c | 0x20) == 'd');
}

/* One number at *at, up to `end`; *at moves behind it. Decimal point, optional exponent. */
enum input_number_state input_number_read(const char **at, const char *end, struct input_number *ret);

/* All digits that count: the value lies in [mantissa, mantissa + 1) * 10^exponent if there are more, else it is the lower
 * end, and has this sign. With more the mantissa has 36 digits. */
struct input_digits {
	unsigned __int128 mantissa;
	int exponent;
	bool negative, more;
};
struct input_digits input_number_digits(const struct input_number *);

#endif
