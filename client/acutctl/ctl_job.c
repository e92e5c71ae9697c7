/*
 * Jobs as people and as programs read them, and the exit status that a job stands for.
 */
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ctl.h"
#include "term.h"
#include "parse.h"

/* A lattice as decimals. */
struct lattice_said {
	char of[256]; /* what the daemon said */
	char scale[2][DECIMAL_TEXT_SIZE], offset[3][DECIMAL_TEXT_SIZE];
	bool ok;
};

static bool lattice_say(const char *lattice, struct lattice_said *ret)
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

void ctl_job_lattice(struct term_json *j, const char *lattice)
{
	static struct lattice_said said; /* lists have the same one many times */

	if (lattice && strlen(lattice) < sizeof(said.of) && (!*said.of || strcmp(said.of, lattice))) {
		strcpy(said.of, lattice);
		said.ok = lattice_say(lattice, &said);
	}
	if (!lattice || strcmp(said.of, lattice) || !said.ok) {
		term_json_text(j, "lattice", NULL);
		return;
	}
	term_json_open(j, "lattice", '{');
	term_json_literal(j, "scale_xy", said.scale[0]);
	term_json_literal(j, "scale_z", said.scale[1]);
	term_json_open(j, "offset", '[');
	for (int i = 0; i < 3; i++)
		term_json_literal(j, NULL, said.offset[i]);
	term_json_close(j, ']');
	term_json_close(j, '}');
}

void ctl_job_units(struct term_json *j, const char *crs, const char *unit_xy, const char *unit_z)
{
	term_json_known(j, "crs", crs);
	term_json_open(j, "units", '{');
	term_json_known(j, "xy", unit_xy);
	term_json_known(j, "z", unit_z);
	term_json_close(j, '}');
}

void ctl_job_refused(struct term_json *j, const struct ctl_staged_file *f)
{
	term_error_json(j, NULL, &f->err);
}

/* All of it unknown. */
static void no_report(struct term_json *j)
{
	static const char *const key[] = {
		"points",          "used",           "vertices",    "triangles",  "hull",          "domains",
		"digest",          "vertex_digest",  "removed",     "seconds",    "stage_seconds", "first_triangle_seconds",
		"peak_rss_bytes",  "halo",           "points_read", "cells_read", "seal_seconds",  "plan_seconds",
		"domains_seconds", "domains_reused", "pieces",      "most"};

	for (size_t i = 0; i < sizeof(key) / sizeof(*key); i++)
		term_json_text(j, key[i], NULL);
}

char *ctl_job_domains(const struct acut_report *p, char *buf, size_t size)
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
		term_json_text(j, key, NULL);
	else
		term_json_u64(j, key, n);
}

static void put_removed(struct term_json *j, const struct acut_report *p)
{
	if (p->window) {
		term_json_text(j, "removed", NULL);
		return;
	}
	term_json_open(j, "removed", '{');
	for (size_t i = 0; i < p->nremoved; i++)
		term_json_u64(j, p->removed[i].rule, p->removed[i].count);
	term_json_close(j, '}');
}

void ctl_job_most(struct term_json *j, uint64_t points, const double at[2])
{
	if (!points) {
		term_json_text(j, "most", NULL);
		return;
	}
	term_json_open(j, "most", '{');
	term_json_u64(j, "points", points);
	term_json_number(j, "x", at[0]);
	term_json_number(j, "y", at[1]);
	term_json_close(j, '}');
}

/* Of a window what is of a whole mesh is not known. */
void ctl_job_report(struct term_json *j, const struct acut_report *p)
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
	if (p->triangles)
		term_json_number(j, "first_triangle_seconds", p->first_triangle_seconds);
	else
		term_json_text(j, "first_triangle_seconds", NULL);
	term_json_u64(j, "peak_rss_bytes", p->peak_rss_bytes);
	put_unless(j, p->window, "halo", p->halo);
	term_json_u64(j, "points_read", p->points_read);
	term_json_u64(j, "cells_read", p->cells_read);
	term_json_number(j, "seal_seconds", p->seal_seconds);
	term_json_number(j, "plan_seconds", p->plan_seconds);
	term_json_number(j, "domains_seconds", p->domains_seconds);
	put_unless(j, p->window, "domains_reused", p->domains_reused);
	put_unless(j, !p->window, "pieces", p->domains);
	ctl_job_most(j, p->most_points, p->most_at);
}

void ctl_job_notes(struct term_json *j, const struct acut_report *p)
{
	term_json_open(j, "notes", '[');
	if (p && *p->note)
		term_json_text(j, NULL, p->note);
	term_json_close(j, ']');
}

void ctl_job_json(struct program *ctl, const struct acut_job *job)
{
	struct term_json j = {.out = ctl->session.console.report, .list = ctl->session.console.list};
	struct err err;

	term_json_open(&j, NULL, '{');
	term_json_u64(&j, "job", job->id);
	term_json_known(&j, "dataset", job->dataset);
	term_json_u64(&j, "generation", job->generation);
	term_json_text(&j, "view", job->view);
	term_json_text(&j, "state", job->state);
	term_json_known(&j, "priority", job->priority);
	term_json_known(&j, "waiting", job->waiting);
	if (job->position)
		term_json_u64(&j, "position", job->position);
	else
		term_json_text(&j, "position", NULL);
	if (job->lacks_space)
		term_json_u64(&j, "lacks_space", job->lacks_space);
	else
		term_json_text(&j, "lacks_space", NULL);
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
	if (job->progress.seconds_left > 0)
		term_json_number(&j, "seconds_left", job->progress.seconds_left);
	else
		term_json_text(&j, "seconds_left", NULL);
	term_json_close(&j, '}');
	ctl_job_report(&j, job->has_report ? &job->report : NULL);
	if (job->has_error) {
		session_failure_of(&job->error, &err);
		term_error_json(&j, "error", &err);
	} else {
		term_json_text(&j, "error", NULL);
	}
	ctl_job_lattice(&j, job->lattice);
	ctl_job_units(&j, job->crs, job->unit_xy, job->unit_z);
	ctl_job_notes(&j, job->has_report ? &job->report : NULL);
	term_json_close(&j, '}');
	term_json_line(&j);
}

void ctl_job_print(struct program *ctl, const struct acut_job *job)
{
	char when[32], count[32], left[32], rest[256] = "";
	size_t n = 0;

	console_progress_clear(&ctl->session.console);
	if (ctl->session.console.json) {
		ctl_job_json(ctl, job);
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
	term_line(ctl->session.console.report, "%6llu  %-10s  %s  %s%s%s%s", (unsigned long long)job->id, job->state,
		  term_time(job->submitted_us, when), job->dataset, rest, job->has_error ? "  " : "",
		  job->has_error ? job->error.message : "");
	if (!ctl->session.console.list)
		fflush(ctl->session.console.report);
}

int ctl_job_status(struct program *ctl, const struct acut_job *job)
{
	struct err err = ERR_INIT;

	if (job->has_report && !job->has_error) {
		console_note(&ctl->session.console, "%s", job->report.note);
		return SESSION_DONE;
	}
	if (job->has_error)
		session_failure_of(&job->error, &err);
	else if (!strcmp(job->state, "cancelled"))
		err_set(&err, ERR_CANCELLED, "job %llu was cancelled", (unsigned long long)job->id);
	else
		err_set(&err, ERR_INTERNAL, "job %llu ended as %s, without a reason", (unsigned long long)job->id, job->state);
	return session_error(&ctl->session, &err);
}

int ctl_job_id(const char *text, uint64_t *ret, struct err *err)
{
	if (!parse_u64(text, ret) || !*ret)
		return err_set(err, ERR_USAGE, "\"%s\" is not the number of a job", text);
	return 0;
}

int ctl_job_each(struct program *ctl, int (*each)(struct program *, uint64_t id))
{
	int first = 0, status;

	for (unsigned i = 0; i < ctl->line.nword; i++) {
		struct err err = ERR_INIT;
		uint64_t id;

		if (ctl_job_id(ctl->line.word[i], &id, &err))
			return session_error(&ctl->session, &err);
	}
	status = session_connect(&ctl->session);
	if (status)
		return status;
	for (unsigned i = 0; i < ctl->line.nword; i++) {
		uint64_t id = 0;

		parse_u64(ctl->line.word[i], &id);
		status = each(ctl, id);
		first = first ? first : status;
		if (session_interrupted(&ctl->session))
			break;
	}
	return first;
}
