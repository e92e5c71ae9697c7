/* The folders of state and cache, and the socket: made, checked, and locked for one acutd. */
#ifndef PLACE_H
#define PLACE_H

#include <stdbool.h>

struct err;
struct marker;

/*
 * Opens and locks the folder of the store, and reads its marker. Writes nothing to a folder that is no store. init: a folder that
 * is absent or empty becomes a new store. The lock is held until *ret_lock is closed; both descriptors are the caller's.
 * -ERR_BUSY: another acutd has it (the message has its pid). -ERR_IO: it is no store. -ERR_UNSUPPORTED: it is on a network file
 * system. -ERR_VERSION, -ERR_CORRUPT: of the marker; or the catalogue is lost. Errors name the folder.
 */
int place_state(const char *path, bool init, int *ret_fd, int *ret_lock, struct marker *ret, struct err *err);
/* The checks of place_state without init. Takes no lock, and writes nothing. */
int place_state_check(const char *path, struct err *err);
/* Whether state and cache are separate, through links and "..", before they are made: the cache is not the state folder, does not
 * contain it (temporary: it may, since the state ends with the process), and is not in a folder that the store has made.
 * -ERR_USAGE. */
int place_check_separate(const char *state, const char *cache, bool temporary, struct err *err);
/* Opens and locks the folder of the cache, made with its parents if it is missing. As place_state. */
int place_cache(const char *path, int *ret_fd, int *ret_lock, struct err *err);
/* Whether the folder of the cache exists and has never served a store, as on a machine where acutd never ran. Beside a cache that
 * was used, a state folder without a store is an unmounted disk. */
bool place_cache_unused(const char *path);
/* Writes into the cache which store it serves. Files named by content stay, even of another store; one-step datasets and
 * temporary files are removed at every start anyway. */
int place_cache_claim(int fd, const char *path, const struct marker *state, struct err *err);

/* Binds and listens, with the lock PATH.lock. An existing socket is replaced only if nobody holds its lock. */
int place_bind(const char *path, int *ret_fd, int *ret_lock, struct err *err);
/* Locks a socket that was passed, for a last accept. False: another process holds the lock. *ret_lock -1: it has no path. */
bool place_lock_socket(int fd, int *ret_lock);
/* Removes the path of the socket, with its lock held. */
void place_unbind(int fd);

#endif
