/* Writing a file once, sequentially, through a large buffer. Its name appears only when it is complete. */
#ifndef GRID_FILE_H
#define GRID_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;

enum { GRID_NAME_MAX = 64 };

/* Opens a file that a manifest names, for reading. If it is missing: -ERR_CORRUPT, with the errno. `what`: "the segment". */
int grid_file_open(int dirfd, const char *name, const char *what, int *ret_fd, struct err *err);

struct grid_file {
	int dirfd, fd; /* fd -1: not open */
	char name[GRID_NAME_MAX], temp[GRID_NAME_MAX + 8];
	uint8_t *buf;
	size_t cap, used;
	uint64_t at; /* place of buf[0] in the file */
};

#define GRID_FILE_INIT ((struct grid_file){.fd = -1})

/* `buf` of `cap` bytes is borrowed until publish or abort. */
int grid_file_create(struct grid_file *, int dirfd, const char *name, void *buf, size_t cap, struct err *err);
/* Reserves n <= cap bytes at the end of the file; grid_file_commit then appends the first n of them. */
int grid_file_reserve(struct grid_file *, size_t n, uint8_t **ret, struct err *err);
void grid_file_commit(struct grid_file *, size_t n);
uint64_t grid_file_place(const struct grid_file *);
int grid_file_append(struct grid_file *, const void *bytes, size_t n, struct err *err);
/* Overwrites bytes that were appended before. */
int grid_file_patch(struct grid_file *, uint64_t place, const void *bytes, size_t n, struct err *err);
/* GRID_DURABLE_DATA: the data are fsynced; the name is durable once the caller has fsynced the folder. */
enum grid_durability { GRID_TEMPORARY, GRID_DURABLE, GRID_DURABLE_DATA };
/* Gives the file its name. On failure neither the name nor the temporary file exists. */
int grid_file_publish(struct grid_file *, enum grid_durability, struct err *err);
void grid_file_abort(struct grid_file *); /* does nothing if not open */

#endif
