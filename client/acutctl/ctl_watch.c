/* watch: a line for each change of one job until it is over, or of all jobs until none is left to change. */
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ctl.h"

static void changed(void *ctx, const struct acut_job *job)
{
	ctl_job_print(ctx, job);
}

static int watch_one(struct program *ctl, uint64_t id)
{
	const struct acut_job *job;

	if (acut_job_wait(ctl->session.acut, id, true, changed, ctl, &job))
		return session_error_acut(&ctl->session);
	if (ctl->session.console.json)
		return job->has_error ? job->error.exit_status : SESSION_DONE;
	return ctl_job_status(ctl, job);
}

/* What was printed of each unfinished job, so that only changes are. */
struct watched {
	struct program *ctl;
	struct seen {
		uint64_t id, domains;
		char state[16], waiting[96];
	} * seen;
	size_t n;
	bool first;
	unsigned open;
};

static void look(void *ctx, const struct acut_job *job)
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
	ctl_job_print(w->ctl, job);
}

static int watch_all(struct program *ctl)
{
	struct watched w = {.ctl = ctl, .first = true};
	struct err err = ERR_INIT;
	int status = 0;

	do {
		w.open = 0;
		if (acut_jobs(ctl->session.acut, look, &w))
			status = session_error_acut(&ctl->session);
		w.first = false;
		if (!status && w.open)
			nanosleep(&(struct timespec){.tv_nsec = 300000000}, NULL);
		if (!status && session_interrupted(&ctl->session)) {
			err_set(&err, ERR_CANCELLED, "interrupted");
			status = session_error(&ctl->session, &err);
		}
	} while (!status && w.open);
	free(w.seen);
	return status;
}

int ctl_watch_run(struct program *ctl)
{
	int status;

	ctl->session.for_reader = true;
	if (ctl->line.nword)
		return ctl_job_each(ctl, watch_one);
	status = session_connect(&ctl->session);
	return status ? status : watch_all(ctl);
}
