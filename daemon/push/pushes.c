/* All open pushes: the list, its turns in the loop, and what they hold of the budget. */
#include <assert.h>
#include <stdlib.h>

#include "clock.h"
#include "push_priv.h"

int pushes_new(struct core *core, struct admission *admission, struct datasets *datasets, struct geoids *geoids,
	       struct pushes **ret, struct err *err)
{
	struct pushes *pushes = calloc(1, sizeof *pushes);

	if (!pushes)
		return err_set(err, ERR_NOMEM, "no memory for the daemon");
	*pushes = (struct pushes){.core = core, .admission = admission, .datasets = datasets, .geoids = geoids};
	*ret = pushes;
	return 0;
}

struct pushes *pushes_free(struct pushes *pushes)
{
	assert(!pushes || !pushes->first);
	free(pushes);
	return NULL;
}

unsigned pushes_open(const struct pushes *pushes)
{
	unsigned n = 0;

	for (const struct push *p = pushes->first; p; p = p->next)
		n++;
	return n;
}

size_t pushes_into(const struct pushes *pushes, const struct dataset *d, uint32_t uid, bool all, uint64_t *ret_ids, size_t most)
{
	size_t n = 0;

	for (const struct push *p = pushes->first; p; p = p->next)
		if (p->dataset == d && (all || p->peer.uid == uid)) {
			if (n < most)
				ret_ids[n] = p->id;
			n++;
		}
	return n;
}

void pushes_settle(struct pushes *pushes)
{
	struct push *p, *next;

	THREAD_LOOP_ONLY();
	for (p = pushes->first; p; p = next) {
		next = p->next;
		push_retry(p);
	}
}

void pushes_tick(struct pushes *pushes)
{
	struct push *p, *next;

	THREAD_LOOP_ONLY();
	for (p = pushes->first; p; p = next) {
		next = p->next;
		push_tick(p);
	}
}

void pushes_abandon(struct pushes *pushes)
{
	for (struct push *p = pushes->first; p; p = p->next)
		push_remove_files(p);
}

static void held_by(const struct push *p, uint64_t held[LEDGER_NAMES])
{
	const struct core *core = p->pushes->core;
	const struct push_stream *s;

	held[LEDGER_JOBS] += p->charged;
	core_task_held(core, &p->task, held);
	/* Plans already count a stage that is about to be made, but its bytes are still the task's. */
	if (p->stage_bytes && !(p->busy && p->requests && p->requests->kind == PUSH_STAGE))
		held[LEDGER_STAGE] += p->stage_bytes;
	held[LEDGER_FILES] += p->table_bytes;
	/* During some requests a worker reads or frees these. */
	if (!p->busy || p->waits_memory) {
		held[LEDGER_MANIFEST] += p->base ? p->base->charged : 0;
		for (size_t i = 0; i < p->noffers; i++)
			held[LEDGER_MANIFEST] += p->offers[i].manifest ? p->offers[i].manifest->charged : 0;
	}
	if (p->requests && p->requests->helpers)
		held[LEDGER_INPUT] += push_helpers_held(p->requests->helpers);
	for (s = p->streams; s; s = s->next)
		core_task_held(core, &s->task, held);
}

static const char *file_of(const struct push *p)
{
	const struct push_request *rq = p->requests;

	return !rq ? "" : rq->path && *rq->path ? rq->path : rq->name ? rq->name : "";
}

unsigned pushes_stalled(const struct pushes *pushes, struct push_stall *ret)
{
	unsigned n = 0;

	*ret = (struct push_stall){.seconds = PUSH_STALL_SECONDS};
	for (const struct push *p = pushes->first; p; p = p->next) {
		double seconds = p->seen_ns ? clock_since(p->seen_ns) : 0;

		if (seconds < PUSH_STALL_SECONDS)
			continue;
		n++;
		if (seconds >= ret->seconds)
			*ret = (struct push_stall){p->id, p->peer.uid, file_of(p), seconds};
	}
	return n;
}

void pushes_held(const struct pushes *pushes, void (*each)(void *ctx, const struct core_holder *), void *ctx)
{
	for (const struct push *p = pushes->first; p; p = p->next) {
		struct core_holder h = {.kind = "push", .id = p->id, .peer = p->peer, .dataset = p->dataset->name};

		held_by(p, h.held);
		each(ctx, &h);
	}
}
