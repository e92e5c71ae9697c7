/*
 * Inputs of a push that come through a pipe.
 *
 * The model: the loop watches the pipe's reading end; when it has bytes, a worker takes them, never waiting.
 * First they go into a file without a name in the cache's folder: of LAS, which is read forwards, what lies
 * before the points; of a text whose lattice is known, its beginning; of everything else all of it, because it must be read twice
 * (text: digits and extent) or out of order (LAZ, COPC: the table of chunks is behind them). Probe and File of the stream's name
 * then work on that file; the File of a LAS stream goes on with the pipe, and gives its worker back whenever the pipe is dry. So
 * a slow client costs a watched descriptor.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "io.h"
#include "push_priv.h"

enum {
	STREAMS_MAX = 8,
	PIECE = 64 << 10,
	ROUND = 64 << 20, /* a worker's turn */
	STEP_LEAST = 1 << 20,
	STEP_MOST = 64 << 20, /* of room on the disk that is taken at once */
};

static struct push_stream *stream_of(struct sched_task *t)
{
	return (struct push_stream *)((char *)t - offsetof(struct push_stream, task));
}

static struct push_stream *stream_free(struct push_stream *s)
{
	if (!s)
		return NULL;
	if (s->watch)
		s->push->calls.unwatch(s->watch);
	input_close(s->input);
	io_close(s->fd);
	io_close(s->spool);
	digest_stream_free(s->seen);
	if (s->room)
		space_give(s->push->pushes->core->space, SPACE_TEMPORARY, s->room);
	free(s->name);
	free(s);
	return NULL;
}

static void watch(struct push_stream *s)
{
	struct err err = ERR_INIT;

	if (s->push->calls.watch(s->push->ctx, s, s->fd, &s->watch, &err)) {
		s->err = err;
		s->ready = true;
	}
}

/* ---- the first bytes, or all ---- */

/* For n bytes more. In steps, the larger the more there is. */
static int room_for(struct push_stream *s, size_t n, struct err *err)
{
	uint64_t step = s->size < STEP_LEAST ? STEP_LEAST : s->size < STEP_MOST ? s->size : STEP_MOST;
	struct space *space = s->push->pushes->core->space;
	struct err why = ERR_INIT;
	char what[96];

	if (s->size + n <= s->room)
		return 0;
	snprintf(what, sizeof what, "an input from a pipe, of which %llu bytes are kept already,", (unsigned long long)s->size);
	if (!space_take(space, SPACE_TEMPORARY, step, SPACE_MUST, what, &why)) {
		s->room += step;
		return 0;
	}
	*err = why;
	err->hint[0] = 0;
	return err_add_hint(err, "write it to a file and push that: files are read where they are");
}

/* True when what is kept is enough. */
static bool enough(struct push_stream *s)
{
	uint64_t need = input_forward_head(s->look, s->nlook);

	/* A text whose lattice is known otherwise need not be read twice; a short one may be, all the same. */
	if (!need && s->text && !s->ended)
		need = INPUT_FORWARD_TEXT;
	s->forward = need > 0 && s->nlook >= INPUT_FORWARD_LOOK;
	return s->ended || (s->forward && s->size >= need);
}

static int keep_piece(struct push_stream *s, const uint8_t *piece, size_t n, struct err *err)
{
	int r;

	if (s->nlook < sizeof s->look) {
		size_t k = sizeof s->look - s->nlook < n ? sizeof s->look - s->nlook : n;

		memcpy(s->look + s->nlook, piece, k);
		s->nlook += k;
	}
	r = room_for(s, n, err);
	if (r)
		return r;
	r = io_write_at(s->spool, piece, n, s->size, "an input from a pipe", err);
	if (!r)
		s->size += n;
	return r;
}

static int keep(struct push_stream *s, uint8_t *piece, struct err *err)
{
	for (uint64_t done = 0; done < ROUND && !enough(s);) {
		ssize_t n = atomic_load(&s->push->cancel) ? 0 : io->read(s->fd, piece, PIECE);
		int r;

		if (atomic_load(&s->push->cancel))
			return err_set(err, ERR_CANCELLED, "the push was ended");
		if (n < 0 && errno == EINTR)
			continue;
		if (n < 0 && errno == EAGAIN)
			return 0;
		if (n < 0)
			return err_sys(err, errno, "the pipe cannot be read");
		s->ended = n == 0;
		r = n ? keep_piece(s, piece, (size_t)n, err) : 0;
		if (r)
			return r;
		done += (uint64_t)n;
	}
	s->kept = enough(s);
	return 0;
}

static void keep_run(struct sched_task *t)
{
	struct push_stream *s = stream_of(t);
	uint8_t *piece = malloc(PIECE);
	int r = 0;

	if (!piece)
		r = err_set(&s->err, ERR_NOMEM, "no memory to read a pipe");
	if (!r && s->spool < 0)
		r = io_open(s->push->pushes->core->tempfd, ".", O_TMPFILE | O_RDWR, 0600, &s->spool, &s->err);
	if (!r)
		r = keep(s, piece, &s->err);
	free(piece);
	if (r) {
		err_add_file(&s->err, s->name);
		s->kept = true;
	}
}

static void keep_done(struct sched_task *t)
{
	struct push_stream *s = stream_of(t);
	struct push *p = s->push;

	s->busy = false;
	s->ready = s->kept;
	if (t->ran) {
		sched_give(p->pushes->core->p.sched, t->name, t->bytes);
	} else {
		err_set(&s->err, ERR_CANCELLED, "the push was ended");
		s->ready = true;
	}
	if (!s->ready)
		watch(s);
	push_pump(p);
}

static void keep_more(struct push_stream *s)
{
	s->task = (struct sched_task){
		.run = keep_run,
		.done = keep_done,
		.owner = s->push->owner,
		.priority = SCHED_NORMAL,
		.name = LEDGER_INPUT,
		.bytes = PIECE,
	};
	s->busy = true;
	sched_submit(s->push->pushes->core->p.sched, &s->task);
}

static void push_stream_resume(struct push_stream *s)
{
	s->asks = false;
	sched_submit(s->push->pushes->core->p.sched, &s->push->task);
}

void push_stream_ready(struct push_stream *s)
{
	if (s->asks)
		push_stream_resume(s);
	else if (!s->ready && !s->busy && !s->push->left && !atomic_load(&s->push->cancel))
		/* A push that closes must find no worker here. */
		keep_more(s);
}

/* ---- a File that waits for its pipe ---- */

void push_stream_wait(struct push_stream *s)
{
	s->asks = true;
	watch(s);
	if (s->err.code)
		push_stream_resume(s);
}

void push_streams_wake(struct push *p)
{
	for (struct push_stream *s = p->streams; s; s = s->next) {
		if (s->busy)
			sched_cancel(p->pushes->core->p.sched, &s->task);
		else if (s->asks)
			push_stream_resume(s);
	}
}

static int stage_piece(struct push_stream *s, const struct input_options *options, const struct pipe_ingest_params *params,
		       bool *ret_dry, struct err *err)
{
	struct pipe_ingested part;
	int r = s->err.code ? -(int)(*err = s->err).code : 0;

	if (!r && !s->input)
		r = input_open(s->spool, s->name, options, &s->input, err);
	if (!r)
		r = pipe_ingest(s->input, params, &part, err);
	*ret_dry = r == PIPE_E_DRY;
	if (r >= 0)
		pipe_ingested_add(&s->in, &part);
	return r < 0 ? r : 0;
}

static int progress(void *ctx, uint64_t points)
{
	struct push_stream *s = ctx;

	atomic_store(&s->push->progress, s->in.points + points);
	return atomic_load(&s->push->cancel) || !push_space_staged(s->push, s->in.points + points);
}

int push_stream_open(struct push_ask *a, struct err *err)
{
	if (a->stream->err.code)
		return -(int)(*err = a->stream->err).code;
	if (a->fd < 0)
		a->fd = fcntl(a->stream->spool, F_DUPFD_CLOEXEC, 3);
	return a->fd < 0 ? err_sys(err, errno, "no descriptor for an input from a pipe") : 0;
}

/* ---- what the client says that will come ---- */

/* By its content, as it was said: nothing else is known before it comes. */
int push_stream_known(struct push *p, struct push_ask *a)
{
	struct client_file kept = a->id;
	int r;

	if (!a->told)
		*a->path = 0;
	a->checksum = a->told;
	if (a->told) {
		a->stream->told = true;
		a->stream->hash = a->hash;
		a->stream->told_size = a->told_size;
		a->id = (struct client_file){.size = a->told_size};
	}
	r = push_known(p, a);
	a->id = kept;
	return r;
}

static int check_told(const struct push_stream *s, struct digest hash, uint64_t size, struct err *err)
{
	if (size == s->told_size && digest_equal(hash, s->hash))
		return 0;
	err_set(err, ERR_CHANGED, "what came through the pipe (%llu bytes) is not what was announced (%llu bytes)%s",
		(unsigned long long)size, (unsigned long long)s->told_size, size == s->told_size ? ": its hash is another" : "");
	err_add_hint(err, "push it again when nobody writes to what it is made of");
	return err_add_file(err, s->name);
}

int push_stream_kept(struct push_ask *a)
{
	const struct push_stream *s = a->stream;
	int r = s->told ? check_told(s, a->hash, a->id.size, &a->err) : 0;

	/* A file of ours: its times say nothing of the input. */
	if (s->told)
		a->id.mtime_ns = 0;
	return r;
}

static void see(void *ctx, const void *bytes, size_t n)
{
	struct push_stream *s = ctx;

	digest_stream_add(s->seen, bytes, n);
	s->seen_size += n;
}

/* What lies in the file of first bytes; the rest is seen when it is read. */
static int see_first(struct push_stream *s, struct err *err)
{
	uint8_t *piece = malloc(PIECE);
	size_t got = 1;
	int r = 0;

	s->seen = digest_stream_new();
	s->seen_size = 0;
	if (!piece || !s->seen)
		r = err_set(err, ERR_NOMEM, "no memory to read a pipe");
	while (!r && got && s->seen_size < s->size) {
		uint64_t left = s->size - s->seen_size;

		r = io_read_some(s->spool, piece, left < PIECE ? (size_t)left : PIECE, s->seen_size, s->name, &got, err);
		if (!r)
			see(s, piece, got);
	}
	free(piece);
	return r;
}

static int check_seen(struct push_ask *a)
{
	struct push_stream *s = a->stream;

	a->hash = digest_stream_end(s->seen);
	a->id = (struct client_file){.size = s->seen_size};
	return check_told(s, a->hash, s->seen_size, &a->err);
}

void push_stream_run(struct push *p, struct push_ask *a)
{
	struct push_stream *s = a->stream;
	struct pipe_ingest_params params = {
		.lattice = &p->lattice,
		.stage = p->stage,
		.before = s->in.points,
		.progress = progress,
		.ctx = s,
	};
	struct input_options options = push_options(p, a);
	struct push_plane_step step;

	a->info.crs = *push_find_probe(p, a->name)->crs;
	a->r = push_plane_of(p, &a->info.crs, &step, &a->err);
	if (!a->r)
		a->r = push_compatible(p, a->name, &step.plane, &a->err);
	params.step = step.needed ? &step.params : NULL;
	a->projected = step.projects;
	if (!a->r && !s->input) {
		a->r = grid_stage_source(p->stage, a->source, &a->err);
		atomic_store(&p->claimed, s->claimed);
		if (!a->r && s->told)
			a->r = see_first(s, &a->err);
	}
	if (s->told) {
		options.pipe_seen = see;
		options.pipe_ctx = s;
	}
	if (!a->r && atomic_load(&p->cancel))
		a->r = err_set(&a->err, ERR_CANCELLED, "the push was ended");
	if (!a->r)
		a->r = stage_piece(s, &options, &params, &a->dry, &a->err);
	if (!a->r && !a->dry && s->told)
		a->r = check_seen(a);
	if (a->r)
		err_add_file(&a->err, a->name);
	a->in = s->in;
}

/* ---- asked ---- */

int push_stream(struct push *p, int fd, const char *name, struct err *err)
{
	struct push_stream *s;
	unsigned n = 0;

	for (s = p->streams; s; s = s->next, n++)
		if (!strcmp(s->name, name))
			err_set(err, ERR_USAGE, "the push has a stream of that name already");
	if (n >= STREAMS_MAX)
		err_set(err, ERR_BUSY, "a push takes at most %d pipes", STREAMS_MAX);
	if (p->left || p->broken)
		err_set(err, ERR_CANCELLED, "the push was ended");
	s = err->code ? NULL : calloc(1, sizeof *s);
	if (s)
		s->name = strdup(name);
	if (!s || !s->name) {
		free(s);
		io_close(fd);
		return err->code ? -(int)err->code : err_set(err, ERR_NOMEM, "no memory for a stream");
	}
	s->push = p;
	/* The lattice of an interrupted push none of whose files has come yet may not stay: then the text decides. */
	s->text = !strcmp(p->format, "xyz") && (*p->scale_xy || (p->has_lattice && (p->base || !p->adopt || p->ntaken)));
	s->fd = fd;
	s->spool = -1;
	s->err = ERR_INIT;
	s->next = p->streams;
	p->streams = s;
	watch(s);
	return 0;
}

struct push_stream *push_stream_find(const struct push *p, const char *name)
{
	struct push_stream *s;

	for (s = p->streams; s && strcmp(s->name, name); s = s->next)
		;
	return s;
}

bool push_streams_busy(const struct push *p)
{
	const struct push_stream *s;

	for (s = p->streams; s && !s->busy; s = s->next)
		;
	return s != NULL;
}

void push_streams_free(struct push *p)
{
	struct push_stream *next;

	for (; p->streams; p->streams = next) {
		next = p->streams->next;
		stream_free(p->streams);
	}
}
