/*
 * An open segment: its header and its table of sources, checked. What cells it has: grid_reader.c, grid_rewrite.c.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_file.h"
#include "grid_read.h"
#include "io.h"

int grid_damaged(const struct grid_part *p, uint64_t place, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "the segment is damaged: %s", what);
	err_add_place(err, place, NULL);
	err_add_file(err, p->name);
	return err_add_hint(err, "check the disk, and restore the file or push its data again");
}

int grid_part_read(const struct grid_part *p, void *buf, size_t n, uint64_t place, struct err *err)
{
	if (place > p->bytes || n > p->bytes - place)
		return grid_damaged(p, place, "something reaches beyond its end", err);
	int rc = io_read_at(p->fd, buf, n, place, p->name, err);

	if (rc != -ERR_TRUNCATED)
		return rc;
	err_clear(err);
	return grid_damaged(p, place, "it ends too early", err);
}

/* ---- segments ---- */

unsigned grid_levels(uint64_t cells)
{
	unsigned levels = 0;

	for (uint64_t n = cells; n > 1 || (n && !levels); levels++)
		n = n / DISK_ENTRIES + (n % DISK_ENTRIES != 0);
	return levels;
}

static int check_header(const struct grid_part *p, const struct disk_segment *h, const struct grid_segment_info *info,
			struct err *err)
{
	struct stat st;

	if (h->check != grid_check((const uint8_t *)h + 8, DISK_HEADER - 8, 0) ||
	    memcmp(h->magic, DISK_SEGMENT_MAGIC, sizeof h->magic))
		return grid_damaged(p, 0, "its header is not one", err);
	if (h->version != DISK_VERSION || h->header_bytes != DISK_HEADER || h->page_bytes != DISK_PAGE ||
	    h->cell_records != GRID_CELL_RECORDS) {
		err_set(err, ERR_VERSION, "a segment of version %u; this acut reads version %u", h->version, DISK_VERSION);
		return err_add_file(err, p->name);
	}
	if (h->points != info->points || h->cells != info->cells || h->bytes != info->bytes || h->sum_hi != info->sum.hi ||
	    h->sum_lo != info->sum.lo || memcmp(h->box, info->box, sizeof h->box) ||
	    memcmp(h->classes, info->classes, sizeof h->classes))
		return grid_damaged(p, 0, "it is not the one that the manifest means", err);
	if (io->fstat(p->fd, &st) != 0) {
		err_sys(err, errno, "cannot look at");
		return err_add_file(err, p->name);
	}
	if ((uint64_t)st.st_size != h->bytes)
		return grid_damaged(p, 0, "its size is not what its header says", err);
	if (h->height != grid_levels(h->cells) || !h->points != !h->cells || h->cells > h->points || h->sources > h->points ||
	    h->sources_place > h->bytes || h->sources_place < DISK_HEADER ||
	    h->bytes - h->sources_place != h->sources * sizeof(struct disk_total))
		return grid_damaged(p, 0, "its header contradicts itself", err);
	return 0;
}

int grid_part_open(struct grid_part *p, int dirfd, const struct grid_segment_info *info, struct disk_segment *h, struct err *err)
{
	p->name = info->file;
	int rc = grid_file_open(dirfd, p->name, "the segment", &p->fd, err);

	if (rc)
		return rc;
	p->bytes = DISK_HEADER; /* until the header says more */
	rc = grid_part_read(p, h, sizeof *h, 0, err);
	if (rc == 0)
		rc = check_header(p, h, info, err);
	if (rc)
		return rc;
	p->bytes = h->bytes;
	p->cells = h->cells;
	p->root = h->root;
	p->root_check = h->root_check;
	p->height = h->height;
	memcpy(p->box, h->box, sizeof p->box);
	p->lo = point_morton(h->box[0], h->box[1]);
	p->hi = point_morton(h->box[2], h->box[3]);
	return 0;
}

int grid_part_sources(const struct grid_part *p, const struct disk_segment *h, struct disk_total **ret, struct err *err)
{
	size_t bytes = h->sources * sizeof(struct disk_total);
	struct disk_total *totals = malloc(bytes ? bytes : 1);
	uint64_t points = 0;

	if (!totals)
		return err_set(err, ERR_NOMEM, "no memory for a table of %u sources", h->sources);
	int rc = grid_part_read(p, totals, bytes, h->sources_place, err);

	if (rc == 0 && grid_check(totals, bytes, h->sources_place) != h->sources_check)
		rc = grid_damaged(p, h->sources_place, "the checksum of its table of sources does not agree", err);
	for (uint32_t i = 0; rc == 0 && i < h->sources; i++) {
		if (totals[i].id <= (i ? totals[i - 1].id : 0))
			rc = grid_damaged(p, h->sources_place, "its table of sources is not in order", err);
		points += totals[i].points;
	}
	if (rc == 0 && points != h->points)
		rc = grid_damaged(p, h->sources_place, "its table of sources does not add up", err);
	if (rc) {
		free(totals);
		return rc;
	}
	*ret = totals;
	return 0;
}
