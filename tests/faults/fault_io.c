/*
 * Faults and the log (fault_io.h). One lock around each call, so that the log has the order that the disk saw. Files
 * and folders are nodes; a descriptor is known by device and inode, since its number is given to others by calls that
 * do not come here.
 */
#include "fault_io.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "fault_priv.h"
#include "io.h"

enum { NONE = ~0u };

struct name {
	unsigned dir, node;
	char *name;
};

struct inode {
	dev_t dev;
	ino_t ino;
	bool lost; /* its fsync failed */
};

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static struct fault_plan plan;
static unsigned long calls, failed, distrusted;
static enum fault_call first;

static char root[512];
static bool logging;
static struct disk_entry *entry;
static size_t entries, room;
static struct name *names;
static size_t nnames, names_room;
static struct inode *inodes; /* by node */
static unsigned nodes, nodes_room;

/* ---- failing ---- */

void fault_plan(const struct fault_plan *p)
{
	pthread_mutex_lock(&lock);
	plan = p ? *p : (struct fault_plan){0};
	calls = failed = distrusted = 0;
	pthread_mutex_unlock(&lock);
}

unsigned long fault_calls(void)
{
	return calls;
}

unsigned long fault_failed(void)
{
	return failed;
}

unsigned long fault_distrusted(void)
{
	return distrusted;
}

enum fault_call fault_first(void)
{
	return first;
}

const char *fault_call_text(enum fault_call c)
{
	static const char *const text[FAULT_CALLS] = {
		"open",     "close", "read",        "write",       "fsync",        "rename",      "unlink",
		"truncate", "stat",  "mkdir",       "punch",       "link",         "times",       "list",
		"copy",     "lock",  "sqlite open", "sqlite read", "sqlite write", "sqlite sync", "sqlite other"};

	return text[c];
}

bool fault_fails(enum fault_call c)
{
	if (!(plan.kinds & 1u << c))
		return false;
	calls++;
	if (!plan.at || calls < plan.at || (!plan.for_ever && calls > plan.at))
		return false;
	if (!failed++)
		first = c;
	errno = plan.error;
	return true;
}

bool fault_half(void)
{
	return plan.half;
}

int fault_error(void)
{
	return plan.error;
}

void fault_lock(void)
{
	pthread_mutex_lock(&lock);
}

void fault_unlock(void)
{
	pthread_mutex_unlock(&lock);
}

/* ---- the log ---- */

static void *more(void *array, size_t n, size_t *have, size_t size)
{
	if (n < *have)
		return array;
	*have = *have ? 2 * *have : 64;
	array = realloc(array, *have * size);
	if (!array)
		abort();
	return array;
}

static struct disk_entry *add(enum disk_op op, unsigned node)
{
	entry = more(entry, entries, &room, sizeof *entry);
	entry[entries] = (struct disk_entry){.op = op, .node = node};
	return &entry[entries++];
}

static unsigned node_new(int dirfd, const char *path)
{
	struct stat st = {0};
	size_t have = nodes_room;

	inodes = more(inodes, nodes, &have, sizeof *inodes);
	nodes_room = (unsigned)have;
	fstatat(dirfd, path, &st, AT_SYMLINK_NOFOLLOW);
	inodes[nodes] = (struct inode){st.st_dev, st.st_ino, false};
	return nodes++;
}

static struct name *find(unsigned dir, const char *name)
{
	for (size_t i = 0; i < nnames; i++)
		if (names[i].dir == dir && !strcmp(names[i].name, name))
			return &names[i];
	return NULL;
}

static void put(unsigned dir, const char *name, unsigned node)
{
	struct name *old = find(dir, name);

	if (old) {
		old->node = node;
		return;
	}
	names = more(names, nnames, &names_room, sizeof *names);
	names[nnames++] = (struct name){dir, node, strdup(name)};
}

static void drop(unsigned dir, const char *name)
{
	struct name *old = find(dir, name);

	if (!old)
		return;
	free(old->name);
	*old = names[--nnames];
}

/* Newest first: a number of an inode that is free is given again. */
static unsigned node_of(int fd)
{
	struct stat st;

	if (!logging || fstat(fd, &st) != 0)
		return NONE;
	for (unsigned i = nodes; i-- > 0;)
		if (inodes[i].ino == st.st_ino && inodes[i].dev == st.st_dev)
			return i;
	return NONE;
}

/* The folder of `path` and the last part of it. */
static unsigned place(int dirfd, const char *path, const char **ret_name)
{
	unsigned dir;
	size_t n = strlen(root);
	const char *slash;

	if (!logging)
		return NONE;
	if (*path == '/') {
		if (strncmp(path, root, n) || path[n] != '/')
			return NONE;
		dir = 0;
		path += n + 1;
	} else {
		dir = node_of(dirfd);
	}
	while (dir != NONE && (slash = strchr(path, '/'))) {
		char part[256];
		struct name *hit;

		snprintf(part, sizeof part, "%.*s", (int)(slash - path), path);
		hit = find(dir, part);
		dir = hit ? hit->node : NONE;
		path = slash + 1;
	}
	*ret_name = path;
	return dir;
}

void fault_did_create(int dirfd, const char *path, bool folder, bool cut)
{
	const char *name;
	unsigned dir = place(dirfd, path, &name);
	struct name *old;

	if (dir == NONE || !strcmp(name, "."))
		return;
	old = find(dir, name);
	if (!old) {
		unsigned node = node_new(dirfd, path);
		struct disk_entry *e = add(DISK_CREATE, node);

		e->dir = dir;
		e->name = strdup(name);
		e->folder = folder;
		put(dir, name, node);
	} else if (cut) {
		add(DISK_SIZE, old->node);
	}
}

void fault_did_write_node(unsigned node, const void *buf, size_t n, uint64_t at)
{
	struct disk_entry *e;

	if (node == NONE)
		return;
	e = add(DISK_WRITE, node);
	e->at = at;
	e->n = n;
	e->data = malloc(n);
	memcpy(e->data, buf, n);
}

void fault_did_size_node(unsigned node, uint64_t size)
{
	if (node != NONE)
		add(DISK_SIZE, node)->n = size;
}

void fault_did_sync_node(unsigned node)
{
	if (node != NONE)
		add(DISK_SYNC, node);
}

void fault_did_sync_dir_of(const char *path)
{
	const char *name;

	fault_did_sync_node(place(AT_FDCWD, path, &name));
}

unsigned fault_node_at(const char *path)
{
	const char *name;
	unsigned dir = place(AT_FDCWD, path, &name);
	struct name *hit = dir == NONE ? NULL : find(dir, name);

	return hit ? hit->node : NONE;
}

void fault_did_unlink(int dirfd, const char *path)
{
	const char *name;
	unsigned dir = place(dirfd, path, &name);
	struct name *hit = dir == NONE ? NULL : find(dir, name);
	struct disk_entry *e;

	if (!hit)
		return;
	e = add(DISK_UNLINK, hit->node);
	e->dir = dir;
	e->name = strdup(name);
	drop(dir, name);
}

static void did_rename(int olddir, const char *old, int newdir, const char *new)
{
	const char *name, *name2;
	unsigned dir = place(olddir, old, &name), dir2 = place(newdir, new, &name2), node;
	struct name *hit = dir == NONE ? NULL : find(dir, name);
	struct disk_entry *e;

	if (!hit || dir2 == NONE)
		return;
	node = hit->node;
	distrusted += inodes[node].lost;
	e = add(DISK_RENAME, node);
	e->dir = dir;
	e->dir2 = dir2;
	e->name = strdup(name);
	e->name2 = strdup(name2);
	drop(dir, name);
	put(dir2, name2, node);
}

static void did_link(int olddir, const char *old, int newdir, const char *new)
{
	const char *name, *name2;
	unsigned dir = place(olddir, old, &name), dir2 = place(newdir, new, &name2);
	struct name *hit = dir == NONE ? NULL : find(dir, name);
	struct disk_entry *e;

	if (!hit || dir2 == NONE)
		return;
	e = add(DISK_LINK, hit->node);
	e->dir = dir2;
	e->name = strdup(name2);
	put(dir2, name2, hit->node);
}

/* ---- what is there already ---- */

static void take_file(int fd, unsigned node)
{
	uint8_t *buf = malloc(1 << 20);
	uint64_t at = 0;
	ssize_t n;

	while ((n = pread(fd, buf, 1 << 20, (off_t)at)) > 0) {
		fault_did_write_node(node, buf, (size_t)n, at);
		at += (uint64_t)n;
	}
	free(buf);
	fault_did_sync_node(node);
}

static void take_folder(const char *path, unsigned node)
{
	DIR *dir = opendir(path);
	struct dirent *e;
	char *sub;

	while (dir && (e = readdir(dir))) {
		size_t n = strlen(e->d_name);
		struct stat st;

		if (!strcmp(e->d_name, ".") || !strcmp(e->d_name, "..") || (n > 4 && !strcmp(e->d_name + n - 4, "-shm")))
			continue;
		if (asprintf(&sub, "%s/%s", path, e->d_name) < 0 || lstat(sub, &st))
			abort();
		fault_did_create(AT_FDCWD, sub, S_ISDIR(st.st_mode), false);
		if (S_ISDIR(st.st_mode)) {
			take_folder(sub, fault_node_at(sub));
		} else {
			int fd = open(sub, O_RDONLY | O_CLOEXEC);

			take_file(fd, fault_node_at(sub));
			close(fd);
		}
		free(sub);
	}
	closedir(dir);
	fault_did_sync_node(node);
}

static void forget(void)
{
	for (size_t i = 0; i < entries; i++) {
		free(entry[i].name);
		free(entry[i].name2);
		free(entry[i].data);
	}
	for (size_t i = 0; i < nnames; i++)
		free(names[i].name);
	entries = nnames = nodes = 0;
}

void fault_log_start(const char *path)
{
	pthread_mutex_lock(&lock);
	forget();
	snprintf(root, sizeof root, "%s", path);
	logging = true;
	node_new(AT_FDCWD, path);
	take_folder(path, 0);
	pthread_mutex_unlock(&lock);
}

void fault_log_stop(void)
{
	pthread_mutex_lock(&lock);
	logging = false;
	pthread_mutex_unlock(&lock);
}

void fault_mark(uint64_t mark)
{
	pthread_mutex_lock(&lock);
	if (logging)
		add(DISK_MARK, 0)->n = mark;
	pthread_mutex_unlock(&lock);
}

size_t fault_log(const struct disk_entry **ret)
{
	*ret = entry;
	return entries;
}

/* ---- the table ---- */

#define GUARDED(type, fault, good, then)     \
	do {                                 \
		type rc_ = -1;               \
		int saved_;                  \
		pthread_mutex_lock(&lock);   \
		if (!fault_fails(fault)) {   \
			rc_ = (good);        \
			saved_ = errno;      \
			if (rc_ >= 0) {      \
				then;        \
			}                    \
			errno = saved_;      \
		}                            \
		pthread_mutex_unlock(&lock); \
		return rc_;                  \
	} while (0)

static int f_openat(int dirfd, const char *path, int flags, mode_t mode)
{
	GUARDED(int, FAULT_OPEN, io_system.openat(dirfd, path, flags, mode),
		if ((flags & O_CREAT)) fault_did_create(dirfd, path, false, flags & O_TRUNC));
}

static int f_close(int fd)
{
	bool fails;
	int rc;

	pthread_mutex_lock(&lock);
	fails = fault_fails(FAULT_CLOSE);
	rc = io_system.close(fd);
	pthread_mutex_unlock(&lock);
	if (!fails)
		return rc;
	errno = plan.error;
	return -1;
}

static ssize_t f_read(int fd, void *buf, size_t n)
{
	pthread_mutex_lock(&lock);
	if (fault_fails(FAULT_READ)) {
		pthread_mutex_unlock(&lock);
		return -1;
	}
	pthread_mutex_unlock(&lock);
	return io_system.read(fd, buf, n);
}

static ssize_t f_pread(int fd, void *buf, size_t n, off_t off)
{
	pthread_mutex_lock(&lock);
	if (fault_fails(FAULT_READ)) {
		pthread_mutex_unlock(&lock);
		return -1;
	}
	pthread_mutex_unlock(&lock);
	return io_system.pread(fd, buf, n, off);
}

static ssize_t f_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	ssize_t rc = -1;
	bool fails;

	pthread_mutex_lock(&lock);
	fails = fault_fails(FAULT_WRITE);
	if (!fails || (plan.half && n > 1)) {
		rc = io_system.pwrite(fd, buf, fails ? n / 2 : n, off);
		if (rc > 0)
			fault_did_write_node(node_of(fd), buf, (size_t)rc, (uint64_t)off);
		if (fails) {
			rc = -1;
			errno = plan.error;
		}
	}
	pthread_mutex_unlock(&lock);
	return rc;
}

/* Folders are synced again for other entries of theirs. */
static int f_fsync(int fd)
{
	struct stat st;
	unsigned node;
	bool file, fails;

	pthread_mutex_lock(&lock);
	node = node_of(fd);
	file = node != NONE && fstat(fd, &st) == 0 && S_ISREG(st.st_mode);
	if (file)
		distrusted += inodes[node].lost;
	fails = fault_fails(FAULT_SYNC);
	if (!fails)
		fault_did_sync_node(node);
	else if (file)
		inodes[node].lost = true;
	pthread_mutex_unlock(&lock);
	return fails ? -1 : 0;
}

static int f_renameat(int olddir, const char *old, int newdir, const char *name)
{
	GUARDED(int, FAULT_RENAME, io_system.renameat(olddir, old, newdir, name), did_rename(olddir, old, newdir, name));
}

static int f_unlinkat(int dirfd, const char *path, int flags)
{
	GUARDED(int, FAULT_UNLINK, io_system.unlinkat(dirfd, path, flags), fault_did_unlink(dirfd, path));
}

static int f_ftruncate(int fd, off_t size)
{
	GUARDED(int, FAULT_TRUNCATE, io_system.ftruncate(fd, size), fault_did_size_node(node_of(fd), (uint64_t)size));
}

static int f_fstat(int fd, struct stat *st)
{
	GUARDED(int, FAULT_STAT, io_system.fstat(fd, st), (void)0);
}

static int f_fstatat(int dirfd, const char *path, struct stat *st, int flags)
{
	GUARDED(int, FAULT_STAT, io_system.fstatat(dirfd, path, st, flags), (void)0);
}

static int f_faccessat(int dirfd, const char *path, int mode, int flags)
{
	GUARDED(int, FAULT_STAT, io_system.faccessat(dirfd, path, mode, flags), (void)0);
}

static int f_fstatvfs(int fd, struct statvfs *vfs)
{
	GUARDED(int, FAULT_STAT, io_system.fstatvfs(fd, vfs), (void)0);
}

static int f_mkdirat(int dirfd, const char *path, mode_t mode)
{
	GUARDED(int, FAULT_MKDIR, io_system.mkdirat(dirfd, path, mode), fault_did_create(dirfd, path, true, false));
}

/* A hole is read as zeros, whether the power goes or not. */
static int f_punch(int fd, off_t from, off_t n)
{
	GUARDED(int, FAULT_PUNCH, io_system.punch(fd, from, n), {
		uint8_t *zeros = calloc(1, (size_t)n);

		fault_did_write_node(node_of(fd), zeros, (size_t)n, (uint64_t)from);
		free(zeros);
	});
}

static int f_linkat(int olddir, const char *old, int newdir, const char *name, int flags)
{
	GUARDED(int, FAULT_LINK, io_system.linkat(olddir, old, newdir, name, flags), did_link(olddir, old, newdir, name));
}

static int f_utimensat(int dirfd, const char *path, const struct timespec times[2], int flags)
{
	GUARDED(int, FAULT_TIMES, io_system.utimensat(dirfd, path, times, flags), (void)0);
}

static int f_futimens(int fd, const struct timespec times[2])
{
	GUARDED(int, FAULT_TIMES, io_system.futimens(fd, times), (void)0);
}

static struct dirent *f_readdir(void *dir)
{
	bool fails;

	pthread_mutex_lock(&lock);
	fails = fault_fails(FAULT_LIST);
	pthread_mutex_unlock(&lock);
	return fails ? NULL : io_system.readdir(dir);
}

/* As on file systems that cannot: whoever calls must have another way, which the log sees. */
static ssize_t f_copy_file_range(int in, off_t *in_off, int out, off_t *out_off, size_t n, unsigned flags)
{
	errno = EOPNOTSUPP;
	return -1;
}

static int f_flock(int fd, int operation)
{
	GUARDED(int, FAULT_LOCK, io_system.flock(fd, operation), (void)0);
}

static const struct io_table table = {
	.openat = f_openat,
	.close = f_close,
	.read = f_read,
	.pread = f_pread,
	.pwrite = f_pwrite,
	.fsync = f_fsync,
	.renameat = f_renameat,
	.unlinkat = f_unlinkat,
	.ftruncate = f_ftruncate,
	.fstat = f_fstat,
	.mkdirat = f_mkdirat,
	.punch = f_punch,
	.fstatat = f_fstatat,
	.faccessat = f_faccessat,
	.linkat = f_linkat,
	.utimensat = f_utimensat,
	.futimens = f_futimens,
	.fstatvfs = f_fstatvfs,
	.readdir = f_readdir,
	.copy_file_range = f_copy_file_range,
	.flock = f_flock,
};

void fault_io_start(void)
{
	io = &table;
	fault_sql_start();
}
