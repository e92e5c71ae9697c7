/* Inner door of pipe/: what its files share. */
#ifndef PIPE_PRIV_H
#define PIPE_PRIV_H

#include <stddef.h>
#include <stdint.h>

enum { PIPE_ALIGN = 64 };

static inline size_t pipe_round(size_t n)
{
	return (n + PIPE_ALIGN - 1) & ~(size_t)(PIPE_ALIGN - 1);
}

size_t pipe_domain_bytes(uint32_t cap, size_t reader_bytes);

#endif
