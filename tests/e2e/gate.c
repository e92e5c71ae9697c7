/*
 * A preload for Gate of e2e.py: calls of a program on files wait until the test lets them go. So a test brings about "in the
 * middle of it" instead of sleeping and hoping. $ACUT_GATE is a folder; its file "rule" says which calls, "CALL TEXT N ID
 * PROGRAM": those named CALL on a path that has TEXT in it, but for the first N since the rule of that ID came, in that program
 * (*: in any). Who waits makes the file "held". Without a rule nobody waits. It changes no call, no result and no order.
 */
#undef _FILE_OFFSET_BITS /* both names of a call are to be had */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define PUBLIC __attribute__((visibility("default")))
#define REAL(f) ((__typeof__(&f))dlsym(RTLD_NEXT, #f))

struct rule {
	char call[32], text[128], id[64], program[32];
	unsigned long pass;
};

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static char counted[64]; /* the rule that the count is of */
static unsigned long count;

/* The calls of this file are the kernel's own: its functions would come by here again. */
static int rule_read(const char *folder, struct rule *ret_rule)
{
	char path[4096], text[512];
	ssize_t n;
	int fd;

	snprintf(path, sizeof path, "%s/rule", folder);
	fd = (int)syscall(SYS_openat, AT_FDCWD, path, O_RDONLY | O_CLOEXEC);
	if (fd < 0)
		return 0;
	n = syscall(SYS_read, fd, text, sizeof text - 1);
	syscall(SYS_close, fd);
	if (n <= 0)
		return 0;
	text[n] = 0;
	return sscanf(text, "%31s %127s %lu %63s %31s", ret_rule->call, ret_rule->text, &ret_rule->pass, ret_rule->id,
		      ret_rule->program) == 5;
}

static int is_let_by(const struct rule *r)
{
	int passes;

	pthread_mutex_lock(&lock);
	if (strcmp(counted, r->id) != 0) {
		snprintf(counted, sizeof counted, "%s", r->id);
		count = 0;
	}
	passes = count < r->pass;
	count += (unsigned)passes;
	pthread_mutex_unlock(&lock);
	return passes;
}

static int is_meant(const struct rule *r, const char *call, int fd, const char *name)
{
	char link[64], path[8192];
	ssize_t n = 0;

	if (strcmp(r->call, call) != 0 ||
	    (strcmp(r->program, "*") != 0 && strcmp(r->program, program_invocation_short_name) != 0))
		return 0;
	if (fd >= 0) {
		snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
		n = readlink(link, path, 4095);
		n = n < 0 ? 0 : n;
	}
	snprintf(path + n, sizeof path - (size_t)n, "/%s", name);
	return strstr(path, r->text) != NULL;
}

static void gate(const char *call, int fd, const char *name)
{
	const char *folder = getenv("ACUT_GATE");
	const struct timespec nap = {.tv_nsec = 2000000};
	int before = errno, held = 0;
	struct rule r;

	while (folder && rule_read(folder, &r) && is_meant(&r, call, fd, name) && !is_let_by(&r)) {
		if (!held) {
			char path[4096];

			snprintf(path, sizeof path, "%s/held", folder);
			held = (int)syscall(SYS_openat, AT_FDCWD, path, O_WRONLY | O_CREAT | O_CLOEXEC, 0666);
			if (held >= 0)
				syscall(SYS_close, held);
			held = 1;
		}
		nanosleep(&nap, NULL);
	}
	errno = before;
}

PUBLIC ssize_t pread(int fd, void *data, size_t n, off_t at)
{
	gate("pread", fd, "");
	return REAL(pread)(fd, data, n, at);
}

PUBLIC ssize_t pread64(int fd, void *data, size_t n, off64_t at)
{
	gate("pread", fd, "");
	return REAL(pread64)(fd, data, n, at);
}

PUBLIC ssize_t pwrite(int fd, const void *data, size_t n, off_t at)
{
	gate("pwrite", fd, "");
	return REAL(pwrite)(fd, data, n, at);
}

PUBLIC ssize_t pwrite64(int fd, const void *data, size_t n, off64_t at)
{
	gate("pwrite", fd, "");
	return REAL(pwrite64)(fd, data, n, at);
}

PUBLIC ssize_t write(int fd, const void *data, size_t n)
{
	gate("write", fd, "");
	return REAL(write)(fd, data, n);
}

PUBLIC int fsync(int fd)
{
	gate("fsync", fd, "");
	return REAL(fsync)(fd);
}

PUBLIC int close(int fd)
{
	gate("close", fd, "");
	return REAL(close)(fd);
}

PUBLIC int renameat2(int from, const char *old, int to, const char *name, unsigned flags)
{
	gate("renameat2", to, name);
	return REAL(renameat2)(from, old, to, name, flags);
}

PUBLIC int renameat(int from, const char *old, int to, const char *name)
{
	gate("renameat", to, name);
	return REAL(renameat)(from, old, to, name);
}

PUBLIC int fstatat(int dir, const char *name, struct stat *ret_st, int flags)
{
	gate("fstatat", dir, name);
	return REAL(fstatat)(dir, name, ret_st, flags);
}

PUBLIC int fstatat64(int dir, const char *name, struct stat64 *ret_st, int flags)
{
	gate("fstatat", dir, name);
	return REAL(fstatat64)(dir, name, ret_st, flags);
}

PUBLIC int fstatvfs(int fd, struct statvfs *ret)
{
	gate("fstatvfs", fd, "");
	return REAL(fstatvfs)(fd, ret);
}

PUBLIC int fstatvfs64(int fd, struct statvfs64 *ret)
{
	gate("fstatvfs", fd, "");
	return REAL(fstatvfs64)(fd, ret);
}
