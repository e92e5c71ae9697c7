/*
 * The head: what all inputs have in common, from their headers.
 *
 * The model: every input is opened once; text is read to its end, because its digits and its extent are nowhere else. Then
 * system, plane and lattice are agreed as for a push into a new dataset (agree_set.h). An input that a push would refuse is
 * refused here, and with it the run: hours of other nodes would be spent on a mesh with a hole. Inputs get their numbers in the
 * order of the Morton keys of the centres of their boxes, so that neighbours are staged together, and a segment covers a part of
 * the survey. The result is a manifest without segments; the points of its sources are those that their headers claim.
 *
 * Not here: reading points; what later phases make of the order.
 */
#include <math.h>
#include <pthread.h>
#include <pwd.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "clock.h"
#include "err.h"
#include "file_hash.h"
#include "io.h"
#include "lock.h"
#include "point.h"
#include "survey_priv.h"

enum { OPENERS = 16, STACK = 64 << 10 /* of a thread, as far as it is used */ };

struct head {
	struct survey *s;
	struct survey_table table;
	/* While headers are read: the lock guards the table and what follows, and callbacks are called under it. */
	struct lock lock;
	_Atomic size_t next; /* the input that is opened next */
	struct err why;      /* why no more are opened */
};

uint64_t survey_head_bytes(uint64_t inputs)
{
	/* The list of inputs, the table, two lists of boxes to choose zone and lattice, the manifest and its bytes. */
	uint64_t each = sizeof(struct work_input) + sizeof(struct survey_input) + 3 * sizeof(struct lattice_input) +
			2 * sizeof(struct name_slot) + SURVEY_SOURCE_BYTES + 512;

	return SURVEY_PROCESS_BYTES + OPENERS * (input_bytes() + STACK) + inputs * each;
}

/* ---- refusals ---- */

static void refuse(struct head *h, size_t i, const struct err *why)
{
	h->table.input[i].refused = true;
	if (!h->table.refused++ || i < h->table.first_refused) {
		h->table.first_refused = i;
		h->table.first = *why;
	}
	if (h->s->p->refused)
		h->s->p->refused(h->s->p->ctx, why);
}

static int all_refused(struct head *h, struct err *err)
{
	const struct survey_table *t = &h->table;

	err_set(err, t->first.code, "%zu of %zu inputs cannot be used; %.200s: %.250s", t->refused, t->n, t->first.file,
		t->first.message);
	return err_add_hint(err, "mend them, or leave them out; the output of this task names them all");
}

/* ---- headers ---- */

static int refuse_lines(struct err *err)
{
	err_set(err, ERR_UNSUPPORTED, "it is a file of lines, which a cluster does not mesh");
	return err_add_hint(err, "leave it out, or mesh the survey with acutd: acutctl mesh");
}

static int note(struct head *h, struct survey_input *to, const struct input *in, struct err *err)
{
	const struct input_info *info = input_info(in);
	struct survey_table *t = &h->table;
	const char *wkt = agree_wkt_of(&h->s->agree, input_wkt(in));
	char reading[GRID_SOURCE_READING], overridden[AGREE_OVERRIDDEN];
	struct crs_info crs;
	int r;

	/* Found by its bytes: all of them are set. */
	memcpy(&crs, &info->crs, sizeof crs);
	if (info->lines.are)
		return refuse_lines(err);
	r = agree_say(&h->s->agree, to->in.name, &crs, overridden, err);
	if (r)
		return r;
	agree_how_read(&h->s->agree, info->format, h->s->p->columns ? h->s->p->columns : "", h->s->p->decimal_comma, &crs,
		       reading, sizeof reading);
	to->in.coords = info->coords;
	to->in.coords.name = to->in.name;
	to->in.crs = survey_keep(t, &crs, sizeof crs);
	to->reading = survey_keep(t, reading, strlen(reading) + 1);
	to->overridden = survey_keep(t, overridden, strlen(overridden) + 1);
	to->wkt = *wkt ? survey_keep(t, wkt, strlen(wkt) + 1) : "";
	if (!to->in.crs || !to->reading || !to->overridden || !to->wkt)
		return err_set(err, ERR_NOMEM, "no memory for %zu inputs", t->n);
	to->claimed = info->most && info->claimed > info->most ? info->most : info->claimed;
	t->read_bytes = info->read_bytes > t->read_bytes ? info->read_bytes : t->read_bytes;
	return 0;
}

static int open_one(struct head *h, struct survey_input *to, struct err *err)
{
	const struct input_options options = survey_input_options(h->s, false);
	struct input *in = NULL;
	int fd, r = survey_open(h->s, to->file->path, to->file->size, to->file->mtime_ns, &fd, err);

	if (r)
		return r;
	r = input_open(fd, to->file->path, &options, &in, err);
	if (!r)
		r = file_hash_bounded(input_info(in), to->file->size, to->file->path, err);
	if (!r) {
		lock_take(&h->lock);
		r = note(h, to, in, err);
		lock_give(&h->lock);
	}
	input_close(in);
	io_close(fd);
	return r ? err_add_file(err, to->file->path) : 0;
}

/* Counts an input; false: nobody opens another one. */
static bool opened(struct head *h, size_t i, int r, const struct err *why)
{
	bool go_on;

	lock_take(&h->lock);
	if (!h->why.code && !work_check_interrupt(h->s->work, &h->why) && r) {
		if (r == -ERR_NOMEM)
			h->why = *why;
		else
			refuse(h, i, why);
	}
	go_on = !h->why.code;
	lock_give(&h->lock);
	return go_on;
}

static void *open_some(void *ctx)
{
	struct head *h = ctx;
	bool go_on = true;
	size_t i;

	while (go_on && (i = atomic_fetch_add(&h->next, 1)) < h->table.n) {
		struct err why = ERR_INIT;
		int r = open_one(h, &h->table.input[i], &why);

		go_on = opened(h, i, r, &why);
	}
	return NULL;
}

/* A header takes little time and several answers of the file system, so many are asked for at once. */
static int open_all(struct head *h, struct err *err)
{
	pthread_t helper[OPENERS - 1];
	unsigned n = 0;

	while (n < OPENERS - 1 && n + 1 < h->table.n && !pthread_create(&helper[n], NULL, open_some, h))
		n++;
	open_some(h);
	while (n)
		pthread_join(helper[--n], NULL);
	if (h->why.code)
		*err = h->why;
	return -(int)h->why.code;
}

/* ---- agreement ---- */

static struct agree_input *input_at(void *ctx, size_t i)
{
	struct survey_input *in = &((struct head *)ctx)->table.input[i];

	return in->refused ? NULL : &in->in;
}

static int exclude(void *ctx, size_t i, const struct err *why)
{
	refuse(ctx, i, why);
	return 0;
}

static const struct crs_info *keep(void *ctx, const struct crs_info *crs)
{
	return survey_keep(&((struct head *)ctx)->table, crs, sizeof *crs);
}

static int agree_all(struct head *h, struct err *err)
{
	const struct agree_inputs in = {.n = h->table.n, .at = input_at, .exclude = exclude, .keep = keep, .ctx = h};
	struct agree *a = &h->s->agree;
	struct err why = ERR_INIT;
	int r = 0;

	if (h->table.refused < h->table.n)
		r = agree_plane_choose(a, &in, &why);
	if (!r && h->table.refused < h->table.n)
		r = agree_crs(a, &in, &why);
	if (!r && h->table.refused < h->table.n)
		r = agree_lattice(a, &in, &why);
	if (r && !h->table.refused) {
		*err = why;
		return r;
	}
	/* What is wrong with the others is told, too. */
	if (r && h->s->p->refused)
		h->s->p->refused(h->s->p->ctx, &why);
	return h->table.refused ? all_refused(h, err) : 0;
}

/* ---- order ---- */

static int32_t to_lattice(const struct lattice *l, int axis, double v)
{
	double n = v / decimal_double(l->scale_xy) - (double)l->k[axis];

	return n < INT32_MIN ? INT32_MIN : n > INT32_MAX ? INT32_MAX : (int32_t)floor(n);
}

/* An input without a box, as one without points, comes last. */
static void set_keys(struct head *h)
{
	const struct lattice *l = &h->s->agree.lattice;

	for (size_t i = 0; i < h->table.n; i++) {
		struct survey_input *in = &h->table.input[i];
		const struct lattice_input *c = &in->in.coords;
		bool good = true;
		int32_t at[2];

		for (int k = 0; k < 2; k++) {
			good &= isfinite(c->min[k]) && isfinite(c->max[k]) && c->min[k] <= c->max[k];
			at[k] = good ? to_lattice(l, k, c->min[k] + (c->max[k] - c->min[k]) / 2) : 0;
		}
		in->key = good ? point_morton(at[0], at[1]) : UINT64_MAX;
	}
}

static int by_key(const void *a, const void *b)
{
	const struct survey_input *x = a, *y = b;

	return x->key < y->key ? -1 : x->key > y->key ? 1 : strcmp(x->file->path, y->file->path);
}

/* ---- the manifest ---- */

/* Of the first input of the command that has one that holds. */
static char *wkt_of(const struct head *h)
{
	const char *before = "";
	char *wkt = NULL;

	for (size_t i = 0; !wkt && i < h->table.n; i++) {
		const char *own = h->table.input[i].wkt;

		if (*own && own != before)
			wkt = agree_wkt_part(&h->s->agree, own);
		before = own;
	}
	return wkt;
}

static void fill_source(const struct survey_input *in, size_t i, struct grid_source *s)
{
	const char *slash = strrchr(in->file->path, '/'), *base = slash ? slash + 1 : in->file->path;

	*s = (struct grid_source){
		.id = (uint32_t)i + 1,
		.added = 1,
		.points = in->claimed,
		/* The last part of a name that is too long. */
		.name = strlen(base) < GRID_SOURCE_NAME ? base : base + strlen(base) - (GRID_SOURCE_NAME - 1),
		.path = in->file->path,
		.size = in->file->size,
		.mtime_ns = in->file->mtime_ns,
		.overridden = in->overridden,
		.reading = in->reading,
	};
}

static void note_generation(struct grid_generation *g, char user[GRID_USER])
{
	struct passwd entry, *found = NULL;
	char buffer[4096];

	if (getpwuid_r(geteuid(), &entry, buffer, sizeof buffer, &found) == 0 && found && strlen(entry.pw_name) < GRID_USER)
		memcpy(user, entry.pw_name, strlen(entry.pw_name) + 1);
	*g = (struct grid_generation){
		.number = 1, .time_us = clock_real_us(), .uid = (uint32_t)geteuid(), .user = user, .kind = GRID_PUSH};
}

static int write_manifest(struct head *h, char *wkt, struct err *err)
{
	const struct survey_table *t = &h->table;
	const struct agree *a = &h->s->agree;
	char user[GRID_USER] = "", name[WORK_NAME];
	struct grid_generation generation;
	struct grid_manifest m = {.lattice = a->lattice,
				  .generation = 1,
				  .oldest = 1,
				  .wkt = wkt,
				  .wkt_since = 1,
				  .nsources = t->n,
				  .generations = &generation,
				  .ngenerations = 1};
	int r;

	m.sources = calloc(t->n + 1, sizeof *m.sources);
	if (!m.sources)
		return err_set(err, ERR_NOMEM, "no memory for a manifest");
	for (size_t i = 0; i < t->n; i++)
		fill_source(&t->input[i], i, &m.sources[i]);
	note_generation(&generation, user);
	snprintf(m.crs, sizeof m.crs, "%s", a->crs);
	snprintf(m.unit_xy, sizeof m.unit_xy, "%s", a->unit_xy);
	snprintf(m.unit_z, sizeof m.unit_z, "%s", a->unit_z);
	snprintf(m.geoid, sizeof m.geoid, "%s", a->geoid_text);
	r = work_attempt_file(h->s->attempt, "", "head", "", name, err);
	if (!r)
		r = grid_manifest_write(work_fd(h->s->work), name, &m, err);
	if (!r)
		r = work_result_file(h->s->attempt, name, err);
	free(m.sources);
	return r;
}

static int write_results(struct head *h, struct err *err)
{
	const struct agree *a = &h->s->agree;
	char lattice[LATTICE_TEXT_SIZE], zone[8] = "";
	const char *const text[][2] = {{"crs", a->crs},
				       {"unit_xy", a->unit_xy},
				       {"unit_z", a->unit_z},
				       {"lattice", lattice_text(&a->lattice, lattice)},
				       {"zone", a->projects ? crs_zone_text(a->zone, zone) : ""},
				       {"datum", a->projects ? a->datum : ""},
				       {"geoid", a->geoid_text},
				       {"note", a->note}};
	uint64_t points = 0, bytes = 0;
	int r = 0;

	for (size_t i = 0; i < h->table.n; i++) {
		points += h->table.input[i].claimed;
		bytes += h->table.input[i].file->size;
	}
	for (size_t i = 0; !r && i < sizeof text / sizeof *text; i++)
		r = work_result(h->s->attempt, text[i][0], text[i][1], err);
	if (!r)
		r = work_result_u64(h->s->attempt, "inputs", h->table.n, err);
	if (!r)
		r = work_result_u64(h->s->attempt, "points", points, err);
	if (!r)
		r = work_result_u64(h->s->attempt, "bytes", bytes, err);
	return r ? r : work_result_u64(h->s->attempt, "read_bytes", h->table.read_bytes, err);
}

static int run(struct survey *s, uint32_t task, struct err *err)
{
	struct head h = {.s = s, .why = ERR_INIT};
	char *wkt;
	int r = survey_table_read(&h.table, s->work, err);

	lock_init(&h.lock, LOCK_SURVEY);
	if (!r)
		r = survey_agree(s, NULL, err);
	if (!r)
		r = open_all(&h, err);
	if (!r)
		r = agree_all(&h, err);
	if (!r) {
		wkt = wkt_of(&h);
		set_keys(&h);
		qsort(h.table.input, h.table.n, sizeof *h.table.input, by_key);
		r = write_manifest(&h, wkt, err);
		free(wkt);
	}
	if (!r)
		r = write_results(&h, err);
	survey_table_free(&h.table);
	lock_done(&h.lock);
	return r;
}

int survey_head(struct work *w, const struct survey_params *p, struct err *err)
{
	return survey_run(w, WORK_HEAD, 0, p, run, err);
}
