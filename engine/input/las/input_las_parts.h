/*
 * Shared by the files of this room; nobody else includes it, but for the tests, which look at the raw
 * records as the reader steps through them.
 */
#ifndef INPUT_LAS_PARTS_H
#define INPUT_LAS_PARTS_H

#include "input_las.h"
#include "laz.h"

/* State of a COPC file; see input_copc.c. */
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

/* Points in LASzip's compatibility mode; see input_las_compat.c. */
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

/* Fields of the LAS header that are needed only while the file is opened. */
struct input_las_header {
	unsigned encoding, format_byte;
	uint32_t point_offset, n_vlrs, n_evlrs, legacy_count;
	uint64_t count, evlr_offset, waveform;
	uint64_t returns[16];
	double scale[3], offset[3], min[3], max[3];
};

static inline struct input_las *input_las_of(const struct input *in)
{
	return input_state(in);
}

bool input_las_matches(const uint8_t *bytes, size_t n);
int input_las_open(struct input *in, struct err *err);
/* Reads the variable length records, before and after the points, and fills in the CRS. */
int input_las_read_vlrs(struct input *in, uint32_t n_vlrs, uint64_t evlr_offset, uint32_t n_evlrs, struct err *err);
/* Whether a record "lascompatible" can have that size. */
bool input_las_compat_is(uint64_t size);
/* After the records were read: finds the fields of the original points. Uses the read buffer. */
int input_las_compat_open(struct input *in, struct input_las_header *h, struct err *err);
/* The last n points of `pts`, made of these records as older ones, become the original ones. */
void input_las_compat_restore(const struct input_las *, const uint8_t *records, size_t n, struct input_points *pts);
/* Drops, with a warning, pointers of the header to data behind the points that lead into the points. */
int input_las_check_behind(struct input *in, struct input_las_header *h, struct err *err);
/* Finds the bytes of the file that belong to points and records, and whether the others belong to nothing. */
int input_las_settle_behind(struct input *in, const struct input_las_header *h, struct err *err);
/* The points end at byte `points_end`: the known part of the file ends there, or at the end of the records behind them. */
void input_las_account(struct input *in, uint64_t points_end);
/* `how`: "" or "up to "; `of`: "", if n are points. */
void input_las_tell_uncounted(struct input *in, const char *how, uint64_t n, const char *of);
/* The byte by which the points must have ended: the start of what follows, if the header has it. */
uint64_t input_las_points_end(const struct input *in, const struct input_las_header *h);
unsigned input_las_min_length(unsigned format); /* 0: no such format */
/* Compressed: `points` that the header claims, up to byte `end` of the file. Looks at the chunk table. */
int input_laz_open(struct input *in, uint64_t points, uint64_t end, struct err *err);
/* The next records to the buffer; none are left when n_buffered is 0, and then `left` is. */
int input_laz_refill(struct input *in, struct err *err);
/* Called after all points were read: without a table, only now their end is known. */
void input_laz_finish(struct input *in);
void input_laz_part(struct input *in, uint64_t first, uint64_t last);
/* Records in a part of uncompressed LAS. The parts of compressed LAS are its chunks. */
enum { INPUT_LAS_PART = 1 << 18 };
void input_laz_close(struct input *in);

/* For a COPC file with a crop box: selects the nodes to be read (copc.selects). `table` is at its first chunk. */
int input_copc_open(struct input *in, struct laz_table *table, struct err *err);
void input_copc_walk_begin(struct input_copc_walk *, const struct input_copc *, bool whole);
/* The next node with points. *ret_why: the hierarchy cannot be used, static text. */
int input_copc_walk_next(struct input *in, struct input_copc_walk *, struct laz_chunk *ret, bool *ret_meets, bool *ret_more,
			 const char **ret_why, struct err *err);

#endif
