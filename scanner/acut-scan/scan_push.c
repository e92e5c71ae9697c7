/*
 * push: spools into a dataset.
 *
 * The model: each spool becomes sources (scan_source.h), whose hash is known before anything is sent. They go through pipes
 * in pushes of at most eight, each announced (path "spool:ID", hash, size): a source that the dataset has is not sent, one
 * that an interrupted push left whole is adopted, and with --replace the new points replace the old ones in one generation.
 * So the same command, repeated after any failure, leaves each spool in the dataset exactly once. A spool that cannot be used
 * does not hold up the others.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "acut.h"
#include "clock.h"
#include "err.h"
#include "io.h"
#include "scan_push_plane.h"
#include "scan_source.h"

#define SYSTEM_SOCKET "/run/acut/acutd.sock"
enum { BATCH = 8, SOME_REFUSED = 3 };

struct part {
	struct scan_source *list;
	size_t n;
};

struct pushing {
	struct program *args;
	struct acut *acut;
	struct scan_target target;
	int pose_fd;
	struct pose_track *track;
	bool poses_failed;
	struct scan_spool *spool; /* an input each */
	struct part *part;
	struct scan_result *result; /* a source each; in order */
	size_t n, refused;
	uint64_t generation, points;
	uint64_t base; /* points of sources that are done */
};

/* ---- the daemon ---- */

static int stops(void *ctx)
{
	return scan_stopped();
}

static void from_failure(const struct acut_failure *f, struct err *err)
{
	*err = ERR_INIT;
	err->code = (enum err_code)f->code;
	err->offset = f->offset;
	snprintf(err->message, sizeof err->message, "%s", f->message);
	snprintf(err->file, sizeof err->file, "%s", f->file);
	snprintf(err->field, sizeof err->field, "%s", f->field);
	snprintf(err->hint, sizeof err->hint, "%s", f->hint);
}

static int of_acut(const struct pushing *p, struct err *err)
{
	from_failure(acut_error(p->acut), err);
	if (!err->code)
		err_set(err, ERR_INTERNAL, "the daemon gave no reason");
	/* Whatever was answered or not: the same command finds out. */
	if ((err->code == ERR_NODAEMON || err->code == ERR_TIMEOUT) && p->acut)
		err_add_hint(err, "push again when it answers: points that it has are not taken twice");
	return -(int)err->code;
}

static int connect_daemon(struct pushing *p, struct err *err)
{
	const struct acut_options options = {.program = "acut-scan", .interrupted = stops};
	const char *env = getenv("ACUT_SOCKET"), *path = p->args->socket;
	struct stat st;
	int r;

	if (!path && env && *env)
		path = env;
	if (!path && !stat(SYSTEM_SOCKET, &st))
		path = SYSTEM_SOCKET;
	if (!path) {
		err_set(err, ERR_NODAEMON, "no daemon is set: no --socket, no ACUT_SOCKET, no %s", SYSTEM_SOCKET);
		return err_add_hint(err, "start acutd, or give its socket with --socket");
	}
	r = acut_connect(path, &options, &p->acut);
	if (r) {
		from_failure(acut_error(p->acut), err);
		p->acut = acut_close(p->acut);
	}
	return r ? -(int)err->code : 0;
}

static void take_dataset(void *ctx, const struct acut_dataset *d)
{
	struct scan_target *t = ctx;

	t->there = true;
	t->empty = d->generation == 0;
	snprintf(t->crs, sizeof t->crs, "%s", d->crs);
	snprintf(t->unit_xy, sizeof t->unit_xy, "%s", d->unit_xy);
	snprintf(t->unit_z, sizeof t->unit_z, "%s", d->unit_z);
}

static int check_dataset(struct pushing *p, struct err *err)
{
	if (!acut_datasets(p->acut, p->args->into, take_dataset, &p->target))
		return 0;
	if (acut_error(p->acut)->code == ACUT_E_NOTFOUND)
		return 0;
	return of_acut(p, err);
}

/* ---- what is to be pushed ---- */

static bool refusal(enum err_code code)
{
	return code == ERR_INPUT || code == ERR_TRUNCATED || code == ERR_CHANGED || code == ERR_UNSUPPORTED ||
	       code == ERR_LIMIT || code == ERR_VERSION || code == ERR_PERM;
}

static int open_poses(struct pushing *p, struct err *err)
{
	struct scan_plane plane;
	int r = scan_push_plane(p->args, &p->target, &plane, err);

	if (r)
		return r;
	p->pose_fd = open(p->args->pose, O_RDONLY | O_CLOEXEC);
	if (p->pose_fd < 0) {
		if (errno == ENOENT || errno == ENOTDIR)
			err_set(err, ERR_INPUT, "there is no such file");
		else
			err_sys(err, errno, "it cannot be opened");
		return err_add_file(err, p->args->pose);
	}
	r = scan_push_poses(p->args, &plane, p->pose_fd, &p->track, err);
	if (!r)
		scan_push_print_poses(p->args, p->track);
	return r;
}

/* One capture under two names would come once or twice, as it happens. */
static int same_capture(const struct pushing *p, size_t i, struct err *err)
{
	for (size_t k = 0; k < i; k++)
		if (p->spool[k].file && !strcmp(p->spool[k].id, p->spool[i].id)) {
			err_set(err, ERR_USAGE, "it is the same capture as %.200s", p->spool[k].file);
			err_add_hint(err, "push one of them: the longer one, if one was copied while it grew");
			return err_add_file(err, p->spool[i].file);
		}
	return 0;
}

/* A spool that cannot be used is a result of its own, without a source. */
static int refuse_spool(struct pushing *p, size_t i, const struct err *why)
{
	struct scan_source *none = calloc(1, sizeof *none);

	if (!none)
		return -(int)why->code;
	p->spool[i].file = p->args->line.word[i];
	none->spool = &p->spool[i];
	none->kind = SCAN_TEXT_LINES;
	p->part[i] = (struct part){.list = none, .n = 1};
	snprintf(none->name, sizeof none->name, "%s", p->args->line.word[i]);
	return 0;
}

static int find_one(struct pushing *p, size_t i, struct err *err)
{
	int r = scan_spool_open(p->args, p->args->line.word[i], &p->spool[i], err);

	if (!r)
		r = same_capture(p, i, err);
	if (!r && p->spool[i].decoder->kind == DECODER_SWEEP && p->args->pose && !p->track) {
		r = open_poses(p, err);
		p->poses_failed = r != 0;
	}
	if (!r && console_progress_on(&p->args->console))
		console_progress(&p->args->console, "reading %s", p->args->line.word[i]);
	return r ? r : scan_source_find(p->args, &p->spool[i], p->track, &p->part[i].list, &p->part[i].n, err);
}

static int result_add(struct pushing *p, const struct scan_source *s, const struct err *why)
{
	struct scan_result *more = realloc(p->result, (p->n + 1) * sizeof *more);

	if (!more)
		return -ERR_NOMEM;
	p->result = more;
	p->result[p->n] = (struct scan_result){.source = s,
					       .points = s->points,
					       .err = ERR_INIT,
					       .first = !p->n || p->result[p->n - 1].source->spool != s->spool};
	if (why) {
		p->result[p->n].state = SCAN_REFUSED;
		p->result[p->n].err = *why;
		p->refused++;
	}
	p->n++;
	return 0;
}

static int find_all(struct pushing *p, struct err *err)
{
	size_t n = p->args->line.nword;

	p->spool = calloc(n, sizeof *p->spool);
	p->part = calloc(n, sizeof *p->part);
	if (!p->spool || !p->part)
		return err_set(err, ERR_NOMEM, "no memory for %zu spools", n);
	for (size_t i = 0; i < n; i++) {
		struct err why = ERR_INIT;
		int r = find_one(p, i, &why);

		/* An error of the poses or of the call concerns all spools. */
		if (r && (!refusal(why.code) || p->poses_failed || refuse_spool(p, i, &why))) {
			*err = why;
			return r;
		}
		for (size_t k = 0; k < p->part[i].n; k++)
			if (result_add(p, &p->part[i].list[k], r ? &why : NULL))
				return err_set(err, ERR_NOMEM, "no memory for a list of inputs");
	}
	console_progress_clear(&p->args->console);
	return 0;
}

/* ---- one push of a few ---- */

struct batch {
	struct pushing *p;
	struct scan_result *result[BATCH];
	struct scan_feed *feed[BATCH];
	size_t n;
	struct acut_push *push;
};

static void progress(void *ctx, const struct acut_progress *now)
{
	struct pushing *p = ctx;

	uint64_t points = p->base + (strcmp(now->phase, "stage") ? 0 : now->points);

	if (console_progress_on(&p->args->console))
		console_progress(&p->args->console, "%s: %s, %llu points", p->args->into, now->phase, (unsigned long long)points);
}

/* The errors for which a single source is left out. */
static int refuse(struct batch *b, size_t i, struct err *err)
{
	struct scan_result *r = b->result[i];

	if (!*err->file)
		err_add_file(err, r->source->name);
	if (strstr(err->hint, "--replace")) {
		snprintf(err->message, sizeof err->message, "the dataset %.60s has this capture already, with other points",
			 b->p->args->into);
		err->field[0] = err->hint[0] = 0;
		err_add_hint(err,
			     "the spool has grown, or its poses have changed: --replace takes it in place of the old points");
	}
	if (scan_stopped() || !refusal(err->code))
		return -(int)err->code;
	r->state = SCAN_REFUSED;
	r->err = *err;
	b->p->refused++;
	err_clear(err);
	return 0;
}

static int begin(struct batch *b, struct err *err)
{
	struct program *a = b->p->args;
	const struct scan_source *first = b->result[0]->source;
	bool ground = first->kind == SCAN_GROUND, text = first->kind == SCAN_TEXT_LINES;
	const struct acut_push_options options = {
		.dataset = a->into,
		.format = text ? "xyz" : "las",
		.columns = text ? first->spool->profile.columns : NULL,
		.assume_crs = ground ? NULL : a->crs,
		.utm = ground ? NULL : a->utm,
		.geoid = a->geoid,
		.checksum = true,
		.replace = a->replace,
		.progress = progress,
		.ctx = b->p,
	};

	if (acut_push_begin(b->p->acut, &options, &b->push))
		return of_acut(b->p, err);
	if (*acut_push_note(b->push))
		console_note(&a->console, "%s: %s", a->into, acut_push_note(b->push));
	return 0;
}

static struct acut_push_input input_of(const struct scan_source *s)
{
	return (struct acut_push_input){.fd = -1, .name = s->name, .path = s->path, .hash = s->hash, .size = s->size};
}

static int probe_one(struct batch *b, size_t i, struct err *err)
{
	struct scan_result *res = b->result[i];
	const struct acut_push_input in = input_of(res->source);
	const struct acut_probe *probe;
	struct err why = ERR_INIT;
	int fd, r;

	if (acut_push_stream(b->push, in.name, &fd))
		return of_acut(b->p, err);
	r = scan_feed_new(res->source, fd, &b->feed[i], err);
	if (r)
		return r;
	if (acut_push_probe_input(b->push, &in, &probe)) {
		of_acut(b->p, err);
		scan_feed_free(b->feed[i], true, &why);
		b->feed[i] = NULL;
		return refuse(b, i, err);
	}
	res->state = probe->known == ACUT_KNOWN ? SCAN_KNOWN : probe->known ? SCAN_ADOPTED : SCAN_STAGED;
	if (probe->warning && *probe->warning)
		res->warning = strdup(probe->warning);
	if (!probe->known)
		return 0;
	res->points = probe->points;
	res->replaced = probe->replaced;
	scan_feed_free(b->feed[i], true, &why);
	b->feed[i] = NULL;
	return 0;
}

static int file_one(struct batch *b, size_t i, struct err *err)
{
	struct scan_result *res = b->result[i];
	const struct acut_push_input in = input_of(res->source);
	const struct acut_file_result *file = NULL;
	struct err why = ERR_INIT;
	bool failed;

	scan_feed_go(b->feed[i]);
	failed = acut_push_file_input(b->push, &in, &file) != 0;
	if (failed)
		of_acut(b->p, err);
	/* A spool that could not be read is why the daemon got too little. */
	if (scan_feed_free(b->feed[i], failed && err->code != ERR_TRUNCATED && err->code != ERR_CHANGED, &why) < 0)
		*err = why;
	b->feed[i] = NULL;
	if (err->code)
		return refuse(b, i, err);
	res->points = file->points;
	res->moved = file->moved;
	res->replaced = file->replaced;
	b->p->base += file->points;
	if (*file->warning && !res->warning)
		res->warning = strdup(file->warning);
	return 0;
}

static bool to_send(const struct batch *b)
{
	for (size_t i = 0; i < b->n; i++)
		if (b->feed[i])
			return true;
	return false;
}

static int commit(struct batch *b, struct err *err)
{
	const struct acut_push_result *done;

	if (acut_push_commit(b->push, &done))
		return of_acut(b->p, err);
	b->p->generation = done->generation;
	b->p->points = done->points;
	for (size_t i = 0; i < b->n; i++)
		b->result[i]->generation = done->generation;
	return 0;
}

static int push_batch(struct batch *b, struct err *err)
{
	struct err ignored = ERR_INIT;
	const char *lattice;
	size_t refused = 0;
	int r = begin(b, err);

	for (size_t i = 0; !r && i < b->n; i++)
		r = probe_one(b, i, err);
	if (!r && to_send(b) && acut_push_plan(b->push, &lattice))
		r = of_acut(b->p, err);
	for (size_t i = 0; !r && i < b->n; i++)
		if (b->feed[i])
			r = file_one(b, i, err);
	for (size_t i = 0; i < b->n; i++)
		refused += b->result[i]->state == SCAN_REFUSED;
	if (!r && refused < b->n)
		r = commit(b, err);
	/* The durable part of a push that failed is kept for the same command again. */
	if (r || refused < b->n)
		acut_push_leave(b->push);
	else
		acut_push_end(b->push);
	if (r)
		b->p->acut = acut_close(b->p->acut); /* ends what still waits for its pipe */
	for (size_t i = 0; i < b->n; i++)
		scan_feed_free(b->feed[i], true, &ignored);
	return r;
}

/* All inputs of one push are read in one way. */
static bool together(const struct scan_source *a, const struct scan_source *b)
{
	return a->kind == b->kind &&
	       (a->kind != SCAN_TEXT_LINES || !strcmp(a->spool->profile.columns, b->spool->profile.columns));
}

/* The streams of one push are identified by their names. */
static bool name_free(const struct batch *b, const struct scan_source *s)
{
	for (size_t i = 0; i < b->n; i++)
		if (!strcmp(b->result[i]->source->name, s->name))
			return false;
	return true;
}

static int push_all(struct pushing *p, struct err *err)
{
	size_t i = 0;
	int r = 0;

	while (!r && i < p->n) {
		struct batch b = {.p = p};
		size_t first = i;

		for (; i < p->n && b.n < BATCH; i++) {
			if (p->result[i].state == SCAN_REFUSED)
				continue;
			if (b.n && (!together(b.result[0]->source, p->result[i].source) || !name_free(&b, p->result[i].source)))
				break;
			b.result[b.n++] = &p->result[i];
		}
		if (b.n)
			r = push_batch(&b, err);
		console_progress_clear(&p->args->console);
		for (size_t k = first; !r && k < i; k++)
			scan_push_print(p->args, &p->result[k]);
	}
	return r;
}

/* ---- into a file ---- */

static int write_file(struct pushing *p, struct err *err)
{
	int r;

	if (p->n != 1)
		return err_set(err, ERR_USAGE, "-o takes one spool of one file, there are %zu", p->n);
	if (p->refused) {
		*err = p->result[0].err;
		return -(int)err->code;
	}
	r = scan_source_save(p->result[0].source, p->args->output, err);
	p->result[0].state = SCAN_WRITTEN;
	if (!r)
		scan_push_print(p->args, &p->result[0]);
	return r;
}

/* ---- the command ---- */

static int check(struct program *a, struct err *err)
{
	if (!a->into == !a->output) {
		err_set(err, ERR_USAGE,
			a->into ? "--into pushes, -o writes a file: one of the two" : "no dataset is given: --into DATASET");
		return err_add_hint(err, "acut-scan push SPOOL... --pose FILE --into DATASET");
	}
	if (a->name && (a->line.nword != 1 || strchr(a->name, '/')))
		return err_set(err, ERR_USAGE, "--name is the name of one spool, without slashes");
	if (a->output && (a->replace || a->geoid || a->socket))
		return err_set(err, ERR_USAGE, "-o writes a file: there is no daemon for --%s",
			       a->replace ? "replace" :
			       a->geoid   ? "geoid" :
					    "socket");
	if (!a->pose && (a->heading || a->grid_scale || a->gap_s > 0 || a->pose_offset_s != 0))
		return err_set(err, ERR_USAGE,
			       "--heading, --grid-scale, --gap and --pose-offset are about poses, and there is no --pose");
	return 0;
}

static int run(struct pushing *p, struct err *err)
{
	int r = check(p->args, err);

	if (!r && p->args->into)
		r = connect_daemon(p, err);
	if (!r && p->args->into)
		r = check_dataset(p, err);
	if (!r)
		r = find_all(p, err);
	if (!r)
		r = p->args->output ? write_file(p, err) : push_all(p, err);
	return r;
}

static void clear(struct pushing *p)
{
	for (size_t i = 0; i < p->n; i++)
		free(p->result[i].warning);
	for (size_t i = 0; p->part && i < p->args->line.nword; i++)
		free(p->part[i].list);
	for (size_t i = 0; p->spool && i < p->args->line.nword; i++)
		scan_spool_clear(&p->spool[i]);
	pose_track_free(p->track);
	io_close(p->pose_fd);
	acut_close(p->acut);
	free(p->result);
	free(p->part);
	free(p->spool);
}

int scan_push(struct program *args)
{
	struct pushing p = {.args = args, .pose_fd = -1};
	uint64_t start = clock_mono_ns();
	struct err err = ERR_INIT;
	int status = 0;

	if (run(&p, &err))
		status = scan_fail(args, &err);
	else if (p.refused && p.refused == p.n)
		status = err_exit_status(p.result[0].err.code);
	else if (p.refused)
		status = SOME_REFUSED;
	if (p.generation)
		scan_push_print_all(args, p.generation, p.points, clock_since(start));
	clear(&p);
	return status;
}
