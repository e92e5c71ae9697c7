/*
 * The profiles of the folders, read once. An invalid file is kept with its fault, so that it can be shown; it matches
 * nothing. Two folders as in systemd: the administrator's file replaces the packaged one of the same name, and an empty
 * file removes it.
 */
#include "profile.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "err.h"
#include "io.h"

enum { ENTRIES_MAX = 1024 };

const char *const profile_folders[] = {PROFILE_SHIPPED, PROFILE_LOCAL, NULL};

struct profile_set {
	struct profile_entry **entries; /* in order of names */
	size_t n;
};

struct profile_entry *profile_entry_free(struct profile_entry *e)
{
	if (e) {
		free(e->text);
		free(e->fault);
		free(e);
	}
	return NULL;
}

struct profile_set *profile_set_free(struct profile_set *s)
{
	for (size_t i = 0; s && i < s->n; i++)
		profile_entry_free(s->entries[i]);
	if (s)
		free(s->entries);
	free(s);
	return NULL;
}

/* "tim" of "/x/tim.conf"; false: not the name of a profile's file, or too long. */
static bool name_of(const char *path, char ret[PROFILE_NAME_SIZE])
{
	const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
	size_t n = strlen(name);

	if (n < 6 || strcmp(name + n - 5, ".conf") || *name == '.' || n - 5 >= PROFILE_NAME_SIZE)
		return false;
	memcpy(ret, name, n - 5);
	ret[n - 5] = '\0';
	return true;
}

/* The file's bytes, zero-terminated; *ret_size 0: empty, or /dev/null. */
static int read_text(const char *path, char **ret, size_t *ret_size, struct err *err)
{
	struct stat st;
	char *text;
	size_t n = 0;
	int fd, rc;

	if ((rc = io_open(AT_FDCWD, path, O_RDONLY | O_NONBLOCK | O_NOCTTY, 0, &fd, err)) < 0)
		return rc;
	if (io->fstat(fd, &st) < 0) {
		rc = err_sys(err, errno, "its state cannot be read");
		err_add_file(err, path);
		io_close(fd);
		return rc;
	}
	text = malloc(PROFILE_FILE_MAX + 2);
	if (!text)
		rc = err_set(err, ERR_NOMEM, "no memory for a profile");
	else if (S_ISREG(st.st_mode))
		rc = io_read_some(fd, text, PROFILE_FILE_MAX + 1, 0, path, &n, err);
	else if (!S_ISCHR(st.st_mode)) /* a link to /dev/null is like an empty file */
		rc = err_set(err, ERR_INPUT, "this is no regular file");
	if (!rc && n > PROFILE_FILE_MAX)
		rc = err_set(err, ERR_INPUT, "more than %d bytes", PROFILE_FILE_MAX);
	io_close(fd);
	if (rc) {
		free(text);
		return err_add_file(err, path);
	}
	text[n] = '\0';
	*ret = text;
	*ret_size = n;
	return 0;
}

/* An entry, with a fault if the file is invalid. *ret NULL: the file is empty. */
static int read_entry(const char *path, const char *name, struct profile_entry **ret, struct err *err)
{
	struct profile_entry *e = calloc(1, sizeof *e);
	struct err bad = ERR_INIT;
	char line[1024];

	if (!e)
		return err_set(err, ERR_NOMEM, "no memory for a profile");
	snprintf(e->path, sizeof e->path, "%s", path);
	snprintf(e->profile.name, sizeof e->profile.name, "%s", name);
	if (!read_text(path, &e->text, &e->size, &bad)) {
		if (!e->size) {
			*ret = profile_entry_free(e);
			return 0;
		}
		profile_parse(e->text, e->size, name, path, &e->profile, &bad);
	}
	if (!strcmp(bad.field, "line")) { /* the message names it */
		bad.offset = ERR_NO_OFFSET;
		bad.field[0] = '\0';
	}
	if (bad.code == ERR_NOMEM || (bad.code && !(e->fault = strdup(err_format(&bad, line, sizeof line))))) {
		profile_entry_free(e);
		return err_set(err, ERR_NOMEM, "no memory for a profile");
	}
	if (e->fault && !e->text && !(e->text = calloc(1, 1))) {
		profile_entry_free(e);
		return err_set(err, ERR_NOMEM, "no memory for a profile");
	}
	*ret = e;
	return 0;
}

int profile_entry_read(const char *path, struct profile_entry **ret, struct err *err)
{
	struct profile_entry *e;
	char name[PROFILE_NAME_SIZE];
	int rc;

	if (!name_of(path, name)) {
		err_set(err, ERR_INPUT, "the name of a profile's file is NAME.conf, NAME at most %d bytes",
			PROFILE_NAME_SIZE - 1);
		return err_add_file(err, path);
	}
	if (!(e = calloc(1, sizeof *e)))
		return err_set(err, ERR_NOMEM, "no memory for a profile");
	snprintf(e->path, sizeof e->path, "%s", path);
	rc = read_text(path, &e->text, &e->size, err);
	if (!rc)
		rc = profile_parse(e->text, e->size, name, path, &e->profile, err);
	if (rc) {
		profile_entry_free(e);
		return rc;
	}
	*ret = e;
	return 0;
}

static size_t place_of(const struct profile_set *s, const char *name, bool *ret_there)
{
	size_t i = 0;

	while (i < s->n && strcmp(s->entries[i]->profile.name, name) < 0)
		i++;
	*ret_there = i < s->n && !strcmp(s->entries[i]->profile.name, name);
	return i;
}

/* Replaces the entry with that name; e NULL: removes it. */
static int put_entry(struct profile_set *s, const char *name, struct profile_entry *e, struct err *err)
{
	bool there;
	size_t at = place_of(s, name, &there);
	struct profile_entry **more;

	if (there) {
		profile_entry_free(s->entries[at]);
		s->entries[at] = e;
		if (!e)
			memmove(s->entries + at, s->entries + at + 1, (--s->n - at) * sizeof *s->entries);
		return 0;
	}
	if (!e)
		return 0;
	if (s->n == ENTRIES_MAX)
		return err_set(err, ERR_LIMIT, "more than %d profiles", ENTRIES_MAX);
	more = realloc(s->entries, (s->n + 1) * sizeof *more);
	if (!more)
		return err_set(err, ERR_NOMEM, "no memory for a profile");
	s->entries = more;
	memmove(more + at + 1, more + at, (s->n++ - at) * sizeof *more);
	more[at] = e;
	return 0;
}

struct walk {
	struct profile_set *set;
	const char *folder;
};

static int each(void *ctx, const struct dirent *d, struct err *err)
{
	struct walk *w = ctx;
	struct profile_entry *e = NULL;
	char name[PROFILE_NAME_SIZE], path[512];
	int rc;

	if (!name_of(d->d_name, name) || (size_t)snprintf(path, sizeof path, "%s/%s", w->folder, d->d_name) >= sizeof path)
		return 0;
	if ((rc = read_entry(path, name, &e, err)) < 0)
		return rc;
	if ((rc = put_entry(w->set, name, e, err)) < 0)
		profile_entry_free(e);
	return rc;
}

int profile_set_read(const char *const *folders, struct profile_set **ret, struct err *err)
{
	struct profile_set *s = calloc(1, sizeof *s);
	struct walk w = {.set = s};
	int rc = 0;

	if (!s)
		return err_set(err, ERR_NOMEM, "no memory for profiles");
	for (folders = folders ? folders : profile_folders; !rc && *folders; folders++) {
		struct stat st;

		w.folder = *folders;
		if (io->fstatat(AT_FDCWD, *folders, &st, 0) < 0 && (errno == ENOENT || errno == ENOTDIR))
			continue;
		if ((rc = io_list(AT_FDCWD, *folders, each, &w, err)) < 0)
			err_add_file(err, *folders);
	}
	if (rc < 0) {
		profile_set_free(s);
		return rc;
	}
	*ret = s;
	return 0;
}

size_t profile_set_count(const struct profile_set *s)
{
	return s->n;
}

const struct profile_entry *profile_set_at(const struct profile_set *s, size_t i)
{
	return i < s->n ? s->entries[i] : NULL;
}

const struct profile_entry *profile_set_find(const struct profile_set *s, const char *name)
{
	bool there;
	size_t at = place_of(s, name, &there);

	return there ? s->entries[at] : NULL;
}
