/*
 * The emitter's table of open vertices: position to number and link sum. It is in a fixed number of page frames; the
 * rest is in an unlinked file. Internal.
 */
#ifndef PIPE_TABLE_H
#define PIPE_TABLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;
struct pipe_table;

struct pipe_vertex {
	uint64_t place;  /* position: x, y as two unsigned 32-bit halves */
	uint64_t number; /* number in the stream plus one; 0: a free slot */
	uint64_t hi, lo; /* link sum */
	uint32_t edges;
	uint32_t reserved;
};

enum { PIPE_TABLE_PAGE = 4096, PIPE_TABLE_FRAMES_MIN = 16 };

/* `memory`: bytes for page frames, at least PIPE_TABLE_FRAMES_MIN pages. */
int pipe_table_new(size_t memory, int tempdirfd, struct pipe_table **ret, struct err *err);
struct pipe_table *pipe_table_free(struct pipe_table *);

/* Adds `edges` triangles and the sum `hi`, `lo` to the vertex at `place`; a new vertex gets `number`. *ret is the entry
 * after that. An entry whose sum has become zero is removed. */
enum { PIPE_TABLE_NEW = 1, PIPE_TABLE_KNOWN = 2, PIPE_TABLE_CLOSED = 3 };
int pipe_table_add(struct pipe_table *, const struct pipe_vertex *add, struct pipe_vertex *ret, struct err *err);
/* Many entries at once, in a table that is not all in memory: in the order of their parts, each page is read and written once.
 * pipe_table_reserve makes room for n new entries, so that no part changes meanwhile. */
bool pipe_table_spills(const struct pipe_table *, uint64_t n); /* with n more entries it will not be all in memory */
int pipe_table_reserve(struct pipe_table *, uint64_t n, struct err *err);
uint64_t pipe_table_pages(const struct pipe_table *);
unsigned pipe_table_parts(const struct pipe_table *);
unsigned pipe_table_part(const struct pipe_table *, uint64_t place);
/* Changes the number of an entry that is there. */
int pipe_table_number(struct pipe_table *, uint64_t place, uint64_t number, struct err *err);
uint64_t pipe_table_count(const struct pipe_table *);
uint64_t pipe_table_spilled_pages(const struct pipe_table *); /* 0: all in memory */

#endif
