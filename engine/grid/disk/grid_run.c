/*
 * Sorted runs (grid_run.h). Each block has its own table of sources, so runs can be merged into longer runs without a
 * limit on the number of sources. All blocks have the same size in bytes and begin with their records, so a binary
 * search over the first records of blocks finds a key without an index.
 */
#include "grid_run.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_block.h"
#include "io.h"
#include "order.h"

int grid_run_begin(struct grid_run_writer *w, int dirfd, const char *name, void *buffer, size_t cap, struct err *err)
{
	uint8_t *room;

	assert(cap >= DISK_RUN_BLOCK);
	*w = (struct grid_run_writer){.file = GRID_FILE_INIT};
	int rc = grid_file_create(&w->file, dirfd, name, buffer, cap - cap % DISK_RUN_BLOCK, err);

	if (rc)
		return rc;
	rc = grid_file_reserve(&w->file, DISK_RUN_BLOCK, &room, err);
	if (rc)
		return rc;
	memset(room, 0, DISK_RUN_BLOCK);
	grid_file_commit(&w->file, DISK_RUN_BLOCK);
	return 0;
}

/* Lists the distinct sources of the records, ascending. */
static uint32_t list_sources(const struct point *pts, const uint32_t *ids, const uint32_t *table, size_t n,
			     uint32_t out[DISK_RUN_RECORDS])
{
	uint32_t count = 0, at = 0;

	for (size_t i = 0; i < n; i++) {
		uint32_t id = ids ? ids[i] : table[point_source(&pts[i])];

		if (!count || out[count - 1] != id)
			out[count++] = id;
	}
	if (count == 1)
		return 1;
	qsort(out, count, sizeof *out, order_u32);
	for (uint32_t i = 1; i < count; i++)
		if (out[i] != out[at])
			out[++at] = out[i];
	return at + 1;
}

static void put_records(struct point *out, const struct point *pts, const uint32_t *ids, const uint32_t *table, size_t n,
			const uint32_t *sources, unsigned nsources)
{
	for (size_t i = 0, at = 0; i < n; i++) {
		out[i] = pts[i];
		if (nsources > 1) {
			uint32_t id = ids ? ids[i] : table[point_source(&pts[i])];

			if (sources[at] != id) {
				const uint32_t *hit = bsearch(&id, sources, nsources, sizeof *sources, order_u32);

				at = (size_t)(hit - sources);
			}
		}
		out[i].tag = (uint16_t)(point_flags(&pts[i]) | at << POINT_SOURCE_SHIFT);
	}
}

/* Writes one block with the first of n records; *ret_n: how many. */
static int put_block(struct grid_run_writer *w, const struct point *pts, const uint32_t *ids, const uint32_t *table, size_t n,
		     size_t *ret_n, struct err *err)
{
	uint32_t sources[DISK_RUN_RECORDS];
	struct disk_run_block head = {0};
	uint8_t *room;
	int rc = grid_file_reserve(&w->file, DISK_RUN_BLOCK, &room, err);

	if (rc)
		return rc;
	n = n < DISK_RUN_RECORDS ? n : DISK_RUN_RECORDS;
	head.sources = (uint16_t)list_sources(pts, ids, table, n, sources);
	if (disk_run_used((unsigned)n, head.sources) >
	    DISK_RUN_BLOCK) { /* take fewer records; they have at most as many sources */
		n = (DISK_RUN_BLOCK - disk_run_used(0, head.sources)) / sizeof *pts;
		n = n > DISK_RUN_LEAST ? n : DISK_RUN_LEAST;
		head.sources = (uint16_t)list_sources(pts, ids, table, n, sources);
	}
	head.records = (uint16_t)n;
	size_t used = disk_run_used((unsigned)n, head.sources);
	uint64_t place = grid_file_place(&w->file);

	put_records((struct point *)(room + sizeof head), pts, ids, table, n, sources, head.sources);
	memcpy(room + used - head.sources * sizeof *sources, sources, head.sources * sizeof *sources);
	memset(room + used, 0, DISK_RUN_BLOCK - used);
	memcpy(room, &head, sizeof head);
	head.check = grid_check(room + 8, DISK_RUN_BLOCK - 8, place);
	memcpy(room, &head, sizeof head);
	grid_file_commit(&w->file, DISK_RUN_BLOCK);
	w->records += n;
	w->blocks++;
	*ret_n = n;
	return 0;
}

int grid_run_add(struct grid_run_writer *w, const struct point *pts, const uint32_t *ids, const uint32_t *table, size_t n,
		 bool end, size_t *ret_taken, struct err *err)
{
	size_t at = 0, part;

	for (; n - at >= DISK_RUN_RECORDS || (end && at < n); at += part) {
		int rc = put_block(w, pts + at, ids ? ids + at : NULL, table, n - at, &part, err);

		if (rc)
			return rc;
	}
	*ret_taken = at;
	return 0;
}

int grid_run_finish(struct grid_run_writer *w, bool durable, uint64_t *ret_records, struct err *err)
{
	union {
		struct disk_run head;
		uint8_t bytes[DISK_RUN_BLOCK];
	} u = {.bytes = {0}};

	u.head = (struct disk_run){
		.version = DISK_RUN_VERSION,
		.block_bytes = DISK_RUN_BLOCK,
		.records = w->records,
		.blocks = w->blocks,
		.bytes = grid_file_place(&w->file),
	};
	memcpy(u.head.magic, DISK_RUN_MAGIC, sizeof u.head.magic);
	u.head.check = grid_check(u.bytes + 8, sizeof u - 8, 0);
	int rc = grid_file_patch(&w->file, 0, &u, sizeof u, err);

	if (rc == 0)
		rc = grid_file_publish(&w->file, durable ? GRID_DURABLE : GRID_TEMPORARY, err);
	if (rc == 0)
		*ret_records = w->records;
	return rc;
}

void grid_run_abort(struct grid_run_writer *w)
{
	grid_file_abort(&w->file);
}

/* ---- an open run ---- */

int grid_run_damaged(const struct grid_run *r, uint64_t place, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "the sorted run is damaged: %s", what);
	err_add_place(err, place, NULL);
	err_add_file(err, r->name);
	return err_add_hint(err, "push the files again, and check the disk");
}

/* Reads n bytes of the file; if it ends before, it is damaged. */
static int read_bytes(const struct grid_run *r, void *to, size_t n, uint64_t place, struct err *err)
{
	int rc = io_read_at(r->fd, to, n, place, r->name, err);

	if (rc != -ERR_TRUNCATED)
		return rc;
	err_clear(err);
	return grid_run_damaged(r, place, "it is cut off", err);
}

static int read_header(struct grid_run *r, struct err *err)
{
	union {
		struct disk_run head;
		uint8_t bytes[DISK_RUN_BLOCK];
	} u;
	const struct disk_run *h = &u.head;
	struct stat st;
	int rc = read_bytes(r, &u, sizeof u, 0, err);

	if (rc)
		return rc;
	if (h->version > DISK_RUN_VERSION && h->check == grid_check(u.bytes + 8, sizeof u - 8, 0) &&
	    !memcmp(h->magic, DISK_RUN_MAGIC, sizeof h->magic)) {
		err_set(err, ERR_VERSION, "a sorted run of version %u; this acut reads up to version %d", h->version,
			DISK_RUN_VERSION);
		return err_add_file(err, r->name);
	}
	if (h->check != grid_check(u.bytes + 8, sizeof u - 8, 0) || memcmp(h->magic, DISK_RUN_MAGIC, sizeof h->magic) ||
	    h->version != DISK_RUN_VERSION || h->block_bytes != DISK_RUN_BLOCK)
		return grid_run_damaged(r, 0, "its header is invalid", err);
	if (io->fstat(r->fd, &st) != 0) {
		err_sys(err, errno, "cannot look at");
		return err_add_file(err, r->name);
	}
	if ((uint64_t)st.st_size != h->bytes || h->blocks != h->bytes / DISK_RUN_BLOCK - 1)
		return grid_run_damaged(r, 0, "its size differs from its header", err);
	r->records = h->records;
	r->blocks = h->blocks;
	return 0;
}

int grid_run_open(struct grid_run *r, int dirfd, const char *name, bool consumed, struct err *err)
{
	*r = GRID_RUN_INIT;
	snprintf(r->name, sizeof r->name, "%s", name);
	int rc = io_open(dirfd, name, consumed ? O_RDWR : O_RDONLY, 0, &r->fd, err);

	if (rc == 0)
		rc = read_header(r, err);
	if (rc)
		grid_run_close(r);
	return rc;
}

void grid_run_close(struct grid_run *r)
{
	r->fd = io_close(r->fd);
}

static uint64_t place_of(uint64_t block)
{
	return (block + 1) * DISK_RUN_BLOCK;
}

int grid_run_key(const struct grid_run *r, uint64_t block, uint64_t *ret_key, struct err *err)
{
	struct point first;
	int rc = read_bytes(r, &first, sizeof first, place_of(block) + sizeof(struct disk_run_block), err);

	if (rc == 0)
		*ret_key = point_morton(first.x, first.y);
	return rc;
}

int grid_run_find(const struct grid_run *r, uint64_t from, uint64_t key, uint64_t *ret_block, struct err *err)
{
	uint64_t to = from, step = 1, at = 0;
	int rc = 0;

	/* A galloping search from `from`: the blocks that it reads are near, and are read soon anyway. */
	while (rc == 0 && to < r->blocks) {
		rc = grid_run_key(r, to, &at, err);
		if (rc || at >= key)
			break;
		from = to + 1;
		to += step;
		step *= 2;
	}
	to = to < r->blocks ? to : r->blocks;
	while (rc == 0 && from < to) {
		uint64_t mid = from + (to - from) / 2;

		rc = grid_run_key(r, mid, &at, err);
		if (at < key)
			from = mid + 1;
		else
			to = mid;
	}
	if (rc == 0)
		*ret_block = from;
	return rc;
}

/* ---- reading blocks ---- */

void grid_run_read(struct grid_run_reader *r, const struct grid_run *run, uint64_t first, uint64_t end, void *buffer,
		   unsigned cap)
{
	*r = (struct grid_run_reader){.run = run, .next = first, .end = end, .buf = buffer, .cap = cap};
}

int grid_run_next(struct grid_run_reader *r, const struct point **ret_pts, size_t *ret_n, const uint32_t **ret_ids,
		  struct err *err)
{
	*ret_n = 0;
	if (r->at == r->have) {
		uint64_t left = r->end - r->next;
		unsigned n = left < r->cap ? (unsigned)left : r->cap;

		if (!n)
			return 0;
		int rc = read_bytes(r->run, r->buf, n * (size_t)DISK_RUN_BLOCK, place_of(r->next), err);

		if (rc)
			return rc;
		r->next += n;
		r->have = n;
		r->at = 0;
	}
	const uint8_t *block = r->buf + r->at * (size_t)DISK_RUN_BLOCK;
	uint64_t place = place_of(r->next - r->have + r->at);
	struct disk_run_block head;

	memcpy(&head, block, sizeof head);
	if (head.check != grid_check(block + 8, DISK_RUN_BLOCK - 8, place))
		return grid_run_damaged(r->run, place, "the checksum of a block does not agree", err);
	if (!head.records || !head.sources || disk_run_used(head.records, head.sources) > DISK_RUN_BLOCK)
		return grid_run_damaged(r->run, place, "a block has an impossible size", err);
	const struct point *pts = (const struct point *)(block + sizeof head);

	for (size_t i = 0; i < head.records; i++)
		if (point_source(&pts[i]) >= head.sources)
			return grid_run_damaged(r->run, place, "a record has no source", err);
	*ret_pts = pts;
	*ret_n = head.records;
	*ret_ids = (const uint32_t *)(pts + head.records);
	r->at++;
	return 0;
}
