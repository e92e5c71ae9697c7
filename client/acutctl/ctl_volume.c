/*
 * volume: cut and fill between the meshes of two jobs, or between a level and one. The meshes are streamed as by fetch, one after
 * the other; with --within only the triangles that meet the polygons, where their text is short enough for a window.
 */
#include <stdlib.h>
#include <string.h>

#include "ctl.h"

enum { NO_CHANGES = -1 }; /* in place of an exit status */

/* What must live as long as the comparison. */
struct work {
	struct session *session;
	struct ctl_volume about;
	struct ctl_area areas;
	struct volume_image image[CLI_TEXTS];
	struct volume_options opt;
	struct volume *volume;
	char *text[2][4], name[2][32]; /* of jobs */
	char *window;                  /* NULL: the whole meshes */
	struct session_progress progress;
	struct acut_changes_sink sink; /* of the running fetch */
};

/* ---- options ---- */

static bool ends(const char *text, const char *with)
{
	size_t n = strlen(text), m = strlen(with);

	return n >= m && !strcasecmp(text + n - m, with);
}

static int parse_outputs(struct work *w, const struct ctl_volume_options *o, struct err *err)
{
	for (unsigned i = 0; i < o->output.n; i++) {
		const char *path = o->output.text[i];
		bool tif = ends(path, ".tif") || ends(path, ".tiff");

		if (!tif && !ends(path, ".png")) {
			err_set(err, ERR_USAGE, "%s is neither a picture (.png) nor a raster (.tif)", path);
			return err_add_hint(err, "the numbers go to standard output; --csv and --json are other forms of them");
		}
		for (unsigned j = 0; j < i; j++)
			if (!strcmp(path, o->output.text[j]))
				return err_set(err, ERR_USAGE, "the output %s is given twice", path);
		w->image[i] = (struct volume_image){path, tif, o->no_clobber};
	}
	w->opt.image = w->image;
	w->opt.nimage = o->output.n;
	if (!o->cell)
		return 0;
	if (!o->output.n)
		return err_set(err, ERR_USAGE, "--cell is the side of a pixel, and there is no -o OUT");
	if (volume_length(o->cell, &w->opt.cell, &w->opt.cell_unit))
		return 0;
	err_set(err, ERR_USAGE, "--cell is not a length above zero: \"%s\"", o->cell);
	return err_add_hint(err, "give a number in the units of the files, or one with m, ft or ftUS, as in 1m");
}

static int parse_level(struct work *w, const struct ctl_volume_options *o, unsigned jobs, struct err *err)
{
	if (!o->level && jobs < 2) {
		err_set(err, ERR_USAGE, "one mesh alone has no volume");
		return err_add_hint(err, "give a second job, or --level Z");
	}
	if (o->level && jobs > 1)
		return err_set(err, ERR_USAGE, "--level takes the place of the first job, and there are two");
	if (!o->level)
		return 0;
	w->opt.has_level = w->about.has_level = true;
	if (!decimal_parse(o->level, &w->opt.level)) {
		err_set(err, ERR_USAGE, "--level is not a height: \"%s\"", o->level);
		return err_add_hint(err, "give a number in the unit of the mesh, as in --level 55.5");
	}
	w->about.level = decimal_double(w->opt.level);
	return 0;
}

static int no_such_field(const struct ctl_area *a, const char *field, const char *file, struct err *err)
{
	char *list = NULL;
	size_t size;
	FILE *out = open_memstream(&list, &size);

	err_set(err, ERR_USAGE, "no polygon has a property \"%.64s\" that is a text or a number", field);
	err_add_file(err, file);
	for (unsigned i = 0; i < a->nfield && out; i++)
		fprintf(out, "%s%.40s", i ? ", " : "", a->field[i]);
	if (out && a->more_fields)
		fprintf(out, " and others");
	if (!out || fclose(out) || !a->nfield)
		err_add_hint(err, "they have no such properties at all: leave out --name-field, and they are numbered");
	else
		err_add_hint(err, "they have %s", list);
	free(list);
	return -(int)err->code;
}

/* A field that was asked for must name something. */
static int check_names(struct work *w, const struct ctl_volume_options *o, struct err *err)
{
	size_t named = 0;

	for (size_t i = 0; i < w->areas.nfeature; i++)
		named += *ctl_area_name(&w->areas, i) != 0;
	if (!o->name_field || named == w->areas.nfeature)
		return 0;
	if (!named)
		return no_such_field(&w->areas, o->name_field, o->within, err);
	console_warn(&w->session->console,
		     "%zu of %zu polygons have no property \"%s\" that is a text or a number: they are numbered",
		     w->areas.nfeature - named, w->areas.nfeature, o->name_field);
	return 0;
}

static bool same_corner(const struct decimal a[2], const struct decimal b[2])
{
	return !decimal_compare(a[0], b[0]) && !decimal_compare(a[1], b[1]);
}

/* A ring of one or two places is a mistake. One without corners is an empty polygon. */
static int check_rings(const struct ctl_area *a, const char *file, struct err *err)
{
	for (size_t i = 0; i < a->nring; i++) {
		size_t first = a->ring[i].first, end = first + ctl_area_corners(a, i), second = first, third;

		while (second < end && same_corner(a->corner[second], a->corner[first]))
			second++;
		for (third = second; third < end; third++)
			if (!same_corner(a->corner[third], a->corner[first]) && !same_corner(a->corner[third], a->corner[second]))
				break;
		if (first == end || third < end)
			continue;
		err_set(err, ERR_INPUT, "a polygon has a ring of fewer than three corners, which has no area");
		return err_add_file(err, file);
	}
	return 0;
}

/* Features without a polygon have no result. */
static int parse_within(struct work *w, const struct ctl_volume_options *o, struct err *err)
{
	struct ctl_area *a = &w->areas;
	FILE *text;
	size_t n = 0, size;
	int r;

	if (!o->within)
		return o->name_field ? err_set(err, ERR_USAGE, "--name-field is of the polygons of --within FILE") : 0;
	r = ctl_area_read_named(o->within, o->name_field ? o->name_field : "name", a, err);
	if (r)
		return r;
	if (check_rings(a, o->within, err))
		return -(int)err->code;
	for (size_t i = 0; i < a->nfeature; i++)
		if (a->feature[i].ring < (i + 1 < a->nfeature ? a->feature[i + 1].ring : a->nring))
			a->feature[n++] = a->feature[i];
	a->nfeature = n;
	w->opt.areas = a;
	w->opt.areas_file = o->within;
	if (check_names(w, o, err))
		return -(int)err->code;
	text = open_memstream(&w->window, &size);
	if (!text)
		return err_set(err, ERR_NOMEM, "no memory for polygons");
	r = ctl_area_print(a, text, err);
	if (fclose(text) || r) { /* too long: the whole meshes come */
		free(w->window);
		w->window = NULL;
		*err = (struct err)ERR_INIT;
	}
	return 0;
}

static int parse(struct work *w, const struct program *ctl, struct err *err)
{
	const struct ctl_volume_options *o = &ctl->volume;
	int r = parse_level(w, o, ctl->line.nword, err);

	w->about.opt = o;
	for (unsigned i = 0; i < ctl->line.nword && !r; i++)
		r = ctl_job_id(ctl->line.word[i], &w->about.mesh[i].job, err);
	if (!r && o->csv && w->session->console.json)
		r = err_set(err, ERR_USAGE, "--csv and --json are two forms of the results");
	if (!r)
		r = parse_outputs(w, o, err);
	if (!r)
		r = parse_within(w, o, err);
	w->opt.unit = o->unit;
	return r;
}

/* ---- jobs ---- */

static int check_system(const struct work *w, const char *crs, struct err *err)
{
	unsigned long of = ctl_area_epsg(&w->areas), mesh = strncmp(crs, "EPSG:", 5) ? 0 : strtoul(crs + 5, NULL, 10);

	if (!of || !mesh || of == mesh)
		return 0;
	err_set(err, ERR_USAGE, "the polygons are in EPSG:%lu, and the mesh in EPSG:%lu", of, mesh);
	err_add_file(err, w->opt.areas_file);
	return err_add_hint(err, "convert them: ogr2ogr -t_srs EPSG:%lu OUT.geojson FILE", mesh);
}

/* What is known of its mesh before it is made. Exit status. */
static int find_job(struct work *w, unsigned i)
{
	struct session *session = w->session;
	struct ctl_volume_mesh *m = &w->about.mesh[i];
	const struct acut_job *job;
	struct err err = ERR_INIT;
	const char *of[4];

	if (acut_job_wait(session->acut, m->job, false, NULL, NULL, &job))
		return session_error_acut(session);
	if (job->final && !job->has_report) {
		int status = ctl_report_job_status(session, job);

		return status ? status : 1;
	}
	of[0] = job->lattice;
	of[1] = job->crs;
	of[2] = job->unit_xy;
	of[3] = job->unit_z;
	m->generation = job->generation;
	m->dataset = strdup(job->dataset);
	m->view = strdup(job->view);
	for (int k = 0; k < 4; k++)
		w->text[i][k] = strdup(of[k] ? of[k] : "");
	if (!m->dataset || !m->view || !w->text[i][0] || !w->text[i][1] || !w->text[i][2] || !w->text[i][3]) {
		err_set(&err, ERR_NOMEM, "no memory for a job");
		return session_error(session, &err);
	}
	snprintf(w->name[i], sizeof(w->name[i]), "job %llu", (unsigned long long)m->job);
	w->opt.side[i] = (struct volume_side){w->name[i], w->text[i][0], w->text[i][1], w->text[i][2], w->text[i][3], 0};
	return check_system(w, w->text[i][1], &err) ? session_error(session, &err) : 0;
}

/* Exit status. */
static int wait_job(struct work *w, unsigned i)
{
	struct session *session = w->session;
	const struct acut_job *job;
	int status;

	if (acut_job_wait(session->acut, w->about.mesh[i].job, true, session_progress_job, &w->progress, &job))
		return session_error_acut(session);
	status = job->has_report ? 0 : ctl_report_job_status(session, job);
	if (status || !job->has_report)
		return status ? status : 1;
	w->opt.side[i].triangles = w->window ? job->report.triangles / 8 : job->report.triangles;
	volume_expect(w->volume, i, w->opt.side[i].triangles);
	return 0;
}

/* ---- the meshes ---- */

static int take_head(void *ctx, const struct acut_mesh_head *head)
{
	struct work *w = ctx;

	return w->sink.mesh.head(w->sink.mesh.ctx, head);
}

static int take_block(void *ctx, const struct acut_mesh_block *block)
{
	struct work *w = ctx;

	return w->sink.mesh.block(w->sink.mesh.ctx, block);
}

static int take_tail(void *ctx, const struct acut_mesh_tail *tail)
{
	struct work *w = ctx;

	return w->sink.mesh.tail(w->sink.mesh.ctx, tail);
}

static int take_base(void *ctx, const struct acut_mesh_base *base)
{
	struct work *w = ctx;

	return w->sink.base(w->sink.mesh.ctx, base);
}

static int take_gone(void *ctx, const struct acut_mesh_region *region)
{
	struct work *w = ctx;

	return w->sink.gone(w->sink.mesh.ctx, region);
}

static void take_progress(void *ctx, const struct acut_progress *now)
{
	struct work *w = ctx;

	session_progress_show(&w->progress, now);
}

static void show_pairs(void *ctx, double share)
{
	struct session *session = ctx;

	if (console_progress_on(&session->console))
		console_progress(&session->console, "compare %.0f %%", 100 * share);
}

/* Exit status. since 0: the whole mesh, or its window. */
static int fetch(struct work *w, unsigned side, const struct acut_changes_sink *sink, uint64_t since)
{
	const struct acut_changes_sink mine = {{take_head, take_block, take_tail, take_progress, w}, take_base, take_gone};
	struct session *session = w->session;
	uint64_t job = w->about.mesh[side].job;

	w->sink = *sink;
	if (acut_fetch_window(session->acut, since ? NULL : w->window))
		return session_error_acut(session);
	if (!(since ? acut_fetch_changes(session->acut, job, since, &mine) : acut_fetch(session->acut, job, &mine.mesh)))
		return 0;
	if (since && (volume_changes_fail(w->volume) || acut_error(session->acut)->code == ACUT_E_GONE))
		return NO_CHANGES;
	if (volume_error(w->volume)->code)
		return session_error(session, volume_error(w->volume));
	return session_error_acut(session);
}

static int begin(struct work *w)
{
	struct err err = ERR_INIT;

	w->volume = volume_free(w->volume);
	if (volume_new(&w->opt, &w->volume, &err))
		return session_error(w->session, &err);
	w->about.volume = w->volume;
	return 0;
}

/* Of two generations under one view only what changed, where the daemon knows it (NO_CHANGES). The whole second mesh gives the
 * area. */
static int by_changes(struct work *w)
{
	const struct ctl_volume_mesh *m = w->about.mesh;
	struct acut_changes_sink sink;
	int status = 0;

	if (w->opt.has_level || w->opt.areas || w->opt.nimage || strcmp(m[0].dataset, m[1].dataset) != 0 ||
	    strcmp(m[0].view, m[1].view) != 0 || m[0].generation == m[1].generation)
		return NO_CHANGES;
	for (unsigned i = 0; i < 2 && !status; i++) {
		sink = volume_changes(w->volume, i, m[!i].job);
		status = fetch(w, i, &sink, m[!i].generation);
	}
	if (status == NO_CHANGES && !(status = begin(w)))
		return NO_CHANGES;
	sink.mesh = volume_whole(w->volume);
	return status ? status : fetch(w, 1, &sink, 0);
}

static int by_wholes(struct work *w)
{
	int status = 0;

	for (unsigned i = 0; i < (w->opt.has_level ? 1 : 2) && !status; i++) {
		const struct acut_changes_sink sink = {volume_sink(w->volume, i), NULL, NULL};

		status = fetch(w, i, &sink, 0);
	}
	return status;
}

/* With the names of files, where they are known. */
static void warn_views(const struct work *w)
{
	const struct ctl_volume_mesh *m = w->about.mesh;
	char *text[2];

	for (int i = 0; i < 2; i++)
		text[i] = ctl_report_view(w->session->acut, m[i].dataset, m[i].view);
	console_warn(&w->session->console, "the views of the two jobs differ: \"%s\" and \"%s\"", text[0] ? text[0] : m[0].view,
		     text[1] ? text[1] : m[1].view);
	for (int i = 0; i < 2; i++)
		free(text[i]);
}

static void warn(const struct work *w)
{
	struct console *c = &w->session->console;
	const struct ctl_volume *v = &w->about;
	bool any = false;

	for (size_t i = 0; i < volume_results(w->volume); i++) {
		struct volume_result p;

		volume_result(w->volume, i, &p);
		any |= p.area > 0;
	}
	if (!any)
		console_warn(c, "%s",
			     v->opt->within ? "no polygon meets what is compared" :
			     v->has_level   ? "the mesh has no triangles" :
					      "the two meshes have no place in common");
	if (!v->has_level && strcmp(v->mesh[0].view, v->mesh[1].view) != 0)
		warn_views(w);
	if (!v->has_level && (!*w->text[0][1] || !strcmp(w->text[0][1], "unknown")))
		console_warn(c, "the coordinate system of the meshes is not known; it is taken to be the same");
}

/* Exit status. */
static int compare(struct work *w)
{
	struct session *session = w->session;
	struct console *c = &session->console;
	unsigned n = w->opt.has_level ? 1 : 2;
	struct err err = ERR_INIT;
	int status = 0;

	session_progress_init(&w->progress, session);
	for (unsigned i = 0; i < n && !status; i++)
		status = find_job(w, i);
	if (!status) /* all that is wrong with the options is said before a job is waited for */
		status = begin(w);
	for (unsigned i = 0; i < n && !status; i++)
		status = wait_job(w, i);
	if (status)
		return status;
	status = by_changes(w);
	if (status == NO_CHANGES)
		status = by_wholes(w);
	if (status)
		return status;
	if (volume_finish(w->volume, &err))
		return session_error(session, &err);
	console_progress_clear(c);
	warn(w);
	if (c->json)
		ctl_volume_json(c, &w->about);
	else if (w->about.opt->csv)
		ctl_volume_csv(c, &w->about);
	else
		ctl_volume_text(c, &w->about);
	return 0;
}

int ctl_volume_run(struct program *ctl)
{
	struct work w = {.session = &ctl->session,
			 .opt = {.interrupted = session_interrupted, .progress = show_pairs, .ctx = &ctl->session}};
	struct err err = ERR_INIT;
	int status;

	ctl->session.writes = ctl->volume.output.n > 0;
	if (parse(&w, ctl, &err))
		status = session_error(&ctl->session, &err);
	else if (!(status = session_connect(&ctl->session)))
		status = compare(&w);
	volume_free(w.volume);
	ctl_area_done(&w.areas);
	free(w.window);
	for (int i = 0; i < 2; i++) {
		free(w.about.mesh[i].dataset);
		free(w.about.mesh[i].view);
		for (int k = 0; k < 4; k++)
			free(w.text[i][k]);
	}
	return status;
}
