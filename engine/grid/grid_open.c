/*
 * Opens a manifest for reading one generation (grid.h). A record is live if its source was added in that generation or
 * before and was not removed by then. This is decided once for each source, here. Later only the cache of index pages
 * changes.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_priv.h"
#include "io.h"
#include "ledger.h"
#include "order.h"

static const struct grid_liveness *find_source(const struct grid *g, uint32_t source)
{
	struct grid_liveness key = {.id = source};

	if (!g->manifest->nsources)
		return NULL;
	return bsearch(&key, g->sources, g->manifest->nsources, sizeof key, order_u32);
}

bool grid_live(const struct grid *g, uint32_t source)
{
	const struct grid_liveness *s = find_source(g, source);

	return s && s->live;
}

uint8_t grid_slot(const struct grid *g, uint32_t source)
{
	const struct grid_liveness *s = g->slots ? find_source(g, source) : NULL;

	return s ? s->slot : 0;
}

struct digest grid_slot_sum(struct digest sum, uint8_t slot)
{
	/* Odd, so that no bit is lost; their differences are as good as random. */
	const uint64_t factor = slot ? slot * UINT64_C(0x9e3779b97f4a7c15) | 1 : 1;

	return (struct digest){sum.hi * factor, sum.lo * factor};
}

static void add_live(struct grid *g, struct grid_live *l, const struct disk_total *t)
{
	const struct digest sum = {t->sum_hi, t->sum_lo};
	uint8_t slot = grid_slot(g, t->id);

	l->points += t->points;
	digest_add(&l->sum, sum);
	digest_add(&l->content, grid_slot_sum(sum, slot));
	l->slots |= UINT32_C(1) << slot;
	l->slot = slot;
	if (!slot)
		return;
	l->slotted += t->points;
	digest_add(&g->slot_sum[slot - 1], sum);
}

/* Reads the sources of a segment, to find whether all, some or none of its records are live. */
static int read_sources(struct grid *g, uint32_t segment, const struct disk_segment *h, struct err *err)
{
	const struct grid_segment *p = &g->segments[segment];
	struct grid_live *l = &g->live[segment];
	size_t bytes = h->sources * sizeof(struct disk_total);
	struct disk_total *totals = NULL;
	int rc;

	if (g->ledger && !ledger_take(g->ledger, LEDGER_INDEX, bytes))
		return err_set(err, ERR_BUSY, "no %zu bytes are free for a table of %u sources", bytes, h->sources);
	rc = grid_segment_sources(p, h, &totals, err);
	l->all = l->none = true;
	for (uint32_t i = 0; rc == 0 && i < h->sources; i++) {
		bool live = grid_live(g, totals[i].id);

		if (!find_source(g, totals[i].id))
			rc = grid_segment_damaged(p, h->sources_place, "one of its sources is not in the manifest", err);
		if (live)
			add_live(g, l, &totals[i]);
		l->all = l->all && live;
		l->none = l->none && !live;
	}
	free(totals);
	if (g->ledger)
		ledger_give(g->ledger, LEDGER_INDEX, bytes);
	return rc;
}

static int open_segment(struct grid *g, int dirfd, uint32_t i, struct err *err)
{
	const struct grid_segment_info *info = &g->manifest->segments[i];
	struct grid_segment *p = &g->segments[i];
	struct disk_segment h;
	int rc = grid_segment_open(p, dirfd, info, &h, err);

	if (rc)
		return rc;
	rc = read_sources(g, i, &h, err);
	if (rc)
		return rc;
	if (p->height > g->height)
		g->height = p->height;
	grid_files_add(g->files, i);
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

/* Opens the file of the lines of the generation. At most a quarter of the memory is for its pages. */
static int open_lines(struct grid *g, int dirfd, const struct grid_use *use, size_t index_memory, struct err *err)
{
	const struct grid_source *s = use->no_lines ? NULL : grid_manifest_line_vertices(g->manifest, g->generation);
	struct grid_named file[GRID_SOURCE_FILES];

	if (!s && !use->no_lines && !use->lines && grid_manifest_lacks_line_set(g->manifest, g->generation))
		return GRID_E_NO_LINE_SET;
	if (!s)
		return 0;
	g->line_source = s->id;
	g->marks = !use->lines;
	g->clear = use->clear;
	if (use->lines)
		return lineset_open(use->linesfd, use->lines, g->ledger, index_memory / 4, &g->lines, err);
	g->folder = io->openat(dirfd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC, 0);
	if (g->folder < 0)
		return err_sys(err, errno, "cannot open the folder of a dataset");
	grid_source_files(s, file);
	return lineset_open(dirfd, file[0].name, g->ledger, index_memory / 4, &g->lines, err);
}

/* What the lines take of that memory. */
static size_t lines_memory(const struct grid *g, size_t index_memory)
{
	uint64_t bytes = g->lines ? lineset_charged(g->lines) : 0;

	return bytes < index_memory ? bytes : index_memory;
}

/* Charges the tables and as many frames as index_memory has room for, but no more than the index has pages. */
static int charge(struct grid *g, size_t index_memory, size_t *ret_frames, struct err *err)
{
	const struct grid_manifest *m = g->manifest;
	uint64_t pages = 0, frames = index_memory / (grid_cache_bytes(1) - grid_cache_bytes(0));

	for (size_t i = 0; i < m->nsegments; i++)
		pages += page_count(m->segments[i].cells);
	frames = frames < pages ? frames : pages;
	/* Sorting the sources may double them for a while. */
	uint64_t bytes = sizeof *g + m->nsegments * (sizeof *g->segments + sizeof *g->live) + grid_files_bytes(m->nsegments) +
			 grid_order_bytes(m->nsegments) + 2 * m->nsources * sizeof *g->sources + grid_cache_bytes(frames) +
			 SLOTS_MOST * sizeof *g->slot_sum;

	if (g->ledger && !ledger_take(g->ledger, LEDGER_INDEX, bytes)) {
		err_set(err, ERR_BUSY, "no %llu bytes are free for the index of the dataset", (unsigned long long)bytes);
		return err_add_hint(err, "try again when other jobs are done, or give acutd more memory");
	}
	g->charged = bytes;
	*ret_frames = frames;
	return 0;
}

static int fill_sources(struct grid *g, int dirfd, uint64_t generation, const struct grid_use *use, struct err *err)
{
	const struct grid_manifest *m = g->manifest;

	g->sources = calloc(m->nsources ? m->nsources : 1, sizeof *g->sources);
	g->segments = calloc(m->nsegments ? m->nsegments : 1, sizeof *g->segments);
	g->live = calloc(m->nsegments ? m->nsegments : 1, sizeof *g->live);
	g->slots = use->slots != NULL;
	if (g->slots)
		g->slot_sum = calloc(SLOTS_MOST, sizeof *g->slot_sum);
	if (!g->sources || !g->segments || !g->live || (g->slots && !g->slot_sum))
		return err_set(err, ERR_NOMEM, "no memory for %zu sources and %zu segments", m->nsources, m->nsegments);
	g->files = grid_files_new(dirfd, g->segments, m->nsegments, err);
	if (!g->files)
		return -(int)err->code;
	for (size_t i = 0; i < m->nsources; i++) {
		const struct grid_source *s = &m->sources[i];

		g->sources[i].id = s->id;
		g->sources[i].live = grid_source_live(s, generation) && !(use->no_lines && s->kind == GRID_LINE_VERTICES);
		g->sources[i].slot = use->slots && s->kind == GRID_POINTS ? slots_of(use->slots, s->id) : 0;
	}
	if (m->nsources)
		qsort(g->sources, m->nsources, sizeof *g->sources, order_u32);
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
	return grid_open_use(dirfd, manifest, generation, NULL, ledger, index_memory, ret, err);
}

int grid_open_use(int dirfd, const char *manifest, uint64_t generation, const struct grid_use *use, struct ledger *ledger,
		  size_t index_memory, struct grid **ret, struct err *err)
{
	static const struct grid_use usual;
	struct grid *g = calloc(1, sizeof *g);
	size_t frames = 0;

	use = use ? use : &usual;
	if (!g)
		return err_set(err, ERR_NOMEM, "no memory to open %s", manifest);
	int rc = grid_manifest_load(dirfd, manifest, ledger, &g->manifest, err);

	if (rc) {
		free(g);
		return rc;
	}
	g->ledger = ledger;
	g->folder = -1;
	if (generation == GRID_NEWEST)
		generation = g->manifest->generation;
	g->generation = generation;
	rc = check_generation(g, manifest, err);
	if (rc == 0)
		rc = open_lines(g, dirfd, use, index_memory, err);
	if (rc == 0)
		rc = charge(g, index_memory - lines_memory(g, index_memory), &frames, err);
	if (rc == 0)
		rc = fill_sources(g, dirfd, generation, use, err);
	for (uint32_t i = 0; rc == 0 && i < g->manifest->nsegments; i++)
		rc = open_segment(g, dirfd, i, err);
	if (rc == 0)
		rc = grid_order_make(g, err);
	if (rc == 0 && !(g->cache = grid_cache_new(frames)))
		rc = err_set(err, ERR_NOMEM, "no memory for %zu pages of the index", frames);
	if (rc) {
		grid_close(g);
		return rc;
	}
	*ret = g;
	return 0;
}

bool grid_reopens(const struct grid *g)
{
	return g->manifest->nsegments > GRID_FILES_OPEN;
}

int grid_folder(const struct grid *g)
{
	return g->folder;
}

uint64_t grid_generation(const struct grid *g)
{
	return g->generation;
}

struct ledger *grid_ledger(const struct grid *g)
{
	return g->ledger;
}

struct lineset *grid_lines(const struct grid *g)
{
	return g->lines;
}

const struct grid_source *grid_lines_source(const struct grid *g)
{
	return g->lines ? grid_manifest_line_vertices(g->manifest, g->generation) : NULL;
}

struct digest grid_lines_content(const struct grid *g)
{
	return g->lines ? lineset_info(g->lines)->content : (struct digest){0, 0};
}

uint64_t grid_charged(const struct grid *g)
{
	return g->charged + (g->lines ? lineset_charged(g->lines) : 0);
}

struct grid *grid_close(struct grid *g)
{
	if (!g)
		return NULL;
	grid_files_free(g->files);
	grid_order_free(&g->order);
	grid_cache_free(g->cache);
	io_close(g->folder);
	lineset_close(g->lines);
	if (g->charged && g->ledger)
		ledger_give(g->ledger, LEDGER_INDEX, g->charged);
	grid_manifest_free(g->manifest);
	free(g->segments);
	free(g->live);
	free(g->sources);
	free(g->slot_sum);
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
		points += g->live[i].points;
	return points;
}

bool grid_all_live(const struct grid *g)
{
	bool all = true;

	for (size_t i = 0; i < g->manifest->nsegments; i++)
		all = all && (g->live[i].all || g->live[i].none);
	return all;
}

struct digest grid_content(const struct grid *g)
{
	struct digest sum = {0, 0};
	uint64_t points = grid_points(g);

	for (size_t i = 0; i < g->manifest->nsegments; i++)
		digest_add(&sum, g->live[i].sum);
	digest_add(&sum, digest_hash(&points, sizeof points));
	if (g->lines)
		digest_add(&sum, grid_lines_content(g));
	if (g->slots)
		digest_add(&sum, digest_hash(g->slot_sum, SLOTS_MOST * sizeof *g->slot_sum));
	return digest_hash(&sum, sizeof sum);
}

uint64_t grid_segment_points(const struct grid *g, size_t segment)
{
	return g->live[segment].points;
}

uint32_t grid_segment_slots(const struct grid *g, size_t segment)
{
	return g->live[segment].slots;
}

uint8_t grid_source_slot(const struct grid *g, uint32_t source)
{
	return grid_slot(g, source);
}

uint64_t grid_segment_slotted(const struct grid *g, size_t segment)
{
	return g->live[segment].slotted;
}

struct digest grid_segment_content(const struct grid *g, size_t segment)
{
	return g->live[segment].content;
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
		point_box_join(box, s->box);
	}
	if (any)
		memcpy(ret_box, box, sizeof box);
	return any;
}
