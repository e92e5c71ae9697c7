/*
 * Candidates of kinds of words, for completion (cli_complete). What only the daemon knows is asked of one that runs, within a
 * second ($ACUT_COMPLETE_SECONDS): none is started, and a failure offers nothing.
 */
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "ctl.h"
#include "parse.h"

enum { LIMIT_SECONDS = 1, NEWEST = 100 };

/* ---- what the daemon knows ---- */

static bool is_connected(struct program *ctl)
{
	const char *set = getenv("ACUT_COMPLETE_SECONDS");
	unsigned limit = set ? (unsigned)strtoul(set, NULL, 10) : 0;

	if (ctl->session.acut)
		return true;
	fflush(stdout);
	signal(SIGALRM, SIG_DFL);
	alarm(limit ? limit : LIMIT_SECONDS);
	return session_connect_running(&ctl->session);
}

static void offer_dataset(void *ctx, const struct acut_dataset *d)
{
	char what[64], count[32];

	snprintf(what, sizeof(what), "%s points", term_count(d->points, count));
	cli_offer(ctx, d->name, what);
}

static void offer_removed(void *ctx, const struct acut_dataset *d)
{
	cli_offer(ctx, d->name, "removed");
}

static void offer_geoid(void *ctx, const struct acut_geoid *g)
{
	cli_offer(ctx, g->name, "geoid grid");
}

/* The newest ones, in a ring. */
struct jobs {
	bool (*wanted)(const struct acut_job *);
	struct {
		uint64_t id;
		char what[80];
	} row[NEWEST];
	size_t n;
};

static void keep_job(void *ctx, const struct acut_job *job)
{
	struct jobs *jobs = ctx;

	if (jobs->wanted && !jobs->wanted(job))
		return;
	jobs->row[jobs->n % NEWEST].id = job->id;
	snprintf(jobs->row[jobs->n % NEWEST].what, sizeof(jobs->row[0].what), "%s %.60s", job->state, job->dataset);
	jobs->n++;
}

static bool is_open(const struct acut_job *job)
{
	return !job->final;
}

static bool is_over(const struct acut_job *job)
{
	return job->final;
}

static bool is_made(const struct acut_job *job)
{
	return !job->has_error && strcmp(job->state, "cancelled");
}

static void offer_jobs(struct cli_typed *t)
{
	const char *name = t->command->name;
	struct jobs jobs = {.wanted = !strcmp(name, "cancel") ? is_open :
				      !strcmp(name, "rm")     ? is_over :
				      !strcmp(name, "fetch")  ? is_made :
								NULL};
	char word[24];

	if (acut_jobs(t->program->session.acut, keep_job, &jobs))
		return;
	for (size_t i = jobs.n; i-- > 0 && jobs.n - i <= NEWEST;) {
		snprintf(word, sizeof(word), "%llu", (unsigned long long)jobs.row[i % NEWEST].id);
		cli_offer(t, word, jobs.row[i % NEWEST].what);
	}
}

static void offer_generation(void *ctx, const struct acut_generation *g)
{
	char word[24], what[80], time[32];

	if (!g->readable)
		return;
	snprintf(word, sizeof(word), "%llu", (unsigned long long)g->number);
	snprintf(what, sizeof(what), "%.20s %s", g->kind, term_time(g->time_us, time));
	cli_offer(ctx, word, what);
}

/* Generations of the dataset on the line, or of the dataset of the job. */
static void offer_generations(struct cli_typed *t)
{
	const struct acut_log_sink sink = {.generation = offer_generation, .ctx = t};
	const struct acut_job *job;
	char name[256];
	uint64_t id;

	if (!t->nword)
		return;
	snprintf(name, sizeof(name), "%s", t->word[0]);
	if (!strcmp(t->command->name, "fetch")) {
		if (!parse_u64(name, &id) || acut_job_wait(t->program->session.acut, id, false, NULL, NULL, &job))
			return;
		snprintf(name, sizeof(name), "%s", job->dataset);
	}
	acut_dataset_log(t->program->session.acut, name, &sink);
}

/* ---- kinds of words ---- */

static void offer_formats(const struct cli_typed *t, bool in)
{
	size_t n;
	const struct format *const *out = format_rows(&n);

	for (const struct ctl_input_format *f = ctl_input_formats; in && f->name; f++)
		cli_offer(t, f->name, f->help);
	for (size_t i = 0; !in && i < n; i++)
		cli_offer(t, out[i]->name, out[i]->help);
}

static void offer_inputs(void)
{
	fputs(":files", stdout);
	for (const struct ctl_input_format *f = ctl_input_formats; f->name; f++)
		printf(" %s", f->extensions);
	for (const struct ctl_input_format *f = ctl_input_archives; f->name; f++)
		printf(" %s", f->extensions);
	putchar('\n');
}

static bool offer(struct cli_typed *t, const char *kind, size_t n)
{
	if (cli_is_kind(kind, n, "INPUT"))
		offer_inputs();
	else if (cli_is_kind(kind, n, "FILE.pgm"))
		puts(":files .pgm");
	else if (cli_is_kind(kind, n, "FORMAT") || cli_is_kind(kind, n, "INPUT-FORMAT"))
		offer_formats(t, n > 6);
	else if (cli_is_kind(kind, n, "DATASET") && is_connected(t->program))
		acut_datasets(t->program->session.acut, NULL, offer_dataset, t);
	else if (cli_is_kind(kind, n, "REMOVED") && is_connected(t->program))
		acut_datasets_removed(t->program->session.acut, offer_removed, t);
	else if (cli_is_kind(kind, n, "GEOID") && is_connected(t->program))
		acut_geoids(t->program->session.acut, offer_geoid, t);
	else if (cli_is_kind(kind, n, "JOB") && is_connected(t->program))
		offer_jobs(t);
	else if (cli_is_kind(kind, n, "GENERATION") && is_connected(t->program))
		offer_generations(t);
	else
		return false;
	return true;
}

int ctl_complete(const struct cli *cli, int argc, char **argv, struct program *ctl)
{
	return cli_complete(cli, argc, argv, ctl, offer);
}
