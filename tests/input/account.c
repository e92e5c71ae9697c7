#include "account.h"

#include <stdlib.h>

#include "io.h"

void *__real_malloc(size_t);
void *__real_calloc(size_t, size_t);
void *__real_realloc(void *, size_t);
void *__real_aligned_alloc(size_t, size_t);
void *__wrap_malloc(size_t);
void *__wrap_calloc(size_t, size_t);
void *__wrap_realloc(void *, size_t);
void *__wrap_aligned_alloc(size_t, size_t);

static size_t taken;

void *__wrap_malloc(size_t n)
{
	taken += n;
	return __real_malloc(n);
}

void *__wrap_calloc(size_t n, size_t size)
{
	taken += n * size;
	return __real_calloc(n, size);
}

void *__wrap_realloc(void *old, size_t n)
{
	taken += n;
	return __real_realloc(old, n);
}

void *__wrap_aligned_alloc(size_t align, size_t n)
{
	taken += n;
	return __real_aligned_alloc(align, n);
}

static uint64_t bytes_read;
static struct io_table counting;

static ssize_t counting_pread(int fd, void *buf, size_t n, off_t off)
{
	ssize_t got = io_system.pread(fd, buf, n, off);

	bytes_read += got > 0 ? (uint64_t)got : 0;
	return got;
}

static ssize_t counting_read(int fd, void *buf, size_t n)
{
	ssize_t got = io_system.read(fd, buf, n);

	bytes_read += got > 0 ? (uint64_t)got : 0;
	return got;
}

void account_begin(void)
{
	counting = io_system;
	counting.pread = counting_pread;
	counting.read = counting_read;
	if (io == &io_system)
		io = &counting;
	taken = 0;
	bytes_read = 0;
}

uint64_t account_read(void)
{
	return bytes_read;
}

size_t account_taken(void)
{
	return taken;
}
