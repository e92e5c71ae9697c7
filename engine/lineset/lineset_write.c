/*
 * Writing a line set file: pieces in the order of the Morton keys of their middles, packed into pages, and the levels of boxes
 * above them (format.md, "Line sets"). Of the tree only the entries of one level are in memory, 1/4 byte for each piece.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_block.h"
#include "grid_file.h"
#include "lineset_file.h"

enum { BUFFER = 16 * LINESET_PAGE };

/* ---- order ---- */

static uint64_t middle(const struct lineset_piece *p)
{
	return point_morton((int32_t)(((int64_t)p->a[0] + p->b[0]) >> 1), (int32_t)(((int64_t)p->a[1] + p->b[1]) >> 1));
}

/* Pieces of one middle by their ends, so that the file depends on the set alone. */
static bool before(const struct lineset_piece *p, uint64_t pm, const struct lineset_piece *q, uint64_t qm)
{
	if (pm != qm)
		return pm < qm;
	for (unsigned k = 0; k < 2; k++)
		if (p->a[k] != q->a[k])
			return p->a[k] < q->a[k];
	for (unsigned k = 0; k < 2; k++)
		if (p->b[k] != q->b[k])
			return p->b[k] < q->b[k];
	return p->turns < q->turns;
}

static void swap(struct lineset_piece *p, struct lineset_piece *q)
{
	struct lineset_piece t = *p;

	*p = *q;
	*q = t;
}

static void insertion_sort(struct lineset_piece *p, size_t n)
{
	for (size_t i = 1; i < n; i++) {
		struct lineset_piece x = p[i];
		uint64_t m = middle(&x);
		size_t k = i;

		for (; k && before(&x, m, &p[k - 1], middle(&p[k - 1])); k--)
			p[k] = p[k - 1];
		p[k] = x;
	}
}

/* Quicksort in place. Pivots are drawn, always in the same way, so that no order of the input is slow. */
static void sort_pieces(struct lineset_piece *p, size_t n)
{
	uint64_t draw = n;

	while (n > 16) {
		size_t i = 0, j = n - 1;
		struct lineset_piece pivot;
		uint64_t m;

		draw = draw * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
		pivot = p[(draw >> 32) % n];
		m = middle(&pivot);
		for (;; i++, j--) {
			while (before(&p[i], middle(&p[i]), &pivot, m))
				i++;
			while (before(&pivot, m, &p[j], middle(&p[j])))
				j--;
			if (i >= j)
				break;
			swap(&p[i], &p[j]);
		}
		/* Of equal pieces all may be on one side, but both sides are smaller than the whole. */
		j += j + 1 < n;
		if (j <= n - j) {
			sort_pieces(p, j);
			p += j;
			n -= j;
		} else {
			sort_pieces(p + j, n - j);
			n = j;
		}
	}
	insertion_sort(p, n);
}

/* ---- pages ---- */

struct writer {
	struct grid_file file;
	struct lineset_shape shape;
	struct lineset_inner *entry; /* of the level that was written last: one for each page */
};

static void entry_join(struct lineset_inner *e, const int32_t box[4], struct digest sum, uint32_t turns)
{
	struct digest all = {e->sum_hi, e->sum_lo};

	point_box_join(e->box, box);
	digest_add(&all, sum);
	e->sum_hi = all.hi;
	e->sum_lo = all.lo;
	e->turns |= turns;
}

static const struct lineset_inner NOTHING = {.box = {INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN}};

static void piece_box(const struct lineset_piece *p, int32_t box[4])
{
	box[0] = p->a[0];
	box[1] = p->a[1] < p->b[1] ? p->a[1] : p->b[1];
	box[2] = p->b[0];
	box[3] = p->a[1] < p->b[1] ? p->b[1] : p->a[1];
}

/* Writes a page with these entries, and sets the check in the entry of the level above. */
static int write_page(struct writer *w, unsigned level, unsigned n, const void *entries, size_t bytes, struct lineset_inner *ret,
		      struct err *err)
{
	_Alignas(8) uint8_t page[LINESET_PAGE] = {0};
	struct lineset_page *head = (struct lineset_page *)page;

	head->level = (uint16_t)level;
	head->entries = (uint16_t)n;
	memcpy(head + 1, entries, bytes);
	head->check = grid_check(page + 8, sizeof page - 8, grid_file_place(&w->file));
	ret->check = head->check;
	return grid_file_append(&w->file, page, sizeof page, err);
}

static int write_pieces(struct writer *w, const struct lineset_piece *p, struct err *err)
{
	int rc = 0;

	for (uint64_t i = 0; rc == 0 && i < w->shape.pages[0]; i++) {
		unsigned n = lineset_shape_entries(&w->shape, 0, i);

		w->entry[i] = NOTHING;
		for (unsigned k = 0; k < n; k++) {
			int32_t box[4];

			piece_box(&p[k], box);
			entry_join(&w->entry[i], box, lineset_piece_sum(&p[k]), p[k].turns);
		}
		rc = write_page(w, 0, n, p, n * sizeof *p, &w->entry[i], err);
		p += n;
	}
	return rc;
}

/* The entries of a level take the places of those of the level below. */
static int write_level(struct writer *w, unsigned level, struct err *err)
{
	const struct lineset_inner *below = w->entry;
	int rc = 0;

	for (uint64_t i = 0; rc == 0 && i < w->shape.pages[level]; i++) {
		unsigned n = lineset_shape_entries(&w->shape, level, i);
		struct lineset_inner sum = NOTHING;

		for (unsigned k = 0; k < n; k++)
			entry_join(&sum, below[k].box, (struct digest){below[k].sum_hi, below[k].sum_lo}, below[k].turns);
		rc = write_page(w, level, n, below, n * sizeof *below, &sum, err);
		below += n;
		w->entry[i] = sum;
	}
	return rc;
}

static int write_head(struct writer *w, uint64_t n, unsigned far, struct err *err)
{
	struct lineset_head h = {.magic = LINESET_MAGIC,
				 .version = LINESET_VERSION,
				 .page_bytes = LINESET_PAGE,
				 .pieces = n,
				 .pages = w->shape.all,
				 .height = w->shape.height,
				 .far = far,
				 .areas = far != 0};

	if (n) {
		h.areas = h.areas || w->entry->turns;
		memcpy(h.box, w->entry->box, sizeof h.box);
		h.sum_hi = w->entry->sum_hi;
		h.sum_lo = w->entry->sum_lo;
		h.root_check = w->entry->check;
	}
	h.check = grid_check((const uint8_t *)&h + 8, sizeof h - 8, 0);
	return grid_file_patch(&w->file, 0, &h, sizeof h, err);
}

static int write_all(struct writer *w, struct lineset_piece *p, size_t n, unsigned far, struct err *err)
{
	static const uint8_t none[LINESET_PAGE];
	int rc = grid_file_append(&w->file, none, sizeof none, err);

	sort_pieces(p, n);
	if (rc == 0)
		rc = write_pieces(w, p, err);
	for (unsigned level = 1; rc == 0 && level < w->shape.height; level++)
		rc = write_level(w, level, err);
	if (rc == 0)
		rc = write_head(w, n, far, err);
	return rc;
}

int lineset_write(int dirfd, const char *name, struct lineset_piece *p, size_t n, unsigned far, struct err *err)
{
	struct writer w = {.file = GRID_FILE_INIT};
	uint8_t *buffer = malloc(BUFFER);
	int rc = 0;

	if (!lineset_shape(n, &w.shape))
		rc = err_set(err, ERR_LIMIT, "%zu pieces of lines are too many", n);
	w.entry = malloc((w.shape.pages[0] + 1) * sizeof *w.entry);
	if (rc == 0 && (!buffer || !w.entry))
		rc = err_set(err, ERR_NOMEM, "no memory to write lines");
	if (rc == 0)
		rc = grid_file_create(&w.file, dirfd, name, buffer, BUFFER, err);
	if (rc == 0)
		rc = write_all(&w, p, n, far, err);
	if (rc == 0)
		rc = grid_file_publish(&w.file, GRID_DURABLE, err);
	grid_file_abort(&w.file);
	free(w.entry);
	free(buffer);
	return rc;
}
