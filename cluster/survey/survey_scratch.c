/*
 * Folders for temporary files on a node's own disk (--scratch). A task that is killed leaves its folder, and no command can clean
 * what is on a node: so each task first removes those of dead ones, of any run. A living task has its folder locked.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <sys/file.h>

#include "err.h"
#include "io.h"
#include "survey_priv.h"

static bool is_scratch(const char *name)
{
	unsigned long long id, attempt;
	unsigned task;
	int n = 0;

	return sscanf(name, "acut-%llx-stage-%u-%llx%n", &id, &task, &attempt, &n) == 3 && n && !name[n];
}

static int sweep_entry(void *ctx, const struct dirent *e, struct err *err)
{
	const int folder = *(const int *)ctx;
	struct err ignored = ERR_INIT;
	int fd;

	(void)err;
	if (!is_scratch(e->d_name) || io_open(folder, e->d_name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW, 0, &fd, &ignored))
		return 0;
	if (!io->flock(fd, LOCK_EX | LOCK_NB))
		io_folder_remove(folder, e->d_name, &ignored);
	io_close(fd);
	return 0;
}

static void sweep(const char *scratch)
{
	struct err ignored = ERR_INIT;
	int folder;

	if (io_open(AT_FDCWD, scratch, O_RDONLY | O_DIRECTORY, 0, &folder, &ignored))
		return;
	io_list(folder, ".", sweep_entry, &folder, &ignored);
	io_close(folder);
}

/* *ret_fd is -1 if another task's sweep has removed the folder before it was locked. */
static int make_locked(const char *name, int *ret_fd, struct err *err)
{
	int fd, r = io_make_dir(AT_FDCWD, name, 0700, err);

	*ret_fd = -1;
	if (r)
		return r;
	r = io_open(AT_FDCWD, name, O_RDONLY | O_DIRECTORY, 0, &fd, err);
	if (r) {
		if (err->sys != ENOENT)
			return r;
		err_clear(err);
		return 0;
	}
	/* Without locks, as on some shared file systems, nobody can lock it to remove it, either. */
	(void)io->flock(fd, LOCK_EX);
	if (io_is_gone(fd))
		io_close(fd);
	else
		*ret_fd = fd;
	return 0;
}

int survey_scratch_make(const struct survey *s, uint32_t task, char ret[SURVEY_SCRATCH_NAME], int *ret_fd, struct err *err)
{
	enum { TIMES = 10 };
	int r = 0, fd = -1;

	sweep(s->p->scratch);
	if (snprintf(ret, SURVEY_SCRATCH_NAME, "%s/acut-%016" PRIx64 "-stage-%" PRIu32 "-%016" PRIx64, s->p->scratch,
		     work_about(s->work)->id, task, work_attempt_number(s->attempt)) >= SURVEY_SCRATCH_NAME) {
		*ret = 0;
		return err_set(err, ERR_USAGE, "the name of the folder for temporary files is too long");
	}
	for (int i = 0; !r && fd < 0 && i < TIMES; i++)
		r = make_locked(ret, &fd, err);
	if (!r && fd < 0) {
		err_set(err, ERR_IO, "the folder for temporary files was removed");
		r = err_add_file(err, ret);
	}
	*ret_fd = fd;
	return r;
}

void survey_scratch_remove(const char *name)
{
	struct err ignored = ERR_INIT;

	io_folder_remove(AT_FDCWD, name, &ignored);
}
