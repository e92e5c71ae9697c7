/*
 * A folder of files that appear together.
 *
 * Files are made in a folder inside of it, .tiles.part, which is locked meanwhile, and moved out when all are complete and
 * durable; a failure before that leaves the outer folder as it was. The old index is removed before the first move, and the
 * new one comes last: if there is an index, all files that it lists are there and belong together. Files that a killed
 * process left in .tiles.part are removed by the next one.
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
	int fd, part;
	bool made, locked, kept, no_clobber;
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
	if (!r && p->no_clobber && !faccessat(p->fd, p->index, F_OK, AT_SYMLINK_NOFOLLOW))
		r = err_set(err, ERR_USAGE, "the folder has tiles already, and --no-clobber was given");
	return r;
}

/* One that has just ended may have removed the folder that was locked. */
static int open_inner(struct outfile_folder *p, struct err *err)
{
	struct stat own, named;
	int r = io_make_dir(p->fd, PART, 0777, err);

	if (!r)
		r = io_open(p->fd, PART, O_RDONLY | O_DIRECTORY | O_NOFOLLOW, 0, &p->part, err);
	if (r)
		return r;
	if (flock(p->part, LOCK_EX | LOCK_NB) || fstat(p->part, &own) || fstatat(p->fd, PART, &named, AT_SYMLINK_NOFOLLOW) ||
	    own.st_ino != named.st_ino || own.st_dev != named.st_dev)
		return err_set(err, ERR_BUSY, "another fetch writes tiles there");
	p->locked = true;
	empty(p->part);
	return 0;
}

int outfile_folder_new(const char *dir, const char *index, bool no_clobber, struct outfile_folder **ret, struct err *err)
{
	struct outfile_folder *p = calloc(1, sizeof(*p));
	int r = 0;

	if (p) {
		p->fd = p->part = -1;
		p->index = index;
		p->no_clobber = no_clobber;
		p->path = strdup(dir);
	}
	if (!p || !p->path)
		r = err_set(err, ERR_NOMEM, "no memory for a folder");
	if (!r)
		r = open_outer(p, err);
	if (!r)
		r = open_inner(p, err);
	if (r) {
		outfile_folder_free(p);
		return r;
	}
	*ret = p;
	return 0;
}

int outfile_folder_file(const struct outfile_folder *p, const char *name, struct outfile **ret, struct err *err)
{
	char *path;
	int r;

	if (asprintf(&path, "%s/" PART "/%s", p->path, name) < 0)
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

	for (size_t i = 0; i < n && p->no_clobber; i++)
		if (!faccessat(p->fd, name(ctx, i, buf), F_OK, AT_SYMLINK_NOFOLLOW))
			return taken(p, buf, err);
	if (p->no_clobber)
		return 0; /* an index cannot be there, or it is not removed */
	r = io_remove(p->fd, p->index, err);
	return r ? r : outfile_folder_sync(p, err);
}

int outfile_folder_move(struct outfile_folder *p, const char *name, struct err *err)
{
	char path[PATH_MAX];
	int r;

	if (!p->no_clobber) {
		r = renameat(p->part, name, p->fd, name);
	} else {
		r = renameat2(p->part, name, p->fd, name, RENAME_NOREPLACE);
		if (r && (errno == EINVAL || errno == ENOSYS) && !(r = linkat(p->part, name, p->fd, name, 0)))
			unlinkat(p->part, name, 0);
		if (r && errno == EEXIST)
			return taken(p, name, err);
	}
	if (!r)
		return 0;
	snprintf(path, sizeof(path), "%s/%s", p->path, name);
	err_sys(err, errno, "the output cannot be given its name");
	return err_add_file(err, path);
}

int outfile_folder_sync(struct outfile_folder *p, struct err *err)
{
	return io_sync(p->fd, p->path, err);
}

void outfile_folder_keep(struct outfile_folder *p)
{
	p->kept = true;
}

struct outfile_folder *outfile_folder_free(struct outfile_folder *p)
{
	if (!p)
		return NULL;
	if (p->locked) {
		empty(p->part);
		unlinkat(p->fd, PART, AT_REMOVEDIR);
	}
	if (p->made && !p->kept)
		rmdir(p->path);
	io_close(p->part);
	io_close(p->fd);
	free(p->path);
	free(p);
	return NULL;
}
