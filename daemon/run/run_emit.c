/*
 * The emission of domains: their triangles become a block for the output, or only sums.
 *
 * At most one emission runs at a time, in plan order.
 */
#include "clock.h"
#include "run_priv.h"

static int take_block(void *ctx, const struct mesh_block *block, struct err *err)
{
	struct run *w = ctx;

	w->blocks = block->index + 1;
	/* Its reader has this block already. */
	if (w->output && block->index < w->output->from)
		return 0;
	w->emitting->block = true;
	if (w->output)
		w->output->calls->encode(w->output, block);
	return 0;
}

static void emit_run(struct sched_task *t)
{
	struct run_domain *d = run_domain_of(t);
	struct run *w = d->run;
	struct mesh_sink sink = {.ctx = w, .block = take_block};

	d->err = ERR_INIT;
	d->r = run_space_spill(w, &d->err);
	/* Whoever has a block can continue the stream after a crash. */
	if (!d->r && w->output && w->file)
		d->r = plan_file_settle(w->file, &d->err);
	if (!d->r)
		d->r = pipe_emit(w->emitter, &d->domain, &d->region, d->domain.triangle ? &sink : NULL, &d->err);
	if (!d->domain.triangle) {
		w->blocks++;
		d->block = !w->output;
	}
}

static void emit_done(struct sched_task *t)
{
	struct run_domain *d = run_domain_of(t);
	struct run *w = d->run;
	bool block = d->block;

	w->tasks--;
	w->emitting = NULL;
	w->output_working = false;
	if (w->output_freed)
		run_output_drop(w);
	if (!t->ran || d->r) {
		if (t->ran)
			run_fail(w, &d->err);
		run_domain_release(d);
		run_settle(w);
		return;
	}
	w->next_emit++;
	w->points += d->domain.counts.points;
	if (d->domain.ntriangle && !w->first_ns)
		w->first_ns = clock_mono_ns();
	if (block && w->output) {
		run_domain_set_state(d, DOMAIN_SENDING);
		w->sending = d;
		w->output_busy = true;
		w->sending_ns = clock_mono_ns();
		w->output->calls->send(w->output);
	} else {
		run_domain_release(d);
	}
	if (w->calls->progressed)
		w->calls->progressed(w->ctx);
	run_settle(w);
}

/* Emits a domain of which only the sums are needed: too little work for a task. */
static void count_domain(struct run_domain *d)
{
	struct run *w = d->run;
	struct err err = ERR_INIT;
	int r = pipe_emit(w->emitter, &d->domain, &d->region, NULL, &err);

	if (r)
		run_fail(w, &err);
	w->blocks += d->domain.nvertex > 0;
	if (d->domain.ntriangle && !w->first_ns)
		w->first_ns = clock_mono_ns();
	w->next_emit++;
	w->points += d->domain.counts.points;
	run_domain_release(d);
	if (w->sums_only && w->calls->progressed)
		w->calls->progressed(w->ctx);
}

void run_domain_emit(struct run_domain *d)
{
	struct run *w = d->run;

	if (!d->domain.nvertex || w->sums_only) {
		count_domain(d);
		return;
	}
	if (!d->domain.triangle && w->output && w->blocks >= w->output->from) {
		/* Its triangles are needed now: a reader came, or an earlier region was split, which moves the numbers of
		 * blocks. */
		run_domain_restart(d, SCHED_FIRST);
		return;
	}
	run_domain_set_state(d, DOMAIN_EMITTING);
	w->emitting = d;
	w->output_working = w->output != NULL;
	run_domain_submit(d, emit_run, emit_done, SCHED_FIRST, 0);
}
