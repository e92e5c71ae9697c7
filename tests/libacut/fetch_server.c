#include "fetch_server.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static const int32_t vertex[4][3] = {{0, 0, 5}, {10, 0, 6}, {0, 10, 7}, {10, 10, -8}};
static const int64_t k[3] = {50000000, -600, 3};

atomic_bool progressed, given_up;

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

void serve(struct fake *f)
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

int got_head(void *ctx, const struct acut_mesh_head *head)
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

int got_block(void *ctx, const struct acut_mesh_block *b)
{
	struct got *got = ctx;

	if (++got->blocks == 2) {
		assert_int_equal(b->index, 4);
		assert_int_equal(b->box[1], 3);
		assert_int_equal(b->first, 3);
		assert_int_equal(b->foreign[1], 2);
		assert_int_equal(b->vertex[0][2], -8);
		assert_int_equal(b->triangle[0][1], 2);
		/* of vertices 1 and 2, also in a fetch that goes on, then its own */
		assert_memory_equal(b->local, vertex[1], 3 * sizeof vertex[0]);
	}
	return got->stop_at == got->blocks;
}

int got_tail(void *ctx, const struct acut_mesh_tail *tail)
{
	struct got *got = ctx;

	got->tails++;
	assert_int_equal(tail->triangles, 2);
	assert_int_equal(tail->box[2], -8);
	assert_int_equal(strlen(tail->digest), 32);
	assert_string_equal(tail->report, "{}");
	return 0;
}

void got_progress(void *ctx, const struct acut_progress *p)
{
	struct got *got = ctx;

	got->progress += strcmp(p->phase, "mesh") == 0;
	progressed = true;
}
