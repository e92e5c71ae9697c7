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
static const double STAGE_S = 0.30e-6, SORT_S = 0.12e-6, MESH_S = 0.26e-6, GATHER_S = 0.20e-6;

static const struct {
	const char *end;
	double bytes; /* a point */
} kinds[] = {{".laz", 6.5}, {".las", 28}, {".ptx", 30}};
static const double OTHER = 25;

static uint64_t points_of(const struct work_input *in)
{
	const size_t n = strlen(in->path);
	double bytes = OTHER;

	for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
		const size_t k = strlen(kinds[i].end);

		if (n >= k && !strcasecmp(in->path + n - k, kinds[i].end))
			bytes = kinds[i].bytes;
	}
	return (uint64_t)((double)in->size / bytes);
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
	return 0;
}

int cluster_size_of(const struct program *p, bool stage, const struct work_input *input, size_t n, struct cluster_size *ret,
		    struct err *err)
{
	struct cluster_size s = {.inputs = n};
	double points;

	for (size_t i = 0; i < n; i++) {
		s.bytes += input[i].size;
		s.points += points_of(&input[i]);
	}
	points = (double)s.points;
	s.tasks[WORK_HEAD] = s.tasks[WORK_COMMIT] = 1;
	s.tasks[WORK_STAGE] = tasks_of(p, points, STAGE_S, (double)(n ? n : 1));
	s.tasks[WORK_SORT] = p->opt.sort ? tasks_of(p, points, SORT_S, TASKS_MOST) : 0;
	s.hours[WORK_STAGE] = points * STAGE_S * RESERVE / 3600;
	s.hours[WORK_SORT] = p->opt.sort ? points * SORT_S * RESERVE / 3600 : 0;
	if (!stage) {
		s.tasks[WORK_PLAN] = s.tasks[WORK_FINISH] = 1;
		s.tasks[WORK_MESH] = tasks_of(p, points, MESH_S, TASKS_MOST);
		s.tasks[WORK_GATHER] = gather_divides(&p->fetch) ? tasks_of(p, points, GATHER_S, TASKS_MOST) : 1;
		s.hours[WORK_MESH] = points * MESH_S * RESERVE / 3600;
		s.hours[WORK_GATHER] = points * GATHER_S * RESERVE / 3600;
	}
	for (int i = 0; i < WORK_PHASES; i++)
		s.core_hours += s.hours[i];
	if (set_memory(p, stage, &s, err))
		return -(int)err->code;
	*ret = s;
	return 0;
}
