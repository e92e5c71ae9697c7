/*
 * Files of lines for acut-verify. They are read as acutctl and acutd read them (client/lines, engine/input); what is done with
 * their vertices is from docs/formats/lines.md: equal vertices in a row are one, lakes get a level, and points are added by
 * --densify.
 */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "check_lines.h"
#include "err.h"
#include "grow.h"
#include "input.h"
#include "io.h"

enum { BATCH = 4096 };

struct line_vertex {
	int32_t at[3];
	uint8_t bits, kind;
	uint32_t feature;
};

struct reading {
	struct check_lines *l;
	double step; /* in lattice numbers; 0: nothing is added */
	unsigned level;
	struct line_vertex *vertex; /* of one feature */
	size_t n, cap;
	int64_t raw[BATCH][3];
	int32_t at[BATCH][3];
	uint8_t cls[BATCH], ret[BATCH], flags[BATCH];
	struct input_vertex of[BATCH];
};

/* ---- segments ---- */

static int add_vertex(struct check_lines *l, const int32_t *at, struct err *err)
{
	if (!grow(&l->vertex, &l->vertex_cap, l->nvertex + 1, 256, sizeof *l->vertex))
		return check_no_memory(err);
	l->vertex[l->nvertex++] = (struct check_vertex){at[0], at[1], at[2], at[2], false, false};
	return 0;
}

static int add_segment(struct check_lines *l, const int32_t *a, const int32_t *b, uint32_t area, uint32_t feature,
		       struct err *err)
{
	if (a[0] == b[0] && a[1] == b[1])
		return 0;
	if (!grow(&l->segment, &l->segment_cap, l->nsegment + 1, 256, sizeof *l->segment))
		return check_no_memory(err);
	l->segment[l->nsegment++] = (struct check_segment){{a[0], a[1]}, {b[0], b[1]}, area, feature, l->nfiles - 1};
	return 0;
}

/* floor(a + (b - a) i / n + 1/2), which is the same from either end. */
static int32_t division(int32_t a, int32_t b, int64_t i, int64_t n)
{
	__int128 num = 2 * (__int128)((int64_t)b - a) * i + n, den = 2 * (__int128)n;

	return (int32_t)(a + (int64_t)(num / den - (num % den < 0)));
}

static int add_stretch(struct reading *r, const int32_t *a, const int32_t *b, uint32_t area, uint32_t feature, struct err *err)
{
	double dx = (double)b[0] - a[0], dy = (double)b[1] - a[1];
	int64_t n = r->step > 0 ? (int64_t)ceil(sqrt(dx * dx + dy * dy) / r->step) : 1;
	int32_t last[3] = {a[0], a[1], a[2]};
	int rc = 0;

	for (int64_t i = 1; rc == 0 && i <= n; i++) {
		const int32_t next[3] = {division(a[0], b[0], i, n), division(a[1], b[1], i, n), division(a[2], b[2], i, n)};

		if (i < n)
			rc = add_vertex(r->l, next, err);
		if (rc == 0)
			rc = add_segment(r->l, last, next, area, feature, err);
		memcpy(last, next, sizeof last);
	}
	return rc;
}

static int add_line(struct reading *r, const struct line_vertex *v, size_t n, uint32_t area, struct err *err)
{
	bool ring = v[0].bits & INPUT_IN_RING;
	int rc = 0;

	for (size_t i = 0; rc == 0 && i < n; i++)
		rc = add_vertex(r->l, v[i].at, err);
	for (size_t i = 1; rc == 0 && i < n; i++)
		rc = add_stretch(r, v[i - 1].at, v[i].at, area, v[i].feature, err);
	return rc || !ring ? rc : add_stretch(r, v[n - 1].at, v[0].at, area, v[0].feature, err);
}

static int uneven(const struct reading *r, struct err *err)
{
	char field[32];

	snprintf(field, sizeof field, "feature %u", r->vertex[0].feature);
	err_set(err, ERR_INPUT, "it is a lake of several heights");
	err_add_hint(err, "give --lake-level as for the mesh");
	return err_add_place(err, ERR_NO_OFFSET, field);
}

/* A lake has one height: --lake-level says which, if its vertices have several. */
static int make_level(struct reading *r, struct err *err)
{
	__int128 sum = 0;
	int32_t low = r->vertex[0].at[2], high = low;

	for (size_t i = 0; i < r->n; i++) {
		int32_t z = r->vertex[i].at[2];

		low = z < low ? z : low;
		high = z > high ? z : high;
		sum += z;
	}
	if (low == high)
		return 0;
	if (r->level == INPUT_LEVEL_NONE)
		return uneven(r, err);
	__int128 num = 2 * sum + (int64_t)r->n, den = 2 * (int64_t)r->n;
	int32_t mean = (int32_t)(num / den - (num % den < 0));

	for (size_t i = 0; i < r->n; i++)
		r->vertex[i].at[2] = r->level == INPUT_LEVEL_MIN ? low : r->level == INPUT_LEVEL_MAX ? high : mean;
	return 0;
}

static int add_feature(struct reading *r, struct err *err)
{
	struct check_lines *l = r->l;
	uint32_t area = 0;
	int rc = 0;

	if (!r->n)
		return 0;
	if (r->vertex[0].kind != INPUT_HARD) {
		if (!grow(&l->area, &l->area_cap, l->nareas + 1, 256, sizeof *l->area))
			return check_no_memory(err);
		l->area[l->nareas++] = r->vertex[0].kind;
		area = (uint32_t)l->nareas;
	}
	if (r->vertex[0].kind == INPUT_LAKE)
		rc = make_level(r, err);
	for (size_t i = 0, end; rc == 0 && i < r->n; i = end) {
		for (end = i + 1; end < r->n && !(r->vertex[end].bits & INPUT_LINE_BEGINS); end++)
			;
		rc = add_line(r, r->vertex + i, end - i, area, err);
	}
	r->n = 0;
	return rc;
}

static int take_batch(struct reading *r, size_t n, struct err *err)
{
	int rc = 0;

	for (size_t i = 0; rc == 0 && i < n; i++) {
		if (r->of[i].bits & INPUT_FEATURE_BEGINS)
			rc = add_feature(r, err);
		if (rc == 0 && !grow(&r->vertex, &r->cap, r->n + 1, 256, sizeof *r->vertex))
			rc = check_no_memory(err);
		if (rc == 0)
			r->vertex[r->n++] = (struct line_vertex){
				{r->at[i][0], r->at[i][1], r->at[i][2]}, r->of[i].bits, r->of[i].kind, r->of[i].feature};
	}
	return rc;
}

/* ---- files ---- */

_Static_assert((int)INPUT_HARD == LINES_HARD && (int)INPUT_LAKE == LINES_LAKE && (int)INPUT_BOUNDARY == LINES_BOUNDARY &&
		       (int)INPUT_HOLE == LINES_HOLE,
	       "kinds of lines have one order");

static int choose_step(struct reading *r, const struct input_lines *lines, const struct check_mesh *m, struct err *err)
{
	double length = decimal_double(lines->densify);

	if (!lines->densify.mantissa)
		return 0;
	if (*lines->densify_unit) {
		double of_mesh = crs_unit_metres(m->unit_xy);

		if (of_mesh <= 0)
			return err_set(err, ERR_INPUT, "the length of --densify has a unit, and that of the mesh is not known");
		length = length * crs_unit_metres(lines->densify_unit) / of_mesh;
	}
	r->step = length / decimal_double(m->lattice.scale_xy);
	return r->step >= 1 ? 0 : err_set(err, ERR_INPUT, "the length of --densify is below the scale of the mesh");
}

static int read_vertices(struct reading *r, struct input *in, const struct check_mesh *m, struct err *err)
{
	const struct input_info *info = input_info(in);
	struct input_points pts = {.raw = r->raw, .cls = r->cls, .ret = r->ret, .flags = r->flags, .cap = BATCH, .vertex = r->of};
	double shift[3] = {0, 0, 0};
	uint64_t moved = 0;
	struct lattice_map map;
	size_t bad;
	int rc;

	if (!info->lines.are)
		return err_set(err, ERR_INPUT, "it is no file of lines");
	r->level = info->lines.level;
	rc = choose_step(r, &info->lines, m, err);
	if (rc == 0)
		rc = lattice_map_init(&map, &m->lattice, &info->coords, err);
	while (rc == 0 && (rc = input_read(in, &pts, err)) == 0 && pts.n > 0) {
		rc = lattice_map_apply(&map, (const int64_t(*)[3])r->raw, pts.n, r->at, &moved, shift, &bad, err);
		if (rc == 0)
			rc = take_batch(r, pts.n, err);
	}
	return rc ? rc : add_feature(r, err);
}

static int read_text(struct check_lines *l, int fd, const char *path, const struct check_mesh *m, struct err *err)
{
	const struct input_options options = {.planar = true, .scale_xy = m->lattice.scale_xy, .scale_z = m->lattice.scale_z};
	struct reading *r = calloc(1, sizeof *r);
	struct input *in = NULL;
	int rc;

	if (!r)
		return check_no_memory(err);
	r->l = l;
	rc = input_open(fd, path, &options, &in, err);
	if (rc == 0)
		rc = read_vertices(r, in, m, err);
	if (in)
		input_close(in);
	free(r->vertex);
	free(r);
	return rc;
}

/* Any other file becomes the text that acutd gets. */
static int convert(const char *path, const struct check_lines_options *o, int *ret_fd, struct err *err)
{
	const struct lines_options options = {.layer = o->layer, .kind_field = o->kind_field, .csv = true};
	struct lines_exported done;
	struct lines *lines = NULL;
	int fd = memfd_create("acut-lines", MFD_CLOEXEC), rc;
	FILE *out = fd < 0 ? NULL : fdopen(dup(fd), "w");

	rc = out ? lines_open(path, &options, &lines, err) : check_no_memory(err);
	if (rc == 0)
		rc = lines_export(lines, &o->text, out, &done, err);
	lines_close(lines);
	if (out && fclose(out) && rc == 0)
		rc = err_sys(err, errno, "its lines cannot be kept in memory");
	if (rc && fd >= 0)
		close(fd);
	else
		*ret_fd = fd;
	return rc;
}

static int open_text(const char *path, const struct check_lines_options *o, int *ret_fd, struct err *err)
{
	static const char signature[] = "acut-lines ";
	char head[sizeof signature - 1];
	size_t n = 0;
	int fd = -1, rc = io_open(AT_FDCWD, path, O_RDONLY, 0, &fd, err);

	if (rc == 0)
		rc = io_read_some(fd, head, sizeof head, 0, path, &n, err);
	if (rc == 0 && n == sizeof head && !memcmp(head, signature, n)) {
		*ret_fd = fd;
		return 0;
	}
	if (fd >= 0)
		io_close(fd);
	return rc ? rc : convert(path, o, ret_fd, err);
}

int check_lines_read(struct check_lines *l, const char *path, const struct check_lines_options *o, const struct check_mesh *m,
		     struct err *err)
{
	char **names = realloc(l->file, (l->nfiles + 1) * sizeof *names);
	int fd = -1, rc;

	if (!names)
		return check_no_memory(err);
	l->file = names;
	names[l->nfiles] = strdup(path);
	if (!names[l->nfiles++])
		return check_no_memory(err);
	rc = open_text(path, o, &fd, err);
	if (rc == 0) {
		rc = read_text(l, fd, path, m, err);
		close(fd);
	}
	return rc ? err_add_file(err, path) : 0;
}

void check_lines_clear(struct check_lines *l)
{
	for (uint32_t i = 0; i < l->nfiles; i++)
		free(l->file[i]);
	free(l->file);
	free(l->segment);
	free(l->vertex);
	free(l->piece);
	free(l->area);
	free(l->edge);
	free(l->band.cell);
	free(l->near.cell);
	free(l->parity);
	free(l->touched);
	*l = (struct check_lines){0};
}
