/*
 * Inspection of one file, for `acutctl info`.
 *
 * The model: one task reads the header, and so finds out how much memory reading takes. A second task, if requested, reads the
 * records (pipe_inspect). It stages their positions in the cache's folder for temporary files, and leaves nothing there. Then it
 * computes area and location, and compares header and records.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "grid_stage.h"
#include "inspect.h"
#include "io.h"

enum { STAGE_BYTES = 8 << 20, RIM = 512 };

struct inspect {
	struct sched_task task; /* first: a task is cast to its inspection */
	struct core *core;
	int fd, r;
	char *name, *format, *columns;
	char *wkt; /* of its system, "": none */
	bool decimal_comma;
	bool header_read; /* the second task runs */
	struct client_file id;
	struct input_info info;
	char info_format[16]; /* that info points to */
	struct inspect_result *result;
	struct err err;
	inspect_header_fn *on_header; /* or */
	inspect_result_fn *on_result;
	void *token;
};

static struct input_options options_of(const struct inspect *a)
{
	/* The file is only described, so an unknown plane is no error, nor a file that ends early. */
	return (struct input_options){
		.format = *a->format ? a->format : NULL,
		.columns = *a->columns ? a->columns : NULL,
		.decimal_comma = a->decimal_comma,
		.accept_truncated = true,
		.planar = true,
	};
}

/* Copies what `in` has of the header. */
static int keep_info(struct inspect *a, const struct input *in, struct input_info *info)
{
	*info = *input_info(in);
	snprintf(a->info_format, sizeof a->info_format, "%s", info->format);
	info->format = a->info_format;
	info->coords.name = a->name;
	free(a->wkt);
	a->wkt = strdup(input_wkt(in));
	return a->wkt ? 0 : err_set(&a->err, ERR_NOMEM, "no memory for a coordinate system");
}

static void header_run(struct sched_task *t)
{
	struct inspect *a = (struct inspect *)t;
	struct input_options options = options_of(a);
	struct input *in = NULL;

	a->r = client_file_check(a->fd, a->name, &a->id, &a->err);
	if (!a->r)
		a->r = input_open(a->fd, a->name, &options, &in, &a->err);
	if (!a->r)
		a->r = keep_info(a, in, &a->info);
	input_close(in);
	if (a->r)
		err_add_file(&a->err, a->name);
}

/* ---- area and location ---- */

/* The boundary of the hull, with its long sides divided: a straight line in the plane is none on the earth. */
static size_t divide_hull(const struct pipe_inspected *in, double ret[PIPE_HULL_MOST + RIM][2])
{
	double around = 0;
	size_t n = 0;

	for (size_t i = 0; i < in->nhull; i++)
		around += hypot(in->hull[(i + 1) % in->nhull][0] - in->hull[i][0],
				in->hull[(i + 1) % in->nhull][1] - in->hull[i][1]);
	for (size_t i = 0; i < in->nhull; i++) {
		const double *a = in->hull[i], *b = in->hull[(i + 1) % in->nhull];
		int pieces = around > 0 ? 1 + (int)(hypot(b[0] - a[0], b[1] - a[1]) / around * (RIM - 8)) : 1;

		for (int k = 0; k < pieces && n < PIPE_HULL_MOST + RIM; k++, n++) {
			ret[n][0] = a[0] + (b[0] - a[0]) * k / pieces;
			ret[n][1] = a[1] + (b[1] - a[1]) * k / pieces;
		}
	}
	return n;
}

static int geographic_box(const struct crs_geo *g, const double (*rim)[2], size_t n, struct inspect_result *res, struct err *err)
{
	double lat, lon, first = 0;
	int r = 0;

	res->south = res->west = INFINITY;
	res->north = res->east = -INFINITY;
	for (size_t i = 0; i < n; i++) {
		r = crs_geo_reverse(g, rim[i][0], rim[i][1], &lat, &lon, err);
		if (r)
			return r;
		/* Across the 180th meridian longitudes continue. */
		if (!i)
			first = lon;
		lon = lon > first + 180 ? lon - 360 : lon < first - 180 ? lon + 360 : lon;
		res->south = fmin(res->south, lat);
		res->north = fmax(res->north, lat);
		res->west = fmin(res->west, lon);
		res->east = fmax(res->east, lon);
	}
	res->west = res->west < -180 ? res->west + 360 : res->west > 180 ? res->west - 360 : res->west;
	res->east = res->east < -180 ? res->east + 360 : res->east > 180 ? res->east - 360 : res->east;
	return 0;
}

static int locate(struct inspect_result *res, struct err *err)
{
	const struct pipe_inspected *in = &res->in;
	double(*rim)[2] = malloc((PIPE_HULL_MOST + RIM) * sizeof *rim), lat, lon;
	struct crs_geo *g = NULL;
	struct err none = ERR_INIT;
	size_t n;
	int r = rim ? crs_geo_new(&res->info.crs.system, &g, err) : err_set(err, ERR_NOMEM, "no memory");

	if (r) {
		free(rim);
		return r;
	}
	n = divide_hull(in, rim);
	r = geographic_box(g, (const double(*)[2])rim, n, res, err);
	if (!r)
		r = crs_geo_area(g, (const double(*)[2])rim, n, &res->area, &res->perimeter, err);
	if (!r)
		r = crs_geo_reverse(g, in->min[0] / 2 + in->max[0] / 2, in->min[1] / 2 + in->max[1] / 2, &lat, &lon, err);
	if (!r && crs_geo_mgrs(lat, lon, 2, res->mgrs, sizeof res->mgrs, &none))
		*res->mgrs = 0;
	crs_geo_free(g);
	free(rim);
	return r;
}

/* ---- differences between header and records ---- */

__attribute__((format(printf, 2, 3))) static void add_difference(struct inspect_result *res, const char *fmt, ...)
{
	va_list ap;

	if (res->ndifferences == INSPECT_DIFFERENCES)
		return;
	va_start(ap, fmt);
	vsnprintf(res->difference[res->ndifferences++], sizeof res->difference[0], fmt, ap);
	va_end(ap);
}

static void compare_box(struct inspect_result *res)
{
	const struct lattice_input *c = &res->info.coords;

	for (int k = 0; k < 3; k++) {
		double half = decimal_double(c->scale[k]) / 2;

		/* An invalid box is reported with the header. A text file has no header; its box comes from the points. */
		if (!(c->min[k] <= c->max[k]))
			continue;
		if (!(fabs(c->min[k] - res->in.min[k]) <= half) || !(fabs(c->max[k] - res->in.max[k]) <= half))
			add_difference(res, "the header has %c from %.10g to %.10g, the points from %.10g to %.10g", "xyz"[k],
				       c -> min[k], c -> max[k], res -> in.min[k], res->in.max[k]);
	}
}

static void compare(struct inspect_result *res)
{
	const struct input_info *info = &res->info;
	const struct pipe_inspected *in = &res->in;
	char said[80] = "", are[80] = "";
	bool same = true;

	/* unless it is reported with the header */
	if (info->claimed != in->points && !info->miscounted)
		add_difference(res, "the header says %llu points, %llu are there", (unsigned long long)info->claimed,
			       (unsigned long long)in->points);
	if (in->points)
		compare_box(res);
	for (int i = 1; info->has_returns && !info->miscounted && i < 16; i++) {
		size_t a = strlen(said), b = strlen(are);

		same = same && info->returns[i] == in->returns[i];
		if (info->returns[i] || in->returns[i]) {
			snprintf(said + a, sizeof said - a, "%s%d: %llu", a ? ", " : "", i, (unsigned long long)info->returns[i]);
			snprintf(are + b, sizeof are - b, "%s%d: %llu", b ? ", " : "", i, (unsigned long long)in->returns[i]);
		}
	}
	if (!same)
		add_difference(res, "the header counts the returns %s; the points are %s", said, are);
	if (in->returns[0])
		add_difference(res, "%llu points have the return number 0, which is invalid", (unsigned long long)in->returns[0]);
	if (info->has_trailing && info->trailing)
		add_difference(res, "%llu bytes behind the last record belong to nothing", (unsigned long long)info->trailing);
}

/* ---- the records ---- */

static int on_progress(void *ctx, uint64_t points)
{
	struct inspect *a = ctx;

	atomic_fetch_add(&a->task.beats, 1);
	return atomic_load(&a->task.cancel);
}

static int inspect_records(struct inspect *a, struct input *in)
{
	static atomic_ullong number;
	struct inspect_result *res = a->result;
	char name[40];
	struct grid_stage_params stage = {.dirfd = a->core->tempfd, .name = name, .memory = STAGE_BYTES};
	struct pipe_inspect_params params = {
		.lattice = &res->lattice, .dirfd = a->core->tempfd, .name = name, .progress = on_progress, .ctx = a};
	struct err none = ERR_INIT;
	int r = lattice_choose(&res->info.coords, 1, NULL, NULL, &res->lattice, &a->err);

	snprintf(name, sizeof name, "inspect-%llu", atomic_fetch_add(&number, 1));
	if (!r)
		r = grid_stage_new(&stage, &params.stage, &a->err);
	if (!r)
		r = pipe_inspect(in, &params, &res->in, &a->err);
	grid_stage_free(params.stage);
	if (r)
		return r;
	compare(res);
	res->has_place = res->in.points && !locate(res, &none);
	if (!res->has_place)
		snprintf(res->no_place, sizeof res->no_place, "%.250s", res->in.points ? none.message : "there are no points");
	return 0;
}

static void records_run(struct sched_task *t)
{
	struct inspect *a = (struct inspect *)t;
	struct input_options options = options_of(a);
	struct client_file id;
	struct input *in = NULL;

	/* Large, so it is allocated only while its memory is charged. */
	a->result = calloc(1, sizeof *a->result);
	if (!a->result)
		a->r = err_set(&a->err, ERR_NOMEM, "no memory to inspect a file");
	else
		a->r = input_open(a->fd, a->name, &options, &in, &a->err);
	if (!a->r) {
		a->result->name = a->name;
		a->r = keep_info(a, in, &a->result->info);
		a->result->wkt = a->wkt;
	}
	if (!a->r)
		a->r = inspect_records(a, in);
	if (!a->r)
		a->r = client_file_check(a->fd, a->name, &id, &a->err);
	if (!a->r && (id.size != a->id.size || id.mtime_ns != a->id.mtime_ns))
		a->r = err_set(&a->err, ERR_CHANGED, "the file changed while it was read");
	input_close(in);
	if (a->r)
		err_add_file(&a->err, a->name);
}

/* ---- loop ---- */

static struct inspect *inspect_free(struct inspect *a)
{
	if (!a)
		return NULL;
	io_close(a->fd);
	free(a->name);
	free(a->format);
	free(a->columns);
	free(a->wkt);
	free(a->result);
	free(a);
	return NULL;
}

static void inspect_done(struct sched_task *t);

static void submit_records(struct inspect *a)
{
	a->task = (struct sched_task){
		.run = records_run,
		.done = inspect_done,
		.owner = a->task.owner,
		.lengthy = true,
		.reads = true,
		.watched = true,
		.priority = SCHED_NORMAL,
		.name = LEDGER_STAGE,
		.bytes = STAGE_BYTES + sizeof *a->result + pipe_inspect_bytes() + input_bytes() + a->info.read_bytes,
	};
	sched_submit(a->core->p.sched, &a->task);
}

static void inspect_done(struct sched_task *t)
{
	struct inspect *a = (struct inspect *)t;
	const struct err *why;

	if (t->ran)
		sched_give(a->core->p.sched, t->name, t->bytes);
	else
		a->r = err_set(&a->err, ERR_CANCELLED, "the daemon is stopping");
	if (!a->r && a->on_result && !a->header_read) {
		a->header_read = true;
		submit_records(a);
		return;
	}
	core_background_done(a->core);
	why = a->r ? &a->err : NULL;
	if (a->on_result)
		a->on_result(a->token, why, why ? NULL : a->result);
	else
		a->on_header(a->token, why, a->name, why ? NULL : &a->info, a->wkt ? a->wkt : "");
	inspect_free(a);
}

/* NULL: no memory; err says so. */
static struct inspect *inspect_new(struct core *core, const struct inspect_input *in, const struct peer *peer, struct err *err)
{
	struct inspect *a = calloc(1, sizeof *a);

	THREAD_LOOP_ONLY();
	if (!a) {
		io_close(in->fd);
		err_set(err, ERR_NOMEM, "no memory for a request");
		return NULL;
	}
	a->core = core;
	a->fd = in->fd;
	a->name = strdup(in->name);
	a->format = strdup(in->format);
	a->columns = strdup(in->columns);
	a->decimal_comma = in->decimal_comma;
	a->err = ERR_INIT;
	a->task = (struct sched_task){
		.run = header_run,
		.done = inspect_done,
		.owner = {.uid = peer->uid, .flow = ++core->last_flow},
		.reads = true,
		.watched = true,
		.priority = SCHED_FIRST,
		.name = LEDGER_INPUT,
		.bytes = input_bytes(),
	};
	if (a->name && a->format && a->columns)
		return a;
	err_set(err, ERR_NOMEM, "no memory for a request");
	return inspect_free(a);
}

void inspect_header(struct core *core, const struct inspect_input *in, const struct peer *peer, inspect_header_fn *answer,
		    void *token)
{
	struct err err = ERR_INIT;
	struct inspect *a = inspect_new(core, in, peer, &err);

	if (!a) {
		answer(token, &err, in->name, NULL, "");
		return;
	}
	a->on_header = answer;
	a->token = token;
	core_background(core, &a->task);
}

void inspect_file(struct core *core, const struct inspect_input *in, const struct peer *peer, inspect_result_fn *answer,
		  void *token)
{
	struct err err = ERR_INIT;
	struct inspect *a = inspect_new(core, in, peer, &err);

	if (!a) {
		answer(token, &err, NULL);
		return;
	}
	a->on_result = answer;
	a->token = token;
	core_background(core, &a->task);
}
