/*
 * The folders of state and cache: made, checked, locked.
 *
 * Locks are by flock, so they end with the process, however it ends. Lock files stay: a file that was removed could be locked
 * twice.
 */
#include "place.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "err.h"
#include "io.h"
#include "log.h"
#include "marker.h"
#include "place_fs.h"
#include "place_priv.h"

/* Syncs a folder, so that a new name in it is durable. A folder above those of acut may be unreadable, which is no error. */
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

int place_lock(int dirfd, const char *name, int *ret_lock, struct err *err)
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
	/* The process number is for messages only, so a full disk does not prevent a start. */
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
		r = place_lock(fd, "lock", ret_lock, err);
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

/* Finds an entry that does not belong into a new store. Allowed are what an interrupted attempt left, and what mkfs makes. */
static int is_stranger(void *ctx, const struct dirent *e, struct err *err)
{
	const char *name = e->d_name;
	char *first = ctx;

	if (strcmp(name, "lock") && strcmp(name, "acut-state.tmp") && strcmp(name, "lost+found") && !*first)
		snprintf(first, 256, "%s", name);
	return 0;
}

/* Older versions made no marker; their stores are recognised by the catalogue. */
static int is_store(int fd, bool *ret, struct err *err)
{
	struct stat st;

	*ret = true;
	if (io->fstatat(fd, "acut-state", &st, AT_SYMLINK_NOFOLLOW) == 0 || io->fstatat(fd, "catalogue.db", &st, 0) == 0)
		return 0;
	*ret = false;
	return errno == ENOENT ? 0 : err_sys(err, errno, "cannot look into the folder");
}

/* Checks a folder before anything is written to it. */
static int check_state(const char *path, bool init, struct err *err)
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

/* A store with datasets and without a catalogue has lost it, and is not a new one. */
static int check_catalogue(int fd, struct err *err)
{
	struct stat st;
	char first[256] = "";
	int r;

	/* To SQLite an empty file is a new database. A catalogue that ever had a dataset is not empty. */
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

/* Completes the path of a file in an error. */
static int add_folder(const char *path, struct err *err)
{
	char file[sizeof err->file];

	if (err->file[0] && err->file[0] != '/') {
		snprintf(file, sizeof file, "%.*s/%.100s", (int)sizeof file - 102, path, err->file);
		strcpy(err->file, file);
	}
	return err_add_file(err, path);
}

/* Whether the folder is a copy of a backup that no daemon has used yet: then it has the note that acutctl leaves beside a backup
 * (format.md), with the identity of the marker. */
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
 * What the store gave out after the backup is lost here, and its numbers will be used again, for other datasets, generations and
 * jobs. So the copy is a new store. Otherwise the next backup into the same folder, or an export, would take one for the other,
 * also if the original store is still in use elsewhere.
 */
static int separate_restored(int fd, const char *path, struct marker *m, struct err *err)
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

static int read_or_make_marker(int fd, const char *path, struct marker *ret, struct err *err)
{
	struct stat st;
	int r = marker_read(fd, MARKER_STATE, ret, err);

	if (!r || r == MARKER_E_ABSENT) {
		int lost = check_catalogue(fd, err);

		if (lost || !r)
			return lost ? lost : is_restored(fd, ret) ? separate_restored(fd, path, ret, err) : 0;
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

int place_state_check(const char *path, struct err *err)
{
	struct marker marker;
	int fd = -1, r = check_state(path, false, err);

	if (!r)
		r = io_open(AT_FDCWD, path, O_RDONLY | O_DIRECTORY, 0, &fd, err);
	if (!r)
		r = marker_read(fd, MARKER_STATE, &marker, err);
	if (!r || r == MARKER_E_ABSENT)
		r = check_catalogue(fd, err);
	io_close(fd);
	return r ? add_folder(path, err) : 0;
}

int place_state(const char *path, bool init, int *ret_fd, int *ret_lock, struct marker *ret, struct err *err)
{
	int fd = -1, lock = -1, r = check_state(path, init, err);

	if (!r)
		r = open_locked(path, &fd, &lock, err);
	if (!r)
		r = read_or_make_marker(fd, path, ret, err);
	if (r) {
		io_close(fd);
		io_close(lock);
		return add_folder(path, err);
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
	struct err ignored = ERR_INIT; /* an unreadable cache counts as used */
	struct marker m;
	int fd, r;

	if (io_open(AT_FDCWD, path, O_RDONLY | O_DIRECTORY, 0, &fd, &ignored))
		return false;
	r = marker_read(fd, MARKER_CACHE, &m, &ignored);
	io_close(fd);
	return r == MARKER_E_ABSENT;
}

int place_cache_claim(int fd, const char *path, const struct marker *state, struct err *err)
{
	struct marker m;
	struct err why = ERR_INIT;
	int r = marker_read(fd, MARKER_CACHE, &m, &why);

	if (!r && !memcmp(m.id, state->id, sizeof m.id))
		return 0;
	if (r < 0 && r != -ERR_CORRUPT) {
		*err = why;
		return add_folder(path, err);
	}
	if (!r)
		log_notice("the cache served another store: files that are named by content stay");
	return marker_write(fd, MARKER_CACHE, state, err) ? add_folder(path, err) : 0;
}
