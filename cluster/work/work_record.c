/* Records of tasks, and of their failures. */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "io.h"
#include "parse.h"
#include "work_priv.h"

enum { NAME = 64 };

/* Those of a record in lines; `file` and `value` have room for all lines. */
static bool parse_record(struct work_in *in, struct work_record *r)
{
	uint64_t n;
	char *key, *rest, *end;

	while (work_in_line(in, &key, &rest)) {
		bool number = rest[0] >= '0' && rest[0] <= '9';

		n = strtoull(rest, &end, !strcmp(key, "attempt") ? 16 : 10);
		if (!strcmp(key, "file")) {
			if (!work_in_u64(&rest, &r->file[r->nfile].size))
				return false;
			r->file[r->nfile++].name = rest;
		} else if (!strcmp(key, "value")) {
			r->value[r->nvalue].key = rest;
			end = strchr(rest, ' ');
			if (!end)
				return false;
			*end = 0;
			r->value[r->nvalue++].text = end + 1;
		} else if (!strcmp(key, "phase")) {
			if (!work_phase_parse(rest, &r->phase))
				return false;
		} else if (!strcmp(key, "host")) {
			r->host = rest;
		} else if (!strcmp(key, "attempt")) {
			r->attempt = n;
		} else if (number && !strcmp(key, "task")) {
			r->task = (uint32_t)n;
		} else if (number && !strcmp(key, "begun")) {
			r->begun_us = (int64_t)n;
		} else if (number && !strcmp(key, "wall")) {
			r->wall = (double)n * 1e-6;
		} else if (number && !strcmp(key, "cpu")) {
			r->cpu = (double)n * 1e-6;
		} else if (number && !strcmp(key, "peak")) {
			r->peak = n;
		}
	}
	return r->host && r->attempt;
}

static int record_read(const struct work *w, enum work_phase phase, uint32_t task, bool wait, struct work_record **ret,
		       struct err *err)
{
	struct work_record *rec;
	struct work_in in;
	char name[NAME];
	size_t lines;
	int r;

	snprintf(name, sizeof name, "done/%s-%" PRIu32, work_phase_text(phase), task);
	r = work_in_read(w, name, "acut-record", wait, &in, err);
	if (r)
		return r;
	rec = calloc(1, sizeof *rec);
	lines = work_in_lines(&in);
	if (rec) {
		rec->text = in.text;
		rec->file = calloc(lines + 1, sizeof *rec->file);
		rec->value = calloc(lines + 1, sizeof *rec->value);
	} else {
		free(in.text);
	}
	if (!rec || !rec->file || !rec->value) {
		work_record_free(rec);
		return err_set(err, ERR_NOMEM, "no memory for a record");
	}
	if (!parse_record(&in, rec) || rec->phase != phase || rec->task != task) {
		work_record_free(rec);
		return work_corrupt(name, "it is damaged", err);
	}
	*ret = rec;
	return 0;
}

int work_record_look(const struct work *w, enum work_phase phase, uint32_t task, struct work_record **ret, struct err *err)
{
	return record_read(w, phase, task, false, ret, err);
}

int work_record_need(const struct work *w, enum work_phase phase, uint32_t task, struct work_record **ret, struct err *err)
{
	int r = record_read(w, phase, task, true, ret, err);

	if (r != WORK_E_ABSENT)
		return r;
	err_set(err, ERR_NOTFOUND, "task %" PRIu32 " of the phase %s, which this task needs, is not done", task,
		work_phase_text(phase));
	return err_add_hint(err, "'acut-cluster resume' runs what is missing");
}

struct work_record *work_record_free(struct work_record *r)
{
	if (!r)
		return NULL;
	free(r->file);
	free(r->value);
	free(r->text);
	free(r);
	return NULL;
}

const char *work_record_text(const struct work_record *r, const char *key)
{
	for (size_t i = 0; i < r->nvalue; i++)
		if (!strcmp(r->value[i].key, key))
			return r->value[i].text;
	return NULL;
}

int work_record_u64(const struct work_record *r, const char *key, uint64_t *ret, struct err *err)
{
	const char *text = work_record_text(r, key);

	if (text && parse_u64(text, ret))
		return 0;
	return err_set(err, ERR_CORRUPT, "the record of task %" PRIu32 " of the phase %s has no number '%s'", r->task,
		       work_phase_text(r->phase), key);
}

int work_forget(const struct work *w, enum work_phase phase, uint32_t task, struct err *err)
{
	char name[NAME];

	snprintf(name, sizeof name, "done/%s-%" PRIu32, work_phase_text(phase), task);
	return io_remove(w->fd, name, err);
}

bool work_record_lost(const struct work *w, const struct work_record *record)
{
	bool lost = false;

	for (size_t i = 0; i < record->nfile && !lost; i++) {
		struct stat st;

		if (io->fstatat(w->fd, record->file[i].name, &st, 0) < 0)
			lost = errno == ENOENT;
		else
			lost = (uint64_t)st.st_size != record->file[i].size;
	}
	return lost;
}

int work_failure_look(const struct work *w, enum work_phase phase, uint32_t task, struct work_failure *ret, struct err *err)
{
	char name[NAME], *key, *rest;
	struct work_in in;
	int r;

	*ret = (struct work_failure){0};
	snprintf(name, sizeof name, "failed/%s-%" PRIu32, work_phase_text(phase), task);
	r = work_in_read(w, name, "acut-failure", false, &in, err);
	if (r)
		return r;
	while (work_in_line(&in, &key, &rest)) {
		if (!strcmp(key, "times"))
			ret->times = (uint32_t)strtoul(rest, NULL, 10);
		else if (!strcmp(key, "at"))
			ret->at_us = strtoll(rest, NULL, 10);
		else if (!strcmp(key, "host"))
			snprintf(ret->host, sizeof ret->host, "%s", rest);
		else if (!strcmp(key, "code"))
			snprintf(ret->code, sizeof ret->code, "%s", rest);
		else if (!strcmp(key, "message"))
			snprintf(ret->message, sizeof ret->message, "%s", rest);
	}
	free(in.text);
	return 0;
}

int work_failure_forget(const struct work *w, enum work_phase phase, uint32_t task, struct err *err)
{
	char name[NAME];

	snprintf(name, sizeof name, "failed/%s-%" PRIu32, work_phase_text(phase), task);
	return io_remove(w->fd, name, err);
}
