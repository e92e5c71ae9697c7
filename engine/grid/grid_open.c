/*
 * Opening a manifest for reading in one generation (grid.h). A record is live if its source was added in
 * that generation or before and was not removed by then; sources are few, so this is decided here once.
 * Nothing changes afterwards except the cache of index pages.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_read.h"
#include "io.h"
#include "ledger.h"

static int by_id(const void *a, const void *b)
{
	const struct grid_life *x = a, *y = b;

	return x->id < y->id ? -1 : x->id > y->id;
}

static const struct grid_life *life_of(const struct grid *g, uint32_t source)
{
	struct grid_life key = {.id = source};

	if (!g->manifest->nsources)
		return NULL;
	return bsearch(&key, g->lives, g->manifest->nsources, sizeof key, by_id);
}

bool grid_live(const struct grid *g, uint32_t source)
{
	const struct grid_life *life = life_of(g, source);

	return life && life->live;
}

/* Whether there is such a source. */
static bool known(const struct grid *g, uint32_t source)
{
	return life_of(g, source) != NULL;
}

/* Which sources a segment has: whether all, some or none of them are live. */
static int read_sources(const struct grid *g, struct grid_part *p, const struct disk_segment *h, struct err *err)
{
	size_t bytes = h->sources * sizeof(struct disk_total);
	struct disk_total *totals = NULL;
	int rc;

	if (g->ledger && !ledger_take(g->ledger, LEDGER_INDEX, bytes))
		return err_set(err, ERR_BUSY, "no %zu bytes are free for a table of %u sources", bytes, h->sources);
	rc = grid_part_sources(p, h, &totals, err);
	p->all_live = p->none_live = true;
	for (uint32_t i = 0; rc == 0 && i < h->sources; i++) {
		bool live = grid_live(g, totals[i].id);

		if (!known(g, totals[i].id))
			rc = grid_damaged(p, h->sources_place, "the manifest lacks one of its sources", err);
		p->live_points += live ? totals[i].points : 0;
		if (live)
			digest_add(&p->live_sum, (struct digest){totals[i].sum_hi, totals[i].sum_lo});
		p->all_live = p->all_live && live;
		p->none_live = p->none_live && !live;
	}
	free(totals);
	if (g->ledger)
		ledger_give(g->ledger, LEDGER_INDEX, bytes);
	return rc;
}

static int open_part(struct grid *g, int dirfd, size_t i, struct err *err)
{
	const struct grid_segment_info *info = &g->manifest->segments[i];
	struct grid_part *p = &g->parts[i];
	struct disk_segment h;
	int rc = grid_part_open(p, dirfd, info, &h, err);

	if (rc)
		return rc;
	rc = read_sources(g, p, &h, err);
	if (rc)
		return rc;
	if (p->height > g->height)
		g->height = p->height;
	g->active += !p->none_live;
	return 0;
}

/* ---- the whole ---- */

static uint64_t page_count(uint64_t cells)
{
	uint64_t pages = 0;

	while (cells) {
		cells = cells / DISK_ENTRIES + (cells % DISK_ENTRIES != 0);
		pages += cells;
		if (cells == 1)
			break;
	}
	return pages;
}

/* Tables first, then as many frames as index_memory has room for and the index has pages. */
static int charge(struct grid *g, size_t index_memory, size_t *ret_frames, struct err *err)
{
	const struct grid_manifest *m = g->manifest;
	uint64_t pages = 0, frames = index_memory / (grid_cache_bytes(1) - grid_cache_bytes(0));

	for (size_t i = 0; i < m->nsegments; i++)
		pages += page_count(m->segments[i].cells);
	frames = frames < pages ? frames : pages;
	/* Sorting the lives doubles them for a while. */
	uint64_t bytes =
		sizeof *g + m->nsegments * sizeof *g->parts + 2 * m->nsources * sizeof *g->lives + grid_cache_bytes(frames);

	if (g->ledger && !ledger_take(g->ledger, LEDGER_INDEX, bytes)) {
		err_set(err, ERR_BUSY, "no %llu bytes are free for the index of the dataset", (unsigned long long)bytes);
		return err_add_hint(err, "try again when other jobs are done, or give acutd more memory");
	}
	g->charged = bytes;
	*ret_frames = frames;
	return 0;
}

static int fill_lives(struct grid *g, uint64_t generation, struct err *err)
{
	const struct grid_manifest *m = g->manifest;

	g->lives = calloc(m->nsources ? m->nsources : 1, sizeof *g->lives);
	g->parts = calloc(m->nsegments ? m->nsegments : 1, sizeof *g->parts);
	/* Also where the other table is missing: grid_close looks at them. */
	for (size_t i = 0; g->parts && i < m->nsegments; i++)
		g->parts[i].fd = -1;
	if (!g->lives || !g->parts)
		return err_set(err, ERR_NOMEM, "no memory for %zu sources and %zu segments", m->nsources, m->nsegments);
	for (size_t i = 0; i < m->nsources; i++) {
		const struct grid_source *s = &m->sources[i];

		g->lives[i].id = s->id;
		g->lives[i].live = grid_source_live(s, generation);
	}
	if (m->nsources)
		qsort(g->lives, m->nsources, sizeof *g->lives, by_id);
	return 0;
}

static int check_generation(const struct grid *g, const char *manifest, struct err *err)
{
	uint64_t oldest = grid_manifest_oldest(g->manifest), newest = g->manifest->generation;

	if (g->generation > newest)
		err_set(err, ERR_NOTFOUND, "there is no generation %llu yet, the newest is %llu",
			(unsigned long long)g->generation, (unsigned long long)newest);
	else if (g->generation && g->generation < oldest)
		err_set(err, ERR_NOTFOUND, "generation %llu was pruned: %llu to %llu can be read",
			(unsigned long long)g->generation, (unsigned long long)oldest, (unsigned long long)newest);
	else
		return 0;
	return err_add_file(err, manifest);
}

int grid_open(int dirfd, const char *manifest, uint64_t generation, struct ledger *ledger, size_t index_memory, struct grid **ret,
	      struct err *err)
{
	struct grid *g = calloc(1, sizeof *g);
	size_t frames = 0;

	if (!g)
		return err_set(err, ERR_NOMEM, "no memory to open %s", manifest);
	int rc = grid_manifest_load(dirfd, manifest, ledger, &g->manifest, err);

	if (rc) {
		free(g);
		return rc;
	}
	g->ledger = ledger;
	if (generation == GRID_NEWEST)
		generation = g->manifest->generation;
	g->generation = generation;
	rc = check_generation(g, manifest, err);
	if (rc == 0)
		rc = charge(g, index_memory, &frames, err);
	if (rc == 0)
		rc = fill_lives(g, generation, err);
	for (size_t i = 0; rc == 0 && i < g->manifest->nsegments; i++)
		rc = open_part(g, dirfd, i, err);
	if (rc == 0 && !(g->cache = grid_cache_new(frames)))
		rc = err_set(err, ERR_NOMEM, "no memory for %zu pages of the index", frames);
	if (rc) {
		grid_close(g);
		return rc;
	}
	*ret = g;
	return 0;
}

struct ledger *grid_ledger(const struct grid *g)
{
	return g->ledger;
}

uint64_t grid_charged(const struct grid *g)
{
	return g->charged;
}

struct grid *grid_close(struct grid *g)
{
	if (!g)
		return NULL;
	for (size_t i = 0; g->parts && i < g->manifest->nsegments; i++)
		io_close(g->parts[i].fd);
	grid_cache_free(g->cache);
	if (g->charged && g->ledger)
		ledger_give(g->ledger, LEDGER_INDEX, g->charged);
	grid_manifest_free(g->manifest);
	free(g->parts);
	free(g->lives);
	free(g);
	return NULL;
}

const struct grid_manifest *grid_manifest(const struct grid *g)
{
	return g->manifest;
}

uint64_t grid_points(const struct grid *g)
{
	uint64_t points = 0;

	for (size_t i = 0; i < g->manifest->nsegments; i++)
		points += g->parts[i].live_points;
	return points;
}

bool grid_all_live(const struct grid *g)
{
	bool all = true;

	for (size_t i = 0; i < g->manifest->nsegments; i++)
		all = all && (g->parts[i].all_live || g->parts[i].none_live);
	return all;
}

struct digest grid_content(const struct grid *g)
{
	struct digest sum = {0, 0};
	uint64_t points = grid_points(g);

	for (size_t i = 0; i < g->manifest->nsegments; i++)
		digest_add(&sum, g->parts[i].live_sum);
	digest_add(&sum, digest_hash(&points, sizeof points));
	return digest_hash(&sum, sizeof sum);
}

uint64_t grid_segment_points(const struct grid *g, size_t segment)
{
	return g->parts[segment].live_points;
}

struct digest grid_segment_content(const struct grid *g, size_t segment)
{
	return g->parts[segment].live_sum;
}

bool grid_box(const struct grid *g, int32_t ret_box[4])
{
	int32_t box[4] = {INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN};
	bool any = false;

	for (size_t i = 0; i < g->manifest->nsegments; i++) {
		const struct grid_segment_info *s = &g->manifest->segments[i];

		if (!s->points)
			continue;
		any = true;
		box[0] = s->box[0] < box[0] ? s->box[0] : box[0];
		box[1] = s->box[1] < box[1] ? s->box[1] : box[1];
		box[2] = s->box[2] > box[2] ? s->box[2] : box[2];
		box[3] = s->box[3] > box[3] ? s->box[3] : box[3];
	}
	if (any)
		memcpy(ret_box, box, sizeof box);
	return any;
}
