/*
 * The memory budget: one number of bytes for the whole daemon, charged by name before the memory is used. Thread-safe.
 * Nothing allocates after ledger_new. The ledger keeps only sums for each name; the callers know their shares (service.h:
 * service_holders).
 */
#ifndef LEDGER_H
#define LEDGER_H

#include <stdbool.h>
#include <stdint.h>

enum ledger_name {
	LEDGER_STAGE,     /* staging buffers, merging of runs, selections in progress */
	LEDGER_INDEX,     /* resident index pages of the grid cache */
	LEDGER_DOMAIN,    /* arenas of domains, results that were not sent yet */
	LEDGER_EMITTER,   /* tables of open vertices */
	LEDGER_PIPE,      /* stream buffers */
	LEDGER_INPUT,     /* read buffers of input files */
	LEDGER_MESSAGE,   /* control messages, connections, requests */
	LEDGER_CATALOGUE, /* SQLite, queued changes */
	LEDGER_PLAN,      /* regions of plans */
	LEDGER_MANIFEST,  /* sources and segments of datasets that are being read or pushed to */
	LEDGER_FILES,     /* records of the files of pushes */
	LEDGER_JOBS,      /* datasets, jobs, pushes, areas of views */
	LEDGER_THREAD,    /* stacks */
	LEDGER_NAMES
};

struct ledger;

struct ledger *ledger_new(uint64_t total);   /* NULL: no memory */
struct ledger *ledger_free(struct ledger *); /* asserts that everything was returned */

/* Reserves `aside` bytes for a name, so that small memory that cannot wait (a message) is never displaced by large
 * memory (a domain); and limits the name to `most` (0: no limit). Once for each name, before anything is charged to it;
 * false: that much cannot be reserved. */
bool ledger_reserve(struct ledger *, enum ledger_name, uint64_t aside, uint64_t most);

/* False, and nothing changes, if `bytes` are not free now. */
bool ledger_take(struct ledger *, enum ledger_name, uint64_t bytes);
void ledger_give(struct ledger *, enum ledger_name, uint64_t bytes);

uint64_t ledger_total(const struct ledger *);
uint64_t ledger_left(struct ledger *);                          /* free for a name without a reserve */
uint64_t ledger_available(struct ledger *, enum ledger_name);   /* free for that name */
uint64_t ledger_limit(const struct ledger *, enum ledger_name); /* the most that it can ever hold */
uint64_t ledger_held(struct ledger *, enum ledger_name);
uint64_t ledger_peak(struct ledger *, enum ledger_name); /* the most that was ever held */
uint64_t ledger_peak_all(struct ledger *);               /* by all names together */
/* For each name of `mask` (1 << name), what it holds or what is reserved, whichever is more; in all. */
uint64_t ledger_claimed(struct ledger *, unsigned mask);
const char *ledger_name_text(enum ledger_name);

#endif
