/* An output, for the files that work on it: names and folders (format_output.c), bytes (format_bytes.c), what is
 * kept of it (format_part.c, format_keep.c). */
#ifndef FORMAT_OUTPUT_H
#define FORMAT_OUTPUT_H

#include "format_priv.h"

/* What direct writes and whole file-system blocks are multiples of. */
#define FORMAT_BLOCK FORMAT_BUFFER_KEPT

struct format_output {
	int dirfd, fd;             /* dirfd -1: standard output or not a regular file; fd -1: an annex without bytes */
	char *label, *name, *temp; /* label: what messages call it; name, temp: inside dirfd */
	bool seekable, no_clobber, own_fd;
	bool passing;               /* its name is not the last one: the folder need not be durable */
	bool nameless;              /* has no name yet, temp is NULL */
	bool may_direct;            /* past the page cache, once it is worth it */
	bool direct;                /* fd is in that state */
	struct format_output *host; /* of an annex; it outlives the annex */
	bool inside;                /* the annex's bytes are in the host's file, from `base` on */
	uint64_t base;
	uint64_t at;                 /* bytes handed to the system */
	struct format_part *part;    /* it is kept in NAME.part; NULL: it is not */
	struct format_output *annex; /* of a kept one */
	size_t used;
	uint8_t *buf; /* FORMAT_BUFFER and FORMAT_BUFFER_BEHIND at least, on a block's bounds */
};

struct format_output *format_output_alloc(const char *label, struct err *err);
/* A nameless file in the folder `dirfd`, or in that for temporary files if it is -1. */
int format_output_nameless(int dirfd, int *ret_fd, struct err *err);
int format_output_flush(struct format_output *, struct err *err);

/* ---- format_part.c ---- */

/* What a kept file has from offset `from` on: bytes, and what they hash to. */
struct format_sum {
	uint64_t from, size, chain, part;
};
enum { FORMAT_PART_NAME = 280 };
bool format_part_can(const struct format_output *);
/* A new output becomes a kept one: `on`, with the file that an earlier one left, and format_part_go_on comes next;
 * else what is there is replaced. -ERR_BUSY: another process has it. */
int format_part_begin(struct format_output *, bool on, struct err *err);
/* -ERR_CORRUPT: the file has something else. `annex` is checked when the annex is opened. */
int format_part_go_on(struct format_output *, const struct format_sum *, const struct format_sum *annex, struct err *err);
int format_part_annex(struct format_output *host, struct format_output *annex, struct err *err);
void format_part_add(struct format_part *, const uint8_t *bytes, size_t n);
struct format_sum format_part_sum(const struct format_output *); /* of what was flushed */
int format_part_sync(struct format_output *, struct err *err);   /* flushed and durable, its annex too */
void format_part_discard(const struct format_output *);          /* removes it, if it was begun and nothing refers to it */
void format_part_clean(const struct format_output *);            /* removes what lies beside NAME.part */
const char *format_part_state_name(const struct format_output *, char buf[FORMAT_PART_NAME]);
struct format_part *format_part_free(struct format_part *);

#endif
