/*
 * The budget: one number of bytes for the whole daemon, taken by name before it is used.
 * Thread-safe. Nothing here allocates after ledger_new. Who of several holds what is known by those who took it (job.h:
 * job_holders): the ledger keeps sums.
 */
#ifndef LEDGER_H
#define LEDGER_H

#include <stdbool.h>
#include <stdint.h>

enum ledger_name {
	LEDGER_STAGE,     /* staging buffers, run merging, selections being made */
	LEDGER_INDEX,     /* resident index pages of the grid cache */
	LEDGER_DOMAIN,    /* arenas of domains, results not yet sent */
	LEDGER_EMITTER,   /* tables of unfinished vertices */
	LEDGER_PIPE,      /* stream buffers */
	LEDGER_INPUT,     /* read buffers of input files */
	LEDGER_MESSAGE,   /* control messages, connections, requests */
	LEDGER_CATALOGUE, /* SQLite, changes that wait for it */
	LEDGER_PLAN,      /* regions of plans */
	LEDGER_MANIFEST,  /* sources and segments of datasets that are read or pushed to */
	LEDGER_FILES,     /* what pushes keep of each of their files */
	LEDGER_JOBS,      /* datasets, jobs, pushes, areas of views */
	LEDGER_THREAD,    /* stacks */
	LEDGER_NAMES
};

struct ledger;

struct ledger *ledger_new(uint64_t total);   /* NULL: no memory */
struct ledger *ledger_free(struct ledger *); /* asserts that everything was given back */

/* What a name has of the whole: `aside` is kept for it, so that what is small and cannot wait (a message) is never
 * pushed out by what is large (a domain); more than `most` it never gets (0: no such bound). Once a name, before
 * anything is taken by it; false: so much cannot be kept. */
bool ledger_share(struct ledger *, enum ledger_name, uint64_t aside, uint64_t most);

/* False, and nothing changed, if `bytes` do not fit now. */
bool ledger_take(struct ledger *, enum ledger_name, uint64_t bytes);
void ledger_give(struct ledger *, enum ledger_name, uint64_t bytes);

uint64_t ledger_total(const struct ledger *);
uint64_t ledger_left(struct ledger *);                         /* for a name that nothing is set aside for */
uint64_t ledger_room(struct ledger *, enum ledger_name);       /* what that name could take now */
uint64_t ledger_most(const struct ledger *, enum ledger_name); /* that it ever gets */
uint64_t ledger_held(struct ledger *, enum ledger_name);
uint64_t ledger_peak(struct ledger *, enum ledger_name); /* the most that was held at a time */
uint64_t ledger_peak_all(struct ledger *);               /* by all names together */
/* What the names of `mask` (1 << name) hold or have set aside, whichever is more of each. */
uint64_t ledger_claimed(struct ledger *, unsigned mask);
const char *ledger_name_text(enum ledger_name);

#endif
