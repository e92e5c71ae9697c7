#include "account.h"

#include <stdlib.h>

void *__real_malloc(size_t);
void *__real_calloc(size_t, size_t);
void *__real_realloc(void *, size_t);
void *__wrap_malloc(size_t);
void *__wrap_calloc(size_t, size_t);
void *__wrap_realloc(void *, size_t);

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

void account_begin(void)
{
	taken = 0;
}

size_t account_taken(void)
{
	return taken;
}
