/*
 * The mesh stream: what is written is read again, however the bytes are divided; every flipped bit and every truncation
 * is found, and so is a writer that breaks the rules with valid checksums.
 */
#include "stream_model.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void test_round_trip(void **state)
{
	static struct model m;
	static const size_t cuts[] = {1, 7, 100, 5000, 1 << 20};

	for (unsigned turn = 0; turn < 50; turn++) {
		struct err err = ERR_INIT;
		struct stream_bytes in;
		bool done;

		model_init(&m, turn % (BLOCKS + 1));
		in = model_bytes(&m);
		assert_int_equal(model_run(&in, cuts[turn % 5], &m, &done, &err), 0);
		assert_true(done);
		free(in.at);
	}
}

static void test_every_byte_flipped(void **state)
{
	static struct model m;
	struct stream_bytes in;

	model_init(&m, 3);
	in = model_bytes(&m);
	for (size_t i = 0; i < in.size; i++) {
		struct err err = ERR_INIT;
		bool done;

		in.at[i] ^= (uint8_t)(1u << model_roll(8));
		assert_true(model_run(&in, 1 << 20, NULL, &done, &err) < 0);
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
	struct stream_bytes in, cut;

	model_init(&m, 2);
	in = model_bytes(&m);
	cut = in;
	for (cut.size = 0; cut.size < in.size; cut.size++) {
		struct err err = ERR_INIT;
		bool done;

		assert_int_equal(model_run(&cut, 1 << 20, NULL, &done, &err), 0);
		assert_false(done);
	}
	free(in.at);
}

static void test_more_than_a_tail(void **state)
{
	static struct model m;
	struct err err = ERR_INIT;
	struct stream_bytes in;
	bool done;

	model_init(&m, 1);
	in = model_bytes(&m);
	in.at = realloc(in.at, in.size + 8);
	memset(in.at + in.size, 0, 8);
	in.size += 8;
	assert_int_equal(model_run(&in, 1 << 20, NULL, &done, &err), -ERR_PROTO);
	free(in.at);
}

static void test_error_tail(void **state)
{
	static struct model m;
	struct err err = ERR_INIT;

	model_init(&m, 2);
	m.tail.failed = true;
	m.tail.blocks = 99; /* the counts of a failed stream are not checked */
	strcpy(m.tail.error_code, "io");
	assert_int_equal(model_run_whole(&m, &err), 0);
}

/* Each breaks one rule; checksums are valid. */
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
		assert_int_equal(model_run_whole(&m, &err), -ERR_PROTO);
		if (!strstr(err.message, row[i].text))
			fail_msg("row %zu: %s", i, err.message);
		assert_true(err.offset != ERR_NO_OFFSET);
	}
}

static void test_kind_of_a_later_version(void **state)
{
	static struct model m;
	struct err err = ERR_INIT;

	model_init(&m, 0);
	m.head.kind = STREAM_CHANGES + 1;
	assert_int_equal(model_run_whole(&m, &err), -ERR_UNSUPPORTED);
}

static void test_order_of_frames(void **state)
{
	static uint8_t scratch[STREAM_SCRATCH];
	static struct model m;
	struct stream_piece piece[STREAM_PIECES];
	struct stream_bytes in = {0};
	struct err err = ERR_INIT;
	bool done;

	model_init(&m, 1);
	model_append(&in, piece, stream_put_block(&m.block[0], scratch, piece));
	assert_int_equal(model_run(&in, 1 << 20, NULL, &done, &err), -ERR_PROTO);
	assert_non_null(strstr(err.message, "start with its head"));
	in.size = 0;
	err_clear(&err);
	model_append(&in, piece, stream_put_head(&m.head, scratch, piece));
	model_append(&in, piece, stream_put_head(&m.head, scratch, piece));
	assert_int_equal(model_run(&in, 1 << 20, NULL, &done, &err), -ERR_PROTO);
	assert_non_null(strstr(err.message, "second head"));
	free(in.at);
}

/* Whatever the padding is; a reader that did not ask gets the bytes that it always got. */
static void test_system(void **state)
{
	static const size_t sizes[] = {0, 1, 5, 300, STREAM_WKT_MAX, STREAM_WKT_MAX + 1};
	static char wkt[STREAM_WKT_MAX + 2], view[AREA_TEXT_MAX + 1];
	static struct model m;

	model_init(&m, 1);
	memcpy(view, m.head.view, sizeof view);
	m.head.view = view;
	m.head.wkt = wkt;
	for (unsigned turn = 0; turn < 8 * 6 * 3; turn++) {
		size_t size = sizes[turn / 8 % 6];
		struct stream_bytes with, without;
		struct err err = ERR_INIT;
		bool done;

		view[turn % 8] = 0;
		memset(wkt, 'w', size);
		wkt[size] = 0;
		snprintf(m.head.geoid, sizeof m.head.geoid, "%.*s", (int)(turn / 48 * 63), view + sizeof view - 200);
		m.head.system = false;
		without = model_bytes(&m);
		assert_int_equal(model_run(&without, 1 << 20, &m, &done, &err), 0);
		m.head.system = true;
		with = model_bytes(&m);
		wkt[size < STREAM_WKT_MAX ? size : STREAM_WKT_MAX] = 0;
		assert_int_equal(model_run(&with, 1 << 20, &m, &done, &err), 0);
		assert_true(with.size >= without.size + size / 8 * 8);
		free(with.at);
		free(without.at);
		view[turn % 8] = 'v';
	}
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
		cmocka_unit_test(test_system),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
