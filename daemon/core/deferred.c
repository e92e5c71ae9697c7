/*
 * Work of a start that may wait: removal of what an earlier daemon left, and measuring the cache.
 *
 * The model: these tasks examine up to a hundred thousand files of a large cache, and whoever starts a daemon wants a quick first
 * answer. So the tasks wait until the time of deferral is over, or until a client begins work (which may need the space that they
 * free). A stop does not wait for them: those that have not begun are cancelled, and the next start makes the same ones again.
 */
#include <assert.h>

#include "clock.h"
#include "core_priv.h"

void deferred_begin(struct core *core)
{
	struct deferred *d = &core->priv->deferred;

	THREAD_LOOP_ONLY();
	assert(!d->since_ns && !d->n);
	d->since_ns = clock_mono_ns();
	d->ended = core->p.defer_seconds <= 0;
}

void deferred_submit(struct core *core, struct sched_task *t)
{
	struct deferred *d = &core->priv->deferred;

	THREAD_LOOP_ONLY();
	assert(d->n < sizeof d->task / sizeof d->task[0]);
	d->task[d->n++] = t;
	if (d->ended)
		core_background(core, t);
}

void deferred_done(struct core *core, const struct sched_task *t)
{
	struct deferred *d = &core->priv->deferred;
	unsigned i = 0;

	THREAD_LOOP_ONLY();
	while (i < d->n && d->task[i] != t)
		i++;
	assert(i < d->n);
	d->task[i] = d->task[--d->n];
	core_background_done(core);
}

static void submit_all(struct core *core)
{
	struct deferred *d = &core->priv->deferred;

	d->ended = true;
	for (unsigned i = 0; i < d->n; i++)
		core_background(core, d->task[i]);
}

bool deferred_tick(struct core *core, bool client_work)
{
	struct deferred *d = &core->priv->deferred;

	if (!d->ended && (client_work || clock_since(d->since_ns) >= core->p.defer_seconds))
		submit_all(core);
	return d->ended;
}

bool deferred_is_pending(const struct core *core)
{
	return !core->priv->deferred.ended;
}

void deferred_cancel_all(struct core *core)
{
	struct deferred *d = &core->priv->deferred;

	THREAD_LOOP_ONLY();
	/* Those that were submitted end by the scheduler, which calls `done`. */
	for (unsigned i = 0; d->ended && i < d->n; i++)
		sched_cancel(core->p.sched, d->task[i]);
	while (!d->ended && d->n) {
		struct sched_task *t = d->task[d->n - 1];

		core->background++;
		t->done(t);
	}
	d->ended = true;
}
