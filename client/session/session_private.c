/*
 * Private daemons: one that all commands of a user share, and one for a single command.
 *
 * Shared: a command takes the lock beside the socket and tries to connect. Only if nobody answers it binds, listens and
 * starts acutd, so two commands at once start one daemon. It releases the lock when it is connected. An idle daemon takes the
 * same lock for its last accept and removes its socket, so no command connects to a daemon that ends; it may still hold its
 * folders for a moment, and then the start is tried again. A daemon of another build, or with other memory or threads than
 * requested, is replaced while it is idle.
 *
 * Own: the daemon has a socket pair and new folders below the user's cache. It ends with the connection, and its folders are
 * removed. Both sides hold a lock in the folders; folders whose lock nobody holds were left by a crash, and the next command
 * removes them.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "clock.h"
#include "session_priv.h"
#include "io.h"
#include "parse.h"

#define FOLDER 3072
#define END_SECONDS 20 /* for a daemon to park its work */
#define TRIES 50       /* a fifth of a second each, for the daemon before this one to let go of its folders */

struct session_daemon {
	char folder[FOLDER], log[FOLDER + 16];
	int pid, lock_fd;
};

static int take_lock(const char *path, struct session *session, int *ret_fd, struct err *err)
{
	int fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);

	if (fd < 0) {
		err_sys(err, errno, "the lock of the private daemon cannot be opened");
		return err_add_file(err, path);
	}
	while (flock(fd, LOCK_EX | LOCK_NB)) {
		if (errno != EWOULDBLOCK && errno != EINTR) {
			err_sys(err, errno, "the lock of the private daemon cannot be taken");
			close(fd);
			return err_add_file(err, path);
		}
		if (session_interrupted(session)) {
			close(fd);
			return err_set(err, ERR_CANCELLED, "interrupted");
		}
		nanosleep(&(struct timespec){.tv_nsec = 10000000}, NULL);
	}
	*ret_fd = fd;
	return 0;
}

/* The daemon did not start: the last line of its log explains more than a closed connection. */
static int explain(const char *log, int pid, struct err *err)
{
	char words[400];
	int status = 0;
	pid_t r = waitpid(pid, &status, WNOHANG);

	/* it closes the connection a moment before it ends */
	for (int i = 0; i < 200 && r == 0; i++) {
		nanosleep(&(struct timespec){.tv_nsec = 10000000}, NULL);
		r = waitpid(pid, &status, WNOHANG);
	}
	session_spawn_last_line(log, words, sizeof(words));
	if (r != pid || !words[0])
		return -(int)err->code;
	*err = ERR_INIT;
	return err_set(err,
		       WIFEXITED(status) && WEXITSTATUS(status) == 2  ? ERR_USAGE :
		       WIFEXITED(status) && WEXITSTATUS(status) == 75 ? ERR_BUSY :
									ERR_NODAEMON,
		       "the private daemon did not start: %s", words);
}

static int start_shared(const struct session_options *a, const char *socket, const char *log, int *ret_pid, struct err *err)
{
	char state[FOLDER], cache[FOLDER];
	struct session_spawn s = {
		.state = state, .cache = cache, .memory = a->memory, .threads = a->threads, .log = log, .lock_fd = -1};
	int r = session_folder_state(state, sizeof(state), err);

	if (!r)
		r = session_folder_cache(cache, sizeof(cache), err);
	if (!r)
		r = session_spawn_listen(socket, &s.socket_fd, err);
	if (r)
		return r;
	unlink(log);
	r = session_spawn_daemon(&s, ret_pid, err);
	close(s.socket_fd);
	if (r)
		unlink(socket);
	return r;
}

/* One try, under the lock. *ret_pid: the daemon if it was started here. */
static int shared_try(struct session *session, const char *socket, const char *log, int *ret_pid, struct err *err)
{
	char lock[FOLDER + 32];
	int lock_fd = -1, fd = -1, r;

	snprintf(lock, sizeof(lock), "%s.lock", socket);
	r = take_lock(lock, session, &lock_fd, err);
	if (r)
		return r;
	r = session_spawn_connect(socket, &fd);
	if (r == -ECONNREFUSED || r == -ENOENT) {
		r = start_shared(&session->opt, socket, log, ret_pid, err);
		if (!r)
			r = session_spawn_connect(socket, &fd);
	}
	if (r && !err->code) {
		err_sys(err, -r, "the private daemon cannot be reached");
		err_add_file(err, socket);
	}
	close(lock_fd);
	if (r)
		return -(int)err->code;
	r = session_attach(session, fd, err);
	/* A daemon that is ending may still accept a connection: as if it were gone already. */
	if (r == -ERR_NODAEMON && !*ret_pid)
		err->code = ERR_BUSY;
	return r ? -(int)err->code : 0;
}

/* One with nothing to do is asked to end, so that a new one can start. */
static bool end_idle(struct session *session)
{
	const struct acut_status *s;
	uint64_t start = clock_mono_ns();

	if (acut_status(session->acut, &s))
		return false;
	if (s->jobs_running || s->jobs_waiting || s->connections > 1 || kill((pid_t)s->pid, SIGTERM))
		return false;
	while (!kill((pid_t)s->pid, 0) && clock_since(start) < 5)
		nanosleep(&(struct timespec){.tv_nsec = 10000000}, NULL);
	session->acut = acut_close(session->acut);
	return true;
}

/* Whether the daemon has the requested memory and threads and this build. Other memory or threads are an error; another build
 * is accepted if the daemon is busy. */
static bool fits(struct session *session, struct err *err)
{
	const struct session_options *a = &session->opt;
	const struct acut_status *s;
	uint64_t memory = 0, threads = 0;
	bool same_build = !strcmp(acut_daemon_build(session->acut), ACUT_VERSION);
	char has[32];

	if ((!a->memory && !a->threads) || acut_status(session->acut, &s))
		return same_build;
	if (a->memory && parse_size(a->memory, &memory) && memory != s->memory)
		err_set(err, ERR_BUSY, "the private daemon that is at work (process %llu) has %s of memory, not %s",
			(unsigned long long)s->pid, parse_size_text(s->memory, has), a->memory);
	else if (a->threads && parse_u64(a->threads, &threads) && threads != s->threads)
		err_set(err, ERR_BUSY, "the private daemon that is at work (process %llu) has %u thread%s, not %s",
			(unsigned long long)s->pid, s->threads, s->threads == 1 ? "" : "s", a->threads);
	else
		return same_build;
	err_add_hint(err, "try again when it is idle, or leave out --private for a daemon of the command's own");
	return false;
}

int session_private_shared(struct session *session, struct err *err)
{
	char folder[FOLDER], socket[FOLDER + 16], log[FOLDER + 16];
	int r = session_folder_runtime(folder, sizeof(folder), err);

	if (r)
		return r;
	snprintf(socket, sizeof(socket), "%s/acutd.sock", folder);
	snprintf(log, sizeof(log), "%s/acutd.log", folder);
	for (int i = 0;; i++) {
		int pid = 0;

		*err = ERR_INIT;
		r = shared_try(session, socket, log, &pid, err);
		if (!r && (pid || i >= TRIES || fits(session, err)))
			return 0;
		if (!r && !end_idle(session))
			return -(int)err->code; /* another build does */
		if (r && pid)
			r = explain(log, pid, err);
		if (r && (err->code != ERR_BUSY || i >= TRIES || session_interrupted(session)))
			return r;
		if (r)
			nanosleep(&(struct timespec){.tv_nsec = 200000000}, NULL);
	}
}

/* As much of it as can be removed. */
static void remove_folder(const char *path)
{
	struct err err = ERR_INIT;

	io_folder_remove(AT_FDCWD, path, &err);
}

/* Removes the folders of daemons that no process holds. */
static void sweep(const char *cache)
{
	DIR *d = opendir(cache);
	struct dirent *e;

	while (d && (e = readdir(d))) {
		char path[FOLDER + 300];
		int fd;

		if (strncmp(e->d_name, "own-", 4))
			continue;
		snprintf(path, sizeof(path), "%s/%s/lock", cache, e->d_name);
		fd = open(path, O_RDWR | O_CLOEXEC | O_NOFOLLOW);
		if (fd >= 0 && !flock(fd, LOCK_EX | LOCK_NB)) {
			path[strlen(path) - 5] = 0;
			remove_folder(path);
		}
		if (fd >= 0)
			close(fd);
	}
	if (d)
		closedir(d);
}

/* The folder gets its name after its lock is taken, so that no sweep finds it unlocked. */
static int own_folder(struct session_daemon *d, struct err *err)
{
	char cache[FOLDER - 64], fresh[FOLDER], lock[FOLDER + 16];
	int r = session_folder_cache(cache, sizeof(cache), err);

	if (r)
		return r;
	sweep(cache);
	snprintf(fresh, sizeof(fresh), "%s/.new-XXXXXX", cache);
	if (!mkdtemp(fresh)) {
		err_sys(err, errno, "a folder for a daemon of its own cannot be made");
		return err_add_file(err, cache);
	}
	snprintf(lock, sizeof(lock), "%s/lock", fresh);
	snprintf(d->folder, sizeof(d->folder), "%s/own-%s", cache, fresh + strlen(fresh) - 6);
	d->lock_fd = open(lock, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
	if (d->lock_fd < 0 || flock(d->lock_fd, LOCK_EX | LOCK_NB) || rename(fresh, d->folder)) {
		err_sys(err, errno, "a folder for a daemon of its own cannot be made");
		err_add_file(err, cache);
		remove_folder(fresh);
		d->folder[0] = 0;
		return -(int)err->code;
	}
	return 0;
}

static int own_start(struct session *session, struct session_daemon *d, struct err *err)
{
	char state[FOLDER + 16], cache[FOLDER + 16], given[PATH_MAX];
	struct session_spawn s = {.state = state,
				  .cache = cache,
				  .memory = session->opt.memory,
				  .threads = session->opt.threads,
				  .disk = session->opt.disk,
				  .keep_free = session->opt.keep_free,
				  .log = d->log,
				  .lock_fd = d->lock_fd,
				  .bound = true};
	int pair[2], r;

	snprintf(state, sizeof(state), "%s/state", d->folder);
	snprintf(cache, sizeof(cache), "%s/cache", d->folder);
	snprintf(d->log, sizeof(d->log), "%s/log", d->folder);
	r = session_folder_make(state, err);
	if (!r)
		r = session_folder_make(session->opt.cache ? session->opt.cache : cache, err);
	if (!r && session->opt.cache) {
		if (!realpath(session->opt.cache, given))
			return err_sys(err, errno, "the folder of --cache cannot be used");
		s.cache = given;
	}
	if (!r && socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, pair))
		r = err_sys(err, errno, "a pair of sockets cannot be made");
	if (r)
		return r;
	s.socket_fd = pair[1];
	r = session_spawn_daemon(&s, &d->pid, err);
	close(pair[1]);
	if (r) {
		close(pair[0]);
		return r;
	}
	r = session_attach(session, pair[0], err);
	return r && err->code != ERR_CANCELLED ? explain(d->log, d->pid, err) : r;
}

int session_private_own(struct session *session, struct err *err)
{
	struct session_daemon *d = calloc(1, sizeof(*d));
	int r;

	if (!d)
		return err_set(err, ERR_NOMEM, "no memory for a daemon of its own");
	d->lock_fd = -1;
	session->daemon = d;
	r = own_folder(d, err);
	return r ? r : own_start(session, d, err);
}

struct session_daemon *session_private_end(struct session_daemon *d)
{
	uint64_t start = clock_mono_ns();

	if (!d)
		return NULL;
	if (d->pid > 0 && !kill(d->pid, SIGTERM)) {
		while (waitpid(d->pid, NULL, WNOHANG) == 0) {
			if (clock_since(start) > END_SECONDS)
				kill(d->pid, SIGKILL);
			nanosleep(&(struct timespec){.tv_nsec = 5000000}, NULL);
		}
	}
	if (d->folder[0])
		remove_folder(d->folder);
	if (d->lock_fd >= 0)
		close(d->lock_fd);
	free(d);
	return NULL;
}
