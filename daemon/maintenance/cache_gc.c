/*
 * `cache stat` and `cache gc`: the use of the disk, and removal of what is not needed.
 *
 * Without --all, gc removes what exceeds the quota, leftovers of interrupted work, and finished domains of removed datasets, as
 * far as these are known (cache_gone.c). With --all it removes everything that can be made again.
 */
#include <stdlib.h>
#include <unistd.h>

#include "cache_priv.h"
#include "io.h"
#include "log.h"

int cache_may(const struct peer *peer, const char *what, struct err *err)
{
	if (rights_admin(peer))
		return 0;
	err_set(err, ERR_PERM, "only administrators may %s", what);
	return err_add_hint(err, "ask an administrator of the daemon");
}

void cache_stat(struct maintenance *m, struct cache_stat *ret)
{
	const struct pending *q;
	const struct dataset *d;

	disk_tick(m->core, true); /* the numbers may be old if the daemon was idle */
	datasets_count(m->datasets);
	disk_query_now(m->core);
	space_stat(m->core->space, &ret->space);
	for (d = datasets_first(m->datasets); d; d = d->next) {
		ret->space.kind[d->onestep    ? SPACE_ONESTEP :
				d->removed_us ? SPACE_REMOVED :
						SPACE_DATASETS]
			.entries += d->onestep || d->generation;
		for (q = d->pending; q; q = q->next)
			ret->space.kind[SPACE_PENDING].entries++;
	}
	space_limit_text(&m->core->p.limits.disk, ret->disk);
	space_limit_text(&m->core->p.limits.keep_free, ret->keep_free);
}

struct gc {
	struct sched_task task;
	struct maintenance *maintenance;
	bool all;
	struct gone *gone; /* NULL with `all` */
	uint64_t bytes, entries;
	int r;
	struct err err;
	void (*freed)(void *token, const struct err *why, uint64_t bytes, uint64_t entries);
	void *token;
};

static void gc_run(struct sched_task *t)
{
	struct gc *g = (struct gc *)t;
	uint64_t bytes = 0, entries = 0;

	g->r = space_sweep(g->maintenance->core->space, &g->bytes, &g->entries, &g->err);
	if (!g->r && g->gone) {
		g->r = cache_gone_run(g->gone, &bytes, &entries, &g->err);
		g->bytes += bytes;
		g->entries += entries;
	}
	if (!g->r) {
		g->r = space_evict(g->maintenance->core->space, g->all, &bytes, &entries, &g->err);
		g->bytes += bytes;
		g->entries += entries;
	}
}

static void gc_done(struct sched_task *t)
{
	struct gc *g = (struct gc *)t;

	if (!t->ran)
		g->r = err_set(&g->err, ERR_CANCELLED, "the daemon is stopping");
	core_background_done(g->maintenance->core);
	cache_gone_free(g->gone);
	g->freed(g->token, g->r ? &g->err : NULL, g->bytes, g->entries);
	free(g);
}

void cache_gc(struct maintenance *m, const struct peer *peer, bool all,
	      void (*freed)(void *token, const struct err *why, uint64_t bytes, uint64_t entries), void *token)
{
	struct err err = ERR_INIT;
	struct gc *g = NULL;

	THREAD_LOOP_ONLY();
	if (!cache_may(peer, "remove what is stored", &err)) {
		g = calloc(1, sizeof *g);
		if (!g)
			err_set(&err, ERR_NOMEM, "no memory to look through the cache");
	}
	if (g && !all && !(g->gone = cache_gone_new(m, &err))) {
		free(g);
		g = NULL;
	}
	if (!g) {
		freed(token, &err, 0, 0);
		return;
	}
	g->task = (struct sched_task){
		.run = gc_run, .done = gc_done, .owner = {.uid = peer->uid}, .priority = SCHED_NORMAL, .lengthy = true};
	g->maintenance = m;
	g->all = all;
	g->err = ERR_INIT;
	g->freed = freed;
	g->token = token;
	core_background(m->core, &g->task);
}
