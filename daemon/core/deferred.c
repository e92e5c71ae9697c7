/*
 * Work after a start that can wait: removing what an earlier daemon left, and measuring the cache.
 *
 * The model: whoever starts a daemon wants an answer first, and these tasks look at a hundred thousand files of a large cache. So
 * they are kept back until the time for that is over, somebody begins something (which may want the room that they make), or the
 * daemon stops.
 */
#include "clock.h"
#include "core.h"

void deferred_begin(struct core *core)
{
	core->deferred.from_ns = clock_mono_ns();
	core->deferred.over = core->p.rest <= 0;
}

void deferred_submit(struct core *core, struct sched_task *t)
{
	THREAD_LOOP_ONLY();
	if (core->deferred.over || core->deferred.n == sizeof core->deferred.task / sizeof core->deferred.task[0])
		core_background(core, t);
	else
		core->deferred.task[core->deferred.n++] = t;
}

void deferred_end(struct core *core)
{
	core->deferred.over = true;
	while (core->deferred.n)
		core_background(core, core->deferred.task[--core->deferred.n]);
}

bool deferred_over(struct core *core, bool active)
{
	if (!core->deferred.over && (active || clock_since(core->deferred.from_ns) >= core->p.rest))
		deferred_end(core);
	return core->deferred.over;
}

bool deferred_waits(const struct core *core)
{
	return !core->deferred.over;
}

/* The tasks do not run any more; each gives back what it has. */
void deferred_drop(struct core *core)
{
	while (core->deferred.n) {
		struct sched_task *t = core->deferred.task[--core->deferred.n];

		core->background++;
		t->done(t);
	}
}
