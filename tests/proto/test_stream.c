/*
 * The mesh stream: what is written is read again however it is cut; every flipped bit and every cut is found;
 * a writer that breaks the rules with good checksums is found too.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "stream.h"

enum { BLOCKS = 6, MAX_NEW = 40, MAX_TRI = 70 };

static uint64_t seed = 0x9e3779b97f4a7c15u;

static uint32_t roll(uint32_t n)
{
	seed ^= seed << 13;
	seed ^= seed >> 7;
	seed ^= seed << 17;
	return (uint32_t)(seed >> 33) % n;
}

struct bytes {
	uint8_t *at;
	size_t size, room;
};

static void append(struct bytes *to, const struct stream_piece *piece, unsigned n)
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

struct data {
	uint64_t foreign[MAX_NEW];
	int32_t vertex[MAX_NEW][3];
	uint32_t triangle[MAX_TRI][3];
	uint8_t flags[MAX_TRI], final[2 * MAX_NEW / 8];
};

/* A stream of random blocks that keeps the rules; a test breaks it before it is written. */
struct model {
	struct stream_head head;
	struct data data[BLOCKS];
	struct stream_block block[BLOCKS];
	unsigned nblock;
	struct stream_tail tail;
	struct stream_base base; /* of changes */
	struct stream_region gone[3];
	uint32_t ngone;
	bool no_base;
};

static void model_block(struct model *m, unsigned i, uint64_t index, uint64_t first)
{
	struct data *d = &m->data[i];
	struct stream_block *b = &m->block[i];
	uint32_t locals;

	*b = (struct stream_block){.index = index,
				   .box = {-3, INT64_MIN, 5, INT64_MAX},
				   .first = first,
				   .foreign = d->foreign,
				   .vertex = d->vertex,
				   .triangle = d->triangle,
				   .final = d->final};
	b->nforeign = first > 0 ? roll(MAX_NEW) : 0;
	b->nnew = 3 + roll(MAX_NEW - 3);
	b->ntriangle = 1 + roll(MAX_TRI - 1);
	locals = b->nforeign + b->nnew;
	for (uint32_t k = 0; k < b->nforeign; k++)
		d->foreign[k] = roll((uint32_t)first);
	for (uint32_t k = 0; k < b->nnew; k++)
		for (unsigned a = 0; a < 3; a++)
			d->vertex[k][a] = (int32_t)roll(2000) - 1000;
	for (uint32_t k = 0; k < b->ntriangle; k++) {
		uint32_t at = roll(locals);

		for (unsigned a = 0; a < 3; a++)
			d->triangle[k][a] = (at + a) % locals;
		d->flags[k] = (uint8_t)roll(256);
	}
	memset(d->final, 0, sizeof d->final);
	for (uint32_t k = 0; k < locals; k++)
		d->final[k / 8] |= (uint8_t)(roll(2) << k % 8);
	if (i % 2)
		b->flags = d->flags;
}

static void model_totals(struct model *m)
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

static void model_init(struct model *m, unsigned nblock)
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
		model_block(m, i, 3 * i + roll(3), first);
		first += m->block[i].nnew;
	}
	m->tail.hull = 5;
	m->tail.digest = (struct digest){1, 2};
	m->tail.vertex_digest = (struct digest){3, 4};
	strcpy(m->tail.report, "{\"points\":5}");
	model_totals(m);
}

/* Regions that are gone, in lists of one and two. */
static void append_changes(const struct model *m, struct bytes *all)
{
	static uint8_t scratch[STREAM_SCRATCH];
	struct stream_piece piece[STREAM_PIECES];

	if (!m->no_base)
		append(all, piece, stream_put_base(&m->base, scratch, piece));
	if (m->ngone)
		append(all, piece, stream_put_gone(m->gone, 1, scratch, piece));
	if (m->ngone > 1)
		append(all, piece, stream_put_gone(m->gone + 1, m->ngone - 1, scratch, piece));
}

static void model_changes(struct model *m, uint32_t ngone)
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

static struct bytes model_bytes(const struct model *m)
{
	static uint8_t scratch[STREAM_SCRATCH];
	struct stream_piece piece[STREAM_PIECES];
	struct bytes out = {0};

	append(&out, piece, stream_put_head(&m->head, scratch, piece));
	if (m->base.generation)
		append_changes(m, &out);
	for (unsigned i = 0; i < m->nblock; i++)
		append(&out, piece, stream_put_block(&m->block[i], scratch, piece));
	append(&out, piece, stream_put_tail(&m->tail, scratch, piece));
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
}

/* Feeds all bytes in cuts of at most `cut`. 0 and *ret_done, or the error. With a model: compares. */
static int run(const struct bytes *in, size_t cut, const struct model *want, bool *ret_done, struct err *err)
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
		n = 1 + roll((uint32_t)cut);
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

static int run_model(const struct model *m, struct err *err)
{
	struct bytes in = model_bytes(m);
	bool done;
	int e = run(&in, 1 << 20, NULL, &done, err);

	if (e == 0)
		assert_true(done);
	free(in.at);
	return e;
}

/* ---- */

static void test_round_trip(void **state)
{
	static struct model m;
	static const size_t cuts[] = {1, 7, 100, 5000, 1 << 20};

	for (unsigned turn = 0; turn < 50; turn++) {
		struct err err = ERR_INIT;
		struct bytes in;
		bool done;

		model_init(&m, turn % (BLOCKS + 1));
		in = model_bytes(&m);
		assert_int_equal(run(&in, cuts[turn % 5], &m, &done, &err), 0);
		assert_true(done);
		free(in.at);
	}
}

static void test_every_byte_flipped(void **state)
{
	static struct model m;
	struct bytes in;

	model_init(&m, 3);
	in = model_bytes(&m);
	for (size_t i = 0; i < in.size; i++) {
		struct err err = ERR_INIT;
		bool done;

		in.at[i] ^= (uint8_t)(1u << roll(8));
		assert_true(run(&in, 1 << 20, NULL, &done, &err) < 0);
		assert_false(done);
		assert_true(err.message[0] != '\0');
		free(in.at);
		in = model_bytes(&m);
	}
	free(in.at);
}

static void test_every_cut(void **state)
{
	static struct model m;
	struct bytes in, cut;

	model_init(&m, 2);
	in = model_bytes(&m);
	cut = in;
	for (cut.size = 0; cut.size < in.size; cut.size++) {
		struct err err = ERR_INIT;
		bool done;

		assert_int_equal(run(&cut, 1 << 20, NULL, &done, &err), 0);
		assert_false(done);
	}
	free(in.at);
}

static void test_more_than_a_tail(void **state)
{
	static struct model m;
	struct err err = ERR_INIT;
	struct bytes in;
	bool done;

	model_init(&m, 1);
	in = model_bytes(&m);
	in.at = realloc(in.at, in.size + 8);
	memset(in.at + in.size, 0, 8);
	in.size += 8;
	assert_int_equal(run(&in, 1 << 20, NULL, &done, &err), -ERR_PROTO);
	free(in.at);
}

static void test_error_tail(void **state)
{
	static struct model m;
	struct err err = ERR_INIT;

	model_init(&m, 2);
	m.tail.failed = true;
	m.tail.blocks = 99; /* counts of a failed stream are nobody's business */
	strcpy(m.tail.error_code, "io");
	assert_int_equal(run_model(&m, &err), 0);
}

/* Each breaks one rule; checksums are right. */
static void break_first(struct model *m)
{
	m->block[2].first++;
}
static void break_foreign(struct model *m)
{
	m->data[2].foreign[0] = m->block[2].first;
}
static void break_index(struct model *m)
{
	m->block[1].index = m->block[2].index + 1;
}
static void break_corner(struct model *m)
{
	m->data[1].triangle[0][1] = m->block[1].nforeign + m->block[1].nnew;
}
static void break_degenerate(struct model *m)
{
	m->data[1].triangle[0][1] = m->data[1].triangle[0][0];
}
static void break_box(struct model *m)
{
	m->data[0].vertex[0][1] = 1001, model_totals(m);
}
static void break_count(struct model *m)
{
	m->tail.triangles++;
}
static void break_vertices(struct model *m)
{
	m->tail.vertices--;
}
static void break_blocks(struct model *m)
{
	m->tail.blocks--;
}
static void break_tail_box(struct model *m)
{
	m->tail.box[2]++;
}

static void break_final(struct model *m)
{
	uint32_t locals = m->block[1].nforeign + m->block[1].nnew;

	while (locals % 8 == 0)
		locals = m->block[1].nforeign + --m->block[1].nnew;
	m->data[1].final[locals / 8] |= 0x80;
}

static void test_broken_rules(void **state)
{
	static const struct {
		void (*brk)(struct model *);
		const char *text;
	} row[] = {
		{break_first, "numbers its vertices from"},
		{break_foreign, "not come yet"},
		{break_index, "comes after"},
		{break_corner, "corners"},
		{break_degenerate, "corners"},
		{break_box, "outside the box"},
		{break_count, "triangles"},
		{break_vertices, "vertices"},
		{break_blocks, "blocks"},
		{break_tail_box, "box in the tail"},
		{break_final, "final"},
	};
	static struct model m;

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		struct err err = ERR_INIT;

		do
			model_init(&m, 3);
		while (m.block[2].nforeign == 0);
		row[i].brk(&m);
		assert_int_equal(run_model(&m, &err), -ERR_PROTO);
		if (!strstr(err.message, row[i].text))
			fail_msg("row %zu: %s", i, err.message);
		assert_true(err.offset != ERR_NO_OFFSET);
	}
}

/* ---- changes ---- */

static void changes_round_trip(void **state)
{
	static struct model m;
	struct err err = ERR_INIT;

	for (uint32_t n = 0; n < 4; n++) {
		struct bytes all;
		bool done;

		model_init(&m, n ? BLOCKS : 0);
		model_changes(&m, n);
		all = model_bytes(&m);
		for (size_t cut = 1; cut < 5000; cut *= 7)
			assert_int_equal(run(&all, cut, &m, &done, &err), 0);
		assert_true(done);
		free(all.at);
	}
}

static void changes_every_byte(void **state)
{
	static struct model m;
	struct bytes all;
	bool done;

	model_init(&m, 1);
	m.head.view = "v";
	model_changes(&m, 3);
	all = model_bytes(&m);
	for (size_t i = 0; i < all.size; i++) {
		struct err err = ERR_INIT;

		all.at[i] ^= 1 << roll(8);
		assert_true(run(&all, all.size, NULL, &done, &err) < 0);
		all.at[i] ^= 255; /* whatever the bit was, another one stays wrong */
		err = ERR_INIT;
		assert_true(run(&all, all.size, NULL, &done, &err) < 0);
		free(all.at);
		all = model_bytes(&m);
	}
	free(all.at);
}

static void no_base(struct model *m)
{
	m->no_base = true;
	m->ngone = 0;
}

static void lists_alone(struct model *m)
{
	m->no_base = true;
}

static void base_of_a_mesh(struct model *m)
{
	m->head.kind = STREAM_WHOLE;
}

static void one_too_many(struct model *m)
{
	m->base.gone--;
	m->base.gone_triangles -= m->gone[2].triangles;
}

static void one_too_few(struct model *m)
{
	m->base.gone++;
}

static void other_triangles(struct model *m)
{
	m->base.gone_triangles++;
}

static void no_region(struct model *m)
{
	m->gone[1].box[2] = m->gone[1].box[0];
}

static void empty_region(struct model *m)
{
	m->base.gone_triangles -= m->gone[1].triangles;
	m->gone[1].triangles = 0;
}

static void changes_broken(void **state)
{
	static void (*const how[])(struct model *) = {no_base,     lists_alone,     base_of_a_mesh, one_too_many,
						      one_too_few, other_triangles, no_region,      empty_region};
	static struct model m;

	for (unsigned blocks = 0; blocks < 2; blocks++)
		for (size_t i = 0; i < sizeof how / sizeof *how; i++) {
			struct err err = ERR_INIT;

			model_init(&m, blocks * BLOCKS);
			model_changes(&m, 3);
			assert_int_equal(run_model(&m, &err), 0);
			how[i](&m);
			assert_int_equal(run_model(&m, &err), -ERR_PROTO);
		}
}

/* Regions behind a block, two bases: good checksums, a wrong place. */
static void changes_order(void **state)
{
	static uint8_t scratch[STREAM_SCRATCH];
	static struct model m;
	struct stream_piece piece[STREAM_PIECES];
	struct err err = ERR_INIT;
	struct bytes all = {0};
	bool done;

	model_init(&m, 1);
	model_changes(&m, 1);
	append(&all, piece, stream_put_head(&m.head, scratch, piece));
	append_changes(&m, &all);
	append(&all, piece, stream_put_block(&m.block[0], scratch, piece));
	append(&all, piece, stream_put_gone(m.gone, 1, scratch, piece));
	assert_int_equal(run(&all, all.size, NULL, &done, &err), -ERR_PROTO);
	all.size = 0;
	err = ERR_INIT;
	append(&all, piece, stream_put_head(&m.head, scratch, piece));
	append(&all, piece, stream_put_base(&m.base, scratch, piece));
	append(&all, piece, stream_put_base(&m.base, scratch, piece));
	assert_int_equal(run(&all, all.size, NULL, &done, &err), -ERR_PROTO);
	free(all.at);
}

static void test_kind_of_a_later_version(void **state)
{
	static struct model m;
	struct err err = ERR_INIT;

	model_init(&m, 0);
	m.head.kind = STREAM_CHANGES + 1;
	assert_int_equal(run_model(&m, &err), -ERR_UNSUPPORTED);
}

static void test_order_of_frames(void **state)
{
	static uint8_t scratch[STREAM_SCRATCH];
	static struct model m;
	struct stream_piece piece[STREAM_PIECES];
	struct bytes in = {0};
	struct err err = ERR_INIT;
	bool done;

	model_init(&m, 1);
	append(&in, piece, stream_put_block(&m.block[0], scratch, piece));
	assert_int_equal(run(&in, 1 << 20, NULL, &done, &err), -ERR_PROTO);
	assert_non_null(strstr(err.message, "start with its head"));
	in.size = 0;
	err_clear(&err);
	append(&in, piece, stream_put_head(&m.head, scratch, piece));
	append(&in, piece, stream_put_head(&m.head, scratch, piece));
	assert_int_equal(run(&in, 1 << 20, NULL, &done, &err), -ERR_PROTO);
	assert_non_null(strstr(err.message, "second head"));
	free(in.at);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_round_trip),
		cmocka_unit_test(test_every_byte_flipped),
		cmocka_unit_test(test_every_cut),
		cmocka_unit_test(test_more_than_a_tail),
		cmocka_unit_test(test_error_tail),
		cmocka_unit_test(test_broken_rules),
		cmocka_unit_test(test_kind_of_a_later_version),
		cmocka_unit_test(test_order_of_frames),
		cmocka_unit_test(changes_round_trip),
		cmocka_unit_test(changes_every_byte),
		cmocka_unit_test(changes_broken),
		cmocka_unit_test(changes_order),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
