/*
 * The budget: one number of bytes for the whole daemon, taken by name before it is used.
 * Thread-safe. Nothing here allocates after ledger_new.
 */
#ifndef LEDGER_H
#define LEDGER_H

#include <stdbool.h>
#include <stdint.h>

enum ledger_name {
	LEDGER_STAGE,     /* staging buffers, run merging */
	LEDGER_INDEX,     /* resident index pages of the grid cache */
	LEDGER_DOMAIN,    /* arenas of domains, results not yet sent */
	LEDGER_EMITTER,   /* tables of unfinished vertices */
	LEDGER_PIPE,      /* stream buffers */
	LEDGER_INPUT,     /* read buffers of input files */
	LEDGER_MESSAGE,   /* control messages, connections */
	LEDGER_CATALOGUE, /* SQLite */
	LEDGER_NAMES
};

struct ledger;

struct ledger *ledger_new(uint64_t total); /* NULL: no memory */
struct ledger *ledger_free(struct ledger *); /* asserts that everything was given back */

/* False, and nothing changed, if `bytes` do not fit now. */
bool ledger_take(struct ledger *, enum ledger_name, uint64_t bytes);
void ledger_give(struct ledger *, enum ledger_name, uint64_t bytes);

uint64_t ledger_total(const struct ledger *);
uint64_t ledger_left(struct ledger *);
uint64_t ledger_held(struct ledger *, enum ledger_name);
const char *ledger_name_text(enum ledger_name);

#endif
