/*
 * How many tasks each phase has. It is known before a file is opened, from sizes and names alone, and fixed for the run: so it is
 * an estimate. A task with nothing to do is done at once.
 *
 * Bytes a point, and seconds of a core a point, are those of measured runs, with a reserve of a half.
 */
#include <math.h>
#include <strings.h>
#include <string.h>

#include "cluster.h"
#include "gather.h"
#include "mesh_phase.h"
#include "parse.h"
#include "survey.h"

enum { TASKS_MOST = 1000000 };
static const double RESERVE = 1.5, TASK_S = 120;
static const uint64_t MEMORY = UINT64_C(1) << 30, LEAST = UINT64_C(64) << 20, OF_PROCESS = UINT64_C(64) << 20;
/* Seconds of a core a point. */
static const double STAGE_S = 0.30e-6, SORT_S = 0.12e-6, MESH_S = 0.26e-6, GATHER_S = 0.20e-6, PLAN_S = 0.001e-6;
/* Of the head a point of a file that is read to its end, as texts are, and an input of any kind; of other phases of one task a
 * record that is read, and a segment that is planned (bench/results/2026-11-26-ranges.txt). */
static const double HEAD_S = 0.15e-6, INPUT_S = 40e-6, RECORD_S = 35e-6, SEGMENT_S = 50e-6;
/* Slurm ends a task after that. An input or a record is waited for, too: on a shared file system for milliseconds. */
static const double HOUR_S = 3600, OF_TASK = 10, OF_EXPECTED = 3, WAIT_S = 2e-3;

static const struct {
	const char *end;
	double bytes; /* a point */
	bool header;  /* which the head reads alone */
} kinds[] = {{".laz", 6.5, true}, {".las", 28, true}, {".ptx", 30, false}};
static const double OTHER = 25;

static double points_of(const struct work_input *in, bool *ret_header)
{
	const size_t n = strlen(in->path);
	double bytes = OTHER;

	*ret_header = false;

	for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
		const size_t k = strlen(kinds[i].end);

		if (n >= k && !strcasecmp(in->path + n - k, kinds[i].end)) {
			bytes = kinds[i].bytes;
			*ret_header = kinds[i].header;
		}
	}
	return (double)in->size / bytes;
}

static uint32_t tasks_of(const struct program *p, double points, double seconds_a_point, double most)
{
	const double task = p->opt.task_seconds > 0 ? p->opt.task_seconds : TASK_S;
	double n = p->opt.task_points ? points / (double)p->opt.task_points : points * seconds_a_point * RESERVE / task;

	n = fmin(ceil(n), fmin(most, TASKS_MOST));
	return n < 1 ? 1 : (uint32_t)n;
}

static uint64_t larger(uint64_t a, uint64_t b)
{
	return a > b ? a : b;
}

/* Less than the smallest task needs is refused. */
static int set_memory(const struct program *p, bool stage, struct cluster_size *s, struct err *err)
{
	const uint64_t given = p->opt.task_memory ? p->opt.task_memory : MEMORY;
	uint64_t least = larger(survey_least_bytes(s->inputs), LEAST);
	char text[32];

	if (!stage)
		least = larger(least, mesh_phase_least_bytes());
	if (given < least) {
		err_set(err, ERR_LIMIT, "a task needs at least %s for %llu inputs", parse_size_text(least, text),
			(unsigned long long)s->inputs);
		err->need = least;
		return err_add_hint(err, "give --task-memory %lluM or more", (unsigned long long)((least + (1 << 20) - 1) >> 20));
	}
	/* What is not of the task's own accounts: the program, its stacks and buffers of the C library. */
	for (int i = 0; i < WORK_PHASES; i++)
		s->memory[i] = given + OF_PROCESS;
	s->memory[WORK_HEAD] = larger(s->memory[WORK_HEAD], survey_head_bytes(s->inputs) + OF_PROCESS);
	s->memory[WORK_COMMIT] = s->memory[WORK_HEAD]; /* it holds the same manifest, and those of stages */
	return 0;
}

struct points {
	double all, read, largest; /* of them, what the head reads; of one input */
};

static struct points count(const struct work_input *input, size_t n, struct cluster_size *s)
{
	struct points p = {0};

	for (size_t i = 0; i < n; i++) {
		bool header;
		const double points = points_of(&input[i], &header);

		s->bytes += input[i].size;
		p.all += points;
		p.read += header ? 0 : points;
		p.largest = fmax(p.largest, points);
	}
	s->points = (uint64_t)p.all;
	return p;
}

static void set_hours(const struct points *p, struct cluster_size *s)
{
	const double records = (double)s->tasks[WORK_STAGE] + s->tasks[WORK_SORT];
	const double parts = (double)s->tasks[WORK_MESH] + s->tasks[WORK_GATHER];
	const double seconds[WORK_PHASES] = {
		[WORK_HEAD] = p->read * HEAD_S + (double)s->inputs * INPUT_S,
		[WORK_STAGE] = p->all * STAGE_S,
		[WORK_SORT] = p->all * SORT_S,
		[WORK_COMMIT] = (double)s->inputs * INPUT_S + records * RECORD_S,
		[WORK_PLAN] = p->all * PLAN_S + records * SEGMENT_S,
		[WORK_MESH] = p->all * MESH_S,
		[WORK_SUM] = (double)s->tasks[WORK_MESH] * RECORD_S,
		[WORK_GATHER] = p->all * GATHER_S,
		[WORK_FINISH] = parts * RECORD_S,
	};

	for (int i = 0; i < WORK_PHASES; i++) {
		s->hours[i] = s->tasks[i] ? seconds[i] * RESERVE / 3600 : 0;
		s->core_hours += s->hours[i];
	}
}

/* A phase of one task, and a stage with a large input, may take longer than the tasks that --task-seconds makes. */
static void set_times(const struct program *p, const struct points *points, struct cluster_size *s)
{
	const double least = fmax(HOUR_S, OF_TASK * p->opt.task_seconds);
	const double waits = (double)s->tasks[WORK_STAGE] + s->tasks[WORK_SORT] + s->tasks[WORK_MESH] + s->tasks[WORK_GATHER];

	for (int i = 0; i < WORK_PHASES; i++) {
		double expected = s->tasks[i] ? s->hours[i] * 3600 / s->tasks[i] : 0;

		if (i == WORK_STAGE)
			expected += points->largest * STAGE_S * RESERVE;
		else if (i != WORK_MESH && i != WORK_GATHER)
			expected += ((double)s->inputs + waits) * WAIT_S;
		s->time[i] = p->opt.time > 0 ? p->opt.time : ceil(fmax(least, OF_EXPECTED * expected));
	}
}

int cluster_size_of(const struct program *p, bool stage, const struct work_input *input, size_t n, struct cluster_size *ret,
		    struct err *err)
{
	struct cluster_size s = {.inputs = n};
	const struct points points = count(input, n, &s);

	s.tasks[WORK_HEAD] = s.tasks[WORK_COMMIT] = 1;
	s.tasks[WORK_STAGE] = tasks_of(p, points.all, STAGE_S, (double)(n ? n : 1));
	s.tasks[WORK_SORT] = p->opt.sort ? tasks_of(p, points.all, SORT_S, TASKS_MOST) : 0;
	if (!stage) {
		s.tasks[WORK_PLAN] = s.tasks[WORK_SUM] = s.tasks[WORK_FINISH] = 1;
		s.tasks[WORK_MESH] = tasks_of(p, points.all, MESH_S, TASKS_MOST);
		s.tasks[WORK_GATHER] = gather_divides(&p->fetch) ? tasks_of(p, points.all, GATHER_S, TASKS_MOST) : 1;
	}
	set_hours(&points, &s);
	set_times(p, &points, &s);
	if (set_memory(p, stage, &s, err))
		return -(int)err->code;
	*ret = s;
	return 0;
}
