/*
 * Memory of what the daemon keeps of datasets, jobs, pushes, runs and their views. Each is small, but users decide how many there
 * are: all of it is charged before it is kept, and refused, with a sentence, when the part of the memory for it is used up.
 *
 * What lasts does not get all of that part: datasets leave some to jobs, and these to runs and pushes, or no job could end and be
 * forgotten. Finished jobs are forgotten first of the user who has most of them, the oldest first.
 */
#include <stdlib.h>
#include <string.h>

#include "core.h"

enum { FORGOTTEN_MAX = 64 }; /* at a time: each is a change of the catalogue */

static int full(struct core *core, const char *what, struct err *err)
{
	err_set(err, ERR_BUSY, "no memory is left for %s: %llu KiB are held for datasets, jobs and pushes", what,
		(unsigned long long)ledger_held(core->p.ledger, LEDGER_JOBS) >> 10);
	return err_add_hint(err, "remove datasets and jobs that nobody needs (acutctl rm), or give acutd more memory");
}

int charge(struct core *core, uint64_t bytes, const char *what, struct err *err)
{
	THREAD_LOOP_ONLY();
	if (ledger_take(core->p.ledger, LEDGER_JOBS, bytes))
		return 0;
	core->lacks = bytes > core->lacks ? bytes : core->lacks;
	return full(core, what, err);
}

bool charge_make_room(struct core *core)
{
	uint64_t held = ledger_held(core->p.ledger, LEDGER_JOBS), most = ledger_limit(core->p.ledger, LEDGER_JOBS),
		 lacks = core->lacks;
	unsigned n = 0;

	THREAD_LOOP_ONLY();
	/* Some at a time, as those that are too old (history). */
	if (!lacks || catalogue_busy(core->p.catalogue))
		return false;
	core->lacks = 0;
	/* Not where domains have the memory, nor where it would not be enough. */
	if (held + lacks <= most || held - core->history.bytes(core->history.ctx) + lacks > most)
		return false;
	while (n < FORGOTTEN_MAX && ledger_held(core->p.ledger, LEDGER_JOBS) + lacks > most &&
	       core->history.forget(core->history.ctx, 0, 0))
		n++;
	if (n == FORGOTTEN_MAX)
		core->lacks = lacks;
	return n;
}

int charge_lasting(struct core *core, enum charge_lasting_kind kind, uint32_t uid, uint64_t bytes, const char *what,
		   struct err *err)
{
	uint64_t most = ledger_limit(core->p.ledger, LEDGER_JOBS);

	THREAD_LOOP_ONLY();
	most -= most / kind;
	while (ledger_held(core->p.ledger, LEDGER_JOBS) + bytes > most || !ledger_take(core->p.ledger, LEDGER_JOBS, bytes))
		if (!core->history.forget(core->history.ctx, uid, bytes))
			/* What is loaded at the start exists already. */
			return core->loading ? charge(core, bytes, what, err) : full(core, what, err);
	return 0;
}

void uncharge(struct core *core, uint64_t bytes)
{
	THREAD_LOOP_ONLY();
	if (bytes)
		ledger_give(core->p.ledger, LEDGER_JOBS, bytes);
}

uint64_t charge_view_bytes(const char *text, unsigned areas)
{
	/* Two copies of the text; of an area a corner for each four bytes at most: itself (with what a growing array
	 * has in hand), its edge, its place in lists of edges, and 40 KiB of cells and strips (view_area.c). */
	const uint64_t corner = 32 + 40 + 16, fixed = 40 << 10;
	uint64_t n = strlen(text) + 1;

	return 2 * n + (areas ? n / 4 * corner + areas * fixed : 0);
}
