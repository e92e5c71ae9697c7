/*
 * Changes of a dataset that are no push, such as a revert.
 *
 * The model: manifests are made one after the other. The push or change that makes the next one is the dataset's `committer`; a
 * change that finds another committer waits in a queue. A worker reads the newest manifest, lets `make` change a copy, and writes
 * it durably. Then the row of the catalogue names it, and then the dataset in memory. A crash may leave a manifest that no row
 * names, complete or not, and no row leads the next start to it. So the push or change that publishes the next manifest first
 * removes what a crash left (dataset_tidy).
 */
#include "dataset_change.h"

#include <assert.h>
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "io.h"
#include "log.h"

/* ---- worker ---- */

static void *copy_array(const void *from, size_t n, size_t size)
{
	void *to = calloc(n + 1, size);

	if (to && n)
		memcpy(to, from, n * size);
	return to;
}

/* For the copy, the written manifest, and the buffer to write it. */
static int charge_manifest(struct dataset_change *c, uint64_t bytes, struct err *err)
{
	if (ledger_take(c->datasets->core->p.ledger, LEDGER_MANIFEST, bytes))
		return 0;
	err_set(err, ERR_BUSY, "no %llu KiB are free for the next manifest of the dataset %s", (unsigned long long)(bytes >> 10),
		c->dataset->name);
	return err_add_hint(err, "try again when other jobs are done, or give acutd more memory");
}

static int write_made(struct dataset_change *c, const struct grid_manifest *base, struct err *err)
{
	struct grid_manifest m = *base;
	uint64_t bytes = 4 * base->charged;
	int dirfd = c->dataset->dirfd, r = charge_manifest(c, bytes, err);

	if (r)
		return r;
	m.texts = m.names = NULL;
	m.spans = NULL;
	m.ledger = NULL;
	m.charged = 0;
	m.generations = NULL;
	m.segments = copy_array(base->segments, base->nsegments, sizeof *m.segments);
	m.sources = copy_array(base->sources, base->nsources, sizeof *m.sources);
	if (!m.segments || !m.sources)
		r = err_set(err, ERR_NOMEM, "no memory for a manifest");
	else
		r = c->make(c, base, &m, err);
	if (!r && m.generation != base->generation)
		r = dataset_note_generation(&m, base, &c->peer, c->kind, c->undoes, err);
	else if (!r && !(m.generations = copy_array(base->generations, base->ngenerations, sizeof *m.generations)))
		r = err_set(err, ERR_NOMEM, "no memory for a manifest");
	if (!r && m.generation != base->generation) {
		c->made_generation = m.generations[m.ngenerations - 1];
		c->made_generation.user = NULL;
	}
	c->apart.name = c->sources_name;
	if (!r)
		r = grid_manifest_write_apart(dirfd, c->made_name, &c->apart, &m, err);
	if (!r)
		r = grid_manifest_load(dirfd, c->made_name, c->datasets->core->p.ledger, &c->made, err);
	free(m.segments);
	free(m.sources);
	free(m.generations);
	free(m.spans);
	ledger_give(c->datasets->core->p.ledger, LEDGER_MANIFEST, bytes);
	return r;
}

void dataset_remove_made(int dirfd, const char *manifest, const struct grid_apart *apart)
{
	io->unlinkat(dirfd, manifest, 0);
	if (apart->made)
		io->unlinkat(dirfd, apart->name, 0);
}

static void remove_made(struct dataset_change *c)
{
	dataset_remove_made(c->dataset->dirfd, c->made_name, &c->apart);
	if (c->undo)
		c->undo(c);
}

static void change_run(struct sched_task *t)
{
	struct dataset_change *c = (struct dataset_change *)t;
	struct grid_manifest *base = NULL;

	c->r = dataset_open(c->dataset, &c->err);
	c->opened = !c->r;
	if (!c->r)
		c->r = grid_manifest_load(c->dataset->dirfd, c->base_name, c->datasets->core->p.ledger, &base, &c->err);
	if (!c->r)
		dataset_tidy(c->dataset, c->base_name, base);
	if (!c->r)
		c->r = write_made(c, base, &c->err);
	/* Nothing names a manifest that was not committed. */
	if (c->r && base)
		remove_made(c);
	grid_manifest_free(base);
}

struct others {
	const struct dataset *dataset;
	const char *keep;
	const struct grid_manifest *m; /* what is in it */
};

static int remove_other(void *ctx, const struct dirent *e, struct err *err)
{
	const struct others *o = ctx;

	if ((strncmp(e->d_name, "manifest-", 9) && strncmp(e->d_name, "sources-", 8)) || !strcmp(e->d_name, o->keep))
		return 0;
	for (size_t i = 0; i < o->m->nfiles; i++)
		if (!strcmp(e->d_name, o->m->files[i].name))
			return 0;
	return io_remove(o->dataset->dirfd, e->d_name, err);
}

/* No other manifest is being read or written now, so all others are obsolete, and so are their files of sources. */
static void remove_others(const struct dataset *d, const char *keep, const struct grid_manifest *m)
{
	struct err err = ERR_INIT;

	if (io_list(d->dirfd, ".", remove_other, &(struct others){d, keep, m}, &err))
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "an old manifest stays behind", &err);
}

void dataset_tidy(struct dataset *d, const char *newest, const struct grid_manifest *m)
{
	/* Without the newest manifest nothing is removed, so that the folder can be repaired. */
	if (!d->tidied && !d->onestep && *newest)
		remove_others(d, newest, m);
	d->tidied = true;
}

static void tidy_run(struct sched_task *t)
{
	struct dataset_change *c = (struct dataset_change *)t;

	if (c->r && catalogue_is_uncertain(c->datasets->core->p.catalogue))
		return;
	if (c->r)
		remove_made(c);
	else
		remove_others(c->dataset, c->made_name, c->made);
}

void dataset_sources_name(const char *manifest, char ret[64])
{
	assert(!strncmp(manifest, "manifest-", 9));
	snprintf(ret, 64, "sources-%.54s", manifest + 9);
}

/* ---- loop ---- */

static void change_finish(struct dataset_change *c)
{
	struct dataset *d = c->dataset;

	if (c->opened)
		dataset_close(d);
	dataset_commit_end(d, c);
	c->made = grid_manifest_free(c->made);
	dataset_next_clear(&c->new_state);
	core_background_done(c->datasets->core);
	c->done(c, c->r ? &c->err : NULL);
	dataset_release(d);
}

static void tidy_done(struct sched_task *t)
{
	change_finish((struct dataset_change *)t);
}

static void change_submit(struct dataset_change *c, void (*run)(struct sched_task *), void (*done)(struct sched_task *))
{
	c->task = (struct sched_task){.run = run,
				      .done = done,
				      .owner = {.uid = c->peer.uid, .flow = ++c->datasets->core->last_flow},
				      .priority = c->lengthy ? SCHED_NORMAL : SCHED_FIRST,
				      .lengthy = c->lengthy};
	sched_submit(c->datasets->core->p.sched, &c->task);
}

static void row_written(void *ctx, int r, const struct err *why)
{
	struct dataset_change *c = ctx;
	struct dataset *d = c->dataset;
	bool in_use = dataset_is_read(d);

	assert(d->committer == c);
	dataset_row_written(d);
	c->r = r;
	if (r)
		c->err = *why;
	else
		dataset_next_install(d, &c->new_state, in_use);
	/* The old manifest stays while somebody opens it. */
	if (!r && in_use)
		change_finish(c);
	else
		change_submit(c, tidy_run, tidy_done);
}

static void change_done(struct sched_task *t)
{
	struct dataset_change *c = (struct dataset_change *)t;

	dataset_read_end(c->dataset);
	if (!t->ran)
		c->r = err_set(&c->err, ERR_CANCELLED, "the daemon is stopping");
	if (!c->r)
		c->r = dataset_next_make(c->dataset, c->made, &c->apart, c->made_name, c->dataset->pushed_us, &c->new_state,
					 &c->err);
	if (!c->r)
		c->r = dataset_next_put(c->dataset, &c->new_state, 0, row_written, c, &c->err);
	if (!c->r)
		return;
	if (c->made)
		change_submit(c, tidy_run, tidy_done);
	else
		change_finish(c);
}

/* The dataset has no committer. */
static void change_begin(struct dataset_change *c)
{
	struct dataset *d = c->dataset;

	assert(!d->committer);
	dataset_commit_begin(d, c);
	memcpy(c->base_name, d->manifest, sizeof c->base_name);
	/* The time makes the name unique, also among those of earlier daemons. */
	snprintf(c->made_name, sizeof c->made_name, "manifest-%llu-c%llu", (unsigned long long)d->generation + 1,
		 (unsigned long long)clock_real_us());
	dataset_sources_name(c->made_name, c->sources_name);
	dataset_read_begin(d);
	change_submit(c, change_run, change_done);
}

void dataset_change_start(struct dataset_change *c)
{
	struct dataset *d = c->dataset;
	struct dataset_change **at;
	struct datasets *ds = d->datasets;

	THREAD_LOOP_ONLY();
	c->datasets = ds;
	c->err = ERR_INIT;
	if (ds->core->stopping)
		err_set(&c->err, ERR_BUSY, "the daemon is stopping");
	else if (!d->generation)
		err_set(&c->err, ERR_NOTFOUND, "the dataset %s has no generation yet", d->name);
	if (c->err.code) {
		c->done(c, &c->err);
		return;
	}
	dataset_hold(d);
	ds->core->background++;
	for (at = &ds->changes; *at; at = &(*at)->next)
		;
	*at = c;
	dataset_changes_settle(ds);
}

void dataset_changes_settle(struct datasets *ds)
{
	struct dataset_change **at = &ds->changes, *c;

	THREAD_LOOP_ONLY();
	while ((c = *at)) {
		if (c->dataset->committer) {
			at = &c->next;
			continue;
		}
		*at = c->next;
		change_begin(c);
		at = &ds->changes;
	}
}
