/*
 * The request File: one file becomes points in the stage.
 *
 * A file that fails in the middle leaves points in the stage, which the commit drops. A failure of the stage itself breaks the
 * push.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "io.h"
#include "log.h"
#include "push_priv.h"

#define TURN_SECONDS 5.0

int push_file_start(struct push *p, struct push_request *rq, struct err *err)
{
	const struct push_probed *probe;
	struct grid_source *s;

	if (!rq->name || !rq->format || !rq->columns)
		return err_set(err, ERR_NOMEM, "no memory for a request");
	if (!p->agree.has_lattice) {
		err_set(err, ERR_USAGE, "the push has no lattice yet: PushPlan comes before File");
		return err_add_file(err, rq->name);
	}
	probe = push_find_probe(p, rq->name);
	if (!probe) {
		err_set(err, ERR_USAGE, "the file was not probed: Probe comes before PushPlan and File");
		return err_add_file(err, rq->name);
	}
	if (probe->excluded) {
		push_exclusion(probe, err);
		return -(int)err->code;
	}
	if (!p->stage) {
		if (!push_request_new(p, PUSH_STAGE, NULL, true))
			return err_set(err, ERR_NOMEM, "no memory for a request");
		return 0;
	}
	/* Between two files, a user without any stage gets a turn. */
	if (clock_since(p->stage_ns) > TURN_SECONDS && admission_stage_other_needs(p->pushes->admission, p->peer.uid))
		return push_request_new(p, PUSH_PARK, NULL, true) ? 0 : err_set(err, ERR_NOMEM, "no memory for a request");
	/* A file that was probed after the stage had its memory may need more than was reserved for decoding. */
	if (pipe_ingest_bytes() + input_bytes() + probe->read_bytes > p->read_bytes)
		push_task_bytes(p, LEDGER_INPUT, pipe_ingest_bytes() + input_bytes() + probe->read_bytes - p->read_bytes);
	if ((p->nsources & (p->nsources - 1)) == 0) {
		size_t cap = p->nsources ? p->nsources * 2 : 1;

		s = realloc(p->sources, cap * sizeof *s);
		if (!s)
			return err_set(err, ERR_NOMEM, "no memory for a source");
		p->sources = s;
	}
	if (rq->stream && push_stream_open(rq, err))
		return -(int)err->code;
	p->task.reads = true;
	rq->source = dataset_next_source(p->dataset);
	atomic_store(&p->progress, 0);
	atomic_store(&p->claimed, 0);
	return 0;
}

static int file_progress(void *ctx, uint64_t points)
{
	struct push *p = ctx;

	atomic_store(&p->progress, points);
	return atomic_load(&p->cancel) || !push_space_staged(p, points);
}

static bool same_input(const struct client_file *a, const struct client_file *b)
{
	return a->dev == b->dev && a->ino == b->ino && a->size == b->size && a->mtime_ns == b->mtime_ns;
}

static int changed(const char *name, const char *when, struct err *err)
{
	err_set(err, ERR_CHANGED, "the file changed %s", when);
	err_add_hint(err, "push it again when nobody writes to it");
	return err_add_file(err, name);
}

int push_file_finish(struct push *p, struct push_request *rq)
{
	struct client_file after;
	int r = client_file_check(rq->fd, rq->name, &after, &rq->err);

	if (!r && !p->dataset->onestep)
		r = file_hash_end(&rq->hashing, rq->id.size, &rq->hash, &rq->err);
	if (!r && !same_input(&rq->id, &after))
		return changed(rq->name, "while it was read", &rq->err);
	return !r && rq->stream ? push_stream_kept(rq) : r;
}

/* Errors of the stage and of a stream's spool name other files. */
void push_mark_unreadable(struct push_request *rq)
{
	size_t most = sizeof rq->err.file - 1;

	if (rq->r == -ERR_IO && !rq->stream && !strncmp(rq->err.file, rq->name, most))
		strcpy(rq->err.field, PUSH_INPUT);
}

/* A file in parts is left to helpers; *ret_parts says so. */
static int file_ingest(struct push *p, struct push_request *rq, struct input *in, bool *ret_parts)
{
	const struct push_probed *probe = push_find_probe(p, rq->name);
	struct pipe_ingest_params params = {
		.lattice = &p->agree.lattice,
		.stage = p->stage,
		.progress = file_progress,
		.ctx = p,
	};
	struct agree_step step;
	int r;

	push_remember_info(rq, in);
	atomic_store(&p->claimed, rq->info.claimed);
	if (!same_input(&probe->id, &rq->id))
		return changed(rq->name, "after its header was read", &rq->err);
	r = agree_say(&p->agree, rq->name, &rq->info.crs, rq->overridden, &rq->err);
	if (!r)
		r = agree_step_of(&p->agree, rq->name, &rq->info.crs, &step, &rq->err);
	params.step = !r && step.needed ? &step.params : NULL;
	rq->projected = !r && step.projects;
	if (!r && !rq->info.lines.are)
		r = grid_stage_source(p->stage, rq->source, &rq->err);
	*ret_parts = !r && rq->info.parts > 1;
	if (*ret_parts)
		return 0;
	if (!r && rq->info.lines.are)
		r = push_lines_begin(p, rq, &params);
	if (!r)
		r = pipe_ingest(in, &params, &rq->in, &rq->err);
	if (params.lines)
		r = push_lines_end(p, rq, params.lines, r);
	if (!r && !p->dataset->onestep)
		r = file_hash_bounded(input_info(in), rq->id.size, rq->name, &rq->err);
	return r ? r : push_file_finish(p, rq);
}

void push_file_run(struct push *p, struct push_request *rq)
{
	const struct file_hash_watch watch = push_hash_watch(p);
	struct input_options options = push_options(p, rq);
	struct input *in = NULL;
	bool parts = false;

	if (options.has_pipe) {
		push_stream_run(p, rq);
		return;
	}
	if (!p->dataset->onestep) {
		file_hash_begin(&rq->hashing, &watch, rq->fd, rq->name);
		options.seen = file_hash_seen;
		options.seen_ctx = &rq->hashing;
	}
	rq->r = client_file_check(rq->fd, rq->name, &rq->id, &rq->err);
	if (!rq->r)
		rq->r = input_open(rq->fd, rq->name, &options, &in, &rq->err);
	if (!rq->r)
		rq->r = file_ingest(p, rq, in, &parts);
	push_mark_unreadable(rq);
	if (rq->r)
		err_add_file(&rq->err, rq->name);
	if (parts)
		rq->whole = in;
	else
		input_close(in);
}

static void source_add(struct push *p, struct push_request *rq, uint32_t *ret_replaced)
{
	struct grid_source *s = &p->sources[p->nsources++];
	const struct push_probed *probe = push_find_probe(p, rq->name);
	struct push_crs *crs = (struct push_crs *)probe->in.crs;
	const char *base = strrchr(probe->name, '/');

	base = base ? base + 1 : probe->name;
	memset(s, 0, sizeof *s);
	s->id = rq->source;
	s->points = rq->in.points;
	/* The last part of a name that is too long. It is valid as long as the push. */
	s->name = strlen(base) < GRID_SOURCE_NAME ? base : base + strlen(base) - (GRID_SOURCE_NAME - 1);
	s->path = probe->path;
	s->overridden = probe->overridden;
	s->reading = probe->reading;
	s->left_out = rq->in.left_out;
	s->size = rq->id.size;
	s->mtime_ns = rq->id.mtime_ns;
	s->hash = rq->hash;
	push_lines_source(p, rq, s);
	push_note_reading(p, rq);
	crs->wkt = crs->wkt ? crs->wkt : probe->wkt;
	*ret_replaced = push_replace_note(p, probe->path, probe->replace, probe->target);
}

/* The stage failed, not the input: nothing more can be staged. */
static bool stage_broke(const struct err *why)
{
	return (why->code == ERR_IO && strcmp(why->field, PUSH_INPUT)) || why->code == ERR_NOSPACE || why->code == ERR_NOMEM ||
	       why->code == ERR_CORRUPT || why->code == ERR_INTERNAL;
}

static void count_file(struct push *p, const struct push_request *rq)
{
	struct tally *tally = &p->pushes->core->tally;

	tally->points_staged += rq->in.points;
	tally->bytes_read += rq->in.bytes_read;
	tally->files_staged++;
	atomic_fetch_add(&p->space.staged, rq->in.points + rq->in.vertices_added);
	atomic_store(&p->progress, 0);
	p->files++;
	p->unsynced_points += rq->in.points;
}

/* After this request, before those that came later. */
static void sync_next(struct push *p, struct push_request *rq)
{
	struct push_request *sync = push_request_new(p, PUSH_SYNC, NULL, true);

	if (!sync)
		return; /* push_tick tries again */
	p->requests = rq;
	sync->next = rq->next;
	rq->next = sync;
	if (!sync->next)
		p->requests_end = &sync->next;
}

bool push_file_done(struct push *p, struct push_request *rq, const struct err *why)
{
	struct push_file file = {.name = rq->name, .geoid = p->agree.geoid_text};
	bool tried = rq->source != 0 && (p->task.ran || rq->helpers) && !p->broken;
	struct err err = ERR_INIT;

	if (rq->stream_dry && !why) {
		rq->stream_dry = false;
		push_stream_wait(rq->stream);
		return false;
	}
	if (rq->stream)
		rq->stream->input = input_close(rq->stream->input);
	if (why && push_space_full(p))
		why = push_space_full(p);
	if (!why && rq->whole && !rq->helpers) {
		if (!push_helpers_start(p, rq, &err))
			return false;
		why = &err;
	}
	file.in = rq->in;
	file.crs_of = rq->projected ? rq->info.crs.text : "";
	file.overridden = rq->overridden;
	rq->helpers = push_helpers_free(rq->helpers);
	rq->whole = input_close(rq->whole);
	if (!why && file.in.partial && !p->dataset->partial)
		dataset_set_partial(p->dataset, p->crop);
	if (!why)
		pipe_ingested_compare(&file.in, &rq->info);
	if (!why) {
		source_add(p, rq, &file.replaced);
		file.lines = p->sources[p->nsources - 1].lines;
		count_file(p, rq);
	} else if (tried && stage_broke(why)) {
		push_break(p, why);
	} else if (why && !p->broken) {
		push_event_refused(p, rq->name, why);
	}
	p->calls.staged(rq->token, why, why ? NULL : &file);
	if (!why && !p->dataset->onestep && !p->left &&
	    (p->unsynced_points >= PUSH_DURABLE_POINTS || clock_since(p->synced_ns) >= PUSH_DURABLE_SECONDS))
		sync_next(p, rq);
	return true;
}
