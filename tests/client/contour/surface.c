/* See surface.h. */
#include "surface.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "err.h"
#include "outfile.h"

static uint64_t state;

void surface_seed(uint64_t seed)
{
	state = seed * 0x9e3779b97f4a7c15u + 1;
}

uint64_t surface_random(uint64_t below)
{
	state = state * 6364136223846793005u + 1442695040888963407u;
	return (state >> 33) % below;
}

void surface_make(struct surface *s, uint32_t columns, uint32_t rows, int32_t heights, int32_t step, bool holes)
{
	*s = (struct surface){.nvertex = columns * rows, .columns = columns};
	s->vertex = calloc(s->nvertex, sizeof(*s->vertex));
	s->triangle = calloc(2 * (size_t)s->nvertex, sizeof(*s->triangle));
	for (uint32_t i = 0; i < s->nvertex; i++) {
		s->vertex[i][0] = (int32_t)(i % columns * 100 + surface_random(45));
		s->vertex[i][1] = (int32_t)(i / columns * 100 + surface_random(45));
		s->vertex[i][2] = step * (int32_t)surface_random((uint64_t)heights);
	}
	for (uint32_t y = 0; y + 1 < rows; y++) {
		for (uint32_t x = 0; x + 1 < columns; x++) {
			uint32_t a = y * columns + x, q[4] = {a, a + 1, a + columns + 1, a + columns};
			uint32_t turn = (uint32_t)surface_random(2), more = (uint32_t)surface_random(3);

			if (holes && !surface_random(7))
				continue;
			for (uint32_t k = 0; k < 2; k++) /* from any corner on */
				for (uint32_t j = 0; j < 3; j++)
					s->triangle[s->ntriangle + k][j] = q[(turn + (k ? 2 : 0) + (j + more) % 3) % 4];
			s->ntriangle += 2;
		}
	}
}

void surface_done(struct surface *s)
{
	free(s->vertex);
	free(s->triangle);
}

/* ---- the lines ---- */

static void take_points(struct contour *c, struct lines *to, uint64_t want, struct err *err)
{
	const double(*point)[2];
	size_t n;
	uint64_t got = 0;

	while (!contour_points(c, &point, &n, err) && n) {
		to->point = realloc(to->point, (to->npoint + n) * sizeof(*to->point));
		memcpy(to->point + to->npoint, point, n * sizeof(*point));
		to->npoint += n;
		got += n;
	}
	assert_int_equal(err->code, 0);
	assert_int_equal(got, want);
}

static void take(struct contour *c, struct lines *to, struct err *err)
{
	struct contour_line line;
	int64_t range[2] = {INT64_MAX, INT64_MIN};
	bool any = contour_range(c, range);

	while (!contour_next(c, &line, err) && line.points) {
		to->line = realloc(to->line, (to->n + 1) * sizeof(*to->line));
		to->height = realloc(to->height, (to->n + 1) * sizeof(*to->height));
		contour_height_text(c, line.level, to->height[to->n]);
		to->line[to->n++] = line;
		assert_true(any && line.level >= range[0] && line.level <= range[1]);
		take_points(c, to, line.points, err);
	}
	assert_int_equal(err->code, 0);
}

static void block(struct contour *c, const struct surface *s, uint32_t number, const uint32_t *of, const uint32_t *order,
		  struct err *err)
{
	uint32_t(*t)[3] = calloc(s->ntriangle + 1, sizeof(*t));
	struct acut_mesh_block b = {.nnew = s->nvertex, .triangle = (const uint32_t(*)[3])t};

	for (uint32_t i = 0; i < s->ntriangle; i++)
		if (of[order[i]] == number)
			memcpy(t[b.ntriangle++], s->triangle[order[i]], sizeof(*t));
	assert_int_equal(contour_block(c, &b, (const int32_t(*)[3])s->vertex, err), 0);
	free(t);
}

void surface_lines(const struct surface *s, const struct way *way, struct lines *ret)
{
	const struct acut_mesh_head head = {.scale_xy = "0.01",
					    .scale_z = "0.01",
					    .view = way->view ? way->view : "view 1",
					    .k = {way->k[0] ? way->k[0] : 1000000, way->k[1] ? way->k[1] : 2000000, 50}};
	struct contour_options opt = {.interval = {way->interval, 1, 1},
				      .base = {way->base, 1, 1},
				      .z_num = 1,
				      .z_den = 1,
				      .segments = way->segments,
				      .pages = way->pages,
				      .tile_p = way->tile_p,
				      .tile_q = way->tile_q,
				      .tiles = 1000,
				      .simplify = way->simplify,
				      .cell = way->cell,
				      .sort_memory = way->sort_memory};
	int64_t tile[2];
	bool any = false;
	uint32_t *of = calloc(s->ntriangle + 1, sizeof(*of)), *order = calloc(s->ntriangle + 1, sizeof(*order));
	struct err err = ERR_INIT;
	struct outfile *out;
	struct contour *c;

	*ret = (struct lines){0};
	for (int i = 0; i < 2; i++)
		opt.axis[i] =
			(struct contour_axis){.a = 1, .b = head.k[i], .e = -2, .whole = true, .scale = {1, -2}, .k = head.k[i]};
	assert_int_equal(outfile_spool(NULL, &out, &err), 0);
	assert_int_equal(contour_new(out, &c, &err), 0);
	assert_int_equal(contour_head(c, &head, &opt, &err), 0);
	for (uint32_t i = 0; i < s->ntriangle; i++) {
		uint32_t k = way->blocks ? (uint32_t)surface_random(i + 1) : i;

		of[i] = way->blocks ? (uint32_t)surface_random(way->blocks) : 0;
		order[i] = order[k];
		order[k] = i;
	}
	for (uint32_t i = 0; i < (way->blocks ? way->blocks : 1); i++)
		block(c, s, i, of, order, &err);
	assert_int_equal(contour_join(c, &err), 0);
	if (!way->tile_p)
		take(c, ret, &err);
	while (way->tile_p && !contour_next_tile(c, tile, &any, &err) && any)
		take(c, ret, &err);
	ret->left_out = contour_simplified(c).left_out;
	assert_int_equal(contour_done(c, &err), 0);
	contour_free(c);
	assert_int_equal(outfile_size(out), 0);
	outfile_free(out);
	free(of);
	free(order);
}

void lines_done(struct lines *l)
{
	free(l->line);
	free(l->point);
	free(l->height);
}

void lines_same(const struct lines *a, const struct lines *b)
{
	assert_int_equal(a->n, b->n);
	assert_int_equal(a->npoint, b->npoint);
	assert_memory_equal(a->point, b->point, a->npoint * sizeof(*a->point));
	for (size_t i = 0; i < a->n; i++) {
		assert_int_equal(a->line[i].level, b->line[i].level);
		assert_int_equal(a->line[i].closed, b->line[i].closed);
		assert_int_equal(a->line[i].points, b->line[i].points);
		assert_memory_equal(&a->line[i].length, &b->line[i].length, sizeof(double));
		assert_memory_equal(a->line[i].box, b->line[i].box, sizeof(a->line[i].box));
	}
}
