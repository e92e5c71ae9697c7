/* jobs: one row a job. */
#include <string.h>

#include "ctl.h"
#include "ctl_table.h"
#include "parse.h"

static const struct ctl_column columns[] = {
	{"JOB", .right = true},       {"STATE"},
	{"DATASET", .shrink = true},  {"GENERATION", .right = true, .spare = true},
	{"TRIANGLES", .right = true}, {"DOMAINS", .right = true, .spare = true},
	{"SUBMITTED", .spare = true}, {"USER", .right = true, .spare = true},
	{"PRIORITY", .spare = true},  {"NOTE", .tail = true},
};

struct listing {
	struct ctl *ctl;
	struct ctl_table *table;
};

/* Why it is not done, or how long it will take. */
static void note(struct ctl_table *t, const struct acut_job *job)
{
	char left[32];

	if (job->has_error)
		ctl_table_text(t, "%s", job->error.message);
	else if (!job->final && job->lacks_space)
		ctl_table_text(t, "%s of disk space are lacking", parse_size_text(job->lacks_space, left));
	else if (!job->final && job->waiting && *job->waiting)
		ctl_table_text(t, "waits for %s", job->waiting);
	else if (!job->final && job->progress.seconds_left > 0)
		ctl_table_text(t, "about %s left", ctl_progress_time(job->progress.seconds_left, left));
	else
		ctl_table_none(t);
}

static void each(void *ctx, const struct acut_job *job)
{
	struct listing *l = ctx;
	struct ctl_table *t = l->table;
	bool failed = !strcmp(job->state, "failed"), over = job->final;

	if (l->ctl->args.json) {
		ctl_job_json(l->ctl, job);
		return;
	}
	ctl_table_id(t, job->id);
	ctl_table_tint(t, failed ? CTL_BAD : over ? CTL_PLAIN : job->lacks_space ? CTL_WARN : CTL_GOOD);
	ctl_table_text(t, "%s", job->state);
	ctl_table_text(t, "%s", job->dataset);
	ctl_table_id(t, job->generation);
	if (job->has_report)
		ctl_table_count(t, job->report.triangles);
	else
		ctl_table_none(t);
	if (job->has_report)
		ctl_table_text(t, "%llu/%llu", (unsigned long long)job->report.domains, (unsigned long long)job->report.domains);
	else if (job->progress.domains_total)
		ctl_table_text(t, "%llu/%llu", (unsigned long long)job->progress.domains,
			       (unsigned long long)job->progress.domains_total);
	else
		ctl_table_none(t);
	ctl_table_time(t, job->submitted_us);
	ctl_table_text(t, "%u", job->uid);
	if (job->priority && strcmp(job->priority, "normal"))
		ctl_table_text(t, "%s", job->priority);
	else
		ctl_table_none(t);
	note(t, job);
}

int ctl_jobs_run(struct ctl *ctl)
{
	struct listing l = {.ctl = ctl};
	int status = ctl_connect(ctl);

	ctl_list_begin(ctl);
	if (status)
		return status;
	if (!ctl->args.json)
		l.table = ctl_table_new(ctl->report, columns, sizeof(columns) / sizeof(*columns));
	status = acut_jobs(ctl->acut, each, &l);
	ctl_table_free(l.table);
	return status ? ctl_error_acut(ctl) : CTL_DONE;
}
