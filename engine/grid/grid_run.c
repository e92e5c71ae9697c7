/*
 * Sorted runs (grid_run.h). A block carries the table of its own sources, so runs can be merged into longer
 * runs without a limit on the number of sources.
 */
#include "grid_run.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_cell.h"
#include "io.h"

int grid_run_begin(struct grid_run_writer *w, int dirfd, const char *name, void *buffer, size_t cap,
		   struct err *err)
{
	uint8_t *room;

	assert(cap >= DISK_RUN_BLOCK_MAX);
	*w = (struct grid_run_writer){.file = GRID_FILE_INIT};
	int rc = grid_file_create(&w->file, dirfd, name, buffer, cap, err);

	if (rc)
		return rc;
	rc = grid_file_reserve(&w->file, DISK_RUN_HEADER, &room, err);
	if (rc)
		return rc;
	memset(room, 0, DISK_RUN_HEADER);
	grid_file_commit(&w->file, DISK_RUN_HEADER);
	return 0;
}

static int by_id(const void *a, const void *b)
{
	uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;

	return x < y ? -1 : x > y;
}

/* The distinct sources of the records, ascending, into `out`. */
static uint32_t collect(const struct point *pts, const uint32_t *ids, const uint32_t *table, size_t n,
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
	qsort(out, count, sizeof *out, by_id);
	for (uint32_t i = 1; i < count; i++)
		if (out[i] != out[at])
			out[++at] = out[i];
	return at + 1;
}

/* One block of n <= DISK_RUN_RECORDS. */
static int put_block(struct grid_run_writer *w, const struct point *pts, const uint32_t *ids,
		     const uint32_t *table, size_t n, struct err *err)
{
	uint32_t sources[DISK_RUN_RECORDS];
	struct disk_run_block head = {.records = (uint32_t)n,
				      .sources = collect(pts, ids, table, n, sources)};
	size_t head_bytes = disk_run_head_bytes(&head), used = sizeof head + head.sources * sizeof *sources;
	size_t bytes = head_bytes + n * sizeof *pts;
	uint64_t place;
	uint8_t *room;
	int rc = grid_file_reserve(&w->file, bytes, &room, err);

	if (rc)
		return rc;
	place = grid_file_place(&w->file);
	memcpy(room + sizeof head, sources, head.sources * sizeof *sources);
	memset(room + used, 0, head_bytes - used);
	struct point *out = (struct point *)(room + head_bytes);

	for (size_t i = 0, at = 0; i < n; i++) {
		out[i] = pts[i];
		if (head.sources > 1) {
			uint32_t id = ids ? ids[i] : table[point_source(&pts[i])];

			if (sources[at] != id)
				at = (size_t)((uint32_t *)bsearch(&id, sources, head.sources, sizeof *sources,
								  by_id) -
					      sources);
		}
		out[i].tag = (uint16_t)(point_flags(&pts[i]) | at << POINT_SOURCE_SHIFT);
	}
	memcpy(room, &head, sizeof head);
	head.check = grid_check(room + 8, bytes - 8, place);
	memcpy(room, &head, sizeof head);
	grid_file_commit(&w->file, bytes);
	w->records += n;
	w->blocks++;
	return 0;
}

int grid_run_add(struct grid_run_writer *w, const struct point *pts, const uint32_t *ids,
		 const uint32_t *table, size_t n, struct err *err)
{
	for (size_t at = 0; at < n;) {
		size_t part = n - at < DISK_RUN_RECORDS ? n - at : DISK_RUN_RECORDS;
		int rc = put_block(w, pts + at, ids ? ids + at : NULL, table, part, err);

		if (rc)
			return rc;
		at += part;
	}
	return 0;
}

int grid_run_finish(struct grid_run_writer *w, bool durable, uint64_t *ret_records, struct err *err)
{
	struct disk_run head = {
	    .version = DISK_VERSION,
	    .block_records = DISK_RUN_RECORDS,
	    .records = w->records,
	    .blocks = w->blocks,
	    .bytes = grid_file_place(&w->file),
	};

	memcpy(head.magic, DISK_RUN_MAGIC, sizeof head.magic);
	head.check = grid_check((uint8_t *)&head + 8, sizeof head - 8, 0);
	int rc = grid_file_patch(&w->file, 0, &head, sizeof head, err);

	if (rc == 0)
		rc = grid_file_publish(&w->file, durable, err);
	if (rc == 0)
		*ret_records = w->records;
	return rc;
}

void grid_run_abort(struct grid_run_writer *w)
{
	grid_file_abort(&w->file);
}

/* ---- reading ---- */

static int damaged(const struct grid_run_reader *r, uint64_t place, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "the sorted run is damaged: %s", what);
	err_add_place(err, place, NULL);
	err_add_file(err, r->name);
	return err_add_hint(err, "push the files again, and check the disk");
}

static int read_header(struct grid_run_reader *r, struct err *err)
{
	struct disk_run head;
	struct stat st;
	int rc = io_read_at(r->fd, &head, sizeof head, 0, r->name, err);

	if (rc == -ERR_TRUNCATED) {
		err_clear(err);
		return damaged(r, 0, "it has no header", err);
	}
	if (rc)
		return rc;
	if (head.check != grid_check((uint8_t *)&head + 8, sizeof head - 8, 0) ||
	    memcmp(head.magic, DISK_RUN_MAGIC, sizeof head.magic) || head.version != DISK_VERSION ||
	    head.block_records != DISK_RUN_RECORDS)
		return damaged(r, 0, "its header is not one", err);
	if (io->fstat(r->fd, &st) != 0) {
		err_sys(err, errno, "cannot look at");
		return err_add_file(err, r->name);
	}
	if ((uint64_t)st.st_size != head.bytes)
		return damaged(r, 0, "its size is not what its header says", err);
	r->bytes = head.bytes;
	r->records = head.records;
	r->at = sizeof head;
	return 0;
}

int grid_run_open(struct grid_run_reader *r, int dirfd, const char *name, void *buffer, struct err *err)
{
	*r = (struct grid_run_reader){.fd = -1, .buf = buffer, .hint = DISK_RUN_BLOCK_MAX};
	snprintf(r->name, sizeof r->name, "%s", name);
	int rc = io_open(dirfd, name, O_RDONLY, 0, &r->fd, err);

	if (rc == 0)
		rc = read_header(r, err);
	if (rc)
		grid_run_close(r);
	return rc;
}

/* The bytes of the next block into the buffer: as many as the last one had, the rest if it is longer. */
static int fetch(struct grid_run_reader *r, struct disk_run_block *ret_head, size_t *ret_bytes,
		 struct err *err)
{
	uint64_t left = r->bytes - r->at;
	size_t got = left < r->hint ? (size_t)left : r->hint;

	if (got < sizeof *ret_head)
		return damaged(r, r->at, "a block is cut off", err);
	int rc = io_read_at(r->fd, r->buf, got, r->at, r->name, err);

	if (rc)
		return rc;
	memcpy(ret_head, r->buf, sizeof *ret_head);
	if (!ret_head->records || ret_head->records > DISK_RUN_RECORDS || !ret_head->sources ||
	    ret_head->sources > DISK_RUN_RECORDS)
		return damaged(r, r->at, "a block has an impossible size", err);
	*ret_bytes = disk_run_head_bytes(ret_head) + ret_head->records * sizeof(struct point);
	if (*ret_bytes > left)
		return damaged(r, r->at, "a block reaches beyond the end", err);
	if (*ret_bytes > got)
		rc = io_read_at(r->fd, r->buf + got, *ret_bytes - got, r->at + got, r->name, err);
	return rc;
}

int grid_run_next(struct grid_run_reader *r, const struct point **ret_pts, size_t *ret_n,
		  const uint32_t **ret_ids, struct err *err)
{
	struct disk_run_block head;
	size_t bytes = 0;

	if (r->at == r->bytes) {
		if (r->seen != r->records)
			return damaged(r, r->at, "it has not as many records as its header says", err);
		*ret_n = 0;
		return 0;
	}
	int rc = fetch(r, &head, &bytes, err);

	if (rc)
		return rc;
	if (head.check != grid_check(r->buf + 8, bytes - 8, r->at))
		return damaged(r, r->at, "the checksum of a block does not agree", err);
	*ret_pts = (const struct point *)(r->buf + disk_run_head_bytes(&head));
	*ret_n = head.records;
	*ret_ids = (const uint32_t *)(r->buf + sizeof head);
	for (size_t i = 0; i < head.records; i++)
		if (point_source(&(*ret_pts)[i]) >= head.sources)
			return damaged(r, r->at, "a record has no source", err);
	r->at += bytes;
	r->hint = bytes;
	r->seen += head.records;
	return 0;
}

void grid_run_close(struct grid_run_reader *r)
{
	r->fd = io_close(r->fd);
}
