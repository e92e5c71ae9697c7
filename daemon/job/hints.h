/*
 * What was noted last of a base of the store of finished domains: a table in memory of entries of one size, each of which begins
 * with the store_id that it is about. It saves a look at the store; what it says is a hint: the file may be gone, or be none for
 * this generation any more. Any thread.
 */
#ifndef HINTS_H
#define HINTS_H

#include <stdbool.h>
#include <stddef.h>

#include "store.h"

struct hints;
struct ledger;

/* Of entries of `size` bytes. Its memory is one `part`th of the total of the ledger, and taken from it (borrowed; LEDGER_JOBS).
 * NULL: there is none for it, and all the others take that: nothing is known. */
struct hints *hints_new(struct ledger *, size_t size, unsigned part);
struct hints *hints_free(struct hints *);
/* Takes the place of what was noted of that base. */
void hints_note(struct hints *, const void *entry);
bool hints_find(struct hints *, struct digest base, void *ret_entry);

#endif
