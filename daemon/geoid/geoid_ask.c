/*
 * Requests to the store of geoid grids: add one, list them, remove a name.
 *
 * The model: each request is a task of its own. To add a grid, the task copies it first and checks the copy. Names are added and
 * removed under one lock, which is held only while files are looked up, renamed or unlinked, not while a grid is copied.
 */
#include "geoid_priv.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "io.h"
#include "lock.h"
#include "log.h"

enum { COPY_BUFFER = 256 * 1024, GEOIDS_PART = 4 };
#define GRID_MOST (UINT64_C(512) << 20) /* the finest published, of one minute, has 445 MiB */

/* Held while a name is added or removed. */
static struct lock geoids_lock = LOCK_STATIC(GEOIDS);

enum ask_kind { ASK_ADD, ASK_LIST, ASK_REMOVE };

struct ask {
	struct sched_task task;
	struct geoids *geoids;
	enum ask_kind kind;
	int fd, r;
	char *name, *file;
	struct peer peer;
	struct geoid_info *list;
	size_t n;
	struct err err;
	geoid_answer_fn *answer;
	void *token;
};

static int copy(int from, const char *name, uint64_t size, int to, struct err *err)
{
	uint8_t *buf = malloc(COPY_BUFFER);
	uint64_t at = 0;
	int r = buf ? 0 : err_set(err, ERR_NOMEM, "no memory to copy a geoid grid");

	while (!r && at < size) {
		size_t n = size - at < COPY_BUFFER ? (size_t)(size - at) : COPY_BUFFER;

		r = io_read_at(from, buf, n, at, name, err);
		if (!r)
			r = io_write_at(to, buf, n, at, "a geoid grid", err);
		at += n;
	}
	free(buf);
	return r;
}

static int write_file(int dirfd, const char *temp, const char *name, const void *bytes, size_t n, struct err *err)
{
	int fd, r = io_open(dirfd, temp, O_WRONLY | O_CREAT | O_TRUNC, 0600, &fd, err);

	if (r)
		return r;
	r = io_write_at(fd, bytes, n, 0, name, err);
	if (!r)
		r = io_publish(dirfd, fd, temp, name, err);
	else
		io->unlinkat(dirfd, temp, 0);
	io_close(fd);
	return r;
}

/* Gives the copy its name. Fails if another grid has that name. */
static int add_named(struct ask *a, int dirfd, const char *temp, int fd, struct geoid_info *g)
{
	char grid[DIGEST_HEX_SIZE + 8], file[DATASET_NAME_MAX + 8], text[GEOIDS_TEXT_MOST], text_temp[32];
	struct geoid_info old;
	struct err none = ERR_INIT;
	struct geoids_names names;
	int r = geoids_count_names(dirfd, g->hash, a->peer.uid, &names, &a->err);

	assert(lock_held(LOCK_GEOIDS));
	if (r)
		return r;
	if (!geoids_read(dirfd, g->name, &old, &none)) {
		if (!strcmp(old.hash, g->hash))
			return 0;
		err_set(&a->err, ERR_CONFLICT, "there is another geoid grid %s, with the hash %s", g->name, old.hash);
		return err_add_hint(&a->err, "give this one another --name, or acutctl geoid rm %s first", g->name);
	}
	if (names.all >= GEOIDS_MAX)
		return err_set(&a->err, ERR_LIMIT, "%d geoid grids are kept already", GEOIDS_MAX);
	/* One user may have only a part of the names that others left: so the next user and administrators still get some. */
	if (!rights_admin(&a->peer) && names.own >= (GEOIDS_MAX - (names.all - names.own)) / GEOIDS_PART) {
		err_set(&a->err, ERR_LIMIT,
			"%u geoid grids of this user are kept already, as many as one user may have beside those of others",
			names.own);
		return err_add_hint(&a->err,
				    "remove one that is not needed (acutctl geoid rm), or ask an administrator to add this one");
	}
	snprintf(grid, sizeof grid, "%s.pgm", g->hash);
	geoids_file(g->name, file);
	snprintf(text_temp, sizeof text_temp, "text-%s", temp);
	r = io_publish(dirfd, fd, temp, grid, &a->err);
	if (!r)
		r = write_file(dirfd, text_temp, file, text, geoids_write(g, text), &a->err);
	return r;
}

/* Under the lock, so that an older count never replaces a newer one. If the folder cannot be listed, the old charges stay. */
static void charge_all(struct ask *a)
{
	struct err err = ERR_INIT;

	assert(lock_held(LOCK_GEOIDS));
	if (geoids_charge(a->geoids, &err))
		log_event_err(LOG_EVENT_SPACE_UNKNOWN, NULL, "the space of geoid grids", &err);
}

static void add_run(struct ask *a)
{
	static atomic_uint number;
	int dirfd = a->geoids->fd, fd = -1;
	struct client_file id;
	struct geoid_info g = {.uid = a->peer.uid};
	char temp[24];

	a->r = geoids_check_name(a->name, &a->err);
	/* Memory for the answer comes first: once the grid has its name, nothing may fail. */
	if (!a->r && !(a->list = malloc(sizeof g)))
		a->r = err_set(&a->err, ERR_NOMEM, "no memory for a geoid grid");
	if (!a->r)
		a->r = client_file_check(a->fd, a->file, &id, &a->err);
	if (!a->r && id.size > GRID_MOST)
		a->r = err_set(&a->err, ERR_LIMIT, "it has %llu bytes, and no geoid grid has more than %llu",
			       (unsigned long long)id.size, (unsigned long long)GRID_MOST);
	snprintf(temp, sizeof temp, "%u.tmp", atomic_fetch_add(&number, 1));
	if (!a->r)
		a->r = io_open(dirfd, temp, O_RDWR | O_CREAT | O_TRUNC, 0600, &fd, &a->err);
	if (a->r)
		return;
	a->r = limit_disk_take(a->geoids->core, a->peer.uid, a->peer.admin, id.size, "a geoid grid", &a->err);
	if (a->r) {
		io->unlinkat(dirfd, temp, 0);
		io_close(fd);
		return;
	}
	/* Reserved only until it is written: then the file system counts it. */
	a->r = space_take(a->geoids->core->space, SPACE_PLANS, id.size, SPACE_MUST, "a geoid grid", &a->err);
	if (!a->r) {
		a->r = copy(a->fd, a->file, id.size, fd, &a->err);
		space_give(a->geoids->core->space, SPACE_PLANS, id.size);
	}
	if (!a->r)
		a->r = crs_geoid_check(fd, a->file, &g.grid, &a->err);
	if (!a->r) {
		snprintf(g.name, sizeof g.name, "%s", a->name);
		digest_hex(g.grid.hash, g.hash);
		lock_take(&geoids_lock);
		a->r = add_named(a, dirfd, temp, fd, &g);
		if (!a->r)
			charge_all(a);
		lock_give(&geoids_lock);
	}
	limit_disk_give(a->geoids->core, a->peer.uid, id.size);
	io->unlinkat(dirfd, temp, 0); /* unless it was renamed */
	io_close(fd);
	if (!a->r) {
		a->list[0] = g;
		a->n = 1;
	}
}

static int list_one(const char *name, void *ctx, struct err *err)
{
	struct ask *a = ctx;

	if (a->n == GEOIDS_MAX)
		return 0;
	/* A damaged one is logged, and the others are listed. */
	if (geoids_read(a->geoids->fd, name, &a->list[a->n], err)) {
		log_event_err(LOG_EVENT_GEOID_BAD, NULL, "a geoid grid", err);
		err_clear(err);
		return 0;
	}
	a->n++;
	return 0;
}

static int by_name(const void *a, const void *b)
{
	return strcmp(((const struct geoid_info *)a)->name, ((const struct geoid_info *)b)->name);
}

static void list_run(struct ask *a)
{
	a->list = calloc(GEOIDS_MAX, sizeof *a->list);
	a->r = a->list ? geoids_each(a->geoids->fd, list_one, a, &a->err) : err_set(&a->err, ERR_NOMEM, "no memory for a list");
	if (!a->r)
		qsort(a->list, a->n, sizeof *a->list, by_name);
}

static void remove_run(struct ask *a)
{
	int dirfd = a->geoids->fd;
	char grid[DIGEST_HEX_SIZE + 8], file[DATASET_NAME_MAX + 8];
	struct geoid_info g;
	struct geoids_names names;

	a->r = geoids_check_name(a->name, &a->err);
	lock_take(&geoids_lock);
	if (!a->r)
		a->r = geoids_read(dirfd, a->name, &g, &a->err);
	/* One with a damaged description can be removed, too. */
	if (a->r == -ERR_CORRUPT) {
		err_clear(&a->err);
		a->r = 0;
		g = (struct geoid_info){.uid = a->peer.uid};
	}
	if (!a->r && !rights_acts_as(&a->peer, g.uid))
		a->r = err_set(&a->err, ERR_PERM, "the geoid grid %s was added by the user with id %u", a->name, g.uid);
	if (!a->r) {
		geoids_file(a->name, file);
		a->r = io_remove(dirfd, file, &a->err);
	}
	if (!a->r)
		a->r = io_sync(dirfd, "the folder of geoid grids", &a->err);
	if (!a->r && *g.hash) {
		snprintf(grid, sizeof grid, "%s.pgm", g.hash);
		if (!geoids_count_names(dirfd, g.hash, 0, &names, &a->err) && !names.n)
			a->r = io_remove(dirfd, grid, &a->err);
	}
	if (!a->r)
		charge_all(a);
	lock_give(&geoids_lock);
}

static void ask_run(struct sched_task *t)
{
	struct ask *a = (struct ask *)t;

	if (a->kind == ASK_ADD)
		add_run(a);
	else if (a->kind == ASK_LIST)
		list_run(a);
	else
		remove_run(a);
}

static void ask_free(struct ask *a)
{
	io_close(a->fd);
	free(a->name);
	free(a->file);
	free(a->list);
	free(a);
}

static void ask_done(struct sched_task *t)
{
	struct ask *a = (struct ask *)t;

	if (t->ran)
		sched_give(a->geoids->core->p.sched, t->name, t->bytes);
	else
		a->r = err_set(&a->err, ERR_CANCELLED, "the daemon is stopping");
	core_background_done(a->geoids->core);
	if (a->kind != ASK_LIST)
		a->geoids->changes++;
	if (!a->r && a->kind != ASK_LIST)
		log_event(a->kind == ASK_ADD ? LOG_EVENT_GEOID_ADDED : LOG_EVENT_GEOID_REMOVED,
			  &(struct log_about){ABOUT_USER(a->peer.uid), .pid = a->peer.pid, .file = a->file},
			  "the geoid grid %s was %s", a->name, a->kind == ASK_ADD ? "added" : "removed");
	a->answer(a->token, a->r ? &a->err : NULL, a->list, a->n);
	ask_free(a);
}

static void ask(struct geoids *g, enum ask_kind kind, int fd, const char *name, const char *file, const struct peer *peer,
		geoid_answer_fn *answer, void *token)
{
	struct ask *a = calloc(1, sizeof *a);
	struct err err = ERR_INIT;

	if (a) {
		a->name = strdup(name);
		a->file = strdup(file);
		a->fd = fd;
	}
	if (!a || !a->name || !a->file) {
		if (a)
			ask_free(a);
		else
			io_close(fd);
		err_set(&err, ERR_NOMEM, "no memory for a request");
		answer(token, &err, NULL, 0);
		return;
	}
	a->task = (struct sched_task){
		.run = ask_run,
		.done = ask_done,
		.owner = {.uid = peer->uid, .flow = ++g->core->last_flow},
		.priority = SCHED_FIRST,
		.name = LEDGER_INPUT,
		.bytes = COPY_BUFFER + GEOIDS_MAX * sizeof(struct geoid_info),
	};
	a->geoids = g;
	a->kind = kind;
	a->peer = rights_without_groups(peer);
	a->err = ERR_INIT;
	a->answer = answer;
	a->token = token;
	core_background(g->core, &a->task);
}

void geoid_add(struct geoids *g, int fd, const char *name, const char *file, const struct peer *peer, geoid_answer_fn *answer,
	       void *token)
{
	ask(g, ASK_ADD, fd, name, file, peer, answer, token);
}

void geoid_list(struct geoids *g, const struct peer *peer, geoid_answer_fn *answer, void *token)
{
	ask(g, ASK_LIST, -1, "", "", peer, answer, token);
}

void geoid_remove(struct geoids *g, const char *name, const struct peer *peer, geoid_answer_fn *answer, void *token)
{
	ask(g, ASK_REMOVE, -1, name, "", peer, answer, token);
}
