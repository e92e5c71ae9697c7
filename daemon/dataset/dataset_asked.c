/*
 * Line sets of earlier generations, made again for runs that read these.
 *
 * The model: only the newest generation is sure to have a line set (dataset_prune.c). A run that opens another one, and finds
 * none, asks for it and waits. A change makes it (dataset_lines.c) and puts it into the next manifest, which has no new
 * generation. Others that ask for the same wait with it. It is made also if nobody waits any more. There may be no need when its
 * turn comes.
 */
#include <stdlib.h>

#include "dataset_change.h"
#include "dataset_lines.h"

struct asked {
	struct dataset_change change;
	struct dataset_lines lines;
	struct asked *next; /* in datasets.asked */
	uint64_t generation;
	bool there; /* it needs nothing */
	struct dataset_lines_wait *waits;
};

static struct asked *of_lines(struct dataset_lines *l)
{
	return (struct asked *)((char *)l - offsetof(struct asked, lines));
}

/* ---- worker ---- */

static int asked_make(struct dataset_change *c, const struct grid_manifest *base, struct grid_manifest *m, struct err *err)
{
	struct asked *a = (struct asked *)c;

	if (a->generation < grid_manifest_oldest(base))
		return err_set(err, ERR_NOTFOUND, "generation %llu of %s was pruned", (unsigned long long)a->generation,
			       c->dataset->name);
	a->there = !grid_manifest_lacks_line_set(base, a->generation);
	if (a->there)
		return err_set(err, ERR_BUSY, "there is a line set");
	return dataset_lines_put_at(&a->lines, m, a->generation, err);
}

static void asked_undo(struct dataset_change *c)
{
	dataset_lines_undo(&((struct asked *)c)->lines);
}

/* ---- loop ---- */

static void asked_finish(struct asked *a, const struct err *why)
{
	struct dataset *d = a->lines.dataset;
	struct dataset_lines_wait *w;
	struct asked **at;

	for (at = &d->datasets->asked; *at != a; at = &(*at)->next)
		;
	*at = a->next;
	d->asks--;
	dataset_lines_end(&a->lines, !why);
	if (!why)
		log_debug("%s: the line set of generation %llu is there again", d->name, (unsigned long long)a->generation);
	while ((w = a->waits)) {
		a->waits = w->next;
		w->of = NULL;
		w->done(w, why);
	}
	uncharge(d->datasets->core, sizeof *a);
	free(a);
	dataset_release(d);
}

static void asked_done(struct dataset_change *c, const struct err *why)
{
	struct asked *a = (struct asked *)c;

	if (why && dataset_lines_lacks(&a->lines))
		dataset_lines_wait(&a->lines);
	else
		asked_finish(a, a->there ? NULL : why);
}

static void asked_start(struct asked *a)
{
	a->change = (struct dataset_change){
		.dataset = a->lines.dataset,
		.peer = a->lines.peer,
		.make = asked_make,
		.undo = asked_undo,
		.done = asked_done,
		.lengthy = a->lines.have > 0,
	};
	dataset_change_start(&a->change);
}

static void lines_ready(struct dataset_lines *l, const struct err *why)
{
	if (why)
		asked_finish(of_lines(l), why);
	else
		asked_start(of_lines(l));
}

static struct asked *asked_new(struct dataset *d, uint64_t generation, const struct peer *peer, struct err *err)
{
	struct datasets *ds = d->datasets;
	struct asked *a;

	if (charge(ds->core, sizeof *a, "a line set", err))
		return NULL;
	a = calloc(1, sizeof *a);
	if (!a) {
		uncharge(ds->core, sizeof *a);
		err_set(err, ERR_NOMEM, "no memory for a request");
		return NULL;
	}
	a->lines.dataset = dataset_hold(d);
	a->lines.peer = rights_without_groups(peer);
	a->lines.what = "the line set of an earlier generation";
	a->lines.ready = lines_ready;
	a->generation = generation;
	a->next = ds->asked;
	ds->asked = a;
	d->asks++;
	return a;
}

int dataset_ask_lines(struct dataset *d, uint64_t generation, const struct peer *peer, struct dataset_lines_wait *w,
		      struct err *err)
{
	struct asked *a;
	bool starts;

	THREAD_LOOP_ONLY();
	for (a = d->datasets->asked; a && (a->lines.dataset != d || a->generation != generation); a = a->next)
		;
	starts = !a;
	if (starts && !(a = asked_new(d, generation, peer, err)))
		return -(int)err->code;
	w->of = a;
	w->next = a->waits;
	a->waits = w;
	if (starts)
		asked_start(a);
	return 0;
}

void dataset_ask_end(struct dataset_lines_wait *w)
{
	struct dataset_lines_wait **at;

	THREAD_LOOP_ONLY();
	if (!w->of)
		return;
	for (at = &w->of->waits; *at != w; at = &(*at)->next)
		;
	*at = w->next;
	w->of = NULL;
}
