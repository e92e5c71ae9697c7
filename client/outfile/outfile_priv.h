/* An output file, for the files of this room: names and folders (outfile.c), bytes (outfile_bytes.c), what is kept of it
 * (outfile_part.c). */
#ifndef OUTFILE_PRIV_H
#define OUTFILE_PRIV_H

#include "outfile.h"

/* Direct writes, and blocks of file systems, are multiples of this. */
#define OUTFILE_BLOCK OUTFILE_BUFFER_KEPT

struct outfile {
	int dirfd, fd;             /* dirfd -1: standard output or not a regular file; fd -1: an annex without bytes */
	char *label, *name, *temp; /* label: what messages call it; name, temp: inside dirfd */
	char *tag;                 /* of outfile_hold, NULL */
	char *held;                /* the name that it is published under; NULL: `name` */
	bool seekable, no_clobber, own_fd;
	bool passing;         /* its name is not the last one: the folder need not be durable */
	bool nameless;        /* has no name yet, temp is NULL */
	bool may_direct;      /* past the page cache, once it is worth it */
	bool direct;          /* fd is in that state */
	struct outfile *host; /* of an annex; it outlives the annex */
	bool inside;          /* the annex's bytes are in the host's file, from `base` on */
	uint64_t base;
	uint64_t at;                   /* bytes handed to the system */
	struct outfile_part *part;     /* it is kept in NAME.part; NULL: it is not */
	struct outfile_behind *behind; /* writes what leaves its buffer and that of its annex; NULL: that is written at once */
	struct outfile *annex;         /* of a kept one */
	size_t used;
	uint8_t *buf; /* OUTFILE_BUFFER and OUTFILE_BUFFER_BEHIND at least, on a block's bounds */
};

struct outfile *outfile_alloc(const char *label, struct err *err);
uint8_t *outfile_buffer(void); /* to be freed; NULL: no memory */
/* A nameless file in the folder `dirfd`, or in that for temporary files if it is -1. */
int outfile_nameless(int dirfd, int *ret_fd, struct err *err);
int outfile_flush(struct outfile *, struct err *err);
/* -1, with errno. EEXIST: no_clobber, and there is a file. */
int outfile_rename(int fromfd, const char *from, int tofd, const char *to, bool no_clobber);
/* ".NAME MIDDLE.part", not longer than a name may be; to be freed. NULL: no memory. */
char *outfile_temp_name(const char *name, const char *middle);
bool outfile_is_held(int dirfd, const char *name, const struct outfile_held *);
/* outfile_held.c: outfile_settle in an open folder. */
int outfile_settle_at(int dirfd, const char *from, const char *name, const struct outfile_held *, bool no_clobber,
		      struct err *err);

/* outfile_bytes.c: at this place of its file; if that is impossible past the page cache, through it from now on. */
int outfile_put_at(struct outfile *, const uint8_t *bytes, size_t n, uint64_t at, struct err *err);

/* outfile_behind.c. Without memory or a thread nothing is begun. */
void outfile_behind_begin(struct outfile *);
void outfile_behind_end(struct outfile *); /* what is not written yet is dropped */
/* Until all is written; or the error that prevents it. */
int outfile_behind_wait(const struct outfile *, struct err *err);
/* Takes n bytes in a buffer, and gives another buffer for it. The error may be of what it took before. */
int outfile_behind_put(const struct outfile *, uint8_t **buf, size_t n, uint64_t at, struct err *err);

int outfile_part_annex(struct outfile *host, struct outfile *annex, struct err *err);
void outfile_part_add(struct outfile_part *, const uint8_t *bytes, size_t n);
struct outfile_part *outfile_part_free(struct outfile_part *);

#endif
