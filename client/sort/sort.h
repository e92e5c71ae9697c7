/* External sort of small records of 64-bit words. */
#ifndef SORT_H
#define SORT_H

#include <stdint.h>

struct err;
struct outfile;

struct sort;
/* Records of `words` words, at most 6; the first `keys` of them are the order. In `memory` bytes, or 1,024
 * records if these need more; what does not fit is in a nameless file beside the output, of any size. */
int sort_new(unsigned words, unsigned keys, uint64_t memory, const struct outfile *beside, struct sort **ret, struct err *err);
/* To be asked every so often while runs are written and merged: not 0: -ERR_CANCELLED. `interrupted` may be NULL. */
void sort_interrupt(struct sort *, int (*interrupted)(void *ctx), void *ctx);
int sort_add(struct sort *, const uint64_t *record, struct err *err);
int sort_start(struct sort *, struct err *err);
/* *ret: the next record, valid until the next call; NULL at the end. */
int sort_next(struct sort *, const uint64_t **ret, struct err *err);
struct sort *sort_free(struct sort *);

#endif
