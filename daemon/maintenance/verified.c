/*
 * Time and result of the last verification: a line in the state folder, so that they are known after a restart. Nothing depends
 * on it: if it cannot be read or written, nothing else fails.
 */
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "io.h"
#include "maintenance_priv.h"
#include "log.h"

static const char *const name = "last-verify";
#define LINE "acut-verified 1 %" SCNd64 " %" SCNu64 " %" SCNu64 " %" SCNu64 " %" SCNu64
/* The number of files of a newer version follows only if there are some. */
#define LINE_WHOLE LINE " %c"
#define LINE_NEWER LINE " %" SCNu64 " %c"

void verified_load(struct maintenance *m)
{
	struct err err = ERR_INIT;
	struct verified v = {0};
	char text[160], end = 0;
	size_t n = 0;
	int fd;

	if (io_open(m->core->p.statefd, name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK, 0, &fd, &err))
		return; /* never verified */
	if (!io_read_some(fd, text, sizeof text - 1, 0, name, &n, &err)) {
		text[n] = 0;
		if ((sscanf(text, LINE_WHOLE, &v.at_us, &v.files, &v.bytes, &v.damaged, &v.derived, &end) == 6 && end == '.') ||
		    (sscanf(text, LINE_NEWER, &v.at_us, &v.files, &v.bytes, &v.damaged, &v.derived, &v.newer, &end) == 7 &&
		     end == '.'))
			m->verified = v;
	}
	io_close(fd);
}

struct note_task {
	struct sched_task task;
	struct maintenance *maintenance;
	struct verified v;
};

static void note_run(struct sched_task *t)
{
	const struct verified *v = &((struct note_task *)t)->v;
	int dirfd = ((struct note_task *)t)->maintenance->core->p.statefd, fd;
	struct err err = ERR_INIT;
	char text[160], newer[24] = "";
	int n, r = io_open(dirfd, "last-verify.tmp", O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW, 0600, &fd, &err);

	if (!r) {
		if (v->newer)
			snprintf(newer, sizeof newer, " %" PRIu64, v->newer);
		n = snprintf(text, sizeof text,
			     "acut-verified 1 %" PRId64 " %" PRIu64 " %" PRIu64 " %" PRIu64 " %" PRIu64 "%s .\n", v->at_us,
			     v->files, v->bytes, v->damaged, v->derived, newer);
		r = io_write_at(fd, text, (size_t)n, 0, name, &err);
		if (!r)
			r = io_publish(dirfd, fd, "last-verify.tmp", name, &err);
		else
			io->unlinkat(dirfd, "last-verify.tmp", 0);
		io_close(fd);
	}
	if (r)
		log_event_err(LOG_EVENT_STORE_FAILED, NULL, "the result of the verification is lost at the next start", &err);
}

static void note_done(struct sched_task *t)
{
	struct note_task *x = (struct note_task *)t;

	core_background_done(x->maintenance->core);
	free(x);
}

void verified_note(struct maintenance *m, const struct cache_verified *found)
{
	struct note_task *x = calloc(1, sizeof *x);

	m->verified = (struct verified){.at_us = clock_real_us(),
					.files = found->files,
					.bytes = found->bytes,
					.damaged = found->damaged,
					.derived = found->derived,
					.newer = found->newer};
	if (!x)
		return;
	x->task = (struct sched_task){.run = note_run, .done = note_done, .priority = SCHED_NORMAL};
	x->maintenance = m;
	x->v = m->verified;
	core_background(m->core, &x->task);
}
