/* What the service knows of itself in numbers, for who watches it. Looks through the lists; keeps nothing. */
#include <string.h>

#include "clock.h"
#include "job_priv.h"
#include "history.h"

_Static_assert(JOB_STATES == 7, "struct jobs_numbers has as many");

static void count_datasets(const struct jobs *j, struct jobs_numbers *ret)
{
	int64_t now = clock_real_us(), first = INT64_MAX;

	for (const struct dataset *d = j->datasets; d; d = d->next) {
		if (!d->onestep && d->removed_us)
			ret->removed++;
		else if (!d->onestep)
			ret->datasets++;
		for (const struct pending *q = d->pending; q; q = q->next) {
			ret->pending++;
			first = pending_until_us(q) < first ? pending_until_us(q) : first;
		}
	}
	if (ret->pending)
		ret->pending_left = (double)(first - now) / 1e6;
}

void jobs_numbers(struct jobs *j, struct jobs_numbers *ret)
{
	int64_t now = clock_real_us(), oldest = now;

	*ret = (struct jobs_numbers){.tally = j->core->tally, .verified = j->verified, .kept = history_count(j)};
	for (const struct job *job = j->jobs; job; job = job->next) {
		if (job_state_final(job->state))
			continue;
		ret->states[job->state]++;
		if (job->state == JOB_queued && job->submitted_us < oldest)
			oldest = job->submitted_us;
		ret->waiting_space += job->run && run_space_lacks(job->run) > 0;
	}
	ret->oldest_waiting = (double)(now - oldest) / 1e6;
	for (const struct push *p = j->pushes; p; p = push_next(p))
		ret->pushes++;
	ret->unsure = catalogue_unsure(j->core->p.catalogue);
	count_datasets(j, ret);
}

void jobs_work(const struct jobs *j, struct jobs_work *ret)
{
	struct jobs_work work = {0};

	jobs_count(j, &work.running, &work.waiting);
	for (struct push *p = j->pushes; p; p = push_next(p))
		work.pushes++;
	for (const struct job *job = j->jobs; job; job = job->next) {
		uint64_t points, all, done, total;

		if (!job->run)
			continue;
		run_progress(job->run, &points, &all, &done, &total);
		work.domains_done += done;
		work.domains_total += total;
	}
	*ret = work;
}

/* ---- by user ---- */

/* The n smallest that are not below `from`; `n` of them are kept in order. */
static void keep_uid(struct jobs_user *list, size_t *n, size_t room, uint64_t from, uint32_t uid)
{
	size_t at = 0;

	if (uid < from)
		return;
	while (at < *n && list[at].uid < uid)
		at++;
	if (at == room || (at < *n && list[at].uid == uid))
		return;
	*n += *n < room;
	memmove(list + at + 1, list + at, (*n - at - 1) * sizeof *list);
	list[at] = (struct jobs_user){.uid = uid};
}

static struct jobs_user *find_uid(struct jobs_user *list, size_t n, uint32_t uid)
{
	size_t low = 0, high = n;

	while (low < high) {
		size_t mid = (low + high) / 2;

		if (list[mid].uid == uid)
			return &list[mid];
		if (list[mid].uid < uid)
			low = mid + 1;
		else
			high = mid;
	}
	return NULL;
}

size_t jobs_users(struct jobs *j, uint64_t from, struct jobs_user *ret, size_t room)
{
	const struct pending *q;
	struct jobs_user *u;
	size_t n = 0;

	for (const struct dataset *d = j->datasets; d; d = d->next) {
		if (!d->onestep)
			keep_uid(ret, &n, room, from, d->uid);
		for (q = d->pending; q; q = q->next)
			keep_uid(ret, &n, room, from, q->uid);
	}
	for (const struct job *job = j->jobs; job; job = job->next)
		if (!job_state_final(job->state))
			keep_uid(ret, &n, room, from, job->peer.uid);
	for (const struct dataset *d = j->datasets; d; d = d->next) {
		u = d->onestep ? NULL : find_uid(ret, n, d->uid);
		if (u) {
			u->datasets += !d->removed_us;
			u->bytes += d->bytes;
			u->points += d->points;
		}
		for (q = d->pending; q; q = q->next)
			if ((u = find_uid(ret, n, q->uid)))
				u->pending_bytes += disk_points_bytes(q->points);
	}
	for (const struct job *job = j->jobs; job; job = job->next)
		if (!job_state_final(job->state) && (u = find_uid(ret, n, job->peer.uid)))
			u->jobs++;
	return n;
}
