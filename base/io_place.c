/*
 * Finding the folder of an output, and the output's name in it.
 *
 * A path is resolved component by component. Each is opened once, relative to the previous one and without following
 * links (O_PATH). What was opened is checked and used to continue, so nobody can exchange it in between. A link is
 * checked by its own owner and by its folder; then its text replaces it in the rest of the path. The rule is the
 * kernel's (protected_symlinks). A program that renames its output to the final name bypasses the kernel's check,
 * because no open follows a link then.
 */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <linux/magic.h>

#include "err.h"
#include "io.h"
#include "io_place.h"

enum { LINKS_MOST = 40 };

struct path_walk {
	const char *path; /* as given by the caller */
	int dirfd;
	char rest[PATH_MAX]; /* rest of the path, from dirfd on */
	unsigned links;
};

static int failed(const struct path_walk *w, int sys, struct err *err)
{
	err_sys(err, sys, "cannot open");
	return err_add_file(err, w->path);
}

static int no_folder(const struct path_walk *w, int sys, struct err *err)
{
	err_sys(err, sys, "the folder that it is to lie in cannot be opened");
	return err_add_file(err, w->path);
}

static void continue_from(struct path_walk *w, int fd)
{
	io_close(w->dirfd);
	w->dirfd = fd;
}

/* Opens the root, the current folder, or the parent folder: these are no links. */
static int step_into(struct path_walk *w, const char *name, struct err *err)
{
	struct err why = ERR_INIT;
	int fd;

	if (io_open(w->dirfd, name, O_PATH | O_DIRECTORY, 0, &fd, &why))
		return no_folder(w, why.sys, err);
	continue_from(w, fd);
	return 0;
}

/* Sets the rest of the path, which begins at the root or in the current folder. */
static int set_rest(struct path_walk *w, const char *first, const char *then, struct err *err)
{
	char all[PATH_MAX];
	int n = snprintf(all, sizeof all, "%s%s%s", first, *then ? "/" : "", then);

	if (n >= (int)sizeof all)
		return failed(w, ENAMETOOLONG, err);
	memcpy(w->rest, all, (size_t)n + 1);
	return *w->rest == '/' ? step_into(w, "/", err) : 0;
}

static int refuse_link(const struct path_walk *w, const char *name, uid_t owner, struct err *err)
{
	err_set(err, ERR_PERM,
		"\"%.100s\" is a link that the user with id %u has put into a folder that everybody may write into: "
		"it is not followed",
		name, (unsigned)owner);
	err_add_hint(err, "write to another name or folder; where you trust that user, name what the link leads to");
	return err_add_file(err, w->path);
}

static int may_follow(const struct path_walk *w, const char *name, const struct stat *link, struct err *err)
{
	struct stat dir;

	if (fstat(w->dirfd, &dir))
		return failed(w, errno, err);
	if ((dir.st_mode & (S_ISVTX | S_IWOTH)) != (S_ISVTX | S_IWOTH) || link->st_uid == geteuid() || link->st_uid == dir.st_uid)
		return 0;
	return refuse_link(w, name, link->st_uid, err);
}

static bool is_proc(int fd)
{
	struct statfs fs;

	return fstatfs(fd, &fs) == 0 && fs.f_type == PROC_SUPER_MAGIC;
}

enum found { FOUND_NOTHING, FOUND_OTHER, FOUND_FOLDER, FOUND_LINK, FOUND_OPAQUE };

/* *ret_fd: the folder if it is one, else -1. For a link: its text, after checking that it may be followed. */
static int inspect(struct path_walk *w, const char *name, char text[PATH_MAX], enum found *ret, int *ret_fd, struct err *err)
{
	int fd = openat(w->dirfd, name, O_PATH | O_NOFOLLOW | O_CLOEXEC), r = 0;
	struct stat st;
	ssize_t n;

	*ret = fd < 0 ? FOUND_NOTHING : FOUND_OTHER;
	*ret_fd = -1;
	if (fd < 0)
		return errno == ENOENT ? 0 : failed(w, errno, err);
	if (fstat(fd, &st)) {
		r = failed(w, errno, err);
	} else if (S_ISDIR(st.st_mode)) {
		*ret = FOUND_FOLDER;
		*ret_fd = fd;
		return 0;
	} else if (S_ISLNK(st.st_mode)) {
		n = readlinkat(fd, "", text, PATH_MAX);
		if (n < 0 || n == PATH_MAX)
			r = failed(w, n < 0 ? errno : ENAMETOOLONG, err);
		else
			text[n] = 0;
		*ret = !r && *text != '/' && is_proc(fd) ? FOUND_OPAQUE : FOUND_LINK;
		if (!r)
			r = may_follow(w, name, &st, err);
		if (!r && ++w->links > LINKS_MOST)
			r = failed(w, ELOOP, err);
	}
	io_close(fd);
	return r;
}

/* Removes the first component of the rest; *ret_more: something follows it, if only a slash. */
static void take_component(struct path_walk *w, char name[NAME_MAX + 2], bool *ret_more)
{
	const char *from = w->rest + strspn(w->rest, "/");
	size_t n = strcspn(from, "/"), k = n <= NAME_MAX ? n : NAME_MAX + 1;

	memcpy(name, from, k);
	name[k] = 0;
	*ret_more = from[n] == '/';
	from += n;
	from += strspn(from, "/");
	memmove(w->rest, from, strlen(from) + 1);
}

/* `name` is the last component of the path. */
static int found_place(struct path_walk *w, const char *name, bool opaque, struct io_place *ret, struct err *err)
{
	char *copy = strdup(name);

	if (!copy)
		return err_set(err, ERR_NOMEM, "no memory for a file name");
	*ret = (struct io_place){w->dirfd, copy, opaque};
	w->dirfd = -1;
	return 0;
}

static int resolve(struct path_walk *w, bool follow, struct io_place *ret, struct err *err)
{
	char name[NAME_MAX + 2], text[PATH_MAX];
	enum found found;
	bool more;
	int r, fd;

	for (;;) {
		take_component(w, name, &more);
		if (!*name)
			return found_place(w, "", false, ret, err);
		if (!strcmp(name, ".") || !strcmp(name, "..")) {
			r = step_into(w, name, err);
			if (r)
				return r;
			continue;
		}
		if (!more && !follow)
			return found_place(w, name, false, ret, err);
		r = inspect(w, name, text, &found, &fd, err);
		if (r)
			return r;
		if (!more && found != FOUND_LINK) {
			io_close(fd);
			return found_place(w, name, found == FOUND_OPAQUE, ret, err);
		}
		/* A link at the end that leads to a folder is followed like any other; the text of /proc/self is a path. */
		if (found == FOUND_LINK || found == FOUND_OPAQUE)
			r = set_rest(w, text, more ? (*w->rest ? w->rest : ".") : "", err);
		else if (found == FOUND_FOLDER)
			continue_from(w, fd);
		else
			r = no_folder(w, found == FOUND_NOTHING ? ENOENT : ENOTDIR, err);
		if (r)
			return r;
	}
}

int io_place_find(const char *path, bool follow, struct io_place *ret, struct err *err)
{
	struct path_walk w = {.path = path, .dirfd = AT_FDCWD};
	int r = *path ? 0 : failed(&w, ENOENT, err);

	/* The current folder may be inaccessible; a path from the root does not need it. */
	if (!r && *path != '/')
		r = step_into(&w, ".", err);
	if (!r)
		r = set_rest(&w, path, "", err);
	if (!r)
		r = resolve(&w, follow, ret, err);
	io_close(w.dirfd);
	return r;
}

void io_place_done(struct io_place *p)
{
	p->dirfd = io_close(p->dirfd);
	free(p->name);
	p->name = NULL;
}

int io_place_folder(const char *path, mode_t mode, int *ret_fd, bool *ret_made, struct err *err)
{
	size_t n = strlen(path);
	char *bare = strdup(path);
	struct io_place p;
	bool made = false;
	int r;

	if (!bare)
		return err_set(err, ERR_NOMEM, "no memory for a file name");
	while (n > 1 && bare[n - 1] == '/')
		bare[--n] = 0;
	r = io_place_find(bare, true, &p, err);
	free(bare);
	if (r)
		return r;
	if (*p.name && mode) {
		made = io->mkdirat(p.dirfd, p.name, mode) == 0;
		if (!made && errno != EEXIST)
			r = err_sys(err, errno, "cannot make the folder");
	}
	/* It may be a link that was made meanwhile. */
	if (!r)
		r = io_open(p.dirfd, *p.name ? p.name : ".", O_RDONLY | O_DIRECTORY | O_NOFOLLOW, 0, ret_fd, err);
	if (r) {
		err->file[0] = 0;
		err_add_file(err, path);
	} else if (ret_made) {
		*ret_made = made;
	}
	io_place_done(&p);
	return r;
}
