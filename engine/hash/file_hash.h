/* The hash of an input (XXH3-128), made while it is read for its points. Workers. */
#ifndef FILE_HASH_H
#define FILE_HASH_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "digest.h"
#include "input.h"

/* Of whoever waits for it. `end`: the bytes of a file that is read only for its hash, 0 if none is; `done` of them. */
struct file_hash_watch {
	atomic_bool *cancel;
	_Atomic uint64_t *done, *end;
};

struct file_hashing {
	struct file_hash_watch watch;
	struct digest_stream *sum; /* NULL: not begun */
	uint64_t at;               /* bytes of the file so far */
	int fd;
	const char *name;
	bool missed; /* bytes came out of order: the file is read once more */
};

/* Of the first `size` bytes of a file. -ERR_CANCELLED. */
int file_hash(const struct file_hash_watch *, int fd, uint64_t size, const char *name, struct digest *ret, struct err *err);
/* The same for a file that somebody else reads (input_options.seen): only the rest is read here. */
void file_hash_begin(struct file_hashing *, const struct file_hash_watch *, int fd, const char *name);
void file_hash_seen(void *ctx, uint64_t at, const void *bytes, size_t n);
int file_hash_end(struct file_hashing *, uint64_t size, struct digest *ret, struct err *err); /* also frees */
void file_hash_free(struct file_hashing *);                                                   /* any thread */
/* A pushed file may have that many bytes behind those that its header accounts for. */
enum { FILE_TRAILING_MOST = 1 << 30 };
int file_hash_bounded(const struct input_info *, uint64_t size, const char *name, struct err *err); /* -ERR_INPUT: it has more */
/* The same, for a hash that is made before the header is read. */
int file_hash_look(int fd, uint64_t size, const char *name, const struct input_options *, struct err *err);

#endif
