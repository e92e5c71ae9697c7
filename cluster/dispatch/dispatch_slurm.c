/*
 * Slurm, by its commands: sbatch, squeue, scontrol, scancel, sinfo. Neither accounting nor its database is asked: a cluster may
 * have none, and `scontrol show job` forgets.
 *
 * A phase is one array (or several, where MaxArraySize is smaller than it) named acut-ID-PHASE; an index of the array is the
 * index of the task, less the offset in its name. What Slurm has is found by these names, and not by a number that was kept: the
 * reply of a submission may be lost. An element depends on the arrays of the phase before that still have tasks (afterok). Where
 * one of these fails, Slurm drops what depends on it, and the next turn submits both again.
 *
 * An element that loses its node is put back by Slurm itself (--requeue); one that is killed or fails is not.
 */
#include <ctype.h>
#include <stdlib.h>
#include <string.h>

#include "dispatch_priv.h"
#include "err.h"

enum { LIST_SIZE = 24 << 10, WORDS = 24, AGAIN = 5 };
static const double COMMAND_S = 120;
/* A node could not start a task, as after a restart of the controller: Slurm puts it back, and holds it. */
static const char NOT_LAUNCHED[] = "launch failed requeued held";

struct slurm {
	uint64_t array_most; /* MaxArraySize; 0: not asked yet */
	uint32_t *job[DISPATCH_PHASES];
	size_t njob[DISPATCH_PHASES], room[DISPATCH_PHASES];
	bool held, begin_later, not_launched;
	unsigned releases;
};

static int begin(struct dispatch *d, struct err *err)
{
	dispatch_clear_environment();
	setenv("SLURM_BITSTR_LEN", "0", 1); /* lists of indices are not shortened */
	d->own = calloc(1, sizeof(struct slurm));
	return d->own ? 0 : err_set(err, ERR_NOMEM, "no memory for a scheduler");
}

static void end(struct dispatch *d)
{
	struct slurm *s = d->own;

	for (unsigned p = 0; s && p < DISPATCH_PHASES; p++)
		free(s->job[p]);
	free(s);
}

static int check(const char *work, const char *script, struct err *err)
{
	static const char *const argv[] = {"sbatch", "--version", NULL};
	int r;

	if (dispatch_path_has(work, '\\'))
		return err_set(err, ERR_USAGE, "Slurm cannot have a work folder with a backslash in its path");
	r = dispatch_command(argv, NULL, COMMAND_S, NULL, err);
	return r ? err_add_hint(err, "submit where Slurm is, or use --on local or --on script") : 0;
}

static bool note_job(struct slurm *s, unsigned phase, uint32_t job)
{
	if (s->njob[phase] && s->job[phase][s->njob[phase] - 1] == job)
		return true;
	for (size_t i = 0; i < s->njob[phase]; i++)
		if (s->job[phase][i] == job)
			return true;
	if (s->njob[phase] == s->room[phase]) {
		size_t room = 2 * s->room[phase] + 8;
		uint32_t *at = realloc(s->job[phase], room * sizeof *at);

		if (!at)
			return false;
		s->job[phase] = at;
		s->room[phase] = room;
	}
	s->job[phase][s->njob[phase]++] = job;
	return true;
}

/* ---- what Slurm has ---- */

static bool lives(enum dispatch_state s)
{
	return s == DISPATCH_WAITING || s == DISPATCH_RUNNING;
}

/* Of several rows of a task the one that lives counts, else the latest. */
static void take_row(struct dispatch *d, const struct dispatch_row *row, uint32_t index)
{
	struct dispatch_task *t = &d->task[row->phase][index];

	if (lives(t->state) ? !lives(row->state) : !lives(row->state) && row->job < t->job)
		return;
	t->state = (uint8_t)row->state;
	t->why = (uint8_t)row->why;
	t->job = row->job;
}

static int ask_array_size(struct dispatch *d, struct err *err)
{
	static const char *const argv[] = {"scontrol", "show", "config", NULL};
	struct slurm *s = d->own;
	char *text;
	int r;

	if (s->array_most)
		return 0;
	r = dispatch_command(argv, NULL, COMMAND_S, &text, err);
	if (r)
		return r;
	if (!dispatch_config_number(text, "MaxArraySize", &s->array_most) || s->array_most < 2)
		r = err_set(err, ERR_UNSUPPORTED, "this Slurm takes no arrays: scontrol show config has no MaxArraySize above 1");
	free(text);
	return r;
}

static int look(struct dispatch *d, struct err *err)
{
	struct slurm *s = d->own;
	char user[24], *text, *save = NULL;
	/* All states: those that have ended are listed for some minutes. */
	const char *const argv[] = {"squeue", "-h", "-r", "-t", "all", "-u", user, "-o", "%F|%K|%T|%r|%j", NULL};
	int r;

	snprintf(user, sizeof user, "%u", d->o.user);
	r = ask_array_size(d, err); /* names of logs depend on it */
	if (!r)
		r = dispatch_command(argv, NULL, COMMAND_S, &text, err);
	if (r == -ERR_IO) /* it cannot reach its controller, which may come back */
		err->code = ERR_BUSY;
	if (r)
		return -(int)err->code;
	for (unsigned p = 0; p < d->o.nphase; p++) {
		s->njob[p] = 0;
		for (uint32_t i = 0; i < d->phase[p].tasks; i++)
			d->task[p][i].state = DISPATCH_ABSENT;
	}
	d->nreason = 0;
	s->held = s->begin_later = s->not_launched = false;
	for (char *line = strtok_r(text, "\n", &save); line && !r; line = strtok_r(NULL, "\n", &save)) {
		struct dispatch_row row;
		uint32_t from, to;

		if (!dispatch_row_read(d, line, &row))
			continue;
		while (dispatch_row_next(d, &row, &from, &to))
			for (; from <= to; from++)
				take_row(d, &row, from);
		if (lives(row.state) && !note_job(s, row.phase, row.job))
			r = err_set(err, ERR_NOMEM, "no memory for the list of jobs");
		if (row.state != DISPATCH_WAITING)
			continue;
		dispatch_reason_count(d, row.reason);
		s->held |= strstr(row.reason, "Held") || strstr(row.reason, "held");
		s->not_launched |= !strcmp(row.reason, NOT_LAUNCHED);
		s->begin_later |= !strcmp(row.reason, "BeginTime");
	}
	free(text);
	return r;
}

/* ---- submission ---- */

struct array {
	unsigned phase;
	uint32_t offset, n;
	uint32_t most; /* of its tasks at once; 0: any */
	struct dispatch_need need;
	char list[LIST_SIZE];
};

static void name_of(const struct dispatch *d, unsigned phase, uint32_t offset, char *buf, size_t size)
{
	size_t n = (size_t)snprintf(buf, size, "acut-%s-%s", d->o.id, d->phase[phase].name);

	if (offset)
		snprintf(buf + n, size - n, "-%u", offset);
}

/* The lines that mark an attempt in the log are read by dispatch_log.c. */
static int script_text(const struct dispatch *d, const struct array *a, char **ret, struct err *err)
{
	const char *phase = d->phase[a->phase].name;
	size_t size;
	FILE *f = open_memstream(ret, &size);

	if (!f)
		return err_set(err, ERR_NOMEM, "no memory for a script");
	fprintf(f, "#!/bin/sh\n# A task of acut-cluster: acut-task(1).\ni=$((SLURM_ARRAY_TASK_ID + %u))\n", a->offset);
	fprintf(f,
		"echo \"acut-cluster: %s $i begins on ${SLURMD_NODENAME:-$(uname -n)}, job $SLURM_ARRAY_JOB_ID, start ${SLURM_RESTART_COUNT:-0}\" >&2\n",
		phase);
	dispatch_quote(f, d->o.task);
	fputc(' ', f);
	dispatch_quote(f, d->o.work);
	fprintf(f, " %s \"$i\"\nr=$?\necho \"acut-cluster: %s $i ends with status $r\" >&2\nexit $r\n", phase, phase);
	if (fclose(f))
		return err_set(err, ERR_NOMEM, "no memory for a script");
	return 0;
}

/* afterok:1:2; "": none. */
static char *dependency(const struct dispatch *d, unsigned phase)
{
	const struct slurm *s = d->own;
	char *text = NULL;
	size_t size;
	FILE *f = open_memstream(&text, &size);

	if (!f)
		return NULL;
	/* Phases without tasks are passed over. */
	while (phase && !d->phase[phase - 1].tasks)
		phase--;
	for (size_t i = 0; phase && i < s->njob[phase - 1]; i++)
		fprintf(f, "%s:%u", i ? "" : "--dependency=afterok", s->job[phase - 1][i]);
	if (fclose(f)) {
		free(text);
		return NULL;
	}
	return text;
}

static const char *option(char *buf, size_t size, const char *name, const char *value)
{
	snprintf(buf, size, "--%s=%s", name, value);
	return buf;
}

static int call(struct dispatch *d, const struct array *a, const char *after, char **ret_out, struct err *err)
{
	char name[160], pattern[4096], output[4200], folder[4200], list[LIST_SIZE + 40], memory[40], time[40], comment[4200],
		more[3][300];
	char own[120], *script;
	const char **argv;
	size_t extra = 0;
	const struct dispatch_phase *phase = &d->phase[a->phase];
	const char *own_words[WORDS] = {
		"sbatch",    "--parsable", "--requeue",        "--open-mode=append", "--kill-on-invalid-dep=yes",
		"--nodes=1", "--ntasks=1", "--cpus-per-task=1"};
	const char *const given[3][2] = {{"partition", d->o.partition}, {"account", d->o.account}, {"qos", d->o.qos}};
	unsigned n = 8;
	int r;

	while (d->o.extra && d->o.extra[extra])
		extra++;
	argv = malloc((WORDS + extra + 1) * sizeof *argv);
	r = argv ? script_text(d, a, &script, err) : err_set(err, ERR_NOMEM, "no memory for a submission");
	if (r) {
		free(argv);
		return r;
	}
	memcpy(argv, own_words, sizeof own_words);
	name_of(d, a->phase, a->offset, own, sizeof own);
	argv[n++] = option(name, sizeof name, "job-name", own);
	snprintf(list, sizeof list, a->most ? "--array=%s%%%u" : "--array=%s", a->list, a->most);
	argv[n++] = list;
	dispatch_pattern(d->o.work, pattern, sizeof pattern);
	if (a->offset)
		snprintf(output, sizeof output, "--output=%s/log/%s-%u+%%a", pattern, phase->name, a->offset);
	else
		snprintf(output, sizeof output, "--output=%s/log/%s-%%a", pattern, phase->name);
	argv[n++] = output;
	argv[n++] = option(folder, sizeof folder, "chdir", d->o.work);
	snprintf(memory, sizeof memory, "--mem=%lluM", (unsigned long long)((a->need.memory + (1 << 20) - 1) >> 20));
	argv[n++] = memory;
	snprintf(time, sizeof time, "--time=%.0f", a->need.time < 60 ? 1 : (a->need.time + 59) / 60);
	argv[n++] = time;
	snprintf(comment, sizeof comment, "--comment=acut-cluster %s %.4000s", phase->name, d->o.work);
	argv[n++] = comment;
	if (*after)
		argv[n++] = after;
	for (int i = 0; i < 3; i++)
		if (given[i][1])
			argv[n++] = option(more[i], sizeof more[i], given[i][0], given[i][1]);
	for (size_t i = 0; i < extra; i++)
		argv[n++] = d->o.extra[i];
	argv[n] = NULL;
	r = dispatch_command(argv, script, COMMAND_S, ret_out, err);
	free(script);
	free(argv);
	return r;
}

/* The job of that name that has the first task of the list waiting or running; 0: there is none. */
static int find_again(struct dispatch *d, const struct array *a, uint32_t task, uint32_t *ret, struct err *err)
{
	char name[160], user[24], *text, *save = NULL;
	const char *const argv[] = {"squeue", "-h", "-r", "-n", name, "-u", user, "-o", "%F|%K|%T|%r|%j", NULL};
	int r;

	name_of(d, a->phase, a->offset, name, sizeof name);
	snprintf(user, sizeof user, "%u", d->o.user);
	r = dispatch_command(argv, NULL, COMMAND_S, &text, err);
	if (r)
		return r;
	*ret = 0;
	for (char *line = strtok_r(text, "\n", &save); line; line = strtok_r(NULL, "\n", &save)) {
		struct dispatch_row row;
		uint32_t from, to;

		if (!dispatch_row_read(d, line, &row) || !lives(row.state) || row.phase != a->phase)
			continue;
		while (dispatch_row_next(d, &row, &from, &to))
			if (task >= from && task <= to)
				*ret = row.job;
	}
	free(text);
	return 0;
}

/* Once: after a reply that did not come, the job is looked for by its name before it is submitted again. */
static int submit_array(struct dispatch *d, const struct array *a, uint32_t task, uint32_t *ret_job, struct err *err)
{
	char *after = dependency(d, a->phase), *out = NULL;
	int r = after ? 0 : err_set(err, ERR_NOMEM, "no memory for a dependency");

	*ret_job = 0;
	for (int i = 0; !r; i++) {
		r = call(d, a, after, &out, err);
		if (!r || !dispatch_is_no_answer(err) || i == AGAIN)
			break;
		dispatch_note(d, "%s; it is looked for by its name", err->message);
		dispatch_sleep(d, d->o.poll);
		if (d->o.stop && d->o.stop(d->o.ctx))
			break;
		err_clear(err);
		if (!find_again(d, a, task, ret_job, err) && *ret_job)
			break;
		err_clear(err);
		r = 0;
	}
	if (*ret_job)
		r = 0;
	else if (!r && !dispatch_job_read(out, ret_job))
		r = err_set(err, ERR_PROTO, "sbatch printed no number of a job: %.100s", out);
	free(after);
	free(out);
	return r;
}

/* As many of the tasks as fit into an array, and `most` at most. */
static void make_array(const struct dispatch *d, unsigned phase, const uint32_t *index, uint32_t n, uint32_t most,
		       struct array *ret)
{
	const struct slurm *s = d->own;
	uint32_t last = 0;

	*ret = (struct array){.phase = phase};
	ret->offset = (uint32_t)(index[0] / s->array_most * s->array_most);
	while (last < n && last < most && index[last] < ret->offset + s->array_most)
		last++;
	ret->n = dispatch_ranges(index, last, ret->offset, ret->list, sizeof ret->list);
}

/* Options.most is of the run, and Slurm keeps it for one array: what is submitted has its share of what is not used. */
struct share {
	uint32_t arrays; /* that may be submitted now */
	uint32_t most;   /* tasks of each at once; 0: any */
};

static int make_share(const struct dispatch *d, unsigned phase, const uint32_t *index, uint32_t n, struct share *ret,
		      struct err *err)
{
	const struct slurm *s = d->own;
	uint32_t live = 0;

	*ret = (struct share){UINT32_MAX, 0};
	if (!d->o.most)
		return 0;
	for (uint32_t i = 0; i < d->phase[phase].tasks; i++)
		live += lives(d->task[phase][i].state);
	if (live >= d->o.most)
		return err_set(err, ERR_BUSY, "%u tasks of phase %s wait or run, and --max-tasks allows no more now", live,
			       d->phase[phase].name);
	ret->arrays = n != 0;
	for (uint32_t k = 1; k < n; k++)
		ret->arrays += index[k] / s->array_most != index[k - 1] / s->array_most;
	ret->most = (d->o.most - live) / (ret->arrays ? ret->arrays : 1);
	ret->most += !ret->most; /* an array has one at least */
	return 0;
}

static int submit(struct dispatch *d, unsigned phase, const uint32_t *index, uint32_t n, const struct dispatch_need *need,
		  struct err *err)
{
	struct array *a = malloc(sizeof *a);
	uint32_t at = 0, job, most = UINT32_MAX;
	struct share share;
	int r = a ? ask_array_size(d, err) : err_set(err, ERR_NOMEM, "no memory for a list of tasks");

	if (!r)
		r = make_share(d, phase, index, n, &share, err);
	while (!r && at < n) {
		if (!share.arrays) {
			r = err_set(err, ERR_BUSY, "--max-tasks allows no more tasks of phase %s now", d->phase[phase].name);
			break;
		}
		make_array(d, phase, index + at, n - at, most, a);
		a->need = *need;
		a->most = share.most;
		r = submit_array(d, a, index[at], &job, err);
		if (r && dispatch_is_full(err)) {
			/* Fewer may fit; the rest is for later. */
			err->code = ERR_BUSY;
			r = a->n > 1 ? 0 : -ERR_BUSY;
			most = a->n / 2;
			if (!r)
				err_clear(err);
			continue;
		}
		for (uint32_t k = at; !r && k < at + a->n; k++) {
			d->task[phase][index[k]].state = DISPATCH_WAITING;
			d->task[phase][index[k]].job = job;
		}
		if (!r && !note_job(d->own, phase, job))
			r = err_set(err, ERR_NOMEM, "no memory for the list of jobs");
		at += a->n;
		share.arrays--;
	}
	free(a);
	return r;
}

/* ---- the rest ---- */

static void update_jobs(struct dispatch *d, const char *verb, const char *setting)
{
	struct slurm *s = d->own;

	for (unsigned p = 0; p < d->o.nphase; p++)
		for (size_t i = 0; i < s->njob[p]; i++) {
			char job[40];
			const char *const argv[] = {"scontrol", verb, job, setting, NULL};
			struct err err = ERR_INIT;

			snprintf(job, sizeof job, setting ? "JobId=%u" : "%u", s->job[p][i]);
			dispatch_command(argv, NULL, COMMAND_S, NULL, &err);
		}
}

/* A task that was put back waits for two minutes, which is of no use when a node is free: it may begin now. One that a node could
 * not start is held until somebody releases it: as often as a task may fail. */
static void hasten(struct dispatch *d)
{
	struct slurm *s = d->own;
	bool own_time = false;

	for (size_t i = 0; d->o.extra && d->o.extra[i]; i++)
		own_time |= !strncmp(d->o.extra[i], "--begin", 7) || !strncmp(d->o.extra[i], "-b", 2);
	if (s->not_launched && s->releases < 2 * d->o.attempts) {
		s->releases++;
		dispatch_note(d, "a node could not start a task: it is released");
		update_jobs(d, "release", NULL);
	}
	if (s->begin_later && !own_time)
		update_jobs(d, "update", "StartTime=now");
	s->begin_later = s->not_launched = false;
}

static void pause_slurm(struct dispatch *d)
{
	hasten(d);
	dispatch_sleep(d, d->o.poll);
}

static bool job_lives(const struct dispatch *d, uint32_t job)
{
	for (unsigned p = 0; p < d->o.nphase; p++)
		for (uint32_t i = 0; i < d->phase[p].tasks; i++)
			if (d->task[p][i].job == job && lives(d->task[p][i].state))
				return true;
	return false;
}

/* Of jobs that scancel could not end, some have ended meanwhile. What it said of the first is the error if one still lives. */
static int look_again(struct dispatch *d, const uint32_t *job, size_t n, struct err *err)
{
	struct err of_look = ERR_INIT;

	dispatch_sleep(d, d->o.poll);
	if (look(d, &of_look))
		return -(int)err->code;
	for (size_t i = 0; i < n; i++)
		if (job_lives(d, job[i]))
			return -(int)err->code;
	err_clear(err);
	return 0;
}

/* The last phase first, so that nothing begins meanwhile. One that cannot be cancelled keeps no other from it. */
static int cancel(struct dispatch *d, uint32_t *ret_n, struct err *err)
{
	struct slurm *s = d->own;
	size_t all = 0, nleft = 0;
	uint32_t *left;
	int r = 0;

	for (unsigned p = 0; p < d->o.nphase; p++)
		all += s->njob[p];
	left = malloc((all + 1) * sizeof *left);
	if (!left)
		return err_set(err, ERR_NOMEM, "no memory for the list of jobs");
	for (unsigned p = d->o.nphase; p-- > 0;)
		for (size_t i = 0; i < s->njob[p]; i++) {
			char job[16];
			const char *const argv[] = {"scancel", job, NULL};
			struct err more = ERR_INIT;

			snprintf(job, sizeof job, "%u", s->job[p][i]);
			if (dispatch_command(argv, NULL, COMMAND_S, NULL, err->code ? &more : err))
				left[nleft++] = s->job[p][i];
			else
				++*ret_n;
		}
	if (nleft)
		r = look_again(d, left, nleft, err);
	free(left);
	return r;
}

/* Nodes that a restart of the controller has drained, and jobs that it then holds. */
static void troubles(struct dispatch *d, void (*each)(void *, const char *, const char *), void *ctx)
{
	const char *argv[] = {"sinfo", "-h", "-N", "-t", "drain,drng,down,fail", "-o", "%N|%T|%E", NULL, NULL, NULL};
	char *text, *save = NULL, last[64] = "";
	struct slurm *s = d->own;
	struct err err = ERR_INIT;

	if (d->o.partition) {
		argv[7] = "-p";
		argv[8] = d->o.partition;
		if (strlen(d->o.partition) > 200)
			return;
	}
	if (!dispatch_command(argv, NULL, COMMAND_S, &text, &err)) {
		for (char *line = strtok_r(text, "\n", &save); line; line = strtok_r(NULL, "\n", &save)) {
			char *state = strchr(line, '|'), *reason = state ? strchr(state + 1, '|') : NULL, what[300], command[200];

			if (!reason)
				continue;
			*state++ = *reason++ = 0;
			if (!strcmp(line, last))
				continue;
			snprintf(last, sizeof last, "%s", line);
			snprintf(what, sizeof what, "node %s is %s: %s", line, state, reason);
			snprintf(command, sizeof command, "scontrol update nodename=%s state=resume", line);
			each(ctx, what, strstr(reason, "Duplicate jobid") || !strncmp(state, "down", 4) ? command : "");
		}
		free(text);
	}
	if (s->held)
		for (unsigned p = 0; p < d->o.nphase; p++)
			for (size_t i = 0; i < s->njob[p]; i++) {
				char what[100], command[60];

				snprintf(what, sizeof what, "tasks of job %u may be held", s->job[p][i]);
				snprintf(command, sizeof command, "scontrol release %u", s->job[p][i]);
				each(ctx, what, command);
			}
}

static void log_name(const struct dispatch *d, unsigned phase, uint32_t index, char buf[96])
{
	const struct slurm *s = d->own;
	const uint64_t offset = s->array_most ? index / s->array_most * s->array_most : 0;

	if (offset)
		snprintf(buf, 96, "%s-%llu+%llu", d->phase[phase].name, (unsigned long long)offset,
			 (unsigned long long)(index - offset));
	else
		snprintf(buf, 96, "%s-%u", d->phase[phase].name, index);
}

const struct dispatch_scheduler dispatch_slurm = {
	.name = "slurm",
	.check = check,
	.begin = begin,
	.end = end,
	.look = look,
	.submit = submit,
	.pause = pause_slurm,
	.cancel = cancel,
	.troubles = troubles,
	.log_name = log_name,
	.late = true,
};
