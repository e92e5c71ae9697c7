/*
 * Outputs: from options to a run of writers, the fetch into it, and the report at the end.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "ctl.h"
#include "parse.h"

static int parse_origin(const char *text, struct format_options *opt, struct err *err)
{
	char part[3 * DECIMAL_TEXT_SIZE], *at = part, *rest;

	if (!strcmp(text, "auto")) {
		opt->origin_auto = true;
		return 0;
	}
	opt->has_origin = strlen(text) < sizeof(part);
	snprintf(part, sizeof(part), "%s", text);
	for (int i = 0; i < 3 && opt->has_origin; i++) {
		rest = strchr(at, ',');
		if (!rest != (i == 2))
			opt->has_origin = false;
		if (rest)
			*rest++ = 0;
		if (opt->has_origin && !decimal_parse(at, &opt->origin[i]))
			opt->has_origin = false;
		at = rest;
	}
	if (!opt->has_origin)
		return err_set(err, ERR_USAGE, "--origin is not X,Y,Z or auto: \"%s\"", text);
	return 0;
}

/* Options of one output; what it cannot use is refused by the run, what none can use below. */
static int options_of(const struct ctl_args *a, const struct format *f, struct format_options *opt, struct err *err)
{
	bool picture = f->positions && !f->canonical;

	*opt = (struct format_options){.no_clobber = a->no_clobber};
	if (picture) {
		if (a->width > FORMAT_WIDTH_MAX)
			return err_set(err, ERR_USAGE, "--width is more than %d", FORMAT_WIDTH_MAX);
		opt->width = (uint32_t)a->width;
		if (a->color && !format_parse_color(a->color, &opt->color))
			return err_set(err, ERR_USAGE, "--color is hillshade, elevation or domain, not \"%s\"", a->color);
		return 0;
	}
	opt->canonical = a->canonical;
	opt->z_unit = a->z_unit ? format_unit_of_word(a->z_unit, strlen(a->z_unit)) : NULL;
	if (a->z_unit && !opt->z_unit)
		return err_set(err, ERR_USAGE, "--z-unit is m, ft or ftUS, not \"%s\"", a->z_unit);
	return a->origin ? parse_origin(a->origin, opt, err) : 0;
}

static const struct format *format_of(const struct ctl_args *a, const char *path, struct err *err)
{
	const char *tile = a->format ? a->format : "ply";
	const struct format *by_path = strcmp(path, "-") ? format_by_path(path) : NULL, *f = by_path;

	if (a->tile || (a->format && (a->out.n == 1 || !by_path))) {
		f = format_find(a->tile ? tile : a->format);
		if (!f) {
			err_set(err, ERR_USAGE, "there is no output format %s", a->tile ? tile : a->format);
			err_add_hint(err, "acutctl formats lists them");
		}
	} else if (!f && !strcmp(path, "-")) {
		f = format_find("ply"); /* as a file of tiles is, unless said */
	} else if (!f) {
		err_set(err, ERR_USAGE, "the name does not say in which format to write");
		err_add_file(err, path);
		err_add_hint(err, "give --format, as in --format ply; acutctl formats lists them");
	}
	return f;
}

static int add_output(const struct ctl_args *a, const char *path, struct format_run *run, bool *ret_picture, bool *ret_mesh,
		      struct err *err)
{
	const struct format *f = path ? format_of(a, path, err) : format_find(a->format);
	struct format_options opt;
	int r = f ? options_of(a, f, &opt, err) : -(int)err->code;

	if (r)
		return r;
	if (path && !a->tile && !f->nothing && !strcmp(path, "-") && isatty(STDOUT_FILENO)) {
		err_set(err, ERR_USAGE, "standard output is a terminal");
		return err_add_hint(err, "give a file, as in -o mesh.%s, or a pipe", f->name);
	}
	*ret_picture |= f->positions && !f->canonical;
	*ret_mesh |= f->canonical;
	return format_run_add(run, path, f, &opt, err);
}

bool ctl_output_nothing(const struct ctl_args *a)
{
	const struct format *f = a->format ? format_find(a->format) : NULL;

	return !a->out.n && f && f->nothing;
}

static int check_outputs(const struct ctl_args *a, struct err *err)
{
	unsigned standard = 0;

	if (!a->out.n && !ctl_output_nothing(a)) {
		err_set(err, ERR_USAGE, "no output given");
		return err_add_hint(err, "say where to write with -o OUT, as in -o mesh.ply");
	}
	for (unsigned i = 0; i < a->out.n; i++) {
		standard += !strcmp(a->out.text[i], "-");
		for (unsigned j = 0; j < i; j++)
			if (!strcmp(a->out.text[i], a->out.text[j]))
				return err_set(err, ERR_USAGE, "the output %s is given twice", a->out.text[i]);
	}
	if (a->tile && a->out.n != 1) {
		err_set(err, ERR_USAGE,
			a->out.n ? "tiles go into one folder, and --output is given %u times" : "tiles need a folder", a->out.n);
		return err_add_hint(err, "say where to write with one -o DIR/, as in -o tiles/");
	}
	return standard > 1 ? err_set(err, ERR_USAGE, "standard output is given twice") : 0;
}

/* A number, and the unit behind it, if there is one. */
static int parse_length(const char *text, struct format_run_options *opt, struct err *err)
{
	char number[DECIMAL_TEXT_SIZE];
	size_t n = strlen(text), m = n;

	while (m && ((text[m - 1] | 32) >= 'a' && (text[m - 1] | 32) <= 'z'))
		m--;
	opt->has_max_edge = true;
	opt->max_edge_unit = m < n ? format_unit_of_word(text + m, n - m) : NULL;
	snprintf(number, sizeof(number), "%.*s", (int)m, text);
	if (m < sizeof(number) && (m == n || opt->max_edge_unit) && decimal_parse(number, &opt->max_edge) &&
	    opt->max_edge.mantissa > 0)
		return 0;
	err_set(err, ERR_USAGE, "--max-edge is not a length above zero: \"%s\"", text);
	return err_add_hint(err, "give a number in the units of the files, or one with m, ft or ftUS, as in 30m");
}

static int parse_tile(struct program *ctl, struct format_run_options *opt, struct err *err)
{
	opt->tiled = true;
	opt->interrupted = session_interrupted;
	opt->ctx = &ctl->session;
	if (decimal_parse(ctl->args.tile, &opt->tile) && opt->tile.mantissa > 0)
		return 0;
	err_set(err, ERR_USAGE, "--tile is not a number above zero: \"%s\"", ctl->args.tile);
	return err_add_hint(err, "give the side of a tile in the units of the dataset, as in --tile 500");
}

int ctl_output_open(struct program *ctl, struct format_run **ret, struct err *err)
{
	const struct ctl_args *a = &ctl->args;
	struct format_run_options opt = {.edges = !a->since, .changes = a->since > 0};
	struct format_run *run = NULL;
	bool picture = false, mesh = false;
	int r = check_outputs(a, err);

	if (!r && a->max_edge)
		r = parse_length(a->max_edge, &opt, err);
	if (!r && a->since && (ctl->view.bbox || ctl->view.polygon))
		r = err_set(err, ERR_USAGE, "--changed-since is of a whole mesh, not of --%s",
			    ctl->view.bbox ? "bbox" : "polygon");
	if (!r && a->tile && a->since) {
		r = err_set(err, ERR_USAGE, "--tile has no meaning with --changed-since: a tile needs all of its triangles");
		err_add_hint(err, "fetch the tiles of the whole mesh: those that have not changed are the same bytes");
	}
	if (!r && a->tile)
		r = parse_tile(ctl, &opt, err);
	if (!r)
		r = format_run_new(&opt, &run, err);
	if (!r && ctl_output_nothing(a))
		r = add_output(a, NULL, run, &picture, &mesh, err);
	for (unsigned i = 0; i < a->out.n && !r; i++)
		r = add_output(a, a->out.text[i], run, &picture, &mesh, err);
	if (!r && !picture && (a->width || a->color))
		r = err_set(err, ERR_USAGE, "--%s is for pictures, and no OUT is one", a->width ? "width" : "color");
	if (!r && !mesh && (a->canonical || a->origin || a->z_unit))
		r = err_set(err, ERR_USAGE, "--%s has no meaning for a picture",
			    a->canonical ? "canonical" :
			    a->origin    ? "origin" :
					   "z-unit");
	if (r)
		format_run_free(run);
	else
		*ret = run;
	return r;
}

/* A fetched job does not say what its pushes moved and left out: null. */
static void moved_json(struct term_json *j, const struct ctl_staged *staged)
{
	double shift[3];
	uint64_t moved = ctl_summary_moved(staged, shift), left_out = 0;

	if (!staged) {
		term_json_text(j, "moved", NULL);
		term_json_text(j, "max_shift", NULL);
		term_json_text(j, "lines_left_out", NULL);
		return;
	}
	for (size_t i = 0; i < staged->nfile; i++)
		left_out += staged->file[i].refused ? 0 : staged->file[i].left_out;
	term_json_u64(j, "moved", moved);
	term_json_open(j, "max_shift", '[');
	for (int k = 0; k < 3; k++)
		term_json_number(j, NULL, shift[k]);
	term_json_close(j, ']');
	term_json_u64(j, "lines_left_out", left_out);
}

/* What was read of each input. */
static void inputs_json(struct term_json *j, const struct ctl_staged *staged)
{
	term_json_open(j, "inputs", '[');
	for (size_t i = 0; staged && i < staged->nfile; i++) {
		const struct ctl_staged_file *f = &staged->file[i];

		if (f->refused)
			continue;
		term_json_open(j, NULL, '{');
		term_json_text(j, "file", f->name);
		term_json_u64(j, "points", f->points);
		term_json_u64(j, "bytes_read", f->bytes_read);
		term_json_u64(j, "bytes_total", f->bytes);
		term_json_bool(j, "partial", f->partial);
		term_json_text(j, "overridden", f->overridden);
		term_json_close(j, '}');
	}
	term_json_close(j, ']');
}

static const char *z_unit_of(const struct program *ctl, const struct acut_job *job)
{
	const char *word = ctl->args.z_unit;

	return word ? format_unit_of_word(word, strlen(word)) : job->unit_z;
}

static void changes_json(struct program *ctl, struct term_json *j, const struct format_changes *c)
{
	if (!ctl->args.since) {
		term_json_text(j, "changes", NULL);
		return;
	}
	term_json_open(j, "changes", '{');
	term_json_u64(j, "since", c->since);
	term_json_u64(j, "old_job", c->old_job);
	term_json_u64(j, "gone", c->gone);
	term_json_u64(j, "gone_triangles", c->gone_triangles);
	term_json_u64(j, "kept", c->kept);
	term_json_u64(j, "kept_triangles", c->kept_triangles);
	term_json_u64(j, "new", c->new_regions);
	term_json_u64(j, "new_triangles", c->new_triangles);
	term_json_close(j, '}');
}

static void tiles_json(struct program *ctl, struct term_json *j, const struct format_report *out)
{
	const char *dir = ctl->args.out.text[0];
	size_t n = ctl->args.tile ? strlen(dir) : 0;
	char *index;

	if (!ctl->args.tile) {
		term_json_text(j, "tiles", NULL);
		return;
	}
	if (asprintf(&index, "%s%s" FORMAT_TILES_INDEX, dir, n && dir[n - 1] == '/' ? "" : "/") < 0)
		index = NULL;
	term_json_open(j, "tiles", '{');
	term_json_u64(j, "files", out->tiles);
	term_json_text(j, "size", ctl->args.tile);
	term_json_text(j, "folder", dir);
	term_json_text(j, "index", index);
	term_json_close(j, '}');
	free(index);
}

static void report_json(struct program *ctl, const struct acut_job *job, const struct format_report *out,
			const struct ctl_staged *staged)
{
	const struct acut_report *p = &job->report;
	struct term_json j = {.out = ctl->session.console.report};

	term_json_open(&j, NULL, '{');
	term_json_u64(&j, "job", job->id);
	term_json_known(&j, "dataset", job->dataset);
	term_json_u64(&j, "generation", job->generation);
	ctl_job_report(&j, p);
	ctl_job_lattice(&j, job->lattice);
	/* of what was written */
	ctl_job_units(&j, job->crs, job->unit_xy, z_unit_of(ctl, job));
	moved_json(&j, staged);
	ctl_height_json(&j, staged, NULL);
	inputs_json(&j, staged);
	term_json_u64(&j, "output_bytes", out->bytes);
	ctl_outlier_json(ctl, &j, out);
	if (ctl->args.max_edge) {
		term_json_open(&j, "left_out", '{');
		term_json_u64(&j, "triangles", out->left_out);
		term_json_number(&j, "area", out->left_out_area);
		term_json_close(&j, '}');
	} else {
		term_json_text(&j, "left_out", NULL);
	}
	tiles_json(ctl, &j, out);
	changes_json(ctl, &j, &out->changes);
	term_json_open(&j, "refused", '[');
	for (size_t i = 0; staged && i < staged->nfile; i++)
		if (staged->file[i].refused)
			ctl_job_refused(&j, &staged->file[i]);
	term_json_close(&j, ']');
	ctl_job_notes(&j, p);
	term_json_open(&j, "warnings", '[');
	for (size_t i = 0; i < ctl->session.console.nwarning; i++)
		term_json_text(&j, NULL, ctl->session.console.warning[i]);
	term_json_close(&j, ']');
	term_json_close(&j, '}');
	term_json_line(&j);
}

static void warn_no_tiles(struct program *ctl, const struct acut_report *p, const struct format_report *out)
{
	char count[32];

	if (ctl->args.tile && !out->tiles && p->vertices)
		console_warn(&ctl->session.console,
			     "%s %s in no tile, since there are no triangles%s: without --tile they are written",
			     term_count(p->vertices, count), p->vertices == 1 ? "vertex lies" : "vertices lie",
			     p->triangles ? " but those that --max-edge leaves out" : "");
}

static int publish(struct program *ctl, const struct acut_job *job, struct format_run *run, const struct ctl_staged *staged)
{
	struct format_report out;
	struct err err = ERR_INIT;

	format_run_about(run, job->id, job->dataset, job->generation);
	if (format_run_publish(run, &err))
		return session_error(&ctl->session, &err);
	format_run_report(run, &out);
	console_progress_clear(&ctl->session.console);
	ctl_outlier_warn(ctl, &job->report, &out);
	warn_no_tiles(ctl, &job->report, &out);
	if (ctl->session.console.json)
		report_json(ctl, job, &out, staged);
	else
		ctl_summary(ctl, job, &out, staged);
	return 0;
}

/* The run's sink and the progress line share one context. */
struct feed {
	struct acut_mesh_sink sink;
	struct format_run *run;
	struct session_progress progress;
	struct program *ctl;
	struct err err; /* of saving */
	bool part;      /* of a job's mesh only a window is fetched */
	struct ctl_window window;
};

static int feed_head(void *ctx, const struct acut_mesh_head *head)
{
	struct feed *f = ctx;

	return f->sink.head(f->sink.ctx, head);
}

/* What the run has, with the state of the fetch, as of the last block. */
static int feed_save(struct feed *f)
{
	void *state;
	size_t size;
	int r;

	if (acut_fetch_state(f->ctl->session.acut, &state, &size))
		return session_failure(&f->ctl->session, NULL, &f->err);
	r = format_run_save(f->run, state, size, &f->err);
	free(state);
	return r;
}

static int feed_block(void *ctx, const struct acut_mesh_block *block)
{
	struct feed *f = ctx;
	int r = f->sink.block(f->sink.ctx, block);

	return r || !format_run_due(f->run) ? r : feed_save(f);
}

static int feed_base(void *ctx, const struct acut_mesh_base *base)
{
	struct feed *f = ctx;

	return format_run_changes(f->run).base(f->sink.ctx, base);
}

static int feed_gone(void *ctx, const struct acut_mesh_region *region)
{
	struct feed *f = ctx;

	return format_run_changes(f->run).gone(f->sink.ctx, region);
}

static int feed_tail(void *ctx, const struct acut_mesh_tail *tail)
{
	struct feed *f = ctx;

	if (f->part)
		ctl_window_tail(&f->window, tail);
	return f->sink.tail(f->sink.ctx, tail);
}

static void feed_progress(void *ctx, const struct acut_progress *now)
{
	struct feed *f = ctx;

	session_progress_show(&f->progress, now);
}

/* These are of what came, or of what is there: going on would not mend them. */
static bool can_go_on(const struct feed *f, const struct err *err)
{
	return format_run_saved(f->run) && err->code != ERR_GONE && err->code != ERR_DIGEST && err->code != ERR_PROTO &&
	       err->code != ERR_CORRUPT;
}

/* A fetch that failed keeps what came; says how to go on. */
static int feed_failed(struct feed *f, uint64_t id)
{
	static const char way[] = "acutctl fetch %llu --resume, with the same outputs and options, goes on with what came";
	struct program *ctl = f->ctl;
	struct err err;
	int status;

	session_failure(&ctl->session, NULL, &err);
	if (format_run_error(f->run)->code)
		err = *format_run_error(f->run);
	else if (f->err.code)
		err = f->err;
	else if (can_go_on(f, &err))
		feed_save(f);
	if (can_go_on(f, &err) && !err.hint[0] && ctl->session.console.json)
		err_add_hint(&err, way, (unsigned long long)id);
	status = session_error(&ctl->session, &err);
	if (can_go_on(f, &err) && !ctl->session.console.quiet && !ctl->session.console.json) {
		fprintf(stderr, "acutctl: ");
		fprintf(stderr, way, (unsigned long long)id);
		fputc('\n', stderr);
	}
	return status;
}

int ctl_output_fetch(struct program *ctl, uint64_t id, struct format_run *run, const struct ctl_staged *staged)
{
	struct feed feed = {.sink = format_run_sink(run), .run = run, .ctl = ctl, .err = ERR_INIT};
	const struct acut_mesh_sink sink = {feed_head, feed_block, feed_tail, feed_progress, &feed};
	const struct acut_job *job;
	struct acut_job part;
	struct acut_changes_sink changes = format_run_changes(run);
	const void *kept;
	size_t size = 0;
	int r;

	feed.part = !staged && (ctl->view.bbox || ctl->view.polygon);
	session_progress_init(&feed.progress, &ctl->session);
	kept = format_run_kept(run, &size);
	changes.mesh = sink;
	changes.base = feed_base;
	changes.gone = feed_gone;
	if (ctl->args.since)
		r = acut_fetch_changes(ctl->session.acut, id, ctl->args.since, &changes);
	else
		r = kept ? acut_fetch_from(ctl->session.acut, kept, size, &sink) : acut_fetch(ctl->session.acut, id, &sink);
	/* A window need not wait for the job. */
	if (r || acut_job_wait(ctl->session.acut, id, !feed.part, NULL, NULL, &job))
		return feed_failed(&feed, id);
	if (feed.part) {
		part = *job;
		part.report = feed.window.report;
		return publish(ctl, &part, run, staged);
	}
	if (!job->has_report)
		return ctl_job_status(ctl, job);
	return publish(ctl, job, run, staged);
}
