/* The place of an output: an open folder, and a name in it, found without following links that other users planted. */
#ifndef IO_PLACE_H
#define IO_PLACE_H

#include <stdbool.h>
#include <sys/types.h>

struct err;

struct io_place {
	int dirfd;  /* O_PATH */
	char *name; /* "": the path is that of a folder; it ends with a slash, ".", or ".." */
	/* the name is a kernel link to something without a path (a pipe behind /dev/stdout): open it, do not replace it */
	bool opaque;
};

/*
 * Follows links in `path` as a kernel with protected_symlinks=1 does, whatever the actual setting: in a sticky folder
 * that everybody may write to, it follows only links of the own user or of the folder's owner. -ERR_PERM names the
 * link. follow: also follows a link at the end, whether its target exists or not; otherwise the link's name is the
 * result.
 */
int io_place_find(const char *path, bool follow, struct io_place *ret, struct err *err);
void io_place_done(struct io_place *);

/* Opens the folder `path` by the same rules; if it does not exist and `mode` is not 0, it is made. *ret_made may be NULL. */
int io_place_folder(const char *path, mode_t mode, int *ret_fd, bool *ret_made, struct err *err);

#endif
