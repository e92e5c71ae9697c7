/* The places that one acutd has for itself: its two folders and its socket. */
#ifndef PLACE_H
#define PLACE_H

#include <stdbool.h>

struct err;

/* Opens the folder, made with its parents if it is not there, and locks it. -ERR_BUSY names the pid of who
 * has it. *ret_lock is held as long as it is open. */
int place_folder(const char *path, int *ret_fd, int *ret_lock, struct err *err);

/* Binds and listens under PATH.lock: a socket that is there is taken over only if nobody holds its lock. */
int place_bind(const char *path, int *ret_fd, int *ret_lock, struct err *err);
/* The lock of a socket that was handed over, for a last accept. False: somebody has it. */
bool place_lock_socket(int fd, int *ret_lock);
/* Removes the socket's name, while its lock is held. */
void place_unbind(int fd);

#endif
