/*
 * Points for acut-verify: read by engine/input, converted to the lattice of the mesh, and kept as the view says. All of
 * them in memory, 16 bytes each.
 */
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "check_lines.h"
#include "err.h"
#include "grow.h"
#include "input.h"
#include "io.h"

enum { BATCH = 8192 };

struct batch {
	int64_t raw[BATCH][3];
	int32_t at[BATCH][3];
	uint8_t cls[BATCH], ret[BATCH], flags[BATCH];
};

static int make_room(struct check_points *c, size_t n, struct err *err)
{
	bool there = grow(&c->pts, &c->cap, c->n + n, 16 * BATCH, sizeof *c->pts);

	return there ? 0 : err_set(err, ERR_NOMEM, "no memory for %zu points", c->n + n);
}

static int add_point(struct check_points *c, const struct batch *b, size_t n, const struct view *view, struct err *err)
{
	int rc = make_room(c, n, err);

	if (rc)
		return rc;
	for (size_t i = 0; i < n; i++) {
		struct point p = {b->at[i][0], b->at[i][1], b->at[i][2],
				  b->cls[i],   b->ret[i],   (uint16_t)(b->flags[i] & POINT_FLAGS)};
		enum view_rule rule;

		p.tag |= (uint16_t)(c->slot << POINT_SLOT_SHIFT);
		if (c->lines)
			p.tag |= (uint16_t)check_lines_mark(c->lines, p.x, p.y);
		rule = view_judge(view, &p);

		c->removed[rule]++;
		if (rule == VIEW_KEPT)
			c->pts[c->n++] = p;
	}
	c->read += n;
	return 0;
}

static int read_all(struct check_points *c, struct input *in, struct batch *b, const struct lattice *l, const struct view *view,
		    struct err *err)
{
	struct input_points pts = {.raw = b->raw, .cls = b->cls, .ret = b->ret, .flags = b->flags, .cap = BATCH};
	double shift[3] = {0, 0, 0};
	struct lattice_map map;
	size_t bad;
	int rc = lattice_map_init(&map, l, &input_info(in)->coords, err);

	while (rc == 0 && (rc = input_read(in, &pts, err)) == 0 && pts.n > 0) {
		rc = lattice_map_apply(&map, (const int64_t(*)[3])b->raw, pts.n, b->at, &c->rounded, shift, &bad, err);
		if (rc == 0)
			rc = add_point(c, b, pts.n, view, err);
	}
	return rc;
}

/* Those of classes come first. */
bool check_points_by_class(const struct check_points *c, const struct view *view)
{
	return !c->slot && view->nweight && !view->weight[0].slot;
}

int check_points_read(struct check_points *c, const char *path, const struct lattice *l, const struct view *view, struct err *err)
{
	/* Degrees count as a plane; the push has checked that. */
	const struct input_options options = {.planar = true, .columns = c->columns, .decimal_comma = c->decimal_comma};
	struct input *in = NULL;
	struct batch *b = malloc(sizeof *b);
	int fd = -1, rc;

	if (!b)
		return err_set(err, ERR_NOMEM, "no memory to read a file");
	rc = io_open(AT_FDCWD, path, O_RDONLY, 0, &fd, err);
	if (rc == 0)
		rc = input_open(fd, path, &options, &in, err);
	if (rc == 0 && check_points_by_class(c, view) && !c->columns && input_info(in)->no_classes) {
		err_set(err, ERR_USAGE, "its points have no classes, and so no weights");
		rc = err_add_hint(err, "give --columns as acutctl was given them: xyzc, or xyz if the class of all points is 0");
	}
	if (rc == 0)
		rc = read_all(c, in, b, l, view, err);
	if (rc)
		err_add_file(err, path);
	if (in)
		input_close(in);
	io_close(fd);
	free(b);
	return rc;
}

int check_ply_is(const char *path, bool *ret, struct err *err)
{
	char head[4] = "";
	size_t n = 0;
	int fd, r = io_open(AT_FDCWD, path, O_RDONLY, 0, &fd, err);

	if (r)
		return r;
	r = io_read_some(fd, head, sizeof head, 0, path, &n, err);
	io_close(fd);
	*ret = n == sizeof head && !memcmp(head, "ply\n", sizeof head);
	return r;
}

int check_points_mesh(struct check_points *c, const struct check_mesh *m, const struct lattice *l, struct err *err)
{
	int r;

	if (decimal_compare(m->lattice.scale_xy, l->scale_xy) || decimal_compare(m->lattice.scale_z, l->scale_z))
		return err_set(err, ERR_INPUT, "the two meshes have different scales");
	r = make_room(c, m->nvertex, err);
	for (size_t i = 0; !r && i < m->nvertex; i++) {
		int64_t at[3];

		for (unsigned k = 0; k < 3; k++) {
			at[k] = m->vertex[i][k] + m->lattice.k[k] - l->k[k];
			if (at[k] < INT32_MIN || at[k] > INT32_MAX)
				return err_set(err, ERR_INPUT, "vertex %zu is beyond the lattice of the mesh", i);
		}
		c->pts[c->n++] = (struct point){.x = (int32_t)at[0],
						.y = (int32_t)at[1],
						.z = (int32_t)at[2],
						.tag = (uint16_t)(c->slot << POINT_SLOT_SHIFT)};
	}
	c->read += m->nvertex;
	c->removed[VIEW_KEPT] += m->nvertex;
	return r;
}

/* What the thin rule compares, in order. */
struct thin_key {
	int64_t cell[2];
	int64_t order[7]; /* z (negated if the highest is taken), class, returns, flags, x, y, slot (negated) */
	size_t at;
};

static int key_compare(const void *a, const void *b)
{
	const struct thin_key *p = a, *q = b;

	for (unsigned i = 0; i < 2; i++)
		if (p->cell[i] != q->cell[i])
			return p->cell[i] < q->cell[i] ? -1 : 1;
	for (unsigned i = 0; i < 7; i++)
		if (p->order[i] != q->order[i])
			return p->order[i] < q->order[i] ? -1 : 1;
	return 0;
}

static int64_t cell_of(int64_t number, int64_t cell)
{
	return number >= 0 ? number / cell : -((-number + cell - 1) / cell);
}

int check_points_thin(struct check_points *c, const struct view *view, struct err *err)
{
	struct thin_key *key = malloc((c->n ? c->n : 1) * sizeof *key);
	struct point *kept = malloc((c->n ? c->n : 1) * sizeof *kept);
	size_t n = 0;

	if (!key || !kept) {
		free(key);
		free(kept);
		return err_set(err, ERR_NOMEM, "no memory to thin %zu points", c->n);
	}
	for (size_t i = 0; i < c->n; i++) {
		const struct point *p = &c->pts[i];

		key[i] = (struct thin_key){
			{cell_of(p->x + view->k[0], view->thin.cell), cell_of(p->y + view->k[1], view->thin.cell)},
			{view->thin.pick == VIEW_PICK_HIGHEST ? -(int64_t)p->z : p->z, p->cls, p->ret, p->tag & POINT_FLAGS, p->x,
			 p->y, -(int64_t)point_slot(p)},
			i};
	}
	qsort(key, c->n, sizeof *key, key_compare);
	for (size_t i = 0, end; i < c->n; i = end) {
		for (end = i; end < c->n && key[end].cell[0] == key[i].cell[0] && key[end].cell[1] == key[i].cell[1]; end++)
			;
		kept[n++] = c->pts[key[view->thin.pick == VIEW_PICK_MEDIAN ? i + (end - i - 1) / 2 : i].at];
	}
	c->removed[VIEW_BY_THIN] += c->n - n;
	memcpy(c->pts, kept, n * sizeof *kept);
	c->n = n;
	free(key);
	free(kept);
	return 0;
}

void check_points_clear(struct check_points *c)
{
	free(c->pts);
	c->pts = NULL;
}
