/*
 * The end of removed datasets and pending pushes, and the clock that decides it.
 *
 * The model: a removed dataset is deleted when its time is over and nothing uses it. First its jobs forget it, then its row goes,
 * then its folder.
 */
#include "clock.h"
#include "dataset_priv.h"
#include "log.h"

#define KEEP_SECONDS (7 * 86400.)
#define CHECK_SECONDS 1.0
#define TRUST_SECONDS 3600. /* a clock that jumped ahead is trusted after that time */
#define SLACK_US INT64_C(60000000)

static double keep_seconds(const struct datasets *ds)
{
	return ds->core->p.limits.keep_removed > 0 ? ds->core->p.limits.keep_removed : KEEP_SECONDS;
}

int64_t dataset_until_us(const struct dataset *d)
{
	double us = keep_seconds(d->datasets) * 1e6;

	return d->removed_us ? d->removed_us + (us < 9e17 ? (int64_t)us : (int64_t)9e17) : 0;
}

/* The latest time that the datasets have recorded, for a daemon that has just started. */
static int64_t latest_us(const struct datasets *ds)
{
	int64_t us = 0;

	for (const struct dataset *d = ds->first; d; d = d->next) {
		for (const struct pending *q = d->pending; q; q = q->next)
			us = q->interrupted_us > us ? q->interrupted_us : us;
		us = d->removed_us > us ? d->removed_us : us;
		us = d->pushed_us > us ? d->pushed_us : us;
		us = d->created_us > us ? d->created_us : us;
	}
	return us;
}

/*
 * Expired data is lost, and a clock may be wrong: a machine without a battery-backed clock starts with an arbitrary date
 * until the network sets it. So time that the daemon did not see pass, between two calls or since the latest recorded time,
 * counts only after the clock has stayed ahead for an hour.
 */
int64_t datasets_trusted_us(struct datasets *ds)
{
	int64_t now = clock_real_us(), us = ds->trusted.us;
	uint64_t mono = clock_mono_ns();

	THREAD_LOOP_ONLY();
	if (ds->trusted.at_ns)
		us += (int64_t)((mono - ds->trusted.at_ns) / 1000);
	else
		us = latest_us(ds);
	ds->trusted.at_ns = mono;
	if (us && now > us + SLACK_US) {
		if (!ds->trusted.ahead_ns)
			ds->trusted.ahead_ns = mono;
		if ((double)(mono - ds->trusted.ahead_ns) < TRUST_SECONDS * 1e9)
			return ds->trusted.us = us;
	}
	ds->trusted.ahead_ns = 0;
	return ds->trusted.us = now;
}

void datasets_expire(struct datasets *ds)
{
	struct dataset *d, *next;
	int64_t now = datasets_trusted_us(ds);

	THREAD_LOOP_ONLY();
	for (d = ds->first; d && !ds->core->stopping; d = next) {
		next = d->next;
		if (!d->removed_us || now < dataset_until_us(d) || d->pushes || d->committer)
			continue;
		if (ds->calls)
			ds->calls->forget(ds->ctx, d);
		pending_forget(d);
		if (d->users)
			continue;
		log_event(LOG_EVENT_DATASET_GONE, ABOUT_DATASET(d),
			  "the removed dataset %s (number %llu) is deleted with its %llu points", d->name,
			  (unsigned long long)d->id, (unsigned long long)d->points);
		dataset_drop(d);
	}
}

void datasets_expire_tick(struct datasets *ds)
{
	if (ds->expiry_checked_ns && clock_since(ds->expiry_checked_ns) < CHECK_SECONDS)
		return;
	ds->expiry_checked_ns = clock_mono_ns();
	datasets_expire(ds);
	/* A pending push may be the last user of its dataset. */
	for (struct dataset *d = ds->first, *next; d && !ds->core->stopping; d = next) {
		next = d->next;
		if (!d->readers)
			pending_expire(d);
	}
}
