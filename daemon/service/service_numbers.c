/* Numbers of the service: work, holders of memory, what each user has. Computed from the lists when requested. */
#include <string.h>

#include "clock.h"
#include "service.h"

void service_work(const struct service *s, struct service_work *ret)
{
	struct jobs_stat stat;

	*ret = (struct service_work){.pushes = pushes_open(s->pushes)};
	jobs_count(s->jobs, &ret->running, &ret->waiting);
	jobs_stat(s->jobs, &stat);
	ret->domains_done = stat.domains_done;
	ret->domains_total = stat.domains_total;
}

static void count_datasets(const struct service *s, struct service_numbers *ret)
{
	int64_t now = clock_real_us(), first = INT64_MAX;

	for (const struct dataset *d = datasets_first(s->datasets); d; d = d->next) {
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

void service_numbers(const struct service *s, struct service_numbers *ret)
{
	struct jobs_stat stat;

	jobs_stat(s->jobs, &stat);
	*ret = (struct service_numbers){
		.tally = s->core->tally,
		.verified = *maintenance_verified(s->maintenance),
		.jobs_listed = stat.kept,
		.oldest_waiting = stat.oldest_waiting,
		.waiting_space = stat.waiting_space,
		.pushes = pushes_open(s->pushes),
		.catalogue_failed = catalogue_is_uncertain(s->core->p.catalogue),
	};
	memcpy(ret->states, stat.states, sizeof ret->states);
	count_datasets(s, ret);
}

void service_usage(const struct service *s, const struct peer *peer, uint64_t state_bytes, struct service_usage *ret)
{
	const struct user_limits *may = &s->core->p.limits.user;
	struct service_usage usage = {.exempt = rights_admin(peer), .jobs_most = may->jobs, .datasets_most = may->datasets};

	usage.jobs = jobs_owned(s->jobs, peer->uid);
	usage.datasets = dataset_owned(s->datasets, peer->uid, &usage.removed);
	limit_disk_of(s->core, peer->uid, state_bytes, &usage.disk, &usage.disk_most);
	*ret = usage;
}

/* ---- holders of memory ---- */

struct holders {
	void (*each)(void *ctx, const struct core_holder *);
	void *ctx;
};

static void report_holder(void *ctx, const struct core_holder *h)
{
	const struct holders *to = ctx;

	for (int i = 0; i < LEDGER_NAMES; i++)
		if (h->held[i]) {
			to->each(to->ctx, h);
			return;
		}
}

void service_holders(const struct service *s, void (*each)(void *ctx, const struct core_holder *), void *ctx)
{
	struct holders to = {each, ctx};

	jobs_held(s->jobs, report_holder, &to);
	pushes_held(s->pushes, report_holder, &to);
}

/* ---- by user ---- */

/* Adds a user to the sorted list of the `cap` smallest uids from `from` on. */
static void add_uid(struct service_user *list, size_t *n, size_t cap, uint64_t from, uint32_t uid)
{
	size_t at = 0;

	if (uid < from)
		return;
	while (at < *n && list[at].uid < uid)
		at++;
	if (at == cap || (at < *n && list[at].uid == uid))
		return;
	*n += *n < cap;
	memmove(list + at + 1, list + at, (*n - at - 1) * sizeof *list);
	list[at] = (struct service_user){.uid = uid};
}

static struct service_user *find_uid(struct service_user *list, size_t n, uint32_t uid)
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

struct users {
	struct service_user *list;
	size_t n, cap;
	uint64_t from;
};

static void add_user(void *ctx, uint32_t uid)
{
	struct users *u = ctx;

	add_uid(u->list, &u->n, u->cap, u->from, uid);
}

static void count_job(void *ctx, uint32_t uid)
{
	const struct users *u = ctx;
	struct service_user *user = find_uid(u->list, u->n, uid);

	if (user)
		user->jobs++;
}

size_t service_users(const struct service *s, uint64_t from, struct service_user *ret, size_t cap)
{
	struct users users = {.list = ret, .cap = cap, .from = from};
	const struct pending *q;
	struct service_user *u;

	for (const struct dataset *d = datasets_first(s->datasets); d; d = d->next) {
		if (!d->onestep)
			add_user(&users, d->uid);
		for (q = d->pending; q; q = q->next)
			add_user(&users, q->uid);
	}
	jobs_unfinished(s->jobs, add_user, &users);
	for (const struct dataset *d = datasets_first(s->datasets); d; d = d->next) {
		u = d->onestep ? NULL : find_uid(ret, users.n, d->uid);
		if (u) {
			u->datasets += !d->removed_us;
			u->bytes += d->bytes;
			u->points += d->points;
		}
		for (q = d->pending; q; q = q->next)
			if ((u = find_uid(ret, users.n, q->uid)))
				u->pending_bytes += q->bytes;
	}
	jobs_unfinished(s->jobs, count_job, &users);
	return users.n;
}
