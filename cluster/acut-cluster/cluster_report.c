/*
 * What a run has to say at its end, and before: its warnings, and the report of its last phase. Both lie in the work folder, by
 * records; clean removes them.
 */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cluster.h"
#include "io.h"

enum { WARNINGS_MOST = 20 };

/* ---- warnings ---- */

static bool is_unknown(const struct work_record *record, const char *key)
{
	const char *text = work_record_text(record, key);

	return text && !strcmp(text, "unknown");
}

static void warn_head(const struct cluster_run *r, struct console *c)
{
	struct work_record *record;
	struct err err = ERR_INIT;
	struct ctl_assume a = {NULL};
	const char *note;

	if (!r->size.tasks[WORK_HEAD] || work_record_look(r->work, WORK_HEAD, 0, &record, &err))
		return;
	a.no_crs = is_unknown(record, "crs");
	a.no_unit_xy = is_unknown(record, "unit_xy");
	a.no_unit_z = is_unknown(record, "unit_z");
	ctl_assume_warn(c, &a);
	note = work_record_text(record, "note");
	if (note && *note)
		console_warn(c, "%s", note);
	work_record_free(record);
}

static void warn_stages(const struct cluster_run *r, struct console *c)
{
	static const char head[] = "warning-";
	uint64_t all = 0, told = 0;

	for (uint32_t i = 0; i < r->size.tasks[WORK_STAGE]; i++) {
		struct work_record *record;
		struct err err = ERR_INIT;
		uint64_t n = 0;

		if (work_record_look(r->work, WORK_STAGE, i, &record, &err))
			continue;
		if (!work_record_u64(record, "warnings", &n, &err))
			all += n;
		for (size_t k = 0; n && k < record->nvalue && told < WARNINGS_MOST; k++)
			if (!strncmp(record->value[k].key, head, sizeof head - 1)) {
				console_warn(c, "%s", record->value[k].text);
				told++;
			}
		work_record_free(record);
	}
	if (all > told)
		console_warn(c, "%llu more warnings of inputs are in the records of stage, in %s/done",
			     (unsigned long long)(all - told), r->folder);
}

static void warnings(const struct cluster_run *r, struct console *c)
{
	warn_head(r, c);
	warn_stages(r, c);
}

void cluster_run_warn(const struct cluster_run *r)
{
	warnings(r, &r->program->session.console);
}

/* ---- the report ---- */

/* The file of a record, of which the name ends so; NULL: there is none, or it cannot be read. */
static char *read_file(const struct cluster_run *r, const struct work_record *record, const char *end)
{
	for (size_t i = 0; i < record->nfile; i++) {
		const struct work_file *f = &record->file[i];
		const size_t n = strlen(f->name), k = strlen(end);
		struct err err = ERR_INIT;
		char *text;
		int fd, e;

		if (n < k || strcmp(f->name + n - k, end) || work_file_open(r->work, f->name, f->size, &fd, &err))
			continue;
		text = malloc((size_t)f->size + 1);
		e = text ? io_read_at(fd, text, (size_t)f->size, 0, f->name, &err) : -ERR_NOMEM;
		io_close(fd);
		if (e) {
			free(text);
			return NULL;
		}
		text[f->size] = 0;
		return text;
	}
	return NULL;
}

static struct work_record *last_record(const struct cluster_run *r)
{
	struct work_record *record = NULL;
	struct err err = ERR_INIT;

	return work_record_look(r->work, r->phase[r->nphase - 1], 0, &record, &err) ? NULL : record;
}

void cluster_run_report_json(const struct cluster_run *r, struct term_json *j)
{
	struct console kept = {.program = "acut-cluster", .json = true, .keeps_warnings = true};
	struct work_record *record = last_record(r);
	char *report = record ? read_file(r, record, ".json") : NULL;

	if (record)
		term_json_open(j, "result", '{');
	else
		term_json_null(j, "result");
	for (size_t i = 0; record && i < record->nvalue; i++)
		term_json_text(j, record->value[i].key, record->value[i].text);
	if (record)
		term_json_close(j, '}');
	if (report) {
		report[strcspn(report, "\n")] = 0;
		term_json_literal(j, "report", report);
	} else {
		term_json_null(j, "report");
	}
	warnings(r, &kept);
	term_json_open(j, "warnings", '[');
	for (size_t i = 0; i < kept.nwarning; i++) {
		term_json_text(j, NULL, kept.warning[i]);
		free(kept.warning[i]);
	}
	term_json_close(j, ']');
	free(kept.warning);
	free(report);
	work_record_free(record);
}

void cluster_run_report_text(const struct cluster_run *r)
{
	struct console *c = &r->program->session.console;
	struct work_record *record = c->quiet ? NULL : last_record(r);
	char *report = record ? read_file(r, record, ".txt") : NULL;

	if (report)
		fputs(report, c->report);
	for (size_t i = 0; record && !report && i < record->nvalue; i++)
		term_field(c->report, record->value[i].key, "%s", record->value[i].text);
	free(report);
	work_record_free(record);
}

void cluster_run_result(const struct cluster_run *r)
{
	struct console *c = &r->program->session.console;
	struct term_json j;

	if (!c->json) {
		cluster_run_warn(r);
		cluster_run_report_text(r);
		return;
	}
	j = console_json(c);
	term_json_text(&j, "work", r->folder);
	term_json_text(&j, "state", "done");
	cluster_run_report_json(r, &j);
	term_json_end(&j);
}
