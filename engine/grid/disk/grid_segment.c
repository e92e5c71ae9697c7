/*
 * Reads the header, the table of sources and the index pages of a segment. Everything is checked before it is used:
 * against its own checksum, and against the checksum in whatever points to it, so a stale or exchanged page fails too.
 */
#include "grid_segment.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_block.h"
#include "grid_file.h"
#include "io.h"

int grid_segment_damaged(const struct grid_segment *p, uint64_t place, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "the segment is damaged: %s", what);
	err_add_place(err, place, NULL);
	err_add_file(err, p->name);
	return err_add_hint(err, "check the disk, and restore the file or push its data again");
}

int grid_segment_read(const struct grid_segment *p, void *buf, size_t n, uint64_t place, struct err *err)
{
	if (place > p->bytes || n > p->bytes - place)
		return grid_segment_damaged(p, place, "a part extends beyond its end", err);
	int rc = io_read_at(p->fd, buf, n, place, p->name, err);

	if (rc != -ERR_TRUNCATED)
		return rc;
	err_clear(err);
	return grid_segment_damaged(p, place, "it ends too early", err);
}

unsigned grid_index_levels(uint64_t cells)
{
	unsigned levels = 0;

	for (uint64_t n = cells; n > 1 || (n && !levels); levels++)
		n = n / DISK_ENTRIES + (n % DISK_ENTRIES != 0);
	return levels;
}

static int check_header(const struct grid_segment *p, const struct disk_segment *h, const struct grid_segment_info *info,
			struct err *err)
{
	struct stat st;

	if (h->check != grid_check((const uint8_t *)h + 8, DISK_HEADER - 8, 0) ||
	    memcmp(h->magic, DISK_SEGMENT_MAGIC, sizeof h->magic))
		return grid_segment_damaged(p, 0, "its header is invalid", err);
	if (h->version != DISK_VERSION || h->header_bytes != DISK_HEADER || h->page_bytes != DISK_PAGE ||
	    h->cell_records != GRID_CELL_RECORDS) {
		err_set(err, ERR_VERSION, "a segment of version %u; this acut reads version %u", h->version, DISK_VERSION);
		return err_add_file(err, p->name);
	}
	if (h->points != info->points || h->cells != info->cells || h->bytes != info->bytes || h->sum_hi != info->sum.hi ||
	    h->sum_lo != info->sum.lo || memcmp(h->box, info->box, sizeof h->box) ||
	    memcmp(h->classes, info->classes, sizeof h->classes))
		return grid_segment_damaged(p, 0, "it is not the segment that the manifest describes", err);
	if (io->fstat(p->fd, &st) != 0) {
		err_sys(err, errno, "cannot look at");
		return err_add_file(err, p->name);
	}
	if ((uint64_t)st.st_size != h->bytes)
		return grid_segment_damaged(p, 0, "its size differs from its header", err);
	if (h->height != grid_index_levels(h->cells) || !h->points != !h->cells || h->cells > h->points ||
	    h->sources > h->points || h->sources_place > h->bytes || h->sources_place < DISK_HEADER ||
	    h->bytes - h->sources_place != h->sources * sizeof(struct disk_total))
		return grid_segment_damaged(p, 0, "its header contradicts itself", err);
	return 0;
}

void grid_segment_describe(struct grid_segment *p, const struct grid_segment_info *info)
{
	*p = (struct grid_segment){.fd = -1,
				   .name = info->file,
				   .bytes = info->bytes,
				   .cells = info->cells,
				   .height = grid_index_levels(info->cells),
				   .lo = info->lo,
				   .hi = info->hi};
	memcpy(p->box, info->box, sizeof p->box);
}

int grid_segment_header(struct grid_segment *p, const struct grid_segment_info *info, struct disk_segment *h, struct err *err)
{
	int rc = grid_segment_read(p, h, sizeof *h, 0, err);

	if (rc == 0)
		rc = check_header(p, h, info, err);
	if (rc)
		return rc;
	p->root = h->root;
	p->root_check = h->root_check;
	return 0;
}

int grid_segment_open(struct grid_segment *p, int dirfd, const struct grid_segment_info *info, struct disk_segment *h,
		      struct err *err)
{
	grid_segment_describe(p, info);
	int rc = grid_file_open(dirfd, p->name, "the segment", &p->fd, err);

	return rc ? rc : grid_segment_header(p, info, h, err);
}

int grid_segment_sources(const struct grid_segment *p, const struct disk_segment *h, struct disk_total **ret, struct err *err)
{
	size_t bytes = h->sources * sizeof(struct disk_total);
	struct disk_total *totals = malloc(bytes ? bytes : 1);
	uint64_t points = 0;

	if (!totals)
		return err_set(err, ERR_NOMEM, "no memory for a table of %u sources", h->sources);
	int rc = grid_segment_read(p, totals, bytes, h->sources_place, err);

	if (rc == 0 && grid_check(totals, bytes, h->sources_place) != h->sources_check)
		rc = grid_segment_damaged(p, h->sources_place, "the checksum of its table of sources does not agree", err);
	for (uint32_t i = 0; rc == 0 && i < h->sources; i++) {
		if (totals[i].id <= (i ? totals[i - 1].id : 0))
			rc = grid_segment_damaged(p, h->sources_place, "its table of sources is not in order", err);
		points += totals[i].points;
	}
	if (rc == 0 && points != h->points)
		rc = grid_segment_damaged(p, h->sources_place, "its table of sources does not add up", err);
	if (rc) {
		free(totals);
		return rc;
	}
	*ret = totals;
	return 0;
}

int grid_segment_page(const struct grid_segment *p, unsigned level, uint64_t place, uint64_t check, uint8_t *page,
		      struct err *err)
{
	const struct disk_page *head = (const struct disk_page *)page;
	int rc = grid_segment_read(p, page, DISK_PAGE, place, err);

	if (rc)
		return rc;
	if (head->check != check || check != grid_check(page + 8, DISK_PAGE - 8, place))
		return grid_segment_damaged(p, place, "the checksum of an index page does not agree", err);
	if (head->magic != DISK_PAGE_MAGIC || head->level != level || !head->entries || head->entries > DISK_ENTRIES)
		return grid_segment_damaged(p, place, "an index page has invalid fields", err);
	return 0;
}

int grid_segment_check_leaf(const struct grid_segment *p, const struct disk_leaf *leaf, struct err *err)
{
	if (leaf->bits > 64 || (leaf->lo & disk_range_end(0, leaf->bits)) || leaf->place % DISK_ALIGN || !leaf->blocks ||
	    !leaf->count || leaf->head_bytes > DISK_HEAD_MAX || leaf->count > (uint64_t)leaf->blocks * GRID_CELL_RECORDS ||
	    leaf->place > p->bytes || leaf->bytes > p->bytes - leaf->place)
		return grid_segment_damaged(p, leaf->place, "an index entry has invalid fields", err);
	return 0;
}

void grid_inner_add(struct disk_inner *sum, const struct disk_inner *next)
{
	sum->hi = next->hi;
	sum->count += next->count;
	sum->distinct += next->distinct;
	sum->cells += next->cells;
	sum->sum_hi += next->sum_hi;
	sum->sum_lo += next->sum_lo;
	point_box_join(sum->box, next->box);
}
