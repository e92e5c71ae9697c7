/*
 * Shared by the readers of all formats: an open input with its buffer, and the functions of a format. Code that only reads points
 * includes input.h instead.
 */
#ifndef INPUT_READER_H
#define INPUT_READER_H

#include <stdalign.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <time.h>

#include "err.h"
#include "input_types.h"

struct input;

/* One format. `matches` looks at the first bytes (up to INPUT_SNIFF); `open` reads header or text and
 * fills in info; `read` goes on where it was. None keeps anything outside of struct input, its state (of `state_bytes`)
 * included, but for what `close` (or NULL) frees. `part` (or NULL: only one) turns a copy of the whole input into a reader of
 * parts. */
enum { INPUT_BUFFER = 256 * 1024, INPUT_SNIFF = 4096 };

struct input_reader {
	size_t state_bytes;
	bool forwards;   /* it can be read from a pipe as it comes */
	bool plain_text; /* any text is one, so other formats come first */
	bool (*matches)(const uint8_t *bytes, size_t n);
	int (*open)(struct input *in, struct err *err);
	int (*read)(struct input *in, struct input_points *pts, struct err *err);
	void (*part)(struct input *in, uint64_t first, uint64_t last);
	void (*close)(struct input *in);
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
	const struct input_reader *reader;
	struct input_info info;
	uint64_t bytes_read; /* since it was opened */
	bool checked;        /* the end was reached, and the file is still the one that was opened */
	char *wkt;           /* of its system, as crs_wkt_normal makes it; NULL: none */
	alignas(16) uint8_t buffer[INPUT_BUFFER];
};

/* Behind it lies the state of its reader, zeros at first. */
static inline void *input_state(const struct input *in)
{
	return (void *)(in + 1);
}

/* -code, with place and file filled in. */
#define input_fail(in, err, code, offset, field, ...) \
	(err_set((err), code, __VA_ARGS__), err_add_place((err), (offset), (field)), err_add_file((err), (in)->name))

/* Degrees that nobody projects, and geocentric coordinates, are no plane. -ERR_UNSUPPORTED. */
int input_check_plane(struct input *in, struct err *err);
/* A lie that does no harm: said once, in info.warning. */
void input_warn(struct input *in, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
/* Looks at the size and the time of the file. */
int input_take_stat(struct input *in, struct err *err);
/* -ERR_CHANGED if size or time of the file are not those of input_take_stat. */
int input_check_unchanged(struct input *in, struct err *err);

/* Up to n bytes of a pipe's input at place `at`, which only goes forwards. *ret_n 0: its end, or in->dry. */
int input_pipe_read(struct input *in, uint64_t at, void *buf, size_t n, size_t *ret_n, struct err *err);

/* The readers, input_las_reader and so on. */
#define INPUT_FORMAT(name, ...) extern const struct input_reader input_##name##_reader;
#include "input_format.def"
#undef INPUT_FORMAT

#endif
