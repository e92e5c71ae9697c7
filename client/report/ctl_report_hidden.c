/*
 * The positions that weights hide, as GeoJSON: the vertices of a mesh of the same view with `hidden`, which a job of its own
 * makes.
 *
 * Names of files are kept in memory, at most NAMES_MOST bytes of them; files beyond have their number alone.
 */
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "ctl_report.h"
#include "grow.h"
#include "outfile.h"

enum { NAMES_MOST = 16 << 20, NAME_MOST = 256 };

struct names {
	struct name {
		uint32_t source, at; /* at: in the text */
	} * row;
	char *text;
	size_t n, room, used, size;
	bool full;
};

struct writing {
	struct outfile *out;
	struct err *err;
	struct names names;
	struct acut_mesh_head head; /* its texts are valid during the fetch */
	uint64_t n;
	int r; /* of the first failure */
};

/* ---- names of files ---- */

/* Room for n, of which each has `size` bytes. */
static bool room_for(void *array, size_t *room, size_t n, size_t size)
{
	return n <= NAMES_MOST / 2 / size && grow(array, room, n, 1024, size);
}

static void keep_name(void *ctx, const struct acut_log_file *f)
{
	struct names *k = ctx;
	size_t n = strlen(f->name) + 1;

	if (k->full || f->of_lines || f->removed)
		return;
	k->full = !room_for(&k->row, &k->room, k->n + 1, sizeof *k->row) || !room_for(&k->text, &k->size, k->used + n, 1);
	if (k->full)
		return;
	k->row[k->n++] = (struct name){f->source, (uint32_t)k->used};
	memcpy(k->text + k->used, f->name, n);
	k->used += n;
}

static void pass_generation(void *ctx, const struct acut_generation *g) {}

static int by_source(const void *a, const void *b)
{
	uint32_t p = ((const struct name *)a)->source, q = ((const struct name *)b)->source;

	return (p > q) - (p < q);
}

/* NULL: it is not known. */
static const char *name_of(const struct names *k, uint32_t source)
{
	const struct name key = {source, 0};
	const struct name *hit = k->n ? bsearch(&key, k->row, k->n, sizeof key, by_source) : NULL;

	return hit ? k->text + hit->at : NULL;
}

/* ---- the file ---- */

static void put(struct writing *w, const char *text)
{
	if (!w->r)
		w->r = outfile_write(w->out, text, strlen(text), w->err);
}

static char *json_text(const char *text, char buf[6 * NAME_MOST + 3])
{
	char *to = buf;

	*to++ = '"';
	for (size_t i = 0; text[i] && i < NAME_MOST; i++)
		if ((unsigned char)text[i] < 0x20 || text[i] == '"' || text[i] == '\\')
			to += sprintf(to, "\\u%04x", (unsigned char)text[i]);
		else
			*to++ = text[i];
	*to++ = '"';
	*to = 0;
	return buf;
}

static void put_place(struct writing *w, const int32_t at[3], const struct acut_mesh_origin *of)
{
	char text[512], a[3][48], name[6 * NAME_MOST + 3];
	const char *file = of->source ? name_of(&w->names, of->source) : NULL;

	snprintf(text, sizeof text, "%s\n{\"type\":\"Feature\",\"properties\":{\"class\":%u,\"source\":", w->n++ ? "," : "",
		 of->cls);
	put(w, text);
	snprintf(text, sizeof text, of->source ? "%u" : "null", of->source);
	put(w, text);
	put(w, ",\"file\":");
	put(w, file ? json_text(file, name) : "null");
	snprintf(text, sizeof text, "},\"geometry\":{\"type\":\"Point\",\"coordinates\":[%s,%s,%s]}}",
		 acut_coordinate_text(&w->head, 0, at[0], a[0]), acut_coordinate_text(&w->head, 1, at[1], a[1]),
		 acut_coordinate_text(&w->head, 2, at[2], a[2]));
	put(w, text);
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

	for (uint32_t i = 0; b->origin && !w->r && i < b->nnew; i++)
		put_place(w, b->vertex[i], &b->origin[i]);
	return w->r;
}

/* The head of a mesh with `hidden` says how to read its numbers. */
static int fetch(struct session *session, const char *dataset, uint64_t generation, const char *view, struct writing *w)
{
	const struct acut_submission what = {
		.dataset = dataset, .generation = generation, .view = view, .bound = true, .fresh = true};
	const struct acut_log_sink log = {.generation = pass_generation, .file = keep_name, .ctx = &w->names};
	const struct acut_mesh_sink sink = {.head = on_head, .block = on_block, .ctx = w};
	const struct acut_job *job;

	/* Names are a help: a dataset of one step has no log. */
	if (!acut_dataset_log(session->acut, dataset, &log) && w->names.n)
		qsort(w->names.row, w->names.n, sizeof *w->names.row, by_source);
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
	put(&w, "\n]}\n");
	if (!status && !w.r)
		w.r = outfile_publish(w.out, &err);
	if (!status && w.r) {
		err_add_file(&err, outfile_name(out));
		status = session_error(session, &err);
	}
	free(hidden);
	free(w.names.row);
	free(w.names.text);
	return status;
}

void ctl_report_hidden_close(struct outfile *out)
{
	outfile_free(out);
}
