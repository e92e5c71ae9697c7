/*
 * Files for the tests of this room: LAS files made byte by byte, in memory (a memfd is a regular file),
 * and the real ones, where they are.
 */
#ifndef FIXTURE_H
#define FIXTURE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "err.h"
#include "input.h"

struct las_spec {
	unsigned minor, format, extra; /* version 1.minor; extra bytes of a record */
	uint64_t n;
	unsigned header_extra, gap; /* bytes behind the standard header; bytes before the points */
	uint16_t encoding;
	const char *wkt;    /* a WKT record, or NULL */
	bool wkt_behind;    /* after the points */
	uint32_t vlrs_more; /* claimed but not there */
};

struct bytes {
	uint8_t *at;
	size_t size;
};

/* A whole file. Record i is filled by fixture_record(). Freed by the caller. */
struct bytes fixture_las(const struct las_spec *spec);
/* The points of fixture_las(spec), of format 6 to 10, as LASzip writes them in its compatibility mode; `laz`: compressed, each
 * record a chunk of its own, which is raw. */
struct bytes fixture_compat(const struct las_spec *spec, bool laz);
/* Deterministic bytes of record i, and what must come out of them. */
void fixture_record(unsigned format, unsigned length, uint64_t i, uint8_t *ret);
unsigned fixture_length(unsigned format); /* of a record without extra bytes, by the standard's tables */
size_t fixture_header_size(unsigned minor);

int fixture_fd(const void *bytes, size_t size);

struct outcome {
	enum err_code code; /* 0: read to the end */
	uint64_t points;
	struct err err;
	struct input_info info;
};

/* Opens, reads all in batches of `batch`, closes. */
struct outcome fixture_read_fd(int fd, const char *name, const struct input_options *options, size_t batch);
struct outcome fixture_read(const void *bytes, size_t size, const char *name, const struct input_options *options, size_t batch);

void fixture_points_new(struct input_points *pts, size_t cap);
void fixture_points_free(struct input_points *pts);

/* Folder of the real files, "" if there is none (a reason is printed). */
const char *fixture_data(void);

uint32_t fixture_random(uint64_t *state);

/* Faults of pread and fstat, between begin and end. */
struct fixture_faults {
	unsigned calls, fail_at; /* calls so far; the call with this number fails with EIO */
	size_t at_most;          /* bytes that one pread gives; 0: all */
};
extern struct fixture_faults fixture_faults;

void fixture_faults_begin(void);
void fixture_faults_end(void);

#endif
