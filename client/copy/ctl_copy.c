/*
 * A folder that files of the daemon are copied into, again and again.
 *
 * Files that never change under their name are copied once, by a hard link where the folder is on the daemon's file system
 * and that is allowed. Files that change are copied each time, the last of them when all others are on the disk. Whatever
 * happens in between, the folder is as it was the last time, with some more files. Files of an earlier time are removed at
 * the end. The folder has a mark, so that no other folder is written into.
 */
#include "ctl_copy.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "io_place.h"

#define MARK "acut-copy"
#define STORE "acut-state"
enum { SAMPLE = 4096, STEP = 1 << 20, PATH = 320, ID_AT = 16, ID_BYTES = 16 }; /* ID: of STORE, format.md */

static int failed(struct err *err, const char *what, const char *name)
{
	err_sys(err, errno, "%s", what);
	return err_add_file(err, name);
}

/* ---- the mark ---- */

static int write_mark(const struct ctl_copy *c, bool whole, struct err *err)
{
	char text[640], when[32];
	int fd, n, r = 0;

	term_time(c->begun_us, when);
	n = snprintf(text, sizeof text, "acut copy 1\nof %s\n%s %s\nfiles %llu\nbytes %llu\n%s%s%s", c->what,
		     whole ? "whole, as of" : "begun", when, (unsigned long long)c->files, (unsigned long long)c->bytes,
		     *c->identity ? "identity " : "", c->identity, *c->identity ? "\n" : "");
	fd = openat(c->dirfd, MARK ".part", O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600);
	if (fd < 0)
		return failed(err, "cannot write", c->dir);
	if (write(fd, text, (size_t)n) != n || fsync(fd) < 0 || renameat(c->dirfd, MARK ".part", c->dirfd, MARK) < 0 ||
	    fsync(c->dirfd) < 0)
		r = failed(err, "cannot write", c->dir);
	close(fd);
	return r;
}

/* 1: no mark. */
static int read_mark(const struct ctl_copy *c, struct err *err)
{
	char text[640] = "", of[112], id[80];
	const char *has;
	int fd = openat(c->dirfd, MARK, O_RDONLY | O_CLOEXEC | O_NOFOLLOW);

	if (fd < 0)
		return errno == ENOENT ? 1 : failed(err, "cannot read", c->dir);
	if (read(fd, text, sizeof text - 1) < 0)
		text[0] = 0;
	close(fd);
	snprintf(of, sizeof of, "\nof %s\n", c->what);
	snprintf(id, sizeof id, "\nidentity %s\n", c->identity);
	has = strstr(text, "\nidentity "); /* the first ones had none */
	if (!strncmp(text, "acut copy ", 10) && strncmp(text, "acut copy 1\n", 12))
		err_set(err, ERR_VERSION, "this folder was written by a newer acutctl");
	else if (!strstr(text, of))
		err_set(err, ERR_USAGE, "this folder holds something else than the %s", c->what);
	else if (has && *c->identity && strncmp(has, id, strlen(id)))
		err_set(err, ERR_USAGE,
			c->flat ? "this folder holds another %s: one of the same name, but not the same one" :
				  "this folder holds the backup of another store, not of this %s",
			c->what);
	else
		return 0;
	err_add_hint(err, "give another folder");
	return err_add_file(err, c->dir);
}

static bool is_empty(int dirfd)
{
	int fd = openat(dirfd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	DIR *dir = fd < 0 ? NULL : fdopendir(fd);
	struct dirent *e;
	bool empty = dir != NULL;

	while (dir && (e = readdir(dir)))
		empty &= !strcmp(e->d_name, ".") || !strcmp(e->d_name, "..") || !strcmp(e->d_name, "lost+found");
	if (dir)
		closedir(dir);
	else if (fd >= 0)
		close(fd);
	return empty;
}

/* The daemon may take files in its own folders for its own, or delete them with its cache. */
static int check_place(const struct ctl_copy *c, struct err *err)
{
	int fd = openat(c->dirfd, ".", O_PATH | O_DIRECTORY | O_CLOEXEC), r = 0;
	struct stat st, last = {0};

	while (!r && fd >= 0 && fstat(fd, &st) == 0 && (st.st_dev != last.st_dev || st.st_ino != last.st_ino)) {
		int up = openat(fd, "..", O_PATH | O_DIRECTORY | O_CLOEXEC);

		for (size_t i = 0; !r && i < 2; i++)
			if (c->place[i].inode && c->place[i].device == (uint64_t)st.st_dev &&
			    c->place[i].inode == (uint64_t)st.st_ino)
				r = err_set(err, ERR_USAGE, "this folder is in the %s folder of the daemon, or is that folder",
					    c->place[i].what);
		last = st;
		close(fd);
		fd = up;
	}
	if (fd >= 0)
		close(fd);
	if (!r)
		return 0;
	err_add_hint(err, "give a folder elsewhere, best on another disk");
	return err_add_file(err, c->dir);
}

int ctl_copy_begin(struct ctl_copy *c, struct err *err)
{
	bool made;
	int r;

	c->begun_us = clock_real_us();
	c->storefd = -1;
	c->dirfd = -1;
	r = io_place_folder(c->dir, 0700, &c->dirfd, &made, err);
	if (r)
		return r;
	r = check_place(c, err);
	if (r) {
		if (made)
			rmdir(c->dir);
		return r;
	}
	if (flock(c->dirfd, LOCK_EX | LOCK_NB) < 0) {
		if (errno != EWOULDBLOCK)
			return failed(err, "cannot lock the folder", c->dir);
		err_set(err, ERR_BUSY, "another acutctl writes into this folder");
		return err_add_file(err, c->dir);
	}
	r = read_mark(c, err);
	if (r < 0)
		return r;
	if (r && !is_empty(c->dirfd)) {
		err_set(err, ERR_USAGE, "this folder is neither empty nor one that acutctl has written before");
		err_add_hint(err, "give a new folder, or that of the last time");
		return err_add_file(err, c->dir);
	}
	if (!c->flat && faccessat(c->dirfd, "lock", F_OK, AT_SYMLINK_NOFOLLOW) == 0) {
		/* Its catalogue would be taken from under that daemon, and what was pushed since. */
		err_set(err, ERR_USAGE, "this folder has been the state of an acutd since it was a backup");
		err_add_hint(err, "give another folder; a backup is copied before an acutd is started on it");
		return err_add_file(err, c->dir);
	}
	return r ? write_mark(c, false, err) : 0;
}

/* ---- one file ---- */

static int remember(struct ctl_copy *c, const char *name)
{
	char **more;

	if (c->n == c->room) {
		c->room = c->room ? 2 * c->room : 64;
		more = realloc(c->name, c->room * sizeof *more);
		if (!more)
			return err_set(&c->err, ERR_NOMEM, "no memory for the names of files");
		c->name = more;
	}
	c->name[c->n] = strdup(name);
	if (!c->name[c->n])
		return err_set(&c->err, ERR_NOMEM, "no memory for the names of files");
	c->n++;
	return 0;
}

/* Makes and opens the folder of the file; *ret_base: its name there. */
static int parent_of(struct ctl_copy *c, const char *name, int *ret_fd, const char **ret_base)
{
	char path[PATH];
	char *slash;
	int fd;

	snprintf(path, sizeof path, "%s", name);
	for (slash = strchr(path, '/'); slash; slash = strchr(slash + 1, '/')) {
		*slash = 0;
		if (mkdirat(c->dirfd, path, 0700) < 0 && errno != EEXIST)
			return failed(&c->err, "cannot make the folder", path);
		*slash = '/';
	}
	slash = strrchr(path, '/');
	if (slash)
		*slash = 0;
	fd = openat(c->dirfd, slash ? path : ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
	if (fd < 0)
		return failed(&c->err, "cannot open the folder", path);
	*ret_fd = fd;
	*ret_base = strrchr(name, '/') ? strrchr(name, '/') + 1 : name;
	return 0;
}

/* Lasting files contain checksums of all their bytes at their beginning and end, so comparing these is enough. */
static bool same_piece(int a, int b, uint64_t at, size_t n)
{
	uint8_t x[SAMPLE], y[SAMPLE];

	return pread(a, x, n, (off_t)at) == (ssize_t)n && pread(b, y, n, (off_t)at) == (ssize_t)n && !memcmp(x, y, n);
}

static bool is_there(int dirfd, const char *base, const struct acut_backup_file *f)
{
	int fd = openat(dirfd, base, O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
	size_t n = f->size < SAMPLE ? (size_t)f->size : SAMPLE;
	struct stat st;
	bool same;

	if (fd < 0)
		return false;
	same = !fstat(fd, &st) && S_ISREG(st.st_mode) && (uint64_t)st.st_size == f->size && same_piece(fd, f->fd, 0, n) &&
	       same_piece(fd, f->fd, f->size - n, n);
	close(fd);
	return same;
}

static bool make_link(const struct ctl_copy *c, const struct acut_backup_file *f, int dirfd, const char *temp)
{
	char from[48];

	if (c->no_links || !f->lasting)
		return false;
	snprintf(from, sizeof from, "/proc/self/fd/%d", f->fd);
	return linkat(AT_FDCWD, from, dirfd, temp, AT_SYMLINK_FOLLOW) == 0;
}

static int make_copy(struct ctl_copy *c, const struct acut_backup_file *f, int dirfd, const char *temp)
{
	int fd = openat(dirfd, temp, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600), r = 0;
	uint64_t done = 0;
	off_t from = 0;

	if (fd < 0)
		return failed(&c->err, "cannot write", f->name);
	while (!r && done < f->size) {
		/* Shares the blocks where the file system can. */
		ssize_t n = copy_file_range(f->fd, &from, fd, NULL, f->size - done < STEP * 64 ? f->size - done : STEP * 64, 0);

		if (n < 0 && (errno == EXDEV || errno == EINVAL || errno == EOPNOTSUPP || errno == ENOSYS)) {
			static uint8_t buf[STEP];

			n = pread(f->fd, buf, sizeof buf, from);
			if (n > 0)
				n = write(fd, buf, (size_t)n);
			if (n > 0)
				from += n;
		}
		if (n < 0 && errno == EINTR)
			continue;
		if (n < 0)
			r = failed(&c->err, "cannot copy", f->name);
		else if (n == 0)
			r = err_set(&c->err, ERR_TRUNCATED, "%s ends %llu bytes too early", f->name,
				    (unsigned long long)(f->size - done));
		else
			done += (uint64_t)n;
		if (!r && session_interrupted(c->session))
			r = err_set(&c->err, ERR_CANCELLED, "interrupted");
	}
	/* Complete before it gets its name: the next time only its ends are compared. */
	if (!r && fsync(fd) < 0)
		r = failed(&c->err, "cannot bring to disk", f->name);
	close(fd);
	return r;
}

static int bring(struct ctl_copy *c, const struct acut_backup_file *f, int dirfd, const char *base)
{
	char temp[PATH];
	bool linked;
	int r = 0;

	snprintf(temp, sizeof temp, "%s.part", base);
	unlinkat(dirfd, temp, 0);
	linked = make_link(c, f, dirfd, temp);
	if (!linked)
		r = make_copy(c, f, dirfd, temp);
	/* All that the last one speaks of is there. */
	if (!r && !f->lasting && !strchr(f->name, '/') && syncfs(c->dirfd) < 0)
		r = failed(&c->err, "cannot bring to disk", c->dir);
	if (!r && renameat(dirfd, temp, dirfd, base) < 0)
		r = failed(&c->err, "cannot rename", f->name);
	if (r)
		unlinkat(dirfd, temp, 0);
	c->linked += linked;
	return r;
}

/* The backup of another store would lose its files to this one. *ret: there is one, of this store. */
static int same_store(struct ctl_copy *c, const struct acut_backup_file *f, bool *ret)
{
	uint8_t old[ID_BYTES], new[ID_BYTES];
	int fd = openat(c->dirfd, STORE, O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
	bool read_both;

	*ret = fd >= 0;
	if (fd < 0)
		return errno == ENOENT ? 0 : failed(&c->err, "cannot read", STORE);
	read_both = pread(fd, old, sizeof old, ID_AT) == ID_BYTES && pread(f->fd, new, sizeof new, ID_AT) == ID_BYTES;
	close(fd);
	if (read_both && !memcmp(old, new, sizeof old))
		return 0;
	err_set(&c->err, ERR_USAGE, "this folder holds the backup of another store");
	err_add_hint(&c->err, "give another folder");
	return err_add_file(&c->err, c->dir);
}

static int take(struct ctl_copy *c, const struct acut_backup_file *f)
{
	const char *base;
	int dirfd = -1, r;

	r = parent_of(c, f->name, &dirfd, &base);
	if (!r && !(f->lasting && is_there(dirfd, base, f))) {
		r = bring(c, f, dirfd, base);
		c->new_files += !r;
		c->new_bytes += r ? 0 : f->size;
	}
	if (dirfd >= 0)
		close(dirfd);
	return r;
}

/* Not before the catalogue: a folder that has this alone passes for a store. */
static int take_store(struct ctl_copy *c)
{
	const struct acut_backup_file f = {.name = STORE, .size = c->store_size, .fd = c->storefd};
	int r = c->storefd < 0 ? 0 : take(c, &f);

	if (c->storefd >= 0)
		close(c->storefd);
	c->storefd = -1;
	return r;
}

static int keep_store(struct ctl_copy *c, const struct acut_backup_file *f)
{
	bool there;
	int r = same_store(c, f, &there);

	if (r || there)
		return r ? r : take(c, f);
	c->store_size = f->size;
	c->storefd = fcntl(f->fd, F_DUPFD_CLOEXEC, 3);
	return c->storefd < 0 ? failed(&c->err, "cannot keep", f->name) : 0;
}

int ctl_copy_file(void *ctx, const struct acut_backup_file *f)
{
	struct ctl_copy *c = ctx;
	int r;

	if (session_interrupted(c->session))
		return err_set(&c->err, ERR_CANCELLED, "interrupted"), -1;
	r = remember(c, f->name);
	if (!r && !c->flat && !strcmp(f->name, STORE)) {
		r = keep_store(c, f);
	} else {
		if (!r && !c->flat && !strchr(f->name, '/'))
			r = take_store(c);
		if (!r)
			r = take(c, f);
	}
	c->files++;
	c->bytes += f->size;
	return r ? -1 : 0;
}

/* ---- the end ---- */

static int by_name(const void *a, const void *b)
{
	return strcmp(*(char *const *)a, *(char *const *)b);
}

/* Files in `folder` that did not come this time. Other folders in it only if they are as the daemon names them. */
static int sweep(struct ctl_copy *c, const char *folder, struct err *err)
{
	int fd = openat(c->dirfd, *folder ? folder : ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW), r = 0;
	char path[PATH + 272];
	const char *key = path;
	struct dirent *e;
	DIR *dir;

	if (fd < 0)
		return errno == ENOENT ? 0 : failed(err, "cannot open the folder", folder);
	dir = fdopendir(fd);
	if (!dir) {
		close(fd);
		return failed(err, "cannot list the folder", folder);
	}
	while (!r && (e = readdir(dir))) {
		struct stat st;

		if (*e->d_name == '.' || (!*folder && !strcmp(e->d_name, MARK)))
			continue;
		snprintf(path, sizeof path, "%s%s%s", folder, *folder ? "/" : "", e->d_name);
		if (fstatat(fd, e->d_name, &st, AT_SYMLINK_NOFOLLOW) < 0)
			continue;
		if (S_ISDIR(st.st_mode)) {
			if (!strcmp(folder, "datasets"))
				r = sweep(c, path, err);
			if (!r)
				unlinkat(fd, e->d_name, AT_REMOVEDIR); /* if it is empty now */
		} else if (S_ISREG(st.st_mode) && !bsearch(&key, c->name, c->n, sizeof *c->name, by_name)) {
			if (unlinkat(fd, e->d_name, 0) < 0)
				r = failed(err, "cannot remove", path);
			c->removed += !r;
		}
	}
	closedir(dir);
	return r;
}

int ctl_copy_end(struct ctl_copy *c, struct err *err)
{
	int r = 0;

	if (fsync(c->dirfd) < 0 || syncfs(c->dirfd) < 0)
		return failed(err, "cannot bring to disk", c->dir);
	qsort(c->name, c->n, sizeof *c->name, by_name);
	if (c->flat) {
		r = sweep(c, "", err);
	} else {
		r = sweep(c, "datasets", err);
		if (!r)
			r = sweep(c, "geoids", err);
		if (!r)
			r = sweep(c, "plans", err);
	}
	return r ? r : write_mark(c, true, err);
}

void ctl_copy_done(struct ctl_copy *c)
{
	for (size_t i = 0; i < c->n; i++)
		free(c->name[i]);
	free(c->name);
	if (c->storefd >= 0)
		close(c->storefd);
	if (c->dirfd >= 0)
		close(c->dirfd);
}
