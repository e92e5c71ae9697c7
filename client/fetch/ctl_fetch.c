/* A job's mesh into a run of outputs, and the report at the end. */
#include <stdlib.h>
#include <string.h>

#include "ctl_fetch.h"

const char *ctl_mesh_index(const struct ctl_fetch_options *opt)
{
	return opt->tile ? OUTPUTS_TILES_INDEX : OUTPUTS_LEVELS_INDEX;
}

static void warn_no_tiles(const struct ctl_mesh *m)
{
	const struct acut_report *p = &m->job->report;
	char count[32];

	if (m->opt->tile && !m->out->tiles && !m->out->no_lines && p->vertices)
		console_warn(m->console, "%s %s in no tile, since there are no triangles%s: without --tile they are written",
			     term_count(p->vertices, count), p->vertices == 1 ? "vertex lies" : "vertices lie",
			     p->triangles ? " but those that are left out" : "");
}

/* One for all outputs: an interval that is more than the relief is given by mistake. */
const char *ctl_mesh_no_lines(const struct ctl_mesh *m, char buf[CTL_MESH_NOTE])
{
	const char *first = NULL;
	char others[32] = " has";
	unsigned n = 0;

	for (unsigned i = 0; i < ctl_fetch_count(m->opt); i++)
		if (m->out->no_lines >> i & 1) {
			first = first ? first : m->opt->output[i + 1].path;
			n++;
		}
	if (n > 1)
		snprintf(others, sizeof(others), " and %u other%s have", n - 1, n == 2 ? "" : "s");
	snprintf(buf, CTL_MESH_NOTE, "%.300s%s no line: the mesh has no height of a contour (--interval, --base)", n ? first : "",
		 others);
	buf[0] = n ? buf[0] : 0;
	return buf;
}

static int publish(struct session *session, const struct ctl_fetch_options *opt, const struct acut_job *job, struct outputs *run,
		   const struct ctl_staged *staged)
{
	struct outputs_report out;
	const struct ctl_mesh mesh = {&session->console, opt, job, &out, staged};
	struct err err = ERR_INIT;
	char note[CTL_MESH_NOTE], bound[CTL_MESH_NOTE];

	outputs_about(run, job->id, job->dataset, job->generation);
	if (outputs_publish(run, &err))
		return session_error(session, &err);
	outputs_report(run, &out);
	console_progress_clear(&session->console);
	ctl_mesh_warn_edges(&mesh);
	ctl_mesh_warn_trimmed(&mesh);
	ctl_report_warn_crowded(&session->console, &job->report);
	warn_no_tiles(&mesh);
	console_note(&session->console, "%s", ctl_mesh_no_lines(&mesh, note));
	console_note(&session->console, "%s", ctl_fetch_bound(job, opt->max_error, bound));
	if (session->console.json)
		ctl_mesh_json(&mesh);
	else
		ctl_mesh_text(&mesh);
	return 0;
}

/* The run's sink and the progress line share one context. */
struct feed {
	struct acut_mesh_sink sink;
	struct outputs *run;
	struct session_progress progress;
	struct session *session;
	struct err err; /* of saving, or of a window's report */
	bool part;      /* of a job's mesh only a window is fetched */
	struct ctl_window window;
};

static int feed_head(void *ctx, const struct acut_mesh_head *head)
{
	struct feed *f = ctx;

	return f->sink.head(f->sink.ctx, head);
}

/* Saves the outputs with the state of the fetch, as of the last block. */
static int feed_save(struct feed *f)
{
	void *state;
	size_t size;
	int r;

	if (acut_fetch_state(f->session->acut, &state, &size))
		return session_failure(f->session, NULL, &f->err);
	r = outputs_save(f->run, state, size, &f->err);
	free(state);
	return r;
}

static int feed_block(void *ctx, const struct acut_mesh_block *block)
{
	struct feed *f = ctx;
	int r = f->sink.block(f->sink.ctx, block);

	return r || !outputs_due(f->run) ? r : feed_save(f);
}

static int feed_base(void *ctx, const struct acut_mesh_base *base)
{
	struct feed *f = ctx;

	return outputs_changes(f->run).base(f->sink.ctx, base);
}

static int feed_gone(void *ctx, const struct acut_mesh_region *region)
{
	struct feed *f = ctx;

	return outputs_changes(f->run).gone(f->sink.ctx, region);
}

static int feed_tail(void *ctx, const struct acut_mesh_tail *tail)
{
	struct feed *f = ctx;
	int r = f->part ? ctl_window_tail(&f->window, tail, &f->err) : 0;

	return r ? r : f->sink.tail(f->sink.ctx, tail);
}

static void feed_progress(void *ctx, const struct acut_progress *now)
{
	struct feed *f = ctx;

	session_progress_show(&f->progress, now);
}

/* Going on would not mend these: they are about the data itself. */
static bool can_go_on(const struct feed *f, const struct err *err)
{
	return outputs_saved(f->run) && err->code != ERR_GONE && err->code != ERR_DIGEST && err->code != ERR_PROTO &&
	       err->code != ERR_CORRUPT && err->code != ERR_VERSION;
}

/* A failed fetch keeps the blocks that came, and prints how to go on. */
static int feed_failed(struct feed *f, uint64_t id)
{
	static const char way[] = "acutctl fetch %llu --resume, with the same outputs and options, continues it";
	struct session *session = f->session;
	struct err err;
	int status;

	session_failure(session, NULL, &err);
	if (outputs_error(f->run)->code)
		err = *outputs_error(f->run);
	else if (f->err.code)
		err = f->err;
	else if (can_go_on(f, &err))
		feed_save(f);
	if (err.code == ERR_NOMEM && !f->part)
		err_add_hint(&err, "fetch the mesh by windows (acutctl fetch %llu --bbox)", (unsigned long long)id);
	if (can_go_on(f, &err) && !err.hint[0] && session->console.json)
		err_add_hint(&err, way, (unsigned long long)id);
	status = session_error(session, &err);
	if (can_go_on(f, &err) && !session->console.quiet && !session->console.json) {
		fprintf(stderr, "acutctl: ");
		fprintf(stderr, way, (unsigned long long)id);
		fputc('\n', stderr);
	}
	return status;
}

int ctl_fetch(struct session *session, const struct ctl_fetch_options *opt, uint64_t id, struct outputs *run,
	      const struct ctl_staged *staged)
{
	struct feed feed = {.sink = outputs_sink(run), .run = run, .session = session, .err = ERR_INIT};
	const struct acut_mesh_sink sink = {feed_head, feed_block, feed_tail, feed_progress, &feed};
	const struct acut_job *job;
	struct acut_job part;
	struct acut_changes_sink changes = outputs_changes(run);
	const void *kept;
	size_t size = 0;
	int r;

	feed.part = !staged && opt->window;
	session_progress_init(&feed.progress, session);
	kept = outputs_kept(run, &size);
	changes.mesh = sink;
	changes.base = feed_base;
	changes.gone = feed_gone;
	if (opt->since)
		r = acut_fetch_changes(session->acut, id, opt->since, &changes);
	else
		r = kept ? acut_fetch_from(session->acut, kept, size, &sink) : acut_fetch(session->acut, id, &sink);
	/* A window need not wait for the job. */
	if (r || acut_job_wait(session->acut, id, !feed.part, NULL, NULL, &job))
		return feed_failed(&feed, id);
	if (feed.part) {
		part = *job;
		part.report = feed.window.report;
		return publish(session, opt, &part, run, staged);
	}
	if (!job->has_report)
		return ctl_report_job_status(session, job);
	return publish(session, opt, job, run, staged);
}
