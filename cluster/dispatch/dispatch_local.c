/*
 * Processes of this machine: at most `most` at once. A task begins when all of the phase before are done. The tasks end with this
 * process, however that ends.
 *
 * Who starts tasks holds a lock of the folder log, and its process is named in logs: others watch while it lives. A file system
 * may have no locks of folders (NFS). Two that begin at the same instant run every task twice then, which does no harm.
 */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/pidfd.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "clock.h"
#include "dispatch_priv.h"
#include "err.h"

enum { NO_PROGRAM = 127, MOST = 1024, STEP_MS = 100 };
static const double END_S = 10, LOOK_S = 2;

struct child {
	pid_t pid;
	int fd; /* readable when it has ended */
	unsigned phase;
	uint32_t index;
};

struct local {
	struct child *child;
	unsigned n, most;
	unsigned at[DISPATCH_PHASES]; /* no task before this one waits */
	pid_t other;                  /* another process that drives the run: this one only watches; 0: none */
	uint64_t looked_ns;           /* when it was looked for; 0: never, or it has to be looked for again */
	int lock;                     /* the folder log, locked; -1: not, or not yet */
};

/* One a processor, and as many as fit into three quarters of the memory. */
static unsigned preset_most(const struct dispatch *d)
{
	const long processors = sysconf(_SC_NPROCESSORS_ONLN), pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
	const uint64_t memory = pages > 0 && page > 0 ? (uint64_t)pages * (uint64_t)page / 4 * 3 : UINT64_MAX;
	uint64_t task = 1, most = processors > 0 ? (uint64_t)processors : 1;

	for (unsigned p = 0; p < d->o.nphase; p++)
		task = d->phase[p].tasks > 1 && d->phase[p].memory > task ? d->phase[p].memory : task;
	most = memory / task < most ? memory / task : most;
	return most ? (unsigned)most : 1;
}

static int begin(struct dispatch *d, struct err *err)
{
	struct local *l = calloc(1, sizeof *l);

	if (!l)
		return err_set(err, ERR_NOMEM, "no memory for a scheduler");
	d->own = l;
	l->lock = -1;
	l->most = d->o.most ? d->o.most : preset_most(d);
	l->most = l->most < MOST ? l->most : MOST;
	l->child = calloc(l->most, sizeof *l->child);
	return l->child ? 0 : err_set(err, ERR_NOMEM, "no memory for a scheduler");
}

static void log_name(const struct dispatch *d, unsigned phase, uint32_t index, char buf[96])
{
	snprintf(buf, 96, "%s-%u", d->phase[phase].name, index);
}

static int open_log(const struct dispatch *d, const struct child *c, struct err *err)
{
	char name[96], path[4200];
	int fd;

	log_name(d, c->phase, c->index, name);
	snprintf(path, sizeof path, "%s/log/%s", d->o.work, name);
	fd = open(path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
	if (fd < 0) {
		err_sys(err, errno, "the log of a task cannot be opened");
		return err_add_file(err, path);
	}
	return fd;
}

__attribute__((format(printf, 2, 3))) static void say(int fd, const char *fmt, ...)
{
	char line[400];
	va_list ap;
	size_t n;

	va_start(ap, fmt);
	n = (size_t)vsnprintf(line, sizeof line, fmt, ap);
	va_end(ap);
	if (write(fd, line, n < sizeof line ? n : sizeof line - 1) < 0)
		return; /* a log is for people: the task goes on without it */
}

static void become(const struct dispatch *d, const struct child *c, int log, pid_t parent)
{
	char index[16];
	const char *const argv[] = {d->o.task, d->o.work, d->phase[c->phase].name, index, NULL};
	sigset_t none;
	int in = open("/dev/null", O_RDONLY);

	prctl(PR_SET_PDEATHSIG, SIGKILL);
	if (getppid() != parent)
		_exit(NO_PROGRAM);
	sigemptyset(&none);
	sigprocmask(SIG_SETMASK, &none, NULL);
	for (int s = 1; s < 32; s++)
		if (s != SIGKILL && s != SIGSTOP)
			signal(s, SIG_DFL);
	setpgid(0, 0); /* an interrupt of the terminal comes by way of the driver */
	snprintf(index, sizeof index, "%u", c->index);
	dup2(in, 0);
	dup2(log, 1);
	dup2(log, 2);
	execv(argv[0], (char *const *)argv);
	say(2, "acut-cluster: %s cannot be run: %s\n", argv[0], strerror(errno));
	_exit(NO_PROGRAM);
}

static int start(struct dispatch *d, unsigned phase, uint32_t index, struct err *err)
{
	struct local *l = d->own;
	struct child *c = &l->child[l->n];
	const pid_t parent = getpid();
	char host[64] = "";
	int log;

	*c = (struct child){.phase = phase, .index = index};
	log = open_log(d, c, err);
	if (log < 0)
		return log;
	gethostname(host, sizeof host - 1);
	say(log, "acut-cluster: %s %u begins on %s, process of %d\n", d->phase[phase].name, index, host, (int)parent);
	c->pid = fork();
	if (c->pid == 0)
		become(d, c, log, parent);
	close(log);
	if (c->pid < 0)
		return err_sys(err, errno, "no process for a task");
	c->fd = pidfd_open(c->pid, 0);
	l->n++;
	d->task[phase][index].state = DISPATCH_RUNNING;
	return 0;
}

/* The first task that waits and may begin. False: there is none. */
static bool next(struct dispatch *d, unsigned *ret_phase, uint32_t *ret_index)
{
	struct local *l = d->own;

	for (unsigned p = 0; p < d->o.nphase; p++) {
		for (; l->at[p] < d->phase[p].tasks; l->at[p]++)
			if (d->task[p][l->at[p]].state == DISPATCH_WAITING) {
				*ret_phase = p;
				*ret_index = l->at[p];
				return true;
			}
		if (!dispatch_phase_done(d, p))
			return false;
	}
	return false;
}

static int fill(struct dispatch *d, struct err *err)
{
	struct local *l = d->own;
	unsigned phase;
	uint32_t index;
	int r = 0;

	while (!r && !l->other && l->n < l->most && !(d->o.stop && d->o.stop(d->o.ctx)) && next(d, &phase, &index))
		r = start(d, phase, index, err);
	return r;
}

static void ended(struct dispatch *d, const struct child *c, int status)
{
	struct dispatch_task *t = &d->task[c->phase][c->index];
	struct err err = ERR_INIT;
	int log = open_log(d, c, &err);

	t->state = DISPATCH_ENDED;
	t->why = WIFSIGNALED(status) ? DISPATCH_WHY_SIGNAL : WEXITSTATUS(status) ? DISPATCH_WHY_STATUS : DISPATCH_WHY_NONE;
	t->status = WIFSIGNALED(status) ? WTERMSIG(status) : WEXITSTATUS(status);
	if (log >= 0) {
		say(log, "acut-cluster: %s %u ends with status %d\n", d->phase[c->phase].name, c->index,
		    WIFSIGNALED(status) ? 128 + t->status : t->status);
		close(log);
	}
	if (!t->status)
		t->done = d->o.done(d->o.ctx, c->phase, c->index);
}

static void reap(struct dispatch *d)
{
	struct local *l = d->own;

	for (unsigned i = 0; i < l->n;) {
		int status;

		if (waitpid(l->child[i].pid, &status, WNOHANG) != l->child[i].pid) {
			i++;
			continue;
		}
		if (l->child[i].fd >= 0)
			close(l->child[i].fd);
		ended(d, &l->child[i], status);
		l->child[i] = l->child[--l->n];
	}
}

/* ---- another driver ---- */

/* A process of that number is no driver if it has the number by chance. */
static bool name_and_state(pid_t pid, char name[64], char *ret_state)
{
	char path[40], text[200], *from, *to;
	ssize_t n;
	int fd;

	snprintf(path, sizeof path, "/proc/%d/stat", (int)pid);
	fd = open(path, O_RDONLY | O_CLOEXEC);
	n = fd >= 0 ? read(fd, text, sizeof text - 1) : -1;
	if (fd >= 0)
		close(fd);
	text[n > 0 ? n : 0] = 0;
	from = strchr(text, '(');
	to = strrchr(text, ')');
	if (!from || !to || to < from || to[1] != ' ' || to - from > 63)
		return false;
	*to = 0;
	strcpy(name, from + 1);
	*ret_state = to[2];
	return true;
}

static bool driver_lives(pid_t pid)
{
	char name[64], own[64], state, own_state;

	return pid && pid != getpid() && name_and_state(pid, name, &state) && state != 'Z' && state != 'X' &&
	       name_and_state(getpid(), own, &own_state) && !strcmp(name, own);
}

/* A driver that began an attempt and lives goes on with the run, also between two tasks: all else waits for it. */
static void look_at_logs(struct dispatch *d)
{
	struct local *l = d->own;
	char host[64] = "";
	int dead = 0;

	gethostname(host, sizeof host - 1);
	l->other = 0;
	for (unsigned p = 0; p < d->o.nphase; p++)
		for (uint32_t i = 0; i < d->phase[p].tasks; i++) {
			struct dispatch_log log;

			d->task[p][i].state = DISPATCH_ABSENT;
			if (!dispatch_log_read(d, p, i, &log) || !log.begun || strcmp(log.host, host) || log.driver == dead)
				continue;
			if (log.driver != l->other && !driver_lives(log.driver)) {
				dead = log.driver;
				continue;
			}
			l->other = log.driver;
			if (!log.ended)
				d->task[p][i].state = DISPATCH_RUNNING;
		}
	for (unsigned p = 0; l->other && p < d->o.nphase; p++)
		for (uint32_t i = 0; i < d->phase[p].tasks; i++) {
			struct dispatch_task *t = &d->task[p][i];

			/* dispatch_look does not ask for the record of a task that waits. */
			t->done = t->done || d->o.done(d->o.ctx, p, i);
			if (t->state == DISPATCH_ABSENT && !t->done)
				t->state = DISPATCH_WAITING;
		}
}

/* There is another driver, or not, when this one begins; once it has begun, later ones see it. */
static int look(struct dispatch *d, struct err *err)
{
	struct local *l = d->own;

	reap(d);
	if (l->looked_ns && (!l->other || (driver_lives(l->other) && clock_since(l->looked_ns) < LOOK_S)))
		return 0;
	look_at_logs(d);
	l->looked_ns = clock_mono_ns();
	return 0;
}

/* -ERR_BUSY: another process has begun to start tasks; soon a log says so. */
static int take_lock(struct dispatch *d, struct err *err)
{
	struct local *l = d->own;
	char path[4200];
	int fd;

	if (l->lock >= 0)
		return 0;
	snprintf(path, sizeof path, "%s/log", d->o.work);
	fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	if (fd >= 0 && flock(fd, LOCK_EX | LOCK_NB) && errno == EWOULDBLOCK) {
		close(fd);
		l->looked_ns = 0;
		return err_set(err, ERR_BUSY, "another process starts the tasks of this run");
	}
	l->lock = fd;
	return 0;
}

static int submit(struct dispatch *d, unsigned phase, const uint32_t *index, uint32_t n, const struct dispatch_need *need,
		  struct err *err)
{
	struct local *l = d->own;
	int r = take_lock(d, err);

	if (r)
		return r;
	for (uint32_t i = 0; i < n; i++)
		d->task[phase][index[i]].state = DISPATCH_WAITING;
	if (n && index[0] < l->at[phase])
		l->at[phase] = index[0];
	return 0;
}

/* Until one has ended; in steps, as a signal may come. */
static void pause_local(struct dispatch *d)
{
	struct local *l = d->own;
	struct pollfd *p = calloc(l->n + 1u, sizeof *p);

	for (unsigned i = 0; p && i < l->n; i++)
		p[i] = (struct pollfd){.fd = l->child[i].fd, .events = POLLIN};
	poll(p, p ? l->n : 0, STEP_MS);
	free(p);
}

static void end_all(struct dispatch *d)
{
	struct local *l = d->own;
	const uint64_t from = clock_mono_ns();
	bool killed = false;

	for (unsigned i = 0; i < l->n; i++)
		kill(l->child[i].pid, SIGTERM);
	while (l->n) {
		reap(d);
		if (!l->n)
			break;
		pause_local(d);
		if (!killed && clock_since(from) > END_S) {
			killed = true;
			for (unsigned i = 0; i < l->n; i++)
				kill(l->child[i].pid, SIGKILL);
		}
	}
}

static int cancel(struct dispatch *d, uint32_t *ret_n, struct err *err)
{
	struct local *l = d->own;
	const uint64_t from = clock_mono_ns();

	*ret_n = l->n;
	end_all(d);
	if (!l->other)
		return 0;
	for (unsigned p = 0; p < d->o.nphase; p++)
		*ret_n += dispatch_counts(d, p).running;
	if (kill(l->other, SIGTERM) && errno != ESRCH)
		return err_sys(err, errno, "the process %d, which runs the tasks, cannot be ended", (int)l->other);
	while (driver_lives(l->other) && clock_since(from) < 2 * END_S)
		poll(NULL, 0, STEP_MS);
	if (driver_lives(l->other))
		return err_set(err, ERR_BUSY, "the process %d, which runs the tasks, has not ended yet", (int)l->other);
	return 0;
}

static void end(struct dispatch *d)
{
	struct local *l = d->own;

	if (!l)
		return;
	end_all(d);
	if (l->lock >= 0)
		close(l->lock);
	free(l->child);
	free(l);
}

const struct dispatch_scheduler dispatch_local = {
	.name = "local",
	.begin = begin,
	.end = end,
	.look = look,
	.submit = submit,
	.submitted = fill,
	.pause = pause_local,
	.cancel = cancel,
	.log_name = log_name,
};
