/*
 * The cache of pages that all readers of a line set share: sets of four frames, of which the least recently used one is given
 * up. A reader gets a copy, so none waits for another, and a cache of any size works, even of none.
 */
#include <stdlib.h>
#include <string.h>

#include "lineset_file.h"

struct frame {
	uint64_t page, used; /* page: its number plus one; 0: none */
};
_Static_assert(sizeof(struct frame) == LINESET_FRAME, "it is counted");

struct lineset_cache {
	struct lock lock;
	size_t sets;
	uint64_t clock;
	struct frame *frame;
	uint8_t *bytes;
};

size_t lineset_cache_bytes(size_t frames)
{
	return sizeof(struct lineset_cache) + frames * (size_t)(LINESET_PAGE + LINESET_FRAME);
}

struct lineset_cache *lineset_cache_new(size_t frames)
{
	struct lineset_cache *c = calloc(1, sizeof *c);

	if (!c)
		return NULL;
	lock_init(&c->lock, LOCK_LINESET_CACHE);
	c->sets = frames / LINESET_WAYS;
	if (!c->sets)
		return c;
	c->frame = calloc(c->sets * LINESET_WAYS, sizeof *c->frame);
	c->bytes = malloc(c->sets * LINESET_WAYS * (size_t)LINESET_PAGE);
	return c->frame && c->bytes ? c : lineset_cache_free(c);
}

struct lineset_cache *lineset_cache_free(struct lineset_cache *c)
{
	if (!c)
		return NULL;
	lock_done(&c->lock);
	free(c->frame);
	free(c->bytes);
	free(c);
	return NULL;
}

/* The frame that has the page, or the one of its set that was used the longest time ago. */
static size_t find(const struct lineset_cache *c, uint64_t page)
{
	size_t first = (size_t)((page * UINT64_C(0x9e3779b97f4a7c15) >> 32) % c->sets) * LINESET_WAYS, at = first;

	for (size_t i = first; i < first + LINESET_WAYS; i++) {
		if (c->frame[i].page == page + 1)
			return i;
		at = c->frame[i].used < c->frame[at].used ? i : at;
	}
	return at;
}

bool lineset_cache_get(struct lineset_cache *c, uint64_t page, void *to)
{
	size_t at;
	bool found;

	if (!c->sets)
		return false;
	lock_take(&c->lock);
	at = find(c, page);
	found = c->frame[at].page == page + 1;
	if (found) {
		memcpy(to, c->bytes + at * LINESET_PAGE, LINESET_PAGE);
		c->frame[at].used = ++c->clock;
	}
	lock_give(&c->lock);
	return found;
}

void lineset_cache_put(struct lineset_cache *c, uint64_t page, const void *from)
{
	size_t at;

	if (!c->sets)
		return;
	lock_take(&c->lock);
	at = find(c, page);
	memcpy(c->bytes + at * LINESET_PAGE, from, LINESET_PAGE);
	c->frame[at] = (struct frame){page + 1, ++c->clock};
	lock_give(&c->lock);
}
