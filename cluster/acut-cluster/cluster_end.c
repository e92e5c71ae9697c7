/* wait, resume, cancel, clean. */
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "cluster.h"
#include "gather.h"

int cluster_wait_run(struct program *p)
{
	struct cluster_run r;
	struct err err = ERR_INIT;
	int status;

	if (cluster_run_open(p, p->line.word[0], CLUSTER_SUBMITS, NULL, &r, &err))
		return session_error(&p->session, &err);
	if (work_cancelled(r.work)) {
		status = cluster_run_cancelled(&r);
	} else {
		status = cluster_run_wait(&r);
	}
	cluster_run_close(&r);
	return status;
}

/* Results that are gone are made again. Outputs may have relative names. */
static int recover(struct cluster_run *r, struct err *err)
{
	const struct gather_params g = {.work = r->work, .outputs = &r->own.fetch, .memory = work_about(r->work)->memory};
	uint32_t n = 0;
	int here, e = 0;

	if (!r->size.tasks[WORK_GATHER])
		return 0;
	here = open(".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	if (r->own.opt.directory && here < 0)
		return err_sys(err, errno, "the working directory cannot be opened, so that --directory could be left again");
	if (r->own.opt.directory && chdir(r->own.opt.directory)) {
		e = err_sys(err, errno, "the folder of the command cannot be entered");
		err_add_file(err, r->own.opt.directory);
	}
	if (!e)
		e = gather_recover(&g, &n, err);
	if (r->own.opt.directory && here >= 0 && fchdir(here) && !e)
		e = err_sys(err, errno, "the folder cannot be entered again");
	if (here >= 0)
		close(here);
	if (n)
		console_note(&r->program->session.console, "%u task%s again: what %s made is not there any more", n,
			     n == 1 ? " is done" : "s are done", n == 1 ? "it" : "they");
	return e;
}

int cluster_resume_run(struct program *p)
{
	struct cluster_run r;
	struct err err = ERR_INIT;
	int status;

	if (cluster_run_open(p, p->line.word[0], CLUSTER_SUBMITS, p->opt.script ? p->opt.script : "", &r, &err))
		return session_error(&p->session, &err);
	if (recover(&r, &err) || work_uncancel(r.work, &err))
		status = session_error(&p->session, &err);
	else
		status = cluster_run_go(&r);
	cluster_run_close(&r);
	return status;
}

/* First the marker: a task that begins meanwhile sees it. */
int cluster_cancel_run(struct program *p)
{
	struct cluster_run r;
	struct err err = ERR_INIT;
	struct term_json j;
	uint32_t n = 0;
	int e;

	if (cluster_run_open(p, p->line.word[0], CLUSTER_LOOKS, NULL, &r, &err))
		return session_error(&p->session, &err);
	e = work_cancel(r.work, &err);
	if (!e)
		e = dispatch_look(r.dispatch, &err);
	if (!e)
		e = dispatch_cancel(r.dispatch, &n, &err);
	if (!e && p->session.console.json) {
		j = console_json(&p->session.console);
		term_json_text(&j, "work", r.folder);
		term_json_u64(&j, "jobs", n);
		term_json_end(&j);
	} else if (!e) {
		console_line(&p->session.console, "cancelled, %u job%s; acut-cluster resume %s goes on", n, n == 1 ? "" : "s",
			     r.folder);
	}
	cluster_run_close(&r);
	return e ? session_error(&p->session, &err) : 0;
}

/* ---- clean ---- */

static int check_clean(const struct cluster_run *r, struct err *err)
{
	const struct cluster_options *o = &r->program->opt;
	uint32_t live = 0;

	for (unsigned p = 0; p < r->nphase; p++) {
		const struct dispatch_counts c = dispatch_counts(r->dispatch, p);

		live += c.running + c.waiting;
	}
	if (live) {
		err_set(err, ERR_CONFLICT, "%u tasks of the run wait or run", live);
		return err_add_hint(err, "acut-cluster cancel %s ends them", r->folder);
	}
	if (!cluster_run_done(r) && !o->force) {
		err_set(err, ERR_CONFLICT, "the run is not done");
		return err_add_hint(err, "--force removes what it has; acut-cluster resume %s goes on", r->folder);
	}
	if (!r->size.tasks[WORK_PLAN] && !o->keep_dataset && !o->force) {
		err_set(err, ERR_CONFLICT, "the dataset is all that the run has made, and it is in the work folder");
		return err_add_hint(err, "--keep-dataset leaves it, --force removes it, too");
	}
	return 0;
}

/* What killed attempts left beside the outputs. Where the folder of the command is gone, so are outputs with relative names. */
static int clean_outputs(struct cluster_run *r, struct err *err)
{
	const struct gather_params g = {.work = r->work, .outputs = &r->own.fetch, .memory = work_about(r->work)->memory};

	if (!r->size.tasks[WORK_GATHER])
		return 0;
	if (r->own.opt.directory && chdir(r->own.opt.directory)) {
		if (errno == ENOENT || r->program->opt.force) {
			console_warn(&r->program->session.console,
				     "%s cannot be entered: %s; what tasks left beside the outputs stays", r->own.opt.directory,
				     strerror(errno));
			return 0;
		}
		err_sys(err, errno, "the folder of the command cannot be entered");
		err_add_hint(err, "with --force it is cleaned all the same");
		return err_add_file(err, r->own.opt.directory);
	}
	return gather_clean(&g, err);
}

int cluster_clean_run(struct program *p)
{
	static const char *const dataset[] = {"dataset", NULL};
	struct cluster_run r;
	struct err err = ERR_INIT;
	int e = cluster_run_open(p, p->line.word[0], CLUSTER_LOOKS, NULL, &r, &err);

	if (e)
		return session_error(&p->session, &err);
	e = dispatch_look(r.dispatch, &err);
	if (e == -ERR_NODAEMON && p->opt.force) { /* the scheduler is not here: who says --force knows that nothing runs */
		err_clear(&err);
		e = 0;
	}
	if (!e)
		e = check_clean(&r, &err);
	if (!e)
		e = clean_outputs(&r, &err);
	if (!e)
		e = work_clean(r.work, p->opt.keep_dataset ? dataset : NULL, &err);
	cluster_run_close(&r);
	return e ? session_error(&p->session, &err) : 0;
}
