/* File calls that fail as planned (fault_io.h). One lock around each call, so that the log (fault_log.c) has the order of the
 * disk. */
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

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static struct fault_plan plan;
static unsigned long calls, failed;
static enum fault_call first;

/* ---- failing ---- */

void fault_plan(const struct fault_plan *p)
{
	pthread_mutex_lock(&lock);
	plan = p ? *p : (struct fault_plan){0};
	calls = failed = 0;
	fault_trust_all();
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
			fault_did_write_node(fault_node_of(fd), buf, (size_t)rc, (uint64_t)off);
		if (fails) {
			rc = -1;
			errno = plan.error;
		}
	}
	pthread_mutex_unlock(&lock);
	return rc;
}

/* A folder may be synced again after a failure, for its other entries. */
static int f_fsync(int fd)
{
	struct stat st;
	unsigned node;
	bool file, fails;

	pthread_mutex_lock(&lock);
	node = fault_node_of(fd);
	file = node != FAULT_NO_NODE && fstat(fd, &st) == 0 && S_ISREG(st.st_mode);
	if (file)
		fault_use(node);
	fails = fault_fails(FAULT_SYNC);
	if (!fails)
		fault_did_sync_node(node);
	else if (file)
		fault_lose(node);
	pthread_mutex_unlock(&lock);
	return fails ? -1 : 0;
}

static int f_renameat(int olddir, const char *old, int newdir, const char *name)
{
	GUARDED(int, FAULT_RENAME, io_system.renameat(olddir, old, newdir, name), fault_did_rename(olddir, old, newdir, name));
}

static int f_unlinkat(int dirfd, const char *path, int flags)
{
	GUARDED(int, FAULT_UNLINK, io_system.unlinkat(dirfd, path, flags), fault_did_unlink(dirfd, path));
}

static int f_ftruncate(int fd, off_t size)
{
	GUARDED(int, FAULT_TRUNCATE, io_system.ftruncate(fd, size), fault_did_size_node(fault_node_of(fd), (uint64_t)size));
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

/* A hole is logged as a write of zeros. */
static int f_punch(int fd, off_t from, off_t n)
{
	GUARDED(int, FAULT_PUNCH, io_system.punch(fd, from, n), {
		uint8_t *zeros = calloc(1, (size_t)n);

		fault_did_write_node(fault_node_of(fd), zeros, (size_t)n, (uint64_t)from);
		free(zeros);
	});
}

static int f_linkat(int olddir, const char *old, int newdir, const char *name, int flags)
{
	GUARDED(int, FAULT_LINK, io_system.linkat(olddir, old, newdir, name, flags), fault_did_link(olddir, old, newdir, name));
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

/* As on file systems that lack it: the caller must copy in another way, which the log records. */
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
