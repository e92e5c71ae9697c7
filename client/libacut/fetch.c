/*
 * Fetching a mesh: the daemon hands over the reading end of a pipe, the bytes go through the stream reader, each block is
 * checked and then given to the sink. The socket is watched meanwhile, since progress and errors come there. Closing the pipe
 * is enough to give up. fetch_state.c continues an earlier fetch, fetch_step.c stops after each frame.
 */
#include "fetch.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "parse.h"

enum { READS_A_LOOK = 32 }; /* reads from the pipe between two polls of the socket */

static int from_sink(struct fetch *f, int r)
{
	return r == 0 ? 0 : err_set(&f->acut->err, ERR_CANCELLED, "the receiver of the mesh gave up");
}

/* ---- frames ---- */

/* Another head is valid only before a tail with a reason. */
static bool is_same(const struct fetch *f, const struct stream_head *head)
{
	return digest_equal(head->id, f->id) && memcmp(f->feed.head.k, f->k, sizeof f->k) == 0;
}

static int other_stream(struct fetch *f)
{
	return err_set(&f->acut->err, ERR_PROTO, "the daemon went on with another stream");
}

static int unasked_kind(struct fetch *f)
{
	return err_set(&f->acut->err, ERR_PROTO,
		       f->changes ? "changes were asked for, and the mesh stream has none" :
				    "a mesh was asked for, and the mesh stream has changes");
}

static int go_on(struct fetch *f)
{
	f->torn = true;
	if (check_unpack(f->feed.check, &f->state, &f->acut->err) < 0)
		return -(int)f->acut->err.code;
	f->torn = false;
	return 0;
}

static int on_head(struct fetch *f)
{
	const struct stream_head *head = stream_reader_head(f->reader);
	int r = feed_begin(&f->feed, head, &f->acut->err);

	if (r < 0)
		return r;
	/* A stream that failed early has another kind, and a tail with a reason. */
	f->unasked = (head->kind == STREAM_CHANGES) != (f->changes != NULL);
	f->other = f->continued && !is_same(f, head);
	if (f->other) {
		f->torn = true;
		return 0;
	}
	r = f->continued ? go_on(f) : 0;
	if (r < 0)
		return r;
	f->id = head->id;
	return feed_head(&f->feed, head, &f->acut->err);
}

static int on_base(struct fetch *f)
{
	const struct stream_base *b = stream_reader_base(f->reader);
	char hex[4][DIGEST_HEX_SIZE];
	const struct acut_mesh_base out = {
		.generation = b->generation,
		.job = b->job,
		.old_digest = digest_hex(b->old_digest, hex[0]),
		.old_vertex_digest = digest_hex(b->old_vertex_digest, hex[1]),
		.digest = digest_hex(b->digest, hex[2]),
		.vertex_digest = digest_hex(b->vertex_digest, hex[3]),
		.gone = b->gone,
		.gone_triangles = b->gone_triangles,
		.kept = b->kept,
		.kept_triangles = b->kept_triangles,
	};

	if (!f->changes)
		return unasked_kind(f);
	if (b->generation != f->since)
		return err_set(&f->acut->err, ERR_PROTO, "changes since generation %llu were asked for, since %llu came",
			       (unsigned long long)f->since, (unsigned long long)b->generation);
	return f->changes->base ? from_sink(f, f->changes->base(f->feed.sink->ctx, &out)) : 0;
}

static int on_gone(struct fetch *f)
{
	char hex[DIGEST_HEX_SIZE];
	size_t n;
	const struct stream_region *region = stream_reader_gone(f->reader, &n);
	int r = 0;

	check_gone(f->feed.check, region, n);
	for (size_t i = 0; i < n && r == 0 && f->changes->gone; i++) {
		struct acut_mesh_region out = {.triangles = region[i].triangles, .digest = digest_hex(region[i].digest, hex)};

		memcpy(out.box, region[i].box, sizeof out.box);
		r = from_sink(f, f->changes->gone(f->feed.sink->ctx, &out));
	}
	return r;
}

static int on_block(struct fetch *f)
{
	int r;

	if (f->unasked)
		r = unasked_kind(f);
	else if (f->other)
		r = other_stream(f);
	else
		r = feed_block(&f->feed, stream_reader_block(f->reader), &f->acut->err);
	f->torn = r < 0;
	return r;
}

static int failed_tail(struct fetch *f, const struct stream_tail *tail)
{
	Acut__V1__Error error = ACUT__V1__ERROR__INIT;

	error.code = (char *)tail->error_code;
	error.message = (char *)tail->error_message;
	error.hint = (char *)tail->error_hint;
	return frame_error_to_err(&error, &f->acut->err);
}

static int on_tail(struct fetch *f)
{
	const struct stream_tail *tail = stream_reader_tail(f->reader);
	const struct stream_head *head = stream_reader_head(f->reader);
	bool whole = head->kind == STREAM_WHOLE && !head->bounded;
	int r;

	if (tail->failed)
		return failed_tail(f, tail);
	if (f->unasked)
		return unasked_kind(f);
	if (f->other)
		return other_stream(f);
	r = check_tail(f->feed.check, tail, whole, &f->acut->err);
	if (r == 0 && f->changes)
		r = check_changes(f->feed.check, stream_reader_base(f->reader), tail, &f->acut->err);
	return r < 0 ? r : feed_tail(&f->feed, tail, &f->acut->err);
}

static int on_event(struct fetch *f, enum stream_event event)
{
	switch (event) {
	case STREAM_HEAD:
		return on_head(f);
	case STREAM_BLOCK:
		return on_block(f);
	case STREAM_TAIL:
		return on_tail(f);
	case STREAM_BASE:
		return on_base(f);
	case STREAM_GONE:
		return on_gone(f);
	case STREAM_MORE:
		break;
	}
	return 0;
}

/* ---- pipe and socket ---- */

/* Takes what the socket has. An Error on the request ends the fetch; so does the end of the connection,
 * but only once the pipe is dry: what is in it may be the whole mesh. */
static int check_socket(struct fetch *f)
{
	struct acut *a = f->acut;
	int r = 0;

	while (r == 0) {
		Acut__V1__Message *m;
		int fd = -1;

		r = call_pump(a, f->request, &m, &fd);
		if (r != 0 || !m)
			continue;
		if (m->body_case == ACUT__V1__MESSAGE__BODY_ERROR)
			r = frame_error_to_err(m->error, &a->err);
		if (fd >= 0)
			close(fd);
		frame_message_free(m);
	}
	return r == FRAME_E_AGAIN ? 0 : r;
}

/* The pipe ended before the tail: the daemon may have sent the reason. */
static int ended_early(struct fetch *f)
{
	struct acut *a = f->acut;
	int r = check_socket(f);

	if (r < 0)
		return r;
	err_set(&a->err, ERR_IO, "the mesh stream ended after %llu bytes, before its tail",
		(unsigned long long)stream_reader_offset(f->reader));
	return err_add_hint(&a->err, "fetch it again");
}

/* One read. 0: some bytes; FRAME_E_AGAIN; FRAME_E_EOF after the tail; negative. */
static int read_some(struct fetch *f)
{
	struct acut *a = f->acut;
	enum stream_event event;
	size_t room;
	void *to;
	ssize_t n;
	int r = stream_reader_space(f->reader, &to, &room, &a->err);

	if (r < 0)
		return r;
	do {
		n = read(f->fd, to, room);
	} while (n < 0 && errno == EINTR);
	if (n < 0 && errno == EAGAIN)
		return FRAME_E_AGAIN;
	if (n < 0)
		return err_sys(&a->err, errno, "cannot read the mesh stream");
	if (n == 0)
		return stream_reader_done(f->reader) ? FRAME_E_EOF : ended_early(f);
	r = stream_reader_feed(f->reader, (size_t)n, &event, &a->err);
	if (r < 0)
		return r;
	f->given = event != STREAM_MORE;
	return on_event(f, event);
}

/* The pipe is empty. 0: try again. */
static int wait_for_bytes(struct fetch *f, uint64_t since)
{
	struct pollfd pipe = {.fd = f->fd, .events = POLLIN};
	struct pollfd look = pipe;
	int r;

	/* A dead connection is readable for ever: then only the pipe counts. */
	if (f->acut->dead.code) {
		r = poll(&look, 1, 0);
		return r > 0 ? 0 : -(int)(f->acut->err = f->acut->dead).code;
	}
	return call_pause(f->acut, since, &pipe);
}

int fetch_stream(struct fetch *f)
{
	uint64_t since = clock_mono_ns();

	for (;;) {
		int r;

		f->given = false;
		r = read_some(f);

		if (r == FRAME_E_EOF)
			return 0;
		if (r < 0)
			return r;
		if (r == 0)
			since = clock_mono_ns();
		if ((r == FRAME_E_AGAIN || ++f->reads % READS_A_LOOK == 0) && !f->acut->dead.code) {
			int looked = check_socket(f);

			if (looked < 0 && !f->acut->dead.code)
				return looked;
			err_clear(&f->acut->err);
			if (f->acut->options.interrupted && f->acut->options.interrupted(f->acut->options.ctx))
				return err_set(&f->acut->err, ERR_CANCELLED, "interrupted");
		}
		if (r == FRAME_E_AGAIN)
			r = wait_for_bytes(f, since);
		if (r < 0)
			return r;
		if (f->stepped && f->given)
			return 1;
	}
}

/* Takes over the descriptor that came with Fetching. */
static int open_stream(struct fetch *f, int fd)
{
	struct acut *a = f->acut;
	struct stat st;
	int flags;

	f->fd = fd;
	if (fd < 0 || fstat(fd, &st) < 0 || !S_ISFIFO(st.st_mode))
		return err_set(&a->err, ERR_PROTO, "the daemon announced a mesh stream and sent no pipe");
	flags = fcntl(fd, F_GETFL);
	if (flags < 0 || fcntl(fd, F_SETFL, flags | O_NONBLOCK) < 0)
		return err_sys(&a->err, errno, "cannot set up the pipe of a mesh stream");
	f->reader = stream_reader_new();
	if (f->reader && f->continued)
		stream_reader_start(f->reader, &f->from);
	return f->reader ? 0 : err_set(&a->err, ERR_NOMEM, "there is no memory to read a mesh stream");
}

struct fetch *fetch_free(struct fetch *f)
{
	if (f) {
		if (f->fd >= 0)
			close(f->fd);
		stream_reader_free(f->reader);
		feed_done(&f->feed);
		free(f);
	}
	return NULL;
}

struct fetch *fetch_new(struct acut *a, const struct acut_mesh_sink *sink)
{
	struct fetch *f = calloc(1, sizeof *f);

	if (!f) {
		err_set(&a->err, ERR_NOMEM, "there is no memory for a fetch");
		return NULL;
	}
	f->acut = a;
	f->feed.sink = sink;
	f->fd = -1;
	a->fetch = f;
	a->progress = sink->progress;
	a->progress_ctx = sink->ctx;
	return f;
}

int fetch_begin(struct fetch *f)
{
	Acut__V1__Fetch req = ACUT__V1__FETCH__INIT;
	struct acut *a = f->acut;
	char id[DIGEST_HEX_SIZE];
	int fd = -1, r;

	req.job = f->job;
	req.area = call_text(f->acut->area);
	req.changed_since = f->since;
	req.system = true;
	req.lines = true;
	if (f->continued) {
		req.from_block = f->from.blocks;
		req.stream_id = digest_hex(f->id, id);
	}
	r = call_send(a, FRAME_MESSAGE(FETCH, fetch, &req), -1, &f->request);
	if (r == 0)
		r = call_next(a, f->request, &a->answer, &fd);
	if (r == 0 && a->answer->body_case != ACUT__V1__MESSAGE__BODY_FETCHING)
		r = call_unexpected(a, a->answer);
	if (r == 0) {
		r = open_stream(f, fd);
		fd = -1;
	}
	if (fd >= 0)
		close(fd);
	return r;
}

int fetch_end(struct fetch *f, int r)
{
	if (f->fd >= 0)
		close(f->fd);
	f->fd = -1;
	f->over = true;
	return r;
}

int fetch_run(struct fetch *f)
{
	int r = fetch_begin(f);

	return fetch_end(f, r < 0 ? r : fetch_stream(f));
}

int acut_fetch_window(struct acut *a, const char *area)
{
	char *copy = area ? strdup(area) : NULL;

	if (area && !copy)
		return err_set(&a->err, ERR_NOMEM, "there is no memory for an area");
	free(a->area);
	a->area = copy;
	return 0;
}

int acut_fetch(struct acut *a, uint64_t job, const struct acut_mesh_sink *sink)
{
	int r = call_begin(a);
	struct fetch *f = r < 0 ? NULL : fetch_new(a, sink);

	if (!f)
		return -(int)a->err.code;
	f->job = job;
	return fetch_run(f);
}

int acut_fetch_changes(struct acut *a, uint64_t job, uint64_t since, const struct acut_changes_sink *sink)
{
	int r = call_begin(a);
	struct fetch *f = r < 0 ? NULL : fetch_new(a, &sink->mesh);

	if (!f)
		return -(int)a->err.code;
	if (!since)
		return err_set(&a->err, ERR_USAGE, "changes are since a generation, and 0 is none");
	f->job = job;
	f->since = since;
	f->changes = sink;
	return fetch_run(f);
}
