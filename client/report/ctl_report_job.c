/* Jobs for people and as JSON, and the exit status of a job. */
#include <math.h>
#include <string.h>

#include "ctl_report.h"
#include "decimal.h"
#include "parse.h"
#include "term.h"

/* A lattice as decimals. */
struct lattice_decimals {
	char text[256];
	char scale[2][DECIMAL_TEXT_SIZE], offset[3][DECIMAL_TEXT_SIZE];
	bool ok;
};

static bool lattice_read(const char *lattice, struct lattice_decimals *ret)
{
	char part[5][DECIMAL_TEXT_SIZE];
	struct decimal scale[2];
	int64_t k[3];

	for (int i = 0; i < 5; i++) {
		size_t n;

		lattice += strspn(lattice, " ");
		n = strcspn(lattice, " ");
		if (!n || n >= sizeof(part[i]))
			return false;
		memcpy(part[i], lattice, n);
		part[i][n] = 0;
		lattice += n;
	}
	for (int i = 0; i < 2; i++) {
		if (!decimal_parse(part[i], &scale[i]))
			return false;
		strcpy(ret->scale[i], part[i]);
	}
	for (int i = 0; i < 3; i++) {
		if (!parse_i64(part[2 + i], &k[i]))
			return false;
		decimal_scaled_text(scale[i == 2], k[i], ret->offset[i]);
	}
	return true;
}

void ctl_report_lattice(struct term_json *j, const char *lattice)
{
	static struct lattice_decimals last; /* lists have the same one many times */

	if (lattice && strlen(lattice) < sizeof(last.text) && (!*last.text || strcmp(last.text, lattice))) {
		strcpy(last.text, lattice);
		last.ok = lattice_read(lattice, &last);
	}
	if (!lattice || strcmp(last.text, lattice) || !last.ok) {
		term_json_null(j, "lattice");
		return;
	}
	term_json_open(j, "lattice", '{');
	term_json_literal(j, "scale_xy", last.scale[0]);
	term_json_literal(j, "scale_z", last.scale[1]);
	term_json_open(j, "offset", '[');
	for (int i = 0; i < 3; i++)
		term_json_literal(j, NULL, last.offset[i]);
	term_json_close(j, ']');
	term_json_close(j, '}');
}

void ctl_report_units(struct term_json *j, const char *crs, const char *unit_xy, const char *unit_z)
{
	term_json_known(j, "crs", crs);
	term_json_open(j, "units", '{');
	term_json_known(j, "xy", unit_xy);
	term_json_known(j, "z", unit_z);
	term_json_close(j, '}');
}

/* All of it unknown. */
static void no_report(struct term_json *j)
{
	static const char *const key[] = {
		"points",          "used",           "vertices",    "triangles",  "hull",          "domains",
		"digest",          "vertex_digest",  "removed",     "seconds",    "stage_seconds", "first_triangle_seconds",
		"peak_rss_bytes",  "halo",           "points_read", "cells_read", "seal_seconds",  "plan_seconds",
		"domains_seconds", "domains_reused", "pieces",      "most",       "bound"};

	for (size_t i = 0; i < sizeof(key) / sizeof(*key); i++)
		term_json_null(j, key[i]);
}

char *ctl_report_domains(const struct acut_report *p, char *buf, size_t size)
{
	char made[32], all[32];

	if (p->domains_reused && p->domains_reused <= p->domains)
		snprintf(buf, size, "%s of %s domains made", term_count(p->domains - p->domains_reused, made),
			 term_count(p->domains, all));
	else
		snprintf(buf, size, "%s %s%s", term_count(p->domains, all), p->window ? "piece" : "domain",
			 p->domains == 1 ? "" : "s");
	return buf;
}

static void put_unless(struct term_json *j, bool unknown, const char *key, uint64_t n)
{
	if (unknown)
		term_json_null(j, key);
	else
		term_json_u64(j, key, n);
}

static void put_removed(struct term_json *j, const struct acut_report *p)
{
	if (p->window) {
		term_json_null(j, "removed");
		return;
	}
	term_json_open(j, "removed", '{');
	for (size_t i = 0; i < p->nremoved; i++)
		term_json_u64(j, p->removed[i].rule, p->removed[i].count);
	term_json_close(j, '}');
}

void ctl_report_most(struct term_json *j, uint64_t points, const double at[2])
{
	if (!points) {
		term_json_null(j, "most");
		return;
	}
	term_json_open(j, "most", '{');
	term_json_u64(j, "points", points);
	term_json_number(j, "x", at[0]);
	term_json_number(j, "y", at[1]);
	term_json_close(j, '}');
}

static double kept(const struct acut_report *p)
{
	return p->positions ? 100 * (double)p->kept / (double)p->positions : 100;
}

char *ctl_report_bound(const struct acut_report *p, char *buf, size_t size)
{
	char a[32], b[32], largest[80] = "";

	if (*p->largest_error)
		snprintf(largest, sizeof(largest), " (largest %s)", p->largest_error);
	snprintf(buf, size, "%s%s: %s of %s positions kept (%.3g %%), %llu round%s", p->max_error, largest,
		 term_count(p->kept, a), term_count(p->positions, b), kept(p), (unsigned long long)p->rounds,
		 p->rounds == 1 ? "" : "s");
	return buf;
}

static void put_bound(struct term_json *j, const struct acut_report *p)
{
	if (!*p->max_error) {
		term_json_null(j, "bound");
		return;
	}
	term_json_open(j, "bound", '{');
	term_json_literal(j, "max_error", p->max_error);
	if (*p->largest_error)
		term_json_literal(j, "largest_error", p->largest_error);
	else
		term_json_null(j, "largest_error");
	term_json_u64(j, "positions", p->positions);
	term_json_u64(j, "kept", p->kept);
	term_json_number(j, "percent", kept(p));
	term_json_u64(j, "rounds", p->rounds);
	term_json_u64(j, "attempts", p->attempts);
	term_json_close(j, '}');
}

/* A window has no values of the whole mesh. */
void ctl_report_mesh(struct term_json *j, const struct acut_report *p)
{
	if (!p) {
		no_report(j);
		return;
	}
	term_json_u64(j, "points", p->points);
	put_unless(j, p->window, "used", p->used);
	term_json_u64(j, "vertices", p->vertices);
	term_json_u64(j, "triangles", p->triangles);
	put_unless(j, p->window, "hull", p->hull);
	put_unless(j, p->window, "domains", p->domains);
	term_json_known(j, "digest", p->digest);
	term_json_known(j, "vertex_digest", p->vertex_digest);
	put_removed(j, p);
	term_json_number(j, "seconds", p->seconds);
	term_json_number(j, "stage_seconds", p->stage_seconds);
	term_json_number(j, "first_triangle_seconds", p->triangles ? p->first_triangle_seconds : NAN);
	term_json_u64(j, "peak_rss_bytes", p->peak_rss_bytes);
	put_unless(j, p->window, "halo", p->halo);
	term_json_u64(j, "points_read", p->points_read);
	term_json_u64(j, "cells_read", p->cells_read);
	term_json_number(j, "seal_seconds", p->seal_seconds);
	term_json_number(j, "plan_seconds", p->plan_seconds);
	term_json_number(j, "domains_seconds", p->domains_seconds);
	put_unless(j, p->window, "domains_reused", p->domains_reused);
	put_unless(j, !p->window, "pieces", p->domains);
	ctl_report_most(j, p->most_points, p->most_at);
	put_bound(j, p);
}

void ctl_report_notes(struct term_json *j, const struct acut_report *p, const char *more, const char *last)
{
	term_json_open(j, "notes", '[');
	if (p && *p->note)
		term_json_text(j, NULL, p->note);
	if (*more)
		term_json_text(j, NULL, more);
	if (*last)
		term_json_text(j, NULL, last);
	term_json_close(j, ']');
}

void ctl_report_job_json(struct console *c, const struct acut_job *job, const char *note)
{
	struct term_json j = console_json(c);
	struct err err;

	term_json_u64(&j, "job", job->id);
	term_json_known(&j, "dataset", job->dataset);
	term_json_u64(&j, "generation", job->generation);
	term_json_text(&j, "view", job->view);
	term_json_text(&j, "state", job->state);
	term_json_known(&j, "priority", job->priority);
	term_json_known(&j, "waiting", job->waiting);
	term_json_known_u64(&j, "position", job->position);
	term_json_known_u64(&j, "lacks_space", job->lacks_space);
	term_json_u64(&j, "uid", job->uid);
	term_json_u64(&j, "pid", job->pid);
	term_json_time(&j, "submitted", job->submitted_us);
	term_json_time(&j, "finished", job->finished_us);
	term_json_open(&j, "progress", '{');
	term_json_known(&j, "phase", job->progress.phase);
	term_json_u64(&j, "points", job->progress.points);
	term_json_u64(&j, "points_total", job->progress.points_total);
	term_json_u64(&j, "domains", job->progress.domains);
	term_json_u64(&j, "domains_total", job->progress.domains_total);
	term_json_number(&j, "seconds_left", job->progress.seconds_left > 0 ? job->progress.seconds_left : NAN);
	term_json_close(&j, '}');
	ctl_report_mesh(&j, job->has_report ? &job->report : NULL);
	if (job->has_error) {
		session_failure_of(&job->error, &err);
		term_error_json(&j, "error", &err);
	} else {
		term_json_null(&j, "error");
	}
	ctl_report_lattice(&j, job->lattice);
	ctl_report_units(&j, job->crs, job->unit_xy, job->unit_z);
	ctl_report_notes(&j, job->has_report ? &job->report : NULL, note, "");
	term_json_end(&j);
}

void ctl_report_job(struct console *c, const struct acut_job *job)
{
	char when[32], count[32], left[32], rest[256] = "";
	size_t n = 0;

	console_progress_clear(c);
	if (c->json) {
		ctl_report_job_json(c, job, "");
		return;
	}
	if (job->has_report)
		n = (size_t)snprintf(rest, sizeof(rest), "  %s triangles", term_count(job->report.triangles, count));
	else if (!job->final && job->progress.domains_total)
		n = (size_t)snprintf(rest, sizeof(rest), "  %llu of %llu domains", (unsigned long long)job->progress.domains,
				     (unsigned long long)job->progress.domains_total);
	if (job->priority && *job->priority && strcmp(job->priority, "normal"))
		n += (size_t)snprintf(rest + n, sizeof(rest) - n, "  %.20s priority", job->priority);
	if (!job->final && job->lacks_space)
		snprintf(rest + n, sizeof(rest) - n, "  %s of disk space are lacking", parse_size_text(job->lacks_space, left));
	else if (!job->final && job->waiting && *job->waiting)
		snprintf(rest + n, sizeof(rest) - n, "  waits for %s", job->waiting);
	else if (!job->final && job->progress.seconds_left > 0)
		snprintf(rest + n, sizeof(rest) - n, "  about %s left", session_progress_time(job->progress.seconds_left, left));
	term_line(c->report, "%6llu  %-10s  %s  %s%s%s%s", (unsigned long long)job->id, job->state,
		  term_time(job->submitted_us, when), job->dataset, rest, job->has_error ? "  " : "",
		  job->has_error ? job->error.message : "");
	if (!c->list)
		fflush(c->report);
}

int ctl_report_job_status(struct session *session, const struct acut_job *job)
{
	struct err err = ERR_INIT;

	if (job->has_report && !job->has_error) {
		console_note(&session->console, "%s", job->report.note);
		return SESSION_DONE;
	}
	if (job->has_error)
		session_failure_of(&job->error, &err);
	else if (!strcmp(job->state, "cancelled"))
		err_set(&err, ERR_CANCELLED, "job %llu was cancelled", (unsigned long long)job->id);
	else
		err_set(&err, ERR_INTERNAL, "job %llu ended as %s, without a reason", (unsigned long long)job->id, job->state);
	return session_error(session, &err);
}

/*
 * Many points at one position, as from scanners that write 0,0,0 for a missing echo: they become one vertex, and its
 * triangles span everything between. A hundred points are no coincidence if they are a hundredth of all points, or a thousand
 * times the mean of a position.
 */
bool ctl_report_crowded(uint64_t at_one, uint64_t points, uint64_t positions)
{
	double all = (double)points, one = (double)at_one;

	return at_one >= 100 && positions && (one >= all / 100 || one >= 1000 * all / (double)positions);
}

void ctl_report_warn_crowded(struct console *c, const struct acut_report *p)
{
	char count[32], points[32];
	uint64_t all = p->used;

	for (size_t i = 0; i < p->nremoved; i++)
		all += strcmp(p->removed[i].rule, "duplicate") ? 0 : p->removed[i].count;
	if (p->window || !ctl_report_crowded(p->most_points, all, p->used))
		return;
	console_warn(c,
		     "%s of %s points (%.3g %%) are at one position, %.15g %.15g: one vertex comes of them; if they are no "
		     "measurements, leave them out with --crop or an option of the view (--not-class, --zmin)",
		     term_count(p->most_points, count), term_count(all, points),
		     floor(1000 * (double)p->most_points / (double)all) / 10, p->most_at[0], p->most_at[1]);
}
