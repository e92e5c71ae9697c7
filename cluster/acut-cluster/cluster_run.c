/*
 * A run, opened from its work folder: the words of the command that began it, read with the tables of today, its tasks by their
 * records, and the scheduler that has them.
 */
#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "cluster.h"
#include "gather.h"
#include "parse.h"

enum { ATTEMPTS_MOST = 100, TASKS_MOST = 1000000 };

/* ---- opening ---- */

/* acut-task stands beside this program; $ACUT_TASK names another. */
static int find_task(char *buf, size_t size, struct err *err)
{
	const char *set = getenv("ACUT_TASK");
	ssize_t n;
	char *slash;

	if (set && *set) {
		if (!realpath(set, buf))
			return err_sys(err, errno, "$ACUT_TASK cannot be found");
		return 0;
	}
	n = readlink("/proc/self/exe", buf, size - 16);
	if (n <= 0)
		return err_sys(err, errno, "the place of this program cannot be found");
	buf[n] = 0;
	slash = strrchr(buf, '/');
	strcpy(slash + 1, "acut-task");
	if (access(buf, X_OK))
		err_sys(err, errno, "the program of the tasks cannot be run");
	return err->code ? err_add_file(err, buf) : 0;
}

static bool is_done(void *ctx, unsigned phase, uint32_t index)
{
	struct cluster_run *r = ctx;
	struct work_record *record;
	struct err err = ERR_INIT;

	if (work_record_look(r->work, r->phase[phase], index, &record, &err))
		return false;
	work_record_free(record);
	return true;
}

static bool is_stopped(void *ctx)
{
	struct cluster_run *r = ctx;

	return session_interrupted(&r->program->session) != 0 || (r->submits && work_cancelled(r->work));
}

static void note(void *ctx, const char *text)
{
	struct cluster_run *r = ctx;

	console_note(&r->program->session.console, "%s", text);
}

static void progress(void *ctx)
{
	struct cluster_run *r = ctx;

	if (!console_progress_on(&r->program->session.console))
		return;
	for (unsigned p = 0; p < r->nphase; p++) {
		const struct dispatch_counts c = dispatch_counts(r->dispatch, p);
		const uint32_t all = r->size.tasks[r->phase[p]];

		if (c.done == all)
			continue;
		console_progress(&r->program->session.console, "%s %u/%u done, %u running, %u waiting",
				 work_phase_text(r->phase[p]), c.done, all, c.running, c.waiting);
		return;
	}
}

/* The scheduler's options of the command that resumes a run hold for what it submits. */
static void take_over(const struct cluster_options *from, struct cluster_options *to)
{
	to->partition = from->partition ? from->partition : to->partition;
	to->account = from->account ? from->account : to->account;
	to->qos = from->qos ? from->qos : to->qos;
	to->time = from->time > 0 ? from->time : to->time;
	to->max_tasks = from->max_tasks ? from->max_tasks : to->max_tasks;
	to->attempts = from->attempts ? from->attempts : to->attempts;
	if (from->sbatch.n)
		to->sbatch = from->sbatch;
}

int cluster_limits(const struct cluster_options *o, struct err *err)
{
	if (o->attempts > ATTEMPTS_MOST)
		return err_set(err, ERR_USAGE, "--attempts is at most %d", ATTEMPTS_MOST);
	if (o->max_tasks > TASKS_MOST)
		return err_set(err, ERR_USAGE, "--max-tasks is at most %d", TASKS_MOST);
	return 0;
}

static int open_dispatch(struct cluster_run *r, enum cluster_open how, const char *script, struct err *err)
{
	const struct cluster_options *o = &r->own.opt;
	const char *patience = getenv("ACUT_CLUSTER_PATIENCE"), *poll = getenv("ACUT_CLUSTER_POLL");
	struct dispatch_phase phase[WORK_PHASES];
	struct dispatch_options d = {.id = r->id,
				     .work = r->folder,
				     .task = r->task,
				     .phase = phase,
				     .most = (unsigned)o->max_tasks,
				     .attempts = (unsigned)o->attempts,
				     .user = (unsigned)r->owner,
				     .partition = o->partition,
				     .account = o->account,
				     .qos = o->qos,
				     .extra = o->sbatch.n ? o->sbatch.text : NULL,
				     .ctx = r,
				     .done = is_done,
				     .stop = is_stopped,
				     .changed = progress,
				     .note = note};

	for (int i = 0; i < WORK_PHASES; i++)
		if (r->size.tasks[i]) {
			r->phase[r->nphase] = (enum work_phase)i;
			phase[r->nphase++] = (struct dispatch_phase){.name = work_phase_text((enum work_phase)i),
								     .tasks = r->size.tasks[i],
								     .memory = r->size.memory[i],
								     .time = r->size.time[i]};
		}
	d.nphase = r->nphase;
	if (patience && !parse_seconds(patience, &d.patience))
		d.patience = 0;
	if (poll && !parse_seconds(poll, &d.poll))
		d.poll = 0;
	if (find_task(r->task, sizeof r->task, err))
		return -(int)err->code;
	snprintf(r->script, sizeof r->script, "%s%s", script && *script ? script : r->folder, script && *script ? "" : "/script");
	d.script = script ? r->script : NULL;
	return dispatch_new(o->on, &d, &r->dispatch, err);
}

/* Jobs have the rights of who submits them, and the words of a run name files: nobody else may submit it. */
static int check_owner(struct cluster_run *r, enum cluster_open how, struct err *err)
{
	struct stat st;

	if (fstatat(work_fd(r->work), "acut-work", &st, 0)) {
		err_sys(err, errno, "the owner of the run cannot be found");
		return err_add_file(err, r->folder);
	}
	r->owner = st.st_uid;
	if (how == CLUSTER_LOOKS || r->owner == geteuid())
		return 0;
	err_set(err, ERR_PERM, "the run belongs to the user %u, who alone may submit it", (unsigned)r->owner);
	return err_add_hint(err, "show, cancel and clean are for anybody who may read or change %s", r->folder);
}

static int open_work(struct cluster_run *r, const char *folder, enum cluster_open how, struct err *err)
{
	const struct work_about *about;
	int e = work_open(folder, &r->work, err);

	if (e)
		return e;
	r->folder = realpath(folder, NULL);
	if (!r->folder) {
		err_sys(err, errno, "the folder has no path");
		return err_add_file(err, folder);
	}
	e = check_owner(r, how, err);
	if (e)
		return e;
	about = work_about(r->work);
	snprintf(r->id, sizeof r->id, "%016llx", (unsigned long long)about->id);
	return cluster_words_parse(about->word, about->nword, &r->own, err);
}

int cluster_run_open(struct program *p, const char *folder, enum cluster_open how, const char *script, struct cluster_run *ret,
		     struct err *err)
{
	struct cluster_run *r = ret;
	const struct work_about *about;
	char log[PATH_MAX];
	int e;

	*r = (struct cluster_run){.program = p, .submits = how == CLUSTER_SUBMITS, .begun_ns = clock_mono_ns()};
	r->own.session.console = p->session.console;
	e = open_work(r, folder, how, err);
	if (!e) {
		about = work_about(r->work);
		take_over(&p->opt, &r->own.opt);
		e = cluster_limits(&r->own.opt, err);
	}
	if (!e) {
		e = work_inputs(r->work, &r->input, &r->ninput, err);
	}
	if (!e && how == CLUSTER_SUBMITS)
		e = gather_check_run(r->work, err);
	if (!e)
		e = cluster_size_of(&r->own, !about->tasks[WORK_PLAN], r->input, r->ninput, &r->size, err);
	if (!e) {
		memcpy(r->size.tasks, about->tasks, sizeof about->tasks);
		snprintf(log, sizeof log, "%s/log", r->folder);
		if (mkdir(log, 0750) && errno != EEXIST && errno != EROFS && errno != EACCES)
			e = err_sys(err, errno, "a folder for logs cannot be made");
	}
	if (!e)
		e = open_dispatch(r, how, script, err);
	if (e)
		cluster_run_close(r);
	return e;
}

void cluster_run_close(struct cluster_run *r)
{
	dispatch_free(r->dispatch);
	cli_done(&r->own.line);
	free(r->input);
	free(r->folder);
	work_close(r->work);
	*r = (struct cluster_run){0};
}

/* ---- going ---- */

bool cluster_run_done(const struct cluster_run *r)
{
	return dispatch_all_done(r->dispatch);
}

static bool is_local(const struct cluster_run *r)
{
	return !strcmp(r->own.opt.on, "local");
}

static void submitted_text(struct cluster_run *r)
{
	struct console *c = &r->program->session.console;
	size_t n;
	uint32_t *job = dispatch_jobs(r->dispatch, &n);

	if (cluster_run_done(r))
		console_line(c, "nothing is missing; acut-cluster show %s", r->folder);
	else if (!strcmp(r->own.opt.on, "script"))
		console_line(c, "the script is written; acut-cluster show %s tells how far the run is", r->folder);
	else if (n)
		console_line(c, "submitted as %s job%s %u%s; acut-cluster show %s tells how far the run is", r->own.opt.on,
			     n == 1 ? "" : "s", job[0], n == 1 ? "" : " and following ones", r->folder);
	else
		console_line(c, "nothing is missing; acut-cluster show %s", r->folder);
	free(job);
}

static void submitted_json(struct cluster_run *r)
{
	struct term_json j = console_json(&r->program->session.console);
	size_t n;
	uint32_t *job = dispatch_jobs(r->dispatch, &n);

	term_json_text(&j, "work", r->folder);
	term_json_text(&j, "id", r->id);
	term_json_text(&j, "scheduler", r->own.opt.on);
	term_json_open(&j, "jobs", '[');
	for (size_t i = 0; i < n; i++)
		term_json_u64(&j, NULL, job[i]);
	term_json_close(&j, ']');
	term_json_end(&j);
	free(job);
}

int cluster_run_cancelled(struct cluster_run *r)
{
	struct err err = ERR_INIT;

	err_set(&err, ERR_CANCELLED, "the run was cancelled");
	err_add_hint(&err, "to go on: acut-cluster resume %s", r->folder);
	return console_error(&r->program->session.console, &err);
}

int cluster_run_wait(struct cluster_run *r)
{
	struct session *s = &r->program->session;
	struct err err = ERR_INIT;
	int e = dispatch_wait(r->dispatch, &err);

	console_progress_clear(&s->console);
	if (!e) {
		cluster_run_result(r);
		return 0;
	}
	if (work_cancelled(r->work)) {
		err_clear(&err);
		return cluster_run_cancelled(r);
	}
	if (e == DISPATCH_E_STOPPED) {
		console_note(&s->console,
			     is_local(r) ? "the tasks end; acut-cluster resume %s goes on" :
					   "the tasks go on; acut-cluster wait %s waits again",
			     r->folder);
		err_set(&err, ERR_CANCELLED, "interrupted");
	}
	return session_error(s, &err);
}

int cluster_run_go(struct cluster_run *r)
{
	struct session *s = &r->program->session;
	struct err err = ERR_INIT;
	int e;

	if (is_local(r))
		return cluster_run_wait(r);
	/* What was cancelled before is submitted again; from then on it ends the wait. */
	e = dispatch_look(r->dispatch, &err);
	if (!e)
		e = dispatch_submit(r->dispatch, false, &err);
	if (e && !(e == -ERR_BUSY && r->program->opt.wait)) {
		err_add_hint(&err, "the run is in %s: acut-cluster resume goes on, clean --force removes it", r->folder);
		return session_error(s, &err);
	}
	if (r->program->opt.wait)
		return cluster_run_wait(r);
	if (s->console.json)
		submitted_json(r);
	else
		submitted_text(r);
	return 0;
}
