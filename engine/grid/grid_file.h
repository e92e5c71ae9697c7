/* A file that is written once, front to back, through a large buffer, and appears only whole. Internal. */
#ifndef GRID_FILE_H
#define GRID_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;

enum { GRID_NAME_MAX = 64 };

/* A file of that name for reading, which something else names: that it is gone is -ERR_CORRUPT, with the errno. `what`: "the
 * segment". */
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
/* Room for n <= cap bytes at the end of the file; takes part of it with grid_file_commit. */
int grid_file_reserve(struct grid_file *, size_t n, uint8_t **ret, struct err *err);
void grid_file_commit(struct grid_file *, size_t n);
uint64_t grid_file_place(const struct grid_file *);
int grid_file_append(struct grid_file *, const void *bytes, size_t n, struct err *err);
/* Overwrite bytes that were appended before. */
int grid_file_patch(struct grid_file *, uint64_t place, const void *bytes, size_t n, struct err *err);
/* The file gets its name; durably, if asked, or all but the name: that is when the folder is fsynced. On failure neither name
 * exists. */
enum grid_durable { GRID_PASSING, GRID_DURABLE, GRID_BUT_NAME };
int grid_file_publish(struct grid_file *, enum grid_durable, struct err *err);
void grid_file_abort(struct grid_file *); /* does nothing if not open */

#endif
