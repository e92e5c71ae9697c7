/* mesh, stage, plan: what can be refused before a task runs is refused; then the work folder is made, and all phases are
 * submitted. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cluster.h"
#include "gather.h"
#include "mesh_phase.h"
#include "parse.h"
#include "pipe.h"

/* Of the points that sizes of files let expect there are so many at least. */
static const double LEAST_OF_POINTS = 0.6;

/* ---- inputs ---- */

static int see_input(const struct ctl_input *in, struct work_input *ret, struct err *err)
{
	char path[4096];
	struct stat st;

	if (in->archive) {
		err_set(err, ERR_USAGE, "a file in an archive is no input of a cluster: unpack the archive");
		return err_add_file(err, in->name);
	}
	if (!ctl_input_path(in, path, sizeof path) || stat(path, &st)) {
		if (errno == ENOENT || errno == ENOTDIR)
			err_set(err, ERR_INPUT, "it cannot be opened: %s", strerror(errno));
		else
			err_sys(err, errno, "it cannot be opened");
		return err_add_file(err, in->name);
	}
	if (!S_ISREG(st.st_mode)) {
		err_set(err, ERR_INPUT, "it is no regular file");
		return err_add_file(err, in->name);
	}
	ret->path = strdup(path);
	ret->size = (uint64_t)st.st_size;
	ret->mtime_ns = (int64_t)st.st_mtim.tv_sec * 1000000000 + st.st_mtim.tv_nsec;
	return ret->path ? 0 : err_set(err, ERR_NOMEM, "no memory for a list of inputs");
}

static void free_inputs(struct work_input *in, size_t n)
{
	for (size_t i = 0; in && i < n; i++)
		free((char *)in[i].path);
	free(in);
}

static int gather_inputs(struct program *p, struct work_input **ret, size_t *ret_n, struct err *err)
{
	struct ctl_inputs in = ctl_inputs_of(&p->session, &p->input);
	const char *path[CTL_FETCH_OUTPUTS + 1];
	struct work_input *list = NULL;
	int r;

	if (!p->line.nword) {
		err_set(err, ERR_USAGE, "%s needs at least 1 word after it, 0 given", p->line.command->name);
		return err_add_hint(err, "acut-cluster %s", p->line.command->usage);
	}
	in.no_pipes = "a pipe is no input of a cluster: other nodes cannot read it";
	r = ctl_inputs_gather(&in, p->line.word, p->line.nword, err);
	if (r)
		return r;
	r = ctl_inputs_not_outputs(&in, ctl_fetch_paths(&p->fetch, path), err);
	list = calloc(in.n + 1, sizeof *list);
	if (!r && !list)
		r = err_set(err, ERR_NOMEM, "no memory for a list of inputs");
	for (size_t i = 0; !r && i < in.n; i++)
		r = see_input(&in.input[i], &list[i], err);
	if (r) {
		free_inputs(list, in.n);
	} else {
		*ret = list;
		*ret_n = in.n;
	}
	ctl_inputs_done(&in);
	return r;
}

/* ---- options ---- */

static int check_view(const struct program *p, struct err *err)
{
	char *text;
	int r = mesh_phase_check(&p->view, err);

	if (!r)
		r = ctl_view_text(&p->view, &text, err);
	if (!r)
		free(text);
	return r;
}

/* The path of a file or folder, of which the end may not be there yet. */
static bool path_of(const char *name, char ret[PATH_MAX])
{
	char whole[PATH_MAX], there[PATH_MAX];
	size_t n;

	if (snprintf(whole, sizeof whole, "%s%s", *name == '/' ? "" : "./", name) >= (int)sizeof whole)
		return false;
	strcpy(there, whole);
	while (!realpath(*there ? there : "/", ret)) {
		char *slash = strrchr(there, '/');

		if (!slash)
			return false;
		*slash = 0;
	}
	n = strlen(ret);
	return snprintf(ret + n, PATH_MAX - n, "%s", whole + strlen(there)) < (int)(PATH_MAX - n);
}

/* clean would remove it with the run. */
static int check_place(const struct program *p, const char *output, struct err *err)
{
	char work[PATH_MAX], out[PATH_MAX];
	size_t n;

	if (!path_of(p->opt.work, work) || !path_of(output, out))
		return 0; /* who makes it says why */
	n = strlen(work);
	while (n > 1 && work[n - 1] == '/')
		work[--n] = 0;
	if (strncmp(out, work, n) || (out[n] && out[n] != '/'))
		return 0;
	err_set(err, ERR_USAGE, "the output is in the work folder, which acut-cluster clean removes");
	err_add_hint(err, "write it to another folder");
	return err_add_file(err, output);
}

static int check_outputs(struct program *p, uint64_t points, struct err *err)
{
	const char *path[CTL_FETCH_OUTPUTS + 1];
	struct outputs *run = NULL;
	int r = 0;

	ctl_fetch_paths(&p->fetch, path);
	for (const char *const *o = path; !r && p->opt.work && *o; o++)
		r = check_place(p, *o, err);
	if (r)
		return r;
	p->fetch.gaps = p->view.ground || p->view.surface;
	if (ctl_fetch_to_standard(&p->fetch))
		return err_set(err, ERR_USAGE, "standard output is no output of a cluster: give a file or a folder");
	r = gather_check(&p->fetch, (uint64_t)(LEAST_OF_POINTS * (double)points), err);
	if (!r)
		r = ctl_fetch_open(&p->session, &p->fetch, &run, err);
	outputs_free(run);
	return r;
}

static int check(struct program *p, bool stage, const struct cluster_size *s, struct err *err)
{
	int r = ctl_stage_check(&p->stage, &p->input, err);

	if (!r && p->input.format && !ctl_input_format_of(p->input.format)) {
		r = err_set(err, ERR_USAGE, "there is no input format %.40s", p->input.format);
		err_add_hint(err, "acutctl formats lists them");
	}
	if (!r && !stage)
		r = check_view(p, err);
	if (!r && !stage)
		r = check_outputs(p, s->points, err);
	return r;
}

static int check_run(const struct program *own, const struct program *p, struct err *err)
{
	if (!own->opt.on) {
		err_set(err, ERR_USAGE, "it is not said where the tasks run");
		return err_add_hint(err, "give --on slurm, local or script, or set scheduler in %s", ACUT_CLUSTER_CONFIG);
	}
	if (!p->opt.work) {
		err_set(err, ERR_USAGE, "no work folder given");
		return err_add_hint(err, "name one with --work DIR: a new folder on a file system that all nodes see");
	}
	if (p->opt.script && strcmp(own->opt.on, "script"))
		return err_set(err, ERR_USAGE, "--script is for --on script");
	if (cluster_limits(&own->opt, err))
		return -(int)err->code;
	return dispatch_check(own->opt.on, p->opt.work, p->opt.script, err);
}

/* ---- the run ---- */

/* The command with its settings: what the run will be. */
struct resolved {
	struct program own;
	char **word;
	size_t nword;
	struct work_input *input;
	size_t ninput;
	struct cluster_size size;
};

static void resolved_done(struct resolved *r)
{
	cli_done(&r->own.line);
	cluster_words_free(r->word);
	free_inputs(r->input, r->ninput);
}

static int resolve(struct program *p, bool stage, struct resolved *ret, struct err *err)
{
	struct cluster_settings settings = {0};
	struct resolved r = {.own.session.console = p->session.console};
	int e = 0;

	if (p->opt.directory && chdir(p->opt.directory)) {
		err_sys(err, errno, "the folder cannot be entered");
		return err_add_file(err, p->opt.directory);
	}
	e = cluster_settings_read(p, &settings, err);
	if (!e)
		e = cluster_words(p, &settings, &r.word, &r.nword, err);
	cluster_settings_done(&settings);
	if (!e)
		e = cluster_words_parse((const char *const *)r.word, r.nword, &r.own, err);
	if (!e)
		e = gather_inputs(p, &r.input, &r.ninput, err);
	if (!e)
		e = cluster_size_of(&r.own, stage, r.input, r.ninput, &r.size, err);
	if (!e)
		e = check(p, stage, &r.size, err);
	if (e)
		resolved_done(&r);
	else
		*ret = r;
	return e;
}

static int make(const struct program *p, const struct resolved *r, struct err *err)
{
	struct work_about about = {.memory = r->own.opt.task_memory ? r->own.opt.task_memory : UINT64_C(1) << 30,
				   .kernel = PIPE_KERNEL,
				   .word = (const char *const *)r->word,
				   .nword = r->nword};
	struct work *w = NULL;
	int e;

	memcpy(about.tasks, r->size.tasks, sizeof about.tasks);
	while (!about.id)
		if (getrandom(&about.id, sizeof about.id, 0) != sizeof about.id)
			return err_sys(err, errno, "no random number for the name of the run");
	e = work_make(p->opt.work, &about, r->input, r->ninput, &w, err);
	work_close(w);
	return e;
}

static int run(struct program *p, bool stage)
{
	struct resolved r;
	struct cluster_run run;
	struct err err = ERR_INIT;
	int e = resolve(p, stage, &r, &err), status;

	if (e)
		return session_error(&p->session, &err);
	e = check_run(&r.own, p, &err);
	if (!e)
		e = make(p, &r, &err);
	resolved_done(&r);
	if (!e)
		e = cluster_run_open(p, p->opt.work, CLUSTER_SUBMITS, p->opt.script ? p->opt.script : "", &run, &err);
	if (e)
		return session_error(&p->session, &err);
	status = cluster_run_go(&run);
	cluster_run_close(&run);
	return status;
}

int cluster_mesh_run(struct program *p)
{
	return run(p, false);
}

int cluster_stage_run(struct program *p)
{
	return run(p, true);
}

/* ---- plan ---- */

static void plan_text(struct program *p, const struct cluster_size *s)
{
	static const struct term_column columns[] = {
		{"PHASE"}, {"TASKS", .right = true}, {"MEMORY", .right = true}, {"CORE-HOURS", .right = true}};
	struct term_table *t = term_table_new(stdout, columns, 4);
	char bytes[32], points[32];

	for (int i = 0; i < WORK_PHASES; i++) {
		if (!s->tasks[i])
			continue;
		term_table_text(t, "%s", work_phase_text((enum work_phase)i));
		term_table_count(t, s->tasks[i]);
		term_table_size(t, s->memory[i]);
		term_table_text(t, "%.2f", s->hours[i]);
	}
	term_table_free(t);
	console_line(&p->session.console, "%llu inputs, %s, about %s points; about %.2f core-hours",
		     (unsigned long long)s->inputs, parse_size_text(s->bytes, bytes), term_count(s->points, points),
		     s->core_hours);
}

static void plan_json(struct program *p, const struct cluster_size *s)
{
	struct term_json j = console_json(&p->session.console);

	term_json_u64(&j, "inputs", s->inputs);
	term_json_u64(&j, "bytes", s->bytes);
	term_json_u64(&j, "points", s->points);
	term_json_number(&j, "core_hours", s->core_hours);
	term_json_open(&j, "phases", '[');
	for (int i = 0; i < WORK_PHASES; i++) {
		if (!s->tasks[i])
			continue;
		term_json_open(&j, NULL, '{');
		term_json_text(&j, "phase", work_phase_text((enum work_phase)i));
		term_json_u64(&j, "tasks", s->tasks[i]);
		term_json_u64(&j, "memory", s->memory[i]);
		term_json_number(&j, "core_hours", s->hours[i]);
		term_json_number(&j, "time", s->time[i]);
		term_json_close(&j, '}');
	}
	term_json_close(&j, ']');
	term_json_end(&j);
}

/* Without an output it is a plan all the same. */
int cluster_plan_run(struct program *p)
{
	struct ctl_fetch_output *first = &p->fetch.output[0];
	struct resolved r;
	struct err err = ERR_INIT;

	if (!ctl_fetch_count(&p->fetch) && !first->format)
		first->format = "null";
	if (resolve(p, false, &r, &err))
		return session_error(&p->session, &err);
	if (p->session.console.json)
		plan_json(p, &r.size);
	else
		plan_text(p, &r.size);
	resolved_done(&r);
	return 0;
}
