/*
 * What a run holds of the budget.
 *
 * The bytes of a task are its own until the loop hears of its end, then they are where the loop keeps them. What a worker is
 * about to change is left out: it is the task's.
 */
#include "run_priv.h"

void run_held(const struct run *w, uint64_t held[LEDGER_NAMES])
{
	struct sched *s = w->runs->core->p.sched;
	const struct run_domain *d;

	core_task_held(w->runs->core, &w->task, held);
	core_task_held(w->runs->core, &w->output_task, held);
	held[LEDGER_DOMAIN] += w->planning.held;
	held[LEDGER_EMITTER] += w->emitter_bytes;
	held[LEDGER_PIPE] += w->output_buffer ? RUN_OUTPUT_BUFFER : 0;
	for (d = w->domains; d; d = d->next) {
		uint64_t taken = sched_taken(s, &d->task);

		/* A lent arena is the run's. */
		held[LEDGER_DOMAIN] += taken ? taken : d->lent && d->state == DOMAIN_MAKING ? 0 : d->size;
	}
	held[LEDGER_DOMAIN] += w->arenas.charged;
	/* Workers have it in these states. */
	if (!w->splitting && w->state >= RUN_RUNNING)
		held[LEDGER_PLAN] += w->plan.cap * sizeof *w->plan.leaf + cut_sites_bytes(w->plan.sites);
	held[LEDGER_JOBS] += w->charged;
	/* Workers open and close it in these states. */
	if (w->grid && w->state != RUN_OPENING && w->state != RUN_SELECTING) {
		held[LEDGER_INDEX] += grid_charged(w->grid);
		held[LEDGER_MANIFEST] += grid_manifest(w->grid)->charged;
	}
}
