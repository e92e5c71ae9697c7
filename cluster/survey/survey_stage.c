/*
 * A stage: the points of a run of inputs become one segment.
 *
 * The model: the inputs are divided by their bytes, in the order of their numbers, so that a task has neighbours; what a task
 * gets depends on the head and the number of tasks alone. Points are sorted in the task's memory, and in runs beside it when they
 * are more. Each input is opened again, and must be the one that the head saw, before and after it is read. The result is a
 * segment and a manifest of it with the sources of this task: points, hash, lines left out.
 *
 * Not here: what inputs have in common (survey_head.c).
 */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "agree_reading.h"
#include "err.h"
#include "file_hash.h"
#include "grid_stage.h"
#include "io.h"
#include "pipe.h"
#include "survey_priv.h"

enum { WARNINGS_MOST = 100 /* that a record holds */ };

struct stage {
	struct survey *s;
	struct grid_source *source; /* of the head's manifest */
	size_t n;
	struct grid_stage *points;
	struct pipe_ingested sum; /* of the inputs that are read */
	uint64_t warnings;
	atomic_bool cancel;                /* nobody sets it */
	_Atomic uint64_t hashed, hash_end; /* nobody asks */
	char scratch[SURVEY_SCRATCH_NAME];
	int runs; /* the folder of the runs; 0: none of its own */
};

/* ---- which inputs ---- */

void survey_share(const struct grid_manifest *head, uint32_t task, uint32_t tasks, size_t *ret_first, size_t *ret_end)
{
	unsigned __int128 all = 0, at = 0;
	size_t first = head->nsources, end = head->nsources;

	for (size_t i = 0; i < head->nsources; i++)
		all += 2 * (head->sources[i].size + 1);
	for (size_t i = 0; i < head->nsources; i++) {
		uint64_t size = head->sources[i].size + 1, middle_of;

		middle_of = (uint64_t)((at + size) * tasks / all);
		at += 2 * (unsigned __int128)size;
		if (middle_of >= task && first == head->nsources)
			first = i;
		if (middle_of > task) {
			end = i;
			break;
		}
	}
	*ret_first = first < end ? first : end;
	*ret_end = end;
}

/* ---- memory ---- */

static uint64_t reading_bytes(uint64_t read_bytes)
{
	return pipe_ingest_bytes() + input_bytes() + read_bytes;
}

uint64_t survey_least_bytes(uint64_t inputs)
{
	return SURVEY_PROCESS_BYTES + inputs * SURVEY_SOURCE_BYTES + reading_bytes(0) + GRID_STAGE_MIN;
}

static int stage_memory(const struct survey *s, size_t *ret, struct err *err)
{
	uint64_t fixed = SURVEY_PROCESS_BYTES + reading_bytes(s->read_bytes) + s->head->nsources * sizeof *s->head->sources +
			 s->head->texts_bytes;

	if (survey_check_memory(s, fixed + GRID_STAGE_MIN, "staging", err))
		return -(int)err->code;
	*ret = work_about(s->work)->memory - fixed;
	return 0;
}

/* ---- one input ---- */

static int progress(void *work, uint64_t points)
{
	return work_interrupted(work);
}

static int warn(struct stage *st, const struct grid_source *source, const char *text, struct err *err)
{
	char key[32], line[GRID_SOURCE_PATH + 300];

	if (!*text)
		return 0;
	if (st->s->p->warned)
		st->s->p->warned(st->s->p->ctx, source->path, text);
	if (st->warnings++ >= WARNINGS_MOST)
		return 0;
	snprintf(key, sizeof key, "warning-%llu", (unsigned long long)st->warnings);
	snprintf(line, sizeof line, "%s: %s", source->path, text);
	return work_result(st->s->attempt, key, line, err);
}

/* The head recorded what the input says only if the dataset has another system. */
static bool was_degrees(const struct survey *s, const struct grid_source *source)
{
	struct agree_reading reading;

	agree_reading_parse(source->reading, &reading);
	return s->agree.projects && reading.has_system && !strcmp(reading.system.unit_xy, "degree");
}

static int ingest(struct stage *st, struct grid_source *source, struct input *in, struct pipe_ingested *ret, struct err *err)
{
	struct survey *s = st->s;
	struct pipe_ingest_params params = {
		.lattice = &s->agree.lattice, .stage = st->points, .progress = progress, .ctx = s->work};
	struct crs_info crs = input_info(in)->crs;
	char overridden[AGREE_OVERRIDDEN];
	struct agree_step step;
	int r = agree_say(&s->agree, source->path, &crs, overridden, err);

	if (!r)
		r = agree_step_of(&s->agree, source->path, &crs, &step, err);
	if (!r && step.projects != was_degrees(s, source))
		r = err_set(err, ERR_CHANGED, "it says now that it is in %.200s", crs.text);
	params.step = !r && step.needed ? &step.params : NULL;
	if (!r)
		r = grid_stage_source(st->points, source->id, err);
	if (!r)
		r = pipe_ingest(in, &params, ret, err);
	if (!r)
		r = file_hash_bounded(input_info(in), source->size, source->path, err);
	if (!r)
		pipe_ingested_compare(ret, input_info(in));
	return r;
}

static int read_open(struct stage *st, struct grid_source *source, int fd, struct pipe_ingested *ret, struct err *err)
{
	struct input_options options = survey_input_options(st->s, was_degrees(st->s, source));
	const struct file_hash_watch watch = {&st->cancel, &st->hashed, &st->hash_end};
	struct file_hashing hashing;
	struct input *in = NULL;
	int r;

	file_hash_begin(&hashing, &watch, fd, source->path);
	options.seen = file_hash_seen;
	options.seen_ctx = &hashing;
	r = input_open(fd, source->path, &options, &in, err);
	if (!r)
		r = ingest(st, source, in, ret, err);
	input_close(in);
	if (!r)
		r = file_hash_end(&hashing, source->size, &source->hash, err);
	file_hash_free(&hashing);
	return r;
}

static int read_one(struct stage *st, struct grid_source *source, struct err *err)
{
	struct pipe_ingested in = {0};
	int fd, r = survey_open(st->s, source->path, source->size, source->mtime_ns, &fd, err);

	if (r)
		return r;
	r = read_open(st, source, fd, &in, err);
	if (!r)
		r = survey_unchanged(fd, source->path, source->size, source->mtime_ns, "while it was read", err);
	io_close(fd);
	if (r)
		return err_add_file(err, source->path);
	source->points = in.points;
	source->left_out = in.left_out;
	r = warn(st, source, in.warning, err);
	*in.warning = 0;
	in.left_out += st->sum.left_out; /* pipe_ingested_add takes the larger one */
	pipe_ingested_add(&st->sum, &in);
	return r;
}

/* ---- all of them ---- */

static int make_scratch(struct stage *st, uint32_t task, struct err *err)
{
	const char *folder = st->s->p->scratch;
	int fd, r;

	if (!folder || !*folder)
		return 0;
	r = survey_scratch_make(st->s, task, st->scratch, &fd, err);
	if (!r)
		st->runs = fd;
	return r;
}

static void remove_scratch(struct stage *st)
{
	if (st->runs)
		io_close(st->runs);
	if (*st->scratch)
		survey_scratch_remove(st->scratch);
}

static int stage_all(struct stage *st, uint32_t task, struct grid_segment_info *ret, struct err *err)
{
	char file[WORK_NAME], stem[WORK_NAME];
	struct grid_stage_params params = {.segment_dirfd = work_fd(st->s->work), .name = stem};
	int r = stage_memory(st->s, &params.memory, err);

	if (!r)
		r = make_scratch(st, task, err);
	if (!r)
		r = work_attempt_file(st->s->attempt, "", "stage", ".seg", file, err);
	if (r)
		return r;
	snprintf(stem, sizeof stem, "%.*s", (int)(strlen(file) - strlen(".seg")), file);
	params.dirfd = st->runs ? st->runs : work_fd(st->s->work);
	r = grid_stage_new(&params, &st->points, err);
	for (size_t i = 0; !r && i < st->n; i++)
		r = read_one(st, &st->source[i], err);
	if (!r)
		r = grid_stage_seal(st->points, ret, err);
	st->points = grid_stage_free(st->points);
	return r ? r : work_result_file(st->s->attempt, file, err);
}

static int write_part(struct stage *st, struct grid_segment_info *segment, struct err *err)
{
	struct grid_manifest m = *st->s->head;
	char name[WORK_NAME];
	int r = work_attempt_file(st->s->attempt, "", "part", "", name, err);

	m.segments = segment;
	m.nsegments = 1;
	m.sources = st->source;
	m.nsources = st->n;
	if (!r)
		r = grid_manifest_write(work_fd(st->s->work), name, &m, err);
	return r ? r : work_result_file(st->s->attempt, name, err);
}

static int write_results(struct stage *st, struct err *err)
{
	const struct pipe_ingested *sum = &st->sum;
	const struct {
		const char *key;
		uint64_t value;
	} of[] = {{"inputs", st->n},           {"points", sum->points},         {"moved", sum->moved},
		  {"left_out", sum->left_out}, {"bytes_read", sum->bytes_read}, {"warnings", st->warnings}};
	char shift[128];
	int r = 0;

	for (size_t i = 0; !r && i < sizeof of / sizeof *of; i++)
		r = work_result_u64(st->s->attempt, of[i].key, of[i].value, err);
	snprintf(shift, sizeof shift, "%.17g %.17g %.17g", sum->max_shift[0], sum->max_shift[1], sum->max_shift[2]);
	return r ? r : work_result(st->s->attempt, "max_shift", shift, err);
}

static int run(struct survey *s, uint32_t task, struct err *err)
{
	struct stage st = {.s = s};
	struct grid_segment_info segment;
	size_t first, end;
	int r = survey_take_head(s, err);

	if (r)
		return r;
	survey_share(s->head, task, work_about(s->work)->tasks[WORK_STAGE], &first, &end);
	st.source = s->head->sources + first;
	st.n = end - first;
	if (st.n) {
		r = stage_all(&st, task, &segment, err);
		remove_scratch(&st);
		if (!r)
			r = write_part(&st, &segment, err);
		if (!r && segment.points && work_about(s->work)->tasks[WORK_SORT])
			r = survey_note_keys(s, &segment, err);
	}
	return r ? r : write_results(&st, err);
}

int survey_stage(struct work *w, uint32_t task, const struct survey_params *p, struct err *err)
{
	return survey_run(w, WORK_STAGE, task, p, run, err);
}
