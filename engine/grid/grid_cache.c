/*
 * A cache of index pages, shared by all readers of a grid: a hash table over frames and an LRU list, under one mutex. A
 * reader gets a copy of a page (16 KiB for 185 cells) and not a reference, so no reader waits for another one to
 * release a page, and a cache of any size works, even of none.
 */
#include <stdlib.h>
#include <string.h>

#include "grid_priv.h"
#include "lock.h"

enum { NONE = UINT32_MAX };

struct frame {
	uint64_t place;
	uint32_t segment;
	uint32_t newer, older; /* in the LRU list */
	uint32_t chain;        /* next in the hash chain */
};

struct grid_cache {
	struct lock lock;
	size_t nframes, used;
	uint32_t newest, oldest;
	struct frame *frames;
	uint32_t *heads; /* nframes of them */
	uint8_t *pages;
};

size_t grid_cache_bytes(size_t frames)
{
	return sizeof(struct grid_cache) + frames * (DISK_PAGE + sizeof(struct frame) + sizeof(uint32_t));
}

struct grid_cache *grid_cache_new(size_t frames)
{
	struct grid_cache *c = calloc(1, sizeof *c);

	if (!c)
		return NULL;
	lock_init(&c->lock, LOCK_GRID_CACHE);
	c->nframes = frames < NONE ? frames : NONE - 1;
	c->newest = c->oldest = NONE;
	if (!frames)
		return c;
	c->frames = malloc(frames * sizeof *c->frames);
	c->heads = malloc(frames * sizeof *c->heads);
	c->pages = malloc(frames * (size_t)DISK_PAGE);
	if (!c->frames || !c->heads || !c->pages)
		return grid_cache_free(c);
	for (size_t i = 0; i < frames; i++)
		c->heads[i] = NONE;
	return c;
}

struct grid_cache *grid_cache_free(struct grid_cache *c)
{
	if (!c)
		return NULL;
	lock_done(&c->lock);
	free(c->frames);
	free(c->heads);
	free(c->pages);
	free(c);
	return NULL;
}

static uint32_t *head_of(struct grid_cache *c, uint32_t segment, uint64_t place)
{
	uint64_t h = (place / DISK_ALIGN ^ (uint64_t)segment << 40) * 0x9e3779b97f4a7c15u;

	return &c->heads[(h >> 32) % c->nframes];
}

static uint32_t find(struct grid_cache *c, uint32_t segment, uint64_t place)
{
	uint32_t i = *head_of(c, segment, place);

	while (i != NONE && (c->frames[i].place != place || c->frames[i].segment != segment))
		i = c->frames[i].chain;
	return i;
}

static void lru_remove(struct grid_cache *c, uint32_t i)
{
	struct frame *f = &c->frames[i];

	*(f->newer == NONE ? &c->newest : &c->frames[f->newer].older) = f->older;
	*(f->older == NONE ? &c->oldest : &c->frames[f->older].newer) = f->newer;
}

static void lru_push(struct grid_cache *c, uint32_t i)
{
	c->frames[i].newer = NONE;
	c->frames[i].older = c->newest;
	*(c->newest == NONE ? &c->oldest : &c->frames[c->newest].newer) = i;
	c->newest = i;
}

bool grid_cache_get(struct grid_cache *c, uint32_t segment, uint64_t place, void *page)
{
	uint32_t i;

	if (!c->nframes)
		return false;
	lock_take(&c->lock);
	i = find(c, segment, place);
	if (i != NONE) {
		memcpy(page, c->pages + i * (size_t)DISK_PAGE, DISK_PAGE);
		lru_remove(c, i);
		lru_push(c, i);
	}
	lock_give(&c->lock);
	return i != NONE;
}

/* A frame for a new page: an unused one, or that of the least recently used page. */
static uint32_t claim_frame(struct grid_cache *c)
{
	if (c->used < c->nframes)
		return (uint32_t)c->used++;
	uint32_t i = c->oldest, *at = head_of(c, c->frames[i].segment, c->frames[i].place);

	while (*at != i)
		at = &c->frames[*at].chain;
	*at = c->frames[i].chain;
	lru_remove(c, i);
	return i;
}

void grid_cache_put(struct grid_cache *c, uint32_t segment, uint64_t place, const void *page)
{
	if (!c->nframes)
		return;
	lock_take(&c->lock);
	if (find(c, segment, place) == NONE) { /* another reader may have put it meanwhile */
		uint32_t i = claim_frame(c), *head = head_of(c, segment, place);

		c->frames[i] = (struct frame){.place = place, .segment = segment, .chain = *head};
		*head = i;
		lru_push(c, i);
		memcpy(c->pages + i * (size_t)DISK_PAGE, page, DISK_PAGE);
	}
	lock_give(&c->lock);
}
