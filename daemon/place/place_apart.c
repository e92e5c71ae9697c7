/*
 * Whether the state and the cache can be told apart: deleting the cache loses time only, so it may neither be the state
 * folder nor hold it, nor lie among what the store has made for itself.
 *
 * Paths say little (links, mounts, ".."), so folders are compared by device and inode, from a folder upwards to the
 * root. What is not there yet is known by the nearest folder above it that is, and the names that come below that. A bind mount
 * of a folder in between has other folders above it, and is not seen through.
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

struct spot {
	struct stat up[DEPTH]; /* the nearest folder that is there, and those above it */
	unsigned n;
	char rest[PATH]; /* of names below it, each behind a '/'; "": it is there itself */
};

/* Of folders that are the store's own: what the daemon lists, sweeps and gives to others. */
static const char *const own[] = {"datasets", "plans", "geoids"};

/* Cuts the last name off `path`. False: there is none. */
static bool climb(char path[PATH], char ret_name[PATH])
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

/* Puts a name before the others. */
static bool prepend(char rest[PATH], const char *name)
{
	char was[PATH];

	memcpy(was, rest, sizeof was);
	return (size_t)snprintf(rest, PATH, "/%s%s", name, was) < PATH;
}

static int step(int fd, const char *name)
{
	int to = openat(fd, name, O_PATH | O_DIRECTORY | O_CLOEXEC);

	if (to >= 0)
		close(fd);
	return to;
}

/* From the folder where a path stopped to be there: up by `up`, which names that are to be made and left again have not taken
 * back, and down what is there after all. */
static int walk_on(int fd, unsigned up, char rest[PATH])
{
	char name[PATH], *next;
	int to = fd;

	while (up-- && to >= 0)
		to = step(fd = to, "..");
	while (to >= 0 && *rest) {
		snprintf(name, sizeof name, "%.*s", (int)strcspn(rest + 1, "/"), rest + 1);
		next = rest + 1 + strlen(name);
		fd = to;
		to = step(fd, name);
		if (to < 0)
			return fd;
		memmove(rest, next, strlen(next) + 1);
	}
	if (to < 0)
		close(fd);
	return to;
}

/* The nearest folder that is there. What is not will be made name by name: a ".." behind one leads back to where that was made.
 */
static int nearest(const char *path, char rest[PATH])
{
	char at[PATH], name[PATH];
	unsigned up = 0;
	int fd;

	if ((size_t)snprintf(at, sizeof at, "%s", path) >= sizeof at)
		return -1;
	while ((fd = open(at, O_PATH | O_DIRECTORY | O_CLOEXEC)) < 0) {
		if ((errno != ENOENT && errno != ENOTDIR) || !climb(at, name))
			return -1;
		if (!strcmp(name, ".."))
			up++;
		else if (strcmp(name, ".") && up)
			up--;
		else if (strcmp(name, ".") && !prepend(rest, name))
			return -1;
	}
	return walk_on(fd, up, rest);
}

/* False: it cannot be found out; whoever opens the folder says why. */
static bool spot_find(const char *path, struct spot *ret)
{
	int fd;

	*ret = (struct spot){0};
	fd = nearest(path, ret->rest);
	if (fd < 0)
		return false;
	while (ret->n < DEPTH && fstat(fd, &ret->up[ret->n]) == 0) {
		int up;

		if (ret->n && ret->up[ret->n].st_dev == ret->up[ret->n - 1].st_dev &&
		    ret->up[ret->n].st_ino == ret->up[ret->n - 1].st_ino)
			break; /* the root is above itself */
		ret->n++;
		up = openat(fd, "..", O_PATH | O_DIRECTORY | O_CLOEXEC);
		close(fd);
		fd = up;
	}
	if (fd >= 0)
		close(fd);
	return ret->n > 0;
}

static bool same(const struct stat *a, const struct stat *b)
{
	return a->st_dev == b->st_dev && a->st_ino == b->st_ino;
}

static bool below(const char *rest, const char *of)
{
	size_t n = strlen(of);

	return !strncmp(rest, of, n) && (!rest[n] || rest[n] == '/');
}

/* `a` is `b`, or lies in it. */
static bool lies_in(const struct spot *a, const struct spot *b)
{
	if (*b->rest)
		return same(&a->up[0], &b->up[0]) && below(a->rest, b->rest);
	for (unsigned i = 0; i < a->n; i++)
		if (same(&a->up[i], &b->up[0]))
			return true;
	return false;
}

/* The store's own folder that `cache` is or lies in; NULL: in none. */
static const char *lies_in_own(const struct spot *cache, const char *state)
{
	char path[PATH + 16];
	struct spot s;

	for (size_t i = 0; i < sizeof own / sizeof *own; i++) {
		snprintf(path, sizeof path, "%s/%s", state, own[i]);
		if (spot_find(path, &s) && lies_in(cache, &s))
			return own[i];
	}
	return NULL;
}

static int refuse(const char *cache, const char *hint, struct err *err)
{
	err_add_hint(err, "%s", hint);
	return err_add_file(err, cache);
}

int place_apart(const char *state, const char *cache, bool passing, struct err *err)
{
	struct spot s, c;
	const char *in;

	if (!*state || !*cache || !spot_find(state, &s) || !spot_find(cache, &c))
		return 0;
	if (lies_in(&s, &c) && lies_in(&c, &s)) {
		err_set(err, ERR_USAGE,
			"the cache folder is the state folder (%s): what can be made again must be a folder of its own", state);
		return refuse(cache, "give --cache another folder", err);
	}
	if (lies_in(&s, &c) && !passing) {
		err_set(err, ERR_USAGE,
			"the state folder (%s) lies in the cache folder: whoever empties the cache loses what was pushed", state);
		return refuse(cache, "give --cache or --state another folder", err);
	}
	in = lies_in(&c, &s) ? lies_in_own(&c, state) : NULL;
	if (!in)
		return 0;
	err_set(err, ERR_USAGE, "the cache folder lies in %s of the state folder (%s), where the store has what was pushed", in,
		state);
	return refuse(cache, "give --cache another folder", err);
}
