/*
 * show: how far a run is, from its records, its logs and the scheduler; no accounting is asked. The scheduler is asked once.
 */
#include <stdlib.h>
#include <string.h>

#include "cluster.h"

static void count_again(struct cluster_phase_state *s, enum dispatch_why why, const char *host)
{
	s->again++;
	for (uint32_t i = 0; i < s->nagain; i++)
		if (s->why[i].why == why && !strcmp(s->why[i].host, host)) {
			s->why[i].tasks++;
			return;
		}
	if (s->nagain == CLUSTER_AGAIN)
		return;
	s->why[s->nagain].why = why;
	s->why[s->nagain].tasks = 1;
	snprintf(s->why[s->nagain++].host, sizeof s->why[0].host, "%s", host);
}

/* A task of which an attempt has ended without a record. */
static void look_again(const struct cluster_run *r, unsigned phase, uint32_t index, struct cluster_phase_state *s)
{
	const struct dispatch_task *t = dispatch_task(r->dispatch, phase, index);
	struct dispatch_log log;

	if (!dispatch_log_read(r->dispatch, phase, index, &log) || !log.begun)
		return;
	if (t->done || (t->state == DISPATCH_RUNNING && !log.ended)) {
		if (log.begun > 1)
			count_again(s, log.before, log.host_before);
	} else {
		count_again(s, log.why, log.host);
	}
}

void cluster_phase_state(const struct cluster_run *r, unsigned phase, struct cluster_phase_state *ret)
{
	const enum work_phase p = r->phase[phase];
	struct cluster_phase_state s = {
		.name = work_phase_text(p), .tasks = r->size.tasks[p], .counts = dispatch_counts(r->dispatch, phase)};

	for (uint32_t i = 0; i < s.tasks; i++) {
		struct work_record *record;
		struct err err = ERR_INIT;

		look_again(r, phase, i, &s);
		if (dispatch_task(r->dispatch, phase, i)->done && !work_record_look(r->work, p, i, &record, &err)) {
			s.cpu += record->cpu;
			s.wall += record->wall;
			s.peak = record->peak > s.peak ? record->peak : s.peak;
			work_record_free(record);
		}
	}
	*ret = s;
}

/* ---- what it is like ---- */

static const char *state_of(const struct cluster_run *r, const struct cluster_phase_state *s)
{
	uint32_t running = 0, waiting = 0;

	if (cluster_run_done(r))
		return "done";
	for (unsigned p = 0; p < r->nphase; p++) {
		running += s[p].counts.running;
		waiting += s[p].counts.waiting;
	}
	return running ? "running" : waiting ? "waiting" : work_cancelled(r->work) ? "cancelled" : "stopped";
}

static void put_again(FILE *to, const struct cluster_phase_state *s)
{
	fprintf(to, ", %u again (", s->again);
	for (uint32_t i = 0; i < s->nagain; i++) {
		const struct cluster_again *a = &s->why[i];

		if (a->why == DISPATCH_WHY_NODE && a->host[0])
			fprintf(to, "%snode %s lost", i ? ", " : "", a->host);
		else
			fprintf(to, "%s%s%s%s", i ? ", " : "", dispatch_why_text(a->why), a->host[0] ? " on " : "", a->host);
	}
	fputc(')', to);
}

static void put_phase(FILE *to, const struct cluster_phase_state *s)
{
	char *text = NULL;
	size_t size;
	FILE *f = open_memstream(&text, &size);

	if (!f)
		return;
	fprintf(f, "phase %s %u/%u done", s->name, s->counts.done, s->tasks);
	if (s->counts.running)
		fprintf(f, ", %u running", s->counts.running);
	if (s->counts.waiting)
		fprintf(f, ", %u waiting", s->counts.waiting);
	if (s->counts.absent)
		fprintf(f, ", %u missing", s->counts.absent);
	if (s->again)
		put_again(f, s);
	if (!fclose(f))
		term_line(to, "%s", text);
	free(text);
}

static double hours(const struct cluster_run *r, const struct cluster_phase_state *s)
{
	double cpu = 0;

	for (unsigned p = 0; p < r->nphase; p++)
		cpu += s[p].cpu;
	return cpu / 3600;
}

/* The rest as estimated, what is done as it was. */
static double hours_expected(const struct cluster_run *r, const struct cluster_phase_state *s)
{
	double all = 0;

	for (unsigned p = 0; p < r->nphase; p++) {
		const double part = s[p].tasks ? (double)s[p].counts.done / s[p].tasks : 1;

		all += part > 0.1 ? s[p].cpu / 3600 / part : r->size.hours[r->phase[p]];
	}
	return all;
}

static void put_trouble(void *ctx, const char *what, const char *command)
{
	if (*command)
		term_line(ctx, "%s; to mend it: %s", what, command);
	else
		term_line(ctx, "%s", what);
}

/* Why tasks fail that have no record, as they told themselves. */
static void put_failures(const struct cluster_run *r, FILE *to)
{
	unsigned printed = 0;

	for (unsigned p = 0; p < r->nphase; p++)
		for (uint32_t i = 0; i < r->size.tasks[r->phase[p]] && printed < 3; i++) {
			struct work_failure f;
			struct err err = ERR_INIT;

			if (dispatch_task(r->dispatch, p, i)->done || work_failure_look(r->work, r->phase[p], i, &f, &err))
				continue;
			term_line(to, "%s %u failed on %s: %s", work_phase_text(r->phase[p]), i, f.host, f.message);
			printed++;
		}
}

static void as_text(struct cluster_run *r, const struct cluster_phase_state *s)
{
	FILE *to = r->program->session.console.report;
	size_t n, nreason;
	uint32_t *job = dispatch_jobs(r->dispatch, &n);
	const struct dispatch_reason *reason = dispatch_reasons(r->dispatch, &nreason);
	char list[300] = "";
	size_t used = 0;

	for (unsigned p = 0; p < r->nphase; p++)
		put_phase(to, &s[p]);
	for (size_t i = 0; i < n && used < sizeof list - 20; i++)
		used += (size_t)snprintf(list + used, sizeof list - used, "%s%u", i ? " " : "", job[i]);
	term_line(to, "%s; %.2f core-hours of about %.2f; %s%s%s", state_of(r, s), hours(r, s), hours_expected(r, s),
		  r->own.opt.on, n ? " " : "", list);
	for (size_t i = 0; i < nreason; i++)
		if (strcmp(reason[i].text, "None") && strcmp(reason[i].text, "Dependency"))
			term_line(to, "%u wait: %s", reason[i].n, reason[i].text);
	dispatch_troubles(r->dispatch, put_trouble, to);
	put_failures(r, to);
	free(job);
	cluster_run_warn(r);
	if (cluster_run_done(r))
		cluster_run_report_text(r);
}

/* ---- JSON ---- */

static void json_phase(struct term_json *j, const struct cluster_run *r, unsigned p, const struct cluster_phase_state *s)
{
	term_json_open(j, NULL, '{');
	term_json_text(j, "phase", s->name);
	term_json_u64(j, "tasks", s->tasks);
	term_json_u64(j, "done", s->counts.done);
	term_json_u64(j, "running", s->counts.running);
	term_json_u64(j, "waiting", s->counts.waiting);
	term_json_u64(j, "missing", s->counts.absent);
	term_json_u64(j, "again", s->again);
	term_json_open(j, "why", '[');
	for (uint32_t i = 0; i < s->nagain; i++) {
		term_json_open(j, NULL, '{');
		term_json_text(j, "why", dispatch_why_text(s->why[i].why));
		term_json_known(j, "host", s->why[i].host);
		term_json_u64(j, "tasks", s->why[i].tasks);
		term_json_close(j, '}');
	}
	term_json_close(j, ']');
	term_json_number(j, "core_hours", s->cpu / 3600);
	term_json_number(j, "core_hours_expected", r->size.hours[r->phase[p]]);
	term_json_known_u64(j, "peak", s->peak);
	term_json_close(j, '}');
}

static void json_trouble(void *ctx, const char *what, const char *command)
{
	struct term_json *j = ctx;

	term_json_open(j, NULL, '{');
	term_json_text(j, "what", what);
	term_json_known(j, "command", command);
	term_json_close(j, '}');
}

static void json_failures(struct term_json *j, const struct cluster_run *r)
{
	for (unsigned p = 0; p < r->nphase; p++)
		for (uint32_t i = 0; i < r->size.tasks[r->phase[p]]; i++) {
			struct work_failure f;
			struct err err = ERR_INIT;

			if (dispatch_task(r->dispatch, p, i)->done || work_failure_look(r->work, r->phase[p], i, &f, &err))
				continue;
			term_json_open(j, NULL, '{');
			term_json_text(j, "phase", work_phase_text(r->phase[p]));
			term_json_u64(j, "task", i);
			term_json_u64(j, "times", f.times);
			term_json_text(j, "host", f.host);
			term_json_text(j, "code", f.code);
			term_json_text(j, "message", f.message);
			term_json_close(j, '}');
		}
}

static void as_json(struct cluster_run *r, const struct cluster_phase_state *s, const struct err *unanswered)
{
	struct term_json j = console_json(&r->program->session.console);
	size_t n, nreason;
	uint32_t *job = dispatch_jobs(r->dispatch, &n);
	const struct dispatch_reason *reason = dispatch_reasons(r->dispatch, &nreason);

	term_json_text(&j, "work", r->folder);
	term_json_text(&j, "id", r->id);
	term_json_text(&j, "scheduler", r->own.opt.on);
	term_json_text(&j, "state", state_of(r, s));
	term_json_open(&j, "phases", '[');
	for (unsigned p = 0; p < r->nphase; p++)
		json_phase(&j, r, p, &s[p]);
	term_json_close(&j, ']');
	term_json_number(&j, "core_hours", hours(r, s));
	term_json_number(&j, "core_hours_expected", hours_expected(r, s));
	term_json_open(&j, "jobs", '[');
	for (size_t i = 0; i < n; i++)
		term_json_u64(&j, NULL, job[i]);
	term_json_close(&j, ']');
	term_json_open(&j, "reasons", '[');
	for (size_t i = 0; i < nreason; i++) {
		term_json_open(&j, NULL, '{');
		term_json_text(&j, "reason", reason[i].text);
		term_json_u64(&j, "tasks", reason[i].n);
		term_json_close(&j, '}');
	}
	term_json_close(&j, ']');
	term_json_open(&j, "troubles", '[');
	if (unanswered->code)
		json_trouble(&j, unanswered->message, "");
	dispatch_troubles(r->dispatch, json_trouble, &j);
	term_json_close(&j, ']');
	term_json_open(&j, "failures", '[');
	json_failures(&j, r);
	term_json_close(&j, ']');
	cluster_run_report_json(r, &j);
	term_json_end(&j);
	free(job);
}

int cluster_show_run(struct program *p)
{
	struct cluster_phase_state state[WORK_PHASES];
	struct cluster_run r;
	struct err err = ERR_INIT;
	int e = cluster_run_open(p, p->line.word[0], CLUSTER_LOOKS, NULL, &r, &err);

	if (e)
		return session_error(&p->session, &err);
	e = dispatch_look(r.dispatch, &err);
	if (e && e != -ERR_BUSY && e != -ERR_NODAEMON) {
		cluster_run_close(&r);
		return session_error(&p->session, &err);
	}
	if (e)
		console_warn(&p->session.console, "%s: only the records count", err.message);
	for (unsigned i = 0; i < r.nphase; i++)
		cluster_phase_state(&r, i, &state[i]);
	if (p->session.console.json)
		as_json(&r, state, &err);
	else
		as_text(&r, state);
	cluster_run_close(&r);
	return 0;
}
