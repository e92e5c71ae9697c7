/*
 * Words of the command line to inputs. A folder stands for the survey files in it and below, in byte order of
 * their paths, an archive for those in it (ctl_archive.c); "@FILE" for the names in it, one a line; "-" for standard input. A
 * file that is named is never judged by its extension.
 */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "ctl.h"
#include "ctl_archive.h"

/* What a folder is searched for. Files of a kind that this version cannot read are in the list too: the
 * daemon refuses them by name, so that nothing is left out in silence. */
static const char *const extension[] = {".las", ".laz", ".ptx", ".xyz", ".pts"};

#define DEPTH 64

bool ctl_input_is_survey(const char *name, size_t n)
{
	for (size_t i = 0; i < sizeof(extension) / sizeof(*extension); i++) {
		size_t m = strlen(extension[i]);

		if (n > m && name[n - m - 1] != '/' && !strncasecmp(name + n - m, extension[i], m))
			return true;
	}
	return false;
}

int ctl_input_add(struct ctl_inputs *in, const char *name, int fd, struct err *err)
{
	if (in->n == in->room) {
		size_t room = in->room ? 2 * in->room : 16;
		void *grown = realloc(in->input, room * sizeof(*in->input));
		if (!grown)
			return err_set(err, ERR_NOMEM, "no memory for a list of inputs");
		in->input = grown;
		in->room = room;
	}
	in->input[in->n] = (struct ctl_input){.name = strdup(name), .fd = fd};
	if (!in->input[in->n].name)
		return err_set(err, ERR_NOMEM, "no memory for a list of inputs");
	in->n++;
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

/* A file that is named, or one of a folder: an archive's members, else itself. */
static int add_file(struct program *ctl, struct ctl_inputs *in, const char *name, bool from_folder, struct err *err)
{
	bool is = false;
	int r = ctl_archive_add(ctl, in, &(struct ctl_input){.name = (char *)name, .fd = -1}, from_folder, &is, err);

	return r || is ? r : ctl_input_add(in, name, -1, err);
}

static int add_folder(struct program *ctl, struct ctl_inputs *in, const char *path, unsigned depth, struct err *err)
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
				r = add_folder(ctl, in, name, depth + 1, err);
			else if ((ctl_input_is_survey(name, strlen(name)) || ctl_archive_named(name)) && !stat(name, &st) &&
				 S_ISREG(st.st_mode))
				r = add_file(ctl, in, name, true, err);
		}
		free(name);
		free(entry[i]);
	}
	free(entry);
	return r;
}

static int add_list(struct program *, struct ctl_inputs *, const char *path, struct err *);

/* Standard input, or a named pipe: read by the daemon through a pipe of its own (ctl_pipe.c). */
static int add_pipe(struct program *ctl, struct ctl_inputs *in, const char *name, int fd, struct err *err)
{
	if (fd < 0)
		return open_failed(name, err);
	if (!ctl_input_add(in, name, fd, err))
		return 0;
	close(fd);
	return -(int)err->code;
}

/* Named by --name, or by nobody. */
static int add_standard(struct program *ctl, struct ctl_inputs *in, struct err *err)
{
	const char *name = ctl->args.name;
	int r = add_pipe(ctl, in, name ? name : "standard input", dup(STDIN_FILENO), err);

	if (!r)
		in->input[in->n - 1].anonymous = !name;
	return r;
}

static int add_word(struct program *ctl, struct ctl_inputs *in, const char *word, bool listed, struct err *err)
{
	struct stat st;

	if (!listed && !strcmp(word, "-"))
		return add_standard(ctl, in, err);
	if (!listed && word[0] == '@' && word[1])
		return add_list(ctl, in, word + 1, err);
	if (!stat(word, &st) && S_ISDIR(st.st_mode)) {
		size_t before = in->n;
		int r = add_folder(ctl, in, word, 0, err);
		if (!r && in->n == before) {
			err_set(err, ERR_INPUT, "the folder holds no survey files");
			err_add_file(err, word);
			return err_add_hint(err, "files ending in " CTL_INPUT_ENDINGS
						 ", packed by gzip or not, and .zip are taken from folders; name others");
		}
		return r;
	}
	if (!stat(word, &st) && S_ISFIFO(st.st_mode))
		/* not waiting for a writer: whoever waits for the daemon can be interrupted */
		return add_pipe(ctl, in, word, open(word, O_RDONLY | O_CLOEXEC | O_NONBLOCK), err);
	return add_file(ctl, in, word, false, err);
}

static int add_list(struct program *ctl, struct ctl_inputs *in, const char *path, struct err *err)
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
			r = add_word(ctl, in, line, true, err);
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

/* What pipes hold is said, or seen where there is one input: a format is that of all of them. LAS and LAZ begin alike. */
static int know_pipes(struct program *ctl, struct ctl_inputs *in, struct err *err)
{
	struct ctl_input *pipe = NULL;

	for (size_t i = 0; i < in->n && !pipe; i++)
		pipe = in->input[i].fd >= 0 ? &in->input[i] : NULL;
	if (!pipe || ctl->args.input_format)
		return 0;
	if (in->n == 1 && ctl_pipe_look(ctl, pipe, err))
		return -(int)err->code;
	if (pipe->nhead >= 4 && !memcmp(pipe->head, "LASF", 4)) {
		ctl->args.input_format = "las";
		return 0;
	}
	if (pipe->nhead >= 4 && ctl_pipe_check(ctl, pipe, err))
		return -(int)err->code;
	err_set(err, ERR_USAGE,
		in->n == 1 ? "what %s holds is not known: it does not begin as LAS and LAZ do" :
			     "what %s holds is not known, beside other inputs",
		pipe->name);
	return err_add_hint(err, "say it with --input-format, as in --input-format xyz");
}

/* --name: of the one input. Who it is stays its path, so the same file pushed again is known by any name. */
static int name_one(const struct ctl_args *a, struct ctl_inputs *in, struct err *err)
{
	if (!a->name)
		return 0;
	if (in->n == 1) {
		in->input[0].label = a->name;
		return 0;
	}
	for (size_t i = 0; i < in->n; i++)
		if (in->input[i].fd >= 0 && !strcmp(in->input[i].name, a->name))
			return 0; /* of standard input, among others */
	err_set(err, ERR_USAGE, "--name is the name of one input, and there are %zu, from %s to %s", in->n, in->input[0].name,
		in->input[in->n - 1].name);
	return err_add_hint(err, "push them one by one, or without --name");
}

int ctl_input_gather(struct program *ctl, char **word, unsigned nword, struct ctl_inputs *ret, struct err *err)
{
	int r = 0;

	*ret = (struct ctl_inputs){0};
	for (unsigned i = 0; i < nword && !r; i++)
		r = add_word(ctl, ret, word[i], false, err);
	if (!r && !ret->n)
		r = err_set(err, ERR_USAGE, "no inputs: the lists are empty");
	if (!r)
		r = name_one(&ctl->args, ret, err);
	if (!r)
		r = know_pipes(ctl, ret, err);
	if (!r && ctl->args.manifest)
		r = ctl_manifest_check(ctl, ret, err);
	if (r)
		ctl_input_done(ret);
	return r;
}

static bool still_verified(const struct ctl_input *in, int fd)
{
	struct stat st;

	return !fstat(fd, &st) && st.st_dev == in->dev && st.st_ino == in->ino && st.st_size == in->size &&
	       st.st_mtim.tv_sec == in->mtime.tv_sec && st.st_mtim.tv_nsec == in->mtime.tv_nsec;
}

static bool same_time(struct timespec a, struct timespec b)
{
	return a.tv_sec == b.tv_sec && a.tv_nsec == b.tv_nsec;
}

bool ctl_input_unchanged(const struct ctl_input *in, const struct stat *st)
{
	return S_ISREG(st->st_mode) && st->st_dev == in->dev && st->st_ino == in->ino && st->st_size == in->size &&
	       same_time(st->st_mtim, in->mtime) && same_time(st->st_ctim, in->ctime);
}

/* Whoever fills the folder may have put anything there since: what is opened is what was seen, or nothing. */
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
	err_set(err, ERR_CHANGED, fd < 0 ? "it is not there any more" : "it has changed since it was looked at");
	return err_add_file(err, in->name);
}

int ctl_input_open(struct program *ctl, struct ctl_input *in, int *ret_fd, struct err *err)
{
	if (in->archive && ctl_archive_keep(ctl, in, err))
		return -(int)err->code;
	if (in->entry)
		return open_entry(in, ret_fd, err);
	/* what comes through a pipe the daemon has already */
	int fd = in->kept    ? fcntl(in->kept, F_DUPFD_CLOEXEC, 3) :
		 in->fd >= 0 ? -1 :
			       open(in->name, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);

	if (fd < 0 && in->fd < 0)
		return open_failed(in->name, err);
	if (in->verified && !in->archive && !still_verified(in, fd)) {
		close(fd);
		err_set(err, ERR_CHANGED, "it is another file than the one that was verified");
		err_add_hint(err, "push it again when nobody writes to it");
		return err_add_file(err, in->name);
	}
	*ret_fd = fd;
	return 0;
}

void ctl_input_close(const struct ctl_input *in, int fd)
{
	if (fd >= 0)
		close(fd);
}

/* "." and empty parts go; ".." may lead through a link, so it stays where it stands. */
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
	else if (in->kept)
		n = snprintf(buf, size, "/dev/stdin/%s", in->name);
	else if (in->fd < 0 && (here || in->name[0] == '/'))
		n = snprintf(buf, size, "%s/%s", here ? here : "", in->name);
	free(here);
	if (n < 0 || (size_t)n >= size)
		return NULL;
	tidy(buf);
	return buf;
}

void ctl_input_done(struct ctl_inputs *in)
{
	for (size_t i = 0; i < in->n; i++) {
		ctl_pipe_stop(&in->input[i]);
		free(in->input[i].name);
		free(in->input[i].head);
		if (in->input[i].fd >= 0)
			close(in->input[i].fd);
		if (in->input[i].kept)
			close(in->input[i].kept);
	}
	free(in->input);
	ctl_archive_free(in);
	*in = (struct ctl_inputs){0};
}

int ctl_input_not_output(const struct ctl_inputs *in, const struct ctl_args *a, struct err *err)
{
	for (unsigned o = 0; o < a->out.n; o++) {
		struct stat out, st;

		if (!strcmp(a->out.text[o], "-") ? fstat(STDOUT_FILENO, &out) : stat(a->out.text[o], &out))
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
