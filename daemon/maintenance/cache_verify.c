/*
 * `cache verify`: the order of the steps, and the reports.
 *
 * The model: the steps are the catalogue (on its own thread), each dataset with its interrupted pushes, plans, selections, and
 * stored domains. Each is a task of the lowest priority, so other work comes first. The files of a dataset are kept while it is
 * read. A worker puts each damage into a short list, which the loop empties and reports; a worker that finds the list full waits.
 * If memory is lacking, the step is tried again later.
 */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cache_priv.h"
#include "clock.h"
#include "log.h"

#define TELL_SECONDS 0.2
#define AGAIN_SECONDS 1.0

static const char *const phases[CACHE_OVER] = {
	[CACHE_CATALOGUE] = "catalogue",   [CACHE_DATASETS] = "datasets", [CACHE_PLANS] = "plans",
	[CACHE_SELECTIONS] = "selections", [CACHE_DOMAINS] = "domains",
};

bool cache_ended(struct cache_verify *v)
{
	bool ended;

	lock_take(&v->lock);
	ended = v->ended;
	lock_give(&v->lock);
	return ended;
}

void cache_found(struct cache_verify *v, const char *what, bool derived, bool removed, const struct err *err)
{
	struct cache_damage *d;
	const bool newer = err->code == ERR_VERSION;

	lock_take(&v->lock);
	while (v->ndamage == CACHE_DAMAGES && !v->ended)
		lock_wait(&v->lock, &v->room);
	if (newer)
		*(derived ? &v->found.derived_newer : &v->found.newer) += 1;
	else
		*(derived ? &v->found.derived : &v->found.damaged) += 1;
	if (v->ndamage < CACHE_DAMAGES) {
		d = &v->damage[v->ndamage++];
		*d = (struct cache_damage){.what = what, .err = *err, .derived = derived, .removed = removed};
		if (newer)
			err_add_hint(&d->err,
				     derived ? "it stays for the newer acut that wrote it; this one makes its own if needed" :
					       "it stays as it is: install the newer acut that wrote it, or a later one");
		if (v->step == CACHE_DATASETS && v->dataset)
			memcpy(d->dataset, v->dataset->name, sizeof d->dataset);
	}
	lock_give(&v->lock);
}

/* ---- reports ---- */

/* Loop. Takes one damage out of the list: it is reported without the lock, since a callback may call cache_verify_end. */
static bool next_damage(struct cache_verify *v, struct cache_damage *ret)
{
	bool any;

	lock_take(&v->lock);
	any = v->ndamage > 0;
	if (any) {
		*ret = v->damage[0];
		memmove(v->damage, v->damage + 1, --v->ndamage * sizeof *v->damage);
		pthread_cond_broadcast(&v->room);
	}
	lock_give(&v->lock);
	return any;
}

static void report(struct cache_verify *v, bool all)
{
	struct cache_damage damage;

	for (unsigned n = 0; n < 4 * CACHE_DAMAGES && next_damage(v, &damage); n++) {
		const struct log_about about = {.dataset = *damage.dataset ? damage.dataset : NULL};

		if (damage.err.code == ERR_VERSION && damage.derived)
			log_err(LOG_LEVEL_INFO, "a derived file of a newer version", &damage.err);
		else if (damage.err.code == ERR_VERSION)
			log_event_err(LOG_EVENT_NEWER_VERSION, &about, "a file of a newer version", &damage.err);
		else if (damage.derived)
			log_event_err(LOG_EVENT_DAMAGE_DERIVED, &about, "damaged, and made again when needed", &damage.err);
		else
			log_event_err(LOG_EVENT_DAMAGE, &about, "damaged", &damage.err);
		v->calls->damage(v->token, &damage);
	}
	if (v->step < CACHE_OVER && (all || clock_since(v->told_ns) >= TELL_SECONDS)) {
		struct space_stat st;
		uint64_t total = 0;

		space_stat(v->maintenance->core->space, &st);
		for (int k = 0; k < SPACE_KINDS; k++)
			total += k == SPACE_TEMPORARY || k == SPACE_ONESTEP ? 0 : st.kind[k].bytes;
		v->told_ns = clock_mono_ns();
		v->calls->progress(v->token, phases[v->step], atomic_load(&v->bytes), total);
	}
}

static void report_end(struct cache_verify *v, const struct err *why)
{
	if (why)
		return;
	verified_note(v->maintenance, &v->found);
	if (v->found.newer)
		log_warning("verified: %llu of %llu files are of a newer version of acut, and were not read",
			    (unsigned long long)v->found.newer, (unsigned long long)v->found.files);
	if (v->found.damaged)
		log_event(LOG_EVENT_VERIFY_DAMAGE, NULL,
			  "verified: %llu of %llu files are damaged, and %llu that can be made again",
			  (unsigned long long)v->found.damaged, (unsigned long long)v->found.files,
			  (unsigned long long)v->found.derived);
	else if (!v->found.newer)
		log_event(LOG_EVENT_VERIFY_DONE, NULL, "verified: %llu files of %llu bytes, %llu damaged ones can be made again",
			  (unsigned long long)v->found.files, (unsigned long long)v->found.bytes,
			  (unsigned long long)v->found.derived);
}

static void finish(struct cache_verify *v, const struct err *why)
{
	v->step = CACHE_OVER;
	report(v, false);
	v->found.bytes = atomic_load(&v->bytes);
	v->found.files = atomic_load(&v->files);
	report_end(v, why);
	v->maintenance->verify = NULL;
	core_background_done(v->maintenance->core);
	v->calls->over(v->token, why, &v->found);
	lock_done(&v->lock);
	pthread_cond_destroy(&v->room);
	free(v->damage);
	free(v);
}

/* ---- steps ---- */

static void next_step(struct cache_verify *v);

static void catalogue_done(void *ctx, int r, const struct err *why)
{
	struct cache_verify *v = ctx;
	struct err err = ERR_INIT;

	if (r && why)
		err = *why;
	else if (r)
		err_set(&err, ERR_NOMEM, "the catalogue could not be checked");
	v->busy = false;
	atomic_fetch_add(&v->files, 1);
	if (r)
		cache_found(v, "catalogue", false, false, &err);
	v->step++;
	next_step(v);
}

static void step_run(struct sched_task *t)
{
	struct cache_verify *v = (struct cache_verify *)((char *)t - offsetof(struct cache_verify, task));
	static void (*const reads[])(struct cache_verify *) = {
		[CACHE_DATASETS] = cache_read_dataset,
		[CACHE_PLANS] = cache_read_plans,
		[CACHE_SELECTIONS] = cache_read_selections,
		[CACHE_DOMAINS] = cache_read_domains,
	};

	v->r = 0;
	v->err = ERR_INIT;
	v->memory = malloc(GRID_VERIFY_BYTES);
	if (!v->memory)
		v->r = err_set(&v->err, ERR_NOMEM, "no memory to read what is stored");
	else
		reads[v->step](v);
	free(v->memory);
}

static void release_dataset(struct cache_verify *v)
{
	dataset_read_end(v->dataset);
	dataset_release(v->dataset);
	v->dataset = NULL;
}

static void step_done(struct sched_task *t)
{
	struct cache_verify *v = (struct cache_verify *)((char *)t - offsetof(struct cache_verify, task));
	bool later = t->ran && (v->r == -ERR_BUSY || v->r == -ERR_NOMEM);

	v->busy = false;
	if (t->ran)
		sched_give(v->maintenance->core->p.sched, t->name, t->bytes);
	if (v->dataset && !later)
		v->last = v->dataset->id;
	if (v->dataset) {
		report(v, true); /* while the name of the dataset is known */
		release_dataset(v);
	}
	if (later && !cache_ended(v)) {
		v->wait_ns = clock_mono_ns();
		return;
	}
	if (!t->ran || cache_ended(v)) {
		err_clear(&v->err);
		err_set(&v->err, ERR_CANCELLED, "the verification was ended before all was read");
		finish(v, &v->err);
	} else if (v->r) {
		finish(v, &v->err);
	} else {
		if (v->step != CACHE_DATASETS)
			v->step++;
		next_step(v);
	}
}

static void submit(struct cache_verify *v)
{
	v->task = (struct sched_task){
		.run = step_run,
		.done = step_done,
		.owner = {.uid = geteuid(), .rank = SCHED_RANK_LOW},
		.priority = SCHED_LAST,
		.lengthy = true,
		.name = LEDGER_INPUT,
		.bytes = GRID_VERIFY_BYTES,
	};
	v->busy = true;
	sched_submit(v->maintenance->core->p.sched, &v->task);
}

/* The next dataset that has files. The list of named datasets is sorted by number. */
static bool next_dataset(struct cache_verify *v)
{
	const size_t most = sizeof v->pending / sizeof *v->pending;
	struct dataset *d;

	for (d = datasets_first(v->maintenance->datasets);
	     d && (d->onestep || d->id <= v->last || (!*d->manifest && !d->pending)); d = d->next)
		;
	if (!d)
		return false;
	v->dataset = dataset_hold(d);
	dataset_read_begin(d);
	memcpy(v->manifest, d->manifest, sizeof v->manifest);
	v->npending = 0;
	for (const struct pending *q = d->pending; q && v->npending < most; q = q->next)
		v->pending[v->npending++] = q->id;
	return true;
}

static void next_step(struct cache_verify *v)
{
	struct err err = ERR_INIT;

	v->wait_ns = 0;
	if (cache_ended(v) || v->maintenance->core->stopping) {
		err_set(&err, ERR_CANCELLED, "the verification was ended before all was read");
		finish(v, &err);
		return;
	}
	if (v->step == CACHE_CATALOGUE) {
		v->busy = true;
		if (catalogue_check(v->maintenance->core->p.catalogue, catalogue_done, v, &err)) {
			v->busy = false;
			finish(v, &err);
		}
		return;
	}
	if (v->step == CACHE_DATASETS && !next_dataset(v))
		v->step++;
	if (v->step == CACHE_OVER)
		finish(v, NULL);
	else
		submit(v);
}

void cache_verify_tick(struct maintenance *m)
{
	struct cache_verify *v = m->verify;

	if (!v)
		return;
	if (m->core->stopping)
		cache_verify_end(v);
	report(v, false);
	if (!v->busy && v->wait_ns && clock_since(v->wait_ns) >= AGAIN_SECONDS)
		next_step(v);
}

/* ---- requests ---- */

int cache_verify(struct maintenance *m, const struct peer *peer, const struct cache_verify_calls *calls, void *token,
		 struct cache_verify **ret, struct err *err)
{
	struct cache_verify *v;
	int r = cache_may(peer, "verify what is stored", err);

	THREAD_LOOP_ONLY();
	if (r)
		return r;
	if (m->verify || m->core->stopping)
		return err_set(err, ERR_BUSY,
			       m->verify ? "a verification is running already, for another client" : "the daemon is stopping");
	v = calloc(1, sizeof *v);
	if (v)
		v->damage = calloc(CACHE_DAMAGES, sizeof *v->damage);
	if (!v || !v->damage) {
		free(v);
		return err_set(err, ERR_NOMEM, "no memory to verify what is stored");
	}
	lock_init(&v->lock, LOCK_VERIFY);
	pthread_cond_init(&v->room, NULL);
	v->maintenance = m;
	v->calls = calls;
	v->token = token;
	v->err = ERR_INIT;
	m->verify = v;
	m->core->background++;
	*ret = v;
	/* It begins with the next tick, after the caller has *ret. */
	v->wait_ns = 1;
	return 0;
}

void cache_verify_end(struct cache_verify *v)
{
	lock_take(&v->lock);
	v->ended = true;
	pthread_cond_broadcast(&v->room);
	lock_give(&v->lock);
	if (v->busy && v->step != CACHE_CATALOGUE)
		sched_cancel(v->maintenance->core->p.sched, &v->task);
	v->wait_ns = 1;
}
