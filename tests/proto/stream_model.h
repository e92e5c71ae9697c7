/* A model of a mesh stream for tests: random blocks, written as bytes and compared with what a reader returns. */
#ifndef STREAM_MODEL_H
#define STREAM_MODEL_H

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "err.h"
#include "stream.h"

enum { BLOCKS = 6, MAX_NEW = 40, MAX_TRI = 70 };

struct stream_bytes {
	uint8_t *at;
	size_t size, room;
};

struct model_data {
	uint64_t foreign[MAX_NEW];
	int32_t vertex[MAX_NEW][3];
	uint32_t triangle[MAX_TRI][3];
	struct stream_origin origin[MAX_NEW];
	uint8_t flags[MAX_TRI], final[2 * MAX_NEW / 8];
};

/* A stream of random blocks that obeys the rules; a test may break them before it is written. */
struct model {
	struct stream_head head;
	struct model_data data[BLOCKS];
	struct stream_block block[BLOCKS];
	unsigned nblock;
	struct stream_tail tail;
	struct stream_base base; /* of changes */
	struct stream_region gone[3];
	uint32_t ngone;
	bool no_base;
};

uint32_t model_roll(uint32_t n);
void model_append(struct stream_bytes *to, const struct stream_piece *piece, unsigned n);
void model_totals(struct model *m);
void model_init(struct model *m, unsigned nblock);
/* Regions that are no longer valid, in lists of one and two. */
void model_append_changes(const struct model *m, struct stream_bytes *all);
void model_changes(struct model *m, uint32_t ngone);
struct stream_bytes model_bytes(const struct model *m);
/* Feeds all bytes in pieces of at most `cut`. 0 and *ret_done, or the error. With a model: compares. */
int model_run(const struct stream_bytes *in, size_t cut, const struct model *want, bool *ret_done, struct err *err);
int model_run_whole(const struct model *m, struct err *err);

#endif
