/*
 * The store of geoid grids (geoids.h).
 *
 * The model: a folder of the state folder with two kinds of files. HASH.pgm is a grid, named by the XXH3-128 of
 * its bytes; NAME.geoid is a text that gives a grid a name, and says what is in it. Both appear by rename, the
 * grid first, so a name always has its grid; a grid without a name is a leftover, removed at the next start. A
 * grid is copied first and checked as it lies here, so nobody can change it between check and use.
 */
#include "geoids.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "io.h"
#include "job_priv.h"
#include "log.h"
#include "push_priv.h"

enum { COPY_BUFFER = 256 * 1024, TEXT_MOST = 2048, GEOIDS_MAX = 64, GEOIDS_PART = 4 };
#define GRID_MOST (UINT64_C(512) << 20) /* the finest published, of one minute, has 445 MiB */

static const char ending[] = ".geoid";
/* Of names that appear and go; each use is short. */
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

/* ---- names and texts ---- */

static void text_name(const char *name, char ret[DATASET_NAME_MAX + 8])
{
	snprintf(ret, DATASET_NAME_MAX + 8, "%.*s%s", DATASET_NAME_MAX, name, ending);
}

static int check_name(const char *name, struct err *err)
{
	if (dataset_name_valid(name))
		return 0;
	err_set(err, ERR_USAGE, "\"%.80s\" cannot name a geoid grid", name);
	return err_add_hint(err, "use up to %d letters, digits, '_', '-' and '.', not starting with '.' or '-'",
			    DATASET_NAME_MAX);
}

static size_t write_text(const struct geoid_info *g, char text[TEXT_MOST])
{
	const struct crs_geoid_info *i = &g->grid;

	return (size_t)snprintf(text, TEXT_MOST,
				"acut-geoid 1\nhash %s\nuid %u\nsize %u %u %llu\nheights %.17g %.17g\nerrors %.17g %.17g\n"
				"date %s\ndescription %s\n",
				g->hash, g->uid, i->width, i->height, (unsigned long long)i->bytes, i->min, i->max,
				i->rms_error, i->max_error, i->date, i->description);
}

static bool read_text(const char *text, struct geoid_info *ret)
{
	struct crs_geoid_info *i = &ret->grid;
	unsigned long long bytes;
	int at = 0;

	if (sscanf(text,
		   "acut-geoid 1\nhash %32[0-9a-f]\nuid %u\nsize %u %u %llu\nheights %lg %lg\nerrors %lg %lg\ndate%n",
		   ret->hash, &ret->uid, &i->width, &i->height, &bytes, &i->min, &i->max, &i->rms_error, &i->max_error,
		   &at) != 9 ||
	    !at || !digest_parse(ret->hash, &i->hash))
		return false;
	i->bytes = bytes;
	*i->date = *i->description = 0;
	sscanf(text + at, " %63[^\n]", i->date);
	text = strstr(text + at, "\ndescription ");
	return text && sscanf(text, "\ndescription %127[^\n]", i->description) >= -1;
}

static int read_name(int dirfd, const char *name, struct geoid_info *ret, struct err *err)
{
	char file[DATASET_NAME_MAX + 8], text[TEXT_MOST];
	size_t n = 0;
	int fd, r = 0;

	text_name(name, file);
	if (io->faccessat(dirfd, file, F_OK, 0) && errno == ENOENT) {
		err_set(err, ERR_NOTFOUND, "there is no geoid grid %s", name);
		return err_add_hint(err, "acutctl geoid add FILE --name %s keeps one; acutctl geoid list shows them", name);
	}
	r = io_open(dirfd, file, O_RDONLY, 0, &fd, err);
	if (r)
		return r;
	r = io_read_some(fd, text, sizeof text - 1, 0, file, &n, err);
	io_close(fd);
	if (r)
		return r;
	text[n] = 0;
	memset(ret, 0, sizeof *ret);
	snprintf(ret->name, sizeof ret->name, "%s", name);
	if (read_text(text, ret))
		return 0;
	err_set(err, ERR_CORRUPT, "what says which grid %s is, is damaged", name);
	return err_add_file(err, file);
}

struct each_name {
	int (*each)(const char *name, void *ctx, struct err *err);
	void *ctx;
};

static int entry(void *ctx, const struct dirent *e, struct err *err)
{
	const struct each_name *names = ctx;
	size_t n = strlen(e->d_name), end = sizeof ending - 1;
	char name[DATASET_NAME_MAX + 1];

	if (n <= end || n - end > DATASET_NAME_MAX || strcmp(e->d_name + n - end, ending))
		return 0;
	snprintf(name, sizeof name, "%.*s", (int)(n - end), e->d_name);
	return names->each(name, names->ctx, err);
}

/* Calls `each` for every name, until it returns non-zero. */
static int each_name(int dirfd, int (*each)(const char *name, void *ctx, struct err *err), void *ctx, struct err *err)
{
	struct each_name names = {each, ctx};

	return io_list(dirfd, ".", entry, &names, err);
}

struct look {
	int dirfd;
	unsigned n, bad;
	struct err first;
};

static int look_one(const char *name, void *ctx, struct err *err)
{
	struct look *l = ctx;
	char grid[DIGEST_HEX_SIZE + 8];
	struct err why = ERR_INIT;
	struct geoid_info g;
	struct stat st;

	l->n++;
	if (!read_name(l->dirfd, name, &g, &why)) {
		snprintf(grid, sizeof grid, "%s.pgm", g.hash);
		if (io->fstatat(l->dirfd, grid, &st, AT_SYMLINK_NOFOLLOW) < 0)
			err_sys(&why, errno, "the grid %s cannot be read", name);
		else if ((uint64_t)st.st_size != g.grid.bytes)
			err_set(&why, ERR_CORRUPT, "the grid %s has %llu bytes, not %llu", name,
				(unsigned long long)st.st_size, (unsigned long long)g.grid.bytes);
	}
	if (why.code && !l->bad++)
		l->first = why;
	return 0;
}

int geoids_look(int dirfd, unsigned *ret_n, unsigned *ret_bad, struct err *err)
{
	struct look l = {.dirfd = dirfd};
	int r = each_name(dirfd, look_one, &l, err);

	if (r)
		return r;
	*ret_n = l.n;
	*ret_bad = l.bad;
	if (l.bad)
		*err = l.first;
	return 0;
}

/* ---- whose disk they take ---- */

struct sums {
	int dirfd;
	struct sum {
		uint32_t uid;
		char hash[DIGEST_HEX_SIZE];
		uint64_t bytes;
	} sum[GEOIDS_MAX];
	size_t n;
};

/* A grid with two names of one user lies there once. */
static int sum_one(const char *name, void *ctx, struct err *err)
{
	struct sums *s = ctx;
	struct err ignored = ERR_INIT;
	struct geoid_info g;
	size_t i;

	if (s->n == GEOIDS_MAX || read_name(s->dirfd, name, &g, &ignored))
		return 0;
	for (i = 0; i < s->n && (s->sum[i].uid != g.uid || strcmp(s->sum[i].hash, g.hash)); i++)
		;
	if (i < s->n)
		return 0;
	s->sum[i] = (struct sum){.uid = g.uid, .bytes = g.grid.bytes};
	memcpy(s->sum[i].hash, g.hash, sizeof g.hash);
	s->n++;
	return 0;
}

int geoids_count(struct jobs *j, struct err *err)
{
	struct limit_geoid all[GEOIDS_MAX];
	struct sums s = {.dirfd = j->geoidsfd};
	int r = each_name(j->geoidsfd, sum_one, &s, err);

	for (size_t i = 0; i < s.n; i++)
		all[i] = (struct limit_geoid){.uid = s.sum[i].uid, .bytes = s.sum[i].bytes};
	if (!r)
		limit_geoids(j, all, s.n);
	return r;
}

/* ---- what a grid is used by ---- */

struct users {
	int dirfd;
	const char *hash;
	uint32_t uid;
	unsigned n, all, own; /* names of the grid, all of them, those that this user added */
};

static int count_user(const char *name, void *ctx, struct err *err)
{
	struct users *u = ctx;
	struct geoid_info g;
	struct err ignored = ERR_INIT;

	u->all++;
	if (!read_name(u->dirfd, name, &g, &ignored)) {
		u->n += !strcmp(g.hash, u->hash);
		u->own += g.uid == u->uid;
	}
	return 0;
}

static int users_of(int dirfd, const char *hash, uint32_t uid, struct users *ret, struct err *err)
{
	*ret = (struct users){.dirfd = dirfd, .hash = hash, .uid = uid};
	return each_name(dirfd, count_user, ret, err);
}

int geoids_find(int dirfd, const char *name, struct geoids_found *ret, struct err *err)
{
	struct geoid_info g;
	int r = check_name(name, err);

	if (!r)
		r = read_name(dirfd, name, &g, err);
	if (r)
		return r;
	snprintf(ret->path, sizeof ret->path, "/proc/self/fd/%d/%s.pgm", dirfd, g.hash);
	memcpy(ret->hash, g.hash, sizeof ret->hash);
	return 0;
}

/* ---- start ---- */

static bool is_grid(const char *name, char hash[DIGEST_HEX_SIZE])
{
	struct digest d;

	if (strlen(name) != DIGEST_HEX_SIZE - 1 + 4 || strcmp(name + DIGEST_HEX_SIZE - 1, ".pgm"))
		return false;
	memcpy(hash, name, DIGEST_HEX_SIZE - 1);
	hash[DIGEST_HEX_SIZE - 1] = 0;
	return digest_parse(hash, &d);
}

static int sweep_one(void *ctx, const struct dirent *e, struct err *err)
{
	int dirfd = *(int *)ctx;
	size_t n = strlen(e->d_name);
	char hash[DIGEST_HEX_SIZE];
	struct users users;
	struct err ignored = ERR_INIT; /* it stays until the next start */
	bool goes = n > 4 && !strcmp(e->d_name + n - 4, ".tmp");

	if (!goes && is_grid(e->d_name, hash))
		goes = !users_of(dirfd, hash, 0, &users, &ignored) && !users.n;
	if (goes)
		io->unlinkat(dirfd, e->d_name, 0);
	return 0;
}

int geoids_open(int statefd, int *ret_fd, struct err *err)
{
	int r = io_make_dir(statefd, "geoids", 0700, err);

	if (!r)
		r = io_open(statefd, "geoids", O_RDONLY | O_DIRECTORY, 0, ret_fd, err);
	if (!r)
		r = io_list(*ret_fd, ".", sweep_one, ret_fd, err);
	return r;
}

/* ---- what is asked ---- */

enum ask_kind { ASK_ADD, ASK_LIST, ASK_REMOVE };

struct ask {
	struct sched_task task;
	struct jobs *jobs;
	enum ask_kind kind;
	int fd, r;
	char *name, *file;
	struct job_peer peer;
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

/* Under the lock: the name is free, or is this very grid's. */
static int add_named(struct ask *a, int dirfd, const char *temp, int fd, struct geoid_info *g)
{
	char grid[DIGEST_HEX_SIZE + 8], file[DATASET_NAME_MAX + 8], text[TEXT_MOST], text_temp[32];
	struct geoid_info old;
	struct err none = ERR_INIT;
	struct users users;
	int r = users_of(dirfd, g->hash, a->peer.uid, &users, &a->err);

	if (r)
		return r;
	if (!read_name(dirfd, g->name, &old, &none)) {
		if (!strcmp(old.hash, g->hash))
			return 0;
		err_set(&a->err, ERR_USAGE, "there is another geoid grid %s, with the hash %s", g->name, old.hash);
		return err_add_hint(&a->err, "give this one another --name, or acutctl geoid rm %s first", g->name);
	}
	if (users.all >= GEOIDS_MAX)
		return err_set(&a->err, ERR_LIMIT, "%d geoid grids are kept already", GEOIDS_MAX);
	/* Something is left for the next user, and for administrators. */
	if (!rights_admin(&a->peer) && users.own >= (GEOIDS_MAX - (users.all - users.own)) / GEOIDS_PART) {
		err_set(&a->err, ERR_LIMIT, "%u geoid grids of this user are kept already, as many as one user may have beside those of others", users.own);
		return err_add_hint(&a->err, "acutctl geoid rm one that nobody needs, or ask an administrator to add it");
	}
	snprintf(grid, sizeof grid, "%s.pgm", g->hash);
	text_name(g->name, file);
	snprintf(text_temp, sizeof text_temp, "text-%s", temp);
	r = io_publish(dirfd, fd, temp, grid, &a->err);
	if (!r)
		r = write_file(dirfd, text_temp, file, text, write_text(g, text), &a->err);
	return r;
}

/* Under the lock, so that a later look is counted later. What cannot be listed stays counted as it was. */
static void count_again(struct ask *a)
{
	struct err err = ERR_INIT;

	if (geoids_count(a->jobs, &err))
		log_event_err(LOG_EVENT_SPACE_UNKNOWN, NULL, "what geoid grids take", &err);
}

static void add_run(struct ask *a)
{
	static atomic_uint number;
	int dirfd = a->jobs->geoidsfd, fd = -1;
	struct push_input_id id;
	struct geoid_info g = {.uid = a->peer.uid};
	char temp[24];

	a->r = check_name(a->name, &a->err);
	if (!a->r)
		a->r = push_fd_check(a->fd, a->file, &id, &a->err);
	if (!a->r && id.size > GRID_MOST)
		a->r = err_set(&a->err, ERR_LIMIT, "it has %llu bytes, and no geoid grid has more than %llu",
			       (unsigned long long)id.size, (unsigned long long)GRID_MOST);
	snprintf(temp, sizeof temp, "%u.tmp", atomic_fetch_add(&number, 1));
	if (!a->r)
		a->r = io_open(dirfd, temp, O_RDWR | O_CREAT | O_TRUNC, 0600, &fd, &a->err);
	if (a->r)
		return;
	a->r = limit_disk_take(a->jobs, a->peer.uid, a->peer.admin, id.size, "a geoid grid", &a->err);
	if (a->r) {
		io->unlinkat(dirfd, temp, 0);
		io_close(fd);
		return;
	}
	/* What it takes is in what is free as soon as it is written. */
	a->r = space_take(a->jobs->space, SPACE_PLANS, id.size, SPACE_MUST, "a geoid grid", &a->err);
	if (!a->r) {
		a->r = copy(a->fd, a->file, id.size, fd, &a->err);
		space_give(a->jobs->space, SPACE_PLANS, id.size);
	}
	if (!a->r)
		a->r = crs_geoid_check(fd, a->file, &g.grid, &a->err);
	if (!a->r) {
		snprintf(g.name, sizeof g.name, "%s", a->name);
		digest_hex(g.grid.hash, g.hash);
		pthread_mutex_lock(&lock);
		a->r = add_named(a, dirfd, temp, fd, &g);
		if (!a->r)
			count_again(a);
		pthread_mutex_unlock(&lock);
	}
	limit_disk_give(a->jobs, a->peer.uid, id.size);
	io->unlinkat(dirfd, temp, 0); /* unless it was renamed */
	io_close(fd);
	if (!a->r && (a->list = malloc(sizeof g))) {
		a->list[0] = g;
		a->n = 1;
	}
}

static int list_one(const char *name, void *ctx, struct err *err)
{
	struct ask *a = ctx;

	if (a->n == GEOIDS_MAX)
		return 0;
	/* One that is damaged is told of, and hides no other. */
	if (read_name(a->jobs->geoidsfd, name, &a->list[a->n], err)) {
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
	a->r = a->list ? each_name(a->jobs->geoidsfd, list_one, a, &a->err)
		       : err_set(&a->err, ERR_NOMEM, "no memory for a list");
	if (!a->r)
		qsort(a->list, a->n, sizeof *a->list, by_name);
}

static void remove_run(struct ask *a)
{
	int dirfd = a->jobs->geoidsfd;
	char grid[DIGEST_HEX_SIZE + 8], file[DATASET_NAME_MAX + 8];
	struct geoid_info g;
	struct users users;

	a->r = check_name(a->name, &a->err);
	pthread_mutex_lock(&lock);
	if (!a->r)
		a->r = read_name(dirfd, a->name, &g, &a->err);
	/* A damaged one can go as well. */
	if (a->r == -ERR_CORRUPT) {
		err_clear(&a->err);
		a->r = 0;
		g = (struct geoid_info){.uid = a->peer.uid};
	}
	if (!a->r && !rights_as(&a->peer, g.uid))
		a->r = err_set(&a->err, ERR_PERM, "the geoid grid %s was added by the user with id %u", a->name, g.uid);
	if (!a->r) {
		text_name(a->name, file);
		a->r = io_remove(dirfd, file, &a->err);
	}
	if (!a->r)
		a->r = io_sync(dirfd, "the folder of geoid grids", &a->err);
	if (!a->r && *g.hash) {
		snprintf(grid, sizeof grid, "%s.pgm", g.hash);
		if (!users_of(dirfd, g.hash, 0, &users, &a->err) && !users.n)
			a->r = io_remove(dirfd, grid, &a->err);
	}
	if (!a->r)
		count_again(a);
	pthread_mutex_unlock(&lock);
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
		sched_give(a->jobs->p.sched, t->name, t->bytes);
	else
		a->r = err_set(&a->err, ERR_CANCELLED, "the daemon is stopping");
	a->jobs->background--;
	if (a->kind != ASK_LIST)
		house_changed(a->jobs);
	if (!a->r && a->kind != ASK_LIST)
		log_event(a->kind == ASK_ADD ? LOG_EVENT_GEOID_ADDED : LOG_EVENT_GEOID_REMOVED,
			  &(struct log_about){ABOUT_USER(a->peer.uid), .pid = a->peer.pid, .file = a->file},
			  "the geoid grid %s was %s", a->name, a->kind == ASK_ADD ? "added" : "removed");
	a->answer(a->token, a->r ? &a->err : NULL, a->list, a->n);
	ask_free(a);
}

static void ask(struct jobs *j, enum ask_kind kind, int fd, const char *name, const char *file,
		const struct job_peer *peer, geoid_answer_fn *answer, void *token)
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
		.owner = {.uid = peer->uid, .flow = ++j->last_flow},
		.priority = SCHED_FIRST,
		.name = LEDGER_INPUT,
		.bytes = COPY_BUFFER + GEOIDS_MAX * sizeof(struct geoid_info),
	};
	a->jobs = j;
	a->kind = kind;
	a->peer = rights_kept(peer);
	a->err = ERR_INIT;
	a->answer = answer;
	a->token = token;
	j->background++;
	sched_submit(j->p.sched, &a->task);
}

void geoid_add(struct jobs *j, int fd, const char *name, const char *file, const struct job_peer *peer,
	       geoid_answer_fn *answer, void *token)
{
	ask(j, ASK_ADD, fd, name, file, peer, answer, token);
}

void geoid_list(struct jobs *j, const struct job_peer *peer, geoid_answer_fn *answer, void *token)
{
	ask(j, ASK_LIST, -1, "", "", peer, answer, token);
}

void geoid_remove(struct jobs *j, const char *name, const struct job_peer *peer, geoid_answer_fn *answer, void *token)
{
	ask(j, ASK_REMOVE, -1, name, "", peer, answer, token);
}
