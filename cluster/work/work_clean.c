/*
 * The end of a work folder. Only names that a run gives are removed: people put files of their own into the folder, and what was
 * not made by the run cannot be made again by one.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "err.h"
#include "io.h"
#include "work_priv.h"

enum { NFS_NAME = 64 };

/* With these it stays the work folder of a run that is done, so that a clean that was interrupted can be repeated. */
enum { LAST = 3 };
static const char *const last[LAST] = {"done", WORK_INPUTS, WORK_ABOUT};

struct cleaning {
	const struct work *work;
	const char *const *keep;
	bool kept;
};

/* KIND-I-A and what follows: the name of a file of an attempt. */
static bool is_of_attempt(const char *name)
{
	enum { DIGITS = 16 };
	const size_t kind = strspn(name, "abcdefghijklmnopqrstuvwxyz");
	const char *at = name + kind;
	size_t n;

	if (!kind || *at++ != '-')
		return false;
	n = strspn(at, "0123456789");
	at += n;
	return n && *at++ == '-' && strspn(at, "0123456789abcdef") >= DIGITS;
}

static bool is_of_run(const char *name)
{
	static const char *const files[] = {WORK_ABOUT, WORK_INPUTS, WORK_CANCELLED, NULL};
	/* Of dispatchers; temporary files of tasks; what NFS makes of a file that is removed while it is open. */
	static const char *const heads[] = {"script", "spill.", ".nfs", NULL};

	for (const char *const *f = files; *f; f++)
		if (!strcmp(name, *f))
			return true;
	for (const char *const *f = work_folders; *f; f++)
		if (!strcmp(name, *f))
			return true;
	for (const char *const *h = heads; *h; h++)
		if (!strncmp(name, *h, strlen(*h)))
			return true;
	return is_of_attempt(name);
}

static bool is_kept(const struct cleaning *c, const char *name)
{
	for (const char *const *k = c->keep; k && *k; k++)
		if (!strcmp(*k, name))
			return true;
	return false;
}

static int check_entry(void *ctx, const struct dirent *e, struct err *err)
{
	struct cleaning *c = ctx;

	if (is_kept(c, e->d_name) || is_of_run(e->d_name))
		return 0;
	err_set(err, ERR_CONFLICT, "%s is in the work folder, and not of the run", e->d_name);
	err_add_hint(err, "move it to another folder first");
	return err_add_file(err, c->work->folder);
}

static int clean_entry(void *ctx, const struct dirent *e, struct err *err)
{
	struct cleaning *c = ctx;

	if (is_kept(c, e->d_name)) {
		c->kept = true;
		return 0;
	}
	for (unsigned i = 0; i < LAST; i++)
		if (!strcmp(e->d_name, last[i]))
			return 0;
	return io_folder_remove(c->work->fd, e->d_name, err);
}

/* ---- files that are open ---- */

static int look_at_entry(void *ctx, const struct dirent *e, struct err *err)
{
	char *found = ctx;

	(void)err;
	if (!*found && !strncmp(e->d_name, ".nfs", 4))
		snprintf(found, NFS_NAME, "%.*s", NFS_NAME - 1, e->d_name);
	return 0;
}

/* Where a client of NFS keeps a file; "": nowhere. `folders`: also in those of a run. */
static void find_open(const struct work *w, bool folders, char path[PATH_MAX])
{
	struct err ignored = ERR_INIT;
	char found[NFS_NAME] = "";
	const char *in = "";

	io_list(w->fd, ".", look_at_entry, found, &ignored);
	for (const char *const *f = work_folders; folders && *f && !*found; f++) {
		err_clear(&ignored);
		io_list(w->fd, *f, look_at_entry, found, &ignored);
		in = *f;
	}
	path[0] = 0;
	if (*found)
		snprintf(path, PATH_MAX, "%s/%s%s%s", w->path ? w->path : w->folder, in, *in ? "/" : "", found);
}

/* A client of NFS gives a file that is removed while a process of its machine has it open the name .nfs..., and removes it when
 * it is closed. Until then nobody else on that machine can (EBUSY), nor the folder (ENOTEMPTY). `r`: an error, which gets the
 * name of such a file if it is of that kind; or 0, and there may be one all the same. */
static int explain_open(const struct work *w, int r, struct err *err)
{
	char path[PATH_MAX] = "";

	if (!r || err->sys == EBUSY || err->sys == ENOTEMPTY)
		find_open(w, r, path);
	if (!*path)
		return r;
	err_clear(err);
	err_set(err, ERR_CONFLICT,
		"the file is deleted, but a process of this machine has it open, and NFS keeps it until it closes it");
	err_add_hint(err, "'fuser -v %s' tells which one; end it, then %s", path,
		     faccessat(w->fd, WORK_ABOUT, F_OK, 0) ? "remove the folder" : "clean once more");
	return err_add_file(err, path);
}

/* ---- all of it ---- */

int work_clean(struct work *w, const char *const *keep, struct err *err)
{
	struct cleaning c = {.work = w, .keep = keep};
	int r = io_list(w->fd, ".", check_entry, &c, err);

	if (!r)
		r = explain_open(w, io_list(w->fd, ".", clean_entry, &c, err), err);
	for (unsigned i = 0; !r && i < LAST; i++)
		if (!is_kept(&c, last[i]))
			r = explain_open(w, io_folder_remove(w->fd, last[i], err), err);
	if (r || c.kept || w->linked || !w->path)
		return r;
	if (io->unlinkat(AT_FDCWD, w->path, AT_REMOVEDIR) < 0 && errno != ENOENT)
		r = explain_open(w, err_sys(err, errno, "cannot remove the folder %s", w->path), err);
	return r;
}
