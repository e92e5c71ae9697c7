/*
 * Jobs that are asked for: the view as it was asked, the limits, whether there is such a job already, and the
 * row that makes an unbound one outlive the daemon. Planning need not wait for that row: what a job does before it is promised is
 * derived, and a crash leaves a plan at most, of a number that another job will get.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "job_priv.h"
#include "log.h"
#include "history.h"
#include "plan_file.h"

static void accept(struct job *job, const struct err *why)
{
	void (*accepted)(void *token, const struct err *why, struct job *) = job->accepted;

	job->waiting_row = false;
	job->accepted = NULL;
	if (accepted)
		accepted(job->token, why, why ? NULL : job);
}

/* Without a row it was never there, however far it has come. */
static void refuse(struct job *job, const struct err *why)
{
	char what[128];

	snprintf(what, sizeof what, "job %llu of %.60s is refused: its row cannot be written", (unsigned long long)job->id,
		 job->dataset->name);
	log_event_err(LOG_EVENT_JOB_FAILED, ABOUT_JOB(job), what, why);
	job->removed = true;
	accept(job, why);
	job_cancel(job);
}

static void submit_row_done(void *ctx, int r, const struct err *why)
{
	struct job *job = ctx;

	if (r) {
		refuse(job, why);
		return;
	}
	accept(job, NULL);
	/* It was faster than its row. */
	if (job_state_final(job->state))
		job_over(job);
	else
		job_step(job);
}

/* ---- the run's calls ---- */

/* Of a dataset that was read in part, a view must lie in what was read. A unit more or less is what rounding
 * makes of the corners, and reading took two more. */
static int check_partial(const struct dataset *d, const struct lattice *l, const struct view *view, struct err *err)
{
	double unit = decimal_double(l->scale_xy);
	bool inside = view->crop != VIEW_CROP_NONE;

	for (int i = 0; d->partial && inside && i < 4; i++) {
		double at = (double)view->crop_box[i] * unit;

		inside = i < 2 ? at >= d->crop[i] - unit : at <= d->crop[i] + unit;
	}
	if (!d->partial || inside)
		return 0;
	err_set(err, ERR_USAGE, "of the inputs of the dataset %s only the points in the box %.15g,%.15g,%.15g,%.15g were read",
		d->name, d->crop[0], d->crop[1], d->crop[2], d->crop[3]);
	return err_add_hint(err, "push them into a named dataset: it takes them whole and serves any view");
}

static int view_of(const char *text, const char *window, const struct dataset *d, char **ret, struct err *err)
{
	struct lattice lattice;
	struct view view;
	int r;

	if (!lattice_parse(d->lattice, &lattice))
		return err_set(err, ERR_INTERNAL, "the lattice of the dataset %s cannot be read", d->name);
	r = view_resolve_window(text, window, &lattice, d->unit_xy, &view, err);
	if (r)
		return r;
	r = check_partial(d, &lattice, &view, err);
	*ret = r ? NULL : view_text(&view);
	view_done(&view);
	if (r)
		return r;
	return *ret ? 0 : err_set(err, ERR_NOMEM, "no memory for a view");
}

int job_view(const char *text, const struct dataset *d, char **ret, struct err *err)
{
	return view_of(text, "", d, ret, err);
}

int job_window(const struct job *job, const char *area, char **ret, struct err *err)
{
	if (!job->dataset)
		return err_set(err, ERR_GONE, "the dataset of job %llu is gone", (unsigned long long)job->id);
	if (strstr(job->view, " window="))
		return err_set(err, ERR_USAGE, "the mesh of job %llu is that of a window already", (unsigned long long)job->id);
	return view_of(job->view, area, job->dataset, ret, err);
}

/* The same generation and view: the same job, unless it came to nothing or to another mesh than now. */
static struct job *find_same(struct jobs *j, const struct job_params *p, uint64_t generation, const char *view)
{
	struct job *job;

	for (uint64_t id = 0; (job = history_next(j, p->dataset, id)); id = job->id)
		if (job->generation == generation && !job->bound && !job->removed && !job->stop && job->peer.uid == p->peer.uid &&
		    job->state != JOB_failed && job->state != JOB_cancelled && !strcmp(job->view, view) &&
		    !report_without_flat(&job->report))
			return job;
	return NULL;
}

/*
 * Jobs that are over keep theirs, for later streams, until others need the room: then the oldest go of the user who has most
 * of it. What is not over cannot go, so a user may fill at most half of what the unfinished jobs of others leave: however
 * many users take what they may, something is left for the next.
 */
static uint64_t views_most(const struct peer *peer, const struct history_views *v)
{
	uint64_t others = v->busy - v->own_busy, left = others < JOBS_VIEWS_MAX ? JOBS_VIEWS_MAX - others : 0;

	return rights_admin(peer) ? left : left / 2;
}

static int take_view(struct jobs *j, const struct peer *peer, const char *view, struct err *err)
{
	uint64_t n = strlen(view);
	struct history_views v;

	history_views(j, peer->uid, &v);
	if (v.own_busy + n <= views_most(peer, &v) && v.all + n <= JOBS_VIEWS_MAX)
		return 0;
	jobs_put_away(j); /* what is over is not busy */
	history_views(j, peer->uid, &v);
	if (v.own_busy + n > views_most(peer, &v)) {
		err_set(err, ERR_BUSY,
			"its area takes %llu KiB, and those of this user's unfinished jobs %llu of the %llu KiB that they may have",
			(unsigned long long)(n + 1023) >> 10, (unsigned long long)(v.own_busy + 1023) >> 10,
			(unsigned long long)views_most(peer, &v) >> 10);
		return err_add_hint(err, "submit it again when some of them are done, or crop to a simpler area");
	}
	while (v.all + n > JOBS_VIEWS_MAX && jobs_forget_one(j, HISTORY_VIEWS, peer->uid, n))
		history_views(j, peer->uid, &v);
	if (v.all + n <= JOBS_VIEWS_MAX)
		return 0;
	err_set(err, ERR_BUSY, "the areas of the jobs that there are take all of the %d MiB for them", JOBS_VIEWS_MAX >> 20);
	return err_add_hint(err, "submit it again when some of them are done");
}

static int check_submit(struct jobs *j, const struct job_params *p, uint64_t generation, char **ret_view, struct err *err)
{
	const struct job *job;
	unsigned open = 0, own = 0;
	int r;

	if (j->core->stopping)
		return err_set(err, ERR_BUSY, "the daemon is stopping");
	for (job = j->jobs; job; job = job->next) {
		open += !job_state_final(job->state);
		own += !job_state_final(job->state) && job->peer.uid == p->peer.uid;
	}
	if (open >= JOBS_OPEN_MAX) {
		err_set(err, ERR_BUSY, "%u jobs wait or run already", open);
		return err_add_hint(err, "submit it again when some of them are done");
	}
	/* Something is left for the next user, and for administrators. */
	if (!rights_admin(&p->peer) && own >= (JOBS_OPEN_MAX - (open - own)) / 2) {
		err_set(err, ERR_BUSY, "%u jobs of this user wait or run already", own);
		return err_add_hint(err, "submit it again when some of them are done");
	}
	r = dataset_check_generation(p->dataset, generation, err);
	if (r)
		return r;
	return job_view(p->view, p->dataset, ret_view, err);
}

/* Asked for again, with another priority: that is how it is changed. */
static void change_priority(struct job *job, const struct job_params *p, enum job_priority priority)
{
	struct err err = ERR_INIT;

	if (!p->priority || !*p->priority || priority == job->priority || job_state_final(job->state))
		return;
	job_set_priority(job, priority);
	if (job_put_row(job, NULL, &err))
		log_event_err(LOG_EVENT_CATALOGUE_FAILED, ABOUT_JOB(job), "a priority is forgotten at the next start", &err);
}

/* No limit holds for admins. */
static int limit_jobs(const struct jobs *j, const struct peer *peer, struct err *err)
{
	unsigned own;

	THREAD_LOOP_ONLY();
	if (!j->core->p.user.jobs || rights_admin(peer))
		return 0;
	own = jobs_owned(j, peer->uid);
	if (own < j->core->p.user.jobs)
		return 0;
	err_set(err, ERR_LIMIT, "%u jobs of this user wait or run, and %u are all that one user may have (user-jobs)", own,
		j->core->p.user.jobs);
	err_add_hint(err, "submit it again when some of them are done, or cancel some");
	return err_add_place(err, ERR_NO_OFFSET, "user-jobs");
}

void job_submit(struct jobs *j, const struct job_params *p, void (*accepted)(void *token, const struct err *why, struct job *),
		void *token)
{
	uint64_t generation = p->generation ? p->generation : p->dataset->generation;
	struct err err = ERR_INIT;
	struct job *job = NULL;
	enum job_priority priority = JOB_PRIORITY_NORMAL;
	char *view = NULL;
	int r = job_priority_read(p->priority, &p->peer, &priority, &err);

	THREAD_LOOP_ONLY();
	if (!r)
		r = check_submit(j, p, generation, &view, &err);

	if (!r && !p->bound && !p->fresh) {
		job = find_same(j, p, generation, view);
		/* One that is not in the catalogue yet is not promised yet. */
		if (job && !job->waiting_row) {
			free(view);
			change_priority(job, p, priority);
			accepted(token, NULL, job);
			return;
		}
	}
	if (!r)
		r = limit_jobs(j, &p->peer, &err);
	if (!r)
		r = take_view(j, &p->peer, view, &err);
	if (!r) {
		job = job_add(j, ++j->last_job, view, &p->peer, &err);
		r = job ? 0 : -(int)err.code;
	}
	if (r) {
		free(view);
		accepted(token, &err, NULL);
		return;
	}
	job->dataset = dataset_hold(p->dataset);
	job->generation = generation;
	job->priority = priority;
	job_slot_init(job);
	job->bound = p->bound;
	if (job_plan_new(job, &err)) {
		accepted(token, &err, NULL);
		job->state = JOB_failed;
		job->removed = true;
		return;
	}
	plan_file_fresh(job->plan);
	job->submitted_us = clock_real_us();
	job->begun_ns = clock_mono_ns();
	job->accepted = accepted;
	job->token = token;
	if (job->bound) {
		accept(job, NULL);
		job_step(job);
		slots_grant(j->admission);
		return;
	}
	job->waiting_row = true;
	if (job_put_row(job, submit_row_done, &err)) {
		refuse(job, &err);
		return;
	}
	/* It begins at once, and is promised, shown and told when its row is there. */
	job_step(job);
	slots_grant(j->admission);
}
