/* Arrays that grow item by item. */
#ifndef GROW_H
#define GROW_H

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* Room for `n` items of `size` bytes in the array whose address is at `array`; it doubles, from `least` items. False: there is no
 * memory, and nothing has changed. */
static inline bool grow(void *array, size_t *room, size_t n, size_t least, size_t size)
{
	size_t wanted = *room ? 2 * *room : least;
	void *items;

	if (n <= *room)
		return true;
	wanted = n > wanted ? n : wanted;
	memcpy(&items, array, sizeof items);
	items = realloc(items, wanted * size);
	if (!items)
		return false;
	memcpy(array, &items, sizeof items);
	*room = wanted;
	return true;
}

#endif
