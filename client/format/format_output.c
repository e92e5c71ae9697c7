/*
 * Where a writer's bytes go: whole files or nothing.
 *
 * A regular output is a nameless file in the folder it will stand in and gets its name only by
 * format_output_publish, so that however this process ends, nothing stays; where the file system has no
 * nameless files, it has a temporary name, and is removed when it is freed unpublished. What cannot be
 * renamed (standard output, pipes, devices) is written straight through. A link is followed first, so that
 * the file it points to is replaced and the link stays. Writes are gathered into one buffer of FORMAT_BUFFER
 * bytes.
 */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "err.h"
#include "format_priv.h"
#include "io.h"

struct format_output {
	int dirfd, fd;             /* dirfd -1: standard output or not a regular file */
	char *label, *name, *temp; /* label: what messages call it; name, temp: inside dirfd */
	bool seekable, no_clobber, own_fd;
	bool nameless;             /* has no name yet, temp is NULL */
	uint64_t at;               /* bytes handed to the system */
	size_t used;
	uint8_t *buf;
};

static struct format_output *output_alloc(const char *label, struct err *err)
{
	struct format_output *o = calloc(1, sizeof(*o));

	if (o) {
		o->dirfd = o->fd = -1;
		o->label = strdup(label);
		o->buf = malloc(FORMAT_BUFFER);
	}
	if (!o || !o->label || !o->buf) {
		err_set(err, ERR_NOMEM, "no memory for an output buffer");
		return format_output_free(o);
	}
	return o;
}

/* Splits `path` into an opened folder and a name in it. */
static int output_folder(struct format_output *o, const char *path, struct err *err)
{
	const char *slash = strrchr(path, '/');
	char *dir = slash ? strndup(path, slash == path ? 1 : (size_t)(slash - path)) : strdup(".");
	int r;

	o->name = strdup(slash ? slash + 1 : path);
	if (!dir || !o->name) {
		free(dir);
		return err_set(err, ERR_NOMEM, "no memory for a file name");
	}
	r = io_open(AT_FDCWD, dir, O_RDONLY | O_DIRECTORY, 0, &o->dirfd, err);
	free(dir);
	return r;
}

static char *proc_name(int fd, char buf[32])
{
	snprintf(buf, 32, "/proc/self/fd/%d", fd);
	return buf;
}

/* Calls `make` with temporary names until one is free. */
static int output_temp(struct format_output *o, int (*make)(struct format_output *, struct err *),
		       struct err *err)
{
	for (unsigned i = 0; i < 1000; i++) {
		struct err e = ERR_INIT;

		if (asprintf(&o->temp, ".%.200s.%d-%u.part", o->name, (int)getpid(), i) < 0) {
			o->temp = NULL;
			return err_set(err, ERR_NOMEM, "no memory for a file name");
		}
		if (!make(o, &e))
			return 0;
		free(o->temp);
		o->temp = NULL;
		if (e.sys != EEXIST) {
			*err = e;
			err->file[0] = 0;
			return err_add_file(err, o->label);
		}
	}
	err_set(err, ERR_IO, "1000 temporary names in the folder are taken");
	return err_add_file(err, o->label);
}

static int make_named(struct format_output *o, struct err *err)
{
	return io_open(o->dirfd, o->temp, O_RDWR | O_CREAT | O_EXCL, 0666, &o->fd, err);
}

/* Gives a nameless file its temporary name. */
static int make_link(struct format_output *o, struct err *err)
{
	char from[32];

	if (linkat(AT_FDCWD, proc_name(o->fd, from), o->dirfd, o->temp, AT_SYMLINK_FOLLOW))
		return err_sys(err, errno, "the output cannot be given a name");
	return 0;
}

static int output_make(struct format_output *o, struct err *err)
{
	struct err ignored = ERR_INIT;
	char name[32];
	int r = 0;

	o->nameless = !io_open(o->dirfd, ".", O_TMPFILE | O_RDWR, 0666, &o->fd, &ignored);
	if (o->nameless && access(proc_name(o->fd, name), F_OK)) {
		o->fd = io_close(o->fd); /* no /proc: it could never get a name */
		o->nameless = false;
	}
	if (!o->nameless)
		r = output_temp(o, make_named, err);
	o->own_fd = o->seekable = !r;
	return r;
}

static int output_open_file(struct format_output *o, const char *path, struct err *err)
{
	struct stat st;
	char real[PATH_MAX];
	int r;

	if (!stat(path, &st)) {
		if (S_ISDIR(st.st_mode)) {
			err_set(err, ERR_USAGE, "the output is a folder");
			return err_add_file(err, path);
		}
		if (o->no_clobber) {
			err_set(err, ERR_USAGE, "the output exists already, and --no-clobber was given");
			return err_add_file(err, path);
		}
		if (!S_ISREG(st.st_mode)) {
			r = io_open(AT_FDCWD, path, O_WRONLY, 0, &o->fd, err);
			o->own_fd = !r;
			return r ? err_add_file(err, path) : 0;
		}
		if (realpath(path, real))
			path = real;
	}
	r = output_folder(o, path, err);
	if (!r && !o->name[0])
		r = err_set(err, ERR_USAGE, "the output is a folder");
	if (!r)
		r = output_make(o, err);
	return r ? err_add_file(err, o->label) : 0;
}

int format_output_new(const char *path, bool no_clobber, struct format_output **ret, struct err *err)
{
	bool standard = !strcmp(path, "-");
	struct format_output *o = output_alloc(standard ? "standard output" : path, err);
	int r = 0;

	if (!o)
		return -err->code;
	o->no_clobber = no_clobber;
	if (standard)
		o->fd = STDOUT_FILENO;
	else
		r = output_open_file(o, path, err);
	if (r) {
		format_output_free(o);
		return r;
	}
	*ret = o;
	return 0;
}

/* A file without a name in `dirfd`, or in the folder for temporary files if that is -1. */
static int spool_open(int dirfd, int *ret_fd, struct err *err)
{
	const char *dir = getenv("TMPDIR");
	struct err ignored = ERR_INIT;
	char name[64];
	int own = -1, r = 0;

	if (dirfd < 0) {
		r = io_open(AT_FDCWD, dir && *dir ? dir : "/var/tmp", O_RDONLY | O_DIRECTORY, 0, &own, err);
		dirfd = own;
	}
	if (!r && io_open(dirfd, ".", O_TMPFILE | O_RDWR, 0600, ret_fd, &ignored)) {
		/* a file system without nameless files, or one that is full: the next call says which */
		snprintf(name, sizeof(name), ".acut-spool-%d-%08lx", (int)getpid(), (unsigned long)random());
		r = io_open(dirfd, name, O_RDWR | O_CREAT | O_EXCL, 0600, ret_fd, err);
		if (!r)
			unlinkat(dirfd, name, 0);
	}
	io_close(own);
	return r;
}

int format_output_spool(const struct format_output *beside, struct format_output **ret, struct err *err)
{
	struct format_output *o = output_alloc(beside->label, err);
	int r;

	if (!o)
		return -err->code;
	r = spool_open(beside->dirfd, &o->fd, err);
	if (r) {
		err_add_file(err, beside->label);
		format_output_free(o);
		return r;
	}
	o->own_fd = o->seekable = true;
	*ret = o;
	return 0;
}

/* Straight to the descriptor: at the offset where it can seek, else in order. */
static int output_put(struct format_output *o, const uint8_t *p, size_t n, struct err *err)
{
	if (o->seekable) {
		int r = io_write_at(o->fd, p, n, o->at, o->label, err);
		if (!r)
			o->at += n;
		return r;
	}
	while (n) {
		ssize_t k = write(o->fd, p, n);
		if (k < 0 && errno == EINTR)
			continue;
		if (k < 0) {
			err_sys(err, errno, "writing failed");
			return err_add_file(err, o->label);
		}
		p += k;
		n -= (size_t)k;
		o->at += (uint64_t)k;
	}
	return 0;
}

static int output_flush(struct format_output *o, struct err *err)
{
	int r = o->used ? output_put(o, o->buf, o->used, err) : 0;

	if (!r)
		o->used = 0;
	return r;
}

void *format_output_room(struct format_output *o, size_t n, struct err *err)
{
	if (o->used + n > FORMAT_BUFFER && output_flush(o, err))
		return NULL;
	return o->buf + o->used;
}

void format_output_used(struct format_output *o, size_t n)
{
	o->used += n;
}

int format_output_write(struct format_output *o, const void *bytes, size_t n, struct err *err)
{
	const uint8_t *p = bytes;

	while (n) {
		size_t k = n < FORMAT_BUFFER ? n : FORMAT_BUFFER;
		void *to = format_output_room(o, k, err);
		if (!to)
			return -err->code;
		memcpy(to, p, k);
		o->used += k;
		p += k;
		n -= k;
	}
	return 0;
}

int format_output_patch(struct format_output *o, uint64_t at, const void *bytes, size_t n, struct err *err)
{
	int r = output_flush(o, err);

	return r ? r : io_write_at(o->fd, bytes, n, at, o->label, err);
}

/* Inside the kernel where the file systems can; 0 done, 1 not possible here (nothing was copied). */
static int join_inside(struct format_output *o, struct format_output *spool, struct err *err)
{
	off_t from = 0, to = (off_t)o->at;
	uint64_t left = spool->at;

	while (left) {
		size_t part = left > (1u << 30) ? (1u << 30) : (size_t)left;
		ssize_t k = copy_file_range(spool->fd, &from, o->fd, o->seekable ? &to : NULL, part, 0);
		if (k < 0 && errno == EINTR)
			continue;
		if (k <= 0 && left == spool->at && (k == 0 || (errno != ENOSPC && errno != EDQUOT)))
			return 1;
		if (k <= 0) {
			err_sys(err, k ? errno : EIO, "copying a temporary file failed");
			return err_add_file(err, o->label);
		}
		left -= (uint64_t)k;
		o->at += (uint64_t)k;
	}
	return 0;
}

int format_output_join(struct format_output *o, struct format_output *spool, struct err *err)
{
	int r = output_flush(o, err);

	if (!r)
		r = output_flush(spool, err);
	if (!r && o->seekable)
		r = join_inside(o, spool, err);
	else if (!r)
		r = 1;
	if (r <= 0)
		return r;
	for (uint64_t from = 0; from < spool->at;) {
		size_t n = spool->at - from < FORMAT_BUFFER ? (size_t)(spool->at - from) : FORMAT_BUFFER;
		r = io_read_at(spool->fd, o->buf, n, from, o->label, err);
		if (!r)
			r = output_put(o, o->buf, n, err);
		if (r)
			return r;
		from += n;
	}
	return 0;
}

int format_output_read(struct format_output *o, uint64_t at, void *bytes, size_t n, struct err *err)
{
	int r = output_flush(o, err);

	return r ? r : io_read_at(o->fd, bytes, n, at, o->label, err);
}

bool format_output_seekable(const struct format_output *o)
{
	return o->seekable;
}

uint64_t format_output_size(const struct format_output *o)
{
	return o->at + o->used;
}

const char *format_output_name(const struct format_output *o)
{
	return o->label;
}

/* rename that never replaces: in one step where the system has it, else by a second link. */
static int publish_no_clobber(struct format_output *o, struct err *err)
{
	int r = io_sync(o->fd, o->label, err);

	if (r)
		return r;
	if (renameat2(o->dirfd, o->temp, o->dirfd, o->name, RENAME_NOREPLACE)) {
		if (errno == EINVAL || errno == ENOSYS) {
			if (!linkat(o->dirfd, o->temp, o->dirfd, o->name, 0)) {
				unlinkat(o->dirfd, o->temp, 0);
				return io_sync(o->dirfd, o->label, err);
			}
		}
		if (errno == EEXIST) {
			err_set(err, ERR_USAGE, "the output exists now, and --no-clobber was given");
			return err_add_file(err, o->label);
		}
		err_sys(err, errno, "the output cannot be given its name");
		return err_add_file(err, o->label);
	}
	return io_sync(o->dirfd, o->label, err);
}

int format_output_publish(struct format_output *o, struct err *err)
{
	int r = output_flush(o, err);

	if (!r && o->nameless) {
		r = output_temp(o, make_link, err);
		o->nameless = r != 0;
	}
	if (r || !o->temp)
		return r;
	if (o->no_clobber) {
		r = publish_no_clobber(o, err);
	} else {
		r = io_publish(o->dirfd, o->fd, o->temp, o->name, err);
		if (r)
			err_add_file(err, o->label);
	}
	if (r)
		return r;
	free(o->temp);
	o->temp = NULL;
	return 0;
}

struct format_output *format_output_free(struct format_output *o)
{
	if (!o)
		return NULL;
	if (o->temp && o->dirfd >= 0)
		unlinkat(o->dirfd, o->temp, 0);
	if (o->own_fd)
		io_close(o->fd);
	io_close(o->dirfd);
	free(o->label);
	free(o->name);
	free(o->temp);
	free(o->buf);
	free(o);
	return NULL;
}
