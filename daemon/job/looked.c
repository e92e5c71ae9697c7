/*
 * A look at what lies under the house: file systems and geoid grids, by a worker, since a disk may take its time.
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>

#include "geoids.h"
#include "io.h"
#include "job_priv.h"

struct looking {
	struct sched_task task;
	struct jobs *jobs;
	struct house_looked found;
	void (*answer)(void *token, const struct err *why, const struct house_looked *);
	void *token;
};

static void look_side(int fd, struct house_side *ret)
{
	struct statvfs vfs;

	*ret = (struct house_side){0};
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

static void look_run(struct sched_task *t)
{
	struct looking *l = (struct looking *)t;
	struct err err = ERR_INIT;

	look_side(l->jobs->p.statefd, &l->found.state);
	look_side(l->jobs->p.cachefd, &l->found.cache);
	if (geoids_look(l->jobs->geoidsfd, &l->found.geoids, &l->found.geoids_bad, &err) || err.code)
		err_format(&err, l->found.geoid_why, sizeof l->found.geoid_why);
}

static void look_done(struct sched_task *t)
{
	struct looking *l = (struct looking *)t;
	struct err err = ERR_INIT;

	l->jobs->background--;
	if (!t->ran)
		err_set(&err, ERR_CANCELLED, "the daemon is stopping");
	l->answer(l->token, err.code ? &err : NULL, &l->found);
	free(l);
}

void house_look(struct jobs *j, const struct job_peer *peer,
		void (*answer)(void *token, const struct err *why, const struct house_looked *), void *token)
{
	struct looking *l = calloc(1, sizeof *l);
	struct err err = ERR_INIT;

	if (!l) {
		err_set(&err, ERR_NOMEM, "no memory for a look");
		answer(token, &err, NULL);
		return;
	}
	l->task = (struct sched_task){.run = look_run, .done = look_done, .priority = SCHED_FIRST,
				      .owner = {.uid = peer->uid, .flow = ++j->last_flow}};
	l->jobs = j;
	l->answer = answer;
	l->token = token;
	j->background++;
	sched_submit(j->p.sched, &l->task);
}
