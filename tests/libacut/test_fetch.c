/*
 * A fetch in one call: a small mesh arrives, and its numbers and digests agree. A wrong digest, an error in the tail or on the
 * socket, a stream that ends early, a receiver that gives up, a daemon that dies or stalls: each gives the right error, and no
 * descriptor stays open.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fetch_server.h"

static int fetch(enum how how, const struct acut_options *options, unsigned stop_at, struct got *got, char *message,
		 struct server *s)
{
	struct acut_mesh_sink sink = {got_head, got_block, got_tail, got_progress, got};
	unsigned before = fake_open_descriptors();
	struct fake *f;
	struct acut *a;
	double seconds;
	int fd, r;

	*got = (struct got){.stop_at = stop_at};
	*s = (struct server){.how = how};
	progressed = false;
	f = fake_start(serve, s, &fd);
	assert_int_equal(acut_attach(fd, options, &a), 0);
	r = acut_fetch(a, 3, &sink);
	strcpy(message, acut_error(a)->message);
	if (how != DEATH)
		assert_int_equal(acut_ping(a, &seconds), 0); /* the connection goes on */
	acut_close(a);
	fake_stop(f);
	assert_int_equal(fake_open_descriptors(), before);
	return r;
}

static void test_good(void **state)
{
	char message[512];
	struct server s;
	struct got got;

	assert_int_equal(fetch(GOOD, NULL, 0, &got, message, &s), 0);
	assert_int_equal(got.heads, 1);
	assert_int_equal(got.blocks, 2);
	assert_int_equal(got.tails, 1);
	assert_true(got.x == 500000.10);
	assert_string_equal(got.coordinate, "-5.93");
	assert_int_equal(got.head.k[1], -600);
	assert_string_equal(got.stream_id, "00000000000000010000000000000002");
}

/* While the mesh takes its time, progress comes through. */
static void test_progress(void **state)
{
	char message[512];
	struct server s;
	struct got got;

	assert_int_equal(fetch(LATE_MESH, NULL, 0, &got, message, &s), 0);
	assert_int_equal(got.tails, 1);
	assert_int_equal(got.progress, 1);
}

static void test_failures(void **state)
{
	static const struct {
		enum how how;
		int code;
		unsigned blocks;
		const char *text;
	} row[] = {
		{BAD_DIGEST, ACUT_E_DIGEST, 2, "the digest"},
		{BAD_VERTEX_DIGEST, ACUT_E_DIGEST, 2, "vertex digest"},
		{ERROR_TAIL, ACUT_E_NOSPACE, 2, "disk is full"},
		{CUT, ACUT_E_IO, 1, "before its tail"},
		{DEATH, ACUT_E_NODAEMON, 1, "closed the connection"},
		{NO_PIPE, ACUT_E_PROTO, 0, "no pipe"},
		{REFUSED, ACUT_E_LIMIT, 0, "set memory"},
	};

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		char message[512];
		struct server s;
		struct got got;

		assert_int_equal(fetch(row[i].how, NULL, 0, &got, message, &s), -row[i].code);
		if (!strstr(message, row[i].text))
			fail_msg("row %zu: %s", i, message);
		assert_int_equal(got.blocks, row[i].blocks);
		assert_int_equal(got.tails, 0);
	}
}

/* ---- changes ---- */

static int got_base(void *ctx, const struct acut_mesh_base *b)
{
	struct got *got = ctx;

	assert_int_equal(got->heads, 1);
	assert_int_equal(got->blocks, 0);
	assert_int_equal(b->job, 2);
	assert_int_equal(b->kept_triangles, 1000);
	assert_string_equal(b->old_digest, "000000000000006400000000000000c8");
	got->bases++;
	return 0;
}

static int got_gone(void *ctx, const struct acut_mesh_region *g)
{
	struct got *got = ctx;

	assert_int_equal(got->bases, 1);
	assert_int_equal(g->box[2], INT64_MAX);
	assert_int_equal(g->triangles, 7);
	assert_int_equal(strlen(g->digest), 32);
	got->gone++;
	return got->stop_at == 99;
}

static int fetch_changes(enum how how, uint64_t since, unsigned stop_at, struct got *got, char *message, struct server *s)
{
	struct acut_changes_sink sink = {{got_head, got_block, got_tail, NULL, got}, got_base, got_gone};
	unsigned before = fake_open_descriptors();
	struct fake *f;
	struct acut *a;
	size_t size;
	void *state;
	int fd, r;

	*got = (struct got){.stop_at = stop_at};
	*s = (struct server){.how = how};
	progressed = false;
	f = fake_start(serve, s, &fd);
	assert_int_equal(acut_attach(fd, NULL, &a), 0);
	r = acut_fetch_changes(a, 3, since, &sink);
	strcpy(message, acut_error(a)->message);
	assert_true(acut_fetch_state(a, &state, &size) < 0); /* it cannot be gone on with */
	acut_close(a);
	fake_stop(f);
	assert_int_equal(fake_open_descriptors(), before);
	return r;
}

static void test_changes(void **state)
{
	static const struct {
		enum how how;
		int code;
		unsigned stop_at;
		const char *text;
	} row[] = {
		{CHANGES_WRONG, ACUT_E_DIGEST, 0, "with these changes has the digest"},
		{CHANGES_OLDER, ACUT_E_PROTO, 0, "since 4 came"},
		{CHANGES_CUT, ACUT_E_PROTO, 0, "1 regions"},
		{CHANGES, ACUT_E_CANCELLED, 99, "gave up"},
		{CHANGES, ACUT_E_CANCELLED, 1, "gave up"},
		{GOOD, ACUT_E_PROTO, 0, "changes were asked for"},
	};
	char message[512];
	struct server s;
	struct got got;

	assert_int_equal(fetch_changes(CHANGES, 5, 0, &got, message, &s), 0);
	assert_int_equal(s.since, 5);
	assert_int_equal(got.gone, 1);
	assert_int_equal(got.blocks, 2);
	assert_int_equal(got.tails, 1);
	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		int r = fetch_changes(row[i].how, 5, row[i].stop_at, &got, message, &s);

		if (r != -row[i].code || !strstr(message, row[i].text))
			fail_msg("row %zu: %d %s", i, r, message);
		assert_int_equal(got.tails, 0);
	}
	assert_int_equal(fetch_changes(CHANGES, 0, 0, &got, message, &s), -ACUT_E_USAGE);
	/* Whoever asked for a mesh must not take changes for one. */
	assert_int_equal(fetch(CHANGES, NULL, 0, &got, message, &s), -ACUT_E_PROTO);
	assert_non_null(strstr(message, "a mesh was asked for"));
	assert_int_equal(s.since, 0);
}

static void test_error_on_the_socket(void **state)
{
	char message[512];
	struct server s;
	struct got got;

	assert_int_equal(fetch(ERROR_SOCKET, NULL, 0, &got, message, &s), -ACUT_E_LIMIT);
	assert_string_equal(message, "set memory to 1G");
	assert_int_equal(got.tails, 0);
}

static void test_stalled(void **state)
{
	struct acut_options options = {.timeout = 0.1};
	struct server s = {.how = STALL};
	struct got got = {0};
	struct acut_mesh_sink sink = {got_head, got_block, got_tail, got_progress, &got};
	struct fake *f;
	struct acut *a;
	int fd;

	given_up = false;
	fake_stop_time();
	f = fake_start(serve, &s, &fd);
	assert_int_equal(acut_attach(fd, &options, &a), 0);
	fake_let_time();
	assert_int_equal(acut_fetch(a, 3, &sink), -ACUT_E_TIMEOUT);
	given_up = true;
	acut_close(a);
	fake_stop(f);
}

static int always(void *ctx)
{
	return *(int *)ctx;
}

static int interrupt_head(void *ctx, const struct acut_mesh_head *head)
{
	*(int *)ctx = 1;
	return 0;
}

static void test_interrupted(void **state)
{
	int stop = 0;
	struct acut_options options = {.interrupted = always, .ctx = &stop};
	struct acut_mesh_sink sink = {.head = interrupt_head, .ctx = &stop};
	struct server s = {.how = STALL};
	struct fake *f;
	struct acut *a;
	int fd;

	given_up = false;
	f = fake_start(serve, &s, &fd);
	assert_int_equal(acut_attach(fd, &options, &a), 0);
	assert_int_equal(acut_fetch(a, 3, &sink), -ACUT_E_CANCELLED);
	given_up = true;
	acut_close(a);
	fake_stop(f);
}

/* The receiver gives up: the writer finds nobody reading. */
static void test_receiver_gives_up(void **state)
{
	char message[512];
	struct server s;
	struct got got;

	assert_int_equal(fetch(GIVEN_UP, NULL, 1, &got, message, &s), -ACUT_E_CANCELLED);
	assert_int_equal(got.blocks, 1);
	assert_true(s.reader_gone);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_good),
		cmocka_unit_test(test_progress),
		cmocka_unit_test(test_changes),
		cmocka_unit_test(test_failures),
		cmocka_unit_test(test_error_on_the_socket),
		cmocka_unit_test(test_stalled),
		cmocka_unit_test(test_interrupted),
		cmocka_unit_test(test_receiver_gives_up),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
