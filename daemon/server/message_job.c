/* Jobs as messages, and their report as JSON. A message points into the job: send it before the job can change. */
#include <stdio.h>
#include <string.h>

#include "server_priv.h"

enum { JOBS_RULES = 3 }; /* acut.proto: Jobs.rules */

static void removed_message(const struct job_report *r, struct message_job *m)
{
	for (int i = VIEW_KEPT + 1; i < VIEW_RULES; i++) {
		Acut__V1__Removed *removed = &m->removed[m->report.n_removed];

		acut__v1__removed__init(removed);
		removed->rule = (char *)view_rule_text((enum view_rule)i);
		removed->count = r->removed[i];
		m->removed_list[m->report.n_removed++] = removed;
	}
	m->report.removed = m->removed_list;
}

static void removed_counts(const struct job_report *r, struct message_job *m)
{
	for (int i = VIEW_KEPT + 1; i < VIEW_RULES; i++)
		m->removed_counts[m->report.n_removed_counts++] = r->removed[i];
	m->report.removed_counts = m->removed_counts;
}

static void most_message(const struct job_report *r, Acut__V1__Report *ret)
{
	unsigned long long points;
	double x, y;

	if (sscanf(r->most, "%llu %lf %lf", &points, &x, &y) != 3)
		return;
	ret->most_points = points;
	ret->most_x = x;
	ret->most_y = y;
}

static void report_message(const struct job_report *r, bool counts, struct message_job *m)
{
	acut__v1__report__init(&m->report);
	m->report.points = r->points;
	m->report.used = r->used;
	m->report.vertices = r->vertices;
	m->report.triangles = r->triangles;
	m->report.hull = r->hull;
	m->report.domains = r->domains;
	m->report.domains_reused = r->domains_reused;
	m->report.halo = r->halo;
	m->report.points_read = r->points_read;
	m->report.cells_read = r->cells_read;
	m->report.digest = (char *)r->digest;
	m->report.vertex_digest = (char *)r->vertex_digest;
	m->report.seconds = r->seconds;
	m->report.stage_seconds = r->stage_seconds;
	m->report.first_triangle_seconds = r->first_triangle_seconds;
	m->report.seal_seconds = r->seal_seconds;
	m->report.plan_seconds = r->plan_seconds;
	m->report.domains_seconds = r->domains_seconds;
	m->report.peak_rss_bytes = r->peak_rss;
	m->report.note = (char *)r->note;
	m->report.window = r->window;
	m->report.max_error = (char *)r->max_error;
	m->report.positions = r->positions;
	m->report.kept = r->kept;
	m->report.rounds = r->rounds;
	m->report.attempts = r->attempts;
	m->report.largest_error = (char *)r->largest_error;
	most_message(r, &m->report);
	if (counts)
		removed_counts(r, m);
	else
		removed_message(r, m);
	m->job.report = &m->report;
}

static void job_message(const struct job *job, bool counts, struct message_job *m)
{
	struct dataset_info d;
	struct job_info info;

	job_info(job, &info);
	acut__v1__job__init(&m->job);
	m->job.id = info.id;
	m->job.dataset = (char *)info.dataset_name;
	m->job.generation = info.generation;
	m->job.view = (char *)info.view;
	m->job.state = (char *)(info.space_missing ? "waiting-space" : job_state_text(info.state));
	m->job.lacks_space = info.space_missing;
	m->job.uid = info.peer.uid;
	m->job.pid = info.peer.pid;
	m->job.submitted_us = info.submitted_us;
	m->job.finished_us = info.finished_us;
	m->job.final = job_state_final(info.state);
	acut__v1__progress__init(&m->progress);
	m->progress.phase = (char *)info.phase;
	m->progress.points = info.points_done;
	m->progress.points_total = info.points_total;
	m->progress.domains = info.domains_done;
	m->progress.domains_total = info.domains_total;
	m->progress.seconds_left = info.seconds_left;
	m->job.progress = &m->progress;
	m->job.priority = (char *)job_priority_text(info.priority);
	memcpy(m->waiting, info.waiting, sizeof m->waiting);
	m->job.waiting = m->waiting;
	m->job.position = info.position;
	if (info.dataset) {
		dataset_info(info.dataset, &d);
		m->job.lattice = (char *)d.lattice;
		m->job.crs = (char *)d.crs;
		m->job.unit_xy = (char *)d.unit_xy;
		m->job.unit_z = (char *)d.unit_z;
	}
	if (info.report)
		report_message(info.report, counts, m);
	if (info.err) {
		frame_error_from_err(info.err, &m->error);
		m->job.error = &m->error.body;
	}
}

void message_job(const struct job *job, struct message_job *m)
{
	job_message(job, false, m);
}

void message_job_counts(const struct job *job, struct message_job *m)
{
	job_message(job, true, m);
}

bool message_job_rules(struct frame_page *page)
{
	bool fits = true;

	for (int i = VIEW_KEPT + 1; i < VIEW_RULES && fits; i++)
		fits = frame_page_text(page, JOBS_RULES, view_rule_text((enum view_rule)i));
	return fits;
}

/* Rule names and the note contain no character that JSON would have to escape. */
char *message_report_json(const struct job_report *r, char *buf, size_t size)
{
	size_t at;
	int i;

	at = (size_t)snprintf(
		buf, size,
		"{\"points\":%llu,\"used\":%llu,\"domains\":%llu,\"domains_reused\":%llu,\"halo\":%llu,\"points_read\":%llu,"
		"\"cells_read\":%llu,\"seconds\":%.6f,"
		"\"stage_seconds\":%.6f,\"first_triangle_seconds\":%.6f,\"seal_seconds\":%.6f,"
		"\"plan_seconds\":%.6f,\"domains_seconds\":%.6f,\"peak_rss_bytes\":%llu,\"note\":\"%s\","
		"\"removed\":{",
		(unsigned long long)r->points, (unsigned long long)r->used, (unsigned long long)r->domains,
		(unsigned long long)r->domains_reused, (unsigned long long)r->halo, (unsigned long long)r->points_read,
		(unsigned long long)r->cells_read, r->seconds, r->stage_seconds, r->first_triangle_seconds, r->seal_seconds,
		r->plan_seconds, r->domains_seconds, (unsigned long long)r->peak_rss, r->note);
	for (i = VIEW_KEPT + 1; i < VIEW_RULES && at < size; i++)
		at += (size_t)snprintf(buf + at, size - at, "%s\"%s\":%llu", i > VIEW_KEPT + 1 ? "," : "",
				       view_rule_text((enum view_rule)i), (unsigned long long)r->removed[i]);
	if (at < size)
		at += (size_t)snprintf(buf + at, size - at, "}");
	if (at < size && *r->max_error)
		at += (size_t)snprintf(buf + at, size - at,
				       ",\"max_error\":\"%s\",\"largest_error\":\"%s\",\"positions\":%llu,\"kept\":%llu,"
				       "\"rounds\":%llu,\"attempts\":%llu",
				       r->max_error, r->largest_error, (unsigned long long)r->positions,
				       (unsigned long long)r->kept, (unsigned long long)r->rounds,
				       (unsigned long long)r->attempts);
	if (at < size)
		snprintf(buf + at, size - at, "}");
	return buf;
}
