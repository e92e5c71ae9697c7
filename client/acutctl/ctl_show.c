/* show: all that is known of a job. */
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "ctl.h"
#include "term.h"

static void show_mesh(FILE *out, const struct acut_report *p)
{
	char a[32], b[32], c[32], bound[512];

	if (p->window) {
		term_field(out, "read", "%s points of %s cells", term_count(p->points_read, a), term_count(p->cells_read, b));
		term_field(out, "window", "%s vertices, %s triangles", term_count(p->vertices, a), term_count(p->triangles, b));
		return;
	}
	term_field(out, "points", "%s, used %s", term_count(p->points, a), term_count(p->used, b));
	for (size_t i = 0; i < p->nremoved; i++)
		if (p->removed[i].count)
			term_field(out, "left out", "%s by %s", term_count(p->removed[i].count, a), p->removed[i].rule);
	if (*p->max_error)
		term_field(out, "bound", "%s", ctl_report_bound(p, bound, sizeof(bound)));
	term_field(out, "mesh", "%s vertices, %s triangles, %s on the hull", term_count(p->vertices, a),
		   term_count(p->triangles, b), term_count(p->hull, c));
}

static void show_report(FILE *out, const struct acut_report *p)
{
	char a[32], b[32];

	show_mesh(out, p);
	if (p->domains_reused && p->domains_reused <= p->domains)
		term_field(out, "domains", "%s of %s made", term_count(p->domains - p->domains_reused, a),
			   term_count(p->domains, b));
	else
		term_field(out, p->window ? "pieces" : "domains", "%s", term_count(p->domains, a));
	term_field(out, "seconds", "%.3f", p->seconds);
	term_field(out, "digest", "%s", p->digest);
	term_field(out, "", "%s", p->vertex_digest);
}

/* `view`: for people. */
static void show_text(FILE *out, const struct acut_job *job, const char *view)
{
	char a[32];

	term_field(out, "job", "%" PRIu64, job->id);
	term_field(out, "state", "%s", job->state);
	term_field(out, "dataset", "%s, generation %" PRIu64, job->dataset, job->generation);
	term_field(out, "view", "%s", view);
	term_field(out, "submitted", "%s by user %u, process %u", term_time(job->submitted_us, a), job->uid, job->pid);
	term_field(out, "finished", "%s", term_time(job->finished_us, a));
	term_field(out, "lattice", "%s", job->lattice);
	term_field(out, "crs", "%s", job->crs);
	term_field(out, "units", "%s, heights %s", job->unit_xy, job->unit_z);
	if (job->has_report)
		show_report(out, &job->report);
	else if (!job->final)
		term_field(out, "progress", "%s, %" PRIu64 " of %" PRIu64 " domains", job->progress.phase, job->progress.domains,
			   job->progress.domains_total);
	if (job->has_error)
		term_field(out, "error", "%s", job->error.message);
}

/* Its view with the names of files. Asking for these ends what is known of the job, so that is asked for again. */
static int show_named(struct session *session, const struct acut_job *job)
{
	uint64_t id = job->id;
	char *dataset = strdup(job->dataset), *view = strdup(job->view), *text;
	struct err err = ERR_INIT;
	int status = SESSION_DONE;

	text = dataset && view ? ctl_report_view(session->acut, dataset, view) : NULL;
	if (!text) {
		err_set(&err, ERR_NOMEM, "no memory for a view");
		status = session_error(session, &err);
	} else if (acut_job_wait(session->acut, id, false, NULL, NULL, &job)) {
		status = session_error_acut(session);
	} else {
		show_text(session->console.report, job, text);
	}
	free(dataset);
	free(view);
	free(text);
	return status;
}

int ctl_show_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	const struct acut_job *job;
	struct err err = ERR_INIT;
	uint64_t id;
	int status;

	if (ctl_job_id(ctl->line.word[0], &id, &err))
		return session_error(session, &err);
	status = session_connect(session);
	if (status)
		return status;
	if (acut_job_wait(session->acut, id, false, NULL, NULL, &job))
		return session_error_acut(session);
	if (session->console.json)
		ctl_report_job_json(&session->console, job, "");
	else
		return show_named(session, job);
	return SESSION_DONE;
}
