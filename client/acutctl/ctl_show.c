/* show: all that is known of a job. */
#include <inttypes.h>

#include "ctl.h"

static void show_mesh(FILE *out, const struct acut_report *p)
{
	char a[32], b[32], c[32];

	if (p->window) {
		fprintf(out, "read        %s points of %s cells\nwindow      %s vertices, %s triangles\n",
			ctl_job_count(p->points_read, a), ctl_job_count(p->cells_read, b), ctl_job_count(p->vertices, c),
			ctl_job_count(p->triangles, (char[32]){ 0 }));
		return;
	}
	fprintf(out, "points      %s, used %s\n", ctl_job_count(p->points, a), ctl_job_count(p->used, b));
	for (size_t i = 0; i < p->nremoved; i++)
		fprintf(out, "left out    %s by %s\n", ctl_job_count(p->removed[i].count, a), p->removed[i].rule);
	fprintf(out, "mesh        %s vertices, %s triangles, %s on the hull\n", ctl_job_count(p->vertices, a),
		ctl_job_count(p->triangles, b), ctl_job_count(p->hull, c));
}

static void show_text(struct ctl *ctl, const struct acut_job *job)
{
	const struct acut_report *p = &job->report;
	FILE *out = ctl->report;
	char a[32], b[32], shown[96];

	fprintf(out,
		"job         %" PRIu64 "\nstate       %s\ndataset     %s, generation %" PRIu64
		"\nview        %s\n",
		job->id, job->state, job->dataset, job->generation, job->view);
	fprintf(out, "submitted   %s by user %u, process %u\nfinished    %s\n",
		ctl_job_time_text(job->submitted_us, a), job->uid, job->pid,
		ctl_job_time_text(job->finished_us, b));
	fprintf(out, "lattice     %s\ncrs         %s\nunits       %s, heights %s\n", job->lattice, job->crs,
		job->unit_xy, job->unit_z);
	if (job->has_report) {
		show_mesh(out, p);
		if (p->domains_reused && p->domains_reused <= p->domains)
			snprintf(shown, sizeof shown, "%s of %s made", ctl_job_count(p->domains - p->domains_reused, a),
				 ctl_job_count(p->domains, b));
		else
			ctl_job_count(p->domains, shown);
		fprintf(out, "%s     %s\nseconds     %.3f\ndigest      %s\n            %s\n",
			p->window ? "pieces " : "domains", shown, p->seconds, p->digest, p->vertex_digest);
	} else if (!job->final) {
		fprintf(out, "progress    %s, %" PRIu64 " of %" PRIu64 " domains\n", job->progress.phase,
			job->progress.domains, job->progress.domains_total);
	}
	if (job->has_error)
		fprintf(out, "error       %s\n", job->error.message);
}

int ctl_show_run(struct ctl *ctl)
{
	const struct acut_job *job;
	struct err err = ERR_INIT;
	uint64_t id;
	int status;

	if (ctl_job_id(ctl->args.word[0], &id, &err))
		return ctl_error(ctl, &err);
	status = ctl_connect(ctl);
	if (status)
		return status;
	if (acut_job_wait(ctl->acut, id, false, NULL, NULL, &job))
		return ctl_error_acut(ctl);
	if (ctl->args.json)
		ctl_job_json(ctl, job);
	else
		show_text(ctl, job);
	return CTL_DONE;
}
