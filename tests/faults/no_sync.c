/*
 * A preload for the control runs of power.py, which must lose data: fsync that does nothing, of everything
 * (ACUT_NO_SYNC=all) or of folders alone (ACUT_NO_SYNC=folders).
 */
#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static int nothing(int fd)
{
	const char *what = getenv("ACUT_NO_SYNC");
	struct stat st;

	if (!what)
		return 0;
	return !strcmp(what, "all") || (fstat(fd, &st) == 0 && S_ISDIR(st.st_mode));
}

static int real(const char *name, int fd)
{
	int (*call)(int) = (int (*)(int))dlsym(RTLD_NEXT, name);

	return call(fd);
}

__attribute__((visibility("default"))) int fsync(int fd)
{
	return nothing(fd) ? 0 : real("fsync", fd);
}

__attribute__((visibility("default"))) int fdatasync(int fd)
{
	return nothing(fd) ? 0 : real("fdatasync", fd);
}
