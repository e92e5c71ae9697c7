/*
 * Health checks: a worker examines file systems, geoid grids and this process, since a disk may take its time.
 *
 * The model: one check at a time, and at most one a second. A request that comes while a check is running, or within a second of
 * its beginning, gets its result. So many requests at once cost no more than one. If a grid is added or removed, results of
 * earlier checks are stale, and the next request waits for another check.
 */
#include <assert.h>
#include <errno.h>
#include <stdlib.h>
#include <sys/statvfs.h>

#include "clock.h"
#include "health.h"
#include "io.h"
#include "process.h"
#include "service.h"

#define FRESH_NS UINT64_C(1000000000)

/* A request that waits for a check. */
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
	uint64_t changes; /* geoids_changes, when it began */
	struct health found;
	struct check_wait *waiting; /* requests that it answers */
};

static void query_side(int fd, struct health_side *ret)
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
	struct check *c = (struct check *)t;
	struct err err = ERR_INIT;
	unsigned extra;

	query_side(c->service->core->p.statefd, &c->found.state);
	query_side(c->service->core->p.cachefd, &c->found.cache);
	c->found.open_files = process_open_files();
	c->found.threads = process_threads();
	extra = sched_extra_threads(c->service->core->p.sched);
	c->found.threads -= c->found.threads > extra ? extra : 0; /* those of files that hang are no setting */
	if (geoids_check(c->service->geoids, &c->found.geoids, &c->found.geoids_bad, &err) || err.code)
		err_format(&err, c->found.geoid_why, sizeof c->found.geoid_why);
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
static bool is_stale(const struct check *c)
{
	return c->changes != geoids_changes(c->service->geoids);
}

static void start_check(struct service *service);

static void check_done(struct sched_task *t)
{
	struct check *c = (struct check *)t;
	struct health_state *state = c->service->health;
	struct err err = ERR_INIT;

	core_background_done(c->service->core);
	assert(state->running == c);
	state->running = NULL;
	if (!t->ran) {
		err_set(&err, ERR_CANCELLED, "the daemon is stopping");
	} else if (!is_stale(c)) {
		state->last = c->found;
		state->last_ns = c->begun_ns;
		state->last_changes = c->changes;
	}
	answer_all(c->waiting, err.code ? &err : NULL, &c->found);
	if (state->waiting && !state->running)
		start_check(c->service);
	free(c);
}

/* For all requests that wait. */
static void start_check(struct service *service)
{
	struct check *c = calloc(1, sizeof *c);
	struct check_wait *waiting = service->health->waiting;
	struct err err = ERR_INIT;

	service->health->waiting = NULL;
	if (!c) {
		err_set(&err, ERR_NOMEM, "no memory for a health check");
		answer_all(waiting, &err, NULL);
		return;
	}
	c->task = (struct sched_task){.run = check_run,
				      .done = check_done,
				      .priority = SCHED_FIRST,
				      .owner = {.uid = waiting->peer.uid, .flow = ++service->core->last_flow}};
	c->service = service;
	c->begun_ns = clock_mono_ns();
	c->changes = geoids_changes(service->geoids);
	c->waiting = waiting;
	assert(!service->health->running && waiting);
	service->health->running = c;
	core_background(service->core, &c->task);
}

void health_check(struct service *service, const struct peer *peer,
		  void (*answer)(void *token, const struct err *why, const struct health *), void *token)
{
	struct health_state *state = service->health;
	struct err err = ERR_INIT;
	struct check_wait *w, **to;

	THREAD_LOOP_ONLY();
	if (state->last_ns && clock_mono_ns() - state->last_ns < FRESH_NS &&
	    state->last_changes == geoids_changes(service->geoids)) {
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
	to = state->running && !is_stale(state->running) ? &state->running->waiting : &state->waiting;
	w->next = *to;
	*to = w;
	if (!state->running)
		start_check(service);
}
