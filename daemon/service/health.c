/*
 * What a worker sees of file systems, geoid grids and this process. By a worker, since a disk may take its time.
 *
 * The model: one check at a time, and one a second. Whoever asks while one is under way gets what it sees, and so does whoever
 * asks within a second of its beginning: many who ask at once cost no more than one. A grid that is added or removed makes what
 * was seen worthless; whoever asks next waits for another check.
 */
#include <errno.h>
#include <stdlib.h>
#include <sys/statvfs.h>

#include "clock.h"
#include "health.h"
#include "io.h"
#include "process.h"
#include "service.h"

#define LASTS_NS UINT64_C(1000000000)

/* Somebody who waits for a check. */
struct check_wait {
	struct check_wait *next;
	struct peer peer;
	void (*answer)(void *token, const struct err *why, const struct health *);
	void *token;
};

int health_new(struct health_state **ret, struct err *err)
{
	*ret = calloc(1, sizeof **ret);
	return *ret ? 0 : err_set(err, ERR_NOMEM, "no memory for the daemon");
}

struct health_state *health_free(struct health_state *h)
{
	free(h);
	return NULL;
}

struct check {
	struct sched_task task;
	struct service *service;
	uint64_t begun_ns;
	uint64_t changes; /* of geoid grids, when it began */
	struct health found;
	struct check_wait *waits;
};

static void side_of(int fd, struct health_side *ret)
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

static void check_run(struct sched_task *t)
{
	struct check *l = (struct check *)t;
	struct err err = ERR_INIT;

	side_of(l->service->core->p.statefd, &l->found.state);
	side_of(l->service->core->p.cachefd, &l->found.cache);
	l->found.open_files = process_open_files();
	l->found.threads = process_threads();
	if (geoids_check(l->service->geoids, &l->found.geoids, &l->found.geoids_bad, &err) || err.code)
		err_format(&err, l->found.geoid_why, sizeof l->found.geoid_why);
}

static void answer_all(struct check_wait *w, const struct err *why, const struct health *found)
{
	struct check_wait *next;

	for (; w; w = next) {
		next = w->next;
		w->answer(w->token, why, found);
		free(w);
	}
}

/* Grids were added or removed since it began. */
static bool is_stale(const struct check *l)
{
	return l->changes != geoids_changes(l->service->geoids);
}

static void check(struct service *service);

static void check_done(struct sched_task *t)
{
	struct check *l = (struct check *)t;
	struct health_state *state = l->service->health;
	struct err err = ERR_INIT;

	core_background_done(l->service->core);
	state->now = NULL;
	if (!t->ran) {
		err_set(&err, ERR_CANCELLED, "the daemon is stopping");
	} else if (!is_stale(l)) {
		state->last = l->found;
		state->last_ns = l->begun_ns;
		state->changes = l->changes;
	}
	answer_all(l->waits, err.code ? &err : NULL, &l->found);
	if (state->next && !state->now)
		check(l->service);
	free(l);
}

/* For all who wait. */
static void check(struct service *service)
{
	struct check *l = calloc(1, sizeof *l);
	struct check_wait *waits = service->health->next;
	struct err err = ERR_INIT;

	service->health->next = NULL;
	if (!l) {
		err_set(&err, ERR_NOMEM, "no memory for a health check");
		answer_all(waits, &err, NULL);
		return;
	}
	l->task = (struct sched_task){.run = check_run,
				      .done = check_done,
				      .priority = SCHED_FIRST,
				      .owner = {.uid = waits->peer.uid, .flow = ++service->core->last_flow}};
	l->service = service;
	l->begun_ns = clock_mono_ns();
	l->changes = geoids_changes(service->geoids);
	l->waits = waits;
	service->health->now = l;
	core_background(service->core, &l->task);
}

void health_check(struct service *service, const struct peer *peer,
		  void (*answer)(void *token, const struct err *why, const struct health *), void *token)
{
	struct health_state *state = service->health;
	struct err err = ERR_INIT;
	struct check_wait *w, **to;

	if (state->last_ns && clock_mono_ns() - state->last_ns < LASTS_NS && state->changes == geoids_changes(service->geoids)) {
		answer(token, NULL, &state->last);
		return;
	}
	w = calloc(1, sizeof *w);
	if (!w) {
		err_set(&err, ERR_NOMEM, "no memory for a health check");
		answer(token, &err, NULL);
		return;
	}
	*w = (struct check_wait){.peer = rights_without_groups(peer), .answer = answer, .token = token};
	to = state->now && !is_stale(state->now) ? &state->now->waits : &state->next;
	w->next = *to;
	*to = w;
	if (!state->now)
		check(service);
}
