/*
 * Inputs into a dataset: all headers first (the lattice must not depend on their order), then the points,
 * file by file, then the commit that makes them visible. A broken input among good ones is told, left out,
 * and makes the exit status 3; with --strict it ends the push, and nothing is kept.
 */
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "ctl.h"
#include "ctl_archive.h"

/* A failure of the file itself, not of the way there. */
static bool is_refusal(enum err_code code)
{
	return code == ERR_INPUT || code == ERR_TRUNCATED || code == ERR_CHANGED || code == ERR_UNSUPPORTED || code == ERR_LIMIT;
}

struct staging {
	struct program *ctl;
	struct ctl_inputs *in;
	struct ctl_staged *ret;
	struct acut_push *push;
	struct ctl_assume assume;
	struct session_progress progress;
	bool named; /* a dataset that stays: it wants to know who the inputs are */
	bool cut;   /* the only input broke off with the connection it came over */
	int status; /* of what ended it, told already */
	char path[4096];
};

/* Exit status if the failure ends the push, 0 if only this input is left out. */
static int refuse(struct staging *s, size_t i, const struct err *err, bool refusal)
{
	struct program *ctl = s->ctl;

	if (session_interrupted(&ctl->session) || !refusal)
		return session_error(&ctl->session, err);
	s->in->input[i].refused = true;
	ctl_archive_drop(&s->in->input[i]);
	s->ret->file[i].refused = true;
	s->ret->file[i].err = *err;
	s->ret->refused++;
	if (ctl->args.strict) {
		session_error(&ctl->session, err);
		return 1;
	}
	session_refusal(&ctl->session, err);
	return 0;
}

/* What an input may be left out for; the rest ends the push. It came as answer to a question about this input, and may be about
 * the push, or the daemon: who is about a file says so, or refuses it. */
static int told(struct staging *s, size_t i, const struct acut_failure *why)
{
	struct err err = ERR_INIT;
	bool refusal;

	session_failure_of(why, &err);
	refusal = is_refusal(err.code) && strcmp(err.field, "push") != 0;
	if (refusal)
		err_add_file(&err, s->in->input[i].name);
	return refuse(s, i, &err, refusal);
}

static int open_input(void *ctx, size_t i, struct acut_push_input *ret)
{
	struct staging *s = ctx;
	struct ctl_input *in = &s->in->input[i];
	struct err err = ERR_INIT;

	if (in->refused || s->ret->file[i].known)
		return 1;
	if (ctl_input_open(s->ctl, in, &ret->fd, &err)) {
		/* A manifest is about all inputs: one that is not what was verified ends the push. */
		s->status = refuse(s, i, &err, !in->verified && (is_refusal(err.code) || err.code == ERR_PERM));
		return s->status ? -1 : 1;
	}
	ret->name = in->label ? in->label : in->name;
	ret->path = s->named ? ctl_input_path(in, s->path, sizeof(s->path)) : NULL;
	return 0;
}

static int probed(void *ctx, size_t i, const struct acut_failure *why, const struct acut_probe *p)
{
	struct staging *s = ctx;
	struct ctl_staged_file *to = &s->ret->file[i];

	if (why)
		return s->status = told(s, i, why);
	to->known = p->known;
	if (p->known) {
		ctl_archive_drop(&s->in->input[i]);
		to->points = p->points;
		to->replaced = p->replaced;
		s->ret->known++;
		s->ret->adopted += p->known == ACUT_KNOWN_ADOPTED;
		return 0;
	}
	s->progress.total += p->points;
	ctl_assume_seen(&s->assume, p);
	if (p->warning[0]) {
		free(to->warning);
		to->warning = strdup(p->warning);
		console_warn(&s->ctl->session.console, "%s: %s", s->in->input[i].name, p->warning);
	}
	return 0;
}

/* What is warned of once all was read begins with what was said of the header. */
static void take_warning(struct staging *s, size_t i, const char *text)
{
	struct ctl_staged_file *to = &s->ret->file[i];
	size_t n = to->warning ? strlen(to->warning) : 0;
	const char *more = n && !strncmp(text, to->warning, n) ? text + n : text;

	more += strncmp(more, "; ", 2) ? 0 : 2;
	if (*more)
		console_warn(&s->ctl->session.console, "%s: %s", s->in->input[i].name, more);
	if (*text) {
		free(to->warning);
		to->warning = strdup(text);
	}
}

static int staged(void *ctx, size_t i, const struct acut_failure *why, const struct acut_file_result *f)
{
	struct staging *s = ctx;
	struct ctl_staged_file *to = &s->ret->file[i];
	struct err err = ERR_INIT;

	if (why)
		return s->status = told(s, i, why);
	if (ctl_pipe_finish(&s->in->input[i], &err))
		return s->status = session_error(&s->ctl->session, &err);
	ctl_archive_drop(&s->in->input[i]);
	to->points = f->points;
	to->moved = f->moved;
	to->bytes_read = f->bytes_read;
	to->bytes = f->bytes;
	to->left_out = f->left_out;
	to->partial = f->partial;
	to->replaced = f->replaced;
	memcpy(to->shift, f->max_shift, sizeof(to->shift));
	to->projected_from = *f->projected_from ? strdup(f->projected_from) : NULL;
	to->overridden = *f->overridden ? strdup(f->overridden) : NULL;
	to->shifted = f->shifted;
	to->height[0] = f->shift_min;
	to->height[1] = f->shift_mean;
	to->height[2] = f->shift_max;
	s->progress.base += f->points;
	s->ret->good++;
	take_warning(s, i, f->warning);
	return 0;
}

static int each_file(struct staging *s, bool probe)
{
	const struct acut_push_each each = {open_input, probed, staged, s};
	size_t left = 0, first = s->in->n;
	int r = probe ? acut_push_probe_each(s->push, s->in->n, &each) : acut_push_file_each(s->push, s->in->n, &each);

	if (r && !s->status)
		s->status = session_error_acut(&s->ctl->session);
	for (size_t i = 0; i < s->in->n; i++) {
		if (!s->in->input[i].refused)
			left++;
		else if (first == s->in->n)
			first = i;
	}
	if (s->status || left)
		return s->status;
	/* nothing good: the first refusal is the command's failure */
	if (s->ctl->session.console.json && !s->in->each)
		session_error(&s->ctl->session, &s->ret->file[first].err);
	return err_exit_status(s->ret->file[first].err.code);
}

static int begin(struct staging *s, const char *dataset)
{
	const struct ctl_args *a = &s->ctl->args;
	char scale[2 * DECIMAL_TEXT_SIZE + 2], *comma, geoid[128];
	struct acut_push_options opt = {.dataset = dataset,
					.format = a->input_format,
					.utm = a->utm,
					.geoid_way = a->geoid_way,
					.columns = a->columns,
					.planar = a->planar,
					.accept_truncated = a->accept_truncated,
					.strict = a->strict,
					.checksum = a->checksum,
					.add = a->add,
					.replace = a->replace,
					.replaces = a->replaces,
					.crop = s->in->crop,
					.progress = session_progress_show,
					.ctx = &s->progress};
	struct decimal d;
	struct err err = ERR_INIT;

	if (ctl_assume_read(a, &s->assume, &err))
		return session_error(&s->ctl->session, &err);
	ctl_assume_options(&s->assume, &opt);
	if (a->scale) {
		snprintf(scale, sizeof(scale), "%s", a->scale);
		comma = strchr(scale, ',');
		if (comma)
			*comma++ = 0;
		if (strlen(a->scale) >= sizeof(scale) || !decimal_parse(scale, &d) || d.mantissa <= 0 ||
		    (comma && (!decimal_parse(comma, &d) || d.mantissa <= 0))) {
			err_set(&err, ERR_USAGE, "--scale is not XY or XY,Z, numbers above zero: \"%s\"", a->scale);
			return session_error(&s->ctl->session, &err);
		}
		opt.scale_xy = scale;
		opt.scale_z = comma;
	}
	if (a->geoid) {
		int status = ctl_height_geoid(s->ctl, geoid);

		if (status)
			return status;
		opt.geoid = geoid;
	}
	if (acut_decimal_comma(s->ctl->session.acut, a->decimal_comma) ||
	    (a->mode && acut_dataset_mode(s->ctl->session.acut, a->mode)) ||
	    acut_push_begin(s->ctl->session.acut, &opt, &s->push))
		return session_error_acut(&s->ctl->session);
	if (*acut_push_note(s->push))
		console_line(&s->ctl->session.console, "%s: %s", dataset, acut_push_note(s->push));
	return 0;
}

/* What may be there already, or stand in the place of another, has to be here as a whole to be judged. */
static int keep(struct staging *s, struct ctl_input *in)
{
	struct err err = ERR_INIT;

	return ctl_pipe_keep(s->ctl, in, &in->kept, &err) ? session_error(&s->ctl->session, &err) : 0;
}

static int start_pipes(struct staging *s)
{
	const struct ctl_args *a = &s->ctl->args;
	int status = 0;

	for (size_t i = 0; i < s->in->n && !status; i++)
		if (s->in->input[i].fd >= 0 && s->named && (a->checksum || a->add || a->replace || a->replaces))
			status = keep(s, &s->in->input[i]);
		else if (s->in->input[i].fd >= 0)
			status = ctl_pipe_start(&s->in->input[i], s->push, s->ctl);
	return status;
}

static int commit(struct staging *s)
{
	const struct acut_push_result *result;

	if (acut_push_commit(s->push, &result))
		return session_error_acut(&s->ctl->session);
	snprintf(s->ret->dataset, sizeof(s->ret->dataset), "%s", result->dataset);
	s->ret->generation = result->generation;
	s->ret->points = result->points;
	s->ret->unchanged = result->unchanged;
	s->ret->committed = true;
	return 0;
}

/* What came over a connection that broke looks ended like anything else. */
static int whole(struct staging *s)
{
	struct err err = ERR_INIT;
	bool piped = false;

	for (size_t i = 0; i < s->in->n; i++)
		piped |= s->in->input[i].fd >= 0;
	if (!piped || !session_cut_off())
		return 0;
	s->cut = s->in->n == 1; /* what came is of no use */
	err_set(&err, ERR_TRUNCATED, "the connection that it came over is gone, so that it may not be whole; nothing was taken");
	err_add_file(&err, "standard input");
	return session_error(&s->ctl->session, &err);
}

int ctl_stage(struct program *ctl, const char *dataset, struct ctl_inputs *in, struct ctl_staged *ret)
{
	struct staging s = {.ctl = ctl, .in = in, .ret = ret, .named = dataset};
	uint64_t start = clock_mono_ns();
	const char *lattice;
	struct err err = ERR_INIT;
	int status;

	*ret = (struct ctl_staged){.nfile = in->n};
	ret->file = calloc(in->n, sizeof(*ret->file));
	if (!ret->file) {
		err_set(&err, ERR_NOMEM, "no memory for %zu inputs", in->n);
		return session_error(&ctl->session, &err);
	}
	for (size_t i = 0; i < in->n; i++)
		ret->file[i].name = in->input[i].name;
	session_progress_init(&s.progress, &ctl->session);
	status = begin(&s, dataset);
	if (!status)
		status = start_pipes(&s);
	if (!status)
		status = each_file(&s, true);
	if (!status && ret->known + ret->refused < in->n) {
		if (acut_push_plan(s.push, &lattice)) {
			status = session_error_acut(&ctl->session);
		} else {
			ctl_height_planned(ctl, acut_push_planned(s.push), ret);
			if (*acut_push_planned(s.push)->note)
				console_warn(&ctl->session.console, "%s", acut_push_planned(s.push)->note);
			if (acut_push_first(s.push))
				ctl_assume_warn(ctl, &s.assume);
		}
		if (!status)
			status = each_file(&s, false);
	}
	if (!status)
		status = whole(&s);
	if (!status)
		status = commit(&s);
	/* on the way into a named dataset what is there whole stays, for the same push again; --strict and a manifest
	 * keep nothing, nor does a stream that broke off */
	if (dataset && !s.cut && (session_caught() || !(ctl->args.strict || ctl->args.manifest)))
		acut_push_leave(s.push);
	else
		acut_push_end(s.push);
	ctl_assume_done(&s.assume);
	console_progress_clear(&ctl->session.console);
	ret->seconds = clock_since(start);
	return status ? status : ret->refused ? SESSION_SOME_REFUSED : 0;
}

void ctl_stage_done(struct ctl_staged *s)
{
	for (size_t i = 0; s->file && i < s->nfile; i++)
		free(s->file[i].warning);
	for (size_t i = 0; s->file && i < s->nfile; i++)
		free(s->file[i].projected_from);
	for (size_t i = 0; s->file && i < s->nfile; i++)
		free(s->file[i].overridden);
	free(s->file);
	*s = (struct ctl_staged){0};
}
