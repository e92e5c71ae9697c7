/*
 * A script for any other scheduler: the commands of all tasks that have no record, a line each, phase by phase. What is between
 * two lines "# phase NAME" may run in any order and at once; all of it must have succeeded before the next phase begins. As it
 * is, sh runs it one task after the other, and ends at the first that fails. acut-cluster(1) has the format.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "dispatch_priv.h"
#include "err.h"

/* By these a script is known. */
#define FIRST "#!/bin/sh\n"
#define SECOND "# The tasks of acut-cluster "

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
		fprintf(s->to, FIRST SECOND "%s, see acut-cluster(1), SCRIPT.\nset -e\n", d->o.id);
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

static int refuse(const char *path, struct err *err)
{
	err_set(err, ERR_CONFLICT, "it is no script of acut-cluster, and is not overwritten");
	err_add_file(err, path);
	return err_add_hint(err, "--script FILE names another file");
}

/* Only a script of ours is overwritten, or an empty file. */
static int check_file(const char *path, struct err *err)
{
	char text[sizeof FIRST + sizeof SECOND];
	struct stat st;
	ssize_t n;
	int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);

	if (fd < 0 && errno == ENOENT)
		return 0;
	if (fd < 0 || fstat(fd, &st)) {
		err_sys(err, errno, "the script cannot be opened");
		if (fd >= 0)
			close(fd);
		return err_add_file(err, path);
	}
	n = S_ISREG(st.st_mode) ? read(fd, text, sizeof text - 1) : -1;
	close(fd);
	if (n < 0)
		return refuse(path, err);
	text[n] = 0;
	return !n || !strncmp(text, FIRST SECOND, strlen(FIRST SECOND)) ? 0 : refuse(path, err);
}

static int check(const char *work, const char *script, struct err *err)
{
	if (dispatch_path_has(work, '\n'))
		return err_set(err, ERR_USAGE,
			       "a script has a command a line: the path of the work folder may have no line feed");
	return script ? check_file(script, err) : 0;
}

/* It has its name when it is complete. */
static int write_file(const struct dispatch *d, const struct script *s, struct err *err)
{
	const char *path = d->o.script;
	char temp[4200];
	int fd, r = check_file(path, err);
	FILE *f;

	if (r)
		return r;
	snprintf(temp, sizeof temp, "%s.XXXXXX", path);
	fd = mkostemp(temp, O_CLOEXEC);
	f = fd >= 0 ? fdopen(fd, "w") : NULL;
	if (!f || fwrite(s->text, 1, s->size, f) != s->size || fflush(f) || fchmod(fd, 0755) || fsync(fd) || rename(temp, path)) {
		err_sys(err, errno, "the script cannot be written");
		err_add_file(err, path);
		if (fd >= 0)
			unlink(temp);
	}
	if (f)
		fclose(f);
	else if (fd >= 0)
		close(fd);
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
	.check = check,
	.begin = begin,
	.end = end,
	.submit = submit,
	.submitted = submitted,
	.pause = pause_script,
	.log_name = log_name,
	.never_lost = true,
};
