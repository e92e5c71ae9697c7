/*
 * The special cases of the run of a window.
 *
 * Its domains are the pieces of the window (window_area.c), which engine/pipe makes when the view has one. Pieces are not stored:
 * making one again costs no more than reading it, and other runs do not need it. The order of its triangles depends on the cells
 * of the segments, so a merge ends its stream.
 */
#include "run_priv.h"

void run_area_id(const struct run *w, struct digest *id)
{
	const struct grid_manifest *m = grid_manifest(w->grid);
	/* A window that was fetched of a job has no kept plan: the number of threads decides its pieces. */
	const uint32_t budget[3] = {w->budget.load, w->budget.cap, w->file ? 0 : w->budget.threads};

	if (!w->view.window)
		return;
	digest_add(id, digest_hash(budget, sizeof budget));
	for (size_t i = 0; i < m->nsegments; i++) {
		const uint64_t segment[4] = {i, m->segments[i].points, m->segments[i].sum.hi, m->segments[i].sum.lo};

		digest_add(id, digest_hash(segment, sizeof segment));
	}
}
