/*
 * Starts acutd with a socket as the service manager would: LISTEN_FDS=1, LISTEN_PID, the socket as descriptor 3. A listening
 * socket listens before the daemon runs, so clients can connect at once; a connected one makes a daemon for one client, which
 * ends with the connection.
 */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "session_priv.h"

/* Socket names hold 107 bytes; a longer path is named through its folder's descriptor. */
static int address_of(const char *path, struct sockaddr_un *ret, int *ret_dirfd)
{
	const char *slash = strrchr(path, '/');
	char dir[PATH_MAX];
	int fd;

	*ret = (struct sockaddr_un){.sun_family = AF_UNIX};
	*ret_dirfd = -1;
	if (strlen(path) < sizeof(ret->sun_path)) {
		strcpy(ret->sun_path, path);
		return 0;
	}
	if (!slash || (size_t)(slash - path) >= sizeof(dir))
		return -ENAMETOOLONG;
	memcpy(dir, path, (size_t)(slash - path));
	dir[slash - path] = 0;
	fd = open(dir, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	if (fd < 0)
		return -errno;
	if ((size_t)snprintf(ret->sun_path, sizeof(ret->sun_path), "/proc/self/fd/%d/%s", fd, slash + 1) >=
	    sizeof(ret->sun_path)) {
		close(fd);
		return -ENAMETOOLONG;
	}
	*ret_dirfd = fd;
	return 0;
}

int session_spawn_connect(const char *path, int *ret_fd)
{
	struct sockaddr_un address;
	int dirfd, fd, r = address_of(path, &address, &dirfd);

	if (r)
		return r;
	fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
	if (fd < 0 || connect(fd, (const struct sockaddr *)&address, sizeof(address))) {
		r = -errno;
		if (fd >= 0)
			close(fd);
	} else {
		*ret_fd = fd;
	}
	if (dirfd >= 0)
		close(dirfd);
	return r;
}

int session_spawn_listen(const char *path, int *ret_fd, struct err *err)
{
	struct sockaddr_un address;
	int dirfd, fd = -1, r = address_of(path, &address, &dirfd);
	mode_t mask = umask(0177);

	if (!r) {
		unlink(path);
		/* as systemd passes them: accept must not block */
		fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
		if (fd < 0 || bind(fd, (const struct sockaddr *)&address, sizeof(address)) || listen(fd, 128))
			r = -errno;
	}
	umask(mask);
	if (dirfd >= 0)
		close(dirfd);
	if (r) {
		if (fd >= 0)
			close(fd);
		err_sys(err, -r, "a socket for the private daemon cannot be made");
		return err_add_file(err, path);
	}
	*ret_fd = fd;
	return 0;
}

/* Beside this program (installed, or in a build folder), then by PATH. */
static int find_acutd(char *buf, size_t size, struct err *err)
{
	static const char *const place[] = {"acutd", "../../daemon/acutd", "../libexec/acut/acutd", "../libexec/acutd",
					    "../sbin/acutd"};
	const char *named = getenv("ACUT_ACUTD"), *path = getenv("PATH");
	char self[PATH_MAX];
	ssize_t n = readlink("/proc/self/exe", self, sizeof(self) - 1);
	char *slash;

	if (named && *named) {
		snprintf(buf, size, "%s", named);
		return 0;
	}
	self[n > 0 ? n : 0] = 0;
	slash = strrchr(self, '/');
	for (unsigned i = 0; slash && i < sizeof(place) / sizeof(*place); i++) {
		snprintf(buf, size, "%.*s/%s", (int)(slash - self), self, place[i]);
		if (!access(buf, X_OK))
			return 0;
	}
	while (path && *path) {
		size_t len = strcspn(path, ":");
		snprintf(buf, size, "%.*s/acutd", (int)len, path);
		if (len && !access(buf, X_OK))
			return 0;
		path += len + (path[len] == ':');
	}
	err_set(err, ERR_NODAEMON, "acutd is not installed beside acutctl, nor in PATH");
	return err_add_hint(err, "give the socket of a daemon with --socket, or the path of the program with ACUT_ACUTD");
}

/* In the child: descriptors, environment, and off. Only calls that are safe after fork in one thread. */
static void child(const struct session_spawn *s, const char *program, char **argv, pid_t parent)
{
	char pid[24];
	int null = open("/dev/null", O_RDWR | O_CLOEXEC), log = -1, fd = s->socket_fd;

	if (s->log)
		log = open(s->log, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
	setsid();
	signal(SIGPIPE, SIG_DFL);
	signal(SIGXFSZ, SIG_DFL);
	signal(SIGINT, SIG_DFL);
	signal(SIGHUP, SIG_DFL);
	if (s->bound) {
		prctl(PR_SET_PDEATHSIG, SIGTERM);
		if (getppid() != parent)
			_exit(1);
	}
	dup2(null, 0);
	dup2(null, 1);
	dup2(log >= 0 ? log : null, 2);
	if (s->lock_fd == 3) /* out of the way of the socket; dup keeps the lock */
		fcntl(dup(3), F_SETFD, 0);
	else if (s->lock_fd >= 0)
		fcntl(s->lock_fd, F_SETFD, 0);
	if (fd != 3)
		dup2(fd, 3);
	else
		fcntl(3, F_SETFD, 0);
	snprintf(pid, sizeof(pid), "%d", (int)getpid());
	setenv("LISTEN_FDS", "1", 1);
	setenv("LISTEN_PID", pid, 1);
	unsetenv("LISTEN_FDNAMES");
	unsetenv("NOTIFY_SOCKET");
	unsetenv("WATCHDOG_USEC");
	if (chdir("/"))
		_exit(1);
	execv(program, argv);
	dprintf(2, "%s: %s\n", program, strerror(errno));
	_exit(127);
}

int session_spawn_daemon(const struct session_spawn *s, int *ret_pid, struct err *err)
{
	char program[PATH_MAX], *argv[20];
	unsigned n = 0;
	pid_t pid, parent = getpid();
	int r = find_acutd(program, sizeof(program), err);

	if (r)
		return r;
	argv[n++] = program;
	argv[n++] = "--no-config"; /* that is the service's */
	argv[n++] = "--idle-exit";
	argv[n++] = "30";
	argv[n++] = "--state";
	argv[n++] = (char *)s->state;
	argv[n++] = "--init"; /* no disk is mounted there */
	argv[n++] = "--cache";
	argv[n++] = (char *)s->cache;
	if (s->memory) {
		argv[n++] = "--memory";
		argv[n++] = (char *)s->memory;
	}
	if (s->threads) {
		argv[n++] = "--threads";
		argv[n++] = (char *)s->threads;
	}
	if (s->disk) {
		argv[n++] = "--disk";
		argv[n++] = (char *)s->disk;
	}
	if (s->keep_free) {
		argv[n++] = "--keep-free";
		argv[n++] = (char *)s->keep_free;
	}
	argv[n] = NULL;
	pid = fork();
	if (pid < 0)
		return err_sys(err, errno, "acutd cannot be started");
	if (!pid)
		child(s, program, argv, parent);
	*ret_pid = (int)pid;
	return 0;
}

void session_spawn_last_line(const char *log, char *buf, size_t size)
{
	FILE *f = fopen(log, "re");
	char line[512];

	buf[0] = 0;
	while (f && fgets(line, sizeof(line), f)) {
		line[strcspn(line, "\n")] = 0;
		if (line[0])
			snprintf(buf, size, "%s", line);
	}
	if (f)
		fclose(f);
}
