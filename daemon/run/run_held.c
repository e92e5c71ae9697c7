/*
 * Sums the memory that a run holds of the budget, for `acutctl status`.
 *
 * The bytes of a task are counted with the task until the loop takes over its result. Memory that a worker may change meanwhile
 * is not counted.
 */
#include "run_priv.h"

static void grid_held(const struct grid *g, uint64_t held[LEDGER_NAMES])
{
	if (!g)
		return;
	held[LEDGER_INDEX] += grid_charged(g);
	held[LEDGER_MANIFEST] += grid_manifest(g)->charged;
}

void run_held(const struct run *w, uint64_t held[LEDGER_NAMES])
{
	struct sched *s = w->runs->core->p.sched;
	const struct run_domain *d;

	core_task_held(w->runs->core, &w->task, held);
	core_task_held(w->runs->core, &w->output_task, held);
	held[LEDGER_DOMAIN] += w->planning.held;
	held[LEDGER_DOMAIN] += w->simplify.held;
	held[LEDGER_EMITTER] += w->emitter_bytes;
	held[LEDGER_PIPE] += w->output_buffer ? RUN_OUTPUT_BUFFER : 0;
	for (d = w->domains; d; d = d->next) {
		uint64_t taken = sched_taken(s, &d->task);

		/* A borrowed arena is counted with the run's. */
		held[LEDGER_DOMAIN] += taken ? taken : d->borrows_arena && d->state == DOMAIN_MAKING ? 0 : d->size;
	}
	held[LEDGER_DOMAIN] += w->arenas.charged;
	/* Otherwise a worker has the plan. */
	if (!w->splitting && w->state >= RUN_RUNNING)
		held[LEDGER_PLAN] += w->plan.cap * sizeof *w->plan.leaf + cut_sites_bytes(w->plan.sites);
	held[LEDGER_JOBS] += w->charged;
	/* Otherwise a worker opens or closes the grids. */
	if (w->grid && w->state != RUN_OPENING && w->state != RUN_SELECTING) {
		grid_held(w->grid, held);
		grid_held(w->origin, held);
		held[LEDGER_MANIFEST] += w->wkt_bytes;
	}
}
