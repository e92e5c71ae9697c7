/*
 * A hash table with linear probing over pages of slots.
 *
 * Page p can only be in frame p modulo the number of frames. As long as there are no more pages than frames, nothing is
 * evicted and no file exists. Beyond that the file is the table, and the frames are its write-back cache. The slot of a
 * finished vertex is freed by shifting back the entries behind it, so there are no tombstones. Growing passes all
 * entries through a temporary file, so memory does not grow. The files are unlinked from the start.
 */
#include "pipe_table.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>
#include <xxhash.h>

#include "err.h"
#include "io.h"

enum { SLOTS = PIPE_TABLE_PAGE / sizeof(struct pipe_vertex) };
_Static_assert(sizeof(struct pipe_vertex) == 40, "102 slots a page");
/* Pages of a new table, if they fit: most meshes have a few thousand open vertices, and growing needs a file. */
enum { FIRST_PAGES = 128, HUGE_PAGE = 2 << 20 };

struct frame {
	uint64_t page;
	bool used, dirty;
};

struct pipe_table {
	int dirfd, fd;
	uint64_t npages, nslots, count;
	size_t nframes;
	struct frame *frame;
	uint8_t *bytes;      /* nframes pages */
	uint64_t file_pages; /* pages that were ever written to the file; the others are zero */
};

static const char NAME[] = "the emitter's spill file";

/* Opens an unlinked file in the folder. */
static int scratch_open(int dirfd, int *ret_fd, struct err *err)
{
	static unsigned serial;
	char name[64];
	int fd, r;

	fd = io->openat(dirfd, ".", O_RDWR | O_TMPFILE | O_CLOEXEC, 0600);
	if (fd >= 0) {
		*ret_fd = fd;
		return 0;
	}
	if (errno != EOPNOTSUPP && errno != EISDIR && errno != ENOENT)
		return err_sys(err, errno, "cannot open %s", NAME);
	snprintf(name, sizeof name, "spill.%ld.%u.tmp", (long)getpid(), __atomic_fetch_add(&serial, 1, __ATOMIC_RELAXED));
	r = io_open(dirfd, name, O_RDWR | O_CREAT | O_EXCL, 0600, ret_fd, err);
	if (!r)
		io->unlinkat(dirfd, name, 0);
	return r;
}

static void *frame_bytes(struct pipe_table *t, size_t i)
{
	return t->bytes + i * PIPE_TABLE_PAGE;
}

static int frame_flush(struct pipe_table *t, size_t i, struct err *err)
{
	struct frame *f = &t->frame[i];
	int r;

	if (t->fd < 0) {
		r = scratch_open(t->dirfd, &t->fd, err);
		if (r)
			return r;
	}
	r = io_write_at(t->fd, frame_bytes(t, i), PIPE_TABLE_PAGE, f->page * PIPE_TABLE_PAGE, NAME, err);
	if (r)
		return r;
	f->dirty = false;
	if (f->page >= t->file_pages)
		t->file_pages = f->page + 1;
	return 0;
}

/* Loads a page into its frame. */
static int page_get(struct pipe_table *t, uint64_t page, struct pipe_vertex **ret, size_t *ret_frame, struct err *err)
{
	size_t i = (size_t)(page % t->nframes), got = 0;
	struct frame *f = &t->frame[i];
	int r;

	if (!f->used || f->page != page) {
		if (f->used && f->dirty) {
			r = frame_flush(t, i, err);
			if (r)
				return r;
		}
		f->used = false;
		memset(frame_bytes(t, i), 0, PIPE_TABLE_PAGE);
		if (t->fd >= 0 && page < t->file_pages) {
			r = io_read_some(t->fd, frame_bytes(t, i), PIPE_TABLE_PAGE, page * PIPE_TABLE_PAGE, NAME, &got, err);
			if (r)
				return r;
		}
		*f = (struct frame){.page = page, .used = true};
	}
	*ret = frame_bytes(t, i);
	*ret_frame = i;
	return 0;
}

static int slot_read(struct pipe_table *t, uint64_t slot, struct pipe_vertex *ret, struct err *err)
{
	struct pipe_vertex *page;
	size_t frame;
	int r = page_get(t, slot / SLOTS, &page, &frame, err);

	if (!r)
		*ret = page[slot % SLOTS];
	return r;
}

static int slot_write(struct pipe_table *t, uint64_t slot, const struct pipe_vertex *v, struct err *err)
{
	struct pipe_vertex *page;
	size_t frame;
	int r = page_get(t, slot / SLOTS, &page, &frame, err);

	if (r)
		return r;
	page[slot % SLOTS] = *v;
	t->frame[frame].dirty = true;
	return 0;
}

static uint64_t home_of(const struct pipe_table *t, uint64_t place)
{
	uint64_t h = XXH3_64bits(&place, sizeof place);

	return (uint64_t)(((unsigned __int128)h * t->nslots) >> 64);
}

static uint64_t next_slot(const struct pipe_table *t, uint64_t slot)
{
	return slot + 1 == t->nslots ? 0 : slot + 1;
}

/* The slot of `place`, or the free slot where it belongs. */
static int slot_find(struct pipe_table *t, uint64_t place, uint64_t *ret_slot, struct pipe_vertex *ret, struct err *err)
{
	uint64_t slot = home_of(t, place);
	int r;

	for (;; slot = next_slot(t, slot)) {
		r = slot_read(t, slot, ret, err);
		if (r)
			return r;
		if (!ret->number || ret->place == place) {
			*ret_slot = slot;
			return 0;
		}
	}
}

/* Frees a slot: moves back every following entry that must not be behind a gap. */
static int slot_free(struct pipe_table *t, uint64_t gap, struct err *err)
{
	const struct pipe_vertex none = {0};
	uint64_t slot = gap;
	struct pipe_vertex v;
	int r;

	for (;;) {
		slot = next_slot(t, slot);
		r = slot_read(t, slot, &v, err);
		if (r)
			return r;
		if (!v.number)
			break;
		/* It may move to the gap if its home is not cyclically in (gap, slot]. */
		uint64_t home = home_of(t, v.place);
		bool between = gap < slot ? (gap < home && home <= slot) : (gap < home || home <= slot);
		if (between)
			continue;
		r = slot_write(t, gap, &v, err);
		if (r)
			return r;
		gap = slot;
	}
	t->count--;
	return slot_write(t, gap, &none, err);
}

static void table_clear(struct pipe_table *t, uint64_t npages)
{
	size_t i;

	t->npages = npages;
	t->nslots = npages * SLOTS;
	t->count = 0;
	t->file_pages = 0;
	for (i = 0; i < t->nframes; i++)
		t->frame[i] = (struct frame){0};
	t->fd = io_close(t->fd);
}

static int insert_new(struct pipe_table *t, const struct pipe_vertex *v, struct err *err)
{
	struct pipe_vertex found;
	uint64_t slot;
	int r = slot_find(t, v->place, &slot, &found, err);

	if (r)
		return r;
	t->count++;
	return slot_write(t, slot, v, err);
}

/* Writes all entries, page by page, to a scratch file. */
static int dump(struct pipe_table *t, int fd, uint64_t *ret_n, struct err *err)
{
	struct pipe_vertex buf[SLOTS], *page;
	uint64_t p, n = 0;
	size_t frame, i, k;
	int r;

	for (p = 0; p < t->npages; p++) {
		r = page_get(t, p, &page, &frame, err);
		if (r)
			return r;
		for (i = k = 0; i < SLOTS; i++)
			if (page[i].number)
				buf[k++] = page[i];
		r = io_write_at(fd, buf, k * sizeof buf[0], n * sizeof buf[0], NAME, err);
		if (r)
			return r;
		n += k;
	}
	*ret_n = n;
	return 0;
}

static int grow(struct pipe_table *t, struct err *err)
{
	struct pipe_vertex buf[SLOTS];
	uint64_t n = 0, at;
	size_t i, k;
	int fd, r;

	r = scratch_open(t->dirfd, &fd, err);
	if (r)
		return r;
	r = dump(t, fd, &n, err);
	if (!r)
		table_clear(t, t->npages * 2);
	for (at = 0; !r && at < n; at += k) {
		k = n - at < SLOTS ? (size_t)(n - at) : SLOTS;
		r = io_read_at(fd, buf, k * sizeof buf[0], at * sizeof buf[0], NAME, err);
		for (i = 0; !r && i < k; i++)
			r = insert_new(t, &buf[i], err);
	}
	io_close(fd);
	return r;
}

/* In huge pages if there is more than one: slots are used at random, and most of the time of a small job would be page
 * faults. Only used pages become resident, cleared by the kernel when they are first used. */
static void *frames_new(size_t nframes)
{
	size_t bytes = nframes * PIPE_TABLE_PAGE, whole = (bytes + HUGE_PAGE - 1) & ~(size_t)(HUGE_PAGE - 1);
	void *at;

	if (bytes <= HUGE_PAGE)
		return malloc(bytes);
	at = aligned_alloc(HUGE_PAGE, whole);
	if (at)
		madvise(at, bytes & ~(size_t)(HUGE_PAGE - 1), MADV_HUGEPAGE);
	return at;
}

int pipe_table_new(size_t memory, int tempdirfd, struct pipe_table **ret, struct err *err)
{
	size_t nframes = memory / PIPE_TABLE_PAGE;
	struct pipe_table *t;

	if (nframes < PIPE_TABLE_FRAMES_MIN)
		return err_set(err, ERR_INTERNAL, "the emitter was given %zu bytes, it needs %d", memory,
			       PIPE_TABLE_FRAMES_MIN * PIPE_TABLE_PAGE);
	t = calloc(1, sizeof *t);
	if (t) {
		t->fd = -1;
		t->frame = calloc(nframes, sizeof *t->frame);
		t->bytes = frames_new(nframes);
	}
	if (!t || !t->frame || !t->bytes) {
		pipe_table_free(t);
		return err_set(err, ERR_NOMEM, "no memory for the emitter's table (%zu bytes)", memory);
	}
	t->dirfd = tempdirfd;
	t->nframes = nframes;
	table_clear(t, nframes < FIRST_PAGES ? PIPE_TABLE_FRAMES_MIN : FIRST_PAGES);
	*ret = t;
	return 0;
}

struct pipe_table *pipe_table_free(struct pipe_table *t)
{
	if (t) {
		io_close(t->fd);
		free(t->frame);
		free(t->bytes);
		free(t);
	}
	return NULL;
}

/* Whether so many entries fill more than that many slots may be. */
static bool is_full(uint64_t entries, uint64_t slots)
{
	return entries * 10 >= slots * 7;
}

bool pipe_table_spills(const struct pipe_table *t, uint64_t n)
{
	return is_full(t->count + n, (uint64_t)t->nframes * SLOTS);
}

int pipe_table_reserve(struct pipe_table *t, uint64_t n, struct err *err)
{
	int r = 0;

	while (!r && is_full(t->count + n, t->nslots))
		r = grow(t, err);
	return r;
}

int pipe_table_add(struct pipe_table *t, const struct pipe_vertex *add, struct pipe_vertex *ret, struct err *err)
{
	struct pipe_vertex v;
	uint64_t slot;
	int r;

	r = pipe_table_reserve(t, 0, err);
	if (r)
		return r;
	r = slot_find(t, add->place, &slot, &v, err);
	if (r)
		return r;
	if (!v.number) {
		r = slot_write(t, slot, add, err);
		if (r)
			return r;
		t->count++;
		*ret = *add;
		return PIPE_TABLE_NEW;
	}
	v.hi += add->hi;
	v.lo += add->lo;
	v.edges += add->edges;
	r = v.hi || v.lo ? slot_write(t, slot, &v, err) : slot_free(t, slot, err);
	if (r)
		return r;
	*ret = v;
	return v.hi || v.lo ? PIPE_TABLE_KNOWN : PIPE_TABLE_CLOSED;
}

uint64_t pipe_table_count(const struct pipe_table *t)
{
	return t->count;
}

uint64_t pipe_table_spilled_pages(const struct pipe_table *t)
{
	return t->npages > t->nframes ? t->npages - t->nframes : 0;
}

uint64_t pipe_table_pages(const struct pipe_table *t)
{
	return t->npages;
}

unsigned pipe_table_parts(const struct pipe_table *t)
{
	return (unsigned)((t->npages + t->nframes - 1) / t->nframes);
}

unsigned pipe_table_part(const struct pipe_table *t, uint64_t place)
{
	return (unsigned)(home_of(t, place) / SLOTS / t->nframes);
}

int pipe_table_number(struct pipe_table *t, uint64_t place, uint64_t number, struct err *err)
{
	struct pipe_vertex v;
	uint64_t slot;
	int r = slot_find(t, place, &slot, &v, err);

	if (r)
		return r;
	if (!v.number)
		return err_set(err, ERR_INTERNAL, "a vertex is not among the open ones");
	v.number = number;
	return slot_write(t, slot, &v, err);
}
