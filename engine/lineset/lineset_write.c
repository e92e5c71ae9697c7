/*
 * Writing a line set file: pieces in the order of the Morton keys of their middles, packed into pages, and the levels of boxes
 * above them (format.md, "Line sets"). The tree is made in memory, which takes 1/4 byte for each piece, so that the states of its
 * boxes can be found with it.
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
	const struct lineset_piece *piece;
	struct lineset_inner *entry; /* one for each page, as the pages */
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

/* ---- the tree ---- */

/* The entry of page i of a level. */
static struct lineset_inner *entry_of(const struct writer *w, unsigned level, uint64_t i)
{
	return &w->entry[w->shape.first[level] + i];
}

static void make_entries(struct writer *w)
{
	for (unsigned level = 0; level < w->shape.height; level++)
		for (uint64_t i = 0; i < w->shape.pages[level]; i++) {
			struct lineset_inner *e = entry_of(w, level, i);
			unsigned n = lineset_shape_entries(&w->shape, level, i);

			*e = NOTHING;
			for (unsigned k = 0; k < n; k++) {
				const struct lineset_piece *p = &w->piece[i * LINESET_PIECES + k];
				const struct lineset_inner *below =
					level ? entry_of(w, level - 1, i * LINESET_ENTRIES + k) : NULL;
				int32_t box[4];

				if (level) {
					entry_join(e, below->box, (struct digest){below->sum_hi, below->sum_lo}, below->turns);
					continue;
				}
				piece_box(p, box);
				entry_join(e, box, lineset_piece_sum(p), p->turns);
			}
		}
}

static void follow(const struct writer *w, unsigned level, uint64_t i, const int32_t box[4], struct lineset_path *t)
{
	const struct lineset_inner *e = entry_of(w, level, i);
	unsigned n = lineset_shape_entries(&w->shape, level, i);

	if (!e->turns || !lineset_boxes_meet(e->box, box))
		return;
	for (unsigned k = 0; k < n; k++)
		if (level)
			follow(w, level - 1, i * LINESET_ENTRIES + k, box, t);
		else if (lineset_meets(&w->piece[i * LINESET_PIECES + k], box))
			lineset_path_turn(t, &w->piece[i * LINESET_PIECES + k]);
}

/* From the corner of one box to that of the next one, which is near. The first path begins left of all. */
static void make_states(struct writer *w, unsigned far)
{
	unsigned top = w->shape.height - 1;
	const int32_t *all = entry_of(w, top, 0)->box;
	struct lineset_path t = {.from = {(int64_t)all[0] - 1, all[1]}, .den = 1, .state = far};

	for (uint64_t i = 0; i < w->shape.all; i++) {
		int32_t box[4];

		for (unsigned k = 0; k < 2; k++)
			t.to[k] = w->entry[i].box[k];
		if (lineset_path_box(&t, box))
			follow(w, top, 0, box, &t);
		w->entry[i].state = t.state;
		for (unsigned k = 0; k < 2; k++)
			t.from[k] = t.to[k];
	}
}

/* ---- pages ---- */

static int write_page(struct writer *w, unsigned level, uint64_t i, struct err *err)
{
	_Alignas(8) uint8_t page[LINESET_PAGE] = {0};
	struct lineset_page *head = (struct lineset_page *)page;
	unsigned n = lineset_shape_entries(&w->shape, level, i);

	head->level = (uint16_t)level;
	head->entries = (uint16_t)n;
	if (level)
		memcpy(head + 1, entry_of(w, level - 1, i * LINESET_ENTRIES), n * sizeof *w->entry);
	else
		memcpy(head + 1, &w->piece[i * LINESET_PIECES], n * sizeof *w->piece);
	head->check = grid_check(page + 8, sizeof page - 8, grid_file_place(&w->file));
	entry_of(w, level, i)->check = head->check;
	return grid_file_append(&w->file, page, sizeof page, err);
}

static int write_head(struct writer *w, uint64_t n, unsigned far, struct err *err)
{
	struct lineset_head h = {.magic = LINESET_MAGIC,
				 .version = LINESET_VERSION,
				 .page_bytes = LINESET_PAGE,
				 .pieces = n,
				 .pages = w->shape.all,
				 .height = w->shape.height,
				 .far = far};

	if (n) {
		const struct lineset_inner *root = entry_of(w, w->shape.height - 1, 0);

		h.turns = root->turns;
		memcpy(h.box, root->box, sizeof h.box);
		h.sum_hi = root->sum_hi;
		h.sum_lo = root->sum_lo;
		h.root_check = root->check;
	}
	h.check = grid_check((const uint8_t *)&h + 8, sizeof h - 8, 0);
	return grid_file_patch(&w->file, 0, &h, sizeof h, err);
}

static int write_all(struct writer *w, struct lineset_piece *p, size_t n, unsigned far, struct err *err)
{
	static const uint8_t none[LINESET_PAGE];
	int rc = grid_file_append(&w->file, none, sizeof none, err);

	sort_pieces(p, n);
	w->piece = p;
	make_entries(w);
	if (n)
		make_states(w, far);
	for (unsigned level = 0; level < w->shape.height; level++)
		for (uint64_t i = 0; rc == 0 && i < w->shape.pages[level]; i++)
			rc = write_page(w, level, i, err);
	return rc ? rc : write_head(w, n, far, err);
}

int lineset_write(int dirfd, const char *name, struct lineset_piece *p, size_t n, unsigned far, struct err *err)
{
	struct writer w = {.file = GRID_FILE_INIT};
	uint8_t *buffer = malloc(BUFFER);
	int rc = 0;

	if (!lineset_shape(n, &w.shape))
		rc = err_set(err, ERR_LIMIT, "%zu pieces of lines are too many", n);
	w.entry = malloc((w.shape.all + 1) * sizeof *w.entry);
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
