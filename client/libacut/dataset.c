/*
 * Datasets, their generations, and what changes a dataset as a whole.
 */
#include "call.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Older daemons have none. */
static void take_lines(const Acut__V1__Lines *m, uint64_t features[4], uint64_t *lines, uint64_t *vertices)
{
	for (size_t i = 0; m && i < 4; i++)
		features[i] = i < m->n_features ? m->features[i] : 0;
	*lines = m ? m->lines : 0;
	*vertices = m ? m->vertices : 0;
}

void call_dataset(const Acut__V1__Dataset *d, struct acut_dataset *ret)
{
	*ret = (struct acut_dataset){
		.name = d->name,
		.lattice = d->lattice,
		.crs = d->crs,
		.unit_xy = d->unit_xy,
		.unit_z = d->unit_z,
		.pending = d->pending,
		.generation = d->generation,
		.points = d->points,
		.bytes = d->bytes,
		.files = d->files,
		.uid = d->uid,
		.gid = d->gid,
		.mode = d->mode,
		.created_us = d->created_us,
		.pushed_us = d->pushed_us,
		.removed_us = d->removed_us,
		.until_us = d->until_us,
		.pinned = d->pinned,
		.id = d->id,
		.oldest = d->oldest,
		.segments = d->segments,
		.merging = d->merging,
		.wkt = d->wkt,
		.geoid = d->geoid,
		.line_files = d->line_files,
	};
	take_lines(d->lines, ret->features, &ret->lines, &ret->vertices);
	call_system(ret->crs, &ret->epsg, &ret->epsg_z, &ret->vertical);
	for (size_t i = 0; i < 3; i++) {
		ret->min[i] = i < d->n_min ? d->min[i] : NAN;
		ret->max[i] = i < d->n_max ? d->max[i] : NAN;
	}
}

/* ---- the log ---- */

enum { PATH_BYTES = 4096 };

/* A path is bytes: what is not UTF-8 becomes "?". */
static const char *path_text(const ProtobufCBinaryData *path, char buf[PATH_BYTES])
{
	size_t n = path->len < PATH_BYTES ? path->len : PATH_BYTES - 1;

	if (n)
		memcpy(buf, path->data, n);
	buf[n] = 0;
	return frame_text_clean(buf);
}

/* The files of a generation, and the generations: each row of these may ask for its files. */
struct files_list {
	struct acut *acut;
	Acut__V1__FilesRequest req;
	uint32_t last; /* handed out */
	const struct acut_log_sink *sink;
};

static bool files_next(void *ctx, const Acut__V1__Message *page)
{
	struct files_list *l = ctx;
	const Acut__V1__Files *files = page->files;

	if (files->n_files)
		l->req.after = files->files[files->n_files - 1]->source;
	return files->more && files->n_files;
}

static int files_rows(void *ctx, const Acut__V1__Message *page)
{
	struct files_list *l = ctx;
	char path[PATH_BYTES];
	int r = 0;

	for (size_t i = 0; i < page->files->n_files && r == 0; i++) {
		const Acut__V1__DatasetFile *f = page->files->files[i];
		struct acut_log_file file = {.name = f->name,
					     .path = path_text(&f->path, path),
					     .hash = f->hash,
					     .points = f->points,
					     .size = f->size,
					     .source = f->source,
					     .removed = f->removed,
					     .overridden = f->overridden,
					     .of_lines = f->lines != NULL};

		take_lines(f->lines, file.features, &file.lines, &file.vertices);
		r = call_rises(l->acut, f->source > l->last, "files");
		if (r == 0)
			l->sink->file(l->sink->ctx, &file);
		l->last = f->source;
	}
	return r;
}

static int files_of(struct acut *a, const char *dataset, uint64_t generation, const struct acut_log_sink *sink)
{
	struct files_list l = {.acut = a, .req = ACUT__V1__FILES_REQUEST__INIT, .sink = sink};

	l.req.dataset = call_text(dataset);
	l.req.generation = generation;
	l.req.limit = CALL_PAGE;
	return call_list(a, &(struct call_list){.req = FRAME_MESSAGE(FILES_REQUEST, files_request, &l.req),
						.want = ACUT__V1__MESSAGE__BODY_FILES,
						.ctx = &l,
						.next = files_next,
						.rows = files_rows});
}

struct log_list {
	struct acut *acut;
	Acut__V1__LogRequest req;
	const char *dataset;
	uint64_t last; /* handed out */
	const struct acut_log_sink *sink;
};

static int log_row(struct log_list *l, const Acut__V1__Log *log, const Acut__V1__Generation *g)
{
	const struct acut_generation row = {.number = g->number,
					    .time_us = g->time_us,
					    .uid = g->uid,
					    .user = g->user,
					    .kind = g->kind,
					    .undoes = g->undoes,
					    .files = g->files,
					    .files_removed = g->files_removed,
					    .points_added = g->points_added,
					    .points_removed = g->points_removed,
					    .content = g->content,
					    .readable = g->number >= log->oldest && g->number <= log->newest};
	int r = 0;

	l->sink->generation(l->sink->ctx, &row);
	if (l->sink->file)
		r = files_of(l->acut, l->dataset, g->number, l->sink);
	if (r == 0 && l->sink->end)
		l->sink->end(l->sink->ctx, &row);
	return r;
}

static bool log_next(void *ctx, const Acut__V1__Message *page)
{
	struct log_list *l = ctx;
	const Acut__V1__Log *log = page->log;

	if (log->n_generations)
		l->req.after = log->generations[log->n_generations - 1]->number;
	return log->more && log->n_generations;
}

static int log_rows(void *ctx, const Acut__V1__Message *page)
{
	struct log_list *l = ctx;
	int r = 0;

	for (size_t i = 0; i < page->log->n_generations && r == 0; i++) {
		const Acut__V1__Generation *g = page->log->generations[i];

		r = call_rises(l->acut, g->number > l->last, "generations");
		if (r == 0)
			r = log_row(l, page->log, g);
		l->last = g->number;
	}
	return r;
}

int acut_dataset_log(struct acut *a, const char *dataset, const struct acut_log_sink *sink)
{
	struct log_list l = {.acut = a, .req = ACUT__V1__LOG_REQUEST__INIT, .dataset = dataset, .sink = sink};
	int r = call_begin(a);

	l.req.dataset = call_text(dataset);
	l.req.limit = CALL_PAGE;
	if (r < 0)
		return r;
	return call_list(a, &(struct call_list){.req = FRAME_MESSAGE(LOG_REQUEST, log_request, &l.req),
						.want = ACUT__V1__MESSAGE__BODY_LOG,
						.asks = true,
						.ctx = &l,
						.next = log_next,
						.rows = log_rows});
}

/* ---- datasets ---- */

struct datasets_list {
	struct acut *acut;
	Acut__V1__DatasetsRequest req;
	const char *last; /* handed out: by name */
	uint64_t last_id; /* by number, those that were removed */
	void (*each)(void *ctx, const struct acut_dataset *);
	void *ctx;
};

static bool datasets_next(void *ctx, const Acut__V1__Message *page)
{
	struct datasets_list *l = ctx;
	const Acut__V1__Datasets *d = page->datasets;

	if (d->n_datasets && l->req.removed)
		l->req.after_id = d->datasets[d->n_datasets - 1]->id;
	else if (d->n_datasets)
		l->req.after = d->datasets[d->n_datasets - 1]->name;
	return d->more && d->n_datasets;
}

static int datasets_rows(void *ctx, const Acut__V1__Message *page)
{
	struct datasets_list *l = ctx;
	int r = 0;

	for (size_t i = 0; i < page->datasets->n_datasets && r == 0; i++) {
		struct acut_dataset d;

		call_dataset(page->datasets->datasets[i], &d);
		r = call_rises(l->acut, l->req.removed ? d.id > l->last_id : strcmp(d.name, l->last) > 0, "datasets");
		if (r == 0)
			l->each(l->ctx, &d);
		l->last = d.name;
		l->last_id = d.id;
	}
	return r;
}

static int datasets_list(struct datasets_list *l)
{
	l->last = "";
	l->req.limit = CALL_PAGE;
	return call_list(l->acut, &(struct call_list){.req = FRAME_MESSAGE(DATASETS_REQUEST, datasets_request, &l->req),
						      .want = ACUT__V1__MESSAGE__BODY_DATASETS,
						      .ctx = l,
						      .next = datasets_next,
						      .rows = datasets_rows});
}

int acut_datasets(struct acut *a, const char *name, void (*each)(void *ctx, const struct acut_dataset *), void *ctx)
{
	struct datasets_list l = {.acut = a, .req = ACUT__V1__DATASETS_REQUEST__INIT, .each = each, .ctx = ctx};
	int r = call_begin(a);

	l.req.name = call_text(name);
	return r < 0 ? r : datasets_list(&l);
}

int acut_datasets_removed(struct acut *a, void (*each)(void *ctx, const struct acut_dataset *), void *ctx)
{
	struct datasets_list l = {.acut = a, .req = ACUT__V1__DATASETS_REQUEST__INIT, .each = each, .ctx = ctx};
	int r = call_begin(a);

	l.req.removed = true;
	return r < 0 ? r : datasets_list(&l);
}

int acut_dataset_at(struct acut *a, const char *dataset, uint64_t generation, struct acut_dataset *ret)
{
	Acut__V1__DatasetsRequest req = ACUT__V1__DATASETS_REQUEST__INIT;
	int r;

	/* On the wire no name is all of them. */
	if (!dataset || !*dataset) {
		r = call_begin(a);
		return r < 0 ? r : err_set(&a->err, ERR_NOTFOUND, "there is no dataset \"\"");
	}
	req.name = call_text(dataset);
	req.generation = generation;
	req.system = true;
	r = call_ask(a, FRAME_MESSAGE(DATASETS_REQUEST, datasets_request, &req), -1, ACUT__V1__MESSAGE__BODY_DATASETS);
	if (r == 0 && a->answer->datasets->n_datasets != 1)
		r = err_set(&a->err, ERR_PROTO, "the daemon's answer has no dataset");
	if (r == 0)
		call_dataset(a->answer->datasets->datasets[0], ret);
	return r;
}

/* ---- changes ---- */

static int change(struct acut *a, Acut__V1__DatasetChange *req, const char *verb, const char *name, struct acut_dataset *ret)
{
	int r;

	req->verb = call_text(verb);
	req->name = call_text(name);
	r = call_ask(a, FRAME_MESSAGE(DATASET_CHANGE, dataset_change, req), -1, ACUT__V1__MESSAGE__BODY_DATASETS);
	if (r == 0 && a->answer->datasets->n_datasets != 1)
		r = err_set(&a->err, ERR_PROTO, "the daemon's answer has no dataset");
	if (r == 0)
		call_dataset(a->answer->datasets->datasets[0], ret);
	return r;
}

int acut_dataset_change(struct acut *a, const char *verb, const char *name, uint64_t id, const char *as, struct acut_dataset *ret)
{
	Acut__V1__DatasetChange req = ACUT__V1__DATASET_CHANGE__INIT;

	req.id = id;
	req.as = call_text(as);
	return change(a, &req, verb, name, ret);
}

int acut_dataset_chmod(struct acut *a, const char *name, const char *mode, struct acut_dataset *ret)
{
	Acut__V1__DatasetChange req = ACUT__V1__DATASET_CHANGE__INIT;

	req.mode = call_text(mode);
	return change(a, &req, "chmod", name, ret);
}

int acut_dataset_chgrp(struct acut *a, const char *name, uint32_t gid, struct acut_dataset *ret)
{
	Acut__V1__DatasetChange req = ACUT__V1__DATASET_CHANGE__INIT;

	req.gid = gid;
	return change(a, &req, "chgrp", name, ret);
}

int acut_dataset_chown(struct acut *a, const char *name, uint32_t uid, struct acut_dataset *ret)
{
	Acut__V1__DatasetChange req = ACUT__V1__DATASET_CHANGE__INIT;

	req.uid = uid;
	return change(a, &req, "chown", name, ret);
}

/* ---- the mode of new ones ---- */

int acut_dataset_mode(struct acut *a, const char *mode)
{
	int r = call_begin(a);

	if (r == 0 && strlen(mode) >= sizeof a->mode)
		return err_set(&a->err, ERR_USAGE, "\"%.60s...\" is not a mode", mode);
	if (r == 0 && *mode)
		r = call_needs(a, CALL_MODE);
	if (r == 0)
		strcpy(a->mode, mode);
	return r;
}

/* umask(2) would change it to read it, which other threads would see: /proc has it as well. */
char *call_mode(struct acut *a)
{
	char line[256];
	unsigned mask;
	FILE *f;

	if (*a->mode)
		return a->mode;
	f = fopen("/proc/self/status", "re");
	while (f && fgets(line, sizeof line, f))
		if (sscanf(line, "Umask: %o", &mask) == 1) {
			snprintf(a->umask_mode, sizeof a->umask_mode, "%04o", 0666 & ~mask);
			break;
		}
	if (f)
		fclose(f);
	return a->umask_mode;
}

int acut_dataset_revert(struct acut *a, const char *dataset, uint64_t generation, struct acut_reverted *ret)
{
	Acut__V1__Revert req = ACUT__V1__REVERT__INIT;
	const Acut__V1__Reverted *d;
	int r;

	req.dataset = call_text(dataset);
	req.generation = generation;
	r = call_ask(a, FRAME_MESSAGE(REVERT, revert, &req), -1, ACUT__V1__MESSAGE__BODY_REVERTED);
	if (r < 0)
		return r;
	d = a->answer->reverted;
	*ret = (struct acut_reverted){.generation = d->generation,
				      .undone = d->undone,
				      .points = d->points,
				      .files = d->files,
				      .files_removed = d->files_removed,
				      .points_added = d->points_added,
				      .points_removed = d->points_removed};
	return 0;
}

int acut_dataset_prune(struct acut *a, const char *dataset, uint64_t keep, uint64_t before, struct acut_pruned *ret)
{
	Acut__V1__Prune req = ACUT__V1__PRUNE__INIT;
	const Acut__V1__Pruned *d;
	int r;

	req.dataset = call_text(dataset);
	req.keep = keep;
	req.before = before;
	r = call_ask(a, FRAME_MESSAGE(PRUNE, prune, &req), -1, ACUT__V1__MESSAGE__BODY_PRUNED);
	if (r < 0)
		return r;
	d = a->answer->pruned;
	*ret = (struct acut_pruned){.oldest = d->oldest,
				    .generations = d->generations,
				    .files = d->files,
				    .points = d->points,
				    .bytes = d->bytes,
				    .segments = d->segments};
	return 0;
}

int acut_dataset_discard(struct acut *a, const char *dataset, int all, struct acut_discarded *ret)
{
	Acut__V1__Discard req = ACUT__V1__DISCARD__INIT;
	const Acut__V1__Discarded *d;
	int r;

	req.dataset = call_text(dataset);
	req.all = all;
	r = call_ask(a, FRAME_MESSAGE(DISCARD, discard, &req), -1, ACUT__V1__MESSAGE__BODY_DISCARDED);
	if (r < 0)
		return r;
	d = a->answer->discarded;
	*ret = (struct acut_discarded){
		.pushes = d->pushes, .files = d->files, .bytes = d->bytes, .open = d->open, .nopen = d->n_open};
	return 0;
}
