/* The turn of a run, whatever its scheduler: see dispatch.h. */
#include "dispatch.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "clock.h"
#include "dispatch_priv.h"
#include "err.h"

enum { ATTEMPTS = 3, LEVELS = 16 };
static const double POLL_S = 10, PATIENCE_S = 120, TIME_S = 3600, STEP_S = 0.1;

static const struct dispatch_scheduler *const schedulers[] = {&dispatch_slurm, &dispatch_local, &dispatch_script};

static const struct dispatch_scheduler *find(const char *name)
{
	for (size_t i = 0; i < sizeof schedulers / sizeof *schedulers; i++)
		if (!strcmp(schedulers[i]->name, name))
			return schedulers[i];
	return NULL;
}

bool dispatch_is_scheduler(const char *name)
{
	return find(name) != NULL;
}

static int no_scheduler(const char *name, struct err *err)
{
	return err_set(err, ERR_USAGE, "there is no scheduler \"%.40s\": slurm, local or script", name);
}

int dispatch_check(const char *name, const char *work, const char *script, struct err *err)
{
	const struct dispatch_scheduler *on = find(name);

	if (!on)
		return no_scheduler(name, err);
	return on->check ? on->check(work, script, err) : 0;
}

const char *dispatch_why_text(enum dispatch_why why)
{
	static const char *const texts[] = {
		[DISPATCH_WHY_NONE] = "no record",       [DISPATCH_WHY_NODE] = "node lost",
		[DISPATCH_WHY_MEMORY] = "out of memory", [DISPATCH_WHY_TIME] = "time limit",
		[DISPATCH_WHY_SIGNAL] = "signal",        [DISPATCH_WHY_STATUS] = "failed",
		[DISPATCH_WHY_CANCELLED] = "cancelled",  [DISPATCH_WHY_PREEMPTED] = "preempted",
		[DISPATCH_WHY_DEPENDENCY] = "dropped",
	};

	return texts[why];
}

static int copy_phases(struct dispatch *d, struct err *err)
{
	for (unsigned i = 0; i < d->o.nphase; i++) {
		d->phase[i] = d->o.phase[i];
		if (!(d->phase[i].time > 0))
			d->phase[i].time = TIME_S;
		d->task[i] = calloc(d->phase[i].tasks + 1u, sizeof *d->task[i]);
		if (!d->task[i])
			return err_set(err, ERR_NOMEM, "no memory for %u tasks", d->phase[i].tasks);
	}
	d->o.phase = d->phase;
	return 0;
}

int dispatch_new(const char *name, const struct dispatch_options *o, struct dispatch **ret, struct err *err)
{
	const struct dispatch_scheduler *on = find(name);
	struct dispatch *d;
	int r;

	if (!on)
		return no_scheduler(name, err);
	if (o->nphase > DISPATCH_PHASES)
		return err_set(err, ERR_INTERNAL, "%u phases are too many", o->nphase);
	d = calloc(1, sizeof *d);
	if (!d)
		return err_set(err, ERR_NOMEM, "no memory for a run");
	d->on = on;
	d->o = *o;
	d->o.attempts = o->attempts ? o->attempts : ATTEMPTS;
	d->o.poll = o->poll > 0 ? o->poll : POLL_S;
	d->o.patience = o->patience > 0 ? o->patience : PATIENCE_S;
	d->begun_ns = clock_mono_ns();
	r = copy_phases(d, err);
	if (!r && on->begin)
		r = on->begin(d, err);
	if (r)
		dispatch_free(d);
	else
		*ret = d;
	return r;
}

struct dispatch *dispatch_free(struct dispatch *d)
{
	if (!d)
		return NULL;
	if (d->on->end)
		d->on->end(d);
	for (unsigned i = 0; i < d->o.nphase; i++)
		free(d->task[i]);
	free(d);
	return NULL;
}

bool dispatch_path_has(const char *path, char byte)
{
	char here[4096] = "";

	if (path[0] != '/' && !getcwd(here, sizeof here))
		here[0] = 0;
	return strchr(path, byte) || strchr(here, byte);
}

void dispatch_note(struct dispatch *d, const char *fmt, ...)
{
	char text[600];
	va_list ap;

	if (!d->o.note)
		return;
	va_start(ap, fmt);
	vsnprintf(text, sizeof text, fmt, ap);
	va_end(ap);
	d->o.note(d->o.ctx, text);
}

/* In steps, as a signal may come just before a sleep begins. */
void dispatch_sleep(struct dispatch *d, double seconds)
{
	const uint64_t from = clock_mono_ns();
	const struct timespec step = {.tv_nsec = (long)(STEP_S * 1e9)};

	while (clock_since(from) < seconds && !(d->o.stop && d->o.stop(d->o.ctx)))
		nanosleep(&step, NULL);
}

void dispatch_reason_count(struct dispatch *d, const char *text)
{
	for (size_t i = 0; i < d->nreason; i++)
		if (!strcmp(d->reason[i].text, text)) {
			d->reason[i].n++;
			for (; i && d->reason[i].n > d->reason[i - 1].n; i--) {
				const struct dispatch_reason swapped = d->reason[i];

				d->reason[i] = d->reason[i - 1];
				d->reason[i - 1] = swapped;
			}
			return;
		}
	if (d->nreason == DISPATCH_REASONS)
		return;
	snprintf(d->reason[d->nreason].text, sizeof d->reason[0].text, "%s", text);
	d->reason[d->nreason++].n = 1;
}

/* ---- what there is ---- */

bool dispatch_phase_done(const struct dispatch *d, unsigned phase)
{
	for (uint32_t i = 0; i < d->phase[phase].tasks; i++)
		if (!d->task[phase][i].done)
			return false;
	return true;
}

bool dispatch_all_done(const struct dispatch *d)
{
	for (unsigned p = 0; p < d->o.nphase; p++)
		if (!dispatch_phase_done(d, p))
			return false;
	return true;
}

const struct dispatch_task *dispatch_task(const struct dispatch *d, unsigned phase, uint32_t index)
{
	return &d->task[phase][index];
}

struct dispatch_counts dispatch_counts(const struct dispatch *d, unsigned phase)
{
	struct dispatch_counts c = {0};

	for (uint32_t i = 0; i < d->phase[phase].tasks; i++) {
		const struct dispatch_task *t = &d->task[phase][i];

		if (t->done)
			c.done++;
		else if (t->state == DISPATCH_RUNNING)
			c.running++;
		else if (t->state == DISPATCH_WAITING)
			c.waiting++;
		else
			c.absent++;
	}
	return c;
}

const struct dispatch_reason *dispatch_reasons(const struct dispatch *d, size_t *ret_n)
{
	*ret_n = d->nreason;
	return d->reason;
}

static int by_number(const void *a, const void *b)
{
	const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;

	return (x > y) - (x < y);
}

uint32_t *dispatch_jobs(const struct dispatch *d, size_t *ret_n)
{
	size_t n = 0, kept = 0, all = 0;
	uint32_t *job;

	for (unsigned p = 0; p < d->o.nphase; p++)
		all += d->phase[p].tasks;
	job = malloc((all + 1) * sizeof *job);
	*ret_n = 0;
	if (!job)
		return NULL;
	for (unsigned p = 0; p < d->o.nphase; p++)
		for (uint32_t i = 0; i < d->phase[p].tasks; i++) {
			const struct dispatch_task *t = &d->task[p][i];

			if (t->job && (t->state == DISPATCH_WAITING || t->state == DISPATCH_RUNNING) &&
			    (!n || job[n - 1] != t->job))
				job[n++] = t->job;
		}
	qsort(job, n, sizeof *job, by_number);
	for (size_t i = 0; i < n; i++)
		if (!i || job[i] != job[i - 1])
			job[kept++] = job[i];
	*ret_n = kept;
	return job;
}

/* An attempt that was submitted to wait for the phase before is one from now on. */
static void has_begun(struct dispatch_task *t)
{
	if (t->hangs && t->tries < UINT8_MAX)
		t->tries++;
	t->hangs = false;
}

/* The scheduler first: a task that ends in between has its record when that is read. */
int dispatch_look(struct dispatch *d, struct err *err)
{
	const uint32_t now = (uint32_t)clock_since(d->begun_ns) + 1;
	int r = d->on->look ? d->on->look(d, err) : 0;

	for (unsigned p = 0; p < d->o.nphase; p++)
		for (uint32_t i = 0; i < d->phase[p].tasks; i++) {
			struct dispatch_task *t = &d->task[p][i];
			const bool there = t->state == DISPATCH_WAITING || t->state == DISPATCH_RUNNING;

			if (t->state == DISPATCH_RUNNING)
				has_begun(t);
			/* One that waits has no record, but for a look at another attempt: it will be done at once. */
			if (!t->done && !(t->state == DISPATCH_WAITING && t->seen))
				t->done = d->o.done(d->o.ctx, p, i);
			t->seen |= t->state != DISPATCH_ABSENT;
			t->missing_s = t->done || there ? 0 : t->missing_s ? t->missing_s : now;
		}
	return r;
}

void dispatch_troubles(struct dispatch *d, void (*each)(void *ctx, const char *what, const char *command), void *ctx)
{
	if (d->on->troubles)
		d->on->troubles(d, each, ctx);
}

/* ---- what is missing ---- */

/* Statuses with which a program says that the same would fail again: the input, the command, the version, a right. */
static bool repeats_itself(const struct dispatch_task *t)
{
	return t->why == DISPATCH_WHY_STATUS && (t->status == 1 || t->status == 2 || t->status == 76 || t->status == 77);
}

/* The log may know better than the scheduler, whose FAILED says little. */
static void refine(const struct dispatch_log *log, struct dispatch_task *t)
{
	if (t->why != DISPATCH_WHY_NONE && t->why != DISPATCH_WHY_STATUS && t->why != DISPATCH_WHY_SIGNAL)
		return;
	if (log->why)
		t->why = (uint8_t)log->why;
	if (log->status)
		t->status = log->status > 128 ? log->status - 128 : log->status;
}

/* Of a task that has no record: did what was submitted begin, or was it dropped? */
static void read_log(struct dispatch *d, unsigned p, uint32_t i, struct dispatch_log *ret)
{
	struct dispatch_task *t = &d->task[p][i];
	bool known = dispatch_log_read(d, p, i, ret), begun = known && ret->begun > t->begun;

	if (t->state == DISPATCH_ENDED)
		begun = t->why != DISPATCH_WHY_DEPENDENCY && t->why != DISPATCH_WHY_CANCELLED;
	if (begun)
		has_begun(t);
	if (begun && known)
		refine(ret, t);
	t->logged = known ? ret->begun : t->logged;
}

static int failed(const struct dispatch *d, unsigned p, uint32_t i, const struct dispatch_log *log, struct err *err)
{
	const struct dispatch_task *t = &d->task[p][i];
	const bool limit = t->why == DISPATCH_WHY_MEMORY || t->why == DISPATCH_WHY_TIME;
	char path[96], number[24] = "", host[80] = "";

	d->on->log_name(d, p, i, path);
	if (t->status)
		snprintf(number, sizeof number, " %s%d", t->why == DISPATCH_WHY_STATUS ? "with status " : "", t->status);
	if (log->host[0])
		snprintf(host, sizeof host, " on %s", log->host);
	err_set(err,
		repeats_itself(t) ? ERR_INPUT :
		limit             ? ERR_LIMIT :
				    ERR_IO,
		"task %s %u: %s%s%s, after %u attempt%s%s%s", d->phase[p].name, i, dispatch_why_text(t->why), number, host,
		log->begun, log->begun == 1 ? "" : "s", log->tail[0] ? "; its log ends with: " : "", log->tail);
	return err_add_hint(err, "its log is %s/log/%s; mend the cause, then: acut-cluster resume %s", d->o.work, path,
			    d->o.work);
}

/* Whether a task is to be submitted now. -ERR_*: it shall not be any more. */
static int is_lost(struct dispatch *d, unsigned p, uint32_t i, bool first, bool patient, bool *ret, struct err *err)
{
	struct dispatch_task *t = &d->task[p][i];
	struct dispatch_log log = {0};

	*ret = false;
	if (t->done || t->state == DISPATCH_WAITING || t->state == DISPATCH_RUNNING)
		return 0;
	if (!t->seen || t->why == DISPATCH_WHY_DEPENDENCY || (!first && !t->tries && t->state != DISPATCH_ENDED)) {
		/* It never was there, or a scheduler has dropped it with the phase before. */
		*ret = !d->submitted || t->state == DISPATCH_ENDED || !d->on->never_lost;
		if (*ret)
			read_log(d, p, i, &log);
		return 0;
	}
	if (patient && first && t->why == DISPATCH_WHY_CANCELLED) {
		err_set(err, ERR_CANCELLED, "task %s %u was cancelled from outside, in job %u", d->phase[p].name, i, t->job);
		return err_add_hint(err, "to go on: acut-cluster resume %s", d->o.work);
	}
	if (t->why == DISPATCH_WHY_NONE && patient && d->on->late &&
	    clock_since(d->begun_ns) - (t->missing_s - 1) < d->o.patience)
		return 0;
	read_log(d, p, i, &log);
	if (d->submitted && (t->tries >= d->o.attempts || repeats_itself(t)))
		return failed(d, p, i, &log, err);
	if (t->tries && t->why != DISPATCH_WHY_CANCELLED)
		dispatch_note(d, "%s %u is submitted again: %s%s%s", d->phase[p].name, i, dispatch_why_text(t->why),
			      log.host[0] ? " on " : "", log.host);
	*ret = true;
	return 0;
}

/* How often a task had too little, with the attempt that has just ended. */
static void levels(const struct dispatch_task *t, unsigned *ret_memory, unsigned *ret_time)
{
	*ret_memory = t->memory + (t->why == DISPATCH_WHY_MEMORY && t->memory < LEVELS);
	*ret_time = t->time + (t->why == DISPATCH_WHY_TIME && t->time < LEVELS);
}

/* The same again would fail again. */
static struct dispatch_need need_of(const struct dispatch_phase *phase, unsigned memory, unsigned time)
{
	struct dispatch_need need = {phase->memory, phase->time};

	for (; memory; memory--)
		need.memory += need.memory / 2;
	for (; time; time--)
		need.time *= 2;
	return need;
}

static void was_submitted(struct dispatch_task *t, bool first)
{
	unsigned memory, time;

	levels(t, &memory, &time);
	t->memory = (uint8_t)memory;
	t->time = (uint8_t)time;
	/* One that has to wait for the phase before is no attempt yet, if it is dropped. */
	t->tries = (uint8_t)(t->tries + (first && t->tries < UINT8_MAX));
	t->hangs = !first;
	t->begun = t->logged;
	t->why = DISPATCH_WHY_NONE;
	t->status = 0;
	t->seen = true;
	t->missing_s = 0;
}

/* Those that need as much as the first of the list, which are taken out of it. */
static int submit_alike(struct dispatch *d, unsigned p, bool first, uint32_t *list, uint32_t *n, uint32_t *alike, struct err *err)
{
	unsigned memory, time, m, t;
	uint32_t kept = 0, taken = 0;
	struct dispatch_need need;
	int r;

	levels(&d->task[p][list[0]], &memory, &time);
	for (uint32_t k = 0; k < *n; k++) {
		levels(&d->task[p][list[k]], &m, &t);
		if (m == memory && t == time)
			alike[taken++] = list[k];
		else
			list[kept++] = list[k];
	}
	*n = kept;
	need = need_of(&d->phase[p], memory, time);
	r = d->on->submit(d, p, alike, taken, &need, err);
	for (uint32_t k = 0; k < taken; k++)
		if (d->task[p][alike[k]].state == DISPATCH_WAITING)
			was_submitted(&d->task[p][alike[k]], first);
	return r;
}

/* `list`: room for twice the tasks of the phase. */
static int submit_phase(struct dispatch *d, unsigned p, bool first, bool patient, uint32_t *list, struct err *err)
{
	uint32_t n = 0;
	int r = 0;

	for (uint32_t i = 0; i < d->phase[p].tasks && !r; i++) {
		bool lost;

		r = is_lost(d, p, i, first, patient, &lost, err);
		if (r || !lost)
			continue;
		list[n++] = i;
	}
	while (!r && n)
		r = submit_alike(d, p, first, list, &n, list + d->phase[p].tasks, err);
	return r;
}

int dispatch_submit(struct dispatch *d, bool patient, struct err *err)
{
	uint32_t *list = NULL, most = 0;
	bool first = true;
	int r = 0;

	for (unsigned p = 0; p < d->o.nphase; p++)
		most = d->phase[p].tasks > most ? d->phase[p].tasks : most;
	list = malloc((2 * (size_t)most + 1) * sizeof *list);
	if (!list)
		return err_set(err, ERR_NOMEM, "no memory for a list of tasks");
	for (unsigned p = 0; p < d->o.nphase && !r; p++) {
		r = submit_phase(d, p, first, patient, list, err);
		first = first && dispatch_phase_done(d, p);
	}
	free(list);
	d->submitted = d->submitted || !r || r == -ERR_BUSY;
	if (!r && d->on->submitted)
		r = d->on->submitted(d, err);
	return r;
}

/* Looks and submits. -ERR_BUSY: not all of it could be done now. */
static int turn(struct dispatch *d, bool *ret_over, struct err *err)
{
	int r = dispatch_look(d, err);

	if (r && r != -ERR_BUSY)
		return r;
	if (d->o.changed)
		d->o.changed(d->o.ctx);
	*ret_over = dispatch_all_done(d);
	if (r || *ret_over || (d->o.stop && d->o.stop(d->o.ctx)))
		return r;
	return dispatch_submit(d, true, err);
}

int dispatch_wait(struct dispatch *d, struct err *err)
{
	bool busy = false, over = false;

	for (;;) {
		int r = turn(d, &over, err);

		if (r == -ERR_BUSY) {
			if (!busy)
				dispatch_note(d, "%s; it is tried again", err->message);
			err_clear(err);
		} else if (r) {
			return r;
		}
		busy = r != 0;
		if (over)
			return 0;
		if (d->o.stop && d->o.stop(d->o.ctx))
			return DISPATCH_E_STOPPED;
		d->on->pause(d);
	}
}

int dispatch_cancel(struct dispatch *d, uint32_t *ret_n, struct err *err)
{
	*ret_n = 0;
	return d->on->cancel ? d->on->cancel(d, ret_n, err) : 0;
}
