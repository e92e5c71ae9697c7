/*
 * A preload for memory.py: the N-th allocation of the process fails, as told through a mapped file (ACUT_NO_MEMORY): a number to
 * fail at, 0: none; how many there were since; how many failed. Whoever writes the number counts anew.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

void *__libc_malloc(size_t n);
void *__libc_calloc(size_t n, size_t size);
void *__libc_realloc(void *p, size_t n);

static struct control {
	_Atomic uint64_t at, count, failed;
} * control;

__attribute__((constructor)) static void begin(void)
{
	const char *path = getenv("ACUT_NO_MEMORY");
	int fd = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
	void *map = fd < 0 ? MAP_FAILED : mmap(NULL, sizeof *control, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);

	if (map != MAP_FAILED)
		control = map;
	if (fd >= 0)
		close(fd);
}

static int fails(void)
{
	uint64_t at = control ? atomic_load(&control->at) : 0;

	if (!at || atomic_fetch_add(&control->count, 1) + 1 != at)
		return 0;
	atomic_fetch_add(&control->failed, 1);
	errno = ENOMEM;
	return 1;
}

__attribute__((visibility("default"))) void *malloc(size_t n)
{
	return fails() ? NULL : __libc_malloc(n);
}

__attribute__((visibility("default"))) void *calloc(size_t n, size_t size)
{
	return fails() ? NULL : __libc_calloc(n, size);
}

__attribute__((visibility("default"))) void *realloc(void *p, size_t n)
{
	return fails() ? NULL : __libc_realloc(p, n);
}
