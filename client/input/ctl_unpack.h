/* gzip and zip, as streams of bytes: no paths, no terminal. */
#ifndef CTL_UNPACK_H
#define CTL_UNPACK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;

enum ctl_unpack_kind { CTL_UNPACK_NONE, CTL_UNPACK_GZIP, CTL_UNPACK_ZIP };

/* By the first bytes of a regular file; its offset is not moved. */
enum ctl_unpack_kind ctl_unpack_kind_of(int fd);

/* A file in a zip archive. */
struct ctl_unpack_member {
	const char *name;       /* as in the archive, with the slashes of its folders */
	uint64_t size;          /* as the directory claims */
	uint64_t place, number; /* for ctl_unpack_zip */
	const char *why;        /* NULL, or why it cannot be unpacked; `todo` with it */
	const char *todo;
};

typedef int ctl_unpack_each(void *ctx, const struct ctl_unpack_member *, struct err *err);
/* Gets the unpacked bytes in pieces, in order. */
typedef int ctl_unpack_sink(void *ctx, const void *bytes, size_t n, struct err *err);

/* All members that are files, in the order of the directory. */
int ctl_unpack_list(int fd, ctl_unpack_each *seen, void *ctx, struct err *err);
/* Only `place`, `number` and `size` of the member are used; more than `size` bytes never come, and fewer are an error. */
int ctl_unpack_zip(int fd, const struct ctl_unpack_member *, ctl_unpack_sink *sink, void *ctx, struct err *err);
/* *ret_cut: it ends early (-ERR_TRUNCATED; the bytes so far are good). *ret_trailing: bytes after the last stream that belong
 * to no stream. */
int ctl_unpack_gzip(int fd, ctl_unpack_sink *sink, void *ctx, bool *ret_cut, uint64_t *ret_trailing, struct err *err);

#endif
