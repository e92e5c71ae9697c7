/*
 * Outputs that are complete before they get their names, which another process gives them, perhaps on another machine.
 *
 * Two processes may give the same output its name at once, and the reply to a rename may be lost. So an output that is not there
 * any more is looked for under its name, where it must have the same inode and size.
 */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "digest.h"
#include "err.h"
#include "io.h"
#include "io_place.h"
#include "outfile_priv.h"

/* A long name is cut, and its hash tells it from others that begin so. */
char *outfile_temp_name(const char *name, const char *middle)
{
	enum { AROUND = sizeof(".") - 1 + sizeof(".part") - 1, HASH = 17 };
	const size_t n = strlen(name), m = strlen(middle), room = NAME_MAX > AROUND + m ? NAME_MAX - AROUND - m : 0;
	char *temp;

	if (n <= room)
		return asprintf(&temp, ".%s%s.part", name, middle) < 0 ? NULL : temp;
	return asprintf(&temp, ".%.*s-%016llx%s.part", room > HASH ? (int)(room - HASH) : 0, name,
			(unsigned long long)digest_hash(name, n).lo, middle) < 0 ?
		       NULL :
		       temp;
}

static char *held_name(const char *name, const char *tag)
{
	char *middle, *held;

	if (asprintf(&middle, ".%s", tag) < 0)
		return NULL;
	held = outfile_temp_name(name, middle);
	free(middle);
	return held;
}

/* A temporary name that the output has already gets the tag, too: what is left of it is found by that. */
static int mark_temp(struct outfile *o, struct err *err)
{
	char *middle = NULL, *temp = NULL;

	if (asprintf(&middle, ".%s.%d", o->tag, (int)getpid()) >= 0) {
		temp = outfile_temp_name(o->name, middle);
		free(middle);
	}
	if (!temp)
		return err_set(err, ERR_NOMEM, "no memory for a file name");
	if (outfile_rename(o->dirfd, o->temp, o->dirfd, temp, true)) {
		err_sys(err, errno, "cannot name a temporary file");
		free(temp);
		return err_add_file(err, o->label);
	}
	free(o->temp);
	o->temp = temp;
	return 0;
}

int outfile_hold(struct outfile *o, const char *tag, struct err *err)
{
	char *held;

	if (o->dirfd < 0) {
		err_set(err, ERR_USAGE, "the output must be a file, and this is none");
		return err_add_file(err, o->label);
	}
	held = held_name(o->name, tag);
	o->tag = strdup(tag);
	if (!held || !o->tag) {
		free(held);
		return err_set(err, ERR_NOMEM, "no memory for a file name");
	}
	o->held = held;
	o->no_clobber = false;
	return o->temp ? mark_temp(o, err) : 0;
}

int outfile_held(const struct outfile *o, struct outfile_held *ret, struct err *err)
{
	struct stat st;

	if (fstat(o->fd, &st)) {
		err_sys(err, errno, "cannot look at an output");
		return err_add_file(err, o->label);
	}
	*ret = (struct outfile_held){(uint64_t)st.st_size, (uint64_t)st.st_ino};
	return 0;
}

bool outfile_is_held(int dirfd, const char *name, const struct outfile_held *held)
{
	struct stat st;

	return !fstatat(dirfd, name, &st, AT_SYMLINK_NOFOLLOW) && (uint64_t)st.st_ino == held->inode &&
	       (uint64_t)st.st_size == held->size;
}

int outfile_settle_at(int dirfd, const char *from, const char *name, const struct outfile_held *held, bool no_clobber,
		      struct err *err)
{
	int failed = outfile_rename(dirfd, from, dirfd, name, no_clobber) ? errno : 0;

	if (!failed || ((failed == ENOENT || failed == EEXIST) && outfile_is_held(dirfd, name, held)))
		return 0;
	if (failed == EEXIST)
		return err_set(err, ERR_USAGE, "the output exists now, and --no-clobber was given");
	if (failed == ENOENT)
		return err_set(err, ERR_GONE, "the complete output %s is not there any more", from);
	return err_sys(err, failed, "the output cannot be given its name");
}

/* By a descriptor: what another machine has written is seen once a file is opened. */
static int check_held(int dirfd, const char *from, const struct outfile_held *held, struct err *err)
{
	struct err absent = ERR_INIT;
	struct stat st;
	int fd = -1, r = 0;

	if (io_open(dirfd, from, O_RDONLY | O_NOFOLLOW, 0, &fd, &absent)) {
		if (absent.sys == ESTALE)
			return err_sys(err, ESTALE, "cannot open the complete output %s", from);
		return 0; /* renaming it tells more */
	}
	if (fstat(fd, &st))
		r = err_sys(err, errno, "cannot look at a complete output");
	else if ((uint64_t)st.st_size != held->size || (uint64_t)st.st_ino != held->inode)
		r = err_set(err, ERR_CORRUPT, "the complete output %s has %llu bytes, and was made with %llu, or is another file",
			    from, (unsigned long long)st.st_size, (unsigned long long)held->size);
	io_close(fd);
	return r;
}

int outfile_settle(const char *path, const char *tag, const struct outfile_held *held, bool no_clobber, struct err *err)
{
	struct io_place p;
	char *from;
	int r = io_place_find(path, true, &p, err);

	if (r)
		return err_add_file(err, path);
	from = held_name(p.name, tag);
	if (!from)
		r = err_set(err, ERR_NOMEM, "no memory for a file name");
	if (!r)
		r = check_held(p.dirfd, from, held, err);
	if (!r)
		r = outfile_settle_at(p.dirfd, from, p.name, held, no_clobber, err);
	if (!r) {
		int fd = -1;

		r = io_open(p.dirfd, ".", O_RDONLY | O_DIRECTORY, 0, &fd, err);
		r = r ? r : io_sync(fd, path, err);
		io_close(fd);
	}
	free(from);
	io_place_done(&p);
	return r ? err_add_file(err, path) : 0;
}

int outfile_unsettle(const char *path, const char *tag, const struct outfile_held *held, struct err *err)
{
	struct err absent = ERR_INIT;
	struct io_place p;
	char *name;
	int r = 0;

	if (io_place_find(path, true, &p, &absent))
		return 0;
	name = held_name(p.name, tag);
	if (!name)
		r = err_set(err, ERR_NOMEM, "no memory for a file name");
	else if (outfile_is_held(p.dirfd, p.name, held) && outfile_rename(p.dirfd, p.name, p.dirfd, name, true) &&
		 errno != ENOENT)
		r = err_sys(err, errno, "cannot take the name of an output away");
	free(name);
	io_place_done(&p);
	return r ? err_add_file(err, path) : 0;
}

void outfile_held_drop(const char *path, const char *tag)
{
	struct err ignored = ERR_INIT;
	struct io_place p;
	char *name;

	if (io_place_find(path, true, &p, &ignored))
		return;
	name = held_name(p.name, tag);
	if (name)
		io->unlinkat(p.dirfd, name, 0);
	free(name);
	io_place_done(&p);
}

/* ---- one that several processes write ---- */

int outfile_shared_make(const char *path, bool no_clobber, const char *tag, struct err *err)
{
	struct outfile *o = NULL;
	int r = outfile_new(path, no_clobber, &o, err);

	if (!r)
		r = outfile_hold(o, tag, err);
	if (!r)
		r = outfile_publish(o, err);
	outfile_free(o);
	return r;
}

static int open_held(struct outfile *o, const char *path, const char *tag, struct err *err)
{
	struct io_place p;
	char *name;
	int r = io_place_find(path, true, &p, err);

	if (r)
		return err_add_file(err, path);
	name = held_name(p.name, tag);
	/* Written at once, not from the pages of this node later: a client of NFS fills the page before a write beyond the size
	 * that it knows with zeros, and an attempt that was given up must not bring them over what another one wrote there since.
	 */
	r = name ? io_open(p.dirfd, name, O_WRONLY | O_DSYNC | O_NOFOLLOW, 0, &o->fd, err) :
		   err_set(err, ERR_NOMEM, "no memory for a file name");
	if (r && err->sys == ENOENT) {
		err_clear(err);
		err_set(err, ERR_GONE, "the output %s is not there any more", name);
		r = err_add_file(err, path);
	}
	o->own_fd = o->seekable = !r;
	free(name);
	io_place_done(&p);
	return r;
}

int outfile_shared_open(const char *path, const char *tag, struct outfile **ret, struct err *err)
{
	struct outfile *o = outfile_alloc(path, err);
	int r;

	if (!o)
		return -(int)err->code;
	r = open_held(o, path, tag, err);
	if (r)
		outfile_free(o);
	else
		*ret = o;
	return r;
}

int outfile_shared_sync(struct outfile *o, struct err *err)
{
	return io_sync(o->fd, o->label, err);
}
