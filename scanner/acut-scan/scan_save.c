/* The bytes of a source into a file of its own, which appears only whole, or to standard output. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "err.h"
#include "io.h"
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

static bool stopped(void *ctx)
{
	return scan_stopped();
}

static int there_already(const char *name, struct err *err)
{
	err_set(err, ERR_USAGE, "it is there already");
	err_add_hint(err, "remove it, or write to another name");
	return err_add_file(err, name);
}

int scan_source_save(const struct scan_source *s, const char *name, struct err *err)
{
	struct out out = {.fd = STDOUT_FILENO, .name = name, .err = err};
	char temp[4096];
	int r;

	if (name[0] == '-' && !name[1])
		return scan_source_write(s, put_stream, stopped, &out, err);
	if (!access(name, F_OK) || snprintf(temp, sizeof temp, "%s.XXXXXX", name) >= (int)sizeof temp)
		return there_already(name, err);
	out.fd = mkostemp(temp, O_CLOEXEC);
	if (out.fd < 0) {
		err_sys(err, errno, "it cannot be written");
		return err_add_file(err, name);
	}
	r = scan_source_write(s, put_file, stopped, &out, err);
	if (!r && fchmod(out.fd, 0644))
		r = err_sys(err, errno, "%s cannot be made readable", name);
	if (!r)
		r = io_sync(out.fd, name, err);
	io_close(out.fd);
	if (!r && renameat2(AT_FDCWD, temp, AT_FDCWD, name, RENAME_NOREPLACE))
		r = errno == EEXIST ? there_already(name, err) : err_sys(err, errno, "%s cannot be put in its place", name);
	if (r)
		unlink(temp);
	return r;
}
