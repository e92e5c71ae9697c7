/* A work folder: what is in it from the beginning, and waiting for files that other nodes wrote. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <time.h>

#include "clock.h"
#include "err.h"
#include "io.h"
#include "parse.h"
#include "work_priv.h"

#define PATIENCE 120.0 /* seconds */

static const char *const phase_text[WORK_PHASES] = {"head", "stage", "sort", "commit", "plan", "mesh", "sum", "gather", "finish"};
const char *const work_folders[] = {"done", "failed", "log", WORK_IN_DATASET, WORK_IN_MESH, NULL};

const char *work_phase_text(enum work_phase phase)
{
	return phase_text[phase];
}

bool work_phase_parse(const char *text, enum work_phase *ret)
{
	for (unsigned i = 0; i < WORK_PHASES; i++)
		if (!strcmp(text, phase_text[i])) {
			*ret = (enum work_phase)i;
			return true;
		}
	return false;
}

uint64_t work_random(void)
{
	uint64_t n = 0;

	while (!n)
		if (getrandom(&n, sizeof n, 0) != (ssize_t)sizeof n)
			n = (uint64_t)clock_real_us() * 0x9e3779b97f4a7c15u ^ clock_mono_ns();
	return n;
}

/* ---- patience ---- */

bool work_passing(int sys)
{
	return sys == ENOENT || sys == ESTALE;
}

bool work_wait(const struct work *w, double *waited)
{
	double seconds = *waited < 0.5 ? 0.05 : *waited < 5 ? 0.5 : 2;
	struct timespec t = {.tv_sec = (time_t)seconds, .tv_nsec = (long)((seconds - (double)(time_t)seconds) * 1e9)};

	if (*waited >= w->patience || work_interrupted((void *)w))
		return false;
	nanosleep(&t, NULL);
	*waited += seconds;
	return true;
}

void work_set_interrupt(struct work *w, int (*interrupted)(void *ctx), void *ctx)
{
	w->interrupted = interrupted;
	w->interrupted_ctx = ctx;
}

int work_interrupted(void *work)
{
	const struct work *w = work;

	return w->interrupted ? w->interrupted(w->interrupted_ctx) : 0;
}

int work_check_interrupt(struct work *w, struct err *err)
{
	return work_interrupted(w) ? err_set(err, ERR_CANCELLED, "the task was interrupted") : 0;
}

void work_set_patience(struct work *w, double seconds)
{
	w->patience = seconds;
}

int work_file_open(const struct work *w, const char *name, uint64_t size, int *ret_fd, struct err *err)
{
	double waited = 0;
	struct stat st;

	for (;;) {
		/* An input may have become a pipe: who opens it finds out, and does not wait for a writer. */
		int fd = io->openat(w->fd, name, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY, 0);
		bool asked = fd >= 0 && io->fstat(fd, &st) == 0;
		int sys = errno;

		if (asked && (size == UINT64_MAX || (uint64_t)st.st_size >= size)) {
			if (size == UINT64_MAX || (uint64_t)st.st_size == size) {
				*ret_fd = fd;
				return 0;
			}
			io_close(fd);
			err_set(err, ERR_CORRUPT, "it has %lld bytes, its record says %llu", (long long)st.st_size,
				(unsigned long long)size);
			return err_add_file(err, name);
		}
		io_close(fd);
		if (!asked && !work_passing(sys))
			return err_sys(err, sys, "cannot open %s", name);
		if (work_wait(w, &waited))
			continue;
		if (asked)
			err_set(err, ERR_CORRUPT, "it has %lld bytes, its record says %llu", (long long)st.st_size,
				(unsigned long long)size);
		else
			err_sys(err, sys, "cannot open it, after %.0f seconds", waited);
		return err_add_file(err, name);
	}
}

/* ---- the folder ---- */

const char *work_folder(const struct work *w)
{
	return w->folder;
}

int work_fd(const struct work *w)
{
	return w->fd;
}

const struct work_about *work_about(const struct work *w)
{
	return &w->about;
}

struct work *work_close(struct work *w)
{
	if (!w)
		return NULL;
	io_close(w->fd);
	free((void *)w->about.word);
	free(w->text);
	free(w->path);
	free(w->folder);
	free(w);
	return NULL;
}

static struct work *work_new(const char *folder)
{
	const char *patience = getenv("ACUT_CLUSTER_PATIENCE");
	struct work *w = calloc(1, sizeof *w);

	if (!w)
		return NULL;
	w->fd = -1;
	w->patience = PATIENCE;
	if (patience && !parse_double(patience, &w->patience))
		w->patience = PATIENCE;
	w->folder = strdup(folder);
	return w->folder ? w : work_close(w);
}

static int write_about(const struct work *w, const struct work_about *a, struct err *err)
{
	struct work_out o;
	char text[64];
	int r = work_out_begin(&o, WORK_ABOUT, err);

	if (r)
		return r;
	snprintf(text, sizeof text, "%016" PRIx64, a->id);
	work_out_line(&o, "id", text);
	snprintf(text, sizeof text, "%" PRIu64, a->memory);
	work_out_line(&o, "memory", text);
	for (unsigned i = 0; i < WORK_PHASES; i++) {
		snprintf(text, sizeof text, "%" PRIu32 " %s", a->tasks[i], phase_text[i]);
		work_out_line(&o, "tasks", text);
	}
	if (a->kernel)
		work_out_line(&o, "kernel", a->kernel);
	for (size_t i = 0; i < a->nword; i++)
		work_out_line(&o, "word", a->word[i]);
	r = work_out_end(&o, err);
	if (!r)
		r = work_write_new(w, WORK_ABOUT, o.bytes, o.size, err);
	work_out_done(&o);
	return r;
}

static int write_inputs(const struct work *w, const struct work_input *input, size_t n, struct err *err)
{
	struct work_out o;
	int r = work_out_begin(&o, WORK_INPUTS, err);

	for (size_t i = 0; !r && i < n; i++) {
		char head[64];

		snprintf(head, sizeof head, "input %" PRIu64 " %" PRIu64, input[i].size, (uint64_t)input[i].mtime_ns);
		work_out_line(&o, head, input[i].path);
	}
	if (!r)
		r = work_out_end(&o, err);
	if (!r)
		r = work_write_new(w, WORK_INPUTS, o.bytes, o.size, err);
	work_out_done(&o);
	return r;
}

static int seen_entry(void *ctx, const struct dirent *e, struct err *err)
{
	(void)e;
	(void)err;
	*(bool *)ctx = true;
	return 0;
}

struct looking {
	const struct work *work;
	bool any;
};

/* Empty folders of a run are what a command left that was killed before the run was made. */
static int look_entry(void *ctx, const struct dirent *e, struct err *err)
{
	struct looking *l = ctx;

	for (const char *const *f = work_folders; *f; f++)
		if (!strcmp(*f, e->d_name))
			return io_list(l->work->fd, e->d_name, seen_entry, &l->any, err);
	l->any = true;
	return 0;
}

static int check_empty(const struct work *w, struct err *err)
{
	struct looking l = {w, false};
	struct stat st;
	int r;

	if (io->fstatat(w->fd, WORK_ABOUT, &st, AT_SYMLINK_NOFOLLOW) == 0) {
		err_set(err, ERR_CONFLICT, "it is the work folder of another run");
		err_add_hint(err, "continue that run with 'acut-cluster resume', or remove it with 'acut-cluster clean'");
		return err_add_file(err, w->folder);
	}
	r = io_list(w->fd, ".", look_entry, &l, err);
	if (r || !l.any)
		return r;
	err_set(err, ERR_CONFLICT, "the folder is not empty");
	if (io->fstatat(w->fd, WORK_INPUTS, &st, AT_SYMLINK_NOFOLLOW) == 0)
		err_add_hint(err, "if a command was killed that made a run here: remove the file " WORK_INPUTS);
	else
		err_add_hint(err, "name a new or an empty folder");
	return err_add_file(err, w->folder);
}

static bool is_link(const char *folder)
{
	char *name = strdup(folder);
	size_t n = name ? strlen(name) : 0;
	struct stat st;
	bool is;

	/* With a slash at the end it would be the folder behind the link. */
	while (n > 1 && name[n - 1] == '/')
		name[--n] = 0;
	is = name && lstat(name, &st) == 0 && S_ISLNK(st.st_mode);
	free(name);
	return is;
}

/* Its path is of now: the current folder may be another one later. */
static int open_folder(struct work *w, struct err *err)
{
	int r = io_open(AT_FDCWD, w->folder, O_RDONLY | O_DIRECTORY, 0, &w->fd, err);

	if (r && (err->sys == ENOENT || err->sys == ENOTDIR)) {
		err_clear(err);
		r = err_set(err, ERR_NOTFOUND, "there is no such folder");
	}
	if (r)
		return err_add_file(err, w->folder);
	w->path = realpath(w->folder, NULL);
	w->linked = is_link(w->folder);
	return 0;
}

/* What a failure has made goes, so that the command can be repeated. Folders that have something stay. */
static void unmake(const struct work *w, bool wrote, bool was_there)
{
	if (wrote)
		io->unlinkat(w->fd, WORK_INPUTS, 0);
	for (size_t i = 0; work_folders[i]; i++)
		io->unlinkat(w->fd, work_folders[i], AT_REMOVEDIR);
	if (!was_there)
		io->unlinkat(AT_FDCWD, w->folder, AT_REMOVEDIR);
}

static int make_inside(struct work *w, const struct work_about *about, const struct work_input *input, size_t ninput,
		       bool was_there, struct err *err)
{
	bool wrote = false, made = false;
	int r = check_empty(w, err);

	if (r)
		return r;
	for (size_t i = 0; !r && work_folders[i]; i++)
		r = io_make_dir(w->fd, work_folders[i], 0750, err);
	if (!r) {
		r = write_inputs(w, input, ninput, err);
		wrote = !r;
	}
	/* Last: with this file it is a work folder. */
	if (!r) {
		r = write_about(w, about, err);
		made = !r;
	}
	if (!r)
		r = io_sync(w->fd, w->folder, err);
	/* A file that exists is of another command, at the same time. */
	if (r && !made && err->sys != EEXIST)
		unmake(w, wrote, was_there);
	return r;
}

int work_make(const char *folder, const struct work_about *about, const struct work_input *input, size_t ninput,
	      struct work **ret, struct err *err)
{
	struct work *w = work_new(folder);
	bool was_there;
	struct stat st;
	int r;

	if (!w)
		return err_set(err, ERR_NOMEM, "no memory for a work folder");
	was_there = io->fstatat(AT_FDCWD, folder, &st, 0) == 0;
	r = io_make_dir(AT_FDCWD, folder, 0750, err);
	if (!r)
		r = open_folder(w, err);
	if (!r)
		r = make_inside(w, about, input, ninput, was_there, err);
	work_close(w);
	return r ? r : work_open(folder, ret, err);
}

static bool parse_about(struct work_in *in, struct work_about *a, const char **word, size_t room)
{
	char *key, *rest, *end;
	uint64_t n;

	while (work_in_line(in, &key, &rest)) {
		enum work_phase phase;

		if (!strcmp(key, "id")) {
			a->id = strtoull(rest, &end, 16);
			if (*end)
				return false;
		} else if (!strcmp(key, "memory")) {
			if (!work_in_u64(&rest, &a->memory))
				return false;
		} else if (!strcmp(key, "tasks")) {
			if (!work_in_u64(&rest, &n) || n > UINT32_MAX || !work_phase_parse(rest, &phase))
				return false;
			a->tasks[phase] = (uint32_t)n;
		} else if (!strcmp(key, "kernel")) {
			a->kernel = rest;
		} else if (!strcmp(key, "word") && a->nword < room) {
			word[a->nword++] = rest;
		}
	}
	return a->id && a->memory;
}

static int read_about(struct work *w, bool wait, struct err *err)
{
	struct work_in in;
	const char **word;
	struct stat st;
	size_t room;
	int r;

	/* Its folders are older: where they are not there, nothing will come. */
	wait = wait && (io->fstatat(w->fd, work_folders[0], &st, AT_SYMLINK_NOFOLLOW) == 0 || errno != ENOENT);
	r = work_in_read(w, WORK_ABOUT, WORK_ABOUT, wait, &in, err);

	if (r == WORK_E_ABSENT) {
		err_set(err, ERR_NOTFOUND, "it is no work folder: it has no file " WORK_ABOUT);
		return err_add_file(err, w->folder);
	}
	if (r)
		return r;
	w->text = in.text;
	room = work_in_lines(&in);
	word = calloc(room + 1, sizeof *word);
	if (!word)
		return err_set(err, ERR_NOMEM, "no memory for %zu words", room);
	w->about.word = word;
	if (parse_about(&in, &w->about, word, room))
		return 0;
	err_set(err, ERR_CORRUPT, "it is damaged");
	return err_add_file(err, WORK_ABOUT);
}

static int open_work(const char *folder, bool wait, struct work **ret, struct err *err)
{
	struct work *w = work_new(folder);
	int r;

	if (!w)
		return err_set(err, ERR_NOMEM, "no memory for a work folder");
	r = open_folder(w, err);
	if (!r)
		r = read_about(w, wait, err);
	if (r)
		work_close(w);
	else
		*ret = w;
	return r;
}

int work_open(const char *folder, struct work **ret, struct err *err)
{
	return open_work(folder, false, ret, err);
}

int work_open_task(const char *folder, struct work **ret, struct err *err)
{
	return open_work(folder, true, ret, err);
}

int work_inputs(const struct work *w, struct work_input **ret, size_t *ret_n, struct err *err)
{
	char *key, *rest, *texts;
	struct work_input *input;
	struct work_in in;
	size_t room, n = 0;
	bool good = true;
	int r = work_in_read(w, WORK_INPUTS, WORK_INPUTS, true, &in, err);

	if (r == WORK_E_ABSENT) {
		err_set(err, ERR_NOTFOUND, "the work folder has no list of inputs");
		return err_add_file(err, WORK_INPUTS);
	}
	if (r)
		return r;
	room = work_in_lines(&in);
	input = malloc((room + 1) * sizeof *input + in.size + 1);
	if (!input) {
		free(in.text);
		return err_set(err, ERR_NOMEM, "no memory for %zu inputs", room);
	}
	texts = (char *)(input + room + 1);
	for (; good && work_in_line(&in, &key, &rest); n++) {
		uint64_t mtime = 0;

		good = n < room && !strcmp(key, "input") && work_in_u64(&rest, &input[n].size) && work_in_u64(&rest, &mtime);
		if (!good)
			break;
		input[n].mtime_ns = (int64_t)mtime;
		input[n].path = texts;
		texts = stpcpy(texts, rest) + 1;
	}
	free(in.text);
	if (!good) {
		free(input);
		err_set(err, ERR_CORRUPT, "it is damaged");
		return err_add_file(err, WORK_INPUTS);
	}
	*ret = input;
	*ret_n = n;
	return 0;
}

/* ---- the run ---- */

int work_cancel(struct work *w, struct err *err)
{
	int fd, r = io_open(w->fd, WORK_CANCELLED, O_WRONLY | O_CREAT, 0640, &fd, err);

	if (!r)
		io_close(fd);
	return r;
}

int work_uncancel(struct work *w, struct err *err)
{
	return io_remove(w->fd, WORK_CANCELLED, err);
}

bool work_cancelled(const struct work *w)
{
	struct stat st;

	return io->fstatat(w->fd, WORK_CANCELLED, &st, AT_SYMLINK_NOFOLLOW) == 0;
}
