/*
 * Opens a manifest for reading one generation (grid.h). A record is live if its source was added in that generation or
 * before and was not removed by then. This is decided once for each batch of sources, here. Later only the cache of index pages
 * changes.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_priv.h"
#include "io.h"
#include "ledger.h"
#include "order.h"

static const struct grid_liveness *find_source(const struct grid *g, uint32_t source)
{
	size_t lo = 0, hi = g->nsources;

	while (lo < hi) {
		size_t mid = lo + (hi - lo) / 2;

		if (g->sources[mid].last < source)
			lo = mid + 1;
		else
			hi = mid;
	}
	return lo < g->nsources && g->sources[lo].first <= source ? &g->sources[lo] : NULL;
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
	struct grid_segment *p = &g->segments[i];
	struct disk_segment h;
	int rc = grid_files_open(g->files, dirfd, p, &p->fd, err);

	if (rc == 0)
		rc = grid_segment_header(p, &g->manifest->segments[i], &h, err);
	if (rc == 0)
		rc = read_sources(g, i, &h, err);
	if (rc == 0)
		grid_files_add(g->files, i);
	return rc;
}

/* ---- segments that are opened late ---- */

/* All of its records are live, as all sources are. */
static void take_live(struct grid *g, uint32_t segment)
{
	const struct grid_segment_info *info = &g->manifest->segments[segment];

	g->live[segment] = (struct grid_live){.points = info->points,
					      .sum = info->sum,
					      .content = info->sum,
					      .all = true,
					      .none = !info->points,
					      .slots = info->points > 0};
}

/* That all of its records are live was concluded from the manifest having all of its sources. */
static int check_sources(const struct grid *g, const struct grid_segment *p, const struct disk_segment *h, struct err *err)
{
	struct disk_total *totals = NULL;
	struct digest sum = {0, 0};
	int rc = grid_segment_sources(p, h, &totals, err);

	for (uint32_t i = 0; rc == 0 && i < h->sources; i++) {
		if (!find_source(g, totals[i].id))
			rc = grid_segment_damaged(p, h->sources_place, "one of its sources is not in the manifest", err);
		digest_add(&sum, (struct digest){totals[i].sum_hi, totals[i].sum_lo});
	}
	if (rc == 0 && (sum.hi != h->sum_hi || sum.lo != h->sum_lo))
		rc = grid_segment_damaged(p, h->sources_place, "its table of sources does not add up", err);
	free(totals);
	return rc;
}

static int find_root(const struct grid *g, uint32_t segment, struct err *err)
{
	struct grid_root *root = &g->roots[segment];
	struct grid_segment p;
	struct disk_segment h;
	int rc = grid_files_take(g->files, segment, &p, err);

	if (rc)
		return rc;
	rc = grid_segment_header(&p, &g->manifest->segments[segment], &h, err);
	if (rc == 0 && h.sources > g->manifest->nall)
		rc = grid_segment_damaged(&p, h.sources_place, "one of its sources is not in the manifest", err);
	if (rc == 0)
		rc = check_sources(g, &p, &h, err);
	grid_files_give(g->files, segment, &p);
	if (rc)
		return rc;
	atomic_store_explicit(&root->place, p.root, memory_order_relaxed);
	atomic_store_explicit(&root->check, p.root_check, memory_order_relaxed);
	atomic_store_explicit(&root->known, true, memory_order_release);
	return 0;
}

int grid_root_of(const struct grid *g, uint32_t segment, uint64_t *ret_place, uint64_t *ret_check, struct err *err)
{
	struct grid_root *root = g->roots ? &g->roots[segment] : NULL;

	if (root && !atomic_load_explicit(&root->known, memory_order_acquire)) {
		int rc = find_root(g, segment, err);

		if (rc)
			return rc;
	}
	*ret_place = root ? atomic_load_explicit(&root->place, memory_order_relaxed) : g->segments[segment].root;
	*ret_check = root ? atomic_load_explicit(&root->check, memory_order_relaxed) : g->segments[segment].root_check;
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

/* Slots are of sources, all else is of batches. */
static uint64_t ranges_most(const struct grid *g, const struct grid_use *use)
{
	return use->slots ? g->manifest->nall : g->manifest->nbatches;
}

/* Sorting the batches of sources doubles them for a while. */
static uint64_t sort_bytes(const struct grid_manifest *m)
{
	return 2 * m->nbatches * sizeof *m->batches;
}

/* Charges the tables (also the one of the sources of a segment that is opened late) and as many frames as index_memory has room
 * for, but no more than the index has pages. */
static int charge(struct grid *g, size_t index_memory, const struct grid_use *use, size_t *ret_frames, struct err *err)
{
	const struct grid_manifest *m = g->manifest;
	uint64_t pages = 0, frames = index_memory / (grid_cache_bytes(1) - grid_cache_bytes(0));

	for (size_t i = 0; i < m->nsegments; i++)
		pages += page_count(m->segments[i].cells);
	frames = frames < pages ? frames : pages;
	uint64_t bytes = sizeof *g + m->nsegments * (sizeof *g->segments + sizeof *g->live + sizeof *g->roots) +
			 (use->late ? m->nall * sizeof(struct disk_total) : 0) + grid_files_bytes(m->nsegments) +
			 grid_order_bytes(m->nsegments) + sort_bytes(m) + ranges_most(g, use) * sizeof *g->sources +
			 grid_cache_bytes(frames) + SLOTS_MOST * sizeof *g->slot_sum;

	if (g->ledger && !ledger_take(g->ledger, LEDGER_INDEX, bytes)) {
		err_set(err, ERR_BUSY, "no %llu bytes are free for the index of the dataset", (unsigned long long)bytes);
		return err_add_hint(err, "try again when other jobs are done, or give acutd more memory");
	}
	g->charged = bytes;
	*ret_frames = frames;
	return 0;
}

static bool is_late(const struct grid *g, const struct grid_use *use)
{
	bool all = use->late && !use->slots;

	for (size_t i = 0; all && i < g->nsources; i++)
		all = g->sources[i].live;
	return all;
}

static int fill_segments(struct grid *g, int dirfd, const struct grid_use *use, struct err *err)
{
	const struct grid_manifest *m = g->manifest;

	for (size_t i = 0; i < m->nsegments; i++) {
		grid_segment_describe(&g->segments[i], &m->segments[i]);
		if (g->segments[i].height > g->height)
			g->height = g->segments[i].height;
	}
	if (is_late(g, use) && !(g->roots = calloc(m->nsegments ? m->nsegments : 1, sizeof *g->roots)))
		return err_set(err, ERR_NOMEM, "no memory for %zu segments", m->nsegments);
	g->files = grid_files_new(dirfd, use, !g->roots, g->segments, m->nsegments, err);
	if (!g->files)
		return -(int)err->code;
	for (uint32_t i = 0; i < m->nsegments; i++) {
		int rc = 0;

		if (g->roots)
			take_live(g, i);
		else
			rc = open_segment(g, dirfd, i, err);
		if (rc)
			return rc;
	}
	return 0;
}

/* The ranges of numbers, ascending. */
static void fill_ranges(struct grid *g, const struct grid_batch *b, uint64_t generation, const struct grid_use *use)
{
	bool slots = use->slots && b->kind == GRID_POINTS;
	struct grid_liveness range = {
		.first = b->first,
		.last = b->first + (b->n - 1),
		.live = grid_batch_live(b, generation) && !(use->no_lines && b->kind == GRID_LINE_VERTICES),
	};

	if (!slots)
		g->sources[g->nsources++] = range;
	for (uint32_t k = 0; slots && k < b->n; k++) {
		range.first = range.last = b->first + k;
		range.slot = slots_of(use->slots, range.first);
		g->sources[g->nsources++] = range;
	}
}

static int fill_sources(struct grid *g, uint64_t generation, const struct grid_use *use, struct err *err)
{
	const struct grid_manifest *m = g->manifest;
	size_t n = 0;
	struct grid_batch *batches = grid_batches_sorted(m, &n);

	g->sources = calloc(ranges_most(g, use) + 1, sizeof *g->sources);
	g->segments = calloc(m->nsegments ? m->nsegments : 1, sizeof *g->segments);
	g->live = calloc(m->nsegments ? m->nsegments : 1, sizeof *g->live);
	g->slots = use->slots != NULL;
	if (g->slots)
		g->slot_sum = calloc(SLOTS_MOST, sizeof *g->slot_sum);
	if (!batches || !g->sources || !g->segments || !g->live || (g->slots && !g->slot_sum)) {
		free(batches);
		return err_set(err, ERR_NOMEM, "no memory for %llu sources and %zu segments", (unsigned long long)m->nall,
			       m->nsegments);
	}
	for (size_t i = 0; i < n; i++)
		fill_ranges(g, &batches[i], generation, use);
	free(batches);
	if (g->ledger)
		ledger_give(g->ledger, LEDGER_INDEX, sort_bytes(m));
	g->charged -= sort_bytes(m);
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
	int rc = grid_manifest_load_bare(dirfd, manifest, ledger, &g->manifest, err);

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
		rc = charge(g, index_memory - lines_memory(g, index_memory), use, &frames, err);
	if (rc == 0)
		rc = fill_sources(g, generation, use, err);
	if (rc == 0)
		rc = fill_segments(g, dirfd, use, err);
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
	return g->roots || g->manifest->nsegments > GRID_FILES_OPEN;
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
	free(g->roots);
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
