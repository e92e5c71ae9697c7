/*
 * The positions that weights hide, as GeoJSON: the vertices of a mesh of the same view with `hidden`, which a job of its own
 * makes.
 */
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "ctl_report.h"
#include "ctl_report_names.h"
#include "outfile.h"
#include "term_json.h"

enum { PLACES = 1000 /* that are printed at once */ };

struct writing {
	struct outfile *out;
	struct err *err;
	struct ctl_report_names names;
	struct acut_mesh_head head; /* its texts are valid during the fetch */
	uint64_t n;
	int r; /* of the first failure */
};

/* ---- the file ---- */

static void put(struct writing *w, const char *text)
{
	if (!w->r)
		w->r = outfile_write(w->out, text, strlen(text), w->err);
}

static void put_place(struct writing *w, FILE *f, const int32_t at[3], const struct acut_mesh_origin *of)
{
	struct term_json j;
	char text[48];

	fputc(w->n++ ? ',' : '\n', f);
	j = term_json_begin(f, true);
	term_json_text(&j, "type", "Feature");
	term_json_open(&j, "properties", '{');
	term_json_u64(&j, "class", of->cls);
	term_json_known_u64(&j, "source", of->source);
	term_json_text(&j, "file", of->source ? ctl_report_name_of(&w->names, of->source) : NULL);
	term_json_close(&j, '}');
	term_json_open(&j, "geometry", '{');
	term_json_text(&j, "type", "Point");
	term_json_open(&j, "coordinates", '[');
	for (unsigned axis = 0; axis < 3; axis++)
		term_json_literal(&j, NULL, acut_coordinate_text(&w->head, axis, at[axis], text));
	term_json_close(&j, ']');
	term_json_close(&j, '}');
	term_json_end(&j);
}

/* Some positions, printed into memory first. */
static void put_places(struct writing *w, const struct acut_mesh_block *b, uint32_t from, uint32_t to)
{
	char *text = NULL;
	size_t size = 0;
	FILE *f = open_memstream(&text, &size);

	for (uint32_t i = from; f && i < to; i++)
		put_place(w, f, b->vertex[i], &b->origin[i]);
	if (!f || fclose(f))
		w->r = err_set(w->err, ERR_NOMEM, "no memory for a report");
	else
		w->r = outfile_write(w->out, text, size, w->err);
	free(text);
}

static int on_head(void *ctx, const struct acut_mesh_head *head)
{
	struct writing *w = ctx;

	w->head = *head;
	w->r = ctl_report_geojson_head(w->out, head->epsg, head->unit_xy, w->err);
	return w->r;
}

static int on_block(void *ctx, const struct acut_mesh_block *b)
{
	struct writing *w = ctx;

	for (uint32_t i = 0; b->origin && !w->r && i < b->nnew; i += PLACES)
		put_places(w, b, i, b->nnew - i < PLACES ? b->nnew : i + PLACES);
	return w->r;
}

/* The head of a mesh with `hidden` says how to read its numbers. */
static int fetch(struct session *session, const char *dataset, uint64_t generation, const char *view, struct writing *w)
{
	const struct acut_submission what = {
		.dataset = dataset, .generation = generation, .view = view, .bound = true, .fresh = true};
	const struct acut_mesh_sink sink = {.head = on_head, .block = on_block, .ctx = w};
	const struct acut_job *job;

	ctl_report_names_read(session->acut, dataset, &w->names);
	if (acut_fetch_window(session->acut, NULL) || acut_submit_job(session->acut, &what, &job) ||
	    acut_fetch(session->acut, job->id, &sink))
		return w->r ? 0 : session_error_acut(session);
	return 0;
}

/* ---- the report ---- */

/* Of the folder that the path is in, and its name there. */
static const char *folder_of(const char *path, struct stat *ret)
{
	const char *slash = strrchr(path, '/');
	char *folder = slash ? strndup(path, (size_t)(slash - path) + 1) : strdup(".");
	int r = folder ? stat(folder, ret) : -1;

	free(folder);
	return r ? NULL : slash ? slash + 1 : path;
}

static bool same_place(const char *a, const char *b)
{
	const char *name[2];
	struct stat x, y;

	if (!strcmp(a, b))
		return true;
	if (!strcmp(a, "-") || !strcmp(b, "-"))
		return false;
	if (!stat(a, &x) && !stat(b, &y))
		return S_ISREG(x.st_mode) && x.st_dev == y.st_dev && x.st_ino == y.st_ino;
	name[0] = folder_of(a, &x);
	name[1] = folder_of(b, &y);
	return name[0] && name[1] && x.st_dev == y.st_dev && x.st_ino == y.st_ino && !strcmp(name[0], name[1]);
}

int ctl_report_hidden_open(const char *path, bool no_clobber, const char *const *outputs, struct outfile **ret, struct err *err)
{
	for (; *outputs; outputs++)
		if (same_place(*outputs, path)) {
			err_set(err, ERR_USAGE, "%s is given for the output and for --weight-report",
				strcmp(path, "-") ? path : "standard output");
			return err_add_hint(err, "give --weight-report a file of its own");
		}
	return outfile_new(path, no_clobber, ret, err);
}

int ctl_report_hidden_check(const char *view, struct err *err)
{
	if (strstr(view, " window=")) {
		err_set(err, ERR_USAGE, "--weight-report is of a whole mesh, not of the window of --bbox or --polygon");
		return err_add_hint(err, "leave it out, or take a part of the points with --crop");
	}
	if (strstr(view, " weight="))
		return 0;
	err_set(err, ERR_USAGE, "without weights nothing is hidden");
	return err_add_hint(err, "give --weight a radius above zero, or leave out --weight-report");
}

int ctl_report_hidden(struct session *session, const char *dataset, uint64_t generation, const char *view, struct outfile *out)
{
	struct err err = ERR_INIT;
	struct writing w = {.out = out, .err = &err};
	char *hidden = NULL;
	int status;

	if (asprintf(&hidden, "%s hidden", view) < 0) {
		err_set(&err, ERR_NOMEM, "no memory for a view");
		return session_error(session, &err);
	}
	status = fetch(session, dataset, generation, hidden, &w);
	put(&w, w.n ? "]}\n" : "\n]}\n");
	if (!status && !w.r)
		w.r = outfile_publish(w.out, &err);
	if (!status && w.r) {
		err_add_file(&err, outfile_name(out));
		status = session_error(session, &err);
	}
	free(hidden);
	ctl_report_names_free(&w.names);
	return status;
}

void ctl_report_hidden_close(struct outfile *out)
{
	outfile_free(out);
}
