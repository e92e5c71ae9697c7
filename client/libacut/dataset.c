/*
 * The generations of a dataset, and what changes a dataset as a whole. Lists come in pages, whose keys must rise.
 */
#include "call.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { PAGE = 64 };

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
	};
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

static int files_of(struct acut *a, const char *dataset, uint64_t generation, const struct acut_log_sink *sink)
{
	Acut__V1__FilesRequest question = ACUT__V1__FILES_REQUEST__INIT;
	Acut__V1__Message *page;
	char path[PATH_BYTES];
	bool more = true;
	uint32_t id;
	int r = 0;

	question.dataset = call_text(dataset);
	question.generation = generation;
	question.limit = PAGE;
	while (r == 0 && more) {
		r = call_again(a, FRAME_MESSAGE(FILES_REQUEST, files_request, &question), -1,
			       ACUT__V1__MESSAGE__BODY_FILES, &id, &page);
		if (r < 0)
			break;
		more = page->files->more && page->files->n_files > 0;
		for (size_t i = 0; i < page->files->n_files && r == 0; i++) {
			const Acut__V1__DatasetFile *f = page->files->files[i];
			const struct acut_log_file file = {.name = f->name,
							   .path = path_text(&f->path, path),
							   .hash = f->hash,
							   .points = f->points,
							   .size = f->size,
							   .source = f->source,
							   .removed = f->removed};

			if (f->source <= question.after)
				r = err_set(&a->err, ERR_PROTO, "the daemon's list of files does not rise");
			else
				sink->file(sink->ctx, &file);
			question.after = f->source;
		}
		frame_message_free(page);
	}
	return r;
}

static int log_row(struct acut *a, const char *dataset, const Acut__V1__Log *log, const Acut__V1__Generation *g,
		   const struct acut_log_sink *sink)
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

	sink->generation(sink->ctx, &row);
	if (sink->file)
		r = files_of(a, dataset, g->number, sink);
	if (r == 0 && sink->end)
		sink->end(sink->ctx, &row);
	return r;
}

int acut_dataset_log(struct acut *a, const char *dataset, const struct acut_log_sink *sink)
{
	Acut__V1__LogRequest question = ACUT__V1__LOG_REQUEST__INIT;
	Acut__V1__Message *page;
	bool more = true;
	uint32_t id;
	int r = call_begin(a);

	question.dataset = call_text(dataset);
	question.limit = PAGE;
	while (r == 0 && more) {
		r = call_again(a, FRAME_MESSAGE(LOG_REQUEST, log_request, &question), -1, ACUT__V1__MESSAGE__BODY_LOG,
			       &id, &page);
		if (r < 0)
			break;
		more = page->log->more && page->log->n_generations > 0;
		for (size_t i = 0; i < page->log->n_generations && r == 0; i++) {
			const Acut__V1__Generation *g = page->log->generations[i];

			if (g->number <= question.after)
				r = err_set(&a->err, ERR_PROTO, "the daemon's list of generations does not rise");
			else
				r = log_row(a, dataset, page->log, g, sink);
			question.after = g->number;
		}
		frame_message_free(page);
	}
	return r;
}

int acut_dataset_at(struct acut *a, const char *dataset, uint64_t generation, struct acut_dataset *ret)
{
	Acut__V1__DatasetsRequest question = ACUT__V1__DATASETS_REQUEST__INIT;
	int r;

	question.name = call_text(dataset);
	question.generation = generation;
	r = call_ask(a, FRAME_MESSAGE(DATASETS_REQUEST, datasets_request, &question), -1,
		     ACUT__V1__MESSAGE__BODY_DATASETS);
	if (r == 0 && a->answer->datasets->n_datasets != 1)
		r = err_set(&a->err, ERR_PROTO, "the daemon did not say what the dataset is");
	if (r == 0)
		call_dataset(a->answer->datasets->datasets[0], ret);
	return r;
}

/* ---- changes ---- */

static int change(struct acut *a, Acut__V1__DatasetChange *question, const char *verb, const char *name,
		  struct acut_dataset *ret)
{
	int r;

	question->verb = call_text(verb);
	question->name = call_text(name);
	r = call_ask(a, FRAME_MESSAGE(DATASET_CHANGE, dataset_change, question), -1, ACUT__V1__MESSAGE__BODY_DATASETS);
	if (r == 0 && a->answer->datasets->n_datasets != 1)
		r = err_set(&a->err, ERR_PROTO, "the daemon did not say what the dataset is");
	if (r == 0)
		call_dataset(a->answer->datasets->datasets[0], ret);
	return r;
}

int acut_dataset_change(struct acut *a, const char *verb, const char *name, uint64_t id, const char *as,
			struct acut_dataset *ret)
{
	Acut__V1__DatasetChange question = ACUT__V1__DATASET_CHANGE__INIT;

	question.id = id;
	question.as = call_text(as);
	return change(a, &question, verb, name, ret);
}

int acut_dataset_chmod(struct acut *a, const char *name, const char *mode, struct acut_dataset *ret)
{
	Acut__V1__DatasetChange question = ACUT__V1__DATASET_CHANGE__INIT;

	question.mode = call_text(mode);
	return change(a, &question, "chmod", name, ret);
}

int acut_dataset_chgrp(struct acut *a, const char *name, uint32_t gid, struct acut_dataset *ret)
{
	Acut__V1__DatasetChange question = ACUT__V1__DATASET_CHANGE__INIT;

	question.gid = gid;
	return change(a, &question, "chgrp", name, ret);
}

int acut_dataset_chown(struct acut *a, const char *name, uint32_t uid, struct acut_dataset *ret)
{
	Acut__V1__DatasetChange question = ACUT__V1__DATASET_CHANGE__INIT;

	question.uid = uid;
	return change(a, &question, "chown", name, ret);
}

/* ---- the mode of new ones ---- */

int acut_dataset_mode(struct acut *a, const char *mode)
{
	int r = call_begin(a);

	if (r == 0 && strlen(mode) >= sizeof a->mode)
		return err_set(&a->err, ERR_USAGE, "\"%.60s...\" is not a mode", mode);
	if (r == 0)
		strcpy(a->mode, mode);
	return r;
}

/* umask(2) tells it by changing it, which other threads would feel: the kernel's text says it as well. */
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

int acut_datasets_removed(struct acut *a, void (*each)(void *ctx, const struct acut_dataset *), void *ctx)
{
	Acut__V1__DatasetsRequest question = ACUT__V1__DATASETS_REQUEST__INIT;
	Acut__V1__Message *page;
	bool more = true;
	uint32_t id;
	int r = call_begin(a);

	question.removed = true;
	question.limit = PAGE;
	while (r == 0 && more) {
		r = call_again(a, FRAME_MESSAGE(DATASETS_REQUEST, datasets_request, &question), -1,
			       ACUT__V1__MESSAGE__BODY_DATASETS, &id, &page);
		if (r < 0)
			break;
		more = page->datasets->more && page->datasets->n_datasets > 0;
		for (size_t i = 0; i < page->datasets->n_datasets && r == 0; i++) {
			struct acut_dataset dataset;

			call_dataset(page->datasets->datasets[i], &dataset);
			if (dataset.id <= question.after_id)
				r = err_set(&a->err, ERR_PROTO, "the daemon's list of datasets does not rise");
			else
				each(ctx, &dataset);
			question.after_id = dataset.id;
		}
		frame_message_free(page);
	}
	return r;
}

int acut_dataset_revert(struct acut *a, const char *dataset, uint64_t generation, struct acut_reverted *ret)
{
	Acut__V1__Revert question = ACUT__V1__REVERT__INIT;
	const Acut__V1__Reverted *d;
	int r;

	question.dataset = call_text(dataset);
	question.generation = generation;
	r = call_ask(a, FRAME_MESSAGE(REVERT, revert, &question), -1, ACUT__V1__MESSAGE__BODY_REVERTED);
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
	Acut__V1__Prune question = ACUT__V1__PRUNE__INIT;
	const Acut__V1__Pruned *d;
	int r;

	question.dataset = call_text(dataset);
	question.keep = keep;
	question.before = before;
	r = call_ask(a, FRAME_MESSAGE(PRUNE, prune, &question), -1, ACUT__V1__MESSAGE__BODY_PRUNED);
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
