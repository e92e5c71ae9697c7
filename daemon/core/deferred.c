/*
 * Work of a start that may wait: removal of what an earlier daemon left, and measuring the cache.
 *
 * The model: these tasks examine up to a hundred thousand files of a large cache, and whoever starts a daemon wants a quick first
 * answer. So the tasks wait until the time of deferral is over, until a client begins work (which may need the space that they
 * free), or until the daemon stops.
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
	if (d->ended || d->n == sizeof d->task / sizeof d->task[0])
		core_background(core, t);
	else
		d->task[d->n++] = t;
}

void deferred_submit_all(struct core *core)
{
	struct deferred *d = &core->priv->deferred;

	THREAD_LOOP_ONLY();
	d->ended = true;
	while (d->n)
		core_background(core, d->task[--d->n]);
}

bool deferred_tick(struct core *core, bool client_work)
{
	struct deferred *d = &core->priv->deferred;

	if (!d->ended && (client_work || clock_since(d->since_ns) >= core->p.defer_seconds))
		deferred_submit_all(core);
	return d->ended;
}

bool deferred_is_pending(const struct core *core)
{
	return !core->priv->deferred.ended;
}

void deferred_cancel_all(struct core *core)
{
	struct deferred *d = &core->priv->deferred;

	while (d->n) {
		struct sched_task *t = d->task[--d->n];

		core->background++;
		t->done(t);
	}
}
