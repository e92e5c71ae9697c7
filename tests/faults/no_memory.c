/*
 * The N-th allocation of the process fails. Of another program: a preload (memory.py), and N is written to a file that is mapped
 * (ACUT_NO_MEMORY). Of a test itself: linked into it, which sets `no_memory` (test_memory.c).
 */
#include "no_memory.h"

#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

void *__libc_malloc(size_t n);
void *__libc_calloc(size_t n, size_t size);
void *__libc_realloc(void *p, size_t n);
void *__libc_memalign(size_t to, size_t n);

struct no_memory *no_memory;

__attribute__((constructor)) static void begin(void)
{
	const char *path = getenv("ACUT_NO_MEMORY");
	int fd = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
	void *map = fd < 0 ? MAP_FAILED : mmap(NULL, sizeof *no_memory, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);

	if (map != MAP_FAILED)
		no_memory = map;
	if (fd >= 0)
		close(fd);
}

static int fails(void)
{
	uint64_t at = no_memory ? atomic_load(&no_memory->at) : 0;

	if (!at || atomic_fetch_add(&no_memory->count, 1) + 1 != at)
		return 0;
	atomic_fetch_add(&no_memory->failed, 1);
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

__attribute__((visibility("default"))) void *aligned_alloc(size_t to, size_t n)
{
	return fails() ? NULL : __libc_memalign(to, n);
}
