/*
 * Sorted runs of version 1: a header of 64 bytes, then blocks of different sizes, each with up to 4,096 records and a
 * table of their sources. Suspended pushes of an older acutd have them. Resuming such a push first converts its runs to
 * this version, under new numbers, so the old runs exist until the new ones do.
 */
#include "grid_run_old.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_block.h"
#include "grid_run.h"
#include "io.h"

enum { OLD_HEADER = 64, OLD_RECORDS = 4096, OLD_BLOCK_MAX = 16 + OLD_RECORDS * (4 + sizeof(struct point)) };

struct old_block {
	uint64_t check; /* of the other bytes of the block; seed: its place */
	uint32_t records, sources;
};
_Static_assert(sizeof(struct old_block) == 16, "format.md");

struct converter {
	int fd;
	const char *name;
	uint64_t at, bytes, records;
	uint8_t *block;    /* OLD_BLOCK_MAX */
	struct point *pts; /* records of a block, behind those of the last one that were not written yet */
	uint32_t *ids;
	size_t n;
	uint8_t *buffer; /* of the writer */
};

static int damaged(const char *name, uint64_t place, const char *what, struct err *err)
{
	struct grid_run r = GRID_RUN_INIT;

	snprintf(r.name, sizeof r.name, "%s", name);
	return grid_run_damaged(&r, place, what, err);
}

static int read_header(int fd, const char *name, bool *ret_older, struct disk_run *ret, struct err *err)
{
	union {
		struct disk_run head;
		uint8_t bytes[DISK_RUN_BLOCK];
	} u;
	size_t got = 0;
	struct stat st;
	bool whole, first;
	int rc = io_read_some(fd, &u, sizeof u, 0, name, &got, err);

	if (rc)
		return rc;
	if (got < OLD_HEADER || memcmp(u.head.magic, DISK_RUN_MAGIC, sizeof u.head.magic))
		return damaged(name, 0, "its header is invalid", err);
	whole = got == sizeof u && u.head.check == grid_check(u.bytes + 8, sizeof u - 8, 0);
	first = u.head.check == grid_check(u.bytes + 8, OLD_HEADER - 8, 0);
	if (u.head.version > DISK_RUN_VERSION && (whole || first)) {
		err_set(err, ERR_VERSION, "a sorted run of version %u; this acut reads up to version %d", u.head.version,
			DISK_RUN_VERSION);
		return err_add_file(err, name);
	}
	*ret_older = first && u.head.version == 1;
	if (!*ret_older && (!whole || u.head.version != DISK_RUN_VERSION))
		return damaged(name, 0, "its header is invalid", err);
	if (io->fstat(fd, &st) != 0) {
		err_sys(err, errno, "cannot look at");
		return err_add_file(err, name);
	}
	if ((uint64_t)st.st_size != u.head.bytes || u.head.block_bytes != (*ret_older ? OLD_RECORDS : DISK_RUN_BLOCK))
		return damaged(name, 0, "its size differs from its header", err);
	*ret = u.head;
	return 0;
}

int grid_run_check(int dirfd, const char *name, bool *ret_older, uint64_t *ret_bytes, struct err *err)
{
	struct disk_run head;
	int fd, rc = io_open(dirfd, name, O_RDONLY, 0, &fd, err);

	if (rc)
		return rc;
	rc = read_header(fd, name, ret_older, &head, err);
	io_close(fd);
	if (rc == 0)
		*ret_bytes = head.bytes;
	return rc;
}

/* Reads the next block and appends its records. */
static int read_block(struct converter *c, struct err *err)
{
	struct old_block head;
	size_t head_bytes, bytes;
	const uint32_t *sources = (const uint32_t *)(c->block + sizeof head);
	const struct point *pts;
	int rc;

	if (c->bytes - c->at < sizeof head)
		return damaged(c->name, c->at, "a block is cut off", err);
	rc = io_read_at(c->fd, &head, sizeof head, c->at, c->name, err);
	if (rc)
		return rc;
	if (!head.records || head.records > OLD_RECORDS || !head.sources || head.sources > OLD_RECORDS)
		return damaged(c->name, c->at, "a block has an impossible size", err);
	head_bytes = disk_align(sizeof head + head.sources * sizeof *sources);
	bytes = head_bytes + head.records * sizeof *pts;
	if (bytes > c->bytes - c->at)
		return damaged(c->name, c->at, "a block reaches beyond the end", err);
	rc = io_read_at(c->fd, c->block, bytes, c->at, c->name, err);
	if (rc)
		return rc;
	if (head.check != grid_check(c->block + 8, bytes - 8, c->at))
		return damaged(c->name, c->at, "the checksum of a block does not agree", err);
	pts = (const struct point *)(c->block + head_bytes);
	for (size_t i = 0; i < head.records; i++) {
		if (point_source(&pts[i]) >= head.sources)
			return damaged(c->name, c->at, "a record has no source", err);
		c->pts[c->n] = pts[i];
		c->ids[c->n++] = sources[point_source(&pts[i])];
	}
	c->at += bytes;
	return 0;
}

static int copy(struct converter *c, struct grid_run_writer *w, bool durable, struct err *err)
{
	uint64_t written = 0, seen = 0;
	size_t taken;
	int rc = 0;

	while (rc == 0 && (c->at < c->bytes || c->n)) {
		size_t before = c->n;

		if (c->at < c->bytes)
			rc = read_block(c, err);
		seen += c->n - before;
		taken = c->n;
		if (rc == 0 && w)
			rc = grid_run_add(w, c->pts, c->ids, NULL, c->n, c->at == c->bytes, &taken, err);
		if (rc)
			break;
		c->n -= taken;
		memmove(c->pts, c->pts + taken, c->n * sizeof *c->pts);
		memmove(c->ids, c->ids + taken, c->n * sizeof *c->ids);
	}
	if (rc == 0 && seen != c->records)
		rc = damaged(c->name, c->at, "the number of its records differs from its header", err);
	return rc || !w ? rc : grid_run_finish(w, durable, &written, err);
}

int grid_run_convert(int dirfd, const char *name, const char *to, bool durable, struct err *err)
{
	enum { BUFFER = 8 * DISK_RUN_BLOCK, ROOM = OLD_RECORDS + DISK_RUN_RECORDS };
	struct converter c = {.name = name, .at = OLD_HEADER};
	struct disk_run head;
	struct grid_run_writer w;
	bool older = false;
	int rc = io_open(dirfd, name, O_RDONLY, 0, &c.fd, err);

	if (rc)
		return rc;
	rc = read_header(c.fd, name, &older, &head, err);
	if (rc == 0 && !older)
		rc = err_set(err, ERR_INTERNAL, "the sorted run %s is not of an older version", name);
	if (rc == 0) {
		c.records = head.records;
		c.bytes = head.bytes;
		c.block = aligned_alloc(16, disk_align(OLD_BLOCK_MAX));
		c.pts = malloc(ROOM * sizeof *c.pts);
		c.ids = malloc(ROOM * sizeof *c.ids);
		c.buffer = aligned_alloc(16, BUFFER);
		if (!c.block || !c.pts || !c.ids || !c.buffer)
			rc = err_set(err, ERR_NOMEM, "no memory to read a run of an older version");
	}
	if (rc == 0 && !to)
		rc = copy(&c, NULL, false, err);
	else if (rc == 0)
		rc = grid_run_begin(&w, dirfd, to, c.buffer, BUFFER, err);
	if (rc == 0 && to) {
		rc = copy(&c, &w, durable, err);
		grid_run_abort(&w);
	}
	io_close(c.fd);
	free(c.block);
	free(c.pts);
	free(c.ids);
	free(c.buffer);
	return rc;
}
