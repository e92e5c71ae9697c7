/*
 * Words of the command line to inputs. A folder stands for the survey files in it and below, in byte order of their paths, an
 * archive for its survey files (ctl_archive.c), "@FILE" for the names in it, one a line, "-" for standard input. A file that
 * is named is taken whatever its extension.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "ctl_input_priv.h"
#include "io.h"

#define DEPTH 64

struct ctl_inputs ctl_inputs_of(struct session *session, const struct ctl_input_options *opt)
{
	return (struct ctl_inputs){.session = session, .opt = opt, .format = opt->format};
}

int ctl_input_append(struct ctl_inputs *in, const struct ctl_input *like, const char *name, struct err *err)
{
	char *copy = strdup(name);

	if (in->n == in->room) {
		size_t room = in->room ? 2 * in->room : 16;
		void *grown = realloc(in->input, room * sizeof(*in->input));

		if (grown) {
			in->input = grown;
			in->room = room;
		}
	}
	if (!copy || in->n == in->room) {
		free(copy);
		return err_set(err, ERR_NOMEM, "no memory for a list of inputs");
	}
	in->input[in->n] = *like;
	in->input[in->n++].name = copy;
	return 0;
}

static int open_failed(const char *name, struct err *err)
{
	int sys = errno;

	if (sys == ENOENT || sys == ENOTDIR || sys == ELOOP || sys == ENAMETOOLONG)
		err_set(err, ERR_INPUT, "it cannot be opened: %s", strerror(sys));
	else
		err_sys(err, sys, "it cannot be opened");
	return err_add_file(err, name);
}

static int by_name(const struct dirent **a, const struct dirent **b)
{
	return strcmp((*a)->d_name, (*b)->d_name);
}

int ctl_inputs_add(struct ctl_inputs *in, const struct ctl_input *file, bool from_folder, struct err *err)
{
	bool is = false;
	int r = ctl_archive_add(in, file, from_folder, &is, err);

	return r || is ? r : ctl_input_append(in, file, file->name, err);
}

static int add_file(struct ctl_inputs *in, const char *name, bool from_folder, struct err *err)
{
	return ctl_inputs_add(in, &(struct ctl_input){.name = (char *)name, .fd = -1}, from_folder, err);
}

static int add_folder(struct ctl_inputs *in, const char *path, unsigned depth, struct err *err)
{
	struct dirent **entry;
	int n = scandir(path, &entry, NULL, by_name), r = 0;

	if (n < 0)
		return open_failed(path, err);
	for (int i = 0; i < n; i++) {
		char *name = NULL;
		struct stat st;

		if (!r && entry[i]->d_name[0] != '.') {
			size_t len = strlen(path);
			if (asprintf(&name, "%s%s%s", path, len && path[len - 1] == '/' ? "" : "/", entry[i]->d_name) < 0)
				r = err_set(err, ERR_NOMEM, "no memory for a file name");
		}
		if (!r && name && !lstat(name, &st)) {
			if (S_ISDIR(st.st_mode) && depth < DEPTH)
				r = add_folder(in, name, depth + 1, err);
			else if ((ctl_input_is_survey(name, strlen(name)) || ctl_archive_named(name)) && !stat(name, &st) &&
				 S_ISREG(st.st_mode))
				r = add_file(in, name, true, err);
		}
		free(name);
		free(entry[i]);
	}
	free(entry);
	return r;
}

static int add_list(struct ctl_inputs *, const char *path, struct err *);

/* Standard input, or a named pipe: read by the daemon through a pipe of its own (ctl_pipe.c). */
static int add_pipe(struct ctl_inputs *in, const char *name, int fd, struct err *err)
{
	if (fd < 0)
		return open_failed(name, err);
	if (in->no_pipes) {
		err_set(err, ERR_USAGE, "%s", in->no_pipes);
		err_add_file(err, name);
	} else if (!ctl_input_append(in, &(struct ctl_input){.fd = fd}, name, err)) {
		return 0;
	}
	close(fd);
	return -(int)err->code;
}

/* Its name is that of --name. */
static int add_standard(struct ctl_inputs *in, struct err *err)
{
	const char *name = in->opt->name;
	int r = add_pipe(in, name ? name : "standard input", dup(STDIN_FILENO), err);

	if (!r)
		in->input[in->n - 1].anonymous = !name;
	return r;
}

static int add_word(struct ctl_inputs *in, const char *word, bool listed, struct err *err)
{
	char endings[64];
	struct stat st;

	if (!listed && word[0] == '@' && word[1])
		return add_list(in, word + 1, err);
	if (in->lines)
		return ctl_inputs_add_lines(in, word, in->lines, err);
	if (!listed && !strcmp(word, "-"))
		return add_standard(in, err);
	if (!stat(word, &st) && S_ISDIR(st.st_mode)) {
		size_t before = in->n;
		int r = add_folder(in, word, 0, err);
		if (!r && in->n == before) {
			err_set(err, ERR_INPUT, "the folder holds no survey files");
			err_add_file(err, word);
			return err_add_hint(
				err, "files ending in %s, packed by gzip or not, and .zip are taken from folders; name others",
				ctl_input_endings(endings, sizeof(endings)));
		}
		return r;
	}
	if (!stat(word, &st) && S_ISFIFO(st.st_mode))
		/* without waiting for a writer: waiting for the daemon can be interrupted */
		return add_pipe(in, word, open(word, O_RDONLY | O_CLOEXEC | O_NONBLOCK), err);
	return add_file(in, word, false, err);
}

static int add_list(struct ctl_inputs *in, const char *path, struct err *err)
{
	FILE *f = strcmp(path, "-") ? fopen(path, "re") : stdin;
	char *line = NULL;
	size_t room = 0;
	ssize_t n;
	int r = 0;

	if (!f)
		return open_failed(path, err);
	while (!r && (n = getline(&line, &room, f)) >= 0) {
		while (n && (line[n - 1] == '\n' || line[n - 1] == '\r'))
			line[--n] = 0;
		if (n)
			r = add_word(in, line, true, err);
	}
	if (!r && ferror(f)) {
		err_sys(err, errno, "the list cannot be read");
		r = err_add_file(err, path);
	}
	free(line);
	if (f != stdin)
		fclose(f);
	return r;
}

/* The format of pipes is given, or seen where there is one input: it is that of all inputs. LAS and LAZ begin alike. */
static int know_pipes(struct ctl_inputs *in, struct err *err)
{
	struct ctl_input *pipe = NULL;

	for (size_t i = 0; i < in->n && !pipe; i++)
		pipe = in->input[i].fd >= 0 ? &in->input[i] : NULL;
	if (!pipe || in->format)
		return 0;
	if (in->n == 1 && ctl_pipe_peek(in, pipe, err))
		return -(int)err->code;
	if (pipe->nhead >= 4 && !memcmp(pipe->head, "LASF", 4)) {
		in->format = "las";
		return 0;
	}
	if (pipe->nhead >= 4 && ctl_pipe_check(in, pipe, err))
		return -(int)err->code;
	err_set(err, ERR_USAGE,
		in->n == 1 ? "the format of %s is unknown: it does not begin as LAS and LAZ do" :
			     "the format of %s is unknown, beside other inputs",
		pipe->name);
	return err_add_hint(err, "name it with --input-format, as in --input-format xyz");
}

/* --name is of one input. A file is known by its path, so the same one pushed again is known by any name. */
static int name_one(struct ctl_inputs *in, struct err *err)
{
	const char *name = in->opt->name;

	if (!name)
		return 0;
	if (in->n == 1) {
		in->input[0].label = name;
		return 0;
	}
	for (size_t i = 0; i < in->n; i++)
		if (in->input[i].fd >= 0 && !strcmp(in->input[i].name, name))
			return 0; /* of standard input, among others */
	err_set(err, ERR_USAGE, "--name is the name of one input, and there are %zu, from %s to %s", in->n, in->input[0].name,
		in->input[in->n - 1].name);
	return err_add_hint(err, "push them one by one, or without --name");
}

int ctl_inputs_gather(struct ctl_inputs *ret, char **word, unsigned nword, struct err *err)
{
	int r = 0;

	for (unsigned i = 0; i < nword && !r; i++)
		r = add_word(ret, word[i], false, err);
	if (!r && !ret->n)
		r = err_set(err, ERR_USAGE, "no inputs: the lists are empty");
	if (!r)
		r = name_one(ret, err);
	if (!r)
		r = know_pipes(ret, err);
	if (!r && ret->opt->manifest)
		r = ctl_manifest_check(ret, err);
	if (r)
		ctl_inputs_done(ret);
	return r;
}

static bool same_time(struct timespec a, struct timespec b)
{
	return a.tv_sec == b.tv_sec && a.tv_nsec == b.tv_nsec;
}

void ctl_input_see(struct ctl_input *in, const struct stat *st)
{
	in->dev = st->st_dev;
	in->ino = st->st_ino;
	in->size = st->st_size;
	in->mtime = st->st_mtim;
	in->ctime = st->st_ctim;
}

bool ctl_input_same(const struct ctl_input *in, const struct stat *st)
{
	return S_ISREG(st->st_mode) && st->st_dev == in->dev && st->st_ino == in->ino && st->st_size == in->size &&
	       same_time(st->st_mtim, in->mtime);
}

bool ctl_input_unchanged(const struct ctl_input *in, const struct stat *st)
{
	return ctl_input_same(in, st) && same_time(st->st_ctim, in->ctime);
}

/* The folder may have changed since: the file that was seen is opened, or none. */
static int open_entry(const struct ctl_input *in, int *ret_fd, struct err *err)
{
	int fd = openat(in->dirfd, in->entry, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY | O_NOFOLLOW);
	struct stat st;

	if (fd < 0 && errno != ENOENT && errno != ELOOP && errno != ENXIO)
		return open_failed(in->name, err);
	if (fd >= 0 && !fstat(fd, &st) && ctl_input_unchanged(in, &st)) {
		*ret_fd = fd;
		return 0;
	}
	if (fd >= 0)
		close(fd);
	err_set(err, ERR_CHANGED, fd < 0 ? "it is not there any more" : "it has changed since it was examined");
	return err_add_file(err, in->name);
}

int ctl_input_open_file(const char *name, int *ret_fd, struct err *err)
{
	int fd = open(name, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);

	if (fd < 0)
		return open_failed(name, err);
	*ret_fd = fd;
	return 0;
}

int ctl_input_open(struct ctl_inputs *inputs, struct ctl_input *in, int *ret_fd, struct err *err)
{
	struct stat st;
	int fd = -1;

	if ((in->archive && ctl_archive_keep(inputs, in, err)) || (in->lines && ctl_lines_keep(inputs, in, err)))
		return -(int)err->code;
	if (in->entry)
		return open_entry(in, ret_fd, err);
	if (in->kept)
		fd = fcntl(in->kept, F_DUPFD_CLOEXEC, 3);
	else if (in->fd < 0 && ctl_input_open_file(in->name, &fd, err)) /* the daemon reads pipes itself */
		return -(int)err->code;
	if (fd < 0 && in->fd < 0)
		return open_failed(in->name, err);
	if (in->verified && !in->archive && (fstat(fd, &st) || !ctl_input_same(in, &st))) {
		close(fd);
		err_set(err, ERR_CHANGED, "it is another file than the one that was verified");
		err_add_hint(err, "push it again when no program writes to it");
		return err_add_file(err, in->name);
	}
	*ret_fd = fd;
	return 0;
}

/* Removes "." and empty parts; ".." may lead through a link and stays. */
static void tidy(char *path)
{
	char *to = path, *from = path;

	while (*from) {
		size_t n;

		while (*from == '/')
			from++;
		n = strcspn(from, "/");
		if (n && !(n == 1 && *from == '.')) {
			*to++ = '/';
			memmove(to, from, n);
			to += n;
		}
		from += n;
	}
	*to = 0;
}

const char *ctl_input_path(const struct ctl_input *in, char *buf, size_t size)
{
	char *here = in->path || in->name[0] == '/' ? NULL : get_current_dir_name();
	int n = -1;

	if (in->path || in->archive)
		return in->path;
	if (in->kept && in->anonymous)
		n = snprintf(buf, size, "/dev/stdin/%llu", (unsigned long long)clock_real_us());
	else if (in->kept && !in->lines)
		n = snprintf(buf, size, "/dev/stdin/%s", in->name);
	else if (in->fd < 0 && (here || in->name[0] == '/'))
		n = snprintf(buf, size, "%s/%s", here ? here : "", in->name);
	free(here);
	if (n < 0 || (size_t)n >= size)
		return NULL;
	tidy(buf);
	return buf;
}

void ctl_inputs_done(struct ctl_inputs *in)
{
	for (size_t i = 0; i < in->n; i++) {
		ctl_pipe_stop(&in->input[i]);
		free(in->input[i].name);
		free(in->input[i].head);
		io_close(in->input[i].fd);
		if (in->input[i].kept)
			io_close(in->input[i].kept);
	}
	free(in->input);
	ctl_archive_free(in);
	in->input = NULL;
	in->n = in->room = 0;
}

int ctl_inputs_not_outputs(const struct ctl_inputs *in, const char *const *output, struct err *err)
{
	for (; *output; output++) {
		struct stat out, st;

		if (!strcmp(*output, "-") ? fstat(STDOUT_FILENO, &out) : stat(*output, &out))
			continue;
		if (!S_ISREG(out.st_mode))
			continue;
		for (size_t i = 0; i < in->n; i++) {
			const struct ctl_input *file = in->input[i].archive ? &in->input[i].archive->file : &in->input[i];

			if (file->fd >= 0 || stat(file->name, &st))
				continue;
			if (st.st_dev == out.st_dev && st.st_ino == out.st_ino) {
				err_set(err, ERR_USAGE, "the output is one of the inputs");
				return err_add_file(err, file->name);
			}
		}
	}
	return 0;
}
