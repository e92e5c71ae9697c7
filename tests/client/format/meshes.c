/* See meshes.h. Vertices are numbered row by row, so that a block knows the last row of the one before. */
#include "meshes.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"

const struct meshes_spec meshes_many = {.columns = 60,
					.rows = 41,
					.strip = 7,
					.x0 = -500,
					.y0 = 900,
					.step = 25,
					.slope_x = 3,
					.slope_y = 4,
					.scale_xy = "0.01",
					.scale_z = "0.01",
					.k = {50000000, 400000000, 0}};

static char lattice[192];

static int32_t row_of(const struct meshes_spec *s, uint32_t row)
{
	return (int32_t)(s->shuffle ? s->rows - 1 - row : row);
}

/* Squares of rows [from, to): new vertices are rows from + 1 .. to, and row 0 in the first block. */
static void make_block(struct acut_mesh_block *b, const struct meshes_spec *s, uint32_t from, uint32_t to)
{
	uint32_t w = s->columns, nf = from ? w : 0, first_row = from ? from + 1 : 0, n = 0;
	int32_t(*v)[3];
	uint32_t(*t)[3];
	uint64_t *f = calloc(w, sizeof(*f));
	uint8_t *final;

	b->nforeign = nf;
	b->nnew = (to + 1 - first_row) * w;
	b->first = from ? (uint64_t)(from + 1) * w : 0;
	for (uint32_t i = 0; i < nf; i++)
		f[i] = (uint64_t)from * w + i;
	v = calloc(b->nnew + 1, sizeof(*v));
	for (uint32_t i = 0; i < b->nnew; i++) {
		int32_t c = (int32_t)(i % w), r = row_of(s, first_row + i / w);
		v[i][0] = s->x0 + c * s->step;
		v[i][1] = s->y0 + r * s->step;
		v[i][2] = s->slope_x * c + s->slope_y * r;
	}
	t = calloc(2 * (size_t)(to - from) * w + 1, sizeof(*t));
	for (uint32_t r = from; r < to; r++) {
		for (uint32_t c = 0; c + 1 < w; c++) {
			uint32_t a = (r - from) * w + c, q[4] = {a, a + 1, a + w + 1, a + w};
			if (s->shuffle) /* rows go down; the diagonal is the same */
				memcpy(q, (uint32_t[4]){a + w, a + w + 1, a + 1, a}, sizeof(q));
			memcpy(t[n++], (uint32_t[3]){q[0], q[1], q[2]}, 12);
			memcpy(t[n++], (uint32_t[3]){q[0], q[2], q[3]}, 12);
		}
	}
	final = calloc((nf + b->nnew) / 8 + 1, 1);
	for (uint32_t i = 0; i < nf + b->nnew; i++)
		if (to == s->rows - 1 || i < nf + b->nnew - w)
			final[i >> 3] |= (uint8_t)(1u << (i & 7));
	b->foreign = f;
	b->vertex = (const int32_t(*)[3])v;
	b->triangle = (const uint32_t(*)[3])t;
	b->ntriangle = n;
	b->final = final;
	b->box[0] = from;
	b->box[2] = to;
}

struct format_options meshes_options(const struct format *f)
{
	return (struct format_options){.origin_auto = !strcmp(f->name, "glb") || !strcmp(f->name, "stl"),
				       .cell = {f->kind == FORMAT_RASTER ? 5 : 0, -1},
				       .interval = {f->takes & FORMAT_INTERVAL ? 5 : 0, -1},
				       .simplify = {!strcmp(f->name, "geojson") ? 2 : 0, -1}};
}

void meshes_make(struct meshes *m, const struct meshes_spec *s)
{
	memset(m, 0, sizeof(*m));
	m->columns = s->columns;
	m->rows = s->rows;
	snprintf(lattice, sizeof(lattice), "%s %s %lld %lld %lld", s->scale_xy, s->scale_z, (long long)s->k[0],
		 (long long)s->k[1], (long long)s->k[2]);
	m->head = (struct acut_mesh_head){.lattice = lattice,
					  .scale_xy = s->scale_xy,
					  .scale_z = s->scale_z,
					  .crs = "EPSG:26910\nsecond line",
					  .epsg = 26910,
					  .unit_xy = "metre",
					  .unit_z = "metre",
					  .view = "view 1",
					  .stream_id = "00"};
	memcpy(m->head.k, s->k, sizeof(s->k));
	m->tail = (struct acut_mesh_tail){.digest = "0123456789abcdef0123456789abcdef",
					  .vertex_digest = "fedcba9876543210fedcba9876543210",
					  .report = "{}"};
	if (!s->columns)
		return;
	for (int i = 0; i < 2; i++) {
		m->head.box[i] = i ? s->y0 : s->x0;
		m->head.box[i + 3] = m->head.box[i] + (int32_t)((i ? s->rows : s->columns) - 1) * s->step;
	}
	m->head.box[2] = -100000;
	m->head.box[5] = 100000;
	m->block = calloc(s->rows, sizeof(*m->block));
	for (uint32_t from = 0; from + 1 < s->rows; from += s->strip) {
		uint32_t to = from + s->strip < s->rows - 1 ? from + s->strip : s->rows - 1;
		m->block[m->nblock].index = m->nblock;
		make_block(&m->block[m->nblock++], s, from, to);
	}
	for (size_t i = 0; i < m->nblock; i++) {
		m->tail.vertices += m->block[i].nnew;
		m->tail.triangles += m->block[i].ntriangle;
	}
	m->tail.blocks = m->nblock;
	memcpy(m->tail.box, m->head.box, sizeof(m->tail.box));
}

/* The position of a vertex by its number. */
static void position_of(const struct meshes *m, uint64_t number, int32_t ret[3])
{
	for (size_t i = 0; i < m->nblock; i++)
		if (number - m->block[i].first < m->block[i].nnew)
			memcpy(ret, m->block[i].vertex[number - m->block[i].first], sizeof(m->block[i].vertex[0]));
}

int meshes_block(const struct meshes *m, const struct acut_mesh_sink *sink, size_t i)
{
	struct acut_mesh_block b = m->block[i];
	int32_t(*local)[3] = calloc(b.nforeign + b.nnew + 1, sizeof(*local));
	int r;

	for (uint32_t k = 0; k < b.nforeign; k++)
		position_of(m, b.foreign[k], local[k]);
	if (b.nnew)
		memcpy(local + b.nforeign, b.vertex, b.nnew * sizeof(*local));
	b.local = (const int32_t(*)[3])local;
	r = sink->block(sink->ctx, &b);
	free(local);
	return r;
}

int meshes_send(const struct meshes *m, const struct acut_mesh_sink *sink, size_t nblock)
{
	int r = sink->head(sink->ctx, &m->head);

	for (size_t i = 0; i < m->nblock && i < nblock && !r; i++)
		r = meshes_block(m, sink, i);
	return r || nblock < m->nblock ? r : sink->tail(sink->ctx, &m->tail);
}

int meshes_write(const struct meshes *m, const char *path, const struct format *f, const struct format_options *opt,
		 const struct outputs_options *ropt, struct outputs_report *report, struct err *err)
{
	struct outputs *run = NULL;
	struct acut_mesh_sink sink;
	int r = outputs_new(ropt, &run, err);

	if (!r)
		r = outputs_add(run, path, f, opt, err);
	if (!r) {
		sink = outputs_sink(run);
		r = meshes_send(m, &sink, SIZE_MAX);
		if (r)
			*err = *outputs_error(run);
		else
			r = outputs_publish(run, err);
	}
	if (!r && report)
		outputs_report(run, report);
	outputs_free(run);
	return r;
}

void meshes_done(struct meshes *m)
{
	for (size_t i = 0; i < m->nblock; i++) {
		free((void *)m->block[i].foreign);
		free((void *)m->block[i].vertex);
		free((void *)m->block[i].triangle);
		free((void *)m->block[i].final);
	}
	free(m->block);
	memset(m, 0, sizeof(*m));
}
