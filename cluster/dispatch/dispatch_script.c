/*
 * A script for any other scheduler: the commands of all tasks that have no record, a line each, phase by phase. What is between
 * two lines "# phase NAME" may run in any order and at once; all of it must have succeeded before the next phase begins. As it
 * is, sh runs it one task after the other, and ends at the first that fails. acut-cluster(1) has the format.
 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "dispatch_priv.h"
#include "err.h"

struct script {
	char *text;
	size_t size;
	FILE *to;
};

static int begin(struct dispatch *d, struct err *err)
{
	struct script *s = d->own = calloc(1, sizeof *s);

	if (s)
		s->to = open_memstream(&s->text, &s->size);
	return s && s->to ? 0 : err_set(err, ERR_NOMEM, "no memory for a script");
}

static void end(struct dispatch *d)
{
	struct script *s = d->own;

	if (s && s->to)
		fclose(s->to);
	if (s)
		free(s->text);
	free(s);
}

static int submit(struct dispatch *d, unsigned phase, const uint32_t *index, uint32_t n, const struct dispatch_need *need,
		  struct err *err)
{
	struct script *s = d->own;
	const struct dispatch_phase *p = &d->phase[phase];

	if (!ftell(s->to))
		fprintf(s->to, "#!/bin/sh\n# The tasks of acut-cluster %s, see acut-cluster(1), SCRIPT.\nset -e\n", d->o.id);
	fprintf(s->to, "# phase %s: %u tasks, %llu MiB and %.0f s each at most\n", p->name, n,
		(unsigned long long)((need->memory + (1 << 20) - 1) >> 20), need->time);
	for (uint32_t i = 0; i < n; i++) {
		dispatch_quote(s->to, d->o.task);
		fputc(' ', s->to);
		dispatch_quote(s->to, d->o.work);
		fprintf(s->to, " %s %u\n", p->name, index[i]);
		d->task[phase][index[i]].state = DISPATCH_WAITING;
	}
	return 0;
}

static int write_file(const struct dispatch *d, const struct script *s, struct err *err)
{
	FILE *f = fopen(d->o.script, "we");

	if (!f || fwrite(s->text, 1, s->size, f) != s->size || fflush(f) || fchmod(fileno(f), 0755) || fsync(fileno(f))) {
		err_sys(err, errno, "the script cannot be written");
		err_add_file(err, d->o.script);
	}
	if (f)
		fclose(f);
	return -(int)err->code;
}

static int submitted(struct dispatch *d, struct err *err)
{
	struct script *s = d->own;

	if (!d->o.script || fflush(s->to) || !s->size)
		return 0;
	return write_file(d, s, err);
}

static void pause_script(struct dispatch *d)
{
	dispatch_sleep(d, d->o.poll);
}

static void log_name(const struct dispatch *d, unsigned phase, uint32_t index, char buf[96])
{
	snprintf(buf, 96, "%s-%u", d->phase[phase].name, index);
}

const struct dispatch_scheduler dispatch_script = {
	.name = "script",
	.begin = begin,
	.end = end,
	.submit = submit,
	.submitted = submitted,
	.pause = pause_script,
	.log_name = log_name,
	.never_lost = true,
};
