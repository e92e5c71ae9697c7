/* Shared by the files of this room. */
#ifndef PLACE_PRIV_H
#define PLACE_PRIV_H

struct err;

/* Opens and locks a file, made if it is missing. The lock is held until *ret_lock is closed. -ERR_BUSY, with the holder's pid. */
int place_lock(int dirfd, const char *name, int *ret_lock, struct err *err);

#endif
