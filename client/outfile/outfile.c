/*
 * An output file: complete, or not there.
 *
 * A regular output is a nameless file in its folder and gets its name in outfile_publish, so nothing is left behind however
 * the process ends. Where the file system has no nameless files it has a temporary name, and is removed if it is freed
 * unpublished. What cannot be renamed (standard output, pipes, devices) is written directly. A link is followed first
 * (io_place.c), so that its target is replaced and the link stays. outfile_bytes.c writes the bytes.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "err.h"
#include "outfile_priv.h"
#include "io.h"
#include "io_place.h"

uint8_t *outfile_buffer(void)
{
	return aligned_alloc(OUTFILE_BLOCK, OUTFILE_BUFFER + OUTFILE_BLOCK);
}

struct outfile *outfile_alloc(const char *label, struct err *err)
{
	struct outfile *o = calloc(1, sizeof(*o));

	if (o) {
		o->dirfd = o->fd = -1;
		o->label = strdup(label);
		o->buf = outfile_buffer();
	}
	if (!o || !o->label || !o->buf) {
		err_set(err, ERR_NOMEM, "no memory for an output buffer");
		return outfile_free(o);
	}
	return o;
}

static char *proc_name(int fd, char buf[32])
{
	snprintf(buf, 32, "/proc/self/fd/%d", fd);
	return buf;
}

/* Calls `make` with temporary names until one is free. */
static int output_temp(struct outfile *o, int (*make)(struct outfile *, struct err *), struct err *err)
{
	for (unsigned i = 0; i < 1000; i++) {
		struct err e = ERR_INIT;
		char *middle = NULL;

		if (asprintf(&middle, "%s%s.%d-%u", o->tag ? "." : "", o->tag ? o->tag : "", (int)getpid(), i) >= 0) {
			o->temp = outfile_temp_name(o->name, middle);
			free(middle);
		}
		if (!o->temp)
			return err_set(err, ERR_NOMEM, "no memory for a file name");
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

static int make_named(struct outfile *o, struct err *err)
{
	return io_open(o->dirfd, o->temp, O_RDWR | O_CREAT | O_EXCL, 0666, &o->fd, err);
}

/* Gives a nameless file its temporary name. */
static int make_link(struct outfile *o, struct err *err)
{
	char from[32];

	if (io->linkat(AT_FDCWD, proc_name(o->fd, from), o->dirfd, o->temp, AT_SYMLINK_FOLLOW))
		return err_sys(err, errno, "the output cannot be given a name");
	return 0;
}

static int output_make(struct outfile *o, struct err *err)
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
	o->own_fd = o->seekable = o->may_direct = !r;
	return r;
}

/* What has the name already: 0: a file that will be replaced, or nothing; PLACE_OPEN: something else, which is written to. */
enum { PLACE_OPEN = 1 };

static int check_existing(const struct outfile *o, const struct io_place *p, struct err *err)
{
	struct stat st;

	if (!*p->name)
		return err_set(err, ERR_USAGE, "the output is a folder");
	if (fstatat(p->dirfd, p->name, &st, p->opaque ? 0 : AT_SYMLINK_NOFOLLOW))
		return 0;
	if (S_ISDIR(st.st_mode))
		return err_set(err, ERR_USAGE, "the output is a folder");
	if (o->no_clobber)
		return err_set(err, ERR_USAGE, "the output exists already, and --no-clobber was given");
	/* It was not a link before: a new link is not followed. */
	if (S_ISLNK(st.st_mode))
		return err_set(err, ERR_PERM, "a link has just been put in the place of the output");
	return p->opaque || !S_ISREG(st.st_mode) ? PLACE_OPEN : 0;
}

static int output_open_file(struct outfile *o, const char *path, struct err *err)
{
	struct io_place p;
	int r = io_place_find(path, true, &p, err);

	if (r)
		return err_add_file(err, o->label);
	r = check_existing(o, &p, err);
	if (r == PLACE_OPEN) {
		r = io_open(p.dirfd, p.name, O_WRONLY | (p.opaque ? 0 : O_NOFOLLOW), 0, &o->fd, err);
		o->own_fd = !r;
	} else if (!r) {
		o->name = p.name;
		p.name = NULL;
		r = io_open(p.dirfd, ".", O_RDONLY | O_DIRECTORY, 0, &o->dirfd, err);
		if (!r)
			r = output_make(o, err);
	}
	io_place_done(&p);
	return r ? err_add_file(err, o->label) : 0;
}

int outfile_new(const char *path, bool no_clobber, struct outfile **ret, struct err *err)
{
	bool standard = !strcmp(path, "-");
	struct outfile *o = outfile_alloc(standard ? "standard output" : path, err);
	int r = 0;

	if (!o)
		return -err->code;
	o->no_clobber = no_clobber;
	if (standard)
		o->fd = STDOUT_FILENO;
	else
		r = output_open_file(o, path, err);
	if (r) {
		outfile_free(o);
		return r;
	}
	*ret = o;
	return 0;
}

const char *outfile_base(const struct outfile *o)
{
	return o->dirfd < 0 ? NULL : o->name;
}

int outfile_nameless(int dirfd, int *ret_fd, struct err *err)
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
		/* no nameless files here, or the disk is full: the next call shows which */
		snprintf(name, sizeof(name), ".acut-spool-%d-%08lx", (int)getpid(), (unsigned long)random());
		r = io_open(dirfd, name, O_RDWR | O_CREAT | O_EXCL, 0600, ret_fd, err);
		if (!r)
			unlinkat(dirfd, name, 0);
	}
	io_close(own);
	return r;
}

int outfile_spool(const struct outfile *beside, struct outfile **ret, struct err *err)
{
	struct outfile *o = outfile_alloc(beside ? beside->label : "a temporary file", err);
	int r;

	if (!o)
		return -err->code;
	r = outfile_nameless(beside ? beside->dirfd : -1, &o->fd, err);
	if (r) {
		err_add_file(err, o->label);
		outfile_free(o);
		return r;
	}
	o->own_fd = o->seekable = true;
	*ret = o;
	return 0;
}

/* One that never replaces is in one step where the system has it, else by a second link. */
int outfile_rename(int fromfd, const char *from, int tofd, const char *to, bool no_clobber)
{
	int r = no_clobber ? renameat2(fromfd, from, tofd, to, RENAME_NOREPLACE) : renameat(fromfd, from, tofd, to);

	if (r && no_clobber && (errno == EINVAL || errno == ENOSYS) && !(r = linkat(fromfd, from, tofd, to, 0)))
		unlinkat(fromfd, from, 0);
	return r;
}

static int publish_no_clobber(struct outfile *o, struct err *err)
{
	int r = io_sync(o->fd, o->label, err);

	if (r)
		return r;
	if (outfile_rename(o->dirfd, o->temp, o->dirfd, o->name, true)) {
		if (errno == EEXIST) {
			err_set(err, ERR_USAGE, "the output exists now, and --no-clobber was given");
			return err_add_file(err, o->label);
		}
		err_sys(err, errno, "the output cannot be given its name");
		return err_add_file(err, o->label);
	}
	return io_sync(o->dirfd, o->label, err);
}

int outfile_publish(struct outfile *o, struct err *err)
{
	const char *name = o->held ? o->held : o->name;
	int r = outfile_flush(o, err);

	if (!r && o->nameless) {
		r = output_temp(o, make_link, err);
		o->nameless = r != 0;
	}
	/* A failure of io_publish removes the file; what is kept must not go because the disk is full. */
	if (!r && o->part)
		r = io_sync(o->fd, o->label, err);
	if (r || !o->temp)
		return r;
	if (o->no_clobber) {
		r = publish_no_clobber(o, err);
	} else if (o->passing) {
		r = io_sync(o->fd, o->label, err);
		if (!r && renameat(o->dirfd, o->temp, o->dirfd, name)) {
			err_sys(err, errno, "the output cannot be given its name");
			r = err_add_file(err, o->label);
		}
	} else {
		r = io_publish(o->dirfd, o->fd, o->temp, name, err);
		if (r)
			err_add_file(err, o->label);
	}
	if (r)
		return r;
	free(o->temp);
	o->temp = NULL;
	return 0;
}

struct outfile *outfile_free(struct outfile *o)
{
	if (!o)
		return NULL;
	outfile_behind_end(o);
	if (o->temp && o->dirfd >= 0 && !o->part)
		unlinkat(o->dirfd, o->temp, 0);
	if (o->host && o->host->annex == o)
		o->host->annex = NULL;
	outfile_part_free(o->part);
	if (o->own_fd)
		io_close(o->fd);
	io_close(o->dirfd);
	free(o->label);
	free(o->name);
	free(o->held);
	free(o->tag);
	free(o->temp);
	free(o->buf);
	free(o);
	return NULL;
}
