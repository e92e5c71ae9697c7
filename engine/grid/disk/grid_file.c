/*
 * Sequential writing (grid_file.h). One buffer, flushed when it is full, so the disk gets few large writes. A failed
 * fsync is not retried.
 */
#include "grid_file.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "io.h"

int grid_file_open(int dirfd, const char *name, const char *what, int *ret_fd, struct err *err)
{
	struct err why = ERR_INIT;
	int rc = io_open(dirfd, name, O_RDONLY, 0, ret_fd, &why);

	if (rc && why.sys == ENOENT) {
		/* acut never removes a file that is still named, so a missing one is damage. */
		err_raise(err, ERR_CORRUPT, ENOENT, __FILE__, __LINE__, "%s is gone", what);
		err_add_file(err, name);
		return err_add_hint(err, "check the disk, and restore the file or push its data again");
	}
	if (rc)
		*err = why;
	return rc;
}

int grid_file_create(struct grid_file *f, int dirfd, const char *name, void *buf, size_t cap, struct err *err)
{
	struct grid_file new = {.dirfd = dirfd, .fd = -1, .buf = buf, .cap = cap};

	assert(strlen(name) < sizeof new.name);
	snprintf(new.name, sizeof new.name, "%s", name);
	snprintf(new.temp, sizeof new.temp, "%s.tmp", name);
	/* A file that a failure left is not written again: its fsync may have failed. */
	int rc = io_remove(dirfd, new.temp, err);

	if (rc == 0)
		rc = io_open(dirfd, new.temp, O_WRONLY | O_CREAT | O_EXCL, 0640, &new.fd, err);
	if (rc)
		return rc;
	*f = new;
	return 0;
}

static int flush(struct grid_file *f, struct err *err)
{
	int rc = f->used ? io_write_at(f->fd, f->buf, f->used, f->at, f->temp, err) : 0;

	if (rc)
		return rc;
	f->at += f->used;
	f->used = 0;
	return 0;
}

int grid_file_reserve(struct grid_file *f, size_t n, uint8_t **ret, struct err *err)
{
	assert(n <= f->cap);
	if (f->cap - f->used < n) {
		int rc = flush(f, err);

		if (rc)
			return rc;
	}
	*ret = f->buf + f->used;
	return 0;
}

void grid_file_commit(struct grid_file *f, size_t n)
{
	assert(n <= f->cap - f->used);
	f->used += n;
}

uint64_t grid_file_place(const struct grid_file *f)
{
	return f->at + f->used;
}

int grid_file_append(struct grid_file *f, const void *bytes, size_t n, struct err *err)
{
	const uint8_t *from = bytes;

	while (n) {
		if (f->used == f->cap) {
			int rc = flush(f, err);

			if (rc)
				return rc;
		}
		size_t part = f->cap - f->used < n ? f->cap - f->used : n;

		memcpy(f->buf + f->used, from, part);
		f->used += part;
		from += part;
		n -= part;
	}
	return 0;
}

int grid_file_patch(struct grid_file *f, uint64_t place, const void *bytes, size_t n, struct err *err)
{
	int rc = flush(f, err);

	return rc ? rc : io_write_at(f->fd, bytes, n, place, f->temp, err);
}

int grid_file_publish(struct grid_file *f, enum grid_durability durable, struct err *err)
{
	int rc = flush(f, err);

	if (rc == 0 && durable == GRID_DURABLE_DATA)
		rc = io_sync(f->fd, f->name, err);
	if (rc) {
		grid_file_abort(f);
		return rc;
	}
	if (durable == GRID_DURABLE) {
		rc = io_publish(f->dirfd, f->fd, f->temp, f->name, err);
	} else if (io->renameat(f->dirfd, f->temp, f->dirfd, f->name) != 0) {
		err_sys(err, errno, "cannot rename %s", f->temp);
		rc = err_add_file(err, f->name);
	}
	if (rc) {
		/* If only the fsync of the folder failed, the new name exists. Remove both names, because the caller will
		 * report that there is no such file. */
		io->unlinkat(f->dirfd, f->temp, 0);
		io->unlinkat(f->dirfd, f->name, 0);
	}
	f->fd = io_close(f->fd);
	return rc;
}

void grid_file_abort(struct grid_file *f)
{
	if (f->fd < 0)
		return;
	io->unlinkat(f->dirfd, f->temp, 0); /* best effort: another error is already being reported */
	f->fd = io_close(f->fd);
}
