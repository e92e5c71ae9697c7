/*
 * Sorting: the records of a range of keys, from the segments of all stages, become one segment.
 *
 * The model: each stage has told the keys that divide its segment into parts of about equal numbers of records. All of these
 * together, each with the records of its part, give the keys that divide the whole; every sort task computes them from the same
 * records, and takes its range. A segment without records in the range is not opened. Sources stay what they are. More segments
 * than one rewrite takes are rewritten in groups first.
 *
 * It pays only where a place lies in many segments, as with flight lines.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_rewrite.h"
#include "io.h"
#include "parse.h"
#include "survey_priv.h"

struct weight {
	uint64_t key, records;
};

struct sort {
	struct survey *s;
	struct grid_segment_info *segment; /* of all stages */
	size_t nsegments, sources;         /* sources: the most that one has */
	struct weight *weight;
	size_t nweights;
	uint64_t records;
};

/* ---- the keys of a stage ---- */

int survey_note_keys(struct survey *s, const struct grid_segment_info *segment, struct err *err)
{
	uint64_t key[SURVEY_PARTS - 1];
	char text[SURVEY_PARTS * 17] = "";
	int r = grid_segment_divide(work_fd(s->work), segment, SURVEY_PARTS, key, err);

	for (unsigned i = 0; !r && i < SURVEY_PARTS - 1; i++)
		snprintf(text + strlen(text), sizeof text - strlen(text), "%s%" PRIx64, i ? " " : "", key[i]);
	return r ? r : work_result(s->attempt, "keys", text, err);
}

static int take_keys(struct sort *so, const struct grid_segment_info *segment, const char *text, struct err *err)
{
	uint64_t key = segment->lo;

	for (unsigned i = 0; i < SURVEY_PARTS; i++) {
		char *end;

		so->weight[so->nweights++] =
			(struct weight){key, segment->points * (i + 1) / SURVEY_PARTS - segment->points * i / SURVEY_PARTS};
		if (i == SURVEY_PARTS - 1)
			break;
		key = strtoull(text, &end, 16);
		if (end == text || (*end && *end != ' '))
			return err_set(err, ERR_CORRUPT, "the keys in the record of a stage are none");
		text = end;
	}
	so->records += segment->points;
	return 0;
}

static int take_stage(struct sort *so, uint32_t task, struct err *err)
{
	struct work_record *record = NULL;
	struct grid_manifest *part = NULL;
	const char *keys;
	int r = work_record_need(so->s->work, WORK_STAGE, task, &record, err);

	if (!r && record->nfile)
		r = survey_read_part(so->s, record, 1, &part, err);
	if (!r && part && part->nsegments == 1 && part->segments[0].points) {
		so->segment[so->nsegments++] = part->segments[0];
		so->sources = part->nsources > so->sources ? part->nsources : so->sources;
		keys = work_record_text(record, "keys");
		r = take_keys(so, &part->segments[0], keys ? keys : "", err);
	}
	grid_manifest_free(part);
	work_record_free(record);
	return r;
}

static int by_key(const void *a, const void *b)
{
	const struct weight *x = a, *y = b;

	return x->key < y->key ? -1 : x->key > y->key;
}

/* The first key of a range. */
static uint64_t border(const struct sort *so, uint32_t task, uint32_t tasks)
{
	uint64_t before = 0;

	if (!task)
		return 0;
	for (size_t i = 0; i < so->nweights; i++) {
		if ((unsigned __int128)before * tasks >= (unsigned __int128)so->records * task)
			return so->weight[i].key;
		before += so->weight[i].records;
	}
	return UINT64_MAX;
}

/* ---- the range ---- */

static void only_meeting(struct sort *so, uint64_t lo, uint64_t hi)
{
	size_t n = 0;

	for (size_t i = 0; i < so->nsegments; i++)
		if (so->segment[i].lo <= hi && so->segment[i].hi >= lo)
			so->segment[n++] = so->segment[i];
	so->nsegments = n;
}

static int rewrite_memory(const struct sort *so, size_t *ret, struct err *err)
{
	uint64_t fixed = SURVEY_PROCESS_BYTES + so->nweights * sizeof *so->weight +
			 work_about(so->s->work)->tasks[WORK_STAGE] * sizeof *so->segment;

	if (survey_check_memory(so->s,
				fixed + grid_rewrite_min_bytes(so->segment, so->nsegments < 2 ? so->nsegments : 2, so->sources),
				"sorting", err))
		return -(int)err->code;
	*ret = work_about(so->s->work)->memory - fixed;
	return 0;
}

static int step_all(struct sort *so, struct grid_rewrite *w, struct err *err)
{
	int r = 0;

	while (!r) {
		r = grid_rewrite_step(w, err);
		if (!r)
			r = work_check_interrupt(so->s->work, err);
	}
	return r < 0 ? r : 0;
}

/* Waits until all of them are seen. */
static int await_segments(struct sort *so, struct err *err)
{
	int fd, r = 0;

	for (size_t i = 0; !r && i < so->nsegments; i++) {
		r = work_file_open(so->s->work, so->segment[i].file, so->segment[i].bytes, &fd, err);
		if (!r)
			io_close(fd);
	}
	return r;
}

/* Rewrites some segments, whose sources are so many at most, as one: KIND-TASK-ATTEMPT.seg. */
static int rewrite(struct sort *so, struct grid_rewrite_params *params, const char *kind, struct grid_segment_info *ret,
		   struct err *err)
{
	char file[WORK_NAME], stem[WORK_NAME];
	struct grid_rewrite *w;
	int r = work_attempt_file(so->s->attempt, "", kind, ".seg", file, err);

	if (r)
		return r;
	snprintf(stem, sizeof stem, "%.*s", (int)(strlen(file) - strlen(".seg")), file);
	params->name = stem;
	r = grid_rewrite_new(params, &w, err);
	if (r == -ERR_LIMIT)
		err_add_hint(err, "give tasks more memory (--task-memory)");
	if (r)
		return r;
	r = step_all(so, w, err);
	if (!r)
		return grid_rewrite_finish(w, ret, err);
	grid_rewrite_free(w);
	return r;
}

/* How many segments from `first` on can be rewritten at once, of those that the memory has room for. */
static size_t count_group(const struct sort *so, size_t first, size_t memory)
{
	size_t n = 1;

	while (n < GRID_REWRITE_MOST && first + n < so->nsegments &&
	       grid_rewrite_min_bytes(so->segment + first, n + 1, so->sources) <= memory)
		n++;
	return n;
}

/*
 * Too many segments for one rewrite: groups of them become one segment each, of the range alone, and these take their place. An
 * attempt has so many files; with them, and 512 segments a group, tens of thousands of segments can meet one range.
 */
static int rewrite_groups(struct sort *so, const struct grid_rewrite_params *how, struct err *err)
{
	enum { MOST = WORK_FILES - 4 };
	size_t n = 0, most = 1, sources = so->sources;
	int r = 0;

	for (size_t at = 0, group; !r && at < so->nsegments; at += group) {
		struct grid_rewrite_params params = *how;
		struct grid_segment_info made;
		char kind[16];

		group = count_group(so, at, how->memory);
		most = group > most ? group : most;
		if (n == MOST) {
			err_set(err, ERR_LIMIT, "%zu segments meet in one range, more than a task can sort", so->nsegments);
			return err_add_hint(err, "make fewer tasks with --task-seconds or --task-points, with more memory");
		}
		params.segments = so->segment + at;
		params.nsegments = group;
		params.temporary = true;
		snprintf(kind, sizeof kind, "group%c%c", (int)('a' + n / 26), (int)('a' + n % 26));
		r = rewrite(so, &params, kind, &made, err);
		if (!r)
			so->segment[n++] = made;
	}
	so->nsegments = n;
	so->sources = sources * most;
	return r;
}

static void remove_groups(const struct sort *so)
{
	for (size_t i = 0; i < so->nsegments; i++)
		io->unlinkat(work_fd(so->s->work), so->segment[i].file, 0);
}

static int rewrite_range(struct sort *so, uint64_t lo, uint64_t hi, struct grid_segment_info *ret, struct err *err)
{
	struct grid_rewrite_params params = {.dirfd = work_fd(so->s->work), .part = true, .lo = lo, .hi = hi};
	bool grouped = false;
	int r = rewrite_memory(so, &params.memory, err);

	if (!r)
		r = await_segments(so, err);
	params.nsources = so->sources;
	if (!r && count_group(so, 0, params.memory) < so->nsegments) {
		grouped = true;
		r = rewrite_groups(so, &params, err);
	}
	if (r)
		return r;
	params.segments = so->segment;
	params.nsegments = so->nsegments;
	params.nsources = so->sources;
	r = rewrite(so, &params, "sort", ret, err);
	if (grouped)
		remove_groups(so);
	if (!r)
		r = work_result_u64(so->s->attempt, "groups", grouped ? so->nsegments : 0, err);
	return r ? r : work_result_file(so->s->attempt, ret->file, err);
}

static int write_part(struct sort *so, struct grid_segment_info *segment, struct err *err)
{
	struct grid_manifest m = {.lattice = so->s->head->lattice, .segments = segment, .nsegments = 1, .generation = 1};
	char name[WORK_NAME];
	int r = work_attempt_file(so->s->attempt, "", "range", "", name, err);

	if (!r)
		r = grid_manifest_write(work_fd(so->s->work), name, &m, err);
	return r ? r : work_result_file(so->s->attempt, name, err);
}

static int sort_range(struct sort *so, uint32_t task, struct err *err)
{
	uint32_t tasks = work_about(so->s->work)->tasks[WORK_SORT];
	struct grid_segment_info segment = {.points = 0};
	uint64_t lo, end;
	int r = 0;

	qsort(so->weight, so->nweights, sizeof *so->weight, by_key);
	lo = border(so, task, tasks);
	end = task + 1 < tasks ? border(so, task + 1, tasks) : UINT64_MAX;
	only_meeting(so, lo, end);
	if (so->nsegments && (lo < end || task + 1 == tasks)) {
		r = rewrite_range(so, lo, task + 1 < tasks ? end - 1 : UINT64_MAX, &segment, err);
		if (!r)
			r = write_part(so, &segment, err);
	}
	return r ? r : work_result_u64(so->s->attempt, "points", segment.points, err);
}

static int run(struct survey *s, uint32_t task, struct err *err)
{
	const uint32_t stages = work_about(s->work)->tasks[WORK_STAGE];
	struct sort so = {.s = s};
	int r = survey_take_head(s, err);

	so.segment = calloc((size_t)stages + 1, sizeof *so.segment);
	so.weight = calloc((size_t)stages * SURVEY_PARTS + 1, sizeof *so.weight);
	if (!r && (!so.segment || !so.weight))
		r = err_set(err, ERR_NOMEM, "no memory for a list of segments");
	for (uint32_t i = 0; !r && i < stages; i++)
		r = take_stage(&so, i, err);
	if (!r)
		r = sort_range(&so, task, err);
	free(so.segment);
	free(so.weight);
	return r;
}

int survey_sort(struct work *w, uint32_t task, const struct survey_params *p, struct err *err)
{
	return survey_run(w, WORK_SORT, task, p, run, err);
}
