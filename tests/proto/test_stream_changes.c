/* The mesh stream: changes against an earlier mesh. */
#include "stream_model.h"

#include <stdlib.h>
#include <string.h>

static void changes_round_trip(void **state)
{
	static struct model m;
	struct err err = ERR_INIT;

	for (uint32_t n = 0; n < 4; n++) {
		struct stream_bytes all;
		bool done;

		model_init(&m, n ? BLOCKS : 0);
		model_changes(&m, n);
		all = model_bytes(&m);
		for (size_t cut = 1; cut < 5000; cut *= 7)
			assert_int_equal(model_run(&all, cut, &m, &done, &err), 0);
		assert_true(done);
		free(all.at);
	}
}

static void changes_every_byte(void **state)
{
	static struct model m;
	struct stream_bytes all;
	bool done;

	model_init(&m, 1);
	m.head.view = "v";
	model_changes(&m, 3);
	all = model_bytes(&m);
	for (size_t i = 0; i < all.size; i++) {
		struct err err = ERR_INIT;

		all.at[i] ^= 1 << model_roll(8);
		assert_true(model_run(&all, all.size, NULL, &done, &err) < 0);
		all.at[i] ^= 255; /* whatever the bit was, another one stays wrong */
		err = ERR_INIT;
		assert_true(model_run(&all, all.size, NULL, &done, &err) < 0);
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
			assert_int_equal(model_run_whole(&m, &err), 0);
			how[i](&m);
			assert_int_equal(model_run_whole(&m, &err), -ERR_PROTO);
		}
}

/* Regions after a block, two bases: valid checksums, wrong order. */
static void changes_order(void **state)
{
	static uint8_t scratch[STREAM_SCRATCH];
	static struct model m;
	struct stream_piece piece[STREAM_PIECES];
	struct err err = ERR_INIT;
	struct stream_bytes all = {0};
	bool done;

	model_init(&m, 1);
	model_changes(&m, 1);
	model_append(&all, piece, stream_put_head(&m.head, scratch, piece));
	model_append_changes(&m, &all);
	model_append(&all, piece, stream_put_block(&m.block[0], scratch, piece));
	model_append(&all, piece, stream_put_gone(m.gone, 1, scratch, piece));
	assert_int_equal(model_run(&all, all.size, NULL, &done, &err), -ERR_PROTO);
	all.size = 0;
	err = ERR_INIT;
	model_append(&all, piece, stream_put_head(&m.head, scratch, piece));
	model_append(&all, piece, stream_put_base(&m.base, scratch, piece));
	model_append(&all, piece, stream_put_base(&m.base, scratch, piece));
	assert_int_equal(model_run(&all, all.size, NULL, &done, &err), -ERR_PROTO);
	free(all.at);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(changes_round_trip),
		cmocka_unit_test(changes_every_byte),
		cmocka_unit_test(changes_broken),
		cmocka_unit_test(changes_order),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
