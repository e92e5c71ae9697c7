/*
 * Locks on folders and sockets, by flock: they go with the process, however it ends. Lock files stay where
 * they are, since one that is removed could be locked twice.
 */
#include "place.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "err.h"
#include "io.h"
#include "log.h"
#include "marker.h"
#include "place_fs.h"

/* A name is on the disk when its folder is. Above what acut made, as far as it may look. */
static int sync_dir(const char *path, struct err *err)
{
	struct err ignored = ERR_INIT;
	int fd, r;

	if (io_open(AT_FDCWD, path, O_RDONLY | O_DIRECTORY, 0, &fd, &ignored))
		return 0;
	r = io_sync(fd, path, err);
	io_close(fd);
	return r;
}

static int make_dir(const char *path, char *parent, mode_t mode, struct err *err)
{
	int r;

	if (io->mkdirat(AT_FDCWD, path, mode) != 0)
		return errno == EEXIST ? 0 : err_sys(err, errno, "cannot make the folder");
	r = *parent ? sync_dir(parent, err) : 0;
	return r;
}

static int make_dirs(const char *path, struct err *err)
{
	char part[512], parent[512] = "/";
	char *at;
	int r;

	if (strlen(path) >= sizeof part)
		return err_set(err, ERR_USAGE, "the path is longer than %zu bytes", sizeof part - 1);
	if (*path != '/')
		strcpy(parent, ".");
	strcpy(part, path);
	for (at = part + 1; (at = strchr(at, '/')); at++) {
		*at = 0;
		r = make_dir(part, parent, 0755, err);
		strcpy(parent, part);
		*at = '/';
		if (r)
			return r;
	}
	return make_dir(part, parent, 0700, err);
}

static long holder_of(int fd)
{
	char text[32] = "";
	ssize_t n = io->pread(fd, text, sizeof text - 1, 0);

	return n > 0 ? strtol(text, NULL, 10) : 0;
}

static int lock_file(int dirfd, const char *name, int *ret_lock, struct err *err)
{
	char text[32];
	int fd, r, n;

	r = io_open(dirfd, name, O_RDWR | O_CREAT | O_NOFOLLOW, 0600, &fd, err);
	if (r)
		return r;
	if (io->flock(fd, LOCK_EX | LOCK_NB) != 0) {
		if (errno == EWOULDBLOCK)
			r = err_set(err, ERR_BUSY, "another acutd (pid %ld) runs here", holder_of(fd));
		else
			r = err_sys(err, errno, "cannot lock");
		io_close(fd);
		return r;
	}
	/* Whose it is, is for messages only: a full disk keeps nobody from starting. */
	n = snprintf(text, sizeof text, "%ld\n", (long)getpid());
	if (io->ftruncate(fd, 0) != 0 || io->pwrite(fd, text, (size_t)n, 0) != n)
		log_warning("the number of this process cannot be written into %s: %s", name, strerror(errno));
	*ret_lock = fd;
	return 0;
}

static int open_locked(const char *path, int *ret_fd, int *ret_lock, struct err *err)
{
	int fd = -1, r = io_open(AT_FDCWD, path, O_RDONLY | O_DIRECTORY, 0, &fd, err);

	if (!r)
		r = lock_file(fd, "lock", ret_lock, err);
	if (r) {
		io_close(fd);
		if (err->code == ERR_BUSY)
			err_add_hint(err, "end that daemon, or give this one other folders (--state, --cache)");
		return r;
	}
	*ret_fd = fd;
	return 0;
}

/* ---- the state ---- */

static int not_a_store(const char *what, struct err *err)
{
	err_set(err, ERR_IO, "%s", what);
	return err_add_hint(err, "mount the disk that holds the store; to make a new one here, start acutd once with --init");
}

/* What is beside a store before it is one: what an attempt that was cut short left, and what mkfs leaves. */
static int is_stranger(void *ctx, const struct dirent *e, struct err *err)
{
	const char *name = e->d_name;
	char *first = ctx;

	if (strcmp(name, "lock") && strcmp(name, "acut-state.tmp") && strcmp(name, "lost+found") && !*first)
		snprintf(first, 256, "%s", name);
	return 0;
}

/* Older versions made no marker: their catalogue tells that it is a store. */
static int is_store(int fd, bool *ret, struct err *err)
{
	struct stat st;

	*ret = true;
	if (io->fstatat(fd, "acut-state", &st, AT_SYMLINK_NOFOLLOW) == 0 || io->fstatat(fd, "catalogue.db", &st, 0) == 0)
		return 0;
	*ret = false;
	return errno == ENOENT ? 0 : err_sys(err, errno, "cannot look into the folder");
}

/* Nothing is written to a folder before this. */
static int may_begin(const char *path, bool init, struct err *err)
{
	char first[256] = "";
	bool store;
	int fd = -1, r;

	if (!init) {
		struct err why = ERR_INIT;

		r = io_open(AT_FDCWD, path, O_RDONLY | O_DIRECTORY, 0, &fd, &why);
		if (r && why.sys == ENOENT)
			return not_a_store("the state folder is not there: an unmounted disk is not an empty store", err);
		if (r) {
			*err = why;
			return r;
		}
	} else {
		r = make_dirs(path, err);
		if (!r)
			r = io_open(AT_FDCWD, path, O_RDONLY | O_DIRECTORY, 0, &fd, err);
	}
	if (!r)
		r = place_fs_check(fd, err);
	if (!r)
		r = is_store(fd, &store, err);
	if (!r && !store && !init)
		r = not_a_store("the state folder has no marker (acut-state): an unmounted disk is not an empty store", err);
	if (!r && !store)
		r = io_list(fd, ".", is_stranger, first, err);
	if (!r && *first) {
		err_set(err, ERR_IO, "a store is made in an empty folder, and this one has other things (%.100s)", first);
		r = err_add_hint(err, "give --state an empty folder, or one that is not there yet");
	}
	io_close(fd);
	return r;
}

/* A store whose catalogue is gone is no new one. */
static int catalogue_gone(int fd, struct err *err)
{
	struct stat st;
	char first[256] = "";
	int r;

	/* An empty file is a new database to SQLite, and no catalogue that has ever had a dataset. */
	if (io->fstatat(fd, "catalogue.db", &st, 0) == 0 && st.st_size)
		return 0;
	if (io->fstatat(fd, "datasets", &st, 0) != 0)
		return 0;
	r = io_list(fd, "datasets", is_stranger, first, err);
	if (r || !*first)
		return r;
	err_set(err, ERR_CORRUPT, "the catalogue is gone (catalogue.db is not there or empty), and there are datasets");
	return err_add_hint(err, "bring it back from a backup");
}

/* What is about a file of the folder is told with its whole path. */
static int of_folder(const char *path, struct err *err)
{
	char file[sizeof err->file];

	if (err->file[0] && err->file[0] != '/') {
		snprintf(file, sizeof file, "%.*s/%.100s", (int)sizeof file - 102, path, err->file);
		strcpy(err->file, file);
	}
	return err_add_file(err, path);
}

/* The folder is a copy of a backup, and no daemon has been on it: what acutctl notes beside a backup (FORMAT.md) came along, and
 * names the very store that the marker does. */
static bool is_restored(int fd, const struct marker *m)
{
	char text[640] = "", identity[64] = "\nidentity ", *at = identity + strlen(identity);
	struct err ignored = ERR_INIT;
	size_t n = 0;
	int note;

	if (io_open(fd, "acut-copy", O_RDONLY | O_NOFOLLOW, 0, &note, &ignored))
		return false;
	if (io_read_some(note, text, sizeof text - 1, 0, "acut-copy", &n, &ignored))
		n = 0;
	text[n] = 0;
	io_close(note);
	for (size_t i = 0; i < sizeof m->id; i++)
		at += sprintf(at, "%02x", m->id[i]);
	strcpy(at, "\n");
	return strstr(text, "\nof state of acutd\n") && strstr(text, identity);
}

/*
 * What the store gave out after the backup is lost here, and its numbers are given out again, for other datasets, generations and
 * jobs. So it is another store from here on: whatever goes by identity, such as the next backup into the folder of the old ones,
 * or an export, takes neither for the other, also where the one that it was copied of goes on elsewhere.
 */
static int part(int fd, const char *path, struct marker *m, struct err *err)
{
	struct marker new;
	int r = marker_new(&new, err);

	new.made_us = m->made_us;
	if (!r)
		r = marker_write(fd, MARKER_STATE, &new, err);
	if (r)
		return r;
	*m = new;
	log_notice("%s is a backup that was restored: the store has a new identity, and its backups and exports need new folders",
		   path);
	return 0;
}

static int take_marker(int fd, const char *path, struct marker *ret, struct err *err)
{
	struct stat st;
	int r = marker_read(fd, MARKER_STATE, ret, err);

	if (!r || r == MARKER_E_ABSENT) {
		int gone = catalogue_gone(fd, err);

		if (gone || !r)
			return gone ? gone : is_restored(fd, ret) ? part(fd, path, ret, err) : 0;
	}
	if (r != MARKER_E_ABSENT)
		return r;
	if (io->fstatat(fd, "catalogue.db", &st, 0) == 0)
		log_notice("the state folder is of an older acutd: it gets a marker (acut-state)");
	else
		log_notice("a new store is made in %s", path);
	r = marker_new(ret, err);
	if (!r)
		r = marker_write(fd, MARKER_STATE, ret, err);
	return r;
}

int place_state_look(const char *path, struct err *err)
{
	struct marker marker;
	int fd = -1, r = may_begin(path, false, err);

	if (!r)
		r = io_open(AT_FDCWD, path, O_RDONLY | O_DIRECTORY, 0, &fd, err);
	if (!r)
		r = marker_read(fd, MARKER_STATE, &marker, err);
	if (!r || r == MARKER_E_ABSENT)
		r = catalogue_gone(fd, err);
	io_close(fd);
	return r ? of_folder(path, err) : 0;
}

int place_state(const char *path, bool init, int *ret_fd, int *ret_lock, struct marker *ret, struct err *err)
{
	int fd = -1, lock = -1, r = may_begin(path, init, err);

	if (!r)
		r = open_locked(path, &fd, &lock, err);
	if (!r)
		r = take_marker(fd, path, ret, err);
	if (r) {
		io_close(fd);
		io_close(lock);
		return of_folder(path, err);
	}
	*ret_fd = fd;
	*ret_lock = lock;
	return 0;
}

/* ---- the cache ---- */

int place_cache(const char *path, int *ret_fd, int *ret_lock, struct err *err)
{
	int r = make_dirs(path, err);

	if (!r)
		r = open_locked(path, ret_fd, ret_lock, err);
	return r ? err_add_file(err, path) : 0;
}

bool place_cache_unused(const char *path)
{
	struct err ignored = ERR_INIT; /* what cannot be read is not taken for unused */
	struct marker m;
	int fd, r;

	if (io_open(AT_FDCWD, path, O_RDONLY | O_DIRECTORY, 0, &fd, &ignored))
		return false;
	r = marker_read(fd, MARKER_CACHE, &m, &ignored);
	io_close(fd);
	return r == MARKER_E_ABSENT;
}

int place_cache_serves(int fd, const char *path, const struct marker *state, struct err *err)
{
	struct marker m;
	struct err why = ERR_INIT;
	int r = marker_read(fd, MARKER_CACHE, &m, &why);

	if (!r && !memcmp(m.id, state->id, sizeof m.id))
		return 0;
	if (r < 0 && r != -ERR_CORRUPT) {
		*err = why;
		return of_folder(path, err);
	}
	if (!r)
		log_notice("the cache served another store: what is in it goes by content, and stays");
	return marker_write(fd, MARKER_CACHE, state, err) ? of_folder(path, err) : 0;
}

/* ---- sockets ---- */

static int address_of(const char *path, struct sockaddr_un *ret, struct err *err)
{
	*ret = (struct sockaddr_un){.sun_family = AF_UNIX};
	if (strlen(path) >= sizeof ret->sun_path) {
		err_set(err, ERR_USAGE, "a socket's path has at most %zu bytes", sizeof ret->sun_path - 1);
		return err_add_file(err, path);
	}
	strcpy(ret->sun_path, path);
	return 0;
}

static int bind_at(int fd, const struct sockaddr_un *a, struct err *err)
{
	struct stat st;
	mode_t mask;
	int r;

	/* Nobody holds the lock, so whoever made it is gone. Only a socket is ever removed. */
	if (lstat(a->sun_path, &st) == 0 && S_ISSOCK(st.st_mode) && unlink(a->sun_path) != 0)
		return err_sys(err, errno, "cannot remove the stale socket");
	mask = umask(0117); /* 0660 from the first moment */
	r = bind(fd, (const struct sockaddr *)a, sizeof *a);
	umask(mask);
	if (r != 0)
		return err_sys(err, errno, "cannot bind the socket");
	/* As in acutd.socket: who waits longer than these take waits in the kernel's other queue, of connect(). */
	return listen(fd, 1024) != 0 ? err_sys(err, errno, "cannot listen") : 0;
}

static int lock_of(const char *path, int *ret_lock, struct err *err)
{
	char name[sizeof(struct sockaddr_un) + 8];

	snprintf(name, sizeof name, "%s.lock", path);
	return lock_file(AT_FDCWD, name, ret_lock, err);
}

int place_bind(const char *path, int *ret_fd, int *ret_lock, struct err *err)
{
	struct sockaddr_un a;
	int lock = -1, fd = -1, r = address_of(path, &a, err);

	if (!r)
		r = lock_of(path, &lock, err);
	if (!r) {
		fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
		r = fd < 0 ? err_sys(err, errno, "cannot make a socket") : bind_at(fd, &a, err);
	}
	if (r) {
		io_close(fd);
		io_close(lock);
		return err_add_file(err, path);
	}
	*ret_fd = fd;
	*ret_lock = lock;
	return 0;
}

static bool name_of(int fd, char *path, size_t size)
{
	struct sockaddr_un a = {0};
	socklen_t n = sizeof a;

	if (getsockname(fd, (struct sockaddr *)&a, &n) != 0 || a.sun_family != AF_UNIX || !a.sun_path[0])
		return false;
	snprintf(path, size, "%s", a.sun_path);
	return true;
}

bool place_lock_socket(int fd, int *ret_lock)
{
	char path[sizeof(struct sockaddr_un)];
	struct err err = ERR_INIT;

	*ret_lock = -1;
	return !name_of(fd, path, sizeof path) || lock_of(path, ret_lock, &err) == 0;
}

void place_unbind(int fd)
{
	char path[sizeof(struct sockaddr_un)];

	if (name_of(fd, path, sizeof path))
		unlink(path);
}
