/* What a task of each phase is: the words of the run as parameters of the rooms that do the work. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cluster.h"
#include "gather.h"
#include "mesh_phase.h"
#include "survey.h"

struct task {
	struct program *program; /* of this process */
	struct program own;      /* of the command that began the run */
	struct work *work;
	uint32_t index;
	struct survey_params survey;
	struct ctl_assume assume;
	char scale[CTL_SCALE_SIZE];
};

static void refused(void *ctx, const struct err *why)
{
	struct task *t = ctx;

	console_error(&t->program->session.console, why);
}

static void warned(void *ctx, const char *path, const char *text)
{
	struct task *t = ctx;

	console_warn(&t->program->session.console, "%s: %s", path, text);
}

/* Files that options name are read by each task: `assume` has their text. */
static int survey_of(struct task *t, struct err *err)
{
	const struct ctl_stage_options *s = &t->own.stage;
	struct survey_params *p = &t->survey;
	const struct ctl_input_format *format;
	const char **to;
	int r = ctl_assume_read(s, &t->assume, err);

	if (r)
		return r;
	to = t->assume.overrides ? p->says.override : p->says.assume;
	to[0] = t->assume.crs;
	to[1] = t->assume.unit_xy[0] ? t->assume.unit_xy : NULL;
	to[2] = t->assume.unit_z[0] ? t->assume.unit_z : NULL;
	if (s->scale) {
		r = ctl_stage_scale(s->scale, t->scale, &p->says.scale_z, err);
		p->says.scale_xy = t->scale;
	}
	p->says.utm = s->utm;
	p->says.geoid = s->geoid;
	p->says.geoid_way = s->geoid_way;
	p->says.planar = s->planar;
	format = t->own.input.format ? ctl_input_format_of(t->own.input.format) : NULL;
	p->format = format ? format->name : NULL; /* laz is read as las */
	p->columns = t->own.input.columns;
	p->decimal_comma = t->own.input.decimal_comma;
	p->accept_truncated = t->own.input.accept_truncated;
	p->strict = s->strict;
	p->grows = !work_about(t->work)->tasks[WORK_PLAN];
	p->scratch = t->own.opt.scratch;
	p->refused = refused;
	p->warned = warned;
	p->ctx = t;
	return r;
}

static int run_head(struct task *t, struct err *err)
{
	return survey_head(t->work, &t->survey, err);
}

static int run_stage(struct task *t, struct err *err)
{
	return survey_stage(t->work, t->index, &t->survey, err);
}

static int run_sort(struct task *t, struct err *err)
{
	return survey_sort(t->work, t->index, &t->survey, err);
}

static int run_commit(struct task *t, struct err *err)
{
	return survey_commit(t->work, &t->survey, err);
}

static int with_view(struct task *t, int (*run)(struct task *, const struct mesh_phase_params *, struct err *), struct err *err)
{
	struct mesh_phase_params p = {.memory = work_about(t->work)->memory};
	char *view;
	int r = ctl_view_text(&t->own.view, &view, err);

	if (r)
		return r;
	p.view = view;
	r = run(t, &p, err);
	free(view);
	return r;
}

static int plan(struct task *t, const struct mesh_phase_params *p, struct err *err)
{
	return mesh_phase_plan(t->work, p, err);
}

static int mesh(struct task *t, const struct mesh_phase_params *p, struct err *err)
{
	return mesh_phase_mesh(t->work, t->index, p, err);
}

static int run_plan(struct task *t, struct err *err)
{
	return with_view(t, plan, err);
}

static int run_mesh(struct task *t, struct err *err)
{
	return with_view(t, mesh, err);
}

static struct gather_params gather_of(struct task *t)
{
	return (struct gather_params){
		.work = t->work, .outputs = &t->own.fetch, .scratch = t->own.opt.scratch, .memory = work_about(t->work)->memory};
}

static int run_sum(struct task *t, struct err *err)
{
	const struct gather_params p = gather_of(t);

	return gather_sum(&p, err);
}

static int run_gather(struct task *t, struct err *err)
{
	const struct gather_params p = gather_of(t);

	return gather_task(&p, t->index, err);
}

static int run_finish(struct task *t, struct err *err)
{
	const struct gather_params p = gather_of(t);

	return gather_finish(&p, err);
}

static int (*const runs[WORK_PHASES])(struct task *, struct err *) = {
	[WORK_HEAD] = run_head,     [WORK_STAGE] = run_stage,   [WORK_SORT] = run_sort,
	[WORK_COMMIT] = run_commit, [WORK_PLAN] = run_plan,     [WORK_MESH] = run_mesh,
	[WORK_SUM] = run_sum,       [WORK_GATHER] = run_gather, [WORK_FINISH] = run_finish,
};

int task_run(struct program *p, struct work *w, enum work_phase phase, uint32_t index, struct err *err)
{
	const struct work_about *about = work_about(w);
	struct task t = {.program = p, .work = w, .index = index};
	int r = 0;

	t.own.session.console = p->session.console;
	work_set_interrupt(w, session_interrupted, &p->session);
	if (index >= about->tasks[phase])
		return err_set(err, ERR_USAGE, "there is no task %s %u: the run has %u of this phase", work_phase_text(phase),
			       index, about->tasks[phase]);
	r = gather_check_run(w, err);
	if (!r)
		r = cluster_words_parse(about->word, about->nword, &t.own, err);
	if (!r && t.own.opt.directory && chdir(t.own.opt.directory)) {
		err_sys(err, errno, "this node cannot enter the folder of the command");
		r = err_add_file(err, t.own.opt.directory);
	}
	if (!r)
		r = survey_of(&t, err);
	if (!r)
		r = runs[phase](&t, err);
	ctl_assume_done(&t.assume);
	cli_done(&t.own.line);
	return r;
}
