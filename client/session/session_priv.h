/* Starting daemons, for the files of this room. */
#ifndef SESSION_PRIV_H
#define SESSION_PRIV_H

#include "session.h"

/* Connects to the private daemon that this user's commands share; starts it if it does not run. */
int session_private_shared(struct session *, struct err *err);
/* A daemon for this command alone, with its own folders. */
int session_private_own(struct session *, struct err *err);
/* Ends it and removes its folders. NULL is fine; returns NULL. */
struct session_daemon *session_private_end(struct session_daemon *);

/* Sets session->acut. */
int session_attach(struct session *, int fd, struct err *err);

/* ---- session_spawn.c ---- */

struct session_spawn {
	const char *state, *cache, *log;
	const char *memory, *threads, *disk, *keep_free; /* NULL if not given */
	int socket_fd;                                   /* handed over as the service manager does */
	int lock_fd;                                     /* kept open by the daemon; -1: none */
	bool bound;                                      /* ends with this process */
};
int session_spawn_daemon(const struct session_spawn *, int *ret_pid, struct err *err);
/* Makes and binds a listening socket; long paths are bound through the folder's descriptor. */
int session_spawn_listen(const char *path, int *ret_fd, struct err *err);
int session_spawn_connect(const char *path, int *ret_fd); /* negative errno */
/* The last line of a log, for a daemon that did not come up. */
void session_spawn_last_line(const char *log, char *buf, size_t size);

/* ---- session_folder.c ---- */

/* Folders of the user, made if absent (0700): $XDG_STATE_HOME/acut, $XDG_CACHE_HOME/acut, and for sockets. */
int session_folder_state(char *buf, size_t size, struct err *err);
int session_folder_cache(char *buf, size_t size, struct err *err);
int session_folder_runtime(char *buf, size_t size, struct err *err);
int session_folder_make(const char *path, struct err *err); /* with its parents */

#endif
