/*
 * What the log hears of the ends of jobs and pushes, and what is counted of the work.
 *
 * The model: who ends something for good tells it here, once, with whose it was; the counts of ends are those of the
 * events (log_event_count), the counts of work lie in jobs->tally. All on the loop, so that nothing is locked and no
 * worker pays.
 */
#include <stdio.h>

#include "log.h"
#include "push_priv.h"

void tally_domain(struct jobs *j, uint32_t triangles)
{
	THREAD_LOOP_ONLY();
	j->tally.domains_made++;
	j->tally.triangles += triangles;
}

void tell_damage(struct jobs *j, const struct log_about *about, const struct err *why)
{
	if (why->code != ERR_CORRUPT)
		return;
	log_event_err(LOG_EVENT_DAMAGE, about, "what is stored is damaged", why);
}

/* ---- jobs ---- */

void job_tell_end(const struct job *job)
{
	const struct job_report *r = &job->report;
	const char *dataset = job->dataset ? job->dataset->name : "";
	char what[128];

	THREAD_LOOP_ONLY();
	if (job->state == JOB_done) {
		log_event(LOG_EVENT_JOB_DONE, ABOUT_JOB(job),
			  "job %llu of %s is done: %llu triangles, %llu of %llu domains made, %.1f s",
			  (unsigned long long)job->id, dataset, (unsigned long long)r->triangles,
			  (unsigned long long)(r->domains - r->domains_reused), (unsigned long long)r->domains, r->seconds);
	} else if (job->state == JOB_cancelled) {
		log_event(LOG_EVENT_JOB_CANCELLED, ABOUT_JOB(job), "job %llu of %s was cancelled", (unsigned long long)job->id,
			  dataset);
	} else if (job->state == JOB_failed) {
		snprintf(what, sizeof what, "job %llu of %s failed", (unsigned long long)job->id, dataset);
		log_event_err(LOG_EVENT_JOB_FAILED, ABOUT_JOB(job), what, &job->err);
		tell_damage(job->jobs, ABOUT_JOB(job), &job->err);
	}
}

/* ---- pushes ---- */

void push_tell_committed(const struct push *p)
{
	const struct dataset *d = p->dataset;
	struct log_about about = *ABOUT_PUSH(p);

	about.generation = d->generation;
	log_event(LOG_EVENT_PUSH_COMMITTED, &about,
		  "push %llu of user %u into %s is done: %zu files, generation %llu, %llu points", (unsigned long long)p->id,
		  p->peer.uid, d->onestep ? "a dataset of one step" : d->name, p->nsources + p->ntaken,
		  (unsigned long long)d->generation, (unsigned long long)d->points);
}

/* Whoever ends a push himself knows it. */
static bool is_news(const struct push *p, const struct err *why)
{
	return !p->broken && why->code != ERR_CANCELLED;
}

void push_tell_failed(const struct push *p, const struct err *why)
{
	char what[160];

	if (!is_news(p, why))
		return;
	snprintf(what, sizeof what, "push %llu of user %u into %s failed", (unsigned long long)p->id, p->peer.uid,
		 p->dataset->onestep ? "a dataset of one step" : p->dataset->name);
	log_event_err(LOG_EVENT_PUSH_FAILED, ABOUT_PUSH(p), what, why);
	tell_damage(p->jobs, ABOUT_PUSH(p), why);
}

void push_tell_refused(const struct push *p, const char *file, const struct err *why)
{
	struct log_about about = *ABOUT_PUSH(p);
	char what[160];

	if (!is_news(p, why))
		return;
	about.file = file;
	snprintf(what, sizeof what, "push %llu of user %u into %s: a file is refused", (unsigned long long)p->id, p->peer.uid,
		 p->dataset->onestep ? "a dataset of one step" : p->dataset->name);
	log_event_err(LOG_EVENT_FILE_REFUSED, &about, what, why);
}
