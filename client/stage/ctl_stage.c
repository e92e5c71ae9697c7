/*
 * Inputs into a dataset: all headers first (the lattice must not depend on their order), then the points, file by file, then
 * the commit that makes them visible. A broken input among good ones is printed and left out, and the exit status is 3; with
 * --strict it ends the push, and nothing is kept.
 */
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "ctl_stage.h"
#include "decimal.h"

/* A failure of the file itself, not of the way there. */
static bool is_refusal(const struct err *err)
{
	enum err_code code = err->code;

	/* its disk does not give it, which says nothing of others (protocol.md, "Inputs") */
	if (code == ERR_IO && !strcmp(err->field, "input"))
		return true;
	return code == ERR_INPUT || code == ERR_TRUNCATED || code == ERR_CHANGED || code == ERR_UNSUPPORTED || code == ERR_LIMIT;
}

struct staging {
	struct session *session;
	const struct ctl_stage_options *opt;
	struct ctl_inputs *in;
	struct ctl_staged *ret;
	struct acut_push *push;
	struct ctl_assume assume;
	struct session_progress progress;
	bool named; /* a dataset that stays */
	bool cut;   /* the only input broke off with the connection it came over */
	int status; /* of the failure that ended it, which is printed already */
	char path[4096];
};

/* Exit status if the failure ends the push, 0 if only this input is left out. */
static int refuse(struct staging *s, size_t i, const struct err *err, bool refusal)
{
	struct session *session = s->session;

	if (session_interrupted(session) || !refusal)
		return session_error(session, err);
	s->in->input[i].refused = true;
	ctl_input_drop(&s->in->input[i]);
	s->ret->file[i].refused = true;
	s->ret->file[i].err = *err;
	s->ret->refused++;
	/* a mesh without its breaklines is another mesh */
	if (s->opt->strict || (s->in->input[i].lines && !s->named)) {
		session_error(session, err);
		return 1;
	}
	session_refusal(session, err);
	return 0;
}

/* A refused input is left out; other failures end the push. The answer may be about the push or the daemon, although the
 * request was about this input: the error names a file, or has the field "push". */
static int failed(struct staging *s, size_t i, const struct acut_failure *why)
{
	struct err err = ERR_INIT;
	bool refusal;

	session_failure_of(why, &err);
	refusal = is_refusal(&err) && strcmp(err.field, "push") != 0;
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
	if (ctl_input_open(s->in, in, &ret->fd, &err)) {
		/* A manifest is about all inputs: one that is not what was verified ends the push. */
		s->status = refuse(s, i, &err, !in->verified && (is_refusal(&err) || err.code == ERR_PERM));
		return s->status ? -1 : 1;
	}
	ret->name = in->label ? in->label : in->name;
	ret->path = ctl_input_path(in, s->path, sizeof(s->path));
	if (in->lines) {
		ret->checksum = true; /* the same lines of another kind are another input */
		ret->format = "lines";
		s->ret->file[i].has_lines = true;
		s->ret->file[i].lines = in->exported;
	}
	return 0;
}

static int probed(void *ctx, size_t i, const struct acut_failure *why, const struct acut_probe *p)
{
	struct staging *s = ctx;
	struct ctl_staged_file *to = &s->ret->file[i];

	if (why)
		return s->status = failed(s, i, why);
	to->known = p->known;
	if (p->known) {
		ctl_input_drop(&s->in->input[i]);
		to->points = p->points;
		to->replaced = p->replaced;
		s->ret->known++;
		s->ret->adopted += p->known == ACUT_KNOWN_ADOPTED;
		return 0;
	}
	s->progress.total += p->points;
	to->text_of_lines = !to->has_lines && !strcmp(p->format, "lines");
	ctl_assume_see(&s->assume, p);
	if (p->warning[0]) {
		free(to->warning);
		to->warning = strdup(p->warning);
		console_warn(&s->session->console, "%s: %s", s->in->input[i].name, p->warning);
	}
	return 0;
}

/* The warning after all was read begins with the warning of the header. */
static void take_warning(struct staging *s, size_t i, const char *text)
{
	struct ctl_staged_file *to = &s->ret->file[i];
	size_t n = to->warning ? strlen(to->warning) : 0;
	const char *more = n && !strncmp(text, to->warning, n) ? text + n : text;

	more += strncmp(more, "; ", 2) ? 0 : 2;
	if (*more)
		console_warn(&s->session->console, "%s: %s", s->in->input[i].name, more);
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
		return s->status = failed(s, i, why);
	if (ctl_input_finish_pipe(&s->in->input[i], &err))
		return s->status = session_error(s->session, &err);
	ctl_input_drop(&s->in->input[i]);
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
		s->status = session_error_acut(s->session);
	for (size_t i = 0; i < s->in->n; i++) {
		if (!s->in->input[i].refused)
			left++;
		else if (first == s->in->n)
			first = i;
	}
	if (s->status || left)
		return s->status;
	/* nothing good: the first refusal is the command's failure */
	if (s->session->console.json && !s->in->each)
		session_error(s->session, &s->ret->file[first].err);
	return err_exit_status(s->ret->file[first].err.code);
}

int ctl_stage_scale(const char *scale, char buf[CTL_SCALE_SIZE], const char **ret_z, struct err *err)
{
	const char *z = strchr(scale, ',');
	size_t n = z ? (size_t)(z++ - scale) : strlen(scale);
	struct decimal d;
	char *comma;
	int size;

	/* older daemons take no number that begins with a point */
	size = snprintf(buf, CTL_SCALE_SIZE, "%s%.*s,%s%s", *scale == '.' ? "0" : "", (int)n, scale, z && *z == '.' ? "0" : "",
			z ? z : "");
	comma = strchr(buf, ',');
	if (comma)
		*comma++ = 0;
	*ret_z = comma = z ? comma : NULL;
	if (size < CTL_SCALE_SIZE && decimal_parse(buf, &d) && d.mantissa > 0 &&
	    (!comma || (decimal_parse(comma, &d) && d.mantissa > 0)))
		return 0;
	return err_set(err, ERR_USAGE, "--scale is not XY or XY,Z, numbers above zero: \"%s\"", scale);
}

/* --geoid names a kept grid, or a .pgm file, which is added then. */
static int geoid_name(struct staging *s, char ret_name[128])
{
	const char *geoid = s->opt->geoid;
	const struct acut_geoid *g;
	size_t n = strlen(geoid);

	if (n > 4 && !strcmp(geoid + n - 4, ".pgm"))
		return ctl_stage_geoid(s->session, geoid, NULL, ret_name, &g);
	snprintf(ret_name, 128, "%s", geoid);
	return 0;
}

static int begin(struct staging *s, const char *dataset)
{
	const struct ctl_stage_options *a = s->opt;
	const struct ctl_input_options *in = s->in->opt;
	char scale[CTL_SCALE_SIZE], geoid[128];
	struct acut_push_options opt = {.dataset = dataset,
					.format = s->in->format,
					.utm = a->utm,
					.geoid_way = a->geoid_way,
					.columns = in->columns,
					.planar = a->planar,
					.accept_truncated = in->accept_truncated,
					.strict = a->strict,
					.checksum = a->checksum,
					.add = a->add,
					.replace = a->replace,
					.replaces = a->replaces,
					.crop = s->in->crop,
					.progress = session_progress_show,
					.ctx = &s->progress};
	struct err err = ERR_INIT;

	if (ctl_assume_read(a, &s->assume, &err) || (a->scale && ctl_stage_scale(a->scale, scale, &opt.scale_z, &err)))
		return session_error(s->session, &err);
	ctl_assume_options(&s->assume, &opt);
	opt.scale_xy = a->scale ? scale : NULL;
	if (a->geoid) {
		int status = geoid_name(s, geoid);

		if (status)
			return status;
		opt.geoid = geoid;
	}
	if (acut_decimal_comma(s->session->acut, in->decimal_comma) ||
	    (a->mode && acut_dataset_mode(s->session->acut, a->mode)) || acut_push_begin(s->session->acut, &opt, &s->push))
		return session_error_acut(s->session);
	if (*acut_push_note(s->push))
		console_line(&s->session->console, "%s: %s", dataset, acut_push_note(s->push));
	return 0;
}

/* Options that compare inputs with the dataset need the whole input here. */
static int keep(struct staging *s, struct ctl_input *in)
{
	struct err err = ERR_INIT;

	return ctl_input_keep_pipe(s->in, in, &in->kept, &err) ? session_error(s->session, &err) : 0;
}

static int start_pipes(struct staging *s)
{
	const struct ctl_stage_options *a = s->opt;
	int status = 0;

	for (size_t i = 0; i < s->in->n && !status; i++)
		if (s->in->input[i].fd >= 0 && s->named && (a->checksum || a->add || a->replace || a->replaces))
			status = keep(s, &s->in->input[i]);
		else if (s->in->input[i].fd >= 0)
			status = ctl_input_start_pipe(s->in, &s->in->input[i], s->push);
	return status;
}

static int commit(struct staging *s)
{
	const struct acut_push_result *result;

	if (acut_push_commit(s->push, &result))
		return session_error_acut(s->session);
	snprintf(s->ret->dataset, sizeof(s->ret->dataset), "%s", result->dataset);
	s->ret->generation = result->generation;
	s->ret->points = result->points;
	s->ret->unchanged = result->unchanged;
	s->ret->has_line_set = result->line_set;
	if (result->line_set)
		s->ret->line_set = *result->line_set;
	s->ret->committed = true;
	return 0;
}

/* A stream over a broken connection ends like a complete one. An interruption while that is found out ends the push. */
static int whole(struct staging *s)
{
	struct err err = ERR_INIT;
	bool piped = false;

	for (size_t i = 0; i < s->in->n; i++)
		piped |= s->in->input[i].fd >= 0;
	if (!piped)
		return 0;
	if (!session_cut_off(s->session)) {
		if (!session_interrupted(s->session))
			return 0;
		err_set(&err, ERR_CANCELLED, "interrupted before the commit");
		return session_error(s->session, &err);
	}
	s->cut = s->in->n == 1; /* what came is of no use */
	err_set(&err, ERR_TRUNCATED, "the connection that it came over is gone, so that it may not be whole; nothing was taken");
	err_add_file(&err, "standard input");
	return session_error(s->session, &err);
}

static void say_soft(struct staging *s)
{
	uint64_t soft = 0;
	char count[32];

	for (size_t i = 0; i < s->in->n; i++)
		soft += s->ret->file[i].lines.soft;
	if (soft)
		console_warn(&s->session->console,
			     "soft lines are read as hard ones, which are the same in a mesh of plane triangles: %s",
			     term_count(soft, count));
}

static void planned(struct staging *s, const struct acut_push_planned *p)
{
	struct ctl_staged *ret = s->ret;

	snprintf(ret->zone, sizeof(ret->zone), "%s", p->zone);
	snprintf(ret->datum, sizeof(ret->datum), "%s", p->datum);
	snprintf(ret->geoid, sizeof(ret->geoid), "%s", p->geoid);
	if (*ret->zone)
		console_line(&s->session->console, "degrees of %s are projected to %s%s (%s)", ret->datum,
			     strncmp(ret->zone, "UPS", 3) ? "UTM zone " : "", ret->zone, p->crs);
}

int ctl_stage(struct ctl_inputs *in, const struct ctl_stage_options *opt, const char *dataset, struct ctl_staged *ret)
{
	struct staging s = {.session = in->session, .opt = opt, .in = in, .ret = ret, .named = dataset};
	uint64_t start = clock_mono_ns();
	const char *lattice;
	struct err err = ERR_INIT;
	int status;

	*ret = (struct ctl_staged){.opt = opt, .nfile = in->n};
	ret->file = calloc(in->n, sizeof(*ret->file));
	if (!ret->file) {
		err_set(&err, ERR_NOMEM, "no memory for %zu inputs", in->n);
		return session_error(s.session, &err);
	}
	for (size_t i = 0; i < in->n; i++)
		ret->file[i].name = in->input[i].name;
	session_progress_init(&s.progress, s.session);
	status = begin(&s, dataset);
	if (!status)
		status = start_pipes(&s);
	if (!status)
		status = each_file(&s, true);
	say_soft(&s);
	if (!status && ret->known + ret->refused < in->n) {
		if (acut_push_plan(s.push, &lattice)) {
			status = session_error_acut(s.session);
		} else {
			planned(&s, acut_push_planned(s.push));
			if (*acut_push_planned(s.push)->note)
				console_warn(&s.session->console, "%s", acut_push_planned(s.push)->note);
			if (acut_push_first(s.push))
				ctl_assume_warn(&s.session->console, &s.assume);
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
	if (dataset && !s.cut && (session_caught() || !(opt->strict || in->opt->manifest)))
		acut_push_leave(s.push);
	else
		acut_push_end(s.push);
	ctl_assume_done(&s.assume);
	console_progress_clear(&s.session->console);
	ret->seconds = clock_since(start);
	return status ? status : ret->refused ? SESSION_SOME_REFUSED : 0;
}

void ctl_stage_done(struct ctl_staged *s)
{
	for (size_t i = 0; s->file && i < s->nfile; i++) {
		free(s->file[i].warning);
		free(s->file[i].projected_from);
		free(s->file[i].overridden);
	}
	free(s->file);
	*s = (struct ctl_staged){0};
}

int ctl_stage_check(const struct ctl_stage_options *a, const struct ctl_input_options *in, struct err *err)
{
	if (a->add && (a->replace || a->replaces))
		return err_set(err, ERR_USAGE,
			       "--add takes a file beside the old one, --replace in its place: both at once are nothing");
	if (in->name && (!*in->name || strchr(in->name, '/')))
		return err_set(err, ERR_USAGE, "--name is a name without slashes");
	return 0;
}
