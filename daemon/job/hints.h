/*
 * Which file of the store of finished domains did last, by base: a small table in memory that saves a look at the folder. What it
 * says is a hint: the file may be gone, or be none for this generation any more. Any thread.
 */
#ifndef HINTS_H
#define HINTS_H

#include <stdbool.h>

#include "store.h"

struct hints;
struct ledger;

/* Its memory is taken from the ledger (borrowed; LEDGER_JOBS), a part of its total. NULL: there is none for it, and all the
 * others take that: nothing is known. */
struct hints *hints_new(struct ledger *);
struct hints *hints_free(struct hints *);
void hints_note(struct hints *, const struct store_id *);
bool hints_find(struct hints *, struct digest base, struct digest *ret_list);

#endif
