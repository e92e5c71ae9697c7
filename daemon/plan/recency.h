/*
 * The most recently used stored domain of each base (store.h): a table in memory. Its entries have one size, and each begins with
 * the store_id of the domain. An entry saves reading the store's folder, and must be verified: the file may have been removed, or
 * may not fit the generation any more. Any thread may call these functions.
 */
#ifndef RECENCY_H
#define RECENCY_H

#include <stdbool.h>
#include <stddef.h>

#include "store.h"

struct recency;
struct ledger;

/* `size`: bytes of an entry. The table has 1/`part` of the ledger's total, charged to the ledger (borrowed; LEDGER_JOBS). NULL:
 * no memory. The other functions accept NULL, a table that stays empty. */
struct recency *recency_new(struct ledger *, size_t size, unsigned part);
struct recency *recency_free(struct recency *);
/* Replaces the entry of that base. */
void recency_note(struct recency *, const void *entry);
/* False: the base has no entry. */
bool recency_find(struct recency *, struct digest base, void *ret_entry);

#endif
