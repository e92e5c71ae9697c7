/*
 * The budget (ledger.h): one total, held by name. Taking never waits: who cannot have it now gives way
 * or comes back later. A name that gives back more than it holds is a fault in the program and ends it.
 */
#include "ledger.h"

#include <assert.h>
#include <pthread.h>
#include <stdlib.h>

struct ledger {
	pthread_mutex_t lock;
	uint64_t total, left;
	uint64_t held[LEDGER_NAMES];
};

struct ledger *ledger_new(uint64_t total)
{
	struct ledger *l = calloc(1, sizeof *l);

	if (!l)
		return NULL;
	pthread_mutex_init(&l->lock, NULL);
	l->total = l->left = total;
	return l;
}

struct ledger *ledger_free(struct ledger *l)
{
	if (!l)
		return NULL;
	assert(l->left == l->total);
	pthread_mutex_destroy(&l->lock);
	free(l);
	return NULL;
}

bool ledger_take(struct ledger *l, enum ledger_name name, uint64_t bytes)
{
	pthread_mutex_lock(&l->lock);
	bool fits = bytes <= l->left;

	if (fits) {
		l->left -= bytes;
		l->held[name] += bytes;
	}
	pthread_mutex_unlock(&l->lock);
	return fits;
}

void ledger_give(struct ledger *l, enum ledger_name name, uint64_t bytes)
{
	pthread_mutex_lock(&l->lock);
	if (bytes > l->held[name])
		abort(); /* not assert: a wrong budget must not go on in a release either */
	l->held[name] -= bytes;
	l->left += bytes;
	pthread_mutex_unlock(&l->lock);
}

uint64_t ledger_total(const struct ledger *l)
{
	return l->total;
}

uint64_t ledger_left(struct ledger *l)
{
	pthread_mutex_lock(&l->lock);
	uint64_t left = l->left;

	pthread_mutex_unlock(&l->lock);
	return left;
}

uint64_t ledger_held(struct ledger *l, enum ledger_name name)
{
	pthread_mutex_lock(&l->lock);
	uint64_t held = l->held[name];

	pthread_mutex_unlock(&l->lock);
	return held;
}

const char *ledger_name_text(enum ledger_name name)
{
	static const char *const text[LEDGER_NAMES] = {
		[LEDGER_STAGE] = "stage",     [LEDGER_INDEX] = "index",         [LEDGER_DOMAIN] = "domain",
		[LEDGER_EMITTER] = "emitter", [LEDGER_PIPE] = "pipe",           [LEDGER_INPUT] = "input",
		[LEDGER_MESSAGE] = "message", [LEDGER_CATALOGUE] = "catalogue",
	};

	return (unsigned)name < LEDGER_NAMES ? text[name] : "unknown";
}
