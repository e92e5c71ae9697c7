/* jobs: one row a job. */
#include <string.h>

#include "ctl.h"
#include "parse.h"

static const struct term_column columns[] = {
	{"JOB", .right = true},       {"STATE"},
	{"DATASET", .shrink = true},  {"GENERATION", .right = true, .spare = true},
	{"TRIANGLES", .right = true}, {"DOMAINS", .right = true, .spare = true},
	{"SUBMITTED", .spare = true}, {"USER", .right = true, .spare = true},
	{"PRIORITY", .spare = true},  {"NOTE", .tail = true},
};

/* Why it is not done, or how long it will take. */
static void note(struct term_table *t, const struct acut_job *job)
{
	char left[32];

	if (job->has_error)
		term_table_text(t, "%s", job->error.message);
	else if (!job->final && job->lacks_space)
		term_table_text(t, "%s of disk space are lacking", parse_size_text(job->lacks_space, left));
	else if (!job->final && job->waiting && *job->waiting)
		term_table_text(t, "waits for %s", job->waiting);
	else if (!job->final && job->progress.seconds_left > 0)
		term_table_text(t, "about %s left", session_progress_time(job->progress.seconds_left, left));
	else
		term_table_none(t);
}

static void each(void *ctx, const struct acut_job *job)
{
	struct console_list *l = ctx;
	struct term_table *t = l->table;
	bool failed = !strcmp(job->state, "failed"), over = job->final;

	if (l->console->json) {
		ctl_report_job_json(l->console, job, "");
		return;
	}
	term_table_id(t, job->id);
	term_table_tint(t, failed ? TERM_BAD : over ? TERM_PLAIN : job->lacks_space ? TERM_WARN : TERM_GOOD);
	term_table_text(t, "%s", job->state);
	term_table_text(t, "%s", job->dataset);
	term_table_id(t, job->generation);
	if (job->has_report)
		term_table_count(t, job->report.triangles);
	else
		term_table_none(t);
	if (job->has_report)
		term_table_text(t, "%llu/%llu", (unsigned long long)job->report.domains, (unsigned long long)job->report.domains);
	else if (job->progress.domains_total)
		term_table_text(t, "%llu/%llu", (unsigned long long)job->progress.domains,
				(unsigned long long)job->progress.domains_total);
	else
		term_table_none(t);
	term_table_time(t, job->submitted_us);
	term_table_text(t, "%u", job->uid);
	term_table_text(t, "%s", job->priority && strcmp(job->priority, "normal") ? job->priority : "");
	note(t, job);
}

int ctl_jobs_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct console_list l = {.console = &session->console};
	int status = session_connect(session);

	console_begin_list(&session->console);
	if (status)
		return status;
	l.table = CONSOLE_TABLE(l.console, columns);
	status = acut_jobs(session->acut, each, &l);
	term_table_free(l.table);
	return status ? session_error_acut(session) : SESSION_DONE;
}
