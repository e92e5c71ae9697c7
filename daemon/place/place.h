/* The places that one acutd has for itself: its two folders and its socket. */
#ifndef PLACE_H
#define PLACE_H

#include <stdbool.h>

struct err;
struct marker;

/* Opens and locks the folder of the store, and gives its marker; nothing is written to a folder that is no store.
 * `init`: one that is absent or empty becomes a new store. -ERR_BUSY names the pid of who has it; -ERR_IO: it is no
 * store; -ERR_UNSUPPORTED: on a network file system; -ERR_VERSION, -ERR_CORRUPT: its marker, or a catalogue that is
 * gone. *ret_lock is held as long as it is open. Messages name the folder. */
int place_state(const char *path, bool init, int *ret_fd, int *ret_lock, struct marker *ret, struct err *err);
/* Whether place_state would take it without --init, and nothing else: no lock, nothing written. */
int place_state_look(const char *path, struct err *err);
/* Whether the cache is apart from the state, by whatever links and "..", before either is made: it is not the state folder, does
 * not hold it (`passing`: may, the state goes with the process), and is not in a folder that the store has made. -ERR_USAGE. */
int place_apart(const char *state, const char *cache, bool passing, struct err *err);
/* The cache's, made with its parents if it is not there. */
int place_cache(const char *path, int *ret_fd, int *ret_lock, struct err *err);
/* Whether the cache's folder is there and has never served a store: a machine where acutd was never started before. Beside
 * a cache that has, a state folder without a store is an unmounted disk. */
bool place_cache_unused(const char *path);
/* Notes in the cache at `path` whom it serves. What lies there is named by content, so another store's may stay; what is not
 * (one-step datasets, temporary files) goes at every start. */
int place_cache_serves(int fd, const char *path, const struct marker *state, struct err *err);

/* Binds and listens under PATH.lock: a socket that is there is taken over only if nobody holds its lock. */
int place_bind(const char *path, int *ret_fd, int *ret_lock, struct err *err);
/* The lock of a socket that was handed over, for a last accept. False: somebody has it. */
bool place_lock_socket(int fd, int *ret_lock);
/* Removes the socket's name, while its lock is held. */
void place_unbind(int fd);

#endif
