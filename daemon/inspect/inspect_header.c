/* The header of one file, by a task. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "inspect.h"
#include "io.h"

struct info_ask {
	struct sched_task task;
	struct core *core;
	int fd, r;
	char *name, *format, *columns;
	bool decimal_comma;
	struct input_info info;
	char info_format[16];
	struct err err;
	void (*probed)(void *token, const struct err *why, const char *name, const struct input_info *);
	void *token;
};

static void info_run(struct sched_task *t)
{
	struct info_ask *a = (struct info_ask *)t;
	/* It is described only, so its plane does not matter, nor that it ends early. */
	struct input_options options = {
		.format = *a->format ? a->format : NULL,
		.columns = *a->columns ? a->columns : NULL,
		.decimal_comma = a->decimal_comma,
		.accept_truncated = true,
		.planar = true,
	};
	struct client_file id;
	struct input *in = NULL;

	a->r = client_file_check(a->fd, a->name, &id, &a->err);
	if (!a->r)
		a->r = input_open(a->fd, a->name, &options, &in, &a->err);
	if (a->r) {
		err_add_file(&a->err, a->name);
		return;
	}
	a->info = *input_info(in);
	snprintf(a->info_format, sizeof a->info_format, "%s", a->info.format);
	a->info.format = a->info_format;
	a->info.coords.name = a->name;
	input_close(in);
}

static void info_done(struct sched_task *t)
{
	struct info_ask *a = (struct info_ask *)t;

	if (t->ran)
		sched_give(a->core->p.sched, t->name, t->bytes);
	else
		a->r = err_set(&a->err, ERR_CANCELLED, "the daemon is stopping");
	core_background_done(a->core);
	a->probed(a->token, a->r ? &a->err : NULL, a->name, a->r ? NULL : &a->info);
	io_close(a->fd);
	free(a->name);
	free(a->format);
	free(a->columns);
	free(a);
}

void inspect_header(struct core *core, int fd, const char *name, const char *format, const char *columns, bool decimal_comma,
		    const struct peer *peer,
		    void (*probed)(void *token, const struct err *why, const char *name, const struct input_info *), void *token)
{
	struct info_ask *a = calloc(1, sizeof *a);
	struct err err = ERR_INIT;

	if (a) {
		a->name = strdup(name);
		a->format = strdup(format);
		a->columns = strdup(columns);
		a->decimal_comma = decimal_comma;
	}
	if (!a || !a->name || !a->format || !a->columns) {
		err_set(&err, ERR_NOMEM, "no memory for a request");
		if (a) {
			free(a->name);
			free(a->format);
			free(a->columns);
			free(a);
		}
		io_close(fd);
		probed(token, &err, name, NULL);
		return;
	}
	a->task = (struct sched_task){
		.run = info_run,
		.done = info_done,
		.owner = {.uid = peer->uid, .flow = ++core->last_flow},
		.reads = true,
		.priority = SCHED_FIRST,
		.name = LEDGER_INPUT,
		.bytes = input_bytes(),
	};
	a->core = core;
	a->fd = fd;
	a->err = ERR_INIT;
	a->probed = probed;
	a->token = token;
	core_background(core, &a->task);
}
