/*
 * Sealing (grid.h): runs, and what is still in memory, become one segment.
 *
 * The model: what is in memory is sorted in as many pieces as there are workers. Then the key space is cut into
 * slices (grid_slices.c). A worker takes the next slice and a slot of memory, merges the slice's records and makes
 * them into cells. Their blocks are put into the segment slice by slice in order, which takes little: places,
 * checksums, index. Who finishes the slice that is next puts it, and those behind it that wait already; the bytes
 * are written by whoever put them, beside all others. A slice with more than its slot holds (nothing bounds the
 * records of one position) waits for its turn, and is put piece by piece.
 *
 * So the segment does not depend on who does what. All of the seal but what slots hold is used under the guard.
 */
#include "grid_seal.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_segment.h"
#include "grid_slices.h"
#include "grid_stage_priv.h"
#include "io.h"

enum {
	WINDOW_MIN = 4096,
	WINDOW_MAX = 16384,
	SLOTS = GRID_LANES + 1,
	READ_BLOCKS = 16,      /* of a run, at a time, where there is room */
	PIECE_LEAST = 1 << 15, /* records: less is not worth a sort of its own */
	SLICE_LEAST = 1 << 13, /* likewise, a slice */
	RECORD_BYTES = 20,     /* made into cells, with heads, and some to spare */
	PUNCH_LEAST = 1 << 20, /* bytes */
};

enum slot_state { FREE, FILLING, FILLED };

struct slot {
	enum slot_state state;
	struct grid_slice slice;
	uint64_t *seen; /* of each run: records taken */
	struct point *window;
	uint32_t *ids;
	size_t room; /* of the window */
	void *merging;
	uint8_t *blocks; /* of runs: `ahead` each */
	unsigned ahead;
	uint8_t *memory; /* for cells */
	size_t size;
	struct grid_merge merge;
	struct grid_cells cells;
};

struct grid_seal {
	struct grid_stage *stage;
	struct grid_guard guard;
	struct grid_segment seg;
	struct grid_slices slices;
	struct slot slot[SLOTS];
	unsigned nslots, workers;
	uint8_t *memory;
	size_t bytes;
	unsigned sorting, sorted; /* pieces: begun, done */
	bool planned, punching, failed;
	struct err err;
	size_t placed;                   /* slices put wholly */
	uint64_t *seen, *dead, *punched; /* of each run: records taken; blocks not needed any more; given back */
	uint64_t left_out;               /* records of dropped sources */
};

static size_t align(size_t n)
{
	return (n + 63) & ~(size_t)63;
}

static void lock(const struct grid_seal *z)
{
	if (z->guard.lock)
		z->guard.lock(z->guard.ctx);
}

static void unlock(const struct grid_seal *z)
{
	if (z->guard.unlock)
		z->guard.unlock(z->guard.ctx);
}

static void wait(const struct grid_seal *z)
{
	z->guard.wait(z->guard.ctx); /* alone, nobody has to */
}

static void wake(const struct grid_seal *z)
{
	if (z->guard.wake)
		z->guard.wake(z->guard.ctx);
}

/* The first failure is everybody's. Under the lock. */
static void fail(struct grid_seal *z, const struct err *err)
{
	if (!z->failed)
		z->err = *err;
	z->failed = true;
	wake(z);
}

/* ---- slots ---- */

static size_t window_bytes(size_t records)
{
	return align(records * (sizeof(struct point) + sizeof(uint32_t)));
}

static size_t fixed_bytes(size_t n, unsigned pieces)
{
	return align(grid_merge_bytes((unsigned)n + pieces)) + align(3 * n * sizeof(uint64_t));
}

static size_t slot_least(size_t n, unsigned pieces)
{
	return fixed_bytes(n, pieces) + window_bytes(WINDOW_MIN) + n * DISK_RUN_BLOCK + align(grid_cells_least());
}

/* Windows, and what is read ahead, only where the least leaves room for them. */
static void slot_init(struct slot *s, uint8_t *memory, size_t bytes, size_t n, unsigned pieces)
{
	uint8_t *end = memory + bytes;
	size_t spare = bytes - slot_least(n, pieces), more = window_bytes(WINDOW_MAX) - window_bytes(WINDOW_MIN), ahead = 0;

	*s = (struct slot){.room = spare / 4 >= more ? WINDOW_MAX : WINDOW_MIN};
	if (n)
		ahead = spare / 4 / (n * DISK_RUN_BLOCK);
	s->ahead = ahead + 1 > READ_BLOCKS ? READ_BLOCKS : (unsigned)ahead + 1;
	s->merging = memory;
	memory += align(grid_merge_bytes((unsigned)n + pieces));
	s->seen = (uint64_t *)memory;
	s->slice.first = s->seen + n;
	s->slice.end = s->slice.first + n;
	memory += align(3 * n * sizeof(uint64_t));
	s->window = (struct point *)memory;
	s->ids = (uint32_t *)(s->window + s->room);
	memory += window_bytes(s->room);
	s->blocks = memory;
	memory += n * s->ahead * DISK_RUN_BLOCK;
	s->memory = memory;
	s->size = (size_t)(end - memory);
}

/* Records of a slice: few, so that all workers have some of a small stage too. With runs, as many as memory can hold. */
static size_t slice_aim(const struct grid_seal *z)
{
	uint64_t n = z->slices.records / (z->workers > 1 ? 2 * z->workers : 1);

	return z->stage->nruns ? SIZE_MAX / 64 : n > SLICE_LEAST ? (size_t)n : SLICE_LEAST;
}

/* What a slot may need, if slices become twice as large as they are meant to be. Not all of a large memory for few records:
 * the kernel clears whatever is touched, which was more work than all else of a small push. */
static size_t slot_most(const struct grid_seal *z)
{
	return align(slot_least(z->slices.nruns, z->slices.npieces) + 2 * RECORD_BYTES * slice_aim(z));
}

/* One more slot than workers, so that who is done early can go on; as many as there is memory for. */
static void slots_init(struct grid_seal *z, unsigned workers)
{
	size_t n = z->slices.nruns, least = slot_least(n, z->slices.npieces);
	unsigned want = workers > 1 ? workers + 1 : 1;

	want = want < SLOTS ? want : SLOTS;
	while (want > 1 && z->bytes / want < 2 * least)
		want--;
	z->nslots = want;
	z->workers = workers;
	size_t each = z->bytes / want & ~(size_t)63, most = slot_most(z);

	each = each < most ? each : most;

	for (unsigned i = 0; i < want; i++)
		slot_init(&z->slot[i], z->memory + i * each, each, n, z->slices.npieces);
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
	return align(n * (sizeof(struct grid_run) + 4 * sizeof(uint64_t)));
}

size_t grid_seal_least(size_t n)
{
	return slot_least(n, 1);
}

static int open_runs(struct grid_seal *z, struct err *err)
{
	struct grid_stage *s = z->stage;
	char name[GRID_NAME_MAX];
	int rc = 0;

	z->slices.run = (struct grid_run *)s->lists; /* sorting needs all of the scratch */
	z->slices.from = (uint64_t *)(z->slices.run + s->nruns);
	z->seen = z->slices.from + s->nruns;
	z->dead = z->seen + s->nruns;
	z->punched = z->dead + s->nruns;
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
	size_t n = s->lane[0].n, most = n / PIECE_LEAST;
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
	rc = s->nruns ? grid_seal_prepare(s, &z->memory, &z->bytes, err) : 0;
	if (rc == 0)
		rc = open_runs(z, err);
	if (rc)
		return rc;
	grid_stage_rank(s);
	cut_pieces(z, workers);
	slots_init(z, workers);
	snprintf(name, sizeof name, "%s.seg", s->stem);
	return grid_segment_begin(&z->seg, s->dirfd, name, s->all, s->nall, s->pages, err);
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

/* ---- a slice ---- */

/* Its part of the sorted memory, and of the runs. */
static int open_slice(struct grid_seal *z, struct slot *s, struct err *err)
{
	const struct grid_slices *all = &z->slices;
	const struct grid_slice *slice = &s->slice;
	int rc = 0;

	grid_cells_begin(&s->cells, s->memory, s->size, slice->lo, slice->hi);
	grid_merge_init(&s->merge, (unsigned)all->nruns + all->npieces, s->merging);
	memset(s->seen, 0, all->nruns * sizeof *s->seen);
	for (unsigned i = 0; i < all->npieces; i++)
		grid_merge_memory(&s->merge, all->piece[i].pts, all->piece[i].n, z->stage->table, slice->lo, slice->hi);
	for (size_t i = 0; rc == 0 && i < all->nruns; i++) {
		struct grid_run_reader r;

		if (slice->first[i] >= slice->end[i])
			continue;
		grid_run_read(&r, &all->run[i], slice->first[i], slice->end[i], s->blocks + i * s->ahead * DISK_RUN_BLOCK,
			      s->ahead);
		rc = grid_merge_run(&s->merge, &r, slice->lo, slice->hi, &s->seen[i], err);
	}
	grid_merge_start(&s->merge);
	return rc;
}

/* In the middle of a slice there is no room for more cells: when it is its turn, they go. */
static int put_some(struct grid_seal *z, struct slot *s, struct err *err)
{
	int rc = 0;

	lock(z);
	while (z->placed < s->slice.number && !z->failed)
		wait(z);
	if (z->failed)
		rc = -(int)(*err = z->err).code;
	else
		rc = grid_segment_put(&z->seg, &s->cells, err);
	unlock(z);
	return rc ? rc : grid_cells_write(&s->cells, z->seg.file.fd, z->seg.file.temp, err);
}

/* Cells of all of pts, or of those that make whole cells. */
static int add(struct grid_seal *z, struct slot *s, const struct point *pts, const uint32_t *ids, const uint32_t *table, size_t n,
	       bool end, size_t *ret_taken, struct err *err)
{
	size_t at = 0, taken;

	for (;;) {
		bool whole = grid_cells_add(&s->cells, pts + at, ids ? ids + at : NULL, table, n - at, end, &taken);
		int rc;

		at += taken;
		*ret_taken = at;
		if (whole)
			return 0;
		rc = put_some(z, s, err);
		if (rc)
			return rc;
	}
}

/* The merged stream, through the window. */
static int merge_slice(struct grid_seal *z, struct slot *s, uint64_t *ret_left_out, struct err *err)
{
	const struct grid_stage *stage = z->stage;
	uint32_t *ids = stage->nall > 1 || stage->ndead ? s->ids : NULL;
	size_t held = 0, got, taken;
	bool end = false;
	int rc = 0;

	while (rc == 0 && !end) {
		size_t want = s->room - held;

		rc = grid_merge_take(&s->merge, s->window + held, ids ? ids + held : NULL, want, &got, err);
		if (rc)
			break;
		end = got < want;
		*ret_left_out += got;
		got = grid_stage_leave_out(stage, s->window + held, ids ? ids + held : NULL, got);
		*ret_left_out -= got;
		held += got;
		if (!ids)
			for (size_t i = held - got; i < held; i++)
				s->window[i].tag &= POINT_FLAGS; /* index 0 of `all` */
		rc = add(z, s, s->window, ids, stage->all, held, end, &taken, err);
		if (rc)
			break;
		held -= taken;
		memmove(s->window, s->window + taken, held * sizeof *s->window);
		if (ids)
			memmove(ids, ids + taken, held * sizeof *ids);
	}
	return rc;
}

static int fill(struct grid_seal *z, struct slot *s, uint64_t *ret_left_out, struct err *err)
{
	int rc = open_slice(z, s, err);
	size_t taken;

	if (rc || !s->merge.n)
		return rc;
	const struct grid_merge_input *in = &s->merge.input[0];

	/* Of one sorted array nothing need be merged. */
	if (s->merge.n == 1 && !in->run.run && !z->stage->ndead)
		return add(z, s, in->at, NULL, in->table, (size_t)(in->end - in->at), true, &taken, err);
	return merge_slice(z, s, ret_left_out, err);
}

/* Blocks of runs that are in the segment go back to the disk, where no promise needs them: it is asked for runs of a
 * stage that is not durable and was not left. Under the lock. */
static void punch(struct grid_seal *z)
{
	const struct grid_slices *all = &z->slices;

	if (z->stage->durable || z->stage->left || z->punching || !io->punch)
		return;
	z->punching = true;
	for (size_t i = 0; i < all->nruns; i++) {
		uint64_t from = z->punched[i] * DISK_RUN_BLOCK, to = z->dead[i] * DISK_RUN_BLOCK;

		if (to < from + PUNCH_LEAST)
			continue;
		z->punched[i] = z->dead[i];
		unlock(z);
		io->punch(all->run[i].fd, (off_t)from, (off_t)(to - from)); /* to no avail: space is saved later */
		lock(z);
	}
	z->punching = false;
}

/* The filled slot whose turn it is: its blocks into the segment. Under the lock, but for writing. */
static int put_slot(struct grid_seal *z, struct slot *s, struct err *err)
{
	int rc = grid_segment_put(&z->seg, &s->cells, err);

	s->state = FILLING;
	z->placed++;
	for (size_t i = 0; i < z->slices.nruns; i++)
		z->dead[i] = s->slice.end[i] ? s->slice.end[i] - 1 : 0;
	wake(z);
	unlock(z);
	if (rc == 0)
		rc = grid_cells_write(&s->cells, z->seg.file.fd, z->seg.file.temp, err);
	lock(z);
	s->state = FREE;
	wake(z);
	if (rc == 0)
		punch(z);
	return rc;
}

static struct slot *find_slot(struct grid_seal *z, enum slot_state state)
{
	for (unsigned i = 0; i < z->nslots; i++)
		if (z->slot[i].state == state && (state == FREE || z->slot[i].slice.number == z->placed))
			return &z->slot[i];
	return NULL;
}

static int do_slice(struct grid_seal *z, struct slot *s, struct err *err)
{
	uint64_t left_out = 0;
	int rc = grid_slices_next(&z->slices, &s->slice, err);

	if (rc)
		return rc;
	s->state = FILLING;
	unlock(z);
	rc = fill(z, s, &left_out, err);
	lock(z);
	if (rc)
		return rc;
	s->state = FILLED;
	z->left_out += left_out;
	for (size_t i = 0; i < z->slices.nruns; i++)
		z->seen[i] += s->seen[i];
	while (rc == 0 && !z->failed && (s = find_slot(z, FILLED)))
		rc = put_slot(z, s, err);
	return rc;
}

/* ---- steps ---- */

static void sort_piece(struct grid_seal *z)
{
	const struct grid_piece *p = &z->slices.piece[z->sorting++];

	struct point *scratch = z->stage->scratch + (p->pts - z->stage->pts);

	unlock(z);
	grid_stage_touch(z->stage, scratch, p->n * sizeof *scratch);
	point_sort(p->pts, scratch, p->n);
	lock(z);
	z->sorted++;
	wake(z);
}

static int plan(struct grid_seal *z, struct err *err)
{
	size_t target = (z->slot[0].size - grid_cells_least()) / RECORD_BYTES, aim = slice_aim(z);

	target = target < aim ? target : aim;
	z->planned = true;
	return grid_slices_plan(&z->slices, target, z->stage->ndead > 0, z->slot[0].memory, z->slot[0].size, err);
}

/* One thing that can be done now; *ret_rc says how it went. False: there is nothing, for now or for good. */
static bool do_something(struct grid_seal *z, int *ret_rc, struct err *err)
{
	struct slot *s;

	*ret_rc = 0;
	if (z->sorting < z->slices.npieces)
		sort_piece(z);
	else if (z->sorted < z->slices.npieces)
		return false;
	else if (!z->planned)
		*ret_rc = plan(z, err);
	else if (z->slices.next < z->slices.n && (s = find_slot(z, FREE)))
		*ret_rc = do_slice(z, s, err);
	else
		return false;
	return true;
}

static bool begun(const struct grid_seal *z)
{
	return z->planned && z->slices.next == z->slices.n;
}

int grid_seal_step(struct grid_seal *z, struct err *err)
{
	int rc = 0;

	lock(z);
	while (rc == 0 && !z->failed && !begun(z) && !do_something(z, &rc, err))
		wait(z);
	if (rc)
		fail(z, err);
	else if (z->failed)
		rc = -(int)(*err = z->err).code;
	else
		rc = begun(z) ? GRID_SEAL_OVER : 0;
	unlock(z);
	return rc;
}

void grid_seal_progress(struct grid_seal *z, uint64_t *ret_done, uint64_t *ret_all)
{
	lock(z);
	*ret_done = z->seg.head.points;
	*ret_all = z->slices.records;
	unlock(z);
}

/* All that was staged is in the segment, or known to be left out. */
static int check_all(struct grid_seal *z, struct err *err)
{
	for (size_t i = 0; i < z->slices.nruns; i++)
		if (z->seen[i] != z->slices.run[i].records)
			return grid_run_damaged(&z->slices.run[i], 0, "it has not as many records as its header says", err);
	if (z->placed == z->slices.n && z->seg.head.points + z->left_out == z->slices.records)
		return 0;
	return err_set(err, ERR_INTERNAL, "of %llu points %llu were sealed", (unsigned long long)z->slices.records,
		       (unsigned long long)z->seg.head.points);
}

struct grid_seal *grid_seal_free(struct grid_seal *z)
{
	if (!z)
		return NULL;
	z->stage->failed = true;
	grid_segment_abort(&z->seg);
	return seal_free(z);
}

int grid_seal_finish(struct grid_seal *z, struct grid_segment_info *ret, struct err *err)
{
	struct grid_stage *s = z->stage;
	int rc = z->failed ? -(int)(*err = z->err).code : check_all(z, err);

	if (rc == 0)
		rc = grid_segment_finish(&z->seg,
					 s->passing      ? GRID_PASSING :
					 s->folder_later ? GRID_BUT_NAME :
							   GRID_DURABLE,
					 ret, err);
	grid_segment_abort(&z->seg);
	seal_free(z);
	if (rc)
		return grid_stage_fail(s, rc);
	if (!s->left)
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
