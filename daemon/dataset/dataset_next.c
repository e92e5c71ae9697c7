/*
 * The state of a dataset after its next manifest.
 *
 * The model: a commit has two halves. All that can fail comes first: texts are copied, sums are made, the row is queued
 * (dataset_next_make, dataset_next_put). When the row is durable, the dataset takes over the new state (dataset_next_install),
 * and nothing of that can fail.
 */
#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dataset_priv.h"

/* The box of all segments, and the bytes of all files. */
static void sum_segments(struct dataset_next *n, const struct grid_manifest *m)
{
	bool any = false;

	n->bytes = grid_manifest_bytes(m);
	for (size_t i = 0; i < m->nsegments; i++) {
		const struct grid_segment_info *s = &m->segments[i];

		if (!s->points)
			continue;
		for (int k = 0; k < 4; k++)
			if (!any || (k < 2 ? s->box[k] < n->box[k] : s->box[k] > n->box[k]))
				n->box[k] = s->box[k];
		any = true;
	}
}

static void sum_sources(struct dataset_next *n, const struct grid_manifest *m)
{
	for (size_t i = 0; i < m->nsources; i++) {
		const struct grid_source *s = &m->sources[i];

		n->sets_due |= s->kind == GRID_LINE_VERTICES && s->removed == m->generation;

		if (!s->removed && s->kind != GRID_LINE_VERTICES) {
			n->points += s->points;
			n->files++;
		}
		if (s->id >= n->next_source)
			n->next_source = s->id + 1;
	}
}

int dataset_next_make(const struct dataset *d, const struct grid_manifest *m, const struct grid_apart *apart,
		      const char *manifest, int64_t pushed_us, struct dataset_next *ret, struct err *err)
{
	unsigned dropped = apart ? apart->ndropped : 0;
	struct dataset_next n = {
		.generation = m->generation,
		.oldest = grid_manifest_oldest(m),
		.segments = (uint32_t)m->nsegments,
		.merge_due = !d->onestep && merge_due(m),
		.pushed_us = pushed_us,
	};
	char lattice[LATTICE_TEXT_SIZE];

	memcpy(n.box, d->box, sizeof n.box);
	snprintf(n.manifest, sizeof n.manifest, "%s", manifest);
	sum_segments(&n, m);
	sum_sources(&n, m);
	lattice_text(&m->lattice, lattice);
	n.lattice = strdup(lattice);
	n.crs = strdup(m->crs);
	n.unit_xy = strdup(m->unit_xy);
	n.unit_z = strdup(m->unit_z);
	n.obsolete = dataset_obsolete_new(1 + dropped);
	if (n.obsolete && *d->manifest)
		dataset_obsolete_add(n.obsolete, d->manifest);
	for (unsigned i = 0; n.obsolete && i < dropped; i++)
		dataset_obsolete_add(n.obsolete, apart->dropped[i]);
	if (n.lattice && n.crs && n.unit_xy && n.unit_z && n.obsolete) {
		*ret = n;
		return 0;
	}
	dataset_next_clear(&n);
	return err_set(err, ERR_NOMEM, "no memory for a dataset");
}

void dataset_next_clear(struct dataset_next *n)
{
	free(n->lattice);
	free(n->crs);
	free(n->unit_xy);
	free(n->unit_z);
	dataset_obsolete_free(n->obsolete);
	*n = (struct dataset_next){0};
}

int dataset_next_put(struct dataset *d, const struct dataset_next *n, uint64_t push, catalogue_done_fn done, void *ctx,
		     struct err *err)
{
	struct catalogue_dataset row;
	int r;

	THREAD_LOOP_ONLY();
	assert(!*n->manifest == !n->generation);
	dataset_row(d, &row);
	row.pushed_us = n->pushed_us;
	row.manifest = n->manifest;
	row.generation = n->generation;
	row.points = n->points;
	row.bytes = n->bytes;
	row.files = n->files;
	row.lattice = n->lattice;
	row.crs = n->crs;
	row.unit_xy = n->unit_xy;
	row.unit_z = n->unit_z;
	row.oldest = n->oldest;
	row.segments = n->segments;
	memcpy(row.box, n->box, sizeof row.box);
	r = catalogue_put_dataset(d->datasets->core->p.catalogue, &row, push, done, ctx, err);
	d->rows_queued += !r;
	return r;
}

static void move_text(char **to, char **from)
{
	free(*to);
	*to = *from;
	*from = NULL;
}

void dataset_next_install(struct dataset *d, struct dataset_next *n, bool old_in_use)
{
	THREAD_LOOP_ONLY();
	assert(*n->manifest && n->generation >= d->generation);
	move_text(&d->lattice, &n->lattice);
	move_text(&d->crs, &n->crs);
	move_text(&d->unit_xy, &n->unit_xy);
	move_text(&d->unit_z, &n->unit_z);
	memcpy(d->manifest, n->manifest, sizeof d->manifest);
	memcpy(d->box, n->box, sizeof d->box);
	d->oldest = n->oldest;
	d->points = n->points;
	d->bytes = n->bytes;
	d->files = n->files;
	d->segments = n->segments;
	d->pushed_us = n->pushed_us;
	d->merge_due = n->merge_due;
	d->datasets->merges_due |= n->merge_due;
	/* Generations are made once; line sets that were asked for since stay until the next one with other lines. */
	d->sets_due |= n->sets_due && n->generation > d->generation && !d->onestep;
	d->datasets->sets_due |= d->sets_due;
	d->generation = n->generation;
	if (n->next_source > d->next_source)
		d->next_source = n->next_source;
	if (old_in_use) {
		dataset_obsolete_queue(n->obsolete, d, 0);
		n->obsolete = NULL;
	}
	dataset_next_clear(n);
}
