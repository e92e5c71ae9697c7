/*
 * Inputs: bytes of a descriptor to batches of raw points. Formats are rows of input_table.c.
 * Reads forwards in a bounded buffer, never the whole file.
 */
#ifndef INPUT_H
#define INPUT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "input_types.h"

struct err;
struct input;

/* Upper bound of the memory that opening an input takes, whatever its bytes are; what reading takes besides
 * is its read_bytes. */
size_t input_bytes(void);

/* Take a descriptor (borrowed: the caller closes it after input_close), read the header (text: the
 * whole file, for digits and extent). `name` is copied, for messages. Reading starts at offset 0. */
int input_open(int fd, const char *name, const struct input_options *, struct input **ret, struct err *err);
const struct input_info *input_info(const struct input *);
/* The WKT that its records carry, as crs_wkt_normal makes it; "": none, or of a part. */
const char *input_wkt(const struct input *);
/* A reader of parts [first, last) of `whole`, with buffers of its own and the same descriptor, which other
 * threads may read at the same time. `whole` must stay open and is not read itself. */
int input_open_part(const struct input *whole, uint64_t first, uint64_t last, struct input **ret, struct err *err);
/* The next points, up to pts->cap; pts->n == 0 at the end. -ERR_TRUNCATED, -ERR_INPUT name the place. */
int input_read(struct input *, struct input_points *pts, struct err *err);
/* From its first bytes: how many bytes must be there before a LAS file can be read forwards. 0: it is not
 * uncompressed LAS, and must be had whole. More than n: ask again when there are more (INPUT_FORWARD_LOOK is
 * always enough to know). */
enum { INPUT_FORWARD_LOOK = 227, INPUT_FORWARD_TEXT = 256 << 10 /* of a text, if it is longer */ };
uint64_t input_forward_head(const uint8_t *bytes, size_t n);
struct input *input_close(struct input *);

/* Bytes of the file that were read for points so far, by this reader. */
uint64_t input_bytes_read(const struct input *);

#endif
