#include "stream_model.h"

#include <stdlib.h>
#include <string.h>

#include "random.h"

static uint64_t seed = 0x9e3779b97f4a7c15u;

uint32_t model_roll(uint32_t n)
{
	return (uint32_t)random_below(&seed, n);
}

void model_append(struct stream_bytes *to, const struct stream_piece *piece, unsigned n)
{
	assert_true(n <= STREAM_PIECES);
	for (unsigned i = 0; i < n; i++) {
		if (to->size + piece[i].size > to->room) {
			to->room = 2 * (to->size + piece[i].size);
			to->at = realloc(to->at, to->room);
			assert_non_null(to->at);
		}
		assert_true(piece[i].size > 0);
		memcpy(to->at + to->size, piece[i].bytes, piece[i].size);
		to->size += piece[i].size;
	}
	assert_int_equal(to->size % 8, 0);
}

static void model_block(struct model *m, unsigned i, uint64_t index, uint64_t first)
{
	struct model_data *d = &m->data[i];
	struct stream_block *b = &m->block[i];
	uint32_t locals;

	*b = (struct stream_block){.index = index,
				   .box = {-3, INT64_MIN, 5, INT64_MAX},
				   .first = first,
				   .foreign = d->foreign,
				   .vertex = d->vertex,
				   .triangle = d->triangle,
				   .final = d->final};
	b->nforeign = first > 0 ? model_roll(MAX_NEW) : 0;
	b->nnew = 3 + model_roll(MAX_NEW - 3);
	b->ntriangle = 1 + model_roll(MAX_TRI - 1);
	locals = b->nforeign + b->nnew;
	for (uint32_t k = 0; k < b->nforeign; k++)
		d->foreign[k] = model_roll((uint32_t)first);
	for (uint32_t k = 0; k < b->nnew; k++)
		for (unsigned a = 0; a < 3; a++)
			d->vertex[k][a] = (int32_t)model_roll(2000) - 1000;
	for (uint32_t k = 0; k < b->ntriangle; k++) {
		uint32_t at = model_roll(locals);

		for (unsigned a = 0; a < 3; a++)
			d->triangle[k][a] = (at + a) % locals;
		d->flags[k] = (uint8_t)model_roll(256);
	}
	memset(d->final, 0, sizeof d->final);
	for (uint32_t k = 0; k < locals; k++)
		d->final[k / 8] |= (uint8_t)(model_roll(2) << k % 8);
	if (i % 2)
		b->flags = d->flags;
	for (uint32_t k = 0; k < b->nnew; k++)
		d->origin[k] = (struct stream_origin){.source = model_roll(UINT32_MAX), .cls = (uint8_t)model_roll(256)};
	if (i % 3 == 2)
		b->origin = d->origin;
}

void model_totals(struct model *m)
{
	int32_t box[6] = {INT32_MAX, INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN, INT32_MIN};

	m->tail.blocks = m->nblock;
	m->tail.vertices = m->tail.triangles = 0;
	for (unsigned i = 0; i < m->nblock; i++) {
		const struct stream_block *b = &m->block[i];

		m->tail.vertices += b->nnew;
		m->tail.triangles += b->ntriangle;
		for (uint32_t k = 0; k < b->nnew; k++)
			for (unsigned a = 0; a < 3; a++) {
				int32_t v = b->vertex[k][a];

				box[a] = v < box[a] ? v : box[a];
				box[3 + a] = v > box[3 + a] ? v : box[3 + a];
			}
	}
	memcpy(m->tail.box, box, sizeof box);
}

void model_init(struct model *m, unsigned nblock)
{
	static const int32_t box[6] = {-1000, -1000, -1000, 1000, 1000, 1000};
	static char view[AREA_TEXT_MAX + 1];
	uint64_t first = 0;

	memset(m, 0, sizeof *m);
	m->nblock = nblock;
	m->head.kind = STREAM_WHOLE;
	m->head.id = (struct digest){7, UINT64_MAX};
	memcpy(m->head.box, box, sizeof box);
	strcpy(m->head.lattice, "0.01 0.01 -500000 0 17");
	strcpy(m->head.crs, "EPSG:25832");
	strcpy(m->head.unit_xy, "m");
	memset(view, 'v', AREA_TEXT_MAX);
	m->head.view = view;
	for (unsigned i = 0; i < nblock; i++) {
		model_block(m, i, 3 * i + model_roll(3), first);
		first += m->block[i].nnew;
	}
	m->tail.hull = 5;
	m->tail.digest = (struct digest){1, 2};
	m->tail.vertex_digest = (struct digest){3, 4};
	strcpy(m->tail.report, "{\"points\":5}");
	model_totals(m);
}

void model_append_changes(const struct model *m, struct stream_bytes *all)
{
	static uint8_t scratch[STREAM_SCRATCH];
	struct stream_piece piece[STREAM_PIECES];

	if (!m->no_base)
		model_append(all, piece, stream_put_base(&m->base, scratch, piece));
	if (m->ngone)
		model_append(all, piece, stream_put_gone(m->gone, 1, scratch, piece));
	if (m->ngone > 1)
		model_append(all, piece, stream_put_gone(m->gone + 1, m->ngone - 1, scratch, piece));
}

void model_changes(struct model *m, uint32_t ngone)
{
	m->head.kind = STREAM_CHANGES;
	m->base = (struct stream_base){.generation = 3,
				       .job = 9,
				       .old_digest = {1, 2},
				       .digest = {3, UINT64_MAX},
				       .old_vertex_digest = {5, 6},
				       .vertex_digest = {7, 8},
				       .kept = 11,
				       .kept_triangles = 99};
	m->ngone = ngone;
	for (uint32_t i = 0; i < ngone; i++) {
		m->gone[i] = (struct stream_region){{2 * i + 1, INT64_MIN, 2 * i + 3, 7}, 5 + i, {i, i + 1}};
		m->base.gone++;
		m->base.gone_triangles += m->gone[i].triangles;
	}
}

struct stream_bytes model_bytes(const struct model *m)
{
	static uint8_t scratch[STREAM_SCRATCH];
	struct stream_piece piece[STREAM_PIECES];
	struct stream_bytes out = {0};

	model_append(&out, piece, stream_put_head(&m->head, scratch, piece));
	if (m->base.generation)
		model_append_changes(m, &out);
	for (unsigned i = 0; i < m->nblock; i++)
		model_append(&out, piece, stream_put_block(&m->block[i], scratch, piece));
	model_append(&out, piece, stream_put_tail(&m->tail, scratch, piece));
	return out;
}

static void check_block(const struct stream_block *b, const struct stream_block *want)
{
	assert_int_equal(b->index, want->index);
	assert_memory_equal(b->box, want->box, sizeof b->box);
	assert_int_equal(b->first, want->first);
	assert_int_equal(b->nforeign, want->nforeign);
	assert_int_equal(b->nnew, want->nnew);
	assert_int_equal(b->ntriangle, want->ntriangle);
	assert_memory_equal(b->foreign, want->foreign, b->nforeign * 8);
	assert_memory_equal(b->vertex, want->vertex, b->nnew * 12);
	assert_memory_equal(b->triangle, want->triangle, b->ntriangle * 12);
	assert_memory_equal(b->final, want->final, (b->nforeign + b->nnew + 7) / 8);
	assert_int_equal(b->flags != NULL, want->flags != NULL);
	if (b->flags)
		assert_memory_equal(b->flags, want->flags, b->ntriangle);
	assert_int_equal(b->origin != NULL, want->origin != NULL);
	if (b->origin)
		assert_memory_equal(b->origin, want->origin, b->nnew * sizeof *b->origin);
	if (!b->local)
		return;
	assert_ptr_equal(b->local + b->nforeign, b->vertex);
	for (uint32_t i = 0; i < b->nforeign; i++)
		memset(b->local[i], 0xa5, sizeof b->local[i]);
	assert_memory_equal(b->foreign, want->foreign, b->nforeign * 8);
	assert_memory_equal(b->vertex, want->vertex, b->nnew * 12);
}

int model_run(const struct stream_bytes *in, size_t cut, const struct model *want, bool *ret_done, struct err *err)
{
	struct stream_reader *r = stream_reader_new();
	unsigned blocks = 0;
	size_t at = 0, gone = 0;
	int e = 0;

	while (at < in->size && e == 0) {
		enum stream_event event;
		size_t n, room;
		void *to;

		e = stream_reader_space(r, &to, &room, err);
		if (e < 0)
			break;
		assert_true(room > 0);
		n = 1 + model_roll((uint32_t)cut);
		n = n < room ? n : room;
		n = n < in->size - at ? n : in->size - at;
		memcpy(to, in->at + at, n);
		at += n;
		e = stream_reader_feed(r, n, &event, err);
		if (e < 0 || !want)
			continue;
		if (event == STREAM_HEAD) {
			assert_memory_equal(&want->head.id, &stream_reader_head(r)->id, sizeof want->head.id);
			assert_string_equal(want->head.view, stream_reader_head(r)->view);
			assert_string_equal(want->head.system ? want->head.geoid : "", stream_reader_head(r)->geoid);
			if (want->head.system && *want->head.wkt)
				assert_string_equal(want->head.wkt, stream_reader_head(r)->wkt);
			else
				assert_true(!stream_reader_head(r)->wkt || !*stream_reader_head(r)->wkt);
			assert_string_equal(want->head.lattice, stream_reader_head(r)->lattice);
			assert_string_equal(want->head.unit_z, stream_reader_head(r)->unit_z);
		} else if (event == STREAM_BASE) {
			assert_memory_equal(&want->base, stream_reader_base(r), sizeof want->base);
		} else if (event == STREAM_GONE) {
			const struct stream_region *region = stream_reader_gone(r, &n);

			assert_memory_equal(region, want->gone + gone, n * sizeof *region);
			gone += n;
		} else if (event == STREAM_BLOCK) {
			check_block(stream_reader_block(r), &want->block[blocks++]);
		} else if (event == STREAM_TAIL) {
			assert_int_equal(blocks, want->nblock);
			assert_int_equal(gone, want->ngone);
			assert_string_equal(want->tail.report, stream_reader_tail(r)->report);
			assert_int_equal(stream_reader_tail(r)->vertex_digest.lo, 4);
		}
	}
	*ret_done = stream_reader_done(r);
	if (e == 0)
		assert_int_equal(stream_reader_offset(r), in->size);
	stream_reader_free(r);
	return e;
}

int model_run_whole(const struct model *m, struct err *err)
{
	struct stream_bytes in = model_bytes(m);
	bool done;
	int e = model_run(&in, 1 << 20, NULL, &done, err);

	if (e == 0)
		assert_true(done);
	free(in.at);
	return e;
}
