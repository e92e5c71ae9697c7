/*
 * Inputs that come through a pipe.
 *
 * The model: the loop watches the reading end of the pipe. When it has bytes, a worker reads them without ever waiting, into a
 * spool: a file without a name in the cache. LAS is read forwards, so only what precedes the points is spooled; of a text whose
 * lattice is known, only its beginning. Everything else is spooled whole, because it is read twice (text: digits and extent) or
 * out of order (LAZ, COPC: the table of chunks follows them). Probe and File requests of that name then use the spool. The File
 * of a LAS stream continues with the pipe, and releases its worker whenever the pipe is empty. So a slow client costs a watched
 * descriptor.
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
	ROUND = 64 << 20, /* bytes that a worker reads in one turn */
	STEP_LEAST = 1 << 20,
	STEP_MOST = 64 << 20, /* disk space that is reserved at once */
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
	if (s->reserved)
		space_give(s->push->pushes->core->space, SPACE_TEMPORARY, s->reserved);
	free(s->name);
	free(s);
	return NULL;
}

static void start_watch(struct push_stream *s)
{
	struct err err = ERR_INIT;

	if (s->push->calls.watch(s->push->ctx, s, s->fd, &s->watch, &err)) {
		s->err = err;
		s->ready = true;
	}
}

/* ---- spooling ---- */

/* Reserves space for n more bytes, in growing steps. */
static int reserve(struct push_stream *s, size_t n, struct err *err)
{
	uint64_t step = s->size < STEP_LEAST ? STEP_LEAST : s->size < STEP_MOST ? s->size : STEP_MOST;
	struct space *space = s->push->pushes->core->space;
	struct err why = ERR_INIT;
	char what[96];

	if (s->size + n <= s->reserved)
		return 0;
	snprintf(what, sizeof what, "an input from a pipe, of which %llu bytes are kept already,", (unsigned long long)s->size);
	if (!space_take(space, SPACE_TEMPORARY, step, SPACE_MUST, what, &why)) {
		s->reserved += step;
		return 0;
	}
	*err = why;
	err->hint[0] = 0;
	return err_add_hint(err, "write it to a file and push that: files are read where they are");
}

/* Nothing more has to be spooled. */
static bool spooled_enough(struct push_stream *s)
{
	uint64_t need = input_forward_head(s->head, s->nhead);

	/* A text whose lattice is known is not read twice. A short one is spooled whole anyway. */
	if (!need && s->text && !s->ended)
		need = INPUT_FORWARD_TEXT;
	s->forward = need > 0 && s->nhead >= INPUT_FORWARD_LOOK;
	return s->ended || (s->forward && s->size >= need);
}

static int spool_piece(struct push_stream *s, const uint8_t *piece, size_t n, struct err *err)
{
	int r;

	if (s->nhead < sizeof s->head) {
		size_t k = sizeof s->head - s->nhead < n ? sizeof s->head - s->nhead : n;

		memcpy(s->head + s->nhead, piece, k);
		s->nhead += k;
	}
	r = reserve(s, n, err);
	if (r)
		return r;
	r = io_write_at(s->spool, piece, n, s->size, "an input from a pipe", err);
	if (!r)
		s->size += n;
	return r;
}

static int spool_bytes(struct push_stream *s, uint8_t *piece, struct err *err)
{
	for (uint64_t done = 0; done < ROUND && !spooled_enough(s);) {
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
		r = n ? spool_piece(s, piece, (size_t)n, err) : 0;
		if (r)
			return r;
		done += (uint64_t)n;
	}
	s->spooled = spooled_enough(s);
	return 0;
}

static void spool_run(struct sched_task *t)
{
	struct push_stream *s = stream_of(t);
	uint8_t *piece = malloc(PIECE);
	int r = 0;

	if (!piece)
		r = err_set(&s->err, ERR_NOMEM, "no memory to read a pipe");
	if (!r && s->spool < 0)
		r = io_open(s->push->pushes->core->tempfd, ".", O_TMPFILE | O_RDWR, 0600, &s->spool, &s->err);
	if (!r)
		r = spool_bytes(s, piece, &s->err);
	free(piece);
	if (r) {
		err_add_file(&s->err, s->name);
		s->spooled = true;
	}
}

static void spool_done(struct sched_task *t)
{
	struct push_stream *s = stream_of(t);
	struct push *p = s->push;

	s->busy = false;
	s->ready = s->spooled;
	if (t->ran) {
		sched_give(p->pushes->core->p.sched, t->name, t->bytes);
	} else {
		err_set(&s->err, ERR_CANCELLED, "the push was ended");
		s->ready = true;
	}
	if (!s->ready)
		start_watch(s);
	push_pump(p);
}

static void spool_more(struct push_stream *s)
{
	s->task = (struct sched_task){
		.run = spool_run,
		.done = spool_done,
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
	s->request_waits = false;
	sched_submit(s->push->pushes->core->p.sched, &s->push->task);
}

void push_stream_ready(struct push_stream *s)
{
	THREAD_LOOP_ONLY();
	if (s->request_waits)
		push_stream_resume(s);
	else if (!s->ready && !s->busy && !s->push->left && !atomic_load(&s->push->cancel))
		/* No worker may run when the push closes. */
		spool_more(s);
}

/* ---- a File that waits for its pipe ---- */

void push_stream_wait(struct push_stream *s)
{
	s->request_waits = true;
	start_watch(s);
	if (s->err.code)
		push_stream_resume(s);
}

void push_streams_wake(struct push *p)
{
	for (struct push_stream *s = p->streams; s; s = s->next) {
		if (s->busy)
			sched_cancel(p->pushes->core->p.sched, &s->task);
		else if (s->request_waits)
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

int push_stream_open(struct push_request *rq, struct err *err)
{
	if (rq->stream->err.code)
		return -(int)(*err = rq->stream->err).code;
	if (rq->fd < 0)
		rq->fd = fcntl(rq->stream->spool, F_DUPFD_CLOEXEC, 3);
	return rq->fd < 0 ? err_sys(err, errno, "no descriptor for an input from a pipe") : 0;
}

/* ---- content that the client announced ---- */

/* It is recognised by the announced content: nothing else is known before it comes. */
int push_stream_known(struct push *p, struct push_request *rq)
{
	struct client_file kept = rq->id;
	int r;

	if (!rq->announced)
		*rq->path = 0;
	rq->checksum = rq->announced;
	if (rq->announced) {
		rq->stream->announced = true;
		rq->stream->hash = rq->hash;
		rq->stream->announced_size = rq->announced_size;
		rq->id = (struct client_file){.size = rq->announced_size};
	}
	r = push_known(p, rq);
	rq->id = kept;
	return r;
}

static int check_announced(const struct push_stream *s, struct digest hash, uint64_t size, struct err *err)
{
	if (size == s->announced_size && digest_equal(hash, s->hash))
		return 0;
	err_set(err, ERR_CHANGED, "what came through the pipe (%llu bytes) is not what was announced (%llu bytes)%s",
		(unsigned long long)size, (unsigned long long)s->announced_size,
		size == s->announced_size ? ": its hash is another" : "");
	err_add_hint(err, "push it again when nobody writes to what it is made of");
	return err_add_file(err, s->name);
}

int push_stream_kept(struct push_request *rq)
{
	const struct push_stream *s = rq->stream;
	int r = s->announced ? check_announced(s, rq->hash, rq->id.size, &rq->err) : 0;

	/* The spool is our own file: its times say nothing about the input. */
	if (s->announced)
		rq->id.mtime_ns = 0;
	return r;
}

static void hash_bytes(void *ctx, const void *bytes, size_t n)
{
	struct push_stream *s = ctx;

	digest_stream_add(s->seen, bytes, n);
	s->seen_size += n;
}

/* Hashes the spooled head; the rest is hashed as it is read. */
static int hash_head(struct push_stream *s, struct err *err)
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
			hash_bytes(s, piece, got);
	}
	free(piece);
	return r;
}

static int check_hash(struct push_request *rq)
{
	struct push_stream *s = rq->stream;

	rq->hash = digest_stream_end(s->seen);
	rq->id = (struct client_file){.size = s->seen_size};
	return check_announced(s, rq->hash, s->seen_size, &rq->err);
}

void push_stream_run(struct push *p, struct push_request *rq)
{
	struct push_stream *s = rq->stream;
	struct pipe_ingest_params params = {
		.lattice = &p->agree.lattice,
		.stage = p->stage,
		.before = s->in.points,
		.progress = progress,
		.ctx = s,
	};
	struct input_options options = push_options(p, rq);
	struct agree_step step;

	rq->info.crs = *push_find_probe(p, rq->name)->in.crs;
	rq->r = agree_step_of(&p->agree, rq->name, &rq->info.crs, &step, &rq->err);
	params.step = step.needed ? &step.params : NULL;
	rq->projected = step.projects;
	if (!rq->r && !s->input) {
		rq->r = grid_stage_source(p->stage, rq->source, &rq->err);
		atomic_store(&p->claimed, s->claimed);
		if (!rq->r && s->announced)
			rq->r = hash_head(s, &rq->err);
	}
	if (s->announced) {
		options.pipe_seen = hash_bytes;
		options.pipe_ctx = s;
	}
	if (!rq->r && atomic_load(&p->cancel))
		rq->r = err_set(&rq->err, ERR_CANCELLED, "the push was ended");
	if (!rq->r)
		rq->r = stage_piece(s, &options, &params, &rq->stream_dry, &rq->err);
	if (!rq->r && !rq->stream_dry && s->announced)
		rq->r = check_hash(rq);
	if (rq->r)
		err_add_file(&rq->err, rq->name);
	rq->in = s->in;
}

/* ---- calls of the client's side ---- */

int push_stream(struct push *p, int fd, const char *name, struct err *err)
{
	struct push_stream *s;
	unsigned n = 0;

	THREAD_LOOP_ONLY();
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
	s->text = !strcmp(p->format, "xyz") && (*p->agree.scale_xy || p->agree.has_lattice);
	s->fd = fd;
	s->spool = -1;
	s->err = ERR_INIT;
	s->next = p->streams;
	p->streams = s;
	start_watch(s);
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
