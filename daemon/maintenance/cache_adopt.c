/*
 * `cache adopt`: finished domains of a pack that a client passes become domains of the store.
 *
 * The model: a task of a worker reads the index of the pack, and copies one domain after the other. Each is checked, byte for
 * byte, and takes disk space as one that a run stores. What fits nothing that this daemon has is evicted in time, since it is not
 * used. A domain is believed as one of the store is: whoever may pass one could change what others get, so it takes an
 * administrator.
 */
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "io.h"
#include "log.h"
#include "maintenance_priv.h"
#include "space.h"
#include "store_pack.h"

enum { ENTRIES = 64, MEMORY = 256 << 10, NAME = 256 };
#define TELL_SECONDS 0.2

struct cache_adopt {
	struct sched_task task;
	struct maintenance *maintenance;
	struct cache_adopt *next; /* of all that run */
	struct peer peer;
	const struct cache_adopt_calls *calls;
	void *token;
	int fd, r;
	char name[NAME];
	struct err err;
	uint64_t told_ns;
	atomic_uint_fast64_t at, total; /* bytes */
	struct cache_adopted found;
	struct store_pack_entry entry[ENTRIES];
	uint64_t memory[MEMORY / 8];
};

/* ---- a worker ---- */

static int adopt_one(struct cache_adopt *a, const struct store_pack *pack, const struct store_pack_entry *e)
{
	struct core *core = a->maintenance->core;
	uint64_t old = store_size(core->domainsfd, &e->id);
	struct store_front front;
	int64_t used;
	int r;

	if (e->flat) {
		a->found.flat++;
		return 0;
	}
	if (store_there(core->domainsfd, &e->id, e->bytes, &used)) {
		a->found.there++;
		return 0;
	}
	r = space_take(core->space, SPACE_DOMAINS, e->bytes, SPACE_MAY, "a finished domain", &a->err);
	if (r)
		return r;
	r = store_pack_adopt(pack, e, core->domainsfd, a->memory, sizeof a->memory, &front, &a->err);
	space_commit(core->space, SPACE_DOMAINS, e->bytes, r ? 0 : e->bytes);
	if (r)
		return r;
	if (old)
		space_give(core->space, SPACE_DOMAINS, old); /* of another version */
	else
		space_count_entries(core->space, SPACE_DOMAINS, 1);
	a->found.domains++;
	a->found.bytes += e->bytes;
	return 0;
}

static int adopt_all(struct cache_adopt *a, const struct store_pack *pack)
{
	int r = 0;

	for (uint64_t first = 0; first < pack->n && !r; first += ENTRIES) {
		size_t n = pack->n - first < ENTRIES ? (size_t)(pack->n - first) : ENTRIES;

		r = store_pack_entries(pack, first, n, a->entry, &a->err);
		for (size_t i = 0; i < n && !r; i++) {
			if (atomic_load(&a->task.cancel))
				return err_set(&a->err, ERR_CANCELLED, "ended before all domains were taken");
			r = adopt_one(a, pack, &a->entry[i]);
			atomic_store(&a->at, a->entry[i].at + a->entry[i].bytes);
			atomic_fetch_add(&a->task.beats, 1);
		}
	}
	return r;
}

static void adopt_run(struct sched_task *t)
{
	struct cache_adopt *a = (struct cache_adopt *)t;
	struct client_file id;
	struct store_pack pack;

	a->r = client_file_check(a->fd, a->name, &id, &a->err);
	if (!a->r)
		a->r = store_pack_open(a->fd, a->name, &pack, &a->err);
	if (!a->r) {
		atomic_store(&a->total, pack.bytes);
		a->r = adopt_all(a, &pack);
	}
	if (a->r)
		err_add_file(&a->err, a->name);
}

/* ---- the loop ---- */

static void adopt_done(struct sched_task *t)
{
	struct cache_adopt *a = (struct cache_adopt *)t, **at;
	struct maintenance *m = a->maintenance;

	if (t->ran)
		sched_give(m->core->p.sched, t->name, t->bytes);
	if (!t->ran)
		a->r = err_set(&a->err, ERR_CANCELLED, "ended before all domains were taken");
	for (at = &m->adopt; *at != a; at = &(*at)->next)
		;
	*at = a->next;
	core_background_done(m->core);
	if (a->found.domains)
		log_info("%llu finished domains of %llu bytes were adopted from %s by user %u",
			 (unsigned long long)a->found.domains, (unsigned long long)a->found.bytes, a->name, a->peer.uid);
	a->calls->over(a->token, a->r ? &a->err : NULL, &a->found);
	io_close(a->fd);
	free(a);
}

int cache_adopt(struct maintenance *m, const struct peer *peer, int fd, const char *name, const struct cache_adopt_calls *calls,
		void *token, struct cache_adopt **ret, struct err *err)
{
	struct cache_adopt *a;
	int r = cache_may(peer, "add finished domains", err);

	THREAD_LOOP_ONLY();
	if (!r && m->core->stopping)
		r = err_set(err, ERR_BUSY, "the daemon is stopping");
	if (r)
		return r;
	a = calloc(1, sizeof *a);
	if (!a)
		return err_set(err, ERR_NOMEM, "no memory to adopt domains");
	a->maintenance = m;
	a->peer = rights_without_groups(peer);
	a->calls = calls;
	a->token = token;
	a->fd = fd;
	a->err = ERR_INIT;
	snprintf(a->name, sizeof a->name, "%s", name);
	a->next = m->adopt;
	m->adopt = a;
	a->task = (struct sched_task){.run = adopt_run,
				      .done = adopt_done,
				      .owner = {.uid = peer->uid, .flow = ++m->core->last_flow},
				      .priority = SCHED_NORMAL,
				      .lengthy = true,
				      .reads = true,
				      .watched = true,
				      .name = LEDGER_INPUT,
				      .bytes = sizeof *a};
	*ret = a;
	core_background(m->core, &a->task);
	return 0;
}

void cache_adopt_end(struct cache_adopt *a)
{
	sched_cancel(a->maintenance->core->p.sched, &a->task);
}

void cache_adopt_tick(struct maintenance *m)
{
	for (struct cache_adopt *a = m->adopt, *next; a; a = next) {
		next = a->next;
		if (m->core->stopping) {
			cache_adopt_end(a);
		} else if (clock_since(a->told_ns) >= TELL_SECONDS) {
			a->told_ns = clock_mono_ns();
			a->calls->progress(a->token, "adopt", atomic_load(&a->at), atomic_load(&a->total));
		}
	}
}
