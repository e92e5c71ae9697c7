/* The files of a simplification in progress: arrays of records, and texts of numbers. All have checksums. Internal. */
#ifndef SIMPLIFY_FILE_H
#define SIMPLIFY_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "digest.h"
#include "grid_file.h"

struct err;

enum { SIMPLIFY_INFO = 6, SIMPLIFY_BUFFER = 64 << 10 };

/* An array that is written once. */
struct simplify_out {
	struct grid_file file;
	struct digest_stream *hash;
	size_t each; /* bytes of a record */
	uint64_t n;
	uint8_t buf[SIMPLIFY_BUFFER];
};
int simplify_out_begin(struct simplify_out *, int dirfd, const char *name, size_t each, struct err *err);
int simplify_out_add(struct simplify_out *, const void *records, size_t n, struct err *err);
/* Gives the file its name. `info`: numbers for the reader, may be NULL. Frees the rest, also after a failure. */
int simplify_out_end(struct simplify_out *, const uint64_t info[SIMPLIFY_INFO], struct err *err);
void simplify_out_abort(struct simplify_out *); /* nothing is left; fine after the end */

/* An array that is read from the front. At its end the checksum is compared. -ERR_CORRUPT: it is damaged, torn, or gone. */
struct simplify_in {
	int dirfd, fd;
	char name[GRID_NAME_MAX];
	struct digest_stream *hash;
	struct digest sum;
	size_t each;
	uint64_t n, at; /* records; those read */
	uint64_t info[SIMPLIFY_INFO];
};
int simplify_in_begin(struct simplify_in *, int dirfd, const char *name, size_t each, struct err *err);
/* Up to `most` records; *ret 0 at the end. */
int simplify_in_read(struct simplify_in *, void *records, size_t most, size_t *ret, struct err *err);
/* Records from..from + n, without the checksum. */
int simplify_in_some(const struct simplify_in *, void *records, uint64_t from, size_t n, struct err *err);
void simplify_in_end(struct simplify_in *);
bool simplify_file_exists(int dirfd, const char *name);
bool simplify_file_whole(int dirfd, const char *name); /* it is there, and its checksum is right */

/* Numbers by name, as lines of text. A number that a file lacks is zero. */
struct simplify_row {
	const char *name;
	size_t at; /* of a uint64_t in the struct */
};
int simplify_text_write(int dirfd, const char *name, const char *head, const struct simplify_row *rows, size_t n,
			const void *from, enum grid_durability, struct err *err);
/* -ERR_CORRUPT: it is damaged, or gone. */
int simplify_text_read(int dirfd, const char *name, const char *head, const struct simplify_row *rows, size_t n, void *to,
		       struct err *err);

#endif
