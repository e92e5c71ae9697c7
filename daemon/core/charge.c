/*
 * Memory that the daemon keeps for datasets, jobs, pushes, runs and their views. Each is small, but users decide how many there
 * are. So each is charged to one account before it is kept, and refused with a message if the account is full.
 *
 * Lasting entries do not get the whole account: datasets leave a part to jobs, and both leave a part to runs and pushes.
 * Otherwise no job could end and be dropped. Finished jobs are dropped if memory is needed, the oldest of the user who has the
 * most first.
 */
#include <stdlib.h>
#include <string.h>

#include "core_priv.h"

enum { FORGOTTEN_MAX = 64 }; /* in one call: each is a change of the catalogue */

static int refuse_charge(struct core *core, const char *what, struct err *err)
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
	core->priv->refused_bytes = bytes > core->priv->refused_bytes ? bytes : core->priv->refused_bytes;
	return refuse_charge(core, what, err);
}

bool charge_reclaim(struct core *core)
{
	uint64_t held = ledger_held(core->p.ledger, LEDGER_JOBS), most = ledger_limit(core->p.ledger, LEDGER_JOBS),
		 need = core->priv->refused_bytes;
	unsigned n = 0;

	THREAD_LOOP_ONLY();
	if (!need || catalogue_busy(core->p.catalogue))
		return false;
	core->priv->refused_bytes = 0;
	/* Dropping jobs does not help if domains hold the memory, or if all finished jobs hold too little. */
	if (held + need <= most || held - core->history.bytes(core->history.ctx) + need > most)
		return false;
	while (n < FORGOTTEN_MAX && ledger_held(core->p.ledger, LEDGER_JOBS) + need > most &&
	       core->history.forget(core->history.ctx, 0, 0))
		n++;
	if (n == FORGOTTEN_MAX)
		core->priv->refused_bytes = need;
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
			/* Rows of the catalogue exist already, so at the start they may fill the account. */
			return core->loading ? charge(core, bytes, what, err) : refuse_charge(core, what, err);
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
	/* Two copies of the text. For an area: at most one corner per four bytes of text, each with its edge, its entries in
	 * lists of edges and the slack of a growing array; and 40 KiB of cells and strips (view_area.c). */
	const uint64_t corner = 32 + 40 + 16, fixed = 40 << 10;
	uint64_t n = strlen(text) + 1;

	return 2 * n + (areas ? n / 4 * corner + areas * fixed : 0);
}
