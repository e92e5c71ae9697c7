/*
 * What each ask of a push does: a row of start (loop), run (worker), done (loop).
 *
 * A file that fails half-way has left points in the stage, which the commit drops. A failure of the stage
 * itself ends the push.
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

#define DURABLE_SECONDS 5.0
#define TURN_SECONDS 5.0
#define DURABLE_POINTS ((UINT64_C(1) << 30) / sizeof(struct point))

static void task_bytes(struct push *p, enum ledger_name name, uint64_t bytes)
{
	p->task.name = name;
	p->task.bytes = bytes;
}

/* ---- probe ---- */

/* Points that come into the crop by rounding lie half a unit outside of it at most. */
static void widen(const struct push *p, double crop[4])
{
	double unit = p->has_lattice ? decimal_double(p->lattice.scale_xy) : 0;

	for (int i = 0; i < 4; i++)
		crop[i] = p->crop[i] + (i < 2 ? -unit : unit);
}

/* What the numbers of texts are rounded to. What a step projects or shifts goes through doubles: it is as fine as they are. */
static void lattice_of(const struct push *p, const struct push_ask *a, struct input_options *ret)
{
	static const struct decimal finest = {1, -9};
	const struct push_probed *probe = push_find_probe(p, a->name);
	struct push_plane_step step = {.projects = false};
	struct err ignored = ERR_INIT;

	ret->lattice_later = true;
	if (p->has_lattice) {
		ret->scale_xy = p->lattice.scale_xy;
		ret->scale_z = p->lattice.scale_z;
	} else if ((*p->scale_xy && !decimal_parse(p->scale_xy, &ret->scale_xy)) ||
		   (*p->scale_z && !decimal_parse(p->scale_z, &ret->scale_z))) {
		ret->scale_xy = ret->scale_z = (struct decimal){0, 0}; /* the plan says so */
	}
	if (probe && !push_plane_of(p, probe->crs, &step, &ignored) && step.projects)
		ret->scale_xy = finest;
	if (*p->plane.geoid)
		ret->scale_z = finest;
}

struct input_options push_options(const struct push *p, const struct push_ask *a)
{
	struct input_options options = {
		.format = a->format && *a->format ? a->format : NULL,
		.columns = *a->columns ? a->columns : NULL,
		.decimal_comma = a->decimal_comma,
		.strict = p->strict,
		.accept_truncated = p->accept_truncated,
		.planar = p->planar,
		.degrees = true,
		.any_plane = p->overrides,
		.has_pipe = a->stream && a->stream->forward,
		.pipe = a->stream ? a->stream->fd : -1,
		/* the box is in the dataset's coordinates: no file's own, if some are projected */
		.has_crop = p->has_crop && !p->plane.projects && !(p->overrides && p->assume.plane == CRS_PLANE_GEOGRAPHIC),
	};

	widen(p, options.crop);
	lattice_of(p, a, &options);
	return options;
}

static int probe_start(struct push *p, struct push_ask *a, struct err *err)
{
	if (a->stream && !a->stream->ready)
		return PUSH_WAIT;
	if (a->stream && push_stream_open(a, err))
		return -(int)err->code;
	p->task.reads = true;
	task_bytes(p, LEDGER_INPUT, input_bytes());
	return a->name && a->format && a->columns && a->path && a->replaces ? 0 :
									      err_set(err, ERR_NOMEM, "no memory for a request");
}

static void remember_info(struct push_ask *a, const struct input *in)
{
	a->info = *input_info(in);
	snprintf(a->info_format, sizeof a->info_format, "%s", a->info.format);
	a->info.format = a->info_format;
	a->info.coords.name = a->name;
}

static void probe_run(struct push *p, struct push_ask *a)
{
	struct input_options options = push_options(p, a);
	struct input *in = NULL;

	a->r = client_file_check(a->fd, a->name, &a->id, &a->err);
	if (!a->r && !a->stream && !p->dataset->onestep && (a->checksum || a->replace || *a->replaces))
		a->r = push_hash_look(a, &options, &a->err);
	if (!a->r)
		a->r = a->stream ? push_stream_known(p, a) : push_known(p, a);
	if (!a->r && a->known == PUSH_NEW)
		a->r = input_open(a->fd, a->name, &options, &in, &a->err);
	if (a->r)
		err_add_file(&a->err, a->name);
	if (!in)
		return;
	remember_info(a, in);
	if (a->stream)
		a->stream->claimed = a->info.claimed;
	a->r = push_assume(p, a);
	if (!a->r && !p->dataset->onestep)
		a->r = push_hash_bounded(&a->info, a->id.size, a->name, &a->err);
	input_close(in);
}

static bool probe_done(struct push *p, struct push_ask *a, const struct err *why)
{
	struct push_probe_result result = {.name = a->name, .known = a->known, .points = a->in.points};
	struct err err = ERR_INIT;
	int r;

	if (!why && push_replace_room(p, a, &err))
		why = &err;
	if (!why && a->known == PUSH_ADOPTED) {
		p->adopt_taken[a->adopted] = true;
		p->ntaken++;
		result.replaced = push_replace_note(p, a->path, a->replace, a->target);
	}
	if (!why && a->known == PUSH_NEW) {
		result.info = &a->info;
		r = push_remember_probe(p, a, &err);
		p->lacks = r == PUSH_WAIT;
		if (p->lacks)
			return false;
		if (r)
			why = &err;
	}
	if (why)
		push_tell_refused(p, a->name, why);
	p->calls.probed(a->token, why, why ? NULL : &result);
	return true;
}

/* ---- plan ---- */

static int plan_start(struct push *p, struct push_ask *a, struct err *err)
{
	int r;

	push_adopt_nothing(p);
	r = push_plane_choose(p, err);
	if (!r)
		r = push_crs_agree(p, err);
	if (!r)
		r = push_created_crs(p, err);
	if (r || p->has_lattice)
		return r;
	if (*p->dataset->manifest) {
		err_set(err, ERR_BUSY, "another push has just chosen the lattice of %s", p->dataset->name);
		return err_add_hint(err, "push again");
	}
	if (!dataset_plan_begin(p->dataset, p)) {
		err_set(err, ERR_BUSY, "another push is choosing the lattice of %s", p->dataset->name);
		return err_add_hint(err, "push again when that one is committed");
	}
	return 0;
}

static void plan_run(struct push *p, struct push_ask *a)
{
	if (!p->has_lattice)
		a->r = push_choose_lattice(p, &a->err);
	if (!a->r)
		a->r = push_space_plan(p, &a->err);
}

static bool plan_done(struct push *p, struct push_ask *a, const struct err *why)
{
	char lattice[LATTICE_TEXT_SIZE] = "", zone[8] = "";
	struct push_planned planned = {
		.lattice = lattice, .crs = p->crs, .zone = zone, .datum = "", .geoid = p->plane.geoid, .note = p->lattice_note};

	if (!why) {
		p->has_lattice = true;
		lattice_text(&p->lattice, lattice);
		if (p->plane.projects) {
			crs_zone_text(p->plane.zone, zone);
			planned.datum = p->plane.datum;
		}
	} else if (!p->has_lattice) {
		dataset_plan_end(p->dataset, p);
	}
	p->calls.planned(a->token, why, why ? NULL : &planned);
	return true;
}

/* ---- the stage's memory ---- */

static int stage_start(struct push *p, struct push_ask *a, struct err *err)
{
	struct pushes *pushes = p->pushes;
	uint64_t size, room;

	/* With the buffers for reading, so that a file never waits for memory that this stage keeps others
	 * from. */
	p->read_bytes = push_read_bytes(p);
	if (admission_check_size(pushes->admission, GRID_STAGE_MIN + p->read_bytes + admission_plan_min(),
				 "staging, beside a mesh,", err) ||
	    admission_user_check_size(pushes->admission, &p->owner, GRID_STAGE_MIN + p->read_bytes + push_keeps(p), "staging",
				      err))
		return -(int)err->code;
	if (admission_stage_other_is_next(pushes->admission, &p->admission))
		return PUSH_WAIT;
	size = admission_stage_available(pushes->admission, GRID_STAGE_MIN + p->read_bytes);
	room = admission_user_available(pushes->admission, &p->owner, NULL);
	room = room > push_keeps(p) ? room - push_keeps(p) : 0;
	size = size < room ? size : room;
	if (size < GRID_STAGE_MIN + p->read_bytes)
		return PUSH_WAIT;
	p->stage_ns = clock_mono_ns();
	p->task.priority = SCHED_FIRST;
	task_bytes(p, LEDGER_STAGE, size);
	/* Known to plans that are made from now on. */
	p->stage_bytes = size;
	return 0;
}

static void stage_run(struct push *p, struct push_ask *a)
{
	char name[48];
	struct grid_stage_params params = {
		.dirfd = p->dataset->dirfd,
		.name = name,
		.memory = p->task.bytes - p->read_bytes,
		.durable = !p->dataset->onestep,
		.temporary = p->dataset->onestep, /* nobody finds it after a crash */
		.folder_later = true,             /* the manifest comes into it, and is durable only with its folder */
		.ready = push_row_wait,
		.ready_ctx = p,
	};

	pending_stage_name(p->id, name);
	if (p->on_disk)
		a->r = grid_stage_resume(&params, &p->stage, &a->err);
	else
		a->r = grid_stage_new(&params, &p->stage, &a->err);
}

static bool stage_done(struct push *p, struct push_ask *a, const struct err *why)
{
	if (!p->task.ran) {
		p->stage_bytes = 0;
	} else if (why) {
		sched_give(p->pushes->core->p.sched, LEDGER_STAGE, p->stage_bytes);
		p->stage_bytes = 0;
	}
	if (why)
		push_break(p, why);
	return true;
}

void push_stage_give(struct push *p)
{
	if (p->stage_bytes)
		sched_give(p->pushes->core->p.sched, LEDGER_STAGE, p->stage_bytes);
	p->stage_bytes = 0;
}

/* ---- file ---- */

static int file_start(struct push *p, struct push_ask *a, struct err *err)
{
	const struct push_probed *probe;
	struct grid_source *s;

	if (!a->name || !a->format || !a->columns)
		return err_set(err, ERR_NOMEM, "no memory for a request");
	if (!p->has_lattice) {
		err_set(err, ERR_USAGE, "the push has no lattice yet: PushPlan comes before File");
		return err_add_file(err, a->name);
	}
	probe = push_find_probe(p, a->name);
	if (!probe) {
		err_set(err, ERR_USAGE, "the file was not probed: Probe comes before PushPlan and File");
		return err_add_file(err, a->name);
	}
	if (probe->why) {
		push_left_out(probe, err);
		return -(int)err->code;
	}
	if (!p->stage) {
		if (!push_ask_new(p, PUSH_STAGE, NULL, true))
			return err_set(err, ERR_NOMEM, "no memory for a request");
		return 0;
	}
	/* A user who has no stage at all gets a turn between two files. */
	if (clock_since(p->stage_ns) > TURN_SECONDS && admission_stage_other_needs(p->pushes->admission, p->peer.uid))
		return push_ask_new(p, PUSH_PARK, NULL, true) ? 0 : err_set(err, ERR_NOMEM, "no memory for a request");
	/* Of a file that was probed after the stage had its memory, and takes more than was put aside. */
	if (pipe_ingest_bytes() + input_bytes() + probe->read_bytes > p->read_bytes)
		task_bytes(p, LEDGER_INPUT, pipe_ingest_bytes() + input_bytes() + probe->read_bytes - p->read_bytes);
	if ((p->nsources & (p->nsources - 1)) == 0) {
		size_t cap = p->nsources ? p->nsources * 2 : 1;

		s = realloc(p->sources, cap * sizeof *s);
		if (!s)
			return err_set(err, ERR_NOMEM, "no memory for a source");
		p->sources = s;
	}
	if (a->stream && push_stream_open(a, err))
		return -(int)err->code;
	p->task.reads = true;
	a->source = dataset_next_source(p->dataset);
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

int push_file_finish(struct push *p, struct push_ask *a)
{
	struct client_file after;
	int r = client_file_check(a->fd, a->name, &after, &a->err);

	if (!r && !p->dataset->onestep)
		r = push_hash_end(&a->hashing, a->id.size, &a->hash, &a->err);
	if (!r && !same_input(&a->id, &after))
		return changed(a->name, "while it was read", &a->err);
	return !r && a->stream ? push_stream_kept(a) : r;
}

/* What comes in parts is left to the crew, *ret_parts. */
static int file_ingest(struct push *p, struct push_ask *a, struct input *in, bool *ret_parts)
{
	const struct push_probed *probe = push_find_probe(p, a->name);
	struct pipe_ingest_params params = {
		.lattice = &p->lattice,
		.stage = p->stage,
		.progress = file_progress,
		.ctx = p,
	};
	struct push_plane_step step;
	int r;

	remember_info(a, in);
	atomic_store(&p->claimed, a->info.claimed);
	if (!same_input(&probe->id, &a->id))
		return changed(a->name, "after its header was read", &a->err);
	r = push_assume(p, a);
	if (!r)
		r = push_plane_of(p, &a->info.crs, &step, &a->err);
	if (!r)
		r = push_compatible(p, a->name, &step.plane, &a->err);
	params.step = !r && step.needed ? &step.params : NULL;
	a->projected = !r && step.projects;
	if (!r)
		r = grid_stage_source(p->stage, a->source, &a->err);
	*ret_parts = !r && a->info.parts > 1;
	if (*ret_parts)
		return 0;
	if (!r)
		r = pipe_ingest(in, &params, &a->in, &a->err);
	if (!r && !p->dataset->onestep)
		r = push_hash_bounded(input_info(in), a->id.size, a->name, &a->err);
	return r ? r : push_file_finish(p, a);
}

static void file_run(struct push *p, struct push_ask *a)
{
	struct input_options options = push_options(p, a);
	struct input *in = NULL;
	bool parts = false;

	if (options.has_pipe) {
		push_stream_run(p, a);
		return;
	}
	if (!p->dataset->onestep) {
		push_hash_begin(&a->hashing, p, a->fd, a->name);
		options.seen = push_hash_seen;
		options.seen_ctx = &a->hashing;
	}
	a->r = client_file_check(a->fd, a->name, &a->id, &a->err);
	if (!a->r)
		a->r = input_open(a->fd, a->name, &options, &in, &a->err);
	if (!a->r)
		a->r = file_ingest(p, a, in, &parts);
	if (a->r)
		err_add_file(&a->err, a->name);
	if (parts)
		a->whole = in;
	else
		input_close(in);
}

static void source_add(struct push *p, const struct push_ask *a, uint32_t *ret_replaced)
{
	struct grid_source *s = &p->sources[p->nsources++];
	const struct push_probed *probe = push_find_probe(p, a->name);
	const char *base = strrchr(probe->name, '/');

	base = base ? base + 1 : probe->name;
	memset(s, 0, sizeof *s);
	s->id = a->source;
	s->points = a->in.points;
	/* Of a name that is too long, its end; it stays as long as the push. */
	s->name = strlen(base) < GRID_SOURCE_NAME ? base : base + strlen(base) - (GRID_SOURCE_NAME - 1);
	s->path = probe->path;
	s->overridden = probe->overridden;
	s->reading = probe->reading;
	s->left_out = a->in.left_out;
	s->size = a->id.size;
	s->mtime_ns = a->id.mtime_ns;
	s->hash = a->hash;
	push_note_reading(p, a);
	*ret_replaced = push_replace_note(p, probe->path, probe->replace, probe->target);
}

/* Of the stage, not of the input: nothing more can be staged. */
static bool stage_broke(const struct err *why)
{
	return why->code == ERR_IO || why->code == ERR_NOSPACE || why->code == ERR_NOMEM || why->code == ERR_CORRUPT ||
	       why->code == ERR_INTERNAL;
}

static bool file_done(struct push *p, struct push_ask *a, const struct err *why)
{
	struct push_file file = {.name = a->name, .geoid = p->plane.geoid};
	bool tried = a->source != 0 && (p->task.ran || a->crew) && !p->broken;
	struct err err = ERR_INIT;

	if (a->dry && !why) {
		a->dry = false;
		push_stream_wait(a->stream);
		return false;
	}
	if (a->stream)
		a->stream->input = input_close(a->stream->input);
	if (why && push_space_full(p))
		why = push_space_full(p);
	if (!why && a->whole && !a->crew) {
		if (!push_helpers_start(p, a, &err))
			return false;
		why = &err;
	}
	file.in = a->in;
	file.crs_of = a->projected ? a->info.crs.text : "";
	file.overridden = a->overridden;
	a->crew = push_helpers_free(a->crew);
	a->whole = input_close(a->whole);
	if (!why && file.in.partial && !p->dataset->partial)
		dataset_set_partial(p->dataset, p->crop);
	if (!why)
		pipe_ingested_compare(&file.in, &a->info);
	if (!why) {
		source_add(p, a, &file.replaced);
		p->pushes->core->tally.points_staged += a->in.points;
		p->pushes->core->tally.bytes_read += a->in.bytes_read;
		p->pushes->core->tally.files_staged++;
		atomic_fetch_add(&p->space.staged, a->in.points);
		atomic_store(&p->progress, 0);
		p->files++;
		p->unsynced_points += a->in.points;
	} else if (tried && stage_broke(why)) {
		push_break(p, why);
	} else if (why && !p->broken) {
		push_tell_refused(p, a->name, why);
	}
	p->calls.staged(a->token, why, why ? NULL : &file);
	if (!why && !p->dataset->onestep && !p->left &&
	    (p->unsynced_points >= DURABLE_POINTS || clock_since(p->synced_ns) >= DURABLE_SECONDS)) {
		/* Behind this one, before what was asked since. */
		struct push_ask *sync = push_ask_new(p, PUSH_SYNC, NULL, true);

		if (sync) {
			p->asks = a;
			sync->next = a->next;
			a->next = sync;
			if (!sync->next)
				p->asks_end = &sync->next;
		}
	}
	return true;
}

/* ---- sync ---- */

static int sync_start(struct push *p, struct push_ask *a, struct err *err)
{
	return p->stage ? 0 : PUSH_NOW;
}

static void sync_run(struct push *p, struct push_ask *a)
{
	a->r = push_leave_pending(p, &a->err);
}

static bool sync_done(struct push *p, struct push_ask *a, const struct err *why)
{
	struct err err = ERR_INIT;
	struct catalogue_push row = {
		.id = p->id,
		.dataset = p->dataset->id,
		.uid = p->peer.uid,
		.files = p->files,
		.begun_us = clock_real_us(),
	};

	if (why) {
		/* One that has left tries once more, at its end. */
		if (!p->left)
			push_break(p, why);
		return true;
	}
	p->durable = p->files;
	p->unsynced_points = 0;
	p->synced_ns = clock_mono_ns();
	if (p->row && catalogue_put_push(p->pushes->core->p.catalogue, &row, NULL, NULL, &err))
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, NULL, "the catalogue", &err);
	if (!p->left)
		p->calls.durable(p->ctx, p->durable);
	return true;
}

const struct push_row push_rows[PUSH_KINDS] = {
	[PUSH_BEGIN] = {push_begin_start, push_begin_run, push_begin_done},
	[PUSH_PROBE] = {probe_start, probe_run, probe_done},
	[PUSH_PLAN] = {plan_start, plan_run, plan_done},
	[PUSH_STAGE] = {stage_start, stage_run, stage_done},
	[PUSH_FILE] = {file_start, file_run, file_done},
	[PUSH_SYNC] = {sync_start, sync_run, sync_done},
	[PUSH_PARK] = {push_park_start, push_park_run, push_park_done},
	[PUSH_COMMIT] = {push_commit_start, push_commit_run, push_commit_done},
	[PUSH_ABORT] = {push_abort_start, push_close_run, push_abort_done},
	[PUSH_CLOSE] = {push_close_start, push_close_run, push_close_done},
};
