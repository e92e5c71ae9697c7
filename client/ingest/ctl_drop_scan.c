/*
 * The regular files of a drop folder, by name, and since when each is unchanged.
 *
 * A file that has changed since the last scan is like a new one. Names of files that are still being written, folders and
 * links are skipped. ctl_ingest.c decides whether a file has settled.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "ctl_drop.h"
#include "term.h"

static bool ends(const char *name, const char *end)
{
	size_t n = strlen(name), m = strlen(end);

	return n >= m && !strcmp(name + n - m, end);
}

/* Names of what is still being written, by common use. */
static bool is_ours(const char *name)
{
	return name[0] != '.' && !ends(name, ".part") && !ends(name, ".tmp") && !ends(name, "~");
}

static int by_name(const void *a, const void *b)
{
	return strcmp(((const struct ctl_drop_file *)a)->entry, ((const struct ctl_drop_file *)b)->entry);
}

static void file_done(struct ctl_drop_file *f)
{
	free(f->in.name);
	free(f->entry);
	free(f->path);
}

static void see(struct ctl_drop_file *f, const struct stat *st)
{
	ctl_input_see(&f->in, st);
	f->since = clock_mono_ns();
	f->tried = f->hashed = f->taken = false;
	f->bad = 0;
}

static int add(const struct ctl_drop *d, struct ctl_drop_list *l, const char *name, const struct stat *st, struct err *err)
{
	struct ctl_drop_file f = {.there = true, .in = {.fd = -1, .dirfd = d->fd}};
	size_t slash = strlen(d->path);

	if (l->n == l->room) {
		size_t room = l->room ? 2 * l->room : 64;
		void *grown = realloc(l->file, room * sizeof(*l->file));

		if (!grown)
			return err_set(err, ERR_NOMEM, "no memory for a list of files");
		l->file = grown;
		l->room = room;
	}
	f.entry = strdup(name);
	f.in.name = term_safe(name);
	while (slash > 1 && d->path[slash - 1] == '/')
		slash--;
	if (asprintf(&f.path, "%.*s/%s", (int)slash, d->path, name) < 0)
		f.path = NULL;
	if (!f.entry || !f.in.name || !f.path) {
		file_done(&f);
		return err_set(err, ERR_NOMEM, "no memory for a file name");
	}
	f.in.entry = f.entry;
	f.in.path = f.path;
	see(&f, st);
	l->file[l->n++] = f;
	return 0;
}

struct looking {
	const struct ctl_drop *drop;
	struct ctl_drop_list *list;
	size_t known; /* files that were there before, by name */
};

static int look_at(struct looking *l, const char *name, struct err *err)
{
	struct ctl_drop_file key = {.entry = (char *)name}, *f;
	struct stat st;

	if (!is_ours(name) || fstatat(l->drop->fd, name, &st, AT_SYMLINK_NOFOLLOW))
		return 0;
	if (!S_ISREG(st.st_mode)) {
		l->list->passed_by += !S_ISDIR(st.st_mode);
		return 0;
	}
	f = l->known ? bsearch(&key, l->list->file, l->known, sizeof(*f), by_name) : NULL;
	if (!f)
		return add(l->drop, l->list, name, &st, err);
	f->there = true;
	if (!ctl_input_unchanged(&f->in, &st))
		see(f, &st);
	return 0;
}

int ctl_drop_scan(const struct ctl_drop *d, struct ctl_drop_list *list, struct err *err)
{
	struct looking l = {d, list, list->n};
	int fd = openat(d->fd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC), r = 0, sys;
	DIR *dir = fd < 0 ? NULL : fdopendir(fd);
	const struct dirent *e;
	size_t kept = 0;

	if (!dir) {
		err_sys(err, errno, "the folder cannot be read");
		if (fd >= 0)
			close(fd);
		return err_add_file(err, d->name);
	}
	list->passed_by = 0;
	list->scanned_ns = clock_mono_ns();
	for (size_t i = 0; i < list->n; i++)
		list->file[i].there = false;
	while (errno = 0, !r && (e = readdir(dir)))
		r = look_at(&l, e->d_name, err);
	sys = errno;
	closedir(dir);
	if (!r && sys) {
		err_sys(err, sys, "the folder cannot be read");
		r = err_add_file(err, d->name);
	}
	for (size_t i = 0; i < list->n; i++) {
		if (list->file[i].there)
			list->file[kept++] = list->file[i];
		else
			file_done(&list->file[i]);
	}
	list->n = kept;
	if (list->n)
		qsort(list->file, list->n, sizeof(*list->file), by_name);
	return r;
}

void ctl_drop_list_done(struct ctl_drop_list *list)
{
	for (size_t i = 0; i < list->n; i++)
		file_done(&list->file[i]);
	free(list->file);
	*list = (struct ctl_drop_list){0};
}
