/*
 * Moves files out of a drop folder: pushed ones to done/, refused ones to failed/, with the reason beside them.
 *
 * Other processes may change the folder at any time. A file is moved only if its name still leads to the file that was read,
 * unchanged, and the moved file is checked once more: another file that has taken the name in between is moved back. Nothing
 * in done/ or failed/ is overwritten: a number is put before the extension. Both are folders inside of the folder itself,
 * never links.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "ctl_drop.h"
#include "term_error.h"
#include "io_place.h"

enum { NUMBERS_MAX = 100000 };

static const char DONE[] = "done", FAILED[] = "failed", REASON[] = ".error";

/* ---- the folders ---- */

static int open_sub(const struct ctl_drop *d, const char *name, int *ret, struct err *err)
{
	int fd = -1, sys;

	if (!mkdirat(d->fd, name, 0777) || errno == EEXIST)
		fd = openat(d->fd, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
	if (fd >= 0 && !faccessat(fd, ".", W_OK | X_OK, AT_EACCESS)) {
		*ret = fd;
		return 0;
	}
	sys = errno;
	if (fd >= 0)
		close(fd);
	err_sys(err, sys, "its folder %s/ cannot be used", name);
	err_add_hint(err, "files are moved there: the folder and it must be writable, and %s/ no link", name);
	return err_add_file(err, d->name);
}

int ctl_drop_open(struct ctl_drop *d, const char *name, struct err *err)
{
	int sys;

	*d = (struct ctl_drop){.name = name, .fd = -1, .done = -1, .failed = -1};
	if (io_place_folder(name, 0, &d->fd, NULL, err)) {
		sys = err->sys;
		if (sys == ENOENT || sys == ENOTDIR || sys == ELOOP) {
			err_clear(err);
			err_set(err, ERR_INPUT, "there is no such folder: %s", strerror(sys));
		} else if (sys) {
			err_clear(err);
			err_sys(err, sys, "the folder cannot be opened");
		}
		return err_add_file(err, name);
	}
	if (name[0] == '/') {
		d->path = strdup(name);
	} else {
		char *here = get_current_dir_name();

		if (!here || asprintf(&d->path, "%s/%s", here, name) < 0)
			d->path = NULL;
		free(here);
	}
	if (!d->path)
		return err_set(err, ERR_NOMEM, "no memory for the name of a folder");
	if (open_sub(d, DONE, &d->done, err))
		return -(int)err->code;
	return open_sub(d, FAILED, &d->failed, err);
}

void ctl_drop_close(struct ctl_drop *d)
{
	if (d->fd >= 0)
		close(d->fd);
	if (d->done >= 0)
		close(d->done);
	if (d->failed >= 0)
		close(d->failed);
	free(d->path);
	d->path = NULL;
	d->fd = d->done = d->failed = -1;
}

/* ---- names ---- */

/* "NAME", then "NAME.1" with the number before the extension. Long names are cut before it; `beside` more bytes must fit. */
static void numbered(const char *name, unsigned n, size_t beside, char buf[NAME_MAX + 1])
{
	const char *dot = strrchr(name, '.');
	size_t ext = dot && dot != name && strlen(dot) <= 16 ? strlen(dot) : 0, stem = strlen(name) - ext, most;
	char number[16] = "";

	if (n)
		snprintf(number, sizeof(number), ".%u", n);
	most = NAME_MAX - beside - ext - strlen(number);
	snprintf(buf, NAME_MAX + 1, "%.*s%s%s", (int)(stem < most ? stem : most), name, number, name + strlen(name) - ext);
}

static int move_to(int from, const char *name, int to, const char *as)
{
	struct stat st;

	if (!renameat2(from, name, to, as, RENAME_NOREPLACE))
		return 0;
	if (errno != EINVAL && errno != ENOSYS)
		return -1;
	/* The file system cannot refuse to replace, so check first. Another ingest waits for our lock. */
	if (!fstatat(to, as, &st, AT_SYMLINK_NOFOLLOW)) {
		errno = EEXIST;
		return -1;
	}
	return renameat(from, name, to, as);
}

static int changed(const struct ctl_input *in, struct err *err)
{
	err_set(err, ERR_CHANGED, "it changed while it was pushed, and stays where it is");
	err_add_hint(err, "the next pass tries it again");
	return err_add_file(err, in->name);
}

static int not_moved(const struct ctl_input *in, const char *to, int sys, struct err *err)
{
	if (sys == EXDEV)
		err_set(err, ERR_IO, "it cannot be moved: %s/ is on another file system", to);
	else
		err_sys(err, sys, "it cannot be moved to %s/", to);
	return err_add_file(err, in->name);
}

/* As `as`. *ret_taken: that name is there already. */
static int move_as(const struct ctl_drop *d, const struct ctl_input *in, int to, const char *folder, const char *as,
		   bool *ret_taken, struct err *err)
{
	struct stat st;

	*ret_taken = false;
	if (fstatat(d->fd, in->entry, &st, AT_SYMLINK_NOFOLLOW) || !ctl_input_unchanged(in, &st))
		return changed(in, err);
	if (move_to(d->fd, in->entry, to, as)) {
		int sys = errno;

		*ret_taken = sys == EEXIST;
		if (sys == ENOENT)
			return changed(in, err);
		return *ret_taken ? 0 : not_moved(in, folder, sys, err);
	}
	/* A rename changes the time of the inode, and nothing else. */
	if (!fstatat(to, as, &st, AT_SYMLINK_NOFOLLOW) && ctl_input_same(in, &st))
		return 0;
	/* Another file took the name between the two: it was not pushed. */
	move_to(to, as, d->fd, in->entry);
	return changed(in, err);
}

static void set_name(const char *folder, const char *as, struct ctl_drop_name *ret)
{
	snprintf(ret->text, sizeof(ret->text), "%s/%s", folder, as);
}

static int no_name(const struct ctl_input *in, const char *folder, struct err *err)
{
	err_set(err, ERR_IO, "%s/ has %d files of this name already", folder, NUMBERS_MAX);
	return err_add_file(err, in->name);
}

int ctl_drop_done(const struct ctl_drop *d, const struct ctl_input *in, struct ctl_drop_name *ret, struct err *err)
{
	char as[NAME_MAX + 1];
	bool taken = true;
	int r = 0;

	for (unsigned n = 0; !r && taken && n < NUMBERS_MAX; n++) {
		numbered(in->entry, n, 0, as);
		r = move_as(d, in, d->done, DONE, as, &taken, err);
	}
	if (!r && taken)
		return no_name(in, DONE, err);
	if (!r)
		set_name(DONE, as, ret);
	return r;
}

/* ---- what was refused ---- */

static void put_reason(FILE *f, const char *dataset, const struct ctl_input *in, const struct err *why)
{
	struct term_json j = term_json_begin(f, false);

	term_json_text(&j, "file", in->entry);
	term_json_text(&j, "dataset", dataset);
	term_json_time(&j, "time", clock_real_us());
	term_error_json(&j, "error", why);
	term_json_end(&j);
}

/* Under a name that nothing has. *ret_taken: this one is there already. */
static int write_reason(const struct ctl_drop *d, const char *as, const char *dataset, const struct ctl_input *in,
			const struct err *why, bool *ret_taken, struct err *err)
{
	int fd = openat(d->failed, as, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666), sys = errno;
	FILE *f = fd < 0 ? NULL : fdopen(fd, "w");
	bool good;

	*ret_taken = fd < 0 && sys == EEXIST;
	if (*ret_taken)
		return 0;
	if (!f) {
		if (fd >= 0)
			close(fd);
		err_sys(err, fd < 0 ? sys : errno, "the reason cannot be written to %s/%s", FAILED, as);
		return err_add_file(err, in->name);
	}
	errno = 0;
	put_reason(f, dataset, in, why);
	good = !fflush(f) && !ferror(f);
	sys = errno;
	good = !fclose(f) && good;
	if (good)
		return 0;
	unlinkat(d->failed, as, 0);
	err_sys(err, sys ? sys : EIO, "the reason cannot be written to %s/%s", FAILED, as);
	return err_add_file(err, in->name);
}

/* The reason is written first: a file in failed/ always has one. */
int ctl_drop_failed(const struct ctl_drop *d, const struct ctl_input *in, const char *dataset, const struct err *why,
		    struct ctl_drop_name *ret, struct err *err)
{
	char as[NAME_MAX + 1], reason[NAME_MAX + sizeof(REASON)];
	bool taken = true;
	int r = 0;

	for (unsigned n = 0; !r && taken && n < NUMBERS_MAX; n++) {
		numbered(in->entry, n, strlen(REASON), as);
		snprintf(reason, sizeof(reason), "%s%s", as, REASON);
		r = write_reason(d, reason, dataset, in, why, &taken, err);
		if (r || taken)
			continue;
		r = move_as(d, in, d->failed, FAILED, as, &taken, err);
		if (r || taken)
			unlinkat(d->failed, reason, 0);
	}
	if (!r && taken)
		return no_name(in, FAILED, err);
	if (!r)
		set_name(FAILED, as, ret);
	return r;
}
