/*
 * A preload: a shared file system that shows files late. $ACUT_LATE is "CALL ERROR COUNT SECONDS TEXT": the call open, for
 * reading or for writing what is there, or read, on files whose path has TEXT in it (A|B: one of both) fails with the number
 * ERROR: the first COUNT of each path, and all in the first SECONDS of the process. Their paths are added to the file
 * $ACUT_LATE_FELT. Folders, and files that the process makes, are as they are.
 */
#undef _FILE_OFFSET_BITS /* both names of a call are to be had */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define PUBLIC __attribute__((visibility("default")))
#define REAL(f) ((__typeof__(&f))dlsym(RTLD_NEXT, #f))

enum { PATHS = 1024, LENGTH = 4096, OWN = 1 << 30 };

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static struct {
	char *path;
	int n;
} seen[PATHS];
static double begun;

static double now(void)
{
	struct timespec t;

	clock_gettime(CLOCK_MONOTONIC, &t);
	return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

__attribute__((constructor)) static void begin(void)
{
	begun = now();
}

static void felt(const char *path)
{
	const char *name = getenv("ACUT_LATE_FELT");
	int fd = name ? (int)syscall(SYS_openat, AT_FDCWD, name, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666) : -1;
	char line[2 * LENGTH + 2];
	int n = snprintf(line, sizeof line, "%s\n", path);

	if (fd < 0)
		return;
	if (syscall(SYS_write, fd, line, n) != n)
		abort();
	syscall(SYS_close, fd);
}

/* How often it has failed; counts it, `by` at once. */
static int times(const char *path, int by)
{
	int n = 0;

	pthread_mutex_lock(&lock);
	for (int i = 0; i < PATHS; i++) {
		if (!seen[i].path)
			seen[i].path = strdup(path);
		if (!seen[i].path || strcmp(seen[i].path, path) != 0)
			continue;
		n = seen[i].n;
		seen[i].n += n < OWN ? by : 0;
		break;
	}
	pthread_mutex_unlock(&lock);
	return n;
}

static void path_of(int fd, const char *name, char path[2 * LENGTH])
{
	char link[64];
	ssize_t n = 0;

	if (fd >= 0 && name[0] != '/') {
		snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
		n = readlink(link, path, LENGTH);
		n = n < 0 ? 0 : n;
	}
	snprintf(path + n, (size_t)(2 * LENGTH - n), "%s%s", n && *name ? "/" : "", name);
}

static int is_meant(const char *path, char *texts)
{
	char *save = NULL;

	for (char *text = strtok_r(texts, "|", &save); text; text = strtok_r(NULL, "|", &save))
		if (strstr(path, text))
			return 1;
	return 0;
}

static int is_folder(const char *path)
{
	struct stat st;

	return stat(path, &st) == 0 && S_ISDIR(st.st_mode);
}

/* Non-zero, with errno: the call fails. */
static int fails(const char *call, int fd, const char *name)
{
	const char *rule = getenv("ACUT_LATE");
	char which[16], text[256], path[2 * LENGTH];
	int before = errno, error, count, n;
	double seconds;

	if (!rule || sscanf(rule, "%15s %d %d %lf %255s", which, &error, &count, &seconds, text) != 5 || strcmp(which, call) != 0)
		return 0;
	path_of(fd, name, path);
	n = is_meant(path, text) && !is_folder(path) ? times(path, 1) : OWN;
	errno = before;
	if (n >= OWN || (n >= count && now() - begun >= seconds))
		return 0;
	felt(path);
	errno = error;
	return 1;
}

/* What this process makes it sees at once. */
static void made(int dir, const char *name)
{
	char path[2 * LENGTH];

	path_of(dir, name, path);
	times(path, OWN);
}

#define OPEN(f)                                                                     \
	PUBLIC int f(int dir, const char *name, int flags, ...)                     \
	{                                                                           \
		va_list ap;                                                         \
		mode_t mode;                                                        \
                                                                                    \
		va_start(ap, flags);                                                \
		mode = va_arg(ap, mode_t);                                          \
		va_end(ap);                                                         \
		if (!(flags & (O_CREAT | O_DIRECTORY)) && fails("open", dir, name)) \
			return -1;                                                  \
		if (flags & O_CREAT)                                                \
			made(dir, name);                                            \
		return REAL(f)(dir, name, flags, mode);                             \
	}
OPEN(openat)
OPEN(openat64)

PUBLIC int linkat(int from, const char *old, int to, const char *name, int flags)
{
	made(to, name);
	return REAL(linkat)(from, old, to, name, flags);
}

PUBLIC int renameat(int from, const char *old, int to, const char *name)
{
	if (fails("open", from, old))
		return -1;
	made(to, name);
	return REAL(renameat)(from, old, to, name);
}

PUBLIC int renameat2(int from, const char *old, int to, const char *name, unsigned flags)
{
	if (fails("open", from, old))
		return -1;
	made(to, name);
	return REAL(renameat2)(from, old, to, name, flags);
}

PUBLIC ssize_t read(int fd, void *data, size_t n)
{
	return fails("read", fd, "") ? -1 : REAL(read)(fd, data, n);
}

PUBLIC ssize_t pread(int fd, void *data, size_t n, off_t at)
{
	return fails("read", fd, "") ? -1 : REAL(pread)(fd, data, n, at);
}

PUBLIC ssize_t pread64(int fd, void *data, size_t n, off64_t at)
{
	return fails("read", fd, "") ? -1 : REAL(pread64)(fd, data, n, at);
}
