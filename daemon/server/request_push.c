/* Requests of a push. The `struct request` is the token of the call, whose answer comes once. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <unistd.h>

#include "breakline.h"
#include "io.h"
#include "log.h"
#include "server_priv.h"

enum { STREAM_PIPE = 1 << 20 };

/* ---- answers ---- */

static void push_ref_end(struct push_ref *ref)
{
	if (ref && ref->push) {
		struct push *p = ref->push;

		ref->push = NULL;
		ref->request = 0;
		push_leave(p);
	}
}

static void on_begun(void *token, const struct err *why, const struct push_begun *b)
{
	struct request *q = token;
	struct push_ref *ref = q->push;
	Acut__V1__PushBegun begun_msg = ACUT__V1__PUSH_BEGUN__INIT;

	if (why) {
		ref->request = 0;
		request_refuse(q, why);
		return;
	}
	ref->push = b->push;
	ref->id = b->id;
	begun_msg.push = b->id;
	begun_msg.lattice = (char *)b->lattice;
	begun_msg.note = (char *)b->note;
	if (q->conn->closed)
		push_ref_end(ref);
	request_answer(q, FRAME_MESSAGE(PUSH_BEGUN, push_begun, &begun_msg));
}

static void on_probed(void *token, const struct err *why, const struct push_probe_result *result)
{
	Acut__V1__Probed known = ACUT__V1__PROBED__INIT;
	char name[256];

	if (why) {
		request_refuse(token, why);
		return;
	}
	if (result->info) {
		request_answer_probed(token, result->name, result->info, "");
		return;
	}
	strncpy(name, result->name, sizeof name - 1);
	name[sizeof name - 1] = 0;
	known.name = frame_text_clean(name);
	known.points = result->points;
	known.replaced = result->replaced;
	known.known = (uint32_t)result->known;
	request_answer(token, FRAME_MESSAGE(PROBED, probed, &known));
}

static void on_planned(void *token, const struct err *why, const struct push_planned *p)
{
	Acut__V1__PushPlanned m = ACUT__V1__PUSH_PLANNED__INIT;
	char note[512];

	if (why) {
		request_refuse(token, why);
		return;
	}
	m.lattice = (char *)p->lattice;
	m.crs = (char *)p->crs;
	m.zone = (char *)p->zone;
	m.datum = (char *)p->datum;
	m.geoid = (char *)p->geoid;
	snprintf(note, sizeof note, "%s", p->note);
	m.note = frame_text_clean(note);
	request_answer(token, FRAME_MESSAGE(PUSH_PLANNED, push_planned, &m));
}

Acut__V1__Lines *request_lines(const struct grid_lines *lines, Acut__V1__Lines *m)
{
	acut__v1__lines__init(m);
	m->features = (uint64_t *)lines->features;
	m->n_features = GRID_LINE_KINDS;
	m->lines = lines->lines;
	m->vertices = lines->vertices;
	return m;
}

static void on_staged(void *token, const struct err *why, const struct push_file *file)
{
	Acut__V1__FileDone m = ACUT__V1__FILE_DONE__INIT;
	Acut__V1__Lines lines;
	struct pipe_ingested in;
	char name[256];

	if (why) {
		request_refuse(token, why);
		return;
	}
	in = file->in;
	strncpy(name, file->name, sizeof name - 1);
	name[sizeof name - 1] = 0;
	m.name = frame_text_clean(name);
	m.points = in.points;
	m.moved = in.moved;
	m.n_max_shift = 3;
	m.max_shift = in.max_shift;
	m.warning = frame_text_clean(in.warning);
	m.projected_from = (char *)file->crs_of;
	m.geoid = (char *)file->geoid;
	m.shifted = in.shift.n;
	if (in.shift.n) {
		m.shift_min = in.shift.min;
		m.shift_max = in.shift.max;
		m.shift_mean = (double)in.shift.sum_um * 1e-6 / (double)in.shift.n;
	}
	m.bytes_read = in.bytes_read;
	m.bytes = in.bytes;
	m.partial = in.partial;
	m.left_out = in.left_out;
	m.left_out_line = in.left_out_line;
	m.replaced = file->replaced;
	m.overridden = (char *)file->overridden;
	if (file->lines) {
		m.lines = request_lines(file->lines, &lines);
		lines.dropped = in.vertices_dropped;
		lines.added = in.vertices_added;
	}
	request_answer(token, FRAME_MESSAGE(FILE_DONE, file_done, &m));
}

static Acut__V1__LineSet *message_line_set(const struct push_committed *done, Acut__V1__LineSet *m)
{
	const struct breakline_counts *c = done->lines;
	const struct lattice *l = done->lattice;

	acut__v1__line_set__init(m);
	m->features = (uint64_t *)c->features;
	m->n_features = BREAKLINE_KINDS;
	m->lines = c->lines;
	m->vertices = c->vertices;
	m->positions = c->positions;
	m->pieces = c->pieces;
	m->crossings = c->crossings;
	m->uneven = c->uneven;
	m->widest = c->widest * decimal_double(l->scale_z);
	if (c->widest) {
		m->widest_x = lattice_coordinate(l, 0, c->widest_at[0]);
		m->widest_y = lattice_coordinate(l, 1, c->widest_at[1]);
	}
	m->left_out = c->left_out;
	m->doubled = c->doubled;
	m->points = c->points;
	return m;
}

static void on_committed(void *token, const struct err *why, const struct push_committed *done)
{
	struct request *q = token;
	struct conn *c = q->conn;
	struct push_ref *ref = q->push;
	Acut__V1__PushCommitted m = ACUT__V1__PUSH_COMMITTED__INIT;
	Acut__V1__LineSet set;
	struct conn_dataset *held;
	struct dataset_info info;

	if (why) {
		request_refuse(q, why);
		return;
	}
	dataset_info(done->dataset, &info);
	/* A one-step dataset lives as long as the connection that pushed it. */
	held = c->closed ? NULL : calloc(1, sizeof *held);
	if (held) {
		held->dataset = dataset_hold(done->dataset);
		held->next = c->held;
		c->held = held;
	}
	m.dataset = (char *)info.name;
	m.generation = done->generation;
	m.points = done->points;
	m.unchanged = done->unchanged;
	if (done->lines)
		m.line_set = message_line_set(done, &set);
	request_answer(q, FRAME_MESSAGE(PUSH_COMMITTED, push_committed, &m));
	push_ref_end(ref);
}

static void on_aborted(void *token)
{
	struct request *q = token;
	struct push_ref *ref = q->push;

	request_answer_done(q);
	push_ref_end(ref);
}

static void on_durable(void *ctx, uint64_t files)
{
	struct push_ref *ref = ctx;
	Acut__V1__Durable m = ACUT__V1__DURABLE__INIT;

	m.files = files;
	if (ref->push)
		conn_send(ref->conn, ref->request, FRAME_MESSAGE(DURABLE, durable, &m), -1);
}

static void on_progress(void *token, const char *phase, uint64_t points, uint64_t total, const char *waiting)
{
	request_progress(token, phase, points, total, waiting);
}

/* ---- pipes of inputs ---- */

static int on_input_pipe(sd_event_source *source, int fd, uint32_t events, void *ctx)
{
	push_stream_ready(ctx);
	return 0;
}

static int on_watch(void *ctx, struct push_stream *stream, int fd, void **slot, struct err *err)
{
	struct push_ref *ref = ctx;
	sd_event_source *source = *slot;
	int r;

	if (source) {
		r = sd_event_source_set_enabled(source, SD_EVENT_ONESHOT);
	} else {
		r = sd_event_add_io(ref->conn->server->p.event, &source, fd, EPOLLIN, on_input_pipe, stream);
		if (r >= 0) {
			*slot = source;
			sd_event_source_set_priority(source, FAIR_STREAMS);
			r = sd_event_source_set_enabled(source, SD_EVENT_ONESHOT);
		}
	}
	return r < 0 ? err_sys(err, -r, "cannot watch a pipe") : 0;
}

static void on_unwatch(void *slot)
{
	sd_event_source_disable_unref(slot);
}

static const struct push_calls calls = {
	.begun = on_begun,
	.probed = on_probed,
	.planned = on_planned,
	.staged = on_staged,
	.committed = on_committed,
	.aborted = on_aborted,
	.durable = on_durable,
	.progress = on_progress,
	.watch = on_watch,
	.unwatch = on_unwatch,
};

/* ---- requests ---- */

void push_ref_leave(struct push_ref *ref)
{
	push_ref_end(ref);
}

/* The reference of a push that has ended is used again. */
static struct push_ref *push_ref_new(struct conn *c, struct err *err)
{
	struct push_ref *ref;
	unsigned n = 0;

	for (ref = c->pushes; ref; ref = ref->next, n++)
		if (!ref->push && !ref->request)
			break;
	if (n >= CONN_PUSHES_MAX) {
		err_set(err, ERR_BUSY, "%u pushes of this connection are open already", n);
		return NULL;
	}
	if (!ref) {
		ref = calloc(1, sizeof *ref);
		if (!ref) {
			err_set(err, ERR_NOMEM, "no memory for a push");
			return NULL;
		}
		ref->conn = c;
		ref->next = c->pushes;
		c->pushes = ref;
	}
	return ref;
}

void request_push_begin(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	const Acut__V1__PushBegin *in = m->push_begin;
	struct push_params p = {
		.dataset = in->dataset,
		.format = in->format,
		.says = {.assume = {in->assume_crs, in->assume_unit_xy, in->assume_unit_z},
			 .override = {in->override_crs, in->override_unit_xy, in->override_unit_z},
			 .scale_xy = in->scale_xy,
			 .scale_z = in->scale_z,
			 .utm = in->utm,
			 .geoid = in->geoid,
			 .geoid_way = in->geoid_way,
			 .planar = in->planar},
		.accept_truncated = in->accept_truncated,
		.strict = in->strict,
		.crop = in->crop,
		.ncrop = in->n_crop,
		.peer = c->peer,
		.calls = &calls,
	};
	struct err err = ERR_INIT;

	if (!request_mode(in->mode, &p.has_mode, &p.mode, &err))
		q->push = push_ref_new(c, &err);
	if (!q->push) {
		request_refuse(q, &err);
		return;
	}
	q->push->request = q->id;
	p.ctx = q->push;
	push_begin(c->server->service->pushes, &p, q);
}

/* NULL: there is no such push, and the request is refused. */
static struct push *find_push(struct conn *c, struct request *q, uint64_t id)
{
	struct err err = ERR_INIT;
	struct push_ref *ref;

	for (ref = c->pushes; ref; ref = ref->next)
		if (ref->push && ref->id == id) {
			q->push = ref;
			return ref->push;
		}
	err_set(&err, ERR_NOTFOUND, "this connection has no push %llu", (unsigned long long)id);
	request_refuse(q, &err);
	return NULL;
}

void request_probe(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	const Acut__V1__Probe *probe = m->probe;
	struct push *p = find_push(c, q, probe->push);
	struct push_input in = {
		.name = probe->name,
		.format = probe->format,
		.columns = probe->columns,
		.decimal_comma = probe->decimal_comma,
		.checksum = probe->checksum,
		.add = probe->add,
		.replace = probe->replace,
		.replaces = probe->replaces,
	};
	struct err err = ERR_INIT;
	char *path = p && probe->path.len ? strndup((const char *)probe->path.data, probe->path.len) : NULL;

	in.path = path;
	in.size = probe->size;
	in.announced = *probe->hash != 0;
	if (p && in.announced && !digest_parse(probe->hash, &in.hash)) {
		err_set(&err, ERR_USAGE, "the hash of a stream is not 32 hexadecimal digits");
		request_refuse(q, &err);
		p = NULL;
	}
	if (p)
		push_probe(p, fd, &in, q);
	else
		io_close(fd);
	free(path);
}

void request_file(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	const struct push_input in = {
		.name = m->file->name,
		.format = m->file->format,
		.columns = m->file->columns,
		.decimal_comma = m->file->decimal_comma,
	};
	struct push *p = find_push(c, q, m->file->push);

	if (p)
		push_file(p, fd, &in, q);
	else
		io_close(fd);
}

void request_stream(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	Acut__V1__Streaming answer = ACUT__V1__STREAMING__INIT;
	struct push *p = find_push(c, q, m->stream->push);
	struct err err = ERR_INIT;
	int ends[2];

	if (!p)
		return;
	if (pipe2(ends, O_CLOEXEC) != 0) {
		err_sys(&err, errno, "cannot make a pipe");
		request_refuse(q, &err);
		return;
	}
	/* The daemon's end does not block; the client's does. A larger pipe saves wake-ups. */
	fcntl(ends[0], F_SETFL, O_NONBLOCK);
	fcntl(ends[1], F_SETPIPE_SZ, STREAM_PIPE);
	if (push_stream(p, ends[0], m->stream->name, &err)) {
		io_close(ends[1]);
		request_refuse(q, &err);
		return;
	}
	answer.name = m->stream->name;
	conn_send(c, q->id, FRAME_MESSAGE(STREAMING, streaming, &answer), ends[1]);
	request_free(q);
}

void request_push_plan(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	struct push *p = find_push(c, q, m->push_plan->push);

	if (p)
		push_plan(p, q);
}

void request_push_commit(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	struct push *p = find_push(c, q, m->push_commit->push);

	if (p)
		push_commit(p, q);
}

void request_push_abort(struct conn *c, struct request *q, Acut__V1__Message *m, int fd)
{
	struct push *p = find_push(c, q, m->push_abort->push);

	if (p)
		push_abort(p, q);
}
