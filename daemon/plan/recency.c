/*
 * The most recently used stored domain of each base.
 *
 * The model: a set-associative cache. The bits of a base select its set. A new entry takes a free place of the set, or replaces a
 * random entry. Random replacement, not LRU: runs read a dataset from one end to the other again and again, and LRU would give no
 * hit at all for a dataset slightly larger than the table. No entry is removed: a caller that finds the file of an entry gone
 * reads the folder, and notes what it found there.
 */
#include "recency.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "ledger.h"
#include "lock.h"

enum { WAYS = 8 };

_Static_assert(WAYS == 1 << 3, "recency_note takes three bits");

struct recency {
	struct lock lock;
	struct ledger *ledger;
	uint64_t bytes, turn;
	size_t size, sets;
	uint8_t *entry; /* WAYS in each set; all zeros: free */
};

struct recency *recency_new(struct ledger *ledger, size_t size, unsigned part)
{
	struct recency *t = calloc(1, sizeof *t);

	if (!t)
		return NULL;
	t->size = size;
	t->sets = ledger_total(ledger) / part / (WAYS * size);
	t->sets += !t->sets;
	t->bytes = sizeof *t + t->sets * WAYS * size;
	if (!ledger_take(ledger, LEDGER_JOBS, t->bytes)) {
		free(t);
		return NULL;
	}
	t->ledger = ledger;
	lock_init(&t->lock, LOCK_RECENCY);
	t->entry = calloc(t->sets * WAYS, size);
	return t->entry ? t : recency_free(t);
}

struct recency *recency_free(struct recency *t)
{
	if (!t)
		return NULL;
	lock_done(&t->lock);
	ledger_give(t->ledger, LEDGER_JOBS, t->bytes);
	free(t->entry);
	free(t);
	return NULL;
}

/* The bits of a digest are uniformly distributed. */
static uint8_t *set_of(struct recency *t, struct digest base)
{
	return t->entry + base.lo % t->sets * WAYS * t->size;
}

/* NULL: the set has no entry of that base. */
static uint8_t *entry_of(const struct recency *t, uint8_t *set, struct digest base)
{
	for (uint8_t *at = set; at < set + WAYS * t->size; at += t->size) {
		struct store_id id;

		memcpy(&id, at, sizeof id);
		if (digest_equal(id.base, base))
			return at;
	}
	return NULL;
}

void recency_note(struct recency *t, const void *entry)
{
	struct store_id id;
	uint8_t *set, *at;

	if (!t)
		return;
	memcpy(&id, entry, sizeof id);
	lock_take(&t->lock);
	set = set_of(t, id.base);
	at = entry_of(t, set, id.base);
	if (!at)
		at = entry_of(t, set, (struct digest){0, 0});
	if (!at)
		at = set + (t->turn++ * UINT64_C(0x9e3779b97f4a7c15) >> 61) * t->size;
	memcpy(at, entry, t->size);
	lock_give(&t->lock);
}

bool recency_find(struct recency *t, struct digest base, void *ret_entry)
{
	const uint8_t *at;

	if (!t)
		return false;
	lock_take(&t->lock);
	at = entry_of(t, set_of(t, base), base);
	if (at)
		memcpy(ret_entry, at, t->size);
	lock_give(&t->lock);
	return at;
}
