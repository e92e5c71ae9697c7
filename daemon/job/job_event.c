/* Events of the ends of jobs. */
#include <stdio.h>

#include "job_priv.h"

void job_event_end(const struct job *job)
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
		event_damage(ABOUT_JOB(job), &job->err);
	}
}
