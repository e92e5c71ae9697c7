/*
 * The user's folders, by the XDG rules.
 */
#include <errno.h>
#include <pwd.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "session_priv.h"

int session_folder_make(const char *path, struct err *err)
{
	char part[4096];
	size_t n = strlen(path);

	if (n >= sizeof(part))
		return err_set(err, ERR_USAGE, "the name of a folder is longer than %zu bytes", sizeof(part) - 1);
	for (size_t i = 1; i <= n; i++) {
		if (path[i] && path[i] != '/')
			continue;
		memcpy(part, path, i);
		part[i] = 0;
		if (mkdir(part, 0700) && errno != EEXIST) {
			struct stat st;
			int sys = errno;
			/* parents on read-only file systems are there all the same */
			if (!stat(part, &st) && S_ISDIR(st.st_mode))
				continue;
			err_sys(err, sys, "the folder cannot be made");
			return err_add_file(err, part);
		}
	}
	return 0;
}

/* $VARIABLE/acut, or ~/REST/acut. */
static int xdg(const char *variable, const char *rest, char *buf, size_t size, struct err *err)
{
	const char *base = getenv(variable), *home = getenv("HOME");
	int n;

	if (base && base[0] == '/') {
		n = snprintf(buf, size, "%s/acut", base);
	} else {
		if (!home || home[0] != '/') {
			const struct passwd *pw = getpwuid(getuid());
			home = pw ? pw->pw_dir : NULL;
		}
		if (!home || home[0] != '/') {
			err_set(err, ERR_IO, "there is no home folder to keep data in");
			return err_add_hint(err, "set HOME, or %s", variable);
		}
		n = snprintf(buf, size, "%s/%s/acut", home, rest);
	}
	if (n < 0 || (size_t)n >= size)
		return err_set(err, ERR_IO, "the name of the folder for %s is too long", rest);
	return session_folder_make(buf, err);
}

int session_folder_state(char *buf, size_t size, struct err *err)
{
	return xdg("XDG_STATE_HOME", ".local/state", buf, size, err);
}

int session_folder_cache(char *buf, size_t size, struct err *err)
{
	return xdg("XDG_CACHE_HOME", ".cache", buf, size, err);
}

/* In a folder that others can write, the name alone proves nothing: it must be ours, and ours alone. */
static int check_own(const char *path, struct err *err)
{
	struct stat st;

	if (lstat(path, &st)) {
		err_sys(err, errno, "the folder of the private daemon cannot be examined");
		return err_add_file(err, path);
	}
	if (!S_ISDIR(st.st_mode) || st.st_uid != getuid() || (st.st_mode & 077)) {
		err_set(err, ERR_PERM, "it is not a folder that only you can enter");
		err_add_file(err, path);
		return err_add_hint(err, "remove it, or set XDG_RUNTIME_DIR");
	}
	return 0;
}

int session_folder_runtime(char *buf, size_t size, struct err *err)
{
	const char *base = getenv("XDG_RUNTIME_DIR");
	int n, r;

	/* a socket's name in it must fit into 107 bytes */
	if (base && base[0] == '/' && strlen(base) < 80 && !access(base, W_OK | X_OK))
		n = snprintf(buf, size, "%s/acut", base);
	else
		n = snprintf(buf, size, "/tmp/acut-%u", (unsigned)getuid());
	if (n < 0 || (size_t)n >= size)
		return err_set(err, ERR_IO, "the name of the folder for sockets is too long");
	r = session_folder_make(buf, err);
	return r ? r : check_own(buf, err);
}
