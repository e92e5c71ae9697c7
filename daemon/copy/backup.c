/*
 * Backups and exports: a folder of hard links, state/backup-N, and a list of its files. No push, merge or removal can take these
 * files away. The client gets one descriptor after the other, and copies or links for itself.
 *
 * The model: files of the state are immutable once they have their names, except plans, which grow, and the catalogue. So the
 * catalogue is copied first. Then each manifest that this copy names is linked, with the files that the manifest names. If one
 * of these is gone already, because a push or a merge came between, the catalogue is copied again. Links that were made stay, so
 * a retry needs only newer files, and this ends. Plans are copied: a plan that grows while it is copied looks as after a crash,
 * which its readers allow.
 *
 * The list has a line for each file: "L PATH" for immutable files, "C PATH" for files that change. The catalogue is the last: a
 * client that updates an older copy and is interrupted still has the old catalogue, and all that it names.
 *
 * Only the owner of a dataset may see the paths of his source files (request_generation.c). Another user who may read the dataset
 * gets a copy of the manifest without these paths.
 */

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "io.h"
#include "copy_priv.h"
#include "log.h"

enum { TRIES = 50, COPY = 64 << 10, LINE = 320, BACKUPS_MAX = 4, BACKUPS_OWN = BACKUPS_MAX / 2 };
enum { E_GONE = 1 };

struct backup {
	struct sched_task task;
	struct backup *other; /* the next open one */
	struct copies *copies;
	uint64_t id, dataset; /* 0: all */
	char name[32], manifest[64];
	struct sched_owner owner;
	int dirfd, listfd;
	uint64_t list_size, at, files, bytes;
	bool pathless;     /* the user may not see the paths of the sources */
	bool busy;         /* a task is under way */
	bool ended;        /* backup_end was called */
	bool telling;      /* a callback is being called */
	uint64_t ndamaged; /* datasets whose manifest is damaged: all their files were taken */
	struct err damaged;
	char line[LINE]; /* of the list */
	char gone[LINE]; /* the file that was missing in the last attempt */
	struct backup_file file;
	int r;
	struct err err;
	void (*ready)(void *token, const struct err *why, const struct backup_ready *);
	void (*next)(void *token, const struct err *why, const struct backup_file *);
	void *token;
};

uint64_t backup_id(const struct backup *b)
{
	return b->id;
}

int copies_new(struct core *core, struct datasets *datasets, struct copies **ret, struct err *err)
{
	struct copies *c;

	if (io_folder_sweep(core->p.statefd, "backup-", err))
		return -(int)err->code;
	c = calloc(1, sizeof *c);
	if (!c)
		return err_set(err, ERR_NOMEM, "no memory for the daemon");
	c->core = core;
	c->datasets = datasets;
	*ret = c;
	return 0;
}

struct copies *copies_free(struct copies *c)
{
	free(c);
	return NULL;
}

/* ---- taking it, by a worker ---- */

static int add_line(struct backup *b, char kind, const char *path, uint64_t bytes, struct err *err)
{
	char line[LINE];
	int n = snprintf(line, sizeof line, "%c %s\n", kind, path), r;

	if (n >= (int)sizeof line)
		return err_set(err, ERR_INTERNAL, "a path of %d bytes in a backup", n);
	r = io_write_at(b->listfd, line, (size_t)n, b->list_size, "the list of a backup", err);
	if (r)
		return r;
	b->list_size += (uint64_t)n;
	b->files++;
	b->bytes += bytes;
	return 0;
}

static int size_of(int dirfd, const char *path, uint64_t *ret, struct err *err)
{
	struct stat st;

	if (io->fstatat(dirfd, path, &st, AT_SYMLINK_NOFOLLOW) < 0)
		return errno == ENOENT ? E_GONE : err_sys(err, errno, "cannot look at %s", path);
	*ret = (uint64_t)st.st_size;
	return 0;
}

static int gone(struct backup *b, const char *path)
{
	snprintf(b->gone, sizeof b->gone, "%s", path);
	return E_GONE;
}

/* E_GONE: the file is not there any more. */
static int take_link(struct backup *b, int from, const char *name, const char *path, struct err *err)
{
	uint64_t bytes = 0;
	int r;

	if (io->linkat(from, name, b->dirfd, path, 0) < 0 && errno != EEXIST) {
		if (errno == ENOENT)
			return gone(b, path);
		err_sys(err, errno, "cannot make a hard link of %s", name);
		return err_add_hint(err, "for backups, the file system of --state must have hard links");
	}
	r = size_of(b->dirfd, path, &bytes, err);
	return r ? r : add_line(b, 'L', path, bytes, err);
}

static int take_copy(struct backup *b, int from, const char *name, const char *path, struct err *err)
{
	uint8_t *buf = malloc(COPY);
	int in = -1, out = -1, r = buf ? 0 : err_set(err, ERR_NOMEM, "no memory for a backup");
	uint64_t at = 0;
	size_t n = COPY;

	if (!r)
		in = io->openat(from, name, O_RDONLY | O_CLOEXEC | O_NOFOLLOW, 0);
	if (!r && in < 0)
		r = errno == ENOENT ? E_GONE : err_sys(err, errno, "cannot open %s", name);
	if (!r)
		r = io_open(b->dirfd, path, O_WRONLY | O_CREAT | O_TRUNC, 0600, &out, err);
	while (!r && n == COPY) {
		r = io_read_some(in, buf, COPY, at, name, &n, err);
		if (!r && n)
			r = io_write_at(out, buf, n, at, path, err);
		at += n;
	}
	io_close(in);
	io_close(out);
	free(buf);
	return r ? r : add_line(b, 'C', path, at, err);
}

/* It has all sources itself, so that it names no file with paths. */
static int take_pathless(struct backup *b, int from, struct grid_manifest *m, const char *path, struct err *err)
{
	uint64_t bytes = 0;
	int r = grid_manifest_complete(from, m, err);

	if (r == -ERR_CORRUPT && err->sys == ENOENT)
		return gone(b, err->file);
	if (r)
		return r;
	for (size_t i = 0; i < m->nsources; i++)
		m->sources[i].path = "";
	r = grid_manifest_write(b->dirfd, path, m, err);
	if (!r)
		r = size_of(b->dirfd, path, &bytes, err);
	return r ? r : add_line(b, 'C', path, bytes, err);
}

/* Links or copies all files of a folder, and closes `fd`. Files that are removed meanwhile are skipped. */
static int take_files(struct backup *b, int fd, const char *prefix, bool copy, struct err *err)
{
	DIR *dir = fdopendir(fd);
	char path[LINE];
	struct dirent *e;
	int r = 0;

	if (!dir) {
		io_close(fd);
		return err_sys(err, errno, "cannot list the folder %s", prefix);
	}
	while (!r && (errno = 0, e = io->readdir(dir))) {
		size_t n = strlen(e->d_name);

		if (*e->d_name == '.' || (n > 4 && !strcmp(e->d_name + n - 4, ".tmp")))
			continue;
		snprintf(path, sizeof path, "%s%s", prefix, e->d_name);
		r = copy ? take_copy(b, fd, e->d_name, path, err) : take_link(b, fd, e->d_name, path, err);
		r = r == E_GONE ? 0 : r;
	}
	/* An incomplete list would be an incomplete backup. */
	if (!r && errno)
		r = err_sys(err, errno, "cannot list the folder %s", prefix);
	closedir(dir);
	return r;
}

/* Links one manifest and the files that it names, below `prefix`. */
static int take_dataset(struct backup *b, uint64_t id, const char *manifest, const char *prefix, const char *as, struct err *err)
{
	struct grid_manifest *m = NULL;
	struct grid_named_at at = {0};
	struct grid_named file;
	char name[32], path[LINE];
	int fd = -1, r;

	snprintf(name, sizeof name, "%llu", (unsigned long long)id);
	fd = io->openat(b->copies->core->datafd, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC, 0);
	if (fd < 0)
		return errno == ENOENT ? gone(b, prefix) : err_sys(err, errno, "cannot open the folder of dataset %s", name);
	snprintf(path, sizeof path, "%s%s", prefix, manifest);
	if (io->faccessat(fd, manifest, F_OK, 0) < 0 && errno == ENOENT)
		r = gone(b, path);
	else
		r = grid_manifest_load_bare(fd, manifest, b->copies->core->p.ledger, &m, err);
	while (!r && grid_manifest_next_file(m, &at, &file)) {
		if (file.of_sources && b->pathless)
			continue;
		snprintf(path, sizeof path, "%s%s", prefix, file.name);
		r = take_link(b, fd, file.name, path, err);
	}
	snprintf(path, sizeof path, "%s%s", prefix, as);
	if (!r)
		r = b->pathless ? take_pathless(b, fd, m, path, err) : take_link(b, fd, manifest, path, err);
	grid_manifest_free(m);
	io_close(fd);
	return r;
}

/* Takes all files of a dataset whose manifest is damaged: which of them it named is not known. */
static int take_damaged(struct backup *b, uint64_t id, const char *prefix, const struct err *why, struct err *err)
{
	char name[32];
	int fd, r;

	snprintf(name, sizeof name, "%llu", (unsigned long long)id);
	fd = io->openat(b->copies->core->datafd, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC, 0);
	if (fd < 0)
		return errno == ENOENT ? gone(b, prefix) : err_sys(err, errno, "cannot open the folder of dataset %s", name);
	r = take_files(b, fd, prefix, false, err);
	if (!b->ndamaged++)
		b->damaged = *why;
	return r;
}

static int each_dataset(void *ctx, uint64_t id, const char *manifest, struct err *err)
{
	struct backup *b = ctx;
	char prefix[64];
	int r;

	snprintf(prefix, sizeof prefix, "datasets/%llu", (unsigned long long)id);
	r = io_make_dir(b->dirfd, prefix, 0700, err);
	strcat(prefix, "/");
	if (!r)
		r = take_dataset(b, id, manifest, prefix, manifest, err);
	if (r == -ERR_CORRUPT) {
		struct err why = *err;

		*err = ERR_INIT;
		/* With the folder: manifests of different datasets have the same names. */
		snprintf(why.file, sizeof why.file, "%s%s", prefix, manifest);
		r = take_damaged(b, id, prefix, &why, err);
	}
	return r;
}

static int take_folder(struct backup *b, const char *folder, bool copy, struct err *err)
{
	int fd = io->openat(b->copies->core->p.statefd, folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC, 0), r;
	char prefix[64];

	if (fd < 0)
		return errno == ENOENT ? 0 : err_sys(err, errno, "cannot open the folder %s", folder);
	snprintf(prefix, sizeof prefix, "%s/", folder);
	r = io_make_dir(b->dirfd, folder, 0700, err);
	if (r)
		io_close(fd);
	return r ? r : take_files(b, fd, prefix, copy, err);
}

/* The files of the state folder itself that are part of a backup: the one that identifies the store. */
static int take_top_files(struct backup *b, struct err *err)
{
	static const char *const top[] = {"acut-state"};
	int r = 0;

	for (size_t i = 0; !r && i < sizeof top / sizeof *top; i++) {
		r = take_copy(b, b->copies->core->p.statefd, top[i], top[i], err);
		r = r == E_GONE ? 0 : r;
	}
	return r;
}

static int take_all(struct backup *b, struct err *err)
{
	char from[64], to[64];
	uint64_t bytes = 0;
	int r;

	snprintf(from, sizeof from, "/proc/self/fd/%d/catalogue.db", b->copies->core->p.statefd);
	snprintf(to, sizeof to, "/proc/self/fd/%d/catalogue.db", b->dirfd);
	r = io_remove(b->dirfd, "catalogue.db", err);
	if (!r)
		r = catalogue_copy(from, to, err);
	/* First in the list: a client learns which store this is before it replaces files of an older copy. */
	if (!r)
		r = take_top_files(b, err);
	if (!r)
		r = io_make_dir(b->dirfd, "datasets", 0700, err);
	if (!r)
		r = catalogue_manifests(to, each_dataset, b, err);
	if (!r)
		r = take_folder(b, "geoids", false, err);
	if (!r)
		r = take_folder(b, "plans", true, err);
	if (!r)
		r = size_of(b->dirfd, "catalogue.db", &bytes, err);
	return r ? r : add_line(b, 'C', "catalogue.db", bytes, err);
}

static void begin_run(struct sched_task *t)
{
	struct backup *b = (struct backup *)t;
	unsigned tries = 0;

	/* Both are open already if this is another attempt, after a commit. */
	b->r = io_make_dir(b->copies->core->p.statefd, b->name, 0700, &b->err);
	if (!b->r && b->dirfd < 0)
		b->r = io_open(b->copies->core->p.statefd, b->name, O_RDONLY | O_DIRECTORY, 0, &b->dirfd, &b->err);
	if (!b->r && b->listfd < 0)
		b->r = io_open(b->dirfd, "list", O_RDWR | O_CREAT | O_TRUNC, 0600, &b->listfd, &b->err);
	if (b->r)
		return;
	do {
		b->list_size = b->files = b->bytes = b->ndamaged = 0;
		b->r = b->dataset ? take_dataset(b, b->dataset, b->manifest, "", "manifest", &b->err) : take_all(b, &b->err);
		/* For a single dataset, begin_done retries with its newest manifest. */
	} while (b->r == E_GONE && !b->dataset && ++tries < TRIES && !atomic_load(&t->cancel));
}

/* ---- the loop's side ---- */

static void end_run(struct sched_task *t)
{
	struct backup *b = (struct backup *)t;
	struct err err = ERR_INIT;

	b->listfd = io_close(b->listfd);
	b->dirfd = io_close(b->dirfd);
	if (io_folder_remove(b->copies->core->p.statefd, b->name, &err))
		log_event_err(LOG_EVENT_LEFTOVER, NULL, "the links of a backup stay behind until the next start", &err);
}

static void end_done(struct sched_task *t)
{
	struct backup *b = (struct backup *)t, **at;

	for (at = &b->copies->backups; *at != b; at = &(*at)->other)
		;
	*at = b->other;
	io_close(b->listfd);
	io_close(b->dirfd);
	core_background_done(b->copies->core);
	uncharge(b->copies->core, sizeof *b);
	free(b);
}

/* `bytes`: memory of the task; 0: it is a few system calls. */
static void submit(struct backup *b, void (*run)(struct sched_task *), void (*done)(struct sched_task *), uint64_t bytes)
{
	b->task = (struct sched_task){.run = run,
				      .done = done,
				      .owner = b->owner,
				      .priority = SCHED_NORMAL,
				      .lengthy = bytes || run == end_run,
				      .name = LEDGER_INPUT,
				      .bytes = bytes};
	b->busy = true;
	b->err = ERR_INIT;
	sched_submit(b->copies->core->p.sched, &b->task);
}

static void give(struct sched_task *t)
{
	struct backup *b = (struct backup *)t;

	b->busy = false;
	if (t->ran && t->bytes)
		sched_give(b->copies->core->p.sched, t->name, t->bytes);
	if (!t->ran)
		b->r = err_set(&b->err, ERR_CANCELLED, "the daemon is stopping");
}

void backup_end(struct backup *b)
{
	b->ended = true;
	if (b->telling)
		return; /* the caller of the callback checks `ended` next */
	if (b->busy)
		sched_cancel(b->copies->core->p.sched, &b->task);
	else
		submit(b, end_run, end_done, 0);
}

static struct dataset *exported(struct copies *c, const char *name, const struct peer *peer, struct err *err)
{
	struct dataset *d;

	if (dataset_access(c->datasets, name, peer, RIGHT_READ, &d, err))
		return NULL;
	if (d->onestep)
		err_set(err, ERR_NOTFOUND, "there is no dataset \"%.100s\"", name);
	else if (!*d->manifest)
		err_set(err, ERR_NOTFOUND, "nothing was pushed into the dataset %s yet", d->name);
	else
		return d;
	return NULL;
}

static void identify(const struct backup *b, struct backup_ready *ret)
{
	const struct core_params *p = &b->copies->core->p;
	const int fd[2] = {p->statefd, p->cachefd};
	char *to = ret->identity;
	struct stat st;

	for (size_t i = 0; i < 16; i++)
		to += sprintf(to, "%02x", p->store ? p->store[i] : 0);
	if (b->dataset)
		sprintf(to, "-%llu", (unsigned long long)b->dataset);
	for (size_t i = 0; i < 2; i++)
		if (io->fstat(fd[i], &st) == 0) {
			ret->place[i][0] = st.st_dev;
			ret->place[i][1] = st.st_ino;
		}
}

static void begin_done(struct sched_task *t)
{
	struct backup *b = (struct backup *)t;
	struct backup_ready ready = {.backup = b, .id = b->id};
	struct dataset *d;

	give(t);
	if (t->ran && b->r == E_GONE && b->dataset && !b->ended) {
		/* A commit came between: retry with the newest manifest. */
		for (d = datasets_first(b->copies->datasets); d && (d->onestep || d->id != b->dataset); d = d->next)
			;
		if (d && *d->manifest && strcmp(d->manifest, b->manifest)) {
			memcpy(b->manifest, d->manifest, sizeof b->manifest);
			submit(b, begin_run, begin_done, COPY);
			return;
		}
	}
	if (b->r == E_GONE) {
		err_set(&b->err, ERR_BUSY, "a file of the state was missing in every attempt");
		err_add_hint(&b->err, "try again; if the same file is missing then, run acutctl cache verify");
		b->r = err_add_file(&b->err, b->gone);
	}
	ready.files = b->files;
	ready.bytes = b->bytes;
	ready.ndamaged = b->ndamaged;
	ready.damaged = &b->damaged;
	identify(b, &ready);
	b->telling = true;
	b->ready(b->token, b->r ? &b->err : NULL, &ready);
	b->telling = false;
	if (b->r || b->ended)
		submit(b, end_run, end_done, 0);
}

/* The last one is kept for administrators, and no other user may have all of the rest. */
static int check_count(const struct copies *c, const struct peer *peer, struct err *err)
{
	unsigned own = 0, all = 0, most = BACKUPS_MAX - !rights_admin(peer);

	for (const struct backup *b = c->backups; b; b = b->other) {
		own += b->owner.uid == peer->uid;
		all++;
	}
	if (own >= BACKUPS_OWN && !rights_admin(peer)) {
		err_set(err, ERR_BUSY, "%u exports of this user are being taken already", own);
		return err_add_hint(err, "try again when one of them has ended");
	}
	return all >= most ? err_set(err, ERR_BUSY, "%u backups or exports are being taken already", all) : 0;
}

void backup_begin(struct copies *c, const char *dataset, const struct peer *peer,
		  void (*ready)(void *token, const struct err *why, const struct backup_ready *), void *token)
{
	struct dataset *d = NULL;
	struct err err = ERR_INIT;
	struct backup *b = NULL;

	if (c->core->stopping)
		err_set(&err, ERR_BUSY, "the daemon is stopping");
	else if (*dataset)
		d = exported(c, dataset, peer, &err);
	else if (!rights_admin(peer))
		err_set(&err, ERR_PERM, "a backup holds what all users have pushed: it is for administrators");
	if (!err.code)
		check_count(c, peer, &err);
	if (!err.code && !charge(c->core, sizeof *b, "a backup", &err)) {
		b = calloc(1, sizeof *b);
		if (!b) {
			uncharge(c->core, sizeof *b);
			err_set(&err, ERR_NOMEM, "no memory for a backup");
		}
	}
	if (!b) {
		ready(token, &err, NULL);
		return;
	}
	b->copies = c;
	b->id = ++c->last_backup;
	b->dataset = d ? d->id : 0;
	if (d)
		memcpy(b->manifest, d->manifest, sizeof b->manifest);
	b->pathless = d && !rights_allow(peer, RIGHT_OWN, d->uid, d->gid, d->mode);
	snprintf(b->name, sizeof b->name, "backup-%llu", (unsigned long long)b->id);
	b->owner = (struct sched_owner){.uid = peer->uid, .flow = ++c->core->last_flow};
	b->dirfd = b->listfd = -1;
	b->ready = ready;
	b->token = token;
	c->core->background++;
	b->other = c->backups;
	c->backups = b;
	submit(b, begin_run, begin_done, COPY);
}

/* ---- the files ---- */

static void next_run(struct sched_task *t)
{
	struct backup *b = (struct backup *)t;
	struct stat st;
	size_t n = 0;
	char *end;

	b->file = (struct backup_file){.fd = -1};
	b->r = io_read_some(b->listfd, b->line, LINE - 1, b->at, "the list of a backup", &n, &b->err);
	if (b->r || b->at >= b->list_size)
		return;
	b->line[n] = 0;
	end = memchr(b->line, '\n', n);
	if (!end || end - b->line < 3) {
		b->r = err_set(&b->err, ERR_CORRUPT, "the list of a backup is damaged");
		return;
	}
	*end = 0;
	b->r = io_open(b->dirfd, b->line + 2, O_RDONLY | O_NOFOLLOW, 0, &b->file.fd, &b->err);
	if (!b->r && io->fstat(b->file.fd, &st) < 0)
		b->r = err_sys(&b->err, errno, "cannot look at %s", b->line + 2);
	if (b->r)
		return;
	b->file.name = b->line + 2;
	b->file.size = (uint64_t)st.st_size;
	b->file.lasting = b->line[0] == 'L';
	b->at += (uint64_t)(end - b->line) + 1;
}

static void next_done(struct sched_task *t)
{
	struct backup *b = (struct backup *)t;

	give(t);
	if (b->r)
		b->file.fd = io_close(b->file.fd);
	if (t->ran && !b->r && !b->file.name)
		log_event(LOG_EVENT_BACKUP_DONE, &(struct log_about){ABOUT_USER(b->owner.uid)},
			  "a %s was handed out: %llu files, %llu bytes", b->dataset ? "dataset" : "backup",
			  (unsigned long long)b->files, (unsigned long long)b->bytes);
	b->telling = true;
	b->next(b->token, b->r ? &b->err : NULL, b->r || !b->file.name ? NULL : &b->file);
	b->telling = false;
	if (b->ended)
		submit(b, end_run, end_done, 0);
}

void backup_next(struct backup *b, void (*next)(void *token, const struct err *why, const struct backup_file *), void *token)
{
	struct err err = ERR_INIT;

	if (b->busy || b->ended) {
		err_set(&err, ERR_USAGE, "the last request for this backup is not answered yet");
		next(token, &err, NULL);
		return;
	}
	b->next = next;
	b->token = token;
	/* The callee owns the last descriptor: forget it here, since next_run may never run. */
	b->file = (struct backup_file){.fd = -1};
	submit(b, next_run, next_done, 0);
}
