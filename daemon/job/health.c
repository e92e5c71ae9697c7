/*
 * A look at what lies under the service: file systems, geoid grids, the process itself. By a worker, since a disk may take its
 * time.
 *
 * The model: one look at a time, and one a second: whoever asks while one is under way gets what it sees, and so does who asks
 * within a second of its beginning. So many who ask at once, or one after the other, cost no more than one. Grids that are
 * added or removed make what was seen worthless: then whoever asks next waits for another look.
 */
#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>

#include "clock.h"
#include "geoids.h"
#include "io.h"
#include "job_priv.h"

#define LASTS_NS UINT64_C(1000000000)

/* Who waits for a look. */
struct look_wait {
	struct look_wait *next;
	struct peer peer;
	void (*answer)(void *token, const struct err *why, const struct health *);
	void *token;
};

struct looking {
	struct sched_task task;
	struct jobs *jobs;
	uint64_t begun_ns;
	bool stale; /* something changed since it began */
	struct health found;
	struct look_wait *waits;
};

static void look_side(int fd, struct health_side *ret)
{
	struct statvfs vfs;

	*ret = (struct health_side){0};
	if (io->fstatvfs(fd, &vfs) != 0) {
		ret->sys = errno;
		return;
	}
	ret->free = (uint64_t)vfs.f_bavail * vfs.f_frsize;
	ret->total = (uint64_t)vfs.f_blocks * vfs.f_frsize;
	ret->files_free = (uint64_t)vfs.f_favail;
	ret->files = (uint64_t)vfs.f_files;
	ret->read_only = vfs.f_flag & ST_RDONLY;
}

static unsigned open_files(void)
{
	DIR *dir = opendir("/proc/self/fd");
	unsigned n = 0;

	while (dir && readdir(dir))
		n++;
	if (dir)
		closedir(dir);
	return n > 3 ? n - 3 : 0; /* ".", "..", and the folder itself */
}

static unsigned threads(void)
{
	unsigned n = 0;
	char line[128];
	FILE *f = fopen("/proc/self/status", "re");

	while (f && fgets(line, sizeof line, f) && sscanf(line, "Threads: %u", &n) != 1)
		;
	if (f)
		fclose(f);
	return n;
}

static void look_run(struct sched_task *t)
{
	struct looking *l = (struct looking *)t;
	struct err err = ERR_INIT;

	look_side(l->jobs->core->p.statefd, &l->found.state);
	look_side(l->jobs->core->p.cachefd, &l->found.cache);
	l->found.open_files = open_files();
	l->found.threads = threads();
	if (geoids_look(l->jobs->geoidsfd, &l->found.geoids, &l->found.geoids_bad, &err) || err.code)
		err_format(&err, l->found.geoid_why, sizeof l->found.geoid_why);
}

static void answer_all(struct look_wait *w, const struct err *why, const struct health *found)
{
	struct look_wait *next;

	for (; w; w = next) {
		next = w->next;
		w->answer(w->token, why, found);
		free(w);
	}
}

static void look(struct jobs *j);

static void look_done(struct sched_task *t)
{
	struct looking *l = (struct looking *)t;
	struct looks *looks = &l->jobs->looks;
	struct err err = ERR_INIT;

	core_background_over(l->jobs->core);
	looks->now = NULL;
	if (!t->ran) {
		err_set(&err, ERR_CANCELLED, "the daemon is stopping");
	} else if (!l->stale) {
		looks->last = l->found;
		looks->last_ns = l->begun_ns;
	}
	answer_all(l->waits, err.code ? &err : NULL, &l->found);
	if (looks->next && !looks->now)
		look(l->jobs);
	free(l);
}

/* For all who wait. */
static void look(struct jobs *j)
{
	struct looking *l = calloc(1, sizeof *l);
	struct look_wait *waits = j->looks.next;
	struct err err = ERR_INIT;

	j->looks.next = NULL;
	if (!l) {
		err_set(&err, ERR_NOMEM, "no memory for a look");
		answer_all(waits, &err, NULL);
		return;
	}
	l->task = (struct sched_task){.run = look_run,
				      .done = look_done,
				      .priority = SCHED_FIRST,
				      .owner = {.uid = waits->peer.uid, .flow = ++j->core->last_flow}};
	l->jobs = j;
	l->begun_ns = clock_mono_ns();
	l->waits = waits;
	j->looks.now = l;
	core_background(j->core, &l->task);
}

void health_changed(struct jobs *j)
{
	j->looks.last_ns = 0;
	if (j->looks.now)
		j->looks.now->stale = true;
}

void health_check(struct jobs *j, const struct peer *peer,
		  void (*answer)(void *token, const struct err *why, const struct health *), void *token)
{
	struct looks *looks = &j->looks;
	struct err err = ERR_INIT;
	struct look_wait *w, **to;

	if (looks->last_ns && clock_mono_ns() - looks->last_ns < LASTS_NS) {
		answer(token, NULL, &looks->last);
		return;
	}
	w = calloc(1, sizeof *w);
	if (!w) {
		err_set(&err, ERR_NOMEM, "no memory for a look");
		answer(token, &err, NULL);
		return;
	}
	*w = (struct look_wait){.peer = rights_kept(peer), .answer = answer, .token = token};
	to = looks->now && !looks->now->stale ? &looks->now->waits : &looks->next;
	w->next = *to;
	*to = w;
	if (!looks->now)
		look(j);
}
