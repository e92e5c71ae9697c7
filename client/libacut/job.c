/*
 * Jobs and plans. (Lists: call_list.c.)
 */
#include "call.h"

#include <stdlib.h>
#include <string.h>

void call_wire_failure(const Acut__V1__Error *e, struct acut_failure *ret)
{
	enum err_code code = err_from_wire_name(e->code);

	*ret = (struct acut_failure){
		.code = (int)code,
		.name = err_wire_name(code),
		.exit_status = err_exit_status(code),
		.message = e->message,
		.file = e->file,
		.field = e->field,
		.hint = e->hint,
		.offset = e->has_offset ? e->offset : UINT64_MAX,
	};
}

/* The points that each rule removed: with its name, or as numbers alone, whose names are in the page that the job is on
 * (NULL: none). */
static int get_removed(struct acut *a, const Acut__V1__Report *p, const Acut__V1__Jobs *page, struct acut_removed **ret,
		       size_t *ret_n)
{
	size_t names = page ? page->n_rules : 0, counts = p->n_removed_counts, n = counts ? counts : p->n_removed;
	struct acut_removed *rows;

	if (counts > names)
		return err_set(&a->err, ERR_PROTO, "a report counts for %zu rules, of which %zu have names", counts, names);
	rows = malloc((n + 1) * sizeof *rows);
	if (!rows)
		return err_set(&a->err, ERR_NOMEM, "there is no memory for a report");
	for (size_t i = 0; i < n; i++)
		rows[i] = counts ? (struct acut_removed){page->rules[i], p->removed_counts[i]} :
				   (struct acut_removed){p->removed[i]->rule, p->removed[i]->count};
	*ret = rows;
	*ret_n = n;
	return 0;
}

static int get_report(struct acut *a, const Acut__V1__Report *p, const Acut__V1__Jobs *page, struct acut_report *ret,
		      void **ret_rows)
{
	struct acut_removed *rows = NULL;
	size_t n = 0;
	int r = get_removed(a, p, page, &rows, &n);

	if (r < 0)
		return r;
	*ret = (struct acut_report){
		.points = p->points,
		.used = p->used,
		.vertices = p->vertices,
		.triangles = p->triangles,
		.hull = p->hull,
		.domains = p->domains,
		.domains_reused = p->domains_reused,
		.halo = p->halo,
		.points_read = p->points_read,
		.cells_read = p->cells_read,
		.peak_rss_bytes = p->peak_rss_bytes,
		.digest = p->digest,
		.vertex_digest = p->vertex_digest,
		.note = p->note,
		.window = p->window,
		.removed = rows,
		.nremoved = n,
		.seconds = p->seconds,
		.stage_seconds = p->stage_seconds,
		.first_triangle_seconds = p->first_triangle_seconds,
		.seal_seconds = p->seal_seconds,
		.plan_seconds = p->plan_seconds,
		.domains_seconds = p->domains_seconds,
		.most_points = p->most_points,
		.most_at = {p->most_x, p->most_y},
		.max_error = p->max_error,
		.positions = p->positions,
		.kept = p->kept,
		.rounds = p->rounds,
		.attempts = p->attempts,
		.largest_error = p->largest_error,
	};
	*ret_rows = rows;
	return 0;
}

/* page: that it is on, or NULL. *ret_rows: free it with the result. */
static int take_job(struct acut *a, const Acut__V1__Job *j, const Acut__V1__Jobs *page, struct acut_job *ret, void **ret_rows)
{
	int r = 0;

	*ret_rows = NULL;
	*ret = (struct acut_job){
		.id = j->id,
		.generation = j->generation,
		.dataset = j->dataset,
		.view = j->view,
		.state = j->state,
		.lattice = j->lattice,
		.crs = j->crs,
		.unit_xy = j->unit_xy,
		.unit_z = j->unit_z,
		.uid = j->uid,
		.pid = j->pid,
		.submitted_us = j->submitted_us,
		.finished_us = j->finished_us,
		.priority = j->priority,
		.waiting = j->waiting,
		.position = j->position,
		.lacks_space = j->lacks_space,
		.final = j->final,
		.has_report = j->report != NULL,
		.has_error = j->error != NULL,
		.progress = {.phase = "", .waiting = ""},
	};
	if (j->progress)
		call_progress(j->progress, &ret->progress);
	ret->progress.waiting = j->waiting;
	if (j->error)
		call_wire_failure(j->error, &ret->error);
	if (j->report)
		r = get_report(a, j->report, page, &ret->report, ret_rows);
	return r;
}

static int job_ask(struct acut *a, const Acut__V1__Message *req, const struct acut_job **ret)
{
	int r = call_ask(a, req, -1, ACUT__V1__MESSAGE__BODY_JOB);

	if (r == 0)
		r = take_job(a, a->answer->job, NULL, &a->job, &a->rows);
	if (r == 0)
		*ret = &a->job;
	return r;
}

int acut_submit_job(struct acut *a, const struct acut_submission *what, const struct acut_job **ret)
{
	Acut__V1__Submit req = ACUT__V1__SUBMIT__INIT;

	req.dataset = call_text(what->dataset);
	req.generation = what->generation;
	req.view = call_text(what->view);
	req.bound = what->bound;
	req.fresh = what->fresh;
	req.priority = call_text(what->priority);
	return job_ask(a, FRAME_MESSAGE(SUBMIT, submit, &req), ret);
}

int acut_submit(struct acut *a, const char *dataset, uint64_t generation, const char *view, bool bound, bool fresh,
		const struct acut_job **ret)
{
	const struct acut_submission what = {dataset, generation, view, NULL, bound, fresh};

	return acut_submit_job(a, &what, ret);
}

int acut_job_cancel(struct acut *a, uint64_t id, const struct acut_job **ret)
{
	Acut__V1__Cancel req = ACUT__V1__CANCEL__INIT;

	req.job = id;
	return job_ask(a, FRAME_MESSAGE(CANCEL, cancel, &req), ret);
}

int acut_job_remove(struct acut *a, uint64_t id)
{
	Acut__V1__Remove req = ACUT__V1__REMOVE__INIT;

	req.job = id;
	return call_ask(a, FRAME_MESSAGE(REMOVE, remove, &req), -1, ACUT__V1__MESSAGE__BODY_DONE);
}

int acut_job_wait(struct acut *a, uint64_t id, bool follow, void (*changed)(void *ctx, const struct acut_job *), void *ctx,
		  const struct acut_job **ret)
{
	Acut__V1__Wait req = ACUT__V1__WAIT__INIT;
	uint32_t request;
	int r = call_begin(a);

	req.job = id;
	req.watch = follow;
	if (r == 0)
		r = call_send(a, FRAME_MESSAGE(WAIT, wait, &req), -1, &request);
	while (r == 0) {
		a->answer = frame_message_free(a->answer);
		free(a->rows);
		a->rows = NULL;
		r = call_next(a, request, &a->answer, NULL);
		if (r == 0 && a->answer->body_case != ACUT__V1__MESSAGE__BODY_JOB)
			r = call_unexpected(a, a->answer);
		if (r == 0)
			r = take_job(a, a->answer->job, NULL, &a->job, &a->rows);
		if (r < 0)
			break;
		if (changed)
			changed(ctx, &a->job);
		if (!follow || a->job.final) {
			*ret = &a->job;
			break;
		}
	}
	return r;
}

struct jobs_list {
	struct acut *acut;
	Acut__V1__JobsRequest req;
	uint64_t last; /* handed out */
	void (*each)(void *ctx, const struct acut_job *);
	void *ctx;
};

static bool jobs_next(void *ctx, const Acut__V1__Message *page)
{
	struct jobs_list *l = ctx;
	const Acut__V1__Jobs *jobs = page->jobs;

	if (jobs->n_jobs)
		l->req.after = jobs->jobs[jobs->n_jobs - 1]->id;
	return jobs->more && jobs->n_jobs;
}

static int jobs_rows(void *ctx, const Acut__V1__Message *page)
{
	struct jobs_list *l = ctx;
	int r = 0;

	for (size_t i = 0; i < page->jobs->n_jobs && r == 0; i++) {
		const Acut__V1__Job *row = page->jobs->jobs[i];
		struct acut_job job;
		void *rows = NULL;

		r = call_rises(l->acut, row->id > l->last, "jobs");
		if (r == 0)
			r = take_job(l->acut, row, page->jobs, &job, &rows);
		if (r == 0)
			l->each(l->ctx, &job);
		l->last = row->id;
		free(rows);
	}
	return r;
}

int acut_jobs(struct acut *a, void (*each)(void *ctx, const struct acut_job *), void *ctx)
{
	struct jobs_list l = {.acut = a, .req = ACUT__V1__JOBS_REQUEST__INIT, .each = each, .ctx = ctx};
	int r = call_begin(a);

	l.req.limit = CALL_PAGE;
	l.req.counts = true;
	if (r < 0)
		return r;
	return call_list(a, &(struct call_list){.req = FRAME_MESSAGE(JOBS_REQUEST, jobs_request, &l.req),
						.want = ACUT__V1__MESSAGE__BODY_JOBS,
						.ctx = &l,
						.next = jobs_next,
						.rows = jobs_rows});
}

int acut_dataset_create(struct acut *a, const char *name, const char *scale_xy, const char *scale_z, const char *crs)
{
	Acut__V1__DatasetCreate req = ACUT__V1__DATASET_CREATE__INIT;
	uint32_t id;
	int r = call_begin(a);

	if (r < 0)
		return r;
	req.name = call_text(name);
	req.scale_xy = call_text(scale_xy);
	req.scale_z = call_text(scale_z);
	req.crs = call_text(crs);
	req.mode = call_mode(a);
	return call_again(a, FRAME_MESSAGE(DATASET_CREATE, dataset_create, &req), -1, ACUT__V1__MESSAGE__BODY_DONE, &id,
			  &a->answer);
}

int acut_plan(struct acut *a, const char *dataset, uint64_t generation, const char *view, const struct acut_plan **ret)
{
	Acut__V1__PlanRequest req = ACUT__V1__PLAN_REQUEST__INIT;
	const Acut__V1__Plan *p;
	int r;

	req.dataset = call_text(dataset);
	req.generation = generation;
	req.view = call_text(view);
	r = call_ask(a, FRAME_MESSAGE(PLAN_REQUEST, plan_request, &req), -1, ACUT__V1__MESSAGE__BODY_PLAN);
	if (r < 0)
		return r;
	p = a->answer->plan;
	a->plan = (struct acut_plan){.points = p->points,
				     .domains = p->domains,
				     .memory_bytes = p->memory_bytes,
				     .disk_bytes = p->disk_bytes,
				     .domains_reused = p->domains_reused,
				     .exact = p->exact,
				     .seconds = p->seconds,
				     .load = p->load,
				     .threads = p->threads};
	*ret = &a->plan;
	return 0;
}
