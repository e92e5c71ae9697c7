/* A fetch step by step, and a fetch that goes on with the state of an earlier one. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "fetch_server.h"

/* ---- piece by piece ---- */

static const struct acut_mesh_block *piece;
static struct acut_mesh_block kept_piece;

static int keep_piece(void *ctx, const struct acut_mesh_block *b)
{
	kept_piece = *b;
	piece = &kept_piece;
	return got_block(ctx, b);
}

static void check_arrays(const struct got *got, unsigned block)
{
	static const uint64_t want[2][3] = {{0, 1, 2}, {1, 3, 2}};
	double xyz[3][3];
	uint64_t triangle[1][3];

	acut_block_triangles(piece, triangle);
	assert_memory_equal(triangle[0], want[block], sizeof triangle);
	acut_block_coordinates(&got->head, piece, xyz);
	for (unsigned i = 0; i < piece->nnew; i++)
		for (int axis = 0; axis < 3; axis++)
			assert_true(xyz[i][axis] == acut_coordinate(&got->head, axis, piece->vertex[i][axis]));
}

/* Frames one at a time, what a block brought lies still between them; the end ends it; so do another call, and the caller. */
static void test_by_steps(void **state)
{
	struct got got = {0};
	struct acut_changes_sink sink = {{got_head, keep_piece, got_tail, got_progress, &got}, NULL, NULL};
	unsigned before = fake_open_descriptors();
	struct server s = {.how = GOOD};
	struct acut *a;
	struct fake *f;
	double seconds;
	void *bytes;
	size_t size;
	int fd;

	f = fake_start(serve, &s, &fd);
	assert_int_equal(acut_attach(fd, NULL, &a), 0);
	assert_int_equal(acut_fetch_step(a), -ACUT_E_USAGE);
	assert_int_equal(acut_fetch_begin(a, 3, 0, NULL, 0, &sink), 0);
	assert_int_equal(got.heads, 0);
	assert_int_equal(acut_fetch_step(a), 1);
	assert_int_equal(got.heads, 1);
	for (unsigned i = 0; i < 2; i++) {
		assert_int_equal(acut_fetch_step(a), 1);
		assert_int_equal(got.blocks, i + 1);
		check_arrays(&got, i);
		if (i == 0)
			assert_int_equal(acut_fetch_state(a, &bytes, &size), 0);
	}
	assert_int_equal(acut_fetch_step(a), 1);
	assert_int_equal(got.tails, 1);
	assert_int_equal(acut_fetch_step(a), 0);
	assert_int_equal(acut_fetch_step(a), -ACUT_E_USAGE);

	got = (struct got){.blocks = 1};
	assert_int_equal(acut_fetch_begin(a, 0, 0, bytes, size, &sink), 0);
	while (acut_fetch_step(a) == 1)
		;
	assert_int_equal(s.from, 1);
	assert_int_equal(got.tails, 1);
	assert_int_equal(acut_fetch_begin(a, 0, 5, bytes, size, &sink), -ACUT_E_USAGE);
	assert_int_equal(acut_fetch_begin(a, 0, 0, bytes, size - 1, &sink), -ACUT_E_CORRUPT);
	assert_int_equal(acut_fetch_step(a), -ACUT_E_USAGE);
	free(bytes);

	assert_int_equal(acut_fetch_begin(a, 3, 0, NULL, 0, &sink), 0);
	assert_int_equal(acut_fetch_step(a), 1);
	acut_fetch_end(a);
	acut_fetch_end(a);
	assert_int_equal(acut_fetch_step(a), -ACUT_E_USAGE);
	assert_int_equal(acut_fetch_begin(a, 3, 0, NULL, 0, &sink), 0);
	assert_int_equal(acut_ping(a, &seconds), 0);
	assert_int_equal(acut_fetch_step(a), -ACUT_E_USAGE);
	acut_close(a);
	fake_stop(f);
	assert_int_equal(fake_open_descriptors(), before);
}

/* A failure comes from the step that meets it. */
static void test_steps_fail(void **state)
{
	static const struct {
		enum how how;
		int code;
	} row[] = {{BAD_DIGEST, ACUT_E_DIGEST}, {ERROR_TAIL, ACUT_E_NOSPACE}, {CUT, ACUT_E_IO}, {CHANGES, ACUT_E_PROTO}};

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		struct got got = {0};
		struct acut_changes_sink sink = {{got_head, got_block, got_tail, NULL, &got}, NULL, NULL};
		struct server s = {.how = row[i].how};
		struct acut *a;
		struct fake *f;
		int fd, r;

		f = fake_start(serve, &s, &fd);
		assert_int_equal(acut_attach(fd, NULL, &a), 0);
		assert_int_equal(acut_fetch_begin(a, 3, 0, NULL, 0, &sink), 0);
		while ((r = acut_fetch_step(a)) == 1)
			;
		if (r != -row[i].code)
			fail_msg("row %zu: %d %s", i, r, acut_error(a)->message);
		assert_int_equal(got.tails, 0);
		assert_int_equal(acut_fetch_step(a), -ACUT_E_USAGE);
		acut_close(a);
		fake_stop(f);
	}
}

/* ---- going on ---- */

struct keeper {
	struct got got;
	struct acut *a;
	unsigned keep_at; /* block in whose callback the state is taken */
	void *state;
	size_t size;
};

static int keep_head(void *ctx, const struct acut_mesh_head *head)
{
	return got_head(&((struct keeper *)ctx)->got, head);
}

static int keep_block(void *ctx, const struct acut_mesh_block *b)
{
	struct keeper *keep = ctx;

	/* blocks go on counting: the second one is checked whoever brings it */
	if (++keep->got.blocks == keep->keep_at)
		assert_int_equal(acut_fetch_state(keep->a, &keep->state, &keep->size), 0);
	return keep->got.stop_at == keep->got.blocks;
}

static int keep_tail(void *ctx, const struct acut_mesh_tail *tail)
{
	return got_tail(&((struct keeper *)ctx)->got, tail);
}

static int fetch_kept(struct keeper *keep, struct server *s, const void *state, size_t size)
{
	struct acut_mesh_sink sink = {keep_head, keep_block, keep_tail, NULL, keep};
	struct fake *f;
	void *after = NULL;
	size_t after_size;
	int fd, r;

	f = fake_start(serve, s, &fd);
	assert_int_equal(acut_attach(fd, NULL, &keep->a), 0);
	r = state ? acut_fetch_from(keep->a, state, size, &sink) : acut_fetch(keep->a, 3, &sink);
	if (!keep->keep_at && acut_fetch_state(keep->a, &after, &after_size) == 0) {
		keep->state = after;
		keep->size = after_size;
	}
	acut_close(keep->a);
	fake_stop(f);
	return r;
}

static void goes_on(unsigned keep_at, enum how how, uint64_t from)
{
	struct keeper first = {.keep_at = keep_at}, second = {0};
	struct server s = {.how = how};

	fetch_kept(&first, &s, NULL, 0);
	assert_non_null(first.state);
	s = (struct server){.how = GOOD};
	assert_int_equal(fetch_kept(&second, &s, first.state, first.size), 0);
	assert_int_equal(s.from, from);
	assert_string_equal(s.wanted, from ? "00000000000000010000000000000002" : s.wanted);
	assert_int_equal(second.got.blocks, 2 - from);
	assert_int_equal(second.got.heads, 1);
	assert_int_equal(second.got.tails, 1);
	free(first.state);
	free(second.state);
}

/* With the state as of any block, in the callback or after a failure; digests are of the whole mesh. */
static void test_goes_on(void **state)
{
	goes_on(1, GOOD, 1);
	goes_on(2, GOOD, 2);
	goes_on(0, CUT, 1);
	goes_on(0, DEATH, 1);
	goes_on(0, ERROR_TAIL, 2);
	goes_on(0, BAD_DIGEST, 2);
}

static void test_does_not_go_on(void **state)
{
	struct keeper first = {.keep_at = 1}, other = {0};
	struct server s = {.how = GOOD};
	uint64_t sum;
	uint8_t *bytes;

	/* A block that the receiver did not take is in no state. */
	other.got.stop_at = 1;
	assert_int_equal(fetch_kept(&other, &s, NULL, 0), -ACUT_E_CANCELLED);
	assert_null(other.state);
	assert_int_equal(fetch_kept(&first, &s, NULL, 0), 0);

	s = (struct server){.how = OTHER_STREAM};
	other = (struct keeper){0};
	assert_int_equal(fetch_kept(&other, &s, first.state, first.size), -ACUT_E_PROTO);
	assert_int_equal(other.got.heads + other.got.blocks, 0);
	/* A daemon that begins at another block. */
	s = (struct server){.how = BAD_DIGEST};
	assert_int_equal(fetch_kept(&other, &s, first.state, first.size), -ACUT_E_DIGEST);
	free(other.state);

	bytes = malloc(first.size);
	for (size_t i = 0; i < first.size; i++) {
		memcpy(bytes, first.state, first.size);
		bytes[i] ^= 1;
		other = (struct keeper){0};
		s = (struct server){.how = GOOD};
		assert_int_equal(fetch_kept(&other, &s, bytes, first.size), -ACUT_E_CORRUPT);
		assert_int_equal(fetch_kept(&other, &s, first.state, i), -ACUT_E_CORRUPT);
		i += i > 16 ? 16 : 0;
	}
	memcpy(bytes, first.state, first.size);
	bytes[4]--; /* the version */
	sum = XXH3_64bits(bytes, first.size - sizeof(sum));
	memcpy(bytes + first.size - sizeof(sum), &sum, sizeof(sum));
	assert_int_equal(fetch_kept(&other, &s, bytes, first.size), -ACUT_E_VERSION);
	free(bytes);
	free(first.state);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_by_steps),
		cmocka_unit_test(test_steps_fail),
		cmocka_unit_test(test_goes_on),
		cmocka_unit_test(test_does_not_go_on),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
