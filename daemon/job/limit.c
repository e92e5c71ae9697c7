/*
 * What one user may have: jobs that are not done, datasets, bytes on the disk, memory. Admins are held by none of it.
 *
 * The model of the disk: of each user who has any there is a row: what the lists of datasets and interrupted pushes say
 * (counted by the loop when they change, and now and then), and what open pushes and imports have taken beside it (by
 * workers, under the lock). What is pushed counts with the owner of the dataset, as a file does; until it is published, with
 * who pushes, and with both while the push goes on. So pushes at the same time never have more together than there is. What
 * was taken is given back and counted in one step (limit_count_given): nobody finds room, or none, between the two. A geoid
 * grid counts with each user who gave it a name.
 *
 * The model of the memory: runs, stages and plans of a user are added up when one of them wants more (limit_held). A
 * run gets a place, a plan its budget and a push its stage only within the user's share; domains start one after the
 * other where more at once would go beyond it. What could not even begin alone is refused with the numbers.
 */
#include <assert.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>

#include "io.h"
#include "job_priv.h"
#include "parse.h"
#include "push_priv.h"
#include "run_priv.h"

struct limit_row {
	uint32_t uid;
	uint64_t counted, taken, geoids;
};

static int refused(const char *setting, struct err *err)
{
	err_add_hint(err, "ask an administrator for more, or make room first");
	return err_add_place(err, ERR_NO_OFFSET, setting);
}

/* ---- jobs ---- */

int limit_jobs(const struct jobs *j, const struct job_peer *peer, struct err *err)
{
	const struct job *job;
	unsigned own = 0;

	THREAD_LOOP_ONLY();
	if (!j->p.user.jobs || rights_admin(peer))
		return 0;
	for (job = j->jobs; job; job = job->next)
		own += !job->removed && !job_state_final(job->state) && job->peer.uid == peer->uid;
	if (own < j->p.user.jobs)
		return 0;
	err_set(err, ERR_LIMIT, "%u jobs of this user wait or run, and %u are all that one user may have (user-jobs)", own,
		j->p.user.jobs);
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

int limit_datasets(const struct jobs *j, const struct job_peer *peer, struct err *err)
{
	unsigned removed, own;

	THREAD_LOOP_ONLY();
	if (!j->p.user.datasets || rights_admin(peer))
		return 0;
	own = limit_datasets_of(j, peer->uid, &removed);
	if (own < j->p.user.datasets)
		return 0;
	if (removed)
		err_set(err, ERR_LIMIT,
			"this user has %u datasets, %u of them removed but not gone yet, and %u are all that one user may "
			"have (user-datasets)",
			own, removed, j->p.user.datasets);
	else
		err_set(err, ERR_LIMIT, "this user has %u datasets, and %u are all that one user may have (user-datasets)", own,
			j->p.user.datasets);
	err_add_hint(
		err,
		"push into one that is there, remove some (they count until keep-removed is over), or ask an administrator for more");
	return err_add_place(err, ERR_NO_OFFSET, "user-datasets");
}

/* ---- the disk ---- */

void limit_init(struct jobs *j)
{
	lock_init(&j->limits.lock, LOCK_LIMITS);
}

void limit_done(struct jobs *j)
{
	free(j->limits.row);
	lock_done(&j->limits.lock);
}

static struct limit_row *row_of(struct limits *l, uint32_t uid)
{
	struct limit_row *more;

	for (size_t i = 0; i < l->n; i++)
		if (l->row[i].uid == uid)
			return &l->row[i];
	if (l->n == l->cap) {
		more = realloc(l->row, (l->cap ? 2 * l->cap : 8) * sizeof *more);
		if (!more)
			return NULL;
		l->row = more;
		l->cap = l->cap ? 2 * l->cap : 8;
	}
	l->row[l->n] = (struct limit_row){.uid = uid};
	return &l->row[l->n++];
}

static void count(struct limits *l, uint32_t uid, uint64_t bytes)
{
	struct limit_row *row = bytes ? row_of(l, uid) : NULL;

	if (row)
		row->counted += bytes;
}

static bool limits_disk(const struct jobs *j)
{
	return j->p.user.disk.unit != SPACE_UNLIMITED && j->p.user.disk.n;
}

static void count_all(struct jobs *j)
{
	struct limits *l = &j->limits;
	const struct dataset *d;
	const struct pending *q;
	size_t n = 0;

	assert(lock_held(LOCK_LIMITS));
	for (size_t i = 0; i < l->n; i++) {
		l->row[i].counted = 0;
		if (l->row[i].taken || l->row[i].geoids)
			l->row[n++] = l->row[i];
	}
	l->n = n;
	for (d = j->datasets; d; d = d->next) {
		count(l, d->uid, d->bytes);
		for (q = d->pending; q; q = q->next)
			count(l, q->uid, disk_points_bytes(q->points));
	}
}

void limit_count(struct jobs *j)
{
	THREAD_LOOP_ONLY();
	limit_count_given(j, 0, 0, 0, 0);
}

/* An account that there was no memory for has taken nothing. */
static uint64_t given(uint64_t taken, int64_t bytes)
{
	if (bytes < 0)
		return taken + (uint64_t)-bytes;
	return taken > (uint64_t)bytes ? taken - (uint64_t)bytes : 0;
}

void limit_count_given(struct jobs *j, uint32_t uid, int64_t bytes, uint32_t other, int64_t others)
{
	struct limits *l = &j->limits;
	struct limit_row *row;

	lock_take(&l->lock);
	row = bytes ? row_of(l, uid) : NULL;
	if (row)
		row->taken = given(row->taken, bytes);
	row = others ? row_of(l, other) : NULL;
	if (row)
		row->taken = given(row->taken, others);
	if (limits_disk(j))
		count_all(j);
	lock_give(&l->lock);
}

void limit_geoids(struct jobs *j, const struct limit_geoid *all, size_t n)
{
	struct limits *l = &j->limits;
	struct limit_row *row;

	lock_take(&l->lock);
	for (size_t i = 0; i < l->n; i++)
		l->row[i].geoids = 0;
	for (size_t i = 0; i < n; i++) {
		row = all[i].bytes ? row_of(l, all[i].uid) : NULL;
		if (row)
			row->geoids += all[i].bytes;
	}
	lock_give(&l->lock);
}

static uint64_t disk_limit(const struct jobs *j)
{
	const struct space_limit *limit = &j->p.user.disk;
	struct statvfs vfs;

	if (limits_disk(j) && limit->unit == SPACE_BYTES)
		return limit->n;
	/* What cannot be found out limits nothing here: whoever writes next meets the reason. */
	if (!limits_disk(j) || io->fstatvfs(j->p.statefd, &vfs) != 0)
		return UINT64_MAX;
	return (uint64_t)((double)vfs.f_blocks * (double)vfs.f_frsize / 100 * (double)limit->n);
}

static uint64_t disk_of(const struct limit_row *row)
{
	return row ? row->counted + row->taken + row->geoids : 0;
}

static int disk_refused(uint32_t uid, uint64_t bytes, uint64_t has, uint64_t limit, const char *what, struct err *err)
{
	char need[32], have[32], may[32];

	err_set(err, ERR_LIMIT,
		"%s needs %s on the disk: the user with id %u has %s of the %s that one user may have (user-disk)", what,
		parse_size_text(bytes, need), uid, parse_size_text(has, have), parse_size_text(limit, may));
	return refused("user-disk", err);
}

int limit_disk_take(struct jobs *j, uint32_t uid, bool admin, uint64_t bytes, const char *what, struct err *err)
{
	uint64_t limit = admin || rights_stored(uid, 0).admin ? UINT64_MAX : disk_limit(j), has;
	struct limit_row *row;
	int r = 0;

	lock_take(&j->limits.lock);
	row = row_of(&j->limits, uid);
	has = disk_of(row);
	if (!row)
		r = err_set(err, ERR_NOMEM, "no memory for the account of a user");
	else if (bytes > limit || has > limit - bytes)
		r = -ERR_LIMIT;
	else
		row->taken += bytes;
	lock_give(&j->limits.lock);
	return r == -ERR_LIMIT ? disk_refused(uid, bytes, has, limit, what, err) : r;
}

void limit_disk_give(struct jobs *j, uint32_t uid, uint64_t bytes)
{
	struct limit_row *row;

	if (!bytes)
		return;
	lock_take(&j->limits.lock);
	row = row_of(&j->limits, uid);
	if (row)
		row->taken -= bytes;
	lock_give(&j->limits.lock);
}

void jobs_set_user_limits(struct jobs *j, const struct jobs_user_limits *user)
{
	j->p.user = *user;
	limit_count(j);
}

/* ---- what a user has of it ---- */

void jobs_own(struct jobs *j, const struct job_peer *peer, uint64_t state_bytes, struct jobs_own *ret)
{
	const struct jobs_user_limits *may = &j->p.user;
	struct jobs_own own = {.exempt = rights_admin(peer), .jobs_most = may->jobs, .datasets_most = may->datasets};

	for (const struct job *job = j->jobs; job; job = job->next)
		own.jobs += !job->removed && !job_state_final(job->state) && job->peer.uid == peer->uid;
	own.datasets = limit_datasets_of(j, peer->uid, &own.removed);
	if (limits_disk(j)) {
		own.disk_most =
			may->disk.unit == SPACE_BYTES ? may->disk.n : (uint64_t)((double)state_bytes / 100 * (double)may->disk.n);
		lock_take(&j->limits.lock);
		for (size_t i = 0; i < j->limits.n; i++)
			if (j->limits.row[i].uid == peer->uid)
				own.disk = disk_of(&j->limits.row[i]);
		lock_give(&j->limits.lock);
	}
	*ret = own;
}

/* ---- memory ---- */

uint64_t limit_memory(const struct jobs *j, const struct sched_owner *owner)
{
	if (!j->p.user.memory || owner->exempt)
		return UINT64_MAX;
	return ledger_total(j->p.ledger) / 100 * j->p.user.memory;
}

/* What a run has or may yet ask for without being asked whether it may: its share; its plan, or two domains, one of them
 * for when the other is split. */
static uint64_t run_claim(const struct run *w)
{
	uint64_t least = pipe_budget_min(w->grid && w->state > RUN_OPENING && w->state != RUN_SELECTING ? w->grid : NULL);
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
	uint64_t limit = limit_memory(j, owner), total = ledger_total(j->p.ledger);
	char need[32], may[32];

	if (bytes <= limit)
		return 0;
	err_set(err, ERR_LIMIT, "%s needs %s of memory, and %s are all that one user may have (user-memory, %u%%)", what,
		parse_size_text(bytes, need), parse_size_text(limit, may), j->p.user.memory);
	err_add_hint(err, "ask an administrator for user-memory = %llu%%, or for more memory",
		     (unsigned long long)(bytes / (total / 100) + 1));
	return err_add_place(err, ERR_NO_OFFSET, "user-memory");
}
