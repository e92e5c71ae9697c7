/*
 * Which daemon a command speaks to: --socket, $ACUT_SOCKET, the system's socket, in this order; only where
 * none of them is set, and only for the commands that need nothing kept, a private one that is started
 * unasked.
 */
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "ctl.h"

#define SYSTEM_SOCKET "/run/acut/acutd.sock"

static const char *configured(const struct ctl_args *a)
{
	const char *env = getenv("ACUT_SOCKET");
	struct stat st;

	if (a->socket)
		return a->socket;
	if (env && *env)
		return env;
	return stat(SYSTEM_SOCKET, &st) ? NULL : SYSTEM_SOCKET;
}

static int connect_to(struct program *ctl, const char *path, struct err *err)
{
	const struct acut_options opt = {.program = "acutctl", .interrupted = ctl_signal_interrupted, .ctx = ctl};
	int fd, r = ctl_spawn_connect(path, &fd);

	if (!r)
		r = acut_attach(fd, &opt, &ctl->acut);
	else
		r = acut_connect(path, &opt, &ctl->acut); /* for its words */
	if (!r)
		return 0;
	ctl_error_from_acut(ctl->acut, NULL, err);
	ctl->acut = acut_close(ctl->acut);
	return -(int)err->code;
}

const char *ctl_connect_path(const struct program *ctl)
{
	return ctl->args.own_private ? NULL : configured(&ctl->args);
}

int ctl_connect_try(struct program *ctl, struct err *err)
{
	const struct ctl_args *a = &ctl->args;
	const char *path = ctl_connect_path(ctl);
	int r;

	if (!a->own_private && (a->memory || a->threads || a->cache || a->disk || a->keep_free)) {
		r = ctl_private_own(ctl, err);
	} else if (path) {
		r = connect_to(ctl, path, err);
	} else if (a->own_private || ctl->line.command->groups & CTL_OWN) {
		r = ctl_private_connect(ctl, err);
	} else {
		r = err_set(err, ERR_NODAEMON, "no daemon is set: no --socket, no ACUT_SOCKET, no %s", SYSTEM_SOCKET);
		err_add_hint(err, "start acutd, or use the private daemon of acutctl mesh with --private");
	}
	return r;
}

int ctl_connect(struct program *ctl)
{
	struct err err = ERR_INIT;

	return ctl_connect_try(ctl, &err) ? ctl_error(ctl, &err) : 0;
}

bool ctl_connect_quietly(struct program *ctl)
{
	const struct acut_options opt = {.program = "acutctl", .interrupted = ctl_signal_interrupted, .ctx = ctl};
	const char *path = configured(&ctl->args);
	char folder[PATH_MAX];
	struct err err = ERR_INIT;
	int fd;

	if (!path) {
		if (ctl_folder_runtime(folder, sizeof(folder) - 16, &err))
			return false;
		strcat(folder, "/acutd.sock");
		path = folder;
	}
	if (ctl_spawn_connect(path, &fd))
		return false;
	if (!acut_attach(fd, &opt, &ctl->acut))
		return true;
	ctl->acut = acut_close(ctl->acut);
	return false;
}

void ctl_disconnect(struct program *ctl)
{
	ctl->acut = acut_close(ctl->acut);
	ctl->daemon = ctl_private_end(ctl->daemon);
}
