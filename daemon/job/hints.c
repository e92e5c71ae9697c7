/*
 * Which file of the store did last.
 *
 * The model: sets of a few entries, a base in the set that its own bits name, the one used last first; a new one
 * takes the place of the last. Nothing is ever taken out: who removes a file need not tell, since whoever takes a hint
 * finds out, looks at the folder, and notes what he found there.
 */
#include "hints.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "ledger.h"

enum { WAYS = 4, PART = 1024 /* of the memory */ };

struct set {
	struct store_id id[WAYS]; /* zeros: none */
};

struct hints {
	pthread_mutex_t lock;
	struct ledger *ledger;
	uint64_t bytes;
	size_t sets; /* a power of two */
	struct set *set;
};

struct hints *hints_new(struct ledger *ledger)
{
	struct hints *h = calloc(1, sizeof *h);
	uint64_t most = ledger_total(ledger) / PART;

	if (!h)
		return NULL;
	for (h->sets = 1; 2 * h->sets * sizeof *h->set <= most; h->sets *= 2)
		;
	h->bytes = sizeof *h + h->sets * sizeof *h->set;
	if (!ledger_take(ledger, LEDGER_JOBS, h->bytes)) {
		free(h);
		return NULL;
	}
	h->ledger = ledger;
	pthread_mutex_init(&h->lock, NULL);
	h->set = calloc(h->sets, sizeof *h->set);
	return h->set ? h : hints_free(h);
}

struct hints *hints_free(struct hints *h)
{
	if (!h)
		return NULL;
	pthread_mutex_destroy(&h->lock);
	ledger_give(h->ledger, LEDGER_JOBS, h->bytes);
	free(h->set);
	free(h);
	return NULL;
}

/* Where it is, or would be if it took the place of the last. */
static unsigned way_of(const struct set *s, struct digest base)
{
	unsigned i = 0;

	while (i < WAYS - 1 && !digest_equal(s->id[i].base, base))
		i++;
	return i;
}

void hints_note(struct hints *h, const struct store_id *id)
{
	struct set *s;

	if (!h)
		return;
	pthread_mutex_lock(&h->lock);
	s = &h->set[id->base.lo & (h->sets - 1)];
	memmove(s->id + 1, s->id, way_of(s, id->base) * sizeof *s->id);
	s->id[0] = *id;
	pthread_mutex_unlock(&h->lock);
}

bool hints_find(struct hints *h, struct digest base, struct digest *ret_list)
{
	const struct store_id *id;
	const struct set *s;
	bool is;

	if (!h)
		return false;
	pthread_mutex_lock(&h->lock);
	s = &h->set[base.lo & (h->sets - 1)];
	id = &s->id[way_of(s, base)];
	is = digest_equal(id->base, base);
	if (is)
		*ret_list = id->list;
	pthread_mutex_unlock(&h->lock);
	return is;
}
