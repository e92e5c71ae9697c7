/*
 * complete N WORD...: what could stand as the Nth of the words (the 0th is acutctl itself), for the shells, whose
 * functions (acutctl.bash, _acutctl) only show it. One source: the tables of commands, verbs and options, where
 * capitals name a kind of word (JOB, DATASET, ...) and small letters are the word itself.
 *
 * A line a candidate: the word, a tab, what it is. Or, once: ":files", ":files .las .laz" or ":folders". What the
 * tables know comes first; what only the daemon knows is asked with a limit of a second ($ACUT_COMPLETE_SECONDS), of a daemon
 * that runs: none is started, and whatever goes wrong is silence.
 */
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "ctl.h"
#include "parse.h"

enum { LIMIT_SECONDS = 1, NEWEST = 100 };

struct line {
	struct ctl *ctl;
	char **word; /* up to the one to be completed */
	unsigned n;
	const char *at;                    /* what is there of it */
	const struct ctl_command *command; /* NULL: not yet said */
	const struct ctl_verb *verb;
	const char *plain[8]; /* words behind command and verb */
	unsigned nplain;
	const struct ctl_option *option; /* whose value it is; NULL: none's */
	bool ended;                      /* "--" came before it */
	bool connected;
};

static void offer(const struct line *l, const char *word, const char *what)
{
	if (strncmp(word, l->at, strlen(l->at)) || strpbrk(word, "\n\t"))
		return;
	printf("%s\t%s\n", word, what);
}

/* ---- what the daemon knows ---- */

static bool daemon_there(struct line *l)
{
	if (!l->connected) {
		const char *set = getenv("ACUT_COMPLETE_SECONDS");
		unsigned limit = set ? (unsigned)strtoul(set, NULL, 10) : 0;

		fflush(stdout);
		alarm(limit ? limit : LIMIT_SECONDS);
		l->connected = ctl_connect_quietly(l->ctl);
	}
	return l->connected;
}

static void offer_dataset(void *ctx, const struct acut_dataset *d)
{
	char what[64], count[32];

	snprintf(what, sizeof(what), "%s points", term_count(d->points, count));
	offer(ctx, d->name, what);
}

static void offer_removed(void *ctx, const struct acut_dataset *d)
{
	offer(ctx, d->name, "removed");
}

static void offer_geoid(void *ctx, const struct acut_geoid *g)
{
	offer(ctx, g->name, "geoid grid");
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

static void offer_jobs(struct line *l)
{
	const char *name = l->command->name;
	struct jobs jobs = {.wanted = !strcmp(name, "cancel") ? is_open :
				      !strcmp(name, "rm")     ? is_over :
				      !strcmp(name, "fetch")  ? is_made :
								NULL};
	char word[24];

	if (acut_jobs(l->ctl->acut, keep_job, &jobs))
		return;
	for (size_t i = jobs.n; i-- > 0 && jobs.n - i <= NEWEST;) {
		snprintf(word, sizeof(word), "%llu", (unsigned long long)jobs.row[i % NEWEST].id);
		offer(l, word, jobs.row[i % NEWEST].what);
	}
}

static void offer_generation(void *ctx, const struct acut_generation *g)
{
	char word[24], what[80], time[32];

	if (!g->readable)
		return;
	snprintf(word, sizeof(word), "%llu", (unsigned long long)g->number);
	snprintf(what, sizeof(what), "%.20s %s", g->kind, term_time(g->time_us, time));
	offer(ctx, word, what);
}

/* Of the dataset on the line, or of that of the job. */
static void offer_generations(struct line *l)
{
	const struct acut_log_sink sink = {.generation = offer_generation, .ctx = l};
	const struct acut_job *job;
	char name[256];
	uint64_t id;

	if (!l->nplain)
		return;
	snprintf(name, sizeof(name), "%s", l->plain[0]);
	if (!strcmp(l->command->name, "fetch")) {
		if (!parse_u64(name, &id) || acut_job_wait(l->ctl->acut, id, false, NULL, NULL, &job))
			return;
		snprintf(name, sizeof(name), "%s", job->dataset);
	}
	acut_dataset_log(l->ctl->acut, name, &sink);
}

/* ---- kinds of words ---- */

static void offer_files(const char *const *extensions, size_t n)
{
	fputs(":files", stdout);
	for (size_t i = 0; i < n; i++)
		printf(" %s", extensions[i]);
	putchar('\n');
}

static void offer_commands(struct line *l)
{
	size_t n;
	const struct ctl_command *row = ctl_command_rows(&n);

	for (size_t i = 0; i < n; i++)
		if (row[i].run && !row[i].hidden)
			offer(l, row[i].name, row[i].help);
}

static void offer_formats(struct line *l, bool in)
{
	size_t n;
	const struct format *const *out = format_rows(&n);

	for (size_t i = 0; in && ctl_formats_input[i].name; i++)
		offer(l, ctl_formats_input[i].name, ctl_formats_input[i].help);
	for (size_t i = 0; !in && i < n; i++)
		offer(l, out[i]->name, out[i]->help);
}

static void offer_inputs(void)
{
	const char *all[16];
	size_t n = 0;

	while (n < 16 && ctl_formats_input[n].name) {
		all[n] = ctl_formats_input[n].extensions;
		n++;
	}
	for (size_t i = 0; n < 16 && ctl_formats_archive[i].name; i++)
		all[n++] = ctl_formats_archive[i].extensions;
	offer_files(all, n);
}

static bool is(const char *word, size_t n, const char *kind)
{
	return strlen(kind) == n && !memcmp(word, kind, n);
}

/* One alternative of a usage: a kind, or the word itself. */
static void offer_kind(struct line *l, const char *kind, size_t n, const char *what)
{
	static const char *const pgm[] = {".pgm"};
	char word[64];

	if (is(kind, n, "INPUT"))
		offer_inputs();
	else if (is(kind, n, "FILE.pgm"))
		offer_files(pgm, 1);
	else if (is(kind, n, "FILE") || is(kind, n, "OUT") || is(kind, n, "PATH"))
		offer_files(NULL, 0);
	else if (is(kind, n, "DIR") || is(kind, n, "FOLDER"))
		fputs(":folders\n", stdout);
	else if (is(kind, n, "COMMAND"))
		offer_commands(l);
	else if (is(kind, n, "FORMAT") || is(kind, n, "INPUT-FORMAT"))
		offer_formats(l, n > 6);
	else if (is(kind, n, "DATASET") && daemon_there(l))
		acut_datasets(l->ctl->acut, NULL, offer_dataset, l);
	else if (is(kind, n, "REMOVED") && daemon_there(l))
		acut_datasets_removed(l->ctl->acut, offer_removed, l);
	else if (is(kind, n, "GEOID") && daemon_there(l))
		acut_geoids(l->ctl->acut, offer_geoid, l);
	else if (is(kind, n, "JOB") && daemon_there(l))
		offer_jobs(l);
	else if (is(kind, n, "GENERATION") && daemon_there(l))
		offer_generations(l);
	else if (n && n < sizeof(word) && kind[0] >= 'a' && kind[0] <= 'z') {
		snprintf(word, sizeof(word), "%.*s", (int)n, kind);
		offer(l, word, what);
	}
}

/* "low|normal|high", "DATASET", "X,Y,Z|auto". */
static void offer_alternatives(struct line *l, const char *text, size_t size, const char *what)
{
	while (size) {
		const char *bar = memchr(text, '|', size);
		size_t n = bar ? (size_t)(bar - text) : size;

		offer_kind(l, text, n, what);
		n += bar != NULL;
		text += n;
		size -= n;
	}
}

/* ---- the line ---- */

/* What the command takes, or the verb where it has some. */
static bool takes(const struct line *l, const struct ctl_option *o)
{
	unsigned groups = l->command ? l->command->groups : CTL_ALL;
	size_t n = strlen(o->name);

	if (o->kind == CTL_LATER || !(o->groups & groups))
		return false;
	if (!l->verb || (o->groups & CTL_ALL))
		return true;
	for (const char *at = l->verb->options; at && (at = strstr(at, o->name)); at += n)
		if ((at == l->verb->options || at[-1] == ' ') && (!at[n] || at[n] == ' '))
			return true;
	return false;
}

static const struct ctl_option *find(const char *word)
{
	size_t n, len = strcspn(word, "=");
	const struct ctl_option *row = ctl_option_rows(&n);

	for (size_t i = 0; i < n; i++)
		if (word[1] == '-' ? is(word + 2, len - 2, row[i].name) : row[i].letter == word[1] && !word[2])
			return &row[i];
	return NULL;
}

/* Reads the words before the one that is asked for. "=" stands alone where the shell took --option=value apart. */
static void read_line(struct line *l)
{
	for (unsigned i = 1; i < l->n; i++) {
		const char *word = l->word[i];
		const struct ctl_option *o;

		if (!l->ended && !strcmp(word, "--")) {
			l->ended = true;
		} else if (!l->ended && word[0] == '-' && word[1]) {
			o = find(word);
			if (!o || !o->value || strchr(word, '='))
				continue;
			if (i + 1 < l->n && !strcmp(l->word[i + 1], "="))
				i++;
			if (i + 1 >= l->n) {
				l->option = o;
			} else {
				i++;
				if (!strcmp(o->name, "socket"))
					l->ctl->args.socket = l->word[i];
			}
		} else if (!l->command) {
			l->command = ctl_command_find(word);
			if (!l->command)
				l->nplain = sizeof(l->plain) / sizeof(*l->plain);
		} else if (l->command->verbs && !l->verb) {
			l->verb = ctl_verb_find(l->command, word);
		} else if (l->nplain < sizeof(l->plain) / sizeof(*l->plain)) {
			l->plain[l->nplain++] = word;
		}
	}
}

static void offer_options(struct line *l)
{
	size_t n;
	const struct ctl_option *row = ctl_option_rows(&n);
	char word[64];

	for (size_t i = 0; i < n; i++) {
		if (!takes(l, &row[i]))
			continue;
		snprintf(word, sizeof(word), "--%s", row[i].name);
		offer(l, word, row[i].help);
	}
}

/* The word of the usage that stands in this place: the nth, or the last one if it goes on ("..."). */
static void offer_words(struct line *l)
{
	const char *usage = l->verb ? l->verb->usage : l->command->usage;
	unsigned at = 0;

	for (const char *word = usage + strcspn(usage, " "); *(word += strspn(word, " ")) && *word != '-';) {
		size_t size = strcspn(word, " "), from = *word == '[', to = size - (word[size - 1] == ']');
		bool goes_on = to > 3 && !memcmp(word + to - 3, "...", 3);

		if (goes_on)
			to -= word[to - 4] == ']' ? 4 : 3;
		if (at++ == l->nplain || goes_on) {
			offer_alternatives(l, word + from, to - from, "");
			return;
		}
		word += size;
	}
}

static void offer_verbs(struct line *l, const struct ctl_command *command)
{
	for (const struct ctl_verb *v = command ? command->verbs : NULL; v && v->name; v++)
		offer(l, v->name, v->help);
}

int ctl_complete_run(struct ctl *ctl)
{
	static char none[] = "";
	struct line l = {.ctl = ctl, .at = none};
	uint64_t n;

	if (!parse_u64(ctl->args.word[0], &n) || !n || n >= ctl->args.nword)
		return CTL_USAGE;
	l.word = ctl->args.word + 1;
	l.n = (unsigned)n;
	l.at = n < ctl->args.nword - 1 ? l.word[n] : none;
	if (!strcmp(l.at, "="))
		l.at = none;
	signal(SIGALRM, SIG_DFL);
	read_line(&l);
	if (!l.option && !l.ended && !strncmp(l.at, "--", 2) && strchr(l.at, '=')) {
		l.option = find(l.at);
		l.at = strchr(l.at, '=') + 1;
	}
	if (l.option && l.option->value)
		offer_alternatives(&l, l.option->value, strlen(l.option->value), l.option->help);
	else if (!l.ended && l.at[0] == '-')
		offer_options(&l);
	else if (!l.command)
		l.nplain ? (void)0 : offer_commands(&l);
	else if (l.command->verbs && !l.verb)
		offer_verbs(&l, l.command);
	else if (l.command->run == ctl_help_run && l.nplain)
		offer_verbs(&l, l.nplain == 1 ? ctl_command_find(l.plain[0]) : NULL);
	else
		offer_words(&l);
	return CTL_DONE;
}
