/* watch: a line for each change of one job until it is over, or of all jobs until none is left to change. */
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ctl.h"

static void changed(void *ctx, const struct acut_job *job)
{
	ctl_report_job(ctx, job);
}

static int watch_one(struct session *session, uint64_t id)
{
	const struct acut_job *job;

	if (acut_job_wait(session->acut, id, true, changed, &session->console, &job))
		return session_error_acut(session);
	if (session->console.json)
		return job->has_error ? job->error.exit_status : SESSION_DONE;
	return ctl_report_job_status(session, job);
}

/* The last printed state of each unfinished job, so that only changes are printed. */
struct watched {
	struct console *console;
	struct seen {
		uint64_t id, domains;
		char state[16], waiting[96];
	} * seen;
	size_t n;
	bool first;
	unsigned open;
};

static void see(void *ctx, const struct acut_job *job)
{
	struct watched *w = ctx;
	struct seen *s = NULL, *grown;

	for (size_t i = 0; i < w->n && !s; i++)
		if (w->seen[i].id == job->id)
			s = &w->seen[i];
	w->open += !job->final;
	if (!s) {
		if (w->first && job->final)
			return; /* over before we came */
		grown = realloc(w->seen, (w->n + 1) * sizeof(*grown));
		if (!grown)
			return;
		w->seen = grown;
		s = &grown[w->n++];
		*s = (struct seen){.id = job->id};
	} else if (s->domains == job->progress.domains && !strcmp(s->state, job->state) &&
		   !strncmp(s->waiting, job->waiting, sizeof(s->waiting) - 1)) {
		return;
	}
	s->domains = job->progress.domains;
	snprintf(s->state, sizeof(s->state), "%s", job->state);
	snprintf(s->waiting, sizeof(s->waiting), "%s", job->waiting);
	ctl_report_job(w->console, job);
}

static int watch_all(struct session *session)
{
	struct watched w = {.console = &session->console, .first = true};
	struct err err = ERR_INIT;
	int status = 0;

	do {
		w.open = 0;
		if (acut_jobs(session->acut, see, &w))
			status = session_error_acut(session);
		w.first = false;
		if (!status && w.open)
			nanosleep(&(struct timespec){.tv_nsec = 300000000}, NULL);
		if (!status && session_interrupted(session)) {
			err_set(&err, ERR_CANCELLED, "interrupted");
			status = session_error(session, &err);
		}
	} while (!status && w.open);
	free(w.seen);
	return status;
}

int ctl_watch_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	int status;

	session->for_reader = true;
	if (ctl->line.nword)
		return ctl_job_each(ctl, watch_one);
	status = session_connect(session);
	return status ? status : watch_all(session);
}
