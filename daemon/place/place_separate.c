/*
 * Checks that state and cache are separate folders. Deleting the cache must not lose data, so it may neither be the state folder,
 * nor contain it, nor be inside the folders that the store makes for itself.
 *
 * Paths do not show this because of links, mounts and "..". So folders are compared by device and inode, from the folder up to
 * the root. A folder that does not exist yet is described by its nearest existing ancestor and the names below that. A bind mount
 * of a folder in between has other ancestors, and is not noticed.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "err.h"
#include "io.h"
#include "place.h"

enum { PATH = 512, DEPTH = 256 };

struct location {
	struct stat up[DEPTH]; /* the nearest existing folder, and its ancestors */
	unsigned n;
	char names_below[PATH]; /* names below it, each after a '/'; "": the folder itself exists */
};

/* Folders of the store: the daemon lists and sweeps them. */
static const char *const store_folders[] = {"datasets", "plans", "geoids"};

/* Removes the last name of `path`. False: there is none. */
static bool cut_last_name(char path[PATH], char ret_name[PATH])
{
	char *slash;
	size_t n = strlen(path);

	while (n > 1 && path[n - 1] == '/')
		path[--n] = 0;
	slash = strrchr(path, '/');
	if (!n || !strcmp(path, "/") || !strcmp(path, "."))
		return false;
	snprintf(ret_name, PATH, "%s", slash ? slash + 1 : path);
	if (!slash)
		strcpy(path, ".");
	else
		slash[slash == path] = 0;
	return true;
}

/* Inserts a name at the beginning. */
static bool prepend(char names_below[PATH], const char *name)
{
	char was[PATH];

	memcpy(was, names_below, sizeof was);
	return (size_t)snprintf(names_below, PATH, "/%s%s", name, was) < PATH;
}

static int open_step(int fd, const char *name)
{
	int to = openat(fd, name, O_PATH | O_DIRECTORY | O_CLOEXEC);

	if (to >= 0)
		close(fd);
	return to;
}

/* From the folder up to which the path exists: goes up by `up`, for ".." that no missing name takes back, then down as far as
 * names exist. */
static int follow(int fd, unsigned up, char names_below[PATH])
{
	char name[PATH], *next;
	int to = fd;

	while (up-- && to >= 0)
		to = open_step(fd = to, "..");
	while (to >= 0 && *names_below) {
		snprintf(name, sizeof name, "%.*s", (int)strcspn(names_below + 1, "/"), names_below + 1);
		next = names_below + 1 + strlen(name);
		fd = to;
		to = open_step(fd, name);
		if (to < 0)
			return fd;
		memmove(names_below, next, strlen(next) + 1);
	}
	if (to < 0)
		close(fd);
	return to;
}

/* Opens the nearest existing folder. Missing names will be made one by one, so a ".." after one leads back to where it is
 * made. */
static int open_nearest(const char *path, char names_below[PATH])
{
	char at[PATH], name[PATH];
	unsigned up = 0;
	int fd;

	if ((size_t)snprintf(at, sizeof at, "%s", path) >= sizeof at)
		return -1;
	while ((fd = open(at, O_PATH | O_DIRECTORY | O_CLOEXEC)) < 0) {
		if ((errno != ENOENT && errno != ENOTDIR) || !cut_last_name(at, name))
			return -1;
		if (!strcmp(name, ".."))
			up++;
		else if (strcmp(name, ".") && up)
			up--;
		else if (strcmp(name, ".") && !prepend(names_below, name))
			return -1;
	}
	return follow(fd, up, names_below);
}

/* False: it is unknown; opening the folder later fails with the reason. */
static bool find_location(const char *path, struct location *ret)
{
	int fd;

	*ret = (struct location){0};
	fd = open_nearest(path, ret->names_below);
	if (fd < 0)
		return false;
	while (ret->n < DEPTH && fstat(fd, &ret->up[ret->n]) == 0) {
		int up;

		if (ret->n && ret->up[ret->n].st_dev == ret->up[ret->n - 1].st_dev &&
		    ret->up[ret->n].st_ino == ret->up[ret->n - 1].st_ino)
			break; /* the root is its own parent */
		ret->n++;
		up = openat(fd, "..", O_PATH | O_DIRECTORY | O_CLOEXEC);
		close(fd);
		fd = up;
	}
	if (fd >= 0)
		close(fd);
	return ret->n > 0;
}

static bool is_same(const struct stat *a, const struct stat *b)
{
	return a->st_dev == b->st_dev && a->st_ino == b->st_ino;
}

static bool is_below(const char *names_below, const char *of)
{
	size_t n = strlen(of);

	return !strncmp(names_below, of, n) && (!names_below[n] || names_below[n] == '/');
}

/* `a` is `b`, or inside of it. */
static bool is_inside(const struct location *a, const struct location *b)
{
	if (*b->names_below)
		return is_same(&a->up[0], &b->up[0]) && is_below(a->names_below, b->names_below);
	for (unsigned i = 0; i < a->n; i++)
		if (is_same(&a->up[i], &b->up[0]))
			return true;
	return false;
}

/* The folder of the store that `cache` is, or is inside of; NULL: none. */
static const char *find_store_folder(const struct location *cache, const char *state)
{
	char path[PATH + 16];
	struct location s;

	for (size_t i = 0; i < sizeof store_folders / sizeof *store_folders; i++) {
		snprintf(path, sizeof path, "%s/%s", state, store_folders[i]);
		if (find_location(path, &s) && is_inside(cache, &s))
			return store_folders[i];
	}
	return NULL;
}

static int refuse(const char *cache, const char *hint, struct err *err)
{
	err_add_hint(err, "%s", hint);
	return err_add_file(err, cache);
}

int place_check_separate(const char *state, const char *cache, bool temporary, struct err *err)
{
	struct location s, c;
	const char *in;

	if (!*state || !*cache || !find_location(state, &s) || !find_location(cache, &c))
		return 0;
	if (is_inside(&s, &c) && is_inside(&c, &s)) {
		err_set(err, ERR_USAGE, "the cache folder is the state folder (%s): the cache must be a folder of its own",
			state);
		return refuse(cache, "give --cache another folder", err);
	}
	if (is_inside(&s, &c) && !temporary) {
		err_set(err, ERR_USAGE,
			"the state folder (%s) lies in the cache folder: emptying the cache would delete the pushed data", state);
		return refuse(cache, "give --cache or --state another folder", err);
	}
	in = is_inside(&c, &s) ? find_store_folder(&c, state) : NULL;
	if (!in)
		return 0;
	err_set(err, ERR_USAGE, "the cache folder lies in %s of the state folder (%s), where the store has what was pushed", in,
		state);
	return refuse(cache, "give --cache another folder", err);
}
