/* The requests Probe and PushPlan: what each file is, and the lattice of all files. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io.h"
#include "push_priv.h"

/* ---- probe ---- */

/* Points that rounding moves into the crop lie at most half a unit outside of it. */
static void widen(const struct push *p, double crop[4])
{
	double unit = p->agree.has_lattice ? decimal_double(p->agree.lattice.scale_xy) : 0;

	for (int i = 0; i < 4; i++)
		crop[i] = p->crop[i] + (i < 2 ? -unit : unit);
}

struct input_options push_options(const struct push *p, const struct push_request *rq)
{
	const struct push_probed *probe = push_find_probe(p, rq->name);
	struct input_options options = {
		.format = rq->format && *rq->format ? rq->format : NULL,
		.columns = *rq->columns ? rq->columns : NULL,
		.decimal_comma = rq->decimal_comma,
		.strict = p->strict,
		.accept_truncated = p->accept_truncated,
		.has_pipe = rq->stream && rq->stream->forward,
		.pipe = rq->stream ? rq->stream->fd : -1,
		/* the crop is in the dataset's coordinates, which are not the file's if it is projected */
		.has_crop =
			p->has_crop && !p->agree.projects && !(p->agree.overrides && p->agree.said.plane == CRS_PLANE_GEOGRAPHIC),
	};

	widen(p, options.crop);
	agree_input_options(&p->agree, probe && agree_projects(&p->agree, probe->in.crs), &options);
	return options;
}

int push_probe_start(struct push *p, struct push_request *rq, struct err *err)
{
	if (rq->stream && !rq->stream->ready)
		return PUSH_WAIT;
	if (rq->stream && push_stream_open(rq, err))
		return -(int)err->code;
	p->task.reads = true;
	push_task_bytes(p, LEDGER_INPUT, input_bytes());
	return rq->name && rq->format && rq->columns && rq->path && rq->replaces ?
		       0 :
		       err_set(err, ERR_NOMEM, "no memory for a request");
}

static int take_wkt(const struct push *p, struct push_request *rq, const struct input *in)
{
	const char *wkt = agree_wkt_of(&p->agree, input_wkt(in));

	free(rq->wkt);
	rq->wkt = *wkt ? strdup(wkt) : NULL;
	return *wkt && !rq->wkt ? err_set(&rq->err, ERR_NOMEM, "no memory for a coordinate system") : 0;
}

void push_probe_run(struct push *p, struct push_request *rq)
{
	struct input_options options = push_options(p, rq);
	struct input *in = NULL;

	rq->r = client_file_check(rq->fd, rq->name, &rq->id, &rq->err);
	if (!rq->r && !rq->stream && !p->dataset->onestep && (rq->checksum || rq->replace || *rq->replaces))
		rq->r = file_hash_look(rq->fd, rq->id.size, rq->name, &options, &rq->err);
	if (!rq->r)
		rq->r = rq->stream ? push_stream_known(p, rq) : push_known(p, rq);
	if (!rq->r && rq->known == PUSH_NEW)
		rq->r = input_open(rq->fd, rq->name, &options, &in, &rq->err);
	push_mark_unreadable(rq);
	if (rq->r)
		err_add_file(&rq->err, rq->name);
	if (!in)
		return;
	push_remember_info(rq, in);
	if (rq->stream)
		rq->stream->claimed = rq->info.claimed;
	rq->r = agree_say(&p->agree, rq->name, &rq->info.crs, rq->overridden, &rq->err);
	if (!rq->r)
		rq->r = take_wkt(p, rq, in);
	if (!rq->r && !p->dataset->onestep)
		rq->r = file_hash_bounded(&rq->info, rq->id.size, rq->name, &rq->err);
	input_close(in);
}

bool push_probe_done(struct push *p, struct push_request *rq, const struct err *why)
{
	struct push_probe_result result = {.name = rq->name, .known = rq->known, .points = rq->in.points};
	struct err err = ERR_INIT;
	int r;

	if (!why && push_replace_room(p, rq, &err))
		why = &err;
	if (!why && rq->known == PUSH_ADOPTED) {
		r = push_adopt(p, rq, &err);
		p->waits_memory = r == PUSH_WAIT;
		p->busy &= r != PUSH_AGAIN;
		if (r > 0)
			return false;
		if (r)
			why = &err;
		else
			result.replaced = push_replace_note(p, rq->path, rq->replace, rq->target);
	}
	if (!why && rq->in_base)
		push_offers_known(p, rq->path);
	if (!why && rq->known == PUSH_NEW) {
		result.info = &rq->info;
		r = push_remember_probe(p, rq, &err);
		p->waits_memory = r == PUSH_WAIT;
		if (p->waits_memory)
			return false;
		if (r)
			why = &err;
	}
	if (why)
		push_event_refused(p, rq->name, why);
	p->calls.probed(rq->token, why, why ? NULL : &result);
	return true;
}

/* ---- plan ---- */

int push_plan_start(struct push *p, struct push_request *rq, struct err *err)
{
	const struct agree_inputs inputs = push_inputs(p);
	int r;

	r = agree_plane_choose(&p->agree, &inputs, err);
	if (!r)
		r = agree_crs(&p->agree, &inputs, err);
	p->agree.near = push_offers_near(p);
	if (!r)
		r = push_created_crs(p, err);
	if (r || p->agree.has_lattice)
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

void push_plan_run(struct push *p, struct push_request *rq)
{
	const struct agree_inputs inputs = push_inputs(p);

	if (!p->agree.has_lattice)
		rq->r = agree_lattice(&p->agree, &inputs, &rq->err);
	if (!rq->r)
		rq->r = push_space_plan(p, &rq->err);
}

bool push_plan_done(struct push *p, struct push_request *rq, const struct err *why)
{
	char lattice[LATTICE_TEXT_SIZE] = "", zone[8] = "";
	struct push_planned planned = {.lattice = lattice,
				       .crs = p->agree.crs,
				       .zone = zone,
				       .datum = "",
				       .geoid = p->agree.geoid_text,
				       .note = p->agree.note};

	if (!why) {
		p->agree.has_lattice = true;
		lattice_text(&p->agree.lattice, lattice);
		if (p->agree.projects) {
			crs_zone_text(p->agree.zone, zone);
			planned.datum = p->agree.datum;
		}
	} else if (!p->agree.has_lattice) {
		dataset_plan_end(p->dataset, p);
	}
	p->calls.planned(rq->token, why, why ? NULL : &planned);
	return true;
}

void push_remember_info(struct push_request *rq, const struct input *in)
{
	rq->info = *input_info(in);
	snprintf(rq->info_format, sizeof rq->info_format, "%s", rq->info.format);
	rq->info.format = rq->info_format;
	rq->info.coords.name = rq->name;
}
