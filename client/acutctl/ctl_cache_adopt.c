/*
 * cache adopt WORK: the finished domains of a run of acut-cluster into the daemon's store.
 *
 * The packs are those that the records of the run's tasks name, of the tasks that are finished. The daemon opens no path: it gets
 * a descriptor for each, and checks all of it.
 */
#include <string.h>

#include "ctl.h"
#include "io.h"
#include "parse.h"
#include "term.h"
#include "work.h"

struct adoption {
	struct session_progress progress; /* first: the progress has the same context */
	struct work *work;
	struct work_record *record; /* of the last pack: has its name */
	uint32_t task, missing;     /* the next one; those that are not finished */
	int fd;
	struct err err;
};

/* The pack among the results of a task; NULL: it has none, since it had nothing to do. */
static const struct work_file *pack_of(const struct work_record *r)
{
	for (size_t i = 0; i < r->nfile; i++)
		if (!strncmp(r->file[i].name, WORK_IN_MESH "/pack-", strlen(WORK_IN_MESH "/pack-")))
			return &r->file[i];
	return NULL;
}

static int next(void *ctx, const char **ret_name, int *ret_fd)
{
	struct adoption *a = ctx;
	const struct work_file *pack = NULL;
	int r = 0;

	a->fd = io_close(a->fd);
	for (; !r && !pack && a->task < work_about(a->work)->tasks[WORK_MESH]; a->task++) {
		a->record = work_record_free(a->record);
		r = work_record_look(a->work, WORK_MESH, a->task, &a->record, &a->err);
		a->missing += r == WORK_E_ABSENT;
		if (!r)
			pack = pack_of(a->record);
		r = r == WORK_E_ABSENT ? 0 : r;
	}
	if (!r && pack)
		r = work_file_open(a->work, pack->name, pack->size, &a->fd, &a->err);
	*ret_name = pack ? pack->name : NULL;
	*ret_fd = a->fd;
	return r ? -1 : 0;
}

static void progress(void *ctx, const struct acut_progress *now)
{
	struct adoption *a = ctx;
	char at[32], all[32];

	if (a->progress.on)
		console_progress(&a->progress.session->console, "task %u of %u: %s of %s", a->task,
				 work_about(a->work)->tasks[WORK_MESH], parse_size_text(now->points, at),
				 parse_size_text(now->points_total, all));
}

static void print(const struct console *c, const struct adoption *a, const struct acut_cache_adopted *got)
{
	char n[32], there[32], size[32];

	if (c->json) {
		struct term_json j = console_json(c);

		term_json_u64(&j, "packs", got->packs);
		term_json_u64(&j, "domains", got->domains);
		term_json_u64(&j, "bytes", got->bytes);
		term_json_u64(&j, "there", got->there);
		term_json_u64(&j, "flat", got->flat);
		term_json_u64(&j, "unfinished", a->missing);
		term_json_end(&j);
		return;
	}
	fprintf(c->report, "%s domains of %s adopted; %s were there\n", term_count(got->domains, n),
		parse_size_text(got->bytes, size), term_count(got->there, there));
	if (got->flat)
		fprintf(c->report, "%s domains have no triangles and are of no use to a daemon\n", term_count(got->flat, n));
	if (a->missing)
		fprintf(c->report, "%u tasks of the run are not finished: call this again when they are\n", a->missing);
}

int ctl_cache_adopt(struct program *ctl)
{
	struct session *session = &ctl->session;
	struct adoption a = {.fd = -1, .err = ERR_INIT};
	struct acut_cache_adopted got;
	int status = 0;

	if (work_open(ctl->line.word[0], &a.work, &a.err))
		return session_error(session, &a.err);
	session_progress_init(&a.progress, session);
	status = session_connect(session);
	if (!status) {
		int r = acut_cache_adopt(session->acut, next, progress, &a, &got);

		console_progress_clear(&session->console);
		if (r)
			status = a.err.code ? session_error(session, &a.err) : session_error_acut(session);
		else
			print(&session->console, &a, &got);
	}
	io_close(a.fd);
	work_record_free(a.record);
	work_close(a.work);
	return status;
}
