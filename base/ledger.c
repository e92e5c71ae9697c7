/*
 * The memory budget (ledger.h): one total, charged by name, with reserved parts for some names. Charging never waits; a
 * caller that cannot have it now yields or tries again later. A name that returns more than it holds is a bug, and ends
 * the program.
 */
#include "ledger.h"

#include <assert.h>
#include <stdlib.h>

#include "lock.h"

struct ledger {
	struct lock lock;
	uint64_t total, left; /* left: neither held nor reserved */
	uint64_t sum, peak_sum;
	uint64_t held[LEDGER_NAMES], peak[LEDGER_NAMES], aside[LEDGER_NAMES], most[LEDGER_NAMES];
};

struct ledger *ledger_new(uint64_t total)
{
	struct ledger *l = calloc(1, sizeof *l);

	if (!l)
		return NULL;
	lock_init(&l->lock, LOCK_LEDGER);
	l->total = l->left = total;
	return l;
}

struct ledger *ledger_free(struct ledger *l)
{
	if (!l)
		return NULL;
	assert(l->sum == 0);
	lock_done(&l->lock);
	free(l);
	return NULL;
}

/* What a name that holds `held` takes from the total: at least its reserve. */
static uint64_t claim(const struct ledger *l, enum ledger_name name, uint64_t held)
{
	return held > l->aside[name] ? held : l->aside[name];
}

bool ledger_reserve(struct ledger *l, enum ledger_name name, uint64_t aside, uint64_t most)
{
	lock_take(&l->lock);
	bool fits = aside <= l->left && !l->held[name] && !l->aside[name];

	if (fits) {
		l->aside[name] = aside;
		l->most[name] = most;
		l->left -= aside;
	}
	lock_give(&l->lock);
	return fits;
}

bool ledger_take(struct ledger *l, enum ledger_name name, uint64_t bytes)
{
	lock_take(&l->lock);
	/* The sum of all that is held cannot overflow, but `bytes` can be any number. */
	bool fits = bytes <= l->total && (!l->most[name] || l->held[name] + bytes <= l->most[name]);

	if (fits) {
		uint64_t held = l->held[name] + bytes, more = claim(l, name, held) - claim(l, name, l->held[name]);

		fits = more <= l->left;
		if (fits) {
			l->left -= more;
			l->held[name] = held;
			l->sum += bytes;
			l->peak[name] = held > l->peak[name] ? held : l->peak[name];
			l->peak_sum = l->sum > l->peak_sum ? l->sum : l->peak_sum;
		}
	}
	lock_give(&l->lock);
	return fits;
}

void ledger_give(struct ledger *l, enum ledger_name name, uint64_t bytes)
{
	lock_take(&l->lock);
	if (bytes > l->held[name])
		abort(); /* not assert: a release must not continue with a wrong budget, either */
	l->left += claim(l, name, l->held[name]) - claim(l, name, l->held[name] - bytes);
	l->held[name] -= bytes;
	l->sum -= bytes;
	lock_give(&l->lock);
}

uint64_t ledger_total(const struct ledger *l)
{
	return l->total;
}

static uint64_t read_number(struct ledger *l, const uint64_t *number)
{
	lock_take(&l->lock);
	uint64_t n = *number;

	lock_give(&l->lock);
	return n;
}

uint64_t ledger_left(struct ledger *l)
{
	return read_number(l, &l->left);
}

uint64_t ledger_available(struct ledger *l, enum ledger_name name)
{
	lock_take(&l->lock);
	uint64_t held = l->held[name], room = l->left + claim(l, name, held) - held;

	if (l->most[name] && room > l->most[name] - held)
		room = l->most[name] - held;
	lock_give(&l->lock);
	return room;
}

uint64_t ledger_limit(const struct ledger *l, enum ledger_name name)
{
	return l->most[name] && l->most[name] < l->total ? l->most[name] : l->total;
}

uint64_t ledger_held(struct ledger *l, enum ledger_name name)
{
	return read_number(l, &l->held[name]);
}

uint64_t ledger_peak(struct ledger *l, enum ledger_name name)
{
	return read_number(l, &l->peak[name]);
}

uint64_t ledger_peak_all(struct ledger *l)
{
	return read_number(l, &l->peak_sum);
}

uint64_t ledger_claimed(struct ledger *l, unsigned mask)
{
	uint64_t sum = 0;

	lock_take(&l->lock);
	for (unsigned i = 0; i < LEDGER_NAMES; i++)
		sum += mask >> i & 1 ? claim(l, (enum ledger_name)i, l->held[i]) : 0;
	lock_give(&l->lock);
	return sum;
}

const char *ledger_name_text(enum ledger_name name)
{
	static const char *const text[LEDGER_NAMES] = {
		[LEDGER_STAGE] = "stage",       [LEDGER_INDEX] = "index",         [LEDGER_DOMAIN] = "domain",
		[LEDGER_EMITTER] = "emitter",   [LEDGER_PIPE] = "pipe",           [LEDGER_INPUT] = "input",
		[LEDGER_MESSAGE] = "message",   [LEDGER_CATALOGUE] = "catalogue", [LEDGER_PLAN] = "plan",
		[LEDGER_MANIFEST] = "manifest", [LEDGER_FILES] = "files",         [LEDGER_JOBS] = "jobs",
		[LEDGER_THREAD] = "thread",
	};

	return (unsigned)name < LEDGER_NAMES ? text[name] : "unknown";
}
