/* All datasets: the list, its turns in the loop, and its disk accounts. */
#include <stdlib.h>

#include "dataset_priv.h"
#include "dataset_rewrite.h"
#include "log.h"

uint64_t datasets_points_bytes(uint64_t points)
{
	/* 16 bytes a point, a twelfth more for tables and index, and pages that are not full. */
	const uint64_t most = UINT64_MAX / 64;

	points = points < most ? points : most;
	return points * 16 + points * 16 / 12 + (64 << 10);
}

void datasets_count(struct datasets *ds)
{
	uint64_t bytes[SPACE_KINDS] = {0};
	const struct dataset *d;
	const struct pending *q;

	for (d = ds->first; d; d = d->next) {
		bytes[d->onestep ? SPACE_ONESTEP : d->removed_us ? SPACE_REMOVED : SPACE_DATASETS] += d->bytes;
		for (q = d->pending; q; q = q->next)
			bytes[SPACE_PENDING] += q->bytes;
	}
	space_set_counted(ds->core->space, SPACE_DATASETS, bytes[SPACE_DATASETS]);
	space_set_counted(ds->core->space, SPACE_REMOVED, bytes[SPACE_REMOVED]);
	space_set_counted(ds->core->space, SPACE_ONESTEP, bytes[SPACE_ONESTEP]);
	space_set_counted(ds->core->space, SPACE_PENDING, bytes[SPACE_PENDING]);
	limit_recount(ds->core);
}

/* Bytes on the disk of each user (struct core_usage). */
static void used_bytes(void *ctx, core_usage_fn *add, void *to)
{
	for (const struct dataset *d = ((struct datasets *)ctx)->first; d; d = d->next) {
		add(to, d->uid, d->bytes, false);
		for (const struct pending *q = d->pending; q; q = q->next)
			add(to, q->uid, q->bytes, true);
	}
}

int datasets_new(struct core *core, struct admission *admission, struct datasets **ret, struct err *err)
{
	struct datasets *ds = calloc(1, sizeof *ds);

	if (!ds)
		return err_set(err, ERR_NOMEM, "no memory for the daemon");
	ds->core = core;
	ds->admission = admission;
	core->usage = (struct core_usage){ds, used_bytes};
	*ret = ds;
	return 0;
}

struct datasets *datasets_free(struct datasets *ds)
{
	struct dataset *d;

	if (!ds)
		return NULL;
	dataset_obsolete_free_all(ds);
	while ((d = ds->first)) {
		ds->first = d->next;
		dataset_free(d);
	}
	free(ds->loaded);
	free(ds);
	return NULL;
}

void datasets_set_calls(struct datasets *ds, const struct datasets_calls *calls, void *ctx)
{
	ds->calls = calls;
	ds->ctx = ctx;
}

struct dataset *datasets_first(const struct datasets *ds)
{
	return ds->first;
}

void dataset_left(struct dataset *d, const struct err *why)
{
	atomic_store(&d->left, true);
	log_event_err(LOG_EVENT_LEFTOVER, NULL, "files of a dataset that nothing names stay until the next start", why);
}

void dataset_drop_row(struct dataset *d, uint64_t push)
{
	struct datasets *ds = d->datasets;
	struct err err = ERR_INIT;

	/* One row suffices. */
	if (atomic_exchange(&d->left, false))
		return;
	if (catalogue_drop_push(ds->core->p.catalogue, push, NULL, NULL, &err))
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, NULL, "the catalogue", &err);
}

void datasets_settle(struct datasets *ds)
{
	THREAD_LOOP_ONLY();
	dataset_sets_settle(ds);
	dataset_prune_settle(ds);
	dataset_merge_settle(ds);
	dataset_lines_settle(ds);
	dataset_changes_settle(ds);
	dataset_actions_settle(ds);
	dataset_obsolete_settle(ds);
}

void datasets_tick(struct datasets *ds)
{
	THREAD_LOOP_ONLY();
	datasets_expire_tick(ds);
	dataset_prune_tick(ds);
	if (ds->merge)
		dataset_rewrite_tick(ds->merge);
}

void datasets_park(struct datasets *ds)
{
	THREAD_LOOP_ONLY();
	dataset_prunes_park(ds);
	if (ds->merge)
		dataset_rewrite_cancel(ds->merge);
}
