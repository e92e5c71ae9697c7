/*
 * The reading of `cache verify`, on workers: files are checked against their checksums, and against the manifests that name them.
 *
 * Damage of pushed data is reported, and the file stays as it is. A damaged derived file is removed, since it can be made again.
 * A file that was removed meanwhile is not damage. A file of a newer version is reported and stays, derived or not: a newer acutd
 * can read it.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "breaklines.h"
#include "cache_priv.h"
#include "io.h"
#include "plan_file.h"
#include "selection.h"
#include "store.h"
#include "run.h"

/* The folder of a dataset or selection that is being read. */
struct reading {
	struct cache_verify *v;
	const char *what, *folder; /* both for reports; `folder` precedes the file name, unless it is "" */
	unsigned found;
	bool derived;
	bool mapped; /* a selection with pieces of its own */
	/* An interrupted push: its number, and its two files that name the others, as they were when the reading began. */
	uint64_t push;
	int dirfd;
	struct stat left[2];
};

/* A push that is continued or dropped writes or removes these files before it removes a file that they name. */
static void stat_left(const struct reading *r, struct stat ret[2])
{
	static const char *const ends[] = {"pending", "stage"};
	char name[64];

	for (int i = 0; i < 2; i++) {
		snprintf(name, sizeof name, "push-%llu.%s", (unsigned long long)r->push, ends[i]);
		if (io->fstatat(r->dirfd, name, &ret[i], AT_SYMLINK_NOFOLLOW) != 0)
			ret[i] = (struct stat){0};
	}
}

/* True: the push was continued or dropped since its reading began. */
static bool push_went_on(const struct reading *r)
{
	struct stat now[2];

	stat_left(r, now);
	for (int i = 0; i < 2; i++)
		if (now[i].st_ino != r->left[i].st_ino || now[i].st_ctim.tv_sec != r->left[i].st_ctim.tv_sec ||
		    now[i].st_ctim.tv_nsec != r->left[i].st_ctim.tv_nsec)
			return true;
	return false;
}

/* Makes the file "folder/file": different datasets have files of the same name. */
static void add_folder(struct err *err, const char *folder)
{
	char path[sizeof err->file];

	if (!*folder)
		return;
	snprintf(path, sizeof path, "%.120s/%.120s", folder, err->file);
	memcpy(err->file, path, sizeof path);
}

static void damaged(void *ctx, const struct err *why)
{
	struct reading *r = ctx;
	struct err err = *why;

	if (r->push && push_went_on(r))
		return;
	add_folder(&err, r->folder);
	r->found++;
	if (!r->derived)
		cache_found(r->v, r->what, false, false, &err);
	else if (r->found == 1 || (r->v->err.code == ERR_VERSION && err.code != ERR_VERSION))
		r->v->err = err; /* reported when it is removed; damage is reported rather than a newer version */
}

static int progress(void *ctx, uint64_t bytes)
{
	struct reading *r = ctx;

	atomic_fetch_add(&r->v->bytes, bytes);
	return cache_ended(r->v);
}

static bool lacks_memory(int r)
{
	return r == -ERR_BUSY || r == -ERR_NOMEM;
}

/* The files of lines of a source; staged ones have another name. */
static int read_lines(struct reading *r, int dirfd, const struct grid_source *s, struct err *err)
{
	struct err why = ERR_INIT;
	const char *what = r->what;
	char staged[64] = "";
	int bad;

	if (s->kind == GRID_POINTS)
		return 0;
	if (cache_ended(r->v))
		return err_set(err, ERR_CANCELLED, "cancelled");
	if (r->push)
		breaklines_staged_name(r->push, s->id, staged);
	bad = r->mapped ? breaklines_verify_mapped(dirfd, s, &why) : breaklines_verify(dirfd, s, *staged ? staged : NULL, &why);
	atomic_fetch_add(&r->v->files, 1);
	atomic_fetch_add(&r->v->bytes, s->lines->bytes);
	if (bad && lacks_memory(bad)) {
		*err = why;
		return bad;
	}
	r->what = r->push || r->derived ? what : "lines";
	if (bad)
		damaged(r, &why);
	r->what = what;
	return 0;
}

/* The files of sources of a manifest, each by itself, then what is in them. */
static int read_sources(struct reading *r, int dirfd, struct grid_manifest *m, struct err *err)
{
	const char *what = r->what;
	struct err why = ERR_INIT;
	unsigned found = 0;
	int s = 0;

	r->what = r->derived ? what : "sources";
	for (size_t i = 0; i <= m->nfiles && !(found && i == m->nfiles); i++) {
		s = i < m->nfiles ? grid_sources_verify(dirfd, m, i, &why) : grid_manifest_complete(dirfd, m, &why);
		if (lacks_memory(s) || s == -ERR_LIMIT)
			break;
		if (i < m->nfiles)
			atomic_fetch_add(&r->v->files, 1);
		if (s) {
			found++;
			damaged(r, &why);
			why = ERR_INIT;
		}
		s = 0;
	}
	r->what = what;
	if (s)
		*err = why;
	return s;
}

/* Reads a manifest and all files that it names. 0: all was read, damaged or not. */
static int read_manifest(struct reading *r, int dirfd, const char *name, struct err *err)
{
	struct grid_verify_params p = {
		.dirfd = dirfd,
		.memory = r->v->memory,
		.damaged = damaged,
		.progress = progress,
		.ctx = r,
	};
	struct grid_manifest *m = NULL;
	struct err why = ERR_INIT;
	int s = grid_manifest_load_bare(dirfd, name, r->v->maintenance->core->p.ledger, &m, &why);

	atomic_fetch_add(&r->v->files, 1);
	if (s && (lacks_memory(s) || s == -ERR_LIMIT)) {
		*err = why;
		return s;
	}
	if (s) {
		const char *what = r->what;

		r->what = r->derived ? what : "manifest";
		err_add_file(&why, name);
		damaged(r, &why);
		r->what = what;
		return 0;
	}
	for (size_t i = 0; !s && i < m->nsegments; i++) {
		atomic_fetch_add(&r->v->files, 1);
		s = grid_verify_segment(&p, m, i, err);
	}
	/* The pieces of a selection are in the dataset, unless a metric has mapped them. */
	for (size_t i = 0; !s && (!r->derived || r->mapped) && i < m->nsources; i++)
		s = read_lines(r, dirfd, &m->sources[i], err);
	/* The last, as this alone may take much memory: what is above needs only the bare manifest, which has all sources of
	 * lines. */
	if (!s)
		s = read_sources(r, dirfd, m, err);
	grid_manifest_free(m);
	return s;
}

/* Reads the manifest of an interrupted push and the runs of its stage. If the push goes on meanwhile, nothing is reported. */
static int read_push(struct reading *r, int dirfd, uint64_t id, struct err *err)
{
	struct grid_verify_params p = {
		.dirfd = dirfd,
		.memory = r->v->memory,
		.damaged = damaged,
		.progress = progress,
		.ctx = r,
	};
	char name[64];
	int s;

	r->push = id;
	r->dirfd = dirfd;
	stat_left(r, r->left);
	snprintf(name, sizeof name, "push-%llu.pending", (unsigned long long)id);
	if (io->faccessat(dirfd, name, F_OK, 0) != 0 && errno == ENOENT)
		return 0;
	s = read_manifest(r, dirfd, name, err);
	snprintf(name, sizeof name, "push-%llu", (unsigned long long)id);
	atomic_fetch_add(&r->v->files, 1);
	return s ? s : grid_verify_stage(&p, name, err);
}

void cache_read_dataset(struct cache_verify *v)
{
	struct dataset *d = v->dataset;
	char folder[48];
	struct reading r = {.v = v, .what = "segment", .folder = folder};

	snprintf(folder, sizeof folder, "datasets/%llu", (unsigned long long)d->id);
	v->r = dataset_open(d, &v->err);
	if (v->r)
		return;
	if (*v->manifest)
		v->r = read_manifest(&r, d->dirfd, v->manifest, &v->err);
	r.what = "push";
	for (size_t i = 0; !v->r && i < v->npending; i++)
		v->r = read_push(&r, d->dirfd, v->pending[i], &v->err);
	dataset_close(d);
}

/* ---- plans ---- */

static int read_plan(void *ctx, const struct dirent *e, struct err *err)
{
	struct cache_verify *v = ctx;
	uint64_t job = plan_file_job(e->d_name), bytes = 0;
	struct err why = ERR_INIT;
	bool removed;
	int r;

	if (!job)
		return 0;
	if (cache_ended(v))
		return err_set(err, ERR_CANCELLED, "cancelled");
	r = plan_file_check(v->maintenance->core->plansfd, job, &bytes, &why);
	atomic_fetch_add(&v->files, 1);
	atomic_fetch_add(&v->bytes, bytes);
	if (!r)
		return 0;
	/* A job that uses this plan makes a new one only if the file is not there. */
	removed = why.code != ERR_VERSION && io->unlinkat(v->maintenance->core->plansfd, e->d_name, 0) == 0;
	add_folder(&why, "plans");
	cache_found(v, "plan", true, removed, &why);
	return 0;
}

void cache_read_plans(struct cache_verify *v)
{
	v->r = io_list(v->maintenance->core->plansfd, ".", read_plan, v, &v->err);
}

/* ---- selections ---- */

/* True: `name` is still the folder that `fd` has open. */
static bool is_still(int parent, const char *name, int fd)
{
	struct stat named, open;

	return io->fstatat(parent, name, &named, AT_SYMLINK_NOFOLLOW) == 0 && io->fstat(fd, &open) == 0 &&
	       named.st_ino == open.st_ino && named.st_dev == open.st_dev;
}

static int read_selection(void *ctx, const struct dirent *e, struct err *err)
{
	struct cache_verify *v = ctx;
	struct reading r = {.v = v, .what = "selection", .folder = e->d_name, .derived = true};
	struct selection_counts counts;
	struct err why = ERR_INIT;
	int parent, fd, s;

	/* One that was made in part is verified when it is continued. */
	if (!strncmp(e->d_name, SPACE_SELECTION_TEMP, strlen(SPACE_SELECTION_TEMP)) ||
	    !strncmp(e->d_name, SPACE_SELECTION_PART, strlen(SPACE_SELECTION_PART)))
		return 0;
	if (cache_ended(v))
		return err_set(err, ERR_CANCELLED, "cancelled");
	s = core_selected_folder(v->maintenance->core, &parent, err);
	if (s)
		return s;
	if (io_open(parent, e->d_name, O_RDONLY | O_DIRECTORY, 0, &fd, &why)) {
		io_close(parent);
		return 0; /* evicted meanwhile */
	}
	if (selection_counts_read(fd, &counts, &why))
		damaged(&r, &why);
	else
		r.mapped = counts.mapped;
	s = read_manifest(&r, fd, SELECTION_MANIFEST, err);
	/* Evicted while it was read: no damage. */
	if (r.found && !is_still(parent, e->d_name, fd)) {
		r.found = 0;
		err_clear(&v->err);
	}
	io_close(fd);
	if (!s && r.found) {
		uint64_t bytes = space_folder_bytes(parent, e->d_name);
		bool removed = v->err.code != ERR_VERSION && !io_folder_remove(parent, e->d_name, &why);

		if (removed) {
			space_give(v->maintenance->core->space, SPACE_SELECTIONS, bytes);
			space_count_entries(v->maintenance->core->space, SPACE_SELECTIONS, -1);
		}
		cache_found(v, "selection", true, removed, &v->err);
		err_clear(&v->err);
	}
	io_close(parent);
	return s;
}

void cache_read_selections(struct cache_verify *v)
{
	struct err why = ERR_INIT;
	int fd;

	v->r = core_selected_folder(v->maintenance->core, &fd, &why);
	if (!v->r) {
		v->r = io_list(fd, ".", read_selection, v, &why);
		io_close(fd);
	}
	if (v->r)
		v->err = why;
}

/* ---- stored domains ---- */

struct folder {
	struct cache_verify *v;
	int fd;
	char path[200];
	unsigned depth;
};

static int read_domains(struct cache_verify *v, int parent, const char *name, const char *path, unsigned depth, struct err *err);

static int read_domain(struct folder *f, const char *name, const struct stat *st, struct err *err)
{
	struct cache_verify *v = f->v;
	struct err why = ERR_INIT;
	bool removed;
	int r = store_check(f->fd, name, v->memory, GRID_VERIFY_BYTES, &why);

	atomic_fetch_add(&v->files, 1);
	atomic_fetch_add(&v->bytes, (uint64_t)st->st_size);
	if (!r)
		return 0;
	if (r == -ERR_NOMEM || (why.sys == ENOENT)) {
		if (r == -ERR_NOMEM)
			*err = why;
		return r == -ERR_NOMEM ? r : 0;
	}
	removed = why.code != ERR_VERSION && io->unlinkat(f->fd, name, 0) == 0;
	if (removed) {
		space_give(v->maintenance->core->space, SPACE_DOMAINS, (uint64_t)st->st_size);
		space_count_entries(v->maintenance->core->space, SPACE_DOMAINS, -1);
	}
	add_folder(&why, f->path);
	cache_found(v, "domain", true, removed, &why);
	return 0;
}

static int read_entry(void *ctx, const struct dirent *e, struct err *err)
{
	struct folder *f = ctx;
	char path[300];
	struct stat st;

	if (cache_ended(f->v))
		return err_set(err, ERR_CANCELLED, "cancelled");
	if (io->fstatat(f->fd, e->d_name, &st, AT_SYMLINK_NOFOLLOW) != 0)
		return 0;
	if (S_ISREG(st.st_mode))
		return strstr(e->d_name, ".tmp") ? 0 : read_domain(f, e->d_name, &st, err);
	if (!S_ISDIR(st.st_mode) || !f->depth)
		return 0;
	snprintf(path, sizeof path, "%s/%.80s", f->path, e->d_name);
	return read_domains(f->v, f->fd, e->d_name, path, f->depth - 1, err);
}

static int read_domains(struct cache_verify *v, int parent, const char *name, const char *path, unsigned depth, struct err *err)
{
	struct folder f = {.v = v, .depth = depth};
	struct err why = ERR_INIT;
	int r = io_open(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW, 0, &f.fd, &why);

	if (r && why.sys == ENOENT)
		return 0;
	if (r) {
		*err = why;
		return r;
	}
	snprintf(f.path, sizeof f.path, "%.190s", path);
	r = io_list(f.fd, ".", read_entry, &f, err);
	io_close(f.fd);
	return r;
}

void cache_read_domains(struct cache_verify *v)
{
	enum { DEPTH = 4 };

	v->r = read_domains(v, v->maintenance->core->p.cachefd, "domains", "domains", DEPTH, &v->err);
}
