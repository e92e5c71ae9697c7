/*
 * Removal of folders with everything in them.
 *
 * Entries are removed depth first, through the folder's descriptor and without following links, so nothing outside of
 * the folder is touched. It stops at the first entry that cannot be removed. Nothing is fsynced: a removed name may
 * come back after a power cut.
 */
#include "io.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "err.h"

struct sweep {
	int dirfd;
	const char *prefix;
	const atomic_bool *stop; /* NULL: never */
};

static int sweep(struct sweep s, struct err *err);

static int folder_remove(int dirfd, const char *name, const atomic_bool *stop, struct err *err)
{
	int sub, r;

	if (io->unlinkat(dirfd, name, 0) == 0 || errno == ENOENT)
		return 0;
	if (errno != EISDIR && errno != EPERM)
		return err_sys(err, errno, "cannot remove %s", name);
	r = io_open(dirfd, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW, 0, &sub, err);
	if (r)
		return r;
	r = sweep((struct sweep){sub, "", stop}, err);
	io_close(sub);
	if (!r && io->unlinkat(dirfd, name, AT_REMOVEDIR) != 0)
		r = err_sys(err, errno, "cannot remove the folder %s", name);
	return r;
}

static int remove_entry(void *ctx, const struct dirent *e, struct err *err)
{
	const struct sweep *s = ctx;

	if (s->stop && atomic_load(s->stop))
		return err_set(err, ERR_CANCELLED, "ended before all was removed");
	return strncmp(e->d_name, s->prefix, strlen(s->prefix)) ? 0 : folder_remove(s->dirfd, e->d_name, s->stop, err);
}

static int sweep(struct sweep s, struct err *err)
{
	return io_list(s.dirfd, ".", remove_entry, &s, err);
}

int io_folder_remove(int dirfd, const char *name, struct err *err)
{
	return folder_remove(dirfd, name, NULL, err);
}

int io_folder_sweep(int dirfd, const char *prefix, struct err *err)
{
	return sweep((struct sweep){dirfd, prefix, NULL}, err);
}

int io_folder_sweep_until(int dirfd, const char *prefix, const atomic_bool *stop, struct err *err)
{
	return sweep((struct sweep){dirfd, prefix, stop}, err);
}

int io_folder_empty(int dirfd, struct err *err)
{
	return io_folder_sweep(dirfd, "", err);
}
