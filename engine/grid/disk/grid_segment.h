/* An open segment file: its header, table of sources and index pages, checked when they are read. */
#ifndef GRID_SEGMENT_H
#define GRID_SEGMENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "grid_disk.h"
#include "grid_segment_info.h"

struct err;

struct grid_segment {
	int fd;
	const char *name;
	uint64_t bytes, cells;
	uint64_t root, root_check;
	uint32_t height;
	int32_t box[4];  /* of its points */
	uint64_t lo, hi; /* the keys of all points are between them */
};

/* All that the manifest says of it; root and file are not known. */
void grid_segment_describe(struct grid_segment *, const struct grid_segment_info *);
/* Reads the header of its open file, and checks it against what the manifest records. */
int grid_segment_header(struct grid_segment *, const struct grid_segment_info *, struct disk_segment *ret, struct err *err);

/* Opens it and checks its header against what the manifest records. On failure s->fd may be open. */
int grid_segment_open(struct grid_segment *s, int dirfd, const struct grid_segment_info *, struct disk_segment *ret,
		      struct err *err);
/* Reads its table of sources, to be freed. */
int grid_segment_sources(const struct grid_segment *, const struct disk_segment *, struct disk_total **ret, struct err *err);
/* Reads n bytes; -ERR_CORRUPT if the file ends before. */
int grid_segment_read(const struct grid_segment *, void *buf, size_t n, uint64_t place, struct err *err);
/* Reads an index page (DISK_PAGE bytes) and checks it against the checksum in the entry above it. */
int grid_segment_page(const struct grid_segment *, unsigned level, uint64_t place, uint64_t check, uint8_t *page,
		      struct err *err);
/* -ERR_CORRUPT if this entry of a page of level 0 cannot be a cell of the segment. */
int grid_segment_check_leaf(const struct grid_segment *, const struct disk_leaf *, struct err *err);
/* Sets the error: -ERR_CORRUPT, with place and fault. */
int grid_segment_damaged(const struct grid_segment *, uint64_t place, const char *what, struct err *err);

/* ---- index pages ---- */

/* Adds the totals of another entry of the same level, which follows. */
void grid_inner_add(struct disk_inner *sum, const struct disk_inner *next);

/* Levels of an index of so many cells. */
unsigned grid_index_levels(uint64_t cells);

static inline unsigned grid_page_entries(const uint8_t *page)
{
	return ((const struct disk_page *)page)->entries;
}

static inline const struct disk_leaf *grid_page_leaf(const uint8_t *page, unsigned i)
{
	return (const struct disk_leaf *)(page + sizeof(struct disk_page)) + i;
}

static inline const struct disk_inner *grid_page_inner(const uint8_t *page, unsigned i)
{
	return (const struct disk_inner *)(page + sizeof(struct disk_page)) + i;
}

/* The first entry whose range ends at `from` or later; the number of entries if there is none. */
static inline unsigned grid_page_find(const uint8_t *page, bool inner, uint64_t from)
{
	unsigned a = 0, b = grid_page_entries(page);

	while (a < b) {
		unsigned mid = a + (b - a) / 2;
		const struct disk_leaf *leaf = grid_page_leaf(page, mid);

		if ((inner ? grid_page_inner(page, mid)->hi : disk_range_end(leaf->lo, leaf->bits)) < from)
			a = mid + 1;
		else
			b = mid;
	}
	return a;
}

#endif
