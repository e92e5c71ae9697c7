/* plan: what a job would take; starts nothing. */
#include <math.h>
#include <stdlib.h>

#include "ctl.h"
#include "term.h"
#include "parse.h"

static void print(FILE *out, const struct acut_plan *p)
{
	char a[32], b[32];

	term_field(out, "points", "%s%s", p->exact ? "" : "at most ", term_count(p->points, a));
	term_field(out, "domains", "%s of at most %s points, %u at once", term_count(p->domains, a), term_count(p->load, b),
		   p->threads);
	if (p->domains_reused)
		term_field(out, "", "%s of them are there already", term_count(p->domains_reused, a));
	term_field(out, "memory", "%s", parse_size_text(p->memory_bytes, a));
	term_field(out, "disk", "%s", parse_size_text(p->disk_bytes, a));
	if (p->seconds > 0)
		term_field(out, "time", "about %.0f s", p->seconds);
	else
		term_field(out, "time", "not known");
}

static void print_json(const struct console *c, const char *dataset, const struct acut_plan *p, const char *note)
{
	struct term_json j = console_json(c);

	term_json_text(&j, "dataset", dataset);
	term_json_u64(&j, "points", p->points);
	term_json_bool(&j, "exact", p->exact);
	term_json_u64(&j, "domains", p->domains);
	term_json_u64(&j, "domains_reused", p->domains_reused);
	term_json_u64(&j, "load", p->load);
	term_json_u64(&j, "threads", p->threads);
	term_json_u64(&j, "memory_bytes", p->memory_bytes);
	term_json_u64(&j, "disk_bytes", p->disk_bytes);
	term_json_number(&j, "seconds", p->seconds > 0 ? p->seconds : NAN);
	ctl_report_notes(&j, NULL, note, "");
	term_json_end(&j);
}

/* As of a job; the answer of a plan has no lattice. */
static int find_note(struct program *ctl, char note[CTL_MESH_NOTE])
{
	struct acut_dataset dataset;
	struct acut_job job = {.view = ""};

	*note = 0;
	if (!ctl->view.max_error)
		return 0;
	if (acut_dataset_at(ctl->session.acut, ctl->line.word[0], ctl->opt.generation, &dataset))
		return session_error_acut(&ctl->session);
	job.lattice = dataset.lattice;
	job.unit_z = dataset.unit_z;
	ctl_fetch_bound(&job, ctl->view.max_error, note);
	return 0;
}

int ctl_plan_run(struct program *ctl)
{
	struct session *session = &ctl->session;
	const struct acut_plan *plan;
	struct acut_plan kept;
	char *view, note[CTL_MESH_NOTE];
	struct err err = ERR_INIT;
	int status;

	if (ctl_view_text(&ctl->view, &view, &err))
		return session_error(session, &err);
	status = session_connect(session);
	if (!status && acut_plan(session->acut, ctl->line.word[0], ctl->opt.generation, view, &plan))
		status = session_error_acut(session);
	free(view);
	if (status)
		return status;
	kept = *plan;
	status = find_note(ctl, note);
	if (status)
		return status;
	console_note(&session->console, "%s", note);
	if (session->console.json)
		print_json(&session->console, ctl->line.word[0], &kept, note);
	else
		print(session->console.report, &kept);
	return SESSION_DONE;
}
