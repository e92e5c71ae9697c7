/* Where an output goes: a folder that is open, and a name in it, found without following links that others planted. */
#ifndef IO_PLACE_H
#define IO_PLACE_H

#include <stdbool.h>
#include <sys/types.h>

struct err;

struct io_place {
	int dirfd;   /* O_PATH */
	char *name;  /* "": the path is that of a folder: it ends with a slash, ".", or ".." */
	bool opaque; /* the name is a link of the kernel to what has no path (a pipe behind /dev/stdout): to be opened, not
			replaced */
};

/*
 * Follows links in `path` as a kernel with protected_symlinks=1 does, whatever this one is set to: in a folder that is sticky and
 * that everybody may write into, only those of the own user or of the folder's owner. -ERR_PERM names the link. follow: also one
 * that stands at the end, whether what it leads to is there or not; else that is the name.
 */
int io_place_find(const char *path, bool follow, struct io_place *ret, struct err *err);
void io_place_done(struct io_place *);

/* The folder `path`, likewise; where it is missing and `mode` is not 0 it is made. *ret_made may be NULL. */
int io_place_folder(const char *path, mode_t mode, int *ret_fd, bool *ret_made, struct err *err);

#endif
