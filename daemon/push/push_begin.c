/*
 * The beginning of a push: what the dataset is already, and what an interrupted push of the same user has left of
 * it; then its row in the catalogue, so that whatever it writes is known to the next start. Nobody waits for the row: it comes to
 * the disk while headers are read, and points into memory. What writes comes after it (push_pump, push_row_wait).
 */
#include <stdio.h>
#include <string.h>

#include "clock.h"
#include "push_priv.h"

int push_begin_start(struct push *p, struct push_ask *a, struct err *err)
{
	const struct push *other;

	/* One that was just interrupted is taken up when it lies there. */
	for (other = p->pushes->first; other; other = other->next)
		if (other != p && other->dataset == p->dataset && other->left && other->peer.uid == p->peer.uid)
			return PUSH_WAIT;
	memcpy(p->base_name, p->dataset->manifest, sizeof p->base_name);
	if (!p->reads)
		dataset_read_begin(p->dataset);
	p->reads = true;
	if (!p->claims)
		push_claim(p);
	return 0;
}

/* No memory for a manifest now: from the start, later. */
static void undo(struct push *p)
{
	names_free(&p->base_paths);
	p->base = grid_manifest_free(p->base);
	if (p->opened)
		dataset_close(p->dataset);
	p->opened = false;
}

void push_begin_run(struct push *p, struct push_ask *a)
{
	a->err = ERR_INIT;
	a->r = dataset_open(p->dataset, &a->err);
	p->opened = !a->r;
	if (!a->r && *p->base_name)
		a->r = grid_manifest_load(p->dataset->dirfd, p->base_name, p->pushes->core->p.ledger, &p->base, &a->err);
	if (!a->r)
		a->r = push_plane_begin(p, &a->err);
	if (!a->r && p->base)
		a->r = push_known_index(p->base, &p->base_paths, &a->err);
	if (!a->r)
		a->r = push_adopt(p, &a->err);
	if (a->r == -ERR_BUSY)
		undo(p);
}

static void answer(struct push *p, const struct err *why)
{
	struct push_begun begun = {.push = p, .id = p->id, .lattice = "", .note = p->note};
	char lattice[LATTICE_TEXT_SIZE];
	const struct push_calls calls = p->calls;
	const struct err copy = why ? *why : ERR_INIT; /* it may be of the ask, which goes first */
	void *token = p->asks->token;

	if (p->has_lattice)
		begun.lattice = lattice_text(&p->lattice, lattice);
	push_ask_over(p);
	if (why)
		push_leave(p);
	calls.begun(token, why ? &copy : NULL, why ? NULL : &begun);
}

static void row_done(void *ctx, int r, const struct err *why)
{
	struct push *p = ctx;

	push_guard_lock(&p->row_guard);
	p->row_comes = false;
	p->row = !r;
	if (r && !p->left)
		push_break(p, why);
	push_guard_wake(&p->row_guard);
	push_guard_unlock(&p->row_guard);
	push_pump(p);
}

int push_row_wait(void *push, struct err *err)
{
	struct push *p = push;
	int r;

	push_guard_lock(&p->row_guard);
	while (p->row_comes && !atomic_load(&p->cancel)) {
		p->row_awaited = true;
		push_guard_wait(&p->row_guard);
	}
	/* Who leaves when it is there writes what is to stay. */
	if (!p->row_comes && (p->row || p->dataset->onestep))
		r = 0;
	else if (!p->row_comes && p->broken)
		r = -(int)(*err = p->broken_err).code;
	else
		r = err_set(err, ERR_CANCELLED, "the push was ended");
	push_guard_unlock(&p->row_guard);
	return r;
}

void push_row_wake(struct push *p)
{
	push_guard_lock(&p->row_guard);
	push_guard_wake(&p->row_guard);
	push_guard_unlock(&p->row_guard);
}

static int settle_base(struct push *p, struct err *err)
{
	const struct grid_manifest *m = p->base;
	size_t i;

	p->has_lattice = true;
	p->lattice = m->lattice;
	p->base_generation = m->generation;
	push_crs_of_dataset(p, m->crs, m->unit_xy, m->unit_z);
	for (i = 0; i < m->nsources; i++)
		dataset_sources_from(p->dataset, m->sources[i].id + 1);
	if (*p->scale_xy || *p->scale_z) {
		struct decimal d;

		if ((*p->scale_xy && (!decimal_parse(p->scale_xy, &d) || decimal_compare(d, m->lattice.scale_xy))) ||
		    (*p->scale_z && (!decimal_parse(p->scale_z, &d) || decimal_compare(d, m->lattice.scale_z)))) {
			err_set(err, ERR_USAGE, "the dataset %s has another scale", p->dataset->name);
			return err_add_hint(err, "leave the scale out, or push into a new dataset");
		}
	}
	return 0;
}

/* The manifests that the push found, and what the commit makes of them. */
static uint64_t manifest_bytes(const struct push *p)
{
	const struct grid_manifest *all[] = {p->base, p->adopt};
	uint64_t bytes = names_bytes(&p->base_paths) + names_bytes(&p->adopt_paths);

	for (int i = 0; i < 2; i++)
		if (all[i])
			bytes += 4 * (all[i]->nsources * sizeof *all[i]->sources + all[i]->texts_bytes +
				      all[i]->nsegments * sizeof *all[i]->segments);
	return bytes;
}

/* Once: what was there is the push's own from here on. */
static int settle(struct push *p, const struct err *why, struct err *err)
{
	if (!why)
		push_adopted(p);
	push_unclaim(p);
	if (dataset_created(p->dataset))
		snprintf(p->plane.created, sizeof p->plane.created, "%s", p->dataset->crs);
	p->settled = true;
	if (!why && p->base && settle_base(p, err))
		return -(int)err->code;
	return why ? 0 : push_created_scale(p, err);
}

bool push_begin_done(struct push *p, struct push_ask *a, const struct err *why)
{
	struct err err = ERR_INIT;
	struct catalogue_push row = {
		.dataset = p->dataset->id,
		.uid = p->peer.uid,
		.begun_us = clock_real_us(),
	};
	int r = 0;

	if (p->reads)
		dataset_read_end(p->dataset);
	p->reads = false;
	if (why && why->code == ERR_BUSY && p->task.ran && !p->left && !push_waits_in_vain(p)) {
		p->lacks = p->again = true;
		return false;
	}
	if (!p->settled)
		r = settle(p, why, &err);
	if (!why && !r)
		r = push_room(p, manifest_bytes(p), &err);
	p->lacks = r == PUSH_WAIT;
	if (p->lacks)
		return false;
	if (!why && r)
		why = &err;
	if (!why && !p->dataset->onestep) {
		row.id = p->id;
		p->row_comes = true;
		if (dataset_put_row(p->dataset, &err) ||
		    catalogue_put_push(p->pushes->core->p.catalogue, &row, row_done, p, &err)) {
			p->row_comes = false;
			why = &err;
		}
	}
	answer(p, why);
	return false;
}
