/*
 * Sealing (grid_stage.h): the runs of a stage, and the points in memory, become one segment.
 *
 * The points in memory are sorted in as many pieces as there are workers. Then the key space is divided into slices
 * (grid_slices.h). A worker takes the next slice and a slot of memory, and makes cells of the slice's records
 * (grid_seal_slot.c). Slices are put into the segment in order; that takes little time: places, checksums, index. The
 * worker that finishes the next slice puts it, and those after it that are ready. It writes the bytes without the lock.
 * A slice that does not fit its slot (nothing bounds the records of one position) waits until it is next, and is then
 * put piece by piece.
 *
 * So the segment does not depend on the workers. All of the seal except the memory of slots is used under the guard.
 */
#include "grid_seal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "align.h"
#include "err.h"
#include "grid_seal_priv.h"
#include "io.h"

enum {
	MIN_PIECE = 1 << 15, /* records; smaller pieces are not worth a separate sort */
	MIN_SLICE = 1 << 13, /* records */
	RECORD_BYTES = 20,   /* of a record in cells, with heads and a margin */
	MIN_PUNCH = 1 << 20, /* bytes */
};

/* All threads return the first failure. Under the lock. */
static void fail(struct grid_seal *z, const struct err *err)
{
	if (!z->failed)
		z->err = *err;
	z->failed = true;
	grid_seal_wake(z);
}

/* ---- slots ---- */

/* The number of records that a slice should have. Without runs: few, so that a small stage gives work to all workers. With
 * runs: as many as the memory can hold. */
static size_t slice_target(const struct grid_seal *z)
{
	uint64_t n = z->slices.records / (z->workers > 1 ? 2 * z->workers : 1);

	return z->stage->nruns ? SIZE_MAX / 64 : n > MIN_SLICE ? (size_t)n : MIN_SLICE;
}

/* The most that a slot may need, if slices become twice as large as intended. Few records do not use all of a large memory,
 * because the kernel clears every page that is touched, which cost more than the rest of a small push. */
static size_t max_slot_bytes(const struct grid_seal *z)
{
	return align_line(grid_slot_min_bytes(z->slices.nruns, z->slices.npieces) + 2 * RECORD_BYTES * slice_target(z));
}

/* One more slot than workers, so that a worker that is early can continue; fewer if the memory is small. */
static void slots_init(struct grid_seal *z, unsigned workers)
{
	size_t n = z->slices.nruns, least = grid_slot_min_bytes(n, z->slices.npieces);
	unsigned want = workers > 1 ? workers + 1 : 1;

	want = want < GRID_SEAL_SLOTS ? want : GRID_SEAL_SLOTS;
	while (want > 1 && z->bytes / want < 2 * least)
		want--;
	z->nslots = want;
	z->workers = workers;
	size_t each = z->bytes / want & ~(size_t)63, most = max_slot_bytes(z);

	each = each < most ? each : most;

	for (unsigned i = 0; i < want; i++)
		grid_slot_init(&z->slot[i], z->memory + i * each, each, n, z->slices.npieces);
}

unsigned grid_seal_workers(const struct grid_seal *z)
{
	return z->nslots > 1 ? z->nslots - 1 : 1;
}

/* ---- beginning ---- */

size_t grid_seal_bytes(void)
{
	return sizeof(struct grid_seal);
}

size_t grid_seal_runs_bytes(size_t n)
{
	return align_line(n * (sizeof(struct grid_run) + 4 * sizeof(uint64_t)));
}

size_t grid_seal_min_bytes(size_t n)
{
	return grid_slot_min_bytes(n, 1);
}

static int open_runs(struct grid_seal *z, struct err *err)
{
	struct grid_stage *s = z->stage;
	char name[GRID_NAME_MAX];
	int rc = 0;

	z->slices.run = (struct grid_run *)s->lists; /* sorting needs all of the scratch */
	z->slices.from = (uint64_t *)(z->slices.run + s->nruns);
	z->seen = z->slices.from + s->nruns;
	z->obsolete = z->seen + s->nruns;
	z->punched = z->obsolete + s->nruns;
	memset(z->slices.from, 0, 4 * s->nruns * sizeof *z->seen);
	for (size_t i = 0; rc == 0 && i < s->nruns; i++) {
		grid_stage_run_name(s, s->runs[i], name);
		rc = grid_run_open(&z->slices.run[i], s->dirfd, name, !s->durable, err);
		if (rc)
			break;
		z->slices.nruns++;
		z->slices.records += z->slices.run[i].records;
	}
	return rc;
}

static void cut_pieces(struct grid_seal *z, unsigned workers)
{
	const struct grid_stage *s = z->stage;
	size_t n = s->lane[0].n, most = n / MIN_PIECE;
	unsigned pieces = workers < GRID_LANES ? workers : GRID_LANES;

	pieces = pieces > most ? (unsigned)most : pieces;
	pieces = pieces ? pieces : n > 0;
	for (unsigned i = 0; i < pieces; i++) {
		size_t first = n * i / pieces;

		z->slices.piece[i] = (struct grid_piece){s->pts + first, n * (i + 1) / pieces - first};
	}
	z->slices.npieces = pieces;
	z->slices.records += n;
}

static struct grid_seal *seal_free(struct grid_seal *z)
{
	for (size_t i = 0; i < z->slices.nruns; i++)
		grid_run_close(&z->slices.run[i]);
	free(z);
	return NULL;
}

static int begin(struct grid_seal *z, unsigned workers, struct err *err)
{
	struct grid_stage *s = z->stage;
	char name[GRID_NAME_MAX];
	int rc;

	z->memory = (uint8_t *)s->scratch;
	z->bytes = s->cap * sizeof *s->scratch;
	rc = s->nruns ? grid_seal_premerge(s, &z->memory, &z->bytes, err) : 0;
	if (rc == 0)
		rc = open_runs(z, err);
	if (rc)
		return rc;
	grid_stage_rank(s);
	cut_pieces(z, workers);
	slots_init(z, workers);
	snprintf(name, sizeof name, "%s.seg", s->segment);
	return grid_segment_writer_begin(&z->seg, s->segment_dirfd, name, s->all, s->nall, s->pages, err);
}

int grid_seal_begin(struct grid_stage *s, unsigned workers, const struct grid_guard *guard, struct grid_seal **ret,
		    struct err *err)
{
	int rc = grid_stage_usable(s, err);
	struct grid_seal *z;

	if (rc)
		return rc;
	z = calloc(1, sizeof *z);
	if (!z)
		return err_set(err, ERR_NOMEM, "no memory to seal a stage");
	z->stage = s;
	z->err = ERR_INIT;
	z->seg.file = GRID_FILE_INIT;
	if (guard)
		z->guard = *guard;
	rc = begin(z, guard ? workers : 1, err);
	if (rc) {
		seal_free(z);
		return grid_stage_fail(s, rc);
	}
	*ret = z;
	return 0;
}

/* Punches holes into runs whose blocks are in the segment, to free disk space. Not for durable or suspended stages, which
 * need their runs. Under the lock. */
static void punch_runs(struct grid_seal *z)
{
	const struct grid_slices *all = &z->slices;

	if (z->stage->durable || z->stage->suspended || z->punching || !io->punch)
		return;
	z->punching = true;
	for (size_t i = 0; i < all->nruns; i++) {
		uint64_t from = z->punched[i] * DISK_RUN_BLOCK, to = z->obsolete[i] * DISK_RUN_BLOCK;

		if (to < from + MIN_PUNCH)
			continue;
		z->punched[i] = z->obsolete[i];
		grid_seal_unlock(z);
		io->punch(all->run[i].fd, (off_t)from, (off_t)(to - from)); /* a failure only delays it */
		grid_seal_lock(z);
	}
	z->punching = false;
}

/* Puts the blocks of the next slice's slot into the segment. Called under the lock, which it releases while writing. */
static int put_slot(struct grid_seal *z, struct grid_slot *s, struct err *err)
{
	int rc = grid_segment_writer_put(&z->seg, &s->cells, err);

	s->state = SLOT_FILLING;
	z->placed++;
	for (size_t i = 0; i < z->slices.nruns; i++)
		z->obsolete[i] = s->slice.end[i] ? s->slice.end[i] - 1 : 0;
	grid_seal_wake(z);
	grid_seal_unlock(z);
	if (rc == 0)
		rc = grid_cells_write(&s->cells, z->seg.file.fd, z->seg.file.temp, err);
	grid_seal_lock(z);
	s->state = SLOT_FREE;
	grid_seal_wake(z);
	if (rc == 0)
		punch_runs(z);
	return rc;
}

static struct grid_slot *find_slot(struct grid_seal *z, enum grid_slot_state state)
{
	for (unsigned i = 0; i < z->nslots; i++)
		if (z->slot[i].state == state && (state == SLOT_FREE || z->slot[i].slice.number == z->placed))
			return &z->slot[i];
	return NULL;
}

static int seal_slice(struct grid_seal *z, struct grid_slot *s, struct err *err)
{
	uint64_t omitted = 0;
	int rc = grid_slices_next(&z->slices, &s->slice, err);

	if (rc)
		return rc;
	s->state = SLOT_FILLING;
	grid_seal_unlock(z);
	rc = grid_slot_fill(z, s, &omitted, err);
	grid_seal_lock(z);
	if (rc)
		return rc;
	s->state = SLOT_FILLED;
	z->omitted += omitted;
	for (size_t i = 0; i < z->slices.nruns; i++)
		z->seen[i] += s->seen[i];
	while (rc == 0 && !z->failed && (s = find_slot(z, SLOT_FILLED)))
		rc = put_slot(z, s, err);
	return rc;
}

/* ---- steps ---- */

static void sort_piece(struct grid_seal *z)
{
	const struct grid_piece *p = &z->slices.piece[z->sorting++];

	struct point *scratch = z->stage->scratch + (p->pts - z->stage->pts);

	grid_seal_unlock(z);
	grid_stage_touch(z->stage, scratch, p->n * sizeof *scratch);
	point_sort(p->pts, scratch, p->n);
	grid_seal_lock(z);
	z->sorted++;
	grid_seal_wake(z);
}

static int plan_slices(struct grid_seal *z, struct err *err)
{
	size_t target = (z->slot[0].size - grid_cells_min_bytes()) / RECORD_BYTES, aim = slice_target(z);

	target = target < aim ? target : aim;
	z->planned = true;
	return grid_slices_plan(&z->slices, target, z->stage->ndropped > 0, z->slot[0].memory, z->slot[0].size, err);
}

/* Does one thing that can be done now, and sets *ret_rc to its result. False: there is nothing to do, now or ever. */
static bool try_step(struct grid_seal *z, int *ret_rc, struct err *err)
{
	struct grid_slot *s;

	*ret_rc = 0;
	if (z->sorting < z->slices.npieces)
		sort_piece(z);
	else if (z->sorted < z->slices.npieces)
		return false;
	else if (!z->planned)
		*ret_rc = plan_slices(z, err);
	else if (z->slices.next < z->slices.n && (s = find_slot(z, SLOT_FREE)))
		*ret_rc = seal_slice(z, s, err);
	else
		return false;
	return true;
}

static bool all_begun(const struct grid_seal *z)
{
	return z->planned && z->slices.next == z->slices.n;
}

int grid_seal_step(struct grid_seal *z, struct err *err)
{
	int rc = 0;

	grid_seal_lock(z);
	while (rc == 0 && !z->failed && !all_begun(z) && !try_step(z, &rc, err))
		grid_seal_wait(z);
	if (rc)
		fail(z, err);
	else if (z->failed)
		rc = -(int)(*err = z->err).code;
	else
		rc = all_begun(z) ? GRID_SEAL_DONE : 0;
	grid_seal_unlock(z);
	return rc;
}

void grid_seal_progress(struct grid_seal *z, uint64_t *ret_done, uint64_t *ret_all)
{
	grid_seal_lock(z);
	*ret_done = z->seg.head.points;
	*ret_all = z->slices.records;
	grid_seal_unlock(z);
}

/* Every staged record is either in the segment or was omitted on purpose. */
static int check_all(struct grid_seal *z, struct err *err)
{
	for (size_t i = 0; i < z->slices.nruns; i++)
		if (z->seen[i] != z->slices.run[i].records)
			return grid_run_damaged(&z->slices.run[i], 0, "the number of its records differs from its header", err);
	if (z->placed == z->slices.n && z->seg.head.points + z->omitted == z->slices.records)
		return 0;
	return err_set(err, ERR_INTERNAL, "of %llu points %llu were sealed", (unsigned long long)z->slices.records,
		       (unsigned long long)z->seg.head.points);
}

struct grid_seal *grid_seal_free(struct grid_seal *z)
{
	if (!z)
		return NULL;
	z->stage->failed = true;
	grid_segment_writer_abort(&z->seg);
	return seal_free(z);
}

int grid_seal_finish(struct grid_seal *z, struct grid_segment_info *ret, struct err *err)
{
	struct grid_stage *s = z->stage;
	int rc = z->failed ? -(int)(*err = z->err).code : check_all(z, err);

	if (rc == 0)
		rc = grid_segment_writer_finish(&z->seg,
						s->temporary    ? GRID_TEMPORARY :
						s->folder_later ? GRID_DURABLE_DATA :
								  GRID_DURABLE,
						ret, err);
	grid_segment_writer_abort(&z->seg);
	seal_free(z);
	if (rc)
		return grid_stage_fail(s, rc);
	if (!s->suspended)
		grid_stage_drop_runs(s, s->nruns);
	s->sealed = true;
	s->lane[0].n = 0;
	return 0;
}

int grid_stage_seal(struct grid_stage *s, struct grid_segment_info *ret, struct err *err)
{
	struct err last = ERR_INIT;
	struct grid_seal *z;
	int rc = grid_seal_begin(s, 1, NULL, &z, err);

	if (rc)
		return rc;
	while (!grid_seal_step(z, &last))
		;
	return grid_seal_finish(z, ret, err);
}
