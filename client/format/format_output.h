/* An output, for the two files that work on it: names and folders (format_output.c), bytes (format_bytes.c). */
#ifndef FORMAT_OUTPUT_H
#define FORMAT_OUTPUT_H

#include "format_priv.h"

/* What direct writes and whole file-system blocks are multiples of. */
#define FORMAT_BLOCK FORMAT_BUFFER_KEPT

struct format_output {
	int dirfd, fd;             /* dirfd -1: standard output or not a regular file; fd -1: an annex without bytes */
	char *label, *name, *temp; /* label: what messages call it; name, temp: inside dirfd */
	bool seekable, no_clobber, own_fd;
	bool nameless;             /* has no name yet, temp is NULL */
	bool may_direct;           /* past the page cache, once it is worth it */
	bool direct;               /* fd is in that state */
	struct format_output *host; /* of an annex; it outlives the annex */
	bool inside;               /* the annex's bytes are in the host's file, from `base` on */
	uint64_t base;
	uint64_t at;               /* bytes handed to the system */
	size_t used;
	uint8_t *buf;              /* FORMAT_BUFFER and FORMAT_BUFFER_BEHIND at least, on a block's bounds */
};

struct format_output *format_output_alloc(const char *label, struct err *err);
/* A nameless file in the folder `dirfd`, or in that for temporary files if it is -1. */
int format_output_nameless(int dirfd, int *ret_fd, struct err *err);
int format_output_flush(struct format_output *, struct err *err);

#endif
