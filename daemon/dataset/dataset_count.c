/* What the lists of datasets and interrupted pushes say of the disk. */
#include "dataset_priv.h"

uint64_t datasets_points_bytes(uint64_t points)
{
	/* 16 bytes a point, and a twelfth for tables and index; of few points pages that are not full. */
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
			bytes[SPACE_PENDING] += datasets_points_bytes(q->points);
	}
	space_set_counted(ds->core->space, SPACE_DATASETS, bytes[SPACE_DATASETS]);
	space_set_counted(ds->core->space, SPACE_REMOVED, bytes[SPACE_REMOVED]);
	space_set_counted(ds->core->space, SPACE_ONESTEP, bytes[SPACE_ONESTEP]);
	space_set_counted(ds->core->space, SPACE_PENDING, bytes[SPACE_PENDING]);
	limit_recount(ds->core);
}
