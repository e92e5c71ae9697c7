/*
 * Slots: small numbers for sources of a dataset, so that a view can tell records of some sources from others. A view says which
 * sources have which slot; the reader of a generation puts the slot into the tag of each record (grid.h).
 */
#ifndef SLOTS_H
#define SLOTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { SLOTS_MOST = 31 };

struct slots_range {
	uint32_t first, last; /* numbers of sources, both ends included */
	uint8_t slot;         /* from 1 */
};
struct slots {
	const struct slots_range *range; /* ascending, disjoint */
	size_t n;
};

uint8_t slots_of(const struct slots *, uint32_t source); /* 0: the source has none */

/* Ranges with a value, in any order, that become slots: one for each value, ascending. */
struct slots_list {
	struct slots_list_row {
		uint32_t first, last;
		int32_t value;
	} * row;
	size_t n, room;
};

/* False: no memory. */
bool slots_list_add(struct slots_list *, uint32_t first, uint32_t last, int32_t value);
void slots_list_free(struct slots_list *);
/* To be freed with slots_free. */
enum { SLOTS_OK, SLOTS_TWICE, SLOTS_MANY, SLOTS_NO_MEMORY };
/* SLOTS_TWICE: source *ret_twice has two values. SLOTS_MANY: there are too many values. */
int slots_list_slots(struct slots_list *, struct slots **ret, int32_t ret_value[SLOTS_MOST], unsigned *ret_values,
		     uint32_t *ret_twice);
void slots_free(struct slots *);

#endif
