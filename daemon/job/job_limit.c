/*
 * What one user may have: unfinished jobs, datasets, memory. No limit holds for admins. (Bytes on the disk: limit.c of core.)
 *
 * The model of the memory: runs, stages and plans of a user are added up when one of them wants more. A run gets a slot, a plan
 * its budget and a push its stage only within the user's share; domains start one after the other where more at once would go
 * beyond it. What could not even begin alone is refused with the numbers.
 */
#include "job_priv.h"
#include "parse.h"
#include "push_priv.h"
#include "run_priv.h"

/* ---- jobs ---- */

int limit_jobs(const struct jobs *j, const struct peer *peer, struct err *err)
{
	const struct job *job;
	unsigned own = 0;

	THREAD_LOOP_ONLY();
	if (!j->core->p.user.jobs || rights_admin(peer))
		return 0;
	for (job = j->jobs; job; job = job->next)
		own += !job->removed && !job_state_final(job->state) && job->peer.uid == peer->uid;
	if (own < j->core->p.user.jobs)
		return 0;
	err_set(err, ERR_LIMIT, "%u jobs of this user wait or run, and %u are all that one user may have (user-jobs)", own,
		j->core->p.user.jobs);
	err_add_hint(err, "submit it again when some of them are done, or cancel some");
	return err_add_place(err, ERR_NO_OFFSET, "user-jobs");
}

/* ---- datasets ---- */

static unsigned limit_datasets_of(const struct jobs *j, uint32_t uid, unsigned *ret_removed)
{
	unsigned n = 0, removed = 0;

	for (const struct dataset *d = j->datasets; d && !d->onestep; d = d->next)
		if (d->uid == uid) {
			n++;
			removed += d->removed_us != 0;
		}
	*ret_removed = removed;
	return n;
}

int limit_datasets(const struct jobs *j, const struct peer *peer, struct err *err)
{
	unsigned removed, own;

	THREAD_LOOP_ONLY();
	if (!j->core->p.user.datasets || rights_admin(peer))
		return 0;
	own = limit_datasets_of(j, peer->uid, &removed);
	if (own < j->core->p.user.datasets)
		return 0;
	if (removed)
		err_set(err, ERR_LIMIT,
			"this user has %u datasets, %u of them removed but not gone yet, and %u are all that one user may "
			"have (user-datasets)",
			own, removed, j->core->p.user.datasets);
	else
		err_set(err, ERR_LIMIT, "this user has %u datasets, and %u are all that one user may have (user-datasets)", own,
			j->core->p.user.datasets);
	err_add_hint(
		err,
		"push into one that is there, remove some (they count until keep-removed is over), or ask an administrator for more");
	return err_add_place(err, ERR_NO_OFFSET, "user-datasets");
}

void jobs_set_user_limits(struct jobs *j, const struct user_limits *user)
{
	j->core->p.user = *user;
	limit_count(j->core);
}

/* ---- what a user has of it ---- */

void jobs_own(struct jobs *j, const struct peer *peer, uint64_t state_bytes, struct jobs_own *ret)
{
	const struct user_limits *may = &j->core->p.user;
	struct jobs_own own = {.exempt = rights_admin(peer), .jobs_most = may->jobs, .datasets_most = may->datasets};

	for (const struct job *job = j->jobs; job; job = job->next)
		own.jobs += !job->removed && !job_state_final(job->state) && job->peer.uid == peer->uid;
	own.datasets = limit_datasets_of(j, peer->uid, &own.removed);
	limit_disk_of(j->core, peer->uid, state_bytes, &own.disk, &own.disk_most);
	*ret = own;
}

/* ---- memory ---- */

uint64_t limit_memory(const struct jobs *j, const struct sched_owner *owner)
{
	if (!j->core->p.user.memory || owner->exempt)
		return UINT64_MAX;
	return ledger_total(j->core->p.ledger) / 100 * j->core->p.user.memory;
}

/* What a run has or may yet ask for without being asked whether it may: its share; its plan, or two domains, one of them
 * for when the other is split. */
static uint64_t run_claim(const struct run *w)
{
	uint64_t least = pipe_budget_least(w->grid && w->state > RUN_OPENING && w->state != RUN_SELECTING ? w->grid : NULL);
	uint64_t need = w->slot->need > least ? w->slot->need : least;

	if (w->state >= RUN_PLANNING)
		need = 2 * w->budget.domain_bytes;
	return admit_share(w->jobs) + w->charged + need;
}

static uint64_t run_uses(const struct run *w)
{
	uint64_t bytes = admit_share(w->jobs) + w->charged, claim = run_claim(w);
	const struct run_domain *d;

	if (w->state == RUN_SELECTING)
		bytes += w->select.bytes;
	for (d = w->domains; d; d = d->next)
		/* What is mapped of one that is being made is its worker's to know. */
		bytes += d->state == DOMAIN_MAKING || d->state == DOMAIN_SPLIT ? w->budget.domain_bytes : d->size;
	return bytes > claim ? bytes : claim;
}

struct sum {
	uint32_t uid;
	const struct run *but;
	uint64_t bytes;
};

static void add_run(struct run *w, void *ctx)
{
	struct sum *s = ctx;

	if (w->placed && w != s->but && w->owner.uid == s->uid)
		s->bytes += run_uses(w);
}

/* By runs and pushes of that user, but for one run. */
static uint64_t held(struct jobs *j, uint32_t uid, const struct run *but)
{
	struct sum s = {.uid = uid, .but = but};

	jobs_each_run(j, add_run, &s);
	for (const struct push *p = j->pushes; p; p = push_next(p))
		/* What it keeps of its files it has while it waits for its stage: that would make those of one user wait for
		 * each other. */
		s.bytes += p->peer.uid == uid && p->stage_bytes ? p->stage_bytes + push_keeps(p) : 0;
	return s.bytes;
}

uint64_t limit_room(struct jobs *j, const struct sched_owner *owner, const struct run *but)
{
	uint64_t limit = limit_memory(j, owner), used;

	if (limit == UINT64_MAX)
		return limit;
	used = held(j, owner->uid, but) + (but ? admit_share(j) : 0);
	return used < limit ? limit - used : 0;
}

bool limit_alone(struct jobs *j, const struct sched_owner *owner, const struct run *but)
{
	return !held(j, owner->uid, but);
}

/* One more domain, and one for when it is split. */
bool limit_domain(const struct run *w)
{
	uint64_t limit = limit_memory(w->jobs, &w->owner), each = w->budget.domain_bytes;
	const struct run_domain *d;

	if (limit == UINT64_MAX)
		return true;
	for (d = w->domains; d && d->state != DOMAIN_MAKING && d->state != DOMAIN_SPLIT; d = d->next)
		;
	if (!d)
		return true; /* what it claims */
	return held(w->jobs, w->owner.uid, w) + run_uses(w) + 2 * each <= limit;
}

int limit_never(struct jobs *j, const struct sched_owner *owner, uint64_t bytes, const char *what, struct err *err)
{
	uint64_t limit = limit_memory(j, owner), total = ledger_total(j->core->p.ledger);
	char need[32], may[32];

	if (bytes <= limit)
		return 0;
	err_set(err, ERR_LIMIT, "%s needs %s of memory, and %s are all that one user may have (user-memory, %u%%)", what,
		parse_size_text(bytes, need), parse_size_text(limit, may), j->core->p.user.memory);
	err_add_hint(err, "ask an administrator for user-memory = %llu%%, or for more memory",
		     (unsigned long long)(bytes / (total / 100) + 1));
	return err_add_place(err, ERR_NO_OFFSET, "user-memory");
}
