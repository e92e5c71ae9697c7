/* The bytes of a source into a file of its own, which appears only whole, or to standard output. */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "err.h"
#include "io.h"
#include "io_place.h"
#include "scan_source.h"

struct out {
	int fd;
	const char *name;
	uint64_t at;
	struct err *err;
};

static int put_file(void *ctx, const void *bytes, size_t n)
{
	struct out *o = ctx;
	int r = io_write_at(o->fd, bytes, n, o->at, o->name, o->err);

	o->at += n;
	return r;
}

static int put_stream(void *ctx, const void *bytes, size_t n)
{
	struct out *o = ctx;
	const char *at = bytes;

	while (n) {
		ssize_t k = write(o->fd, at, n);

		if (k < 0 && errno != EINTR)
			return err_sys(o->err, errno, "standard output cannot be written");
		at += k > 0 ? k : 0;
		n -= k > 0 ? (size_t)k : 0;
	}
	return 0;
}

static int there_already(const char *name, struct err *err)
{
	err_set(err, ERR_USAGE, "it is there already");
	err_add_hint(err, "remove it, or write to another name");
	return err_add_file(err, name);
}

static int save_at(const struct scan_source *s, const struct io_place *at, struct out *out, struct err *err)
{
	char temp[NAME_MAX + 1];
	int r;

	if (!faccessat(at->dirfd, at->name, F_OK, AT_SYMLINK_NOFOLLOW))
		return there_already(out->name, err);
	if (snprintf(temp, sizeof temp, "%s.%d.part", at->name, (int)getpid()) >= (int)sizeof temp) {
		err_set(err, ERR_USAGE, "its name is too long");
		return err_add_file(err, out->name);
	}
	unlinkat(at->dirfd, temp, 0);
	out->fd = openat(at->dirfd, temp, O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
	if (out->fd < 0) {
		err_sys(err, errno, "it cannot be written");
		return err_add_file(err, out->name);
	}
	r = scan_source_write(s, put_file, NULL, out, err);
	if (!r && fchmod(out->fd, 0644))
		r = err_sys(err, errno, "%s cannot be made readable", out->name);
	if (!r)
		r = io_sync(out->fd, out->name, err);
	io_close(out->fd);
	if (!r && renameat2(at->dirfd, temp, at->dirfd, at->name, RENAME_NOREPLACE))
		r = errno == EEXIST ? there_already(out->name, err) :
				      err_sys(err, errno, "%s cannot be put in its place", out->name);
	if (r)
		unlinkat(at->dirfd, temp, 0);
	return r;
}

int scan_source_save(const struct scan_source *s, const char *name, struct err *err)
{
	struct out out = {.fd = STDOUT_FILENO, .name = name, .err = err};
	struct io_place at;
	int r;

	if (name[0] == '-' && !name[1])
		return scan_source_write(s, put_stream, NULL, &out, err);
	r = io_place_find(name, false, &at, err);
	if (r)
		return r;
	r = save_at(s, &at, &out, err);
	io_place_done(&at);
	return r;
}
