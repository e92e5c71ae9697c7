/* Which daemon a command speaks to, and the connection to it. */
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "parse.h"
#include "session_priv.h"

#define SYSTEM_SOCKET "/run/acut/acutd.sock"

static const char *configured(const struct session_options *a)
{
	const char *env = getenv("ACUT_SOCKET");
	struct stat st;

	if (a->socket)
		return a->socket;
	if (env && *env)
		return env;
	return stat(SYSTEM_SOCKET, &st) ? NULL : SYSTEM_SOCKET;
}

static int disk_limit(const char *option, const char *text, struct err *err)
{
	size_t n = strlen(text);
	char digits[4] = "";
	uint64_t v;

	if (n > 1 && n <= 4 && text[n - 1] == '%') {
		memcpy(digits, text, n - 1);
		if (parse_u64(digits, &v) && v <= 100)
			return 0;
	}
	if (parse_size(text, &v))
		return 0;
	err_set(err, ERR_USAGE, "%s is neither a size nor a percentage: \"%s\"", option, text);
	return err_add_hint(err, "give a number with K, M or G, as in %s 20G, or as in %s 50%%", option, option);
}

int session_check(const struct session *session, struct err *err)
{
	const struct session_options *a = &session->opt;
	uint64_t n;

	if (a->memory && (!parse_size(a->memory, &n) || n < 24u << 20)) {
		err_set(err, ERR_USAGE, "--memory is not a size of at least 24M: \"%s\"", a->memory);
		return err_add_hint(err, "give a number with K, M or G, as in --memory 256M");
	}
	if (a->threads && (!parse_u64(a->threads, &n) || !n || n > 1024))
		return err_set(err, ERR_USAGE, "--threads must be a whole number from 1 to 1024, not \"%s\"", a->threads);
	if ((a->disk && disk_limit("--disk", a->disk, err)) || (a->keep_free && disk_limit("--keep-free", a->keep_free, err)))
		return -(int)err->code;
	if (a->own_private && (a->cache || a->disk || a->keep_free)) {
		err_set(err, ERR_USAGE,
			"--cache, --disk and --keep-free mean a daemon of the command's own, --private the one of the user");
		return err_add_hint(err, "leave out --private");
	}
	if ((a->memory || a->threads || a->cache || a->disk || a->keep_free) && a->socket) {
		err_set(err, ERR_USAGE,
			"--memory, --threads, --cache, --disk and --keep-free mean a daemon of the command's own");
		return err_add_hint(err, "leave out --socket");
	}
	return 0;
}

static struct acut_options options_of(struct session *session)
{
	return (struct acut_options){.program = session->console.program, .interrupted = session_interrupted, .ctx = session};
}

/* Handles the result of a call that sets session->acut. */
static int connected(struct session *session, int r, struct err *err)
{
	if (!r)
		return 0;
	session_failure(session, NULL, err);
	session->acut = acut_close(session->acut);
	return -(int)err->code;
}

int session_attach(struct session *session, int fd, struct err *err)
{
	const struct acut_options opt = options_of(session);

	return connected(session, acut_attach(fd, &opt, &session->acut), err);
}

static int connect_to(struct session *session, const char *path, struct err *err)
{
	const struct acut_options opt = options_of(session);
	int fd;

	if (!session_spawn_connect(path, &fd))
		return session_attach(session, fd, err);
	return connected(session, acut_connect(path, &opt, &session->acut), err); /* for its message */
}

const char *session_path(const struct session *session)
{
	return session->opt.own_private ? NULL : configured(&session->opt);
}

int session_connect_try(struct session *session, struct err *err)
{
	const struct session_options *a = &session->opt;
	const char *path = session_path(session);

	if (!a->own_private && (a->memory || a->threads || a->cache || a->disk || a->keep_free))
		return session_private_own(session, err);
	if (path)
		return connect_to(session, path, err);
	if (a->own_private || session->starts)
		return session_private_shared(session, err);
	err_set(err, ERR_NODAEMON, "no daemon is set: no --socket, no ACUT_SOCKET, no %s", SYSTEM_SOCKET);
	return err_add_hint(err, "start acutd, or use the private daemon of acutctl mesh with --private");
}

int session_connect(struct session *session)
{
	struct err err = ERR_INIT;

	return session_connect_try(session, &err) ? session_error(session, &err) : 0;
}

bool session_connect_running(struct session *session)
{
	const char *path = configured(&session->opt);
	char folder[PATH_MAX];
	struct err err = ERR_INIT;
	int fd;

	if (!path) {
		if (session_folder_runtime(folder, sizeof(folder) - 16, &err))
			return false;
		strcat(folder, "/acutd.sock");
		path = folder;
	}
	return !session_spawn_connect(path, &fd) && !session_attach(session, fd, &err);
}

void session_disconnect(struct session *session)
{
	session->acut = acut_close(session->acut);
	session->daemon = session_private_end(session->daemon);
}
