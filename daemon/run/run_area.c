/*
 * What is different in the run of a window: its domains are the pieces of the window (window_area.c), which engine/pipe
 * makes by itself where the view has one. A piece is not kept in the store: it is made again as fast as it is read,
 * and nobody else would ask for it. In which order its triangles come depends on how cells lie in segments, so the stream
 * of a window is gone when these were merged.
 */
#include "run_priv.h"

void run_area_id(const struct run *w, struct digest *id)
{
	const struct grid_manifest *m = grid_manifest(w->grid);
	const uint32_t budget[2] = {w->budget.load, w->budget.cap};

	if (!w->view.window)
		return;
	/* A window that was fetched of a job has no plan that is kept. */
	digest_add(id, digest_hash(budget, sizeof budget));
	for (size_t i = 0; i < m->nsegments; i++) {
		const uint64_t segment[4] = {i, m->segments[i].points, m->segments[i].sum.hi, m->segments[i].sum.lo};

		digest_add(id, digest_hash(segment, sizeof segment));
	}
}
