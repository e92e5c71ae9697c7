/*
 * dispatch-run SCHEDULER WORK ID TASK POLL COMMAND PHASE=N...: the room cluster/dispatch with tasks of a test's own. A task is
 * done if WORK/done/PHASE-INDEX exists. COMMAND: submit, wait, cancel, show. Prints "PHASE done running waiting absent" a line at
 * the end.
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "dispatch.h"
#include "err.h"

struct run {
	const char *work;
	struct dispatch_phase phase[DISPATCH_PHASES];
	unsigned n;
};

static volatile sig_atomic_t stopped;

static void on_signal(int s)
{
	stopped = s;
}

static bool done(void *ctx, unsigned phase, uint32_t index)
{
	const struct run *r = ctx;
	char path[4096];

	snprintf(path, sizeof path, "%s/done/%s-%u", r->work, r->phase[phase].name, index);
	return access(path, F_OK) == 0;
}

static bool stop(void *ctx)
{
	return stopped;
}

static void note(void *ctx, const char *text)
{
	fprintf(stderr, "note: %s\n", text);
}

static void trouble(void *ctx, const char *what, const char *command)
{
	printf("trouble: %s: %s\n", what, command);
}

static int act(struct dispatch *d, const char *command, struct err *err)
{
	uint32_t n;
	int r;

	if (!strcmp(command, "wait"))
		return dispatch_wait(d, err);
	r = dispatch_look(d, err);
	if (!r && !strcmp(command, "submit"))
		r = dispatch_submit(d, false, err);
	if (!r && !strcmp(command, "cancel"))
		r = dispatch_cancel(d, &n, err);
	if (!r && !strcmp(command, "show"))
		dispatch_troubles(d, trouble, NULL);
	return r;
}

int main(int argc, char **argv)
{
	struct run run = {0};
	struct dispatch_options o = {.phase = run.phase, .ctx = &run, .done = done, .stop = stop, .note = note, .patience = 5};
	char *extra = getenv("DISPATCH_EXTRA");
	const char *list[128] = {0};
	struct dispatch *d = NULL;
	struct err err = ERR_INIT;
	char text[1600], script[4096];
	size_t n;
	int r;

	if (argc < 8)
		return 2;
	for (size_t i = 0; extra && i < sizeof list / sizeof *list - 1; i++)
		list[i] = strtok(i ? NULL : extra, " ");
	signal(SIGTERM, on_signal);
	signal(SIGINT, on_signal);
	run.work = o.work = argv[2];
	o.id = argv[3];
	o.task = argv[4];
	o.poll = atof(argv[5]);
	o.most = getenv("DISPATCH_MOST") ? (unsigned)atoi(getenv("DISPATCH_MOST")) : 0;
	o.user = getenv("DISPATCH_USER") ? (unsigned)atoi(getenv("DISPATCH_USER")) : (unsigned)getuid();
	o.extra = extra ? list : NULL;
	snprintf(script, sizeof script, "%s/script", argv[2]);
	o.script = script;
	for (int i = 7; i < argc && run.n < DISPATCH_PHASES; i++) {
		char *name = argv[i], *equal = strchr(name, '=');

		*equal = 0;
		run.phase[run.n++] = (struct dispatch_phase){name, (uint32_t)atoi(equal + 1), 64 << 20, 600};
	}
	o.nphase = run.n;
	r = dispatch_new(argv[1], &o, &d, &err);
	if (!r)
		r = act(d, argv[6], &err);
	if (r < 0)
		fprintf(stderr, "error: %s\n", err_format(&err, text, sizeof text));
	for (unsigned p = 0; d && p < run.n; p++) {
		const struct dispatch_counts c = dispatch_counts(d, p);

		printf("%s %u %u %u %u\n", run.phase[p].name, c.done, c.running, c.waiting, c.absent);
	}
	for (size_t i = 0; d && i < (dispatch_reasons(d, &n), n); i++)
		printf("reason %s %u\n", dispatch_reasons(d, &n)[i].text, dispatch_reasons(d, &n)[i].n);
	dispatch_free(d);
	return r < 0 ? 1 : r ? 3 : 0;
}
