/*
 * Fetching: a small mesh arrives with its numbers and digests agreed; a wrong digest, an error in the tail or
 * on the socket, a stream cut off, a receiver that gives up, a daemon that dies or stalls each end in the
 * right failure, with no descriptor left.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "fake.h"

/* Two blocks of one triangle each over four points; the second reuses two vertices of the first. */
static const int32_t vertex[4][3] = {{0, 0, 5}, {10, 0, 6}, {0, 10, 7}, {10, 10, -8}};
static const int64_t k[3] = {50000000, -600, 3};

enum how {
	GOOD,
	BAD_DIGEST,
	BAD_VERTEX_DIGEST,
	ERROR_TAIL,
	ERROR_SOCKET,
	CUT,
	DEATH,
	STALL,
	NO_PIPE,
	REFUSED,
	LATE_MESH,
	GIVEN_UP,
	OTHER_STREAM,
	CHANGES,       /* from here on with a base and a region that is gone */
	CHANGES_WRONG, /* whose digest is not the region's */
	CHANGES_OLDER, /* of another generation */
	CHANGES_CUT    /* short of a region */
};

/* The client: has heard of progress; has given up. */
static atomic_bool progressed, given_up;

struct server {
	enum how how;
	bool reader_gone;
	uint64_t from, since; /* of the last Fetch */
	char wanted[40];
};

static void put_blocks(struct stream_block b[2])
{
	static const uint64_t foreign[2] = {1, 2};
	static const uint32_t first[1][3] = {{0, 1, 2}}, second[1][3] = {{0, 2, 1}};
	static const uint8_t none = 0;

	b[0] = (struct stream_block){.index = 0, .nnew = 3, .ntriangle = 1, .vertex = vertex, .triangle = first, .final = &none};
	b[1] = (struct stream_block){.index = 4,
				     .box = {1, 3, 5, INT64_MAX},
				     .first = 3,
				     .nforeign = 2,
				     .nnew = 1,
				     .ntriangle = 1,
				     .foreign = foreign,
				     .vertex = &vertex[3],
				     .triangle = second,
				     .final = &none};
}

static void put_tail(struct stream_tail *tail, enum how how)
{
	static const unsigned triangle[2][3] = {{0, 1, 2}, {1, 3, 2}};

	*tail = (struct stream_tail){
		.blocks = 2, .vertices = 4, .triangles = 2, .hull = 4, .box = {0, 0, -8, 10, 10, 7}, .report = "{}"};
	for (unsigned i = 0; i < 4; i++)
		digest_add_vertex(&tail->vertex_digest, vertex[i][0] + k[0], vertex[i][1] + k[1], vertex[i][2] + k[2]);
	for (unsigned i = 0; i < 2; i++) {
		int64_t corner[3][2];

		for (unsigned j = 0; j < 3; j++)
			for (unsigned a = 0; a < 2; a++)
				corner[j][a] = vertex[triangle[i][j]][a] + k[a];
		digest_add_triangle(&tail->digest, corner);
	}
	tail->digest.lo += how == BAD_DIGEST;
	tail->vertex_digest.hi += how == BAD_VERTEX_DIGEST;
	if (how == ERROR_TAIL) {
		tail->failed = true;
		strcpy(tail->error_code, "no-space");
		strcpy(tail->error_message, "the disk is full");
		strcpy(tail->error_hint, "free some");
	}
}

static bool write_changes(int fd, const struct server *s, const struct stream_tail *tail)
{
	static uint8_t scratch[STREAM_SCRATCH];
	struct stream_base base = {.generation = s->how == CHANGES_OLDER ? 4 : 5,
				   .job = 2,
				   .old_digest = {100, 200},
				   .old_vertex_digest = {3, 4},
				   .vertex_digest = {5, 6},
				   .gone = 1,
				   .gone_triangles = 7,
				   .kept = 9,
				   .kept_triangles = 1000};
	struct stream_region gone = {{1, 3, INT64_MAX, 5}, 7, {90, 210}};
	struct stream_piece piece[STREAM_PIECES];

	base.digest = (struct digest){10, -10};
	digest_add(&base.digest, tail->digest);
	gone.digest.lo += s->how == CHANGES_WRONG;
	return fake_write(fd, piece, stream_put_base(&base, scratch, piece)) &&
	       (s->how == CHANGES_CUT || fake_write(fd, piece, stream_put_gone(&gone, 1, scratch, piece)));
}

static void write_stream(int fd, struct server *s)
{
	static uint8_t scratch[STREAM_SCRATCH];
	struct stream_head head = {.kind = s->how >= CHANGES ? STREAM_CHANGES : STREAM_WHOLE,
				   .lattice = "0.01 0.001 50000000 -600 3",
				   .crs = "EPSG:25832",
				   .unit_xy = "m",
				   .box = {-1, -1, -10, 10, 10, 10},
				   .id = {1, s->how == OTHER_STREAM ? 3 : 2}};
	struct stream_piece piece[STREAM_PIECES];
	struct stream_block block[2];
	struct stream_tail tail;
	bool ok;

	put_blocks(block);
	put_tail(&tail, s->how);
	ok = fake_write(fd, piece, stream_put_head(&head, scratch, piece)) && (s->how < CHANGES || write_changes(fd, s, &tail)) &&
	     (s->from > 0 || fake_write(fd, piece, stream_put_block(&block[0], scratch, piece)));
	if (s->how == CUT || s->how == DEATH || s->how == STALL || s->how == ERROR_SOCKET)
		return;
	if (s->how == LATE_MESH)
		fake_wait(&progressed);
	if (s->how == GIVEN_UP)
		poll(&(struct pollfd){.fd = fd}, 1, 100000); /* until nobody reads */
	ok = ok && (s->from > 1 || fake_write(fd, piece, stream_put_block(&block[1], scratch, piece))) &&
	     fake_write(fd, piece, stream_put_tail(&tail, scratch, piece));
	s->reader_gone = !ok;
}

static void send_error(struct fake *f, uint32_t id)
{
	Acut__V1__Error error = ACUT__V1__ERROR__INIT;

	error.code = "does-not-fit";
	error.message = "set memory to 1G";
	fake_send(f, id, FRAME_MESSAGE(ERROR, error, &error), -1);
}

static void serve_fetch(struct fake *f, uint32_t id)
{
	struct server *s = f->ctx;
	Acut__V1__Fetching fetching = ACUT__V1__FETCHING__INIT;
	Acut__V1__Progress progress = ACUT__V1__PROGRESS__INIT;
	int fds[2];

	if (s->how == REFUSED) {
		send_error(f, id);
		return;
	}
	if (s->how == NO_PIPE) {
		fake_send(f, id, FRAME_MESSAGE(FETCHING, fetching, &fetching), -1);
		return;
	}
	fake_pipe(fds);
	fake_send(f, id, FRAME_MESSAGE(FETCHING, fetching, &fetching), fds[0]);
	progress.phase = "mesh";
	progress.domains = 1;
	fake_send(f, id, FRAME_MESSAGE(PROGRESS, progress, &progress), -1);
	write_stream(fds[1], s);
	if (s->how == ERROR_SOCKET)
		send_error(f, id);
	if (s->how == DEATH)
		fake_close(f);
	if (s->how == STALL)
		fake_wait(&given_up);
	close(fds[1]);
}

static void serve(struct fake *f)
{
	Acut__V1__Hello hello = ACUT__V1__HELLO__INIT;
	Acut__V1__Done done = ACUT__V1__DONE__INIT;
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	hello.version_min = hello.version_max = 1;
	while (f->conn && fake_recv(f, &id, &m, &fd)) {
		if (m->body_case == ACUT__V1__MESSAGE__BODY_FETCH) {
			struct server *s = f->ctx;

			s->from = m->fetch->from_block;
			s->since = m->fetch->changed_since;
			snprintf(s->wanted, sizeof s->wanted, "%s", m->fetch->stream_id);
			serve_fetch(f, id);
		} else if (m->body_case == ACUT__V1__MESSAGE__BODY_HELLO)
			fake_send(f, id, FRAME_MESSAGE(HELLO, hello, &hello), -1);
		else
			fake_send(f, id, FRAME_MESSAGE(DONE, done, &done), -1);
		frame_message_free(m);
	}
}

struct got {
	unsigned heads, blocks, tails, progress, stop_at, bases, gone;
	struct acut_mesh_head head;
	char coordinate[48], stream_id[40];
	double x;
};

static int got_head(void *ctx, const struct acut_mesh_head *head)
{
	struct got *got = ctx;

	got->heads++;
	got->head = *head;
	strcpy(got->stream_id, head->stream_id);
	assert_string_equal(head->scale_xy, "0.01");
	assert_string_equal(head->scale_z, "0.001");
	assert_string_equal(head->crs, "EPSG:25832");
	got->x = acut_coordinate(head, 0, 10);
	assert_true(acut_coordinate(head, 2, -8) == -0.005);
	acut_coordinate_text(head, 1, 7, got->coordinate);
	return 0;
}

static int got_block(void *ctx, const struct acut_mesh_block *b)
{
	struct got *got = ctx;

	if (++got->blocks == 2) {
		assert_int_equal(b->index, 4);
		assert_int_equal(b->box[1], 3);
		assert_int_equal(b->first, 3);
		assert_int_equal(b->foreign[1], 2);
		assert_int_equal(b->vertex[0][2], -8);
		assert_int_equal(b->triangle[0][1], 2);
	}
	return got->stop_at == got->blocks;
}

static int got_tail(void *ctx, const struct acut_mesh_tail *tail)
{
	struct got *got = ctx;

	got->tails++;
	assert_int_equal(tail->triangles, 2);
	assert_int_equal(tail->box[2], -8);
	assert_int_equal(strlen(tail->digest), 32);
	assert_string_equal(tail->report, "{}");
	return 0;
}

static void got_progress(void *ctx, const struct acut_progress *p)
{
	struct got *got = ctx;

	got->progress += strcmp(p->phase, "mesh") == 0;
	progressed = true;
}

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
	free(bytes);
	free(first.state);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_goes_on),
		cmocka_unit_test(test_does_not_go_on),
		cmocka_unit_test(test_good),
		cmocka_unit_test(test_progress),
		cmocka_unit_test(test_changes),
		cmocka_unit_test(test_by_steps),
		cmocka_unit_test(test_steps_fail),
		cmocka_unit_test(test_failures),
		cmocka_unit_test(test_error_on_the_socket),
		cmocka_unit_test(test_stalled),
		cmocka_unit_test(test_interrupted),
		cmocka_unit_test(test_receiver_gives_up),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
