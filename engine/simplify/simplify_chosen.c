/* The grid of the points chosen so far: its segments and manifests. */
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "grid_stage.h"
#include "simplify_priv.h"

char *simplify_name(char name[GRID_NAME_MAX], const char *what, uint64_t a, uint64_t b, uint64_t c)
{
	snprintf(name, GRID_NAME_MAX, "%s-%llu-%llu-%llu", what, (unsigned long long)a, (unsigned long long)b,
		 (unsigned long long)c);
	return name;
}

/* ---- segments ---- */

int simplify_stage_begin(struct simplify_stage *g, const struct simplify *s, const char *name, bool temporary, size_t memory,
			 struct err *err)
{
	const struct grid_stage_params p = {.dirfd = s->p.dirfd, .name = name, .memory = memory, .temporary = temporary};

	memset(g->n, 0, sizeof g->n);
	memset(g->count, 0, sizeof g->count);
	g->stage = NULL;
	return grid_stage_new(&p, &g->stage, err);
}

static int flush(struct simplify_stage *g, unsigned kind, struct err *err)
{
	static const uint32_t source[2] = {SIMPLIFY_POINTS, SIMPLIFY_LINES};
	size_t n = g->n[kind];
	int r;

	g->n[kind] = 0;
	g->count[kind] += n;
	if (!n)
		return 0;
	r = grid_stage_source(g->stage, source[kind], err);
	return r ? r : grid_stage_add(g->stage, g->batch[kind], n, err);
}

int simplify_stage_add(struct simplify_stage *g, const struct point *p, struct err *err)
{
	unsigned kind = (p->tag & POINT_LINE) != 0;
	struct point *to = &g->batch[kind][g->n[kind]++];

	*to = *p;
	to->tag &= POINT_FLAGS;
	return g->n[kind] == SIMPLIFY_BATCH ? flush(g, kind, err) : 0;
}

int simplify_stage_end(struct simplify_stage *g, struct grid_segment_info *ret, struct err *err)
{
	int r = flush(g, 0, err);

	if (!r)
		r = flush(g, 1, err);
	/* Even without a point it has a source. */
	if (!r && !g->count[0])
		r = grid_stage_source(g->stage, SIMPLIFY_POINTS, err);
	if (!r)
		r = grid_stage_seal(g->stage, ret, err);
	simplify_stage_abort(g);
	return r;
}

void simplify_stage_abort(struct simplify_stage *g)
{
	g->stage = grid_stage_free(g->stage);
}

/* ---- manifests ---- */

int simplify_manifest(const struct simplify *s, const char *name, struct grid_segment_info *segment, size_t n, uint64_t lines,
		      struct err *err)
{
	const struct grid_manifest *from = grid_manifest(s->p.grid);
	const struct grid_source *set = grid_lines_source(s->p.grid);
	struct grid_source source[2] = {
		{.id = SIMPLIFY_POINTS, .added = 1, .name = "simplified"},
		{.id = SIMPLIFY_LINES, .added = 1, .points = lines, .kind = GRID_LINE_VERTICES},
	};
	struct grid_manifest m = {
		.lattice = from->lattice,
		.generation = 1,
		.segments = segment,
		.nsegments = n,
		.sources = source,
		.nsources = lines ? 2 : 1,
	};

	for (size_t i = 0; i < n; i++)
		source[0].points += segment[i].points;
	source[0].points -= lines;
	source[1].lines = set ? set->lines : NULL;
	memcpy(m.crs, from->crs, sizeof m.crs);
	memcpy(m.unit_xy, from->unit_xy, sizeof m.unit_xy);
	memcpy(m.unit_z, from->unit_z, sizeof m.unit_z);
	return grid_manifest_write(s->p.dirfd, name, &m, err);
}

int simplify_grid(const struct simplify *s, const char *name, struct grid **ret, struct err *err)
{
	const struct grid_use use = {.no_lines = !grid_lines(s->p.grid), .lines = s->p.lines, .linesfd = s->p.linesfd};

	return grid_open_use(s->p.dirfd, name, GRID_NEWEST, &use, s->p.ledger, s->p.index_memory, ret, err);
}
