/*
 * What was noted last of the store, by base.
 *
 * The model: sets of a few entries, a base in the set that its own bits name. A new one takes a free place, or that of any other:
 * datasets are passed over from one end to the other again and again, and where those used last stay, one that is a little too
 * large for the table finds nothing in it each time. Nothing is ever taken out: who removes a file need not tell, since whoever
 * takes a hint finds out, looks at the folder, and notes what he found there.
 */
#include "hints.h"

#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "ledger.h"

enum { WAYS = 8 };

_Static_assert(WAYS == 1 << 3, "hints_note takes three bits");

struct hints {
	pthread_mutex_t lock;
	struct ledger *ledger;
	uint64_t bytes, turn;
	size_t size, sets;
	uint8_t *entry; /* WAYS a set; zeros: none */
};

struct hints *hints_new(struct ledger *ledger, size_t size, unsigned part)
{
	struct hints *h = calloc(1, sizeof *h);

	if (!h)
		return NULL;
	h->size = size;
	h->sets = ledger_total(ledger) / part / (WAYS * size);
	h->sets += !h->sets;
	h->bytes = sizeof *h + h->sets * WAYS * size;
	if (!ledger_take(ledger, LEDGER_JOBS, h->bytes)) {
		free(h);
		return NULL;
	}
	h->ledger = ledger;
	pthread_mutex_init(&h->lock, NULL);
	h->entry = calloc(h->sets * WAYS, size);
	return h->entry ? h : hints_free(h);
}

struct hints *hints_free(struct hints *h)
{
	if (!h)
		return NULL;
	pthread_mutex_destroy(&h->lock);
	ledger_give(h->ledger, LEDGER_JOBS, h->bytes);
	free(h->entry);
	free(h);
	return NULL;
}

/* Digests are as good as random. */
static uint8_t *set_of(struct hints *h, struct digest base)
{
	return h->entry + base.lo % h->sets * WAYS * h->size;
}

/* NULL: it is not in the set. */
static uint8_t *entry_of(const struct hints *h, uint8_t *set, struct digest base)
{
	for (uint8_t *at = set; at < set + WAYS * h->size; at += h->size) {
		struct store_id id;

		memcpy(&id, at, sizeof id);
		if (digest_equal(id.base, base))
			return at;
	}
	return NULL;
}

void hints_note(struct hints *h, const void *entry)
{
	struct store_id id;
	uint8_t *set, *at;

	if (!h)
		return;
	memcpy(&id, entry, sizeof id);
	pthread_mutex_lock(&h->lock);
	set = set_of(h, id.base);
	at = entry_of(h, set, id.base);
	if (!at)
		at = entry_of(h, set, (struct digest){0, 0});
	if (!at)
		at = set + (h->turn++ * UINT64_C(0x9e3779b97f4a7c15) >> 61) * h->size;
	memcpy(at, entry, h->size);
	pthread_mutex_unlock(&h->lock);
}

bool hints_find(struct hints *h, struct digest base, void *ret_entry)
{
	const uint8_t *at;

	if (!h)
		return false;
	pthread_mutex_lock(&h->lock);
	at = entry_of(h, set_of(h, base), base);
	if (at)
		memcpy(ret_entry, at, h->size);
	pthread_mutex_unlock(&h->lock);
	return at;
}
