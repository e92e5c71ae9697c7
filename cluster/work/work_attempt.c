/* An attempt at a task: its files, and the record that makes them count. */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "clock.h"
#include "err.h"
#include "io.h"
#include "process.h"
#include "work_priv.h"

struct work_attempt {
	struct work *work;
	enum work_phase phase;
	uint32_t task;
	uint64_t number;
	int64_t begun_us;
	uint64_t begun_ns;
	struct work_out out; /* lines of results */
	char file[WORK_FILES][WORK_NAME];
	unsigned nfile;
	bool stays; /* its files: they are, or may be, named by the record */
};

enum { RECORD_NAME = 64 };

static void record_name(enum work_phase phase, uint32_t task, const char *folder, char ret[RECORD_NAME])
{
	snprintf(ret, RECORD_NAME, "%s/%s-%" PRIu32, folder, work_phase_text(phase), task);
}

/* The name of the node by Slurm, where several may be on one machine; else that of the machine. */
static void host_name(char ret[64])
{
	const char *node = getenv("SLURMD_NODENAME");

	if (node && *node)
		snprintf(ret, 64, "%s", node);
	else if (gethostname(ret, 64) != 0)
		strcpy(ret, "?");
	ret[63] = 0;
}

int work_begin(struct work *w, enum work_phase phase, uint32_t task, struct work_attempt **ret, struct err *err)
{
	struct work_record *record;
	struct work_attempt *a;
	int r;

	if (task >= w->about.tasks[phase])
		return err_set(err, ERR_USAGE,
			       "the run has %" PRIu32 " tasks of the phase %s, numbered from 0: %" PRIu32 " is none",
			       w->about.tasks[phase], work_phase_text(phase), task);
	if (work_cancelled(w)) {
		err_set(err, ERR_CANCELLED, "the run was cancelled");
		return err_add_hint(err, "continue it with 'acut-cluster resume'");
	}
	r = work_record_look(w, phase, task, &record, err);
	if (r == -ERR_CORRUPT)
		err_add_hint(err, "remove it, so that the task runs again");
	if (r != WORK_E_ABSENT) {
		if (!r)
			work_record_free(record);
		return r ? r : WORK_E_DONE;
	}
	a = calloc(1, sizeof *a);
	if (!a)
		return err_set(err, ERR_NOMEM, "no memory for a task");
	*a = (struct work_attempt){.work = w,
				   .phase = phase,
				   .task = task,
				   .number = work_random(),
				   .begun_us = clock_real_us(),
				   .begun_ns = clock_mono_ns()};
	if (work_out_begin(&a->out, "acut-record", err)) {
		free(a);
		return -ERR_NOMEM;
	}
	*ret = a;
	return 0;
}

struct work_attempt *work_end(struct work_attempt *a)
{
	if (!a)
		return NULL;
	for (unsigned i = 0; !a->stays && i < a->nfile; i++)
		io->unlinkat(a->work->fd, a->file[i], 0);
	work_out_done(&a->out);
	free(a);
	return NULL;
}

uint64_t work_attempt_number(const struct work_attempt *a)
{
	return a->number;
}

int work_attempt_file(struct work_attempt *a, const char *folder, const char *kind, const char *suffix, char ret[WORK_NAME],
		      struct err *err)
{
	int n;

	if (a->nfile == WORK_FILES)
		return err_set(err, ERR_INTERNAL, "a task has more than %d files", WORK_FILES);
	n = snprintf(ret, WORK_NAME, "%s%s%s-%" PRIu32 "-%016" PRIx64 "%s", folder, *folder ? "/" : "", kind, a->task, a->number,
		     suffix);
	if (n >= WORK_NAME)
		return err_set(err, ERR_INTERNAL, "the name of a file is too long");
	memcpy(a->file[a->nfile++], ret, WORK_NAME);
	return 0;
}

/* ---- results ---- */

int work_result_file(struct work_attempt *a, const char *name, struct err *err)
{
	char key[48];
	struct stat st;

	if (io->fstatat(a->work->fd, name, &st, AT_SYMLINK_NOFOLLOW) < 0)
		return err_sys(err, errno, "cannot find %s", name);
	snprintf(key, sizeof key, "file %llu", (unsigned long long)st.st_size);
	work_out_line(&a->out, key, name);
	return 0;
}

int work_result(struct work_attempt *a, const char *key, const char *text, struct err *err)
{
	char head[64];

	if (snprintf(head, sizeof head, "value %s", key) >= (int)sizeof head || strpbrk(key, " \n"))
		return err_set(err, ERR_INTERNAL, "'%s' is no key of a record", key);
	work_out_line(&a->out, head, text);
	return 0;
}

int work_result_u64(struct work_attempt *a, const char *key, uint64_t value, struct err *err)
{
	char text[32];

	snprintf(text, sizeof text, "%" PRIu64, value);
	return work_result(a, key, text, err);
}

static double cpu_seconds(void)
{
	double sum = 0;

	for (int of = 0; of < 2; of++) {
		struct rusage u;

		if (getrusage(of ? RUSAGE_CHILDREN : RUSAGE_SELF, &u) == 0)
			sum += (double)(u.ru_utime.tv_sec + u.ru_stime.tv_sec) +
			       (double)(u.ru_utime.tv_usec + u.ru_stime.tv_usec) * 1e-6;
	}
	return sum;
}

static void line_u64(struct work_out *o, const char *key, uint64_t value)
{
	char text[32];

	snprintf(text, sizeof text, "%" PRIu64, value);
	work_out_line(o, key, text);
}

/* Times in microseconds. */
static void add_numbers(struct work_attempt *a)
{
	char text[64];

	work_out_line(&a->out, "phase", work_phase_text(a->phase));
	line_u64(&a->out, "task", a->task);
	snprintf(text, sizeof text, "%016" PRIx64, a->number);
	work_out_line(&a->out, "attempt", text);
	host_name(text);
	work_out_line(&a->out, "host", text);
	line_u64(&a->out, "begun", (uint64_t)a->begun_us);
	line_u64(&a->out, "wall", (uint64_t)(clock_since(a->begun_ns) * 1e6));
	line_u64(&a->out, "cpu", (uint64_t)(cpu_seconds() * 1e6));
	line_u64(&a->out, "peak", process_peak_rss());
}

/* Whose record has the name: this attempt's (0), or another one's (WORK_E_LOST). WORK_E_ABSENT: none. */
static int whose(const struct work_attempt *a, bool wait, struct err *err)
{
	struct work_record *record;
	int r = (wait ? work_record_need : work_record_look)(a->work, a->phase, a->task, &record, err);

	if (r)
		return r;
	r = record->attempt == a->number ? 0 : WORK_E_LOST;
	work_record_free(record);
	return r;
}

/*
 * The answer of a link may be lost, and the request repeated, so that it fails although it was done. What tells is the record
 * itself: the number of links may be an old one. If even that is not known, the files must stay, as the record may name them.
 */
static int take_name(struct work_attempt *a, const char *temp, const char *name, struct err *err)
{
	const struct work *w = a->work;
	struct err ignored = ERR_INIT;
	int sys, r;

	if (io->linkat(w->fd, temp, w->fd, name, 0) == 0)
		return 0;
	sys = errno;
	if (sys == EPERM || sys == EOPNOTSUPP || sys == ENOSYS) {
		err_sys(err, sys, "cannot name %s", name);
		return err_add_hint(err, "the file system has no hard links: use a work folder on another one");
	}
	r = whose(a, sys == EEXIST, &ignored);
	if (r >= 0 && r != WORK_E_ABSENT)
		return r;
	a->stays = true;
	return err_sys(err, sys, "cannot name %s", name);
}

static int sync_folder(const struct work *w, const char *name, struct err *err)
{
	int fd, r = io_open(w->fd, name, O_RDONLY | O_DIRECTORY, 0, &fd, err);

	if (r)
		return r;
	/* A folder that cannot be synced is one of a file system that writes it through. */
	if (io->fsync(fd) < 0 && errno != EINVAL && errno != ENOTSUP)
		r = err_sys(err, errno, "cannot sync the folder %s", name);
	io_close(fd);
	return r;
}

int work_publish(struct work_attempt *a, struct err *err)
{
	const struct work *w = a->work;
	char name[RECORD_NAME], temp[RECORD_NAME + 24];
	int r = 0;

	record_name(a->phase, a->task, "done", name);
	snprintf(temp, sizeof temp, "%s.%016" PRIx64, name, a->number);
	add_numbers(a);
	r = work_out_end(&a->out, err);
	/* The names of its files first. */
	if (!r && a->nfile)
		r = io_sync(w->fd, w->folder, err);
	if (!r && a->nfile)
		r = sync_folder(w, WORK_IN_DATASET, err);
	if (!r && a->nfile)
		r = sync_folder(w, WORK_IN_MESH, err);
	if (!r)
		r = work_write_new(w, temp, a->out.bytes, a->out.size, err);
	if (r)
		return r;
	r = take_name(a, temp, name, err);
	a->stays |= r == 0;
	io->unlinkat(w->fd, temp, 0);
	return r ? r : sync_folder(w, "done", err);
}

/* ---- failures ---- */

void work_fail(struct work_attempt *a, const struct err *why)
{
	char name[RECORD_NAME], temp[RECORD_NAME + 24], host[64], text[1600];
	struct err ignored = ERR_INIT;
	struct work_failure before = {0};
	struct work_out o;

	if (work_failure_look(a->work, a->phase, a->task, &before, &ignored))
		before.times = 0;
	if (work_out_begin(&o, "acut-failure", &ignored))
		return;
	record_name(a->phase, a->task, "failed", name);
	snprintf(temp, sizeof temp, "%s.%016" PRIx64, name, a->number);
	host_name(host);
	line_u64(&o, "times", before.times + 1);
	line_u64(&o, "at", (uint64_t)clock_real_us());
	work_out_line(&o, "host", host);
	work_out_line(&o, "code", err_wire_name(why->code));
	work_out_line(&o, "message", err_format(why, text, sizeof text));
	if (!work_out_end(&o, &ignored) && !work_write_new(a->work, temp, o.bytes, o.size, &ignored) &&
	    io->renameat(a->work->fd, temp, a->work->fd, name) < 0)
		io->unlinkat(a->work->fd, temp, 0);
	work_out_done(&o);
}

/* ---- a task ---- */

int work_run(struct work *w, enum work_phase phase, uint32_t task, work_make_fn make, void *ctx, struct err *err)
{
	struct work_attempt *a;
	struct err ignored = ERR_INIT;
	int r = work_begin(w, phase, task, &a, err);

	if (r)
		return r;
	r = make(ctx, a, task, err);
	if (!r)
		r = work_publish(a, err);
	if (r < 0 && whose(a, false, &ignored) == WORK_E_LOST) {
		err_clear(err);
		r = WORK_E_LOST;
	}
	/* What was waited for when it was interrupted may come. */
	if (r < 0 && r != -ERR_CANCELLED && work_interrupted(w)) {
		err_clear(err);
		r = work_check_interrupt(w, err);
	}
	if (r < 0 && r != -ERR_CANCELLED)
		work_fail(a, err);
	work_end(a);
	return r;
}
