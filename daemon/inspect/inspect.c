/*
 * Inspection of one file, for `acutctl info`: its header by one task, then, when it is known what reading takes,
 * its records by another (pipe_inspect), which stages their positions into the cache's folder for temporary
 * files and leaves nothing there. What follows from both, and what does not agree, is worked out here.
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
	struct sched_task task;
	struct core *core;
	int fd, r;
	char *name, *format, *columns, info_format[16];
	bool decimal_comma;
	bool read; /* the header is: now the records */
	size_t read_bytes;
	struct client_file id;
	struct inspect_result *result;
	struct err err;
	inspect_answer_fn *answer;
	void *token;
};

static struct input_options options_of(const struct inspect *a)
{
	/* It is described only, so its plane does not matter, nor that it ends early. */
	return (struct input_options){
		.format = *a->format ? a->format : NULL,
		.columns = *a->columns ? a->columns : NULL,
		.decimal_comma = a->decimal_comma,
		.accept_truncated = true,
		.planar = true,
	};
}

static void take_info(struct inspect *a, const struct input *in)
{
	struct input_info *info = &a->result->info;

	a->result->name = a->name;
	*info = *input_info(in);
	snprintf(a->info_format, sizeof a->info_format, "%s", info->format);
	info->format = a->info_format;
	info->coords.name = a->name;
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
		a->read_bytes = input_info(in)->read_bytes;
	input_close(in);
	if (a->r)
		err_add_file(&a->err, a->name);
}

/* ---- the earth ---- */

/* The rim of the hull, its long sides cut, since a straight line of the plane is not one on the earth. */
static size_t rim_of(const struct pipe_inspected *in, double ret[PIPE_HULL_MOST + RIM][2])
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

static int box_of(const struct crs_geo *g, const double (*rim)[2], size_t n, struct inspect_result *res, struct err *err)
{
	double lat, lon, first = 0;
	int r = 0;

	res->south = res->west = INFINITY;
	res->north = res->east = -INFINITY;
	for (size_t i = 0; i < n; i++) {
		r = crs_geo_reverse(g, rim[i][0], rim[i][1], &lat, &lon, err);
		if (r)
			return r;
		/* Across 180 degrees east and west go on counting. */
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

static int place(struct inspect_result *res, struct err *err)
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
	n = rim_of(in, rim);
	r = box_of(g, (const double(*)[2])rim, n, res, err);
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

/* ---- what does not agree ---- */

__attribute__((format(printf, 2, 3))) static void differs(struct inspect_result *res, const char *fmt, ...)
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

		/* A box that is none was told with the header. Text has no header: its box was read off the points. */
		if (!(c->min[k] <= c->max[k]))
			continue;
		if (!(fabs(c->min[k] - res->in.min[k]) <= half) || !(fabs(c->max[k] - res->in.max[k]) <= half))
			differs(res, "the header has %c from %.10g to %.10g, the points from %.10g to %.10g", "xyz"[k],
				c -> min[k], c -> max[k], res -> in.min[k], res->in.max[k]);
	}
}

static void compare(struct inspect_result *res)
{
	const struct input_info *info = &res->info;
	const struct pipe_inspected *in = &res->in;
	char said[80] = "", are[80] = "";
	bool same = true;

	/* said with the header already, or not */
	if (info->claimed != in->points && !info->miscounted)
		differs(res, "the header says %llu points, %llu are there", (unsigned long long)info->claimed,
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
		differs(res, "the header counts the returns %s; the points are %s", said, are);
	if (in->returns[0])
		differs(res, "%llu points have the return number 0, which is none", (unsigned long long)in->returns[0]);
	if (info->has_trailing && info->trailing)
		differs(res, "%llu bytes behind the last record belong to nothing", (unsigned long long)info->trailing);
}

/* ---- the records ---- */

static int cancelled(void *ctx, uint64_t points)
{
	struct inspect *a = ctx;

	return atomic_load(&a->task.cancel);
}

static int records(struct inspect *a, struct input *in)
{
	static atomic_ullong number;
	struct inspect_result *res = a->result;
	char name[40];
	struct grid_stage_params stage = {.dirfd = a->core->tempfd, .name = name, .memory = STAGE_BYTES};
	struct pipe_inspect_params params = {
		.lattice = &res->lattice, .dirfd = a->core->tempfd, .name = name, .progress = cancelled, .ctx = a};
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
	res->has_place = res->in.points && !place(res, &none);
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

	/* Large, so it is there only while its memory is. */
	a->result = calloc(1, sizeof *a->result);
	if (!a->result)
		a->r = err_set(&a->err, ERR_NOMEM, "no memory to look at a file");
	else
		a->r = input_open(a->fd, a->name, &options, &in, &a->err);
	if (!a->r) {
		take_info(a, in);
		a->r = records(a, in);
	}
	if (!a->r)
		a->r = client_file_check(a->fd, a->name, &id, &a->err);
	if (!a->r && (id.size != a->id.size || id.mtime_ns != a->id.mtime_ns))
		a->r = err_set(&a->err, ERR_CHANGED, "the file changed while it was read");
	input_close(in);
	if (a->r)
		err_add_file(&a->err, a->name);
}

/* ---- loop ---- */

static void inspect_free(struct inspect *a)
{
	io_close(a->fd);
	free(a->name);
	free(a->format);
	free(a->columns);
	free(a->result);
	free(a);
}

static void inspect_done(struct sched_task *t)
{
	struct inspect *a = (struct inspect *)t;
	struct core *core = a->core;

	if (t->ran)
		sched_give(core->p.sched, t->name, t->bytes);
	else
		a->r = err_set(&a->err, ERR_CANCELLED, "the daemon is stopping");
	if (!a->r && !a->read) {
		a->read = true;
		a->task = (struct sched_task){
			.run = records_run,
			.done = inspect_done,
			.owner = a->task.owner,
			.lengthy = true,
			.reads = true,
			.priority = SCHED_NORMAL,
			.name = LEDGER_STAGE,
			.bytes = STAGE_BYTES + sizeof *a->result + pipe_inspect_bytes() + input_bytes() + a->read_bytes,
		};
		sched_submit(core->p.sched, &a->task);
		return;
	}
	core_background_done(core);
	a->answer(a->token, a->r ? &a->err : NULL, a->r ? NULL : a->result);
	inspect_free(a);
}

void inspect_file(struct core *core, int fd, const char *name, const char *format, const char *columns, bool decimal_comma,
		  const struct peer *peer, inspect_answer_fn *answer, void *token)
{
	struct inspect *a = calloc(1, sizeof *a);
	struct err err = ERR_INIT;

	THREAD_LOOP_ONLY();
	if (a) {
		a->fd = fd;
		a->name = strdup(name);
		a->format = strdup(format);
		a->columns = strdup(columns);
		a->decimal_comma = decimal_comma;
	}
	if (!a || !a->name || !a->format || !a->columns) {
		if (a)
			inspect_free(a);
		else
			io_close(fd);
		err_set(&err, ERR_NOMEM, "no memory for a request");
		answer(token, &err, NULL);
		return;
	}
	a->task = (struct sched_task){
		.run = header_run,
		.done = inspect_done,
		.owner = {.uid = peer->uid, .flow = ++core->last_flow},
		.reads = true,
		.priority = SCHED_FIRST,
		.name = LEDGER_INPUT,
		.bytes = input_bytes(),
	};
	a->core = core;
	a->err = ERR_INIT;
	a->answer = answer;
	a->token = token;
	core_background(core, &a->task);
}
