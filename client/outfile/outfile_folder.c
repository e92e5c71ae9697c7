/*
 * A folder of files that appear together.
 *
 * Files are made in a folder inside of it, .tiles.part, which is locked meanwhile, and moved out when all are complete and
 * durable; a failure before that leaves the outer folder as it was. The old index is removed before the first move, and the
 * new one comes last: if there is an index, all files that it lists are there and belong together. Files that a killed
 * process left in .tiles.part are removed by the next one.
 *
 * Where several processes make the files of one folder, each has an inner folder of its own (outfile_folder_hold), perhaps on
 * another machine: there are no locks then. One process moves all files, and may be followed by another that does the same again.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "err.h"
#include "outfile_priv.h"
#include "io.h"
#include "io_place.h"

#define PART ".tiles.part"

struct outfile_folder {
	char *path;
	const char *index;
	char inner[160];
	int fd, part;
	bool made, locked, kept, no_clobber;
	bool held;  /* another process moves the files */
	bool joins; /* those of several folders are moved */
	bool own;   /* the inner folder was made here */
};

static void empty(int fd)
{
	int copy = openat(fd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	DIR *d = copy < 0 ? NULL : fdopendir(copy);
	struct dirent *e;

	if (!d) {
		io_close(copy);
		return;
	}
	while ((e = readdir(d)))
		if (strcmp(e->d_name, ".") && strcmp(e->d_name, ".."))
			unlinkat(fd, e->d_name, 0);
	closedir(d);
}

static int open_outer(struct outfile_folder *p, struct err *err)
{
	int r = io_place_folder(p->path, 0777, &p->fd, &p->made, err);

	if (r && err->sys == ENOTDIR) {
		err_clear(err);
		err_set(err, ERR_USAGE, "tiles go into a folder, and this is none");
		return err_add_hint(err, "give a folder, or one that is not there yet, as in -o tiles/");
	}
	if (!r && p->no_clobber && !p->joins && !faccessat(p->fd, p->index, F_OK, AT_SYMLINK_NOFOLLOW))
		r = err_set(err, ERR_USAGE, "the folder has tiles already, and --no-clobber was given");
	return r;
}

/* One that has just ended may have removed the folder that was locked. */
static int open_inner(struct outfile_folder *p, struct err *err)
{
	struct stat own, named;
	int r = io_make_dir(p->fd, p->inner, 0777, err);

	if (!r)
		r = io_open(p->fd, p->inner, O_RDONLY | O_DIRECTORY | O_NOFOLLOW, 0, &p->part, err);
	if (r)
		return r;
	if (flock(p->part, LOCK_EX | LOCK_NB) || fstat(p->part, &own) || fstatat(p->fd, p->inner, &named, AT_SYMLINK_NOFOLLOW) ||
	    own.st_ino != named.st_ino || own.st_dev != named.st_dev)
		return err_set(err, ERR_BUSY, "another fetch writes tiles there");
	p->locked = true;
	empty(p->part);
	return 0;
}

/* One of its own, which must not be there. */
static int make_inner(struct outfile_folder *p, struct err *err)
{
	if (io->mkdirat(p->fd, p->inner, 0777))
		return err_sys(err, errno, "cannot make the folder %s", p->inner);
	p->own = true;
	return io_open(p->fd, p->inner, O_RDONLY | O_DIRECTORY | O_NOFOLLOW, 0, &p->part, err);
}

static void inner_name(const char *tag, char *buf, size_t size)
{
	snprintf(buf, size, ".tiles.%s.part", tag);
}

int outfile_folder_hold(const char *dir, const char *index, bool no_clobber, const char *tag, bool joins,
			struct outfile_folder **ret, struct err *err)
{
	struct outfile_folder *p = calloc(1, sizeof(*p));
	int r = 0;

	if (p) {
		p->fd = p->part = -1;
		p->index = index;
		p->no_clobber = no_clobber;
		p->held = tag && !joins;
		p->joins = joins;
		p->path = strdup(dir);
		snprintf(p->inner, sizeof(p->inner), "%s", PART);
		if (tag)
			inner_name(tag, p->inner, sizeof(p->inner));
	}
	if (!p || !p->path)
		r = err_set(err, ERR_NOMEM, "no memory for a folder");
	if (!r)
		r = open_outer(p, err);
	if (!r)
		r = tag ? make_inner(p, err) : open_inner(p, err);
	if (r) {
		outfile_folder_free(p);
		return r;
	}
	*ret = p;
	return 0;
}

int outfile_folder_new(const char *dir, const char *index, bool no_clobber, struct outfile_folder **ret, struct err *err)
{
	return outfile_folder_hold(dir, index, no_clobber, NULL, false, ret, err);
}

int outfile_folder_file(const struct outfile_folder *p, const char *name, struct outfile **ret, struct err *err)
{
	char *path;
	int r;

	if (asprintf(&path, "%s/%s/%s", p->path, p->inner, name) < 0)
		return err_set(err, ERR_NOMEM, "no memory for a file name");
	r = outfile_new(path, false, ret, err);
	free(path);
	if (!r)
		(*ret)->passing = true;
	return r;
}

static int taken(const struct outfile_folder *p, const char *name, struct err *err)
{
	char path[PATH_MAX];

	snprintf(path, sizeof(path), "%s/%s", p->path, name);
	err_set(err, ERR_USAGE, "the output exists already, and --no-clobber was given");
	return err_add_file(err, path);
}

int outfile_folder_clear(struct outfile_folder *p, size_t n, const char *(*name)(void *ctx, size_t i, char *buf), void *ctx,
			 struct err *err)
{
	char buf[OUTFILE_NAME];
	int r;

	if (p->held)
		return 0;
	for (size_t i = 0; i < n && p->no_clobber && !p->joins; i++)
		if (!faccessat(p->fd, name(ctx, i, buf), F_OK, AT_SYMLINK_NOFOLLOW))
			return taken(p, buf, err);
	if (p->no_clobber && !p->joins)
		return 0; /* an index cannot be there, or it is not removed */
	r = io_remove(p->fd, p->index, err);
	return r ? r : outfile_folder_sync(p, err);
}

int outfile_folder_move(struct outfile_folder *p, const char *name, struct err *err)
{
	char path[PATH_MAX];
	int r;

	if (p->held)
		return 0;
	r = outfile_rename(p->part, name, p->fd, name, p->no_clobber && !p->joins);
	if (r && p->no_clobber && errno == EEXIST)
		return taken(p, name, err);
	if (!r)
		return 0;
	snprintf(path, sizeof(path), "%s/%s", p->path, name);
	err_sys(err, errno, "the output cannot be given its name");
	return err_add_file(err, path);
}

int outfile_folder_held(const struct outfile_folder *p, const char *name, struct outfile_held *ret, struct err *err)
{
	struct stat st;

	if (fstatat(p->part, name, &st, AT_SYMLINK_NOFOLLOW)) {
		err_sys(err, errno, "cannot look at an output");
		return err_add_file(err, name);
	}
	*ret = (struct outfile_held){(uint64_t)st.st_size, (uint64_t)st.st_ino};
	return 0;
}

int outfile_folder_settle(struct outfile_folder *p, const char *tag, const char *name, const struct outfile_held *held,
			  struct err *err)
{
	char from[320], path[PATH_MAX];
	int r;

	inner_name(tag, from, sizeof(from));
	snprintf(from + strlen(from), sizeof(from) - strlen(from), "/%s", name);
	r = outfile_settle_at(p->fd, from, name, held, p->no_clobber, err);
	snprintf(path, sizeof(path), "%s/%s", p->path, name);
	return r ? err_add_file(err, path) : 0;
}

bool outfile_folder_has(const struct outfile_folder *p, const char *name, const struct outfile_held *held)
{
	return outfile_is_held(p->fd, name, held);
}

bool outfile_folder_waits(const struct outfile_folder *p, const char *tag, const char *name)
{
	char from[320];

	inner_name(tag, from, sizeof(from));
	snprintf(from + strlen(from), sizeof(from) - strlen(from), "/%s", name);
	return !io->faccessat(p->fd, from, F_OK, AT_SYMLINK_NOFOLLOW);
}

/* Whether two files of `size` bytes are equal; one that cannot be read is not. */
static bool equal_bytes(int a, int b, uint64_t size, uint8_t *buf, size_t room)
{
	struct err ignored = ERR_INIT;
	int r = 0;

	for (uint64_t at = 0; at < size && !r; at += room / 2) {
		size_t n = size - at < room / 2 ? (size_t)(size - at) : room / 2;

		r = io_read_at(a, buf, n, at, PART, &ignored);
		if (!r)
			r = io_read_at(b, buf + room / 2, n, at, PART, &ignored);
		if (!r && memcmp(buf, buf + room / 2, n))
			return false;
	}
	return !r;
}

bool outfile_folder_same(const struct outfile_folder *p, const char *name)
{
	enum { ROOM = 1 << 17 };
	struct err ignored = ERR_INIT;
	struct stat ours, theirs;
	uint8_t *buf = malloc(ROOM);
	int a = -1, b = -1;
	bool same = buf && !io_open(p->part, name, O_RDONLY | O_NOFOLLOW, 0, &a, &ignored) &&
		    !io_open(p->fd, name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK, 0, &b, &ignored) && !io->fstat(a, &ours) &&
		    !io->fstat(b, &theirs) && S_ISREG(theirs.st_mode) && ours.st_size == theirs.st_size &&
		    equal_bytes(a, b, (uint64_t)ours.st_size, buf, ROOM);

	io_close(a);
	io_close(b);
	free(buf);
	return same;
}

void outfile_folder_drop(const char *dir, const char *tag)
{
	struct err ignored = ERR_INIT;
	char name[160];
	int fd = -1;

	inner_name(tag, name, sizeof(name));
	if (!io_place_folder(dir, 0, &fd, NULL, &ignored))
		io_folder_remove(fd, name, &ignored);
	io_close(fd);
}

int outfile_folder_sync(struct outfile_folder *p, struct err *err)
{
	int r = p->held ? io_sync(p->part, p->path, err) : 0;

	return r ? r : io_sync(p->fd, p->path, err);
}

void outfile_folder_keep(struct outfile_folder *p)
{
	p->kept = true;
}

struct outfile_folder *outfile_folder_free(struct outfile_folder *p)
{
	if (!p)
		return NULL;
	if (p->locked || (p->own && !(p->held && p->kept))) {
		empty(p->part);
		unlinkat(p->fd, p->inner, AT_REMOVEDIR);
	}
	if (p->made && !p->kept && !p->held)
		rmdir(p->path);
	io_close(p->part);
	io_close(p->fd);
	free(p->path);
	free(p);
	return NULL;
}
