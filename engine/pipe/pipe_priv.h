/* Inner door of pipe/: what its files share. */
#ifndef PIPE_PRIV_H
#define PIPE_PRIV_H

#include <stddef.h>
#include <stdint.h>

#include "digest.h"

struct err;
struct grid;
struct pipe_selected;

enum { PIPE_ALIGN = 64 };

static inline size_t pipe_round(size_t n)
{
	return (n + PIPE_ALIGN - 1) & ~(size_t)(PIPE_ALIGN - 1);
}

size_t pipe_domain_bytes(uint32_t cap, size_t reader_bytes);
/* What tells the points of two generations apart, whatever dataset they are of. */
struct digest pipe_content(const struct grid *grid);
int pipe_selected_write(int dirfd, const struct pipe_selected *, struct err *err);

#endif
