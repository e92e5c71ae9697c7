/* Events of the ends of pushes, and of files that they refuse. */
#include <stdio.h>

#include "push_priv.h"

void push_event_committed(const struct push *p)
{
	const struct dataset *d = p->dataset;
	struct log_about about = *ABOUT_PUSH(p);

	about.generation = d->generation;
	log_event(LOG_EVENT_PUSH_COMMITTED, &about,
		  "push %llu of user %u into %s is done: %zu files, generation %llu, %llu points", (unsigned long long)p->id,
		  p->peer.uid, d->onestep ? "a dataset of one step" : d->name, p->nsources + p->nadopt_named,
		  (unsigned long long)d->generation, (unsigned long long)d->points);
}

/* A cancelled push is no event. */
static bool is_news(const struct push *p, const struct err *why)
{
	return !p->broken && why->code != ERR_CANCELLED;
}

void push_event_failed(const struct push *p, const struct err *why)
{
	char what[160];

	if (!is_news(p, why))
		return;
	snprintf(what, sizeof what, "push %llu of user %u into %s failed", (unsigned long long)p->id, p->peer.uid,
		 p->dataset->onestep ? "a dataset of one step" : p->dataset->name);
	log_event_err(LOG_EVENT_PUSH_FAILED, ABOUT_PUSH(p), what, why);
	event_damage(ABOUT_PUSH(p), why);
}

void push_event_refused(const struct push *p, const char *file, const struct err *why)
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
