/*
 * Bytes on the disk that one user may have (user-disk). Administrators have no limit.
 *
 * The model: each user who has something has a row with two parts. `counted` comes from the lists of datasets and interrupted
 * pushes; the loop counts it again when they change. `taken` is what open pushes and imports have charged beside it; workers
 * change it, under the lock. Pushed data counts for the owner of the dataset, as a file does. Until it is published it counts for
 * the pushing user, and during the push for both, so concurrent pushes never exceed the limit together. Releasing a charge and
 * counting again is one step (limit_release_and_recount), so nobody sees the sum in between. A geoid grid counts for each user
 * who gave it a name.
 */
#include <assert.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>

#include "core_priv.h"
#include "io.h"
#include "parse.h"

void limit_init(struct core_private *priv)
{
	lock_init(&priv->limits.lock, LOCK_LIMITS);
}

void limit_done(struct core_private *priv)
{
	free(priv->limits.row);
	lock_done(&priv->limits.lock);
}

/* The row of the user, made if it is missing. NULL: no memory. */
static struct limit_row *row_of(struct limits *l, uint32_t uid)
{
	struct limit_row *more;

	assert(lock_held(LOCK_LIMITS));
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

static void add_usage(void *to, uint32_t uid, uint64_t bytes, bool pending)
{
	struct limit_row *row = bytes ? row_of(to, uid) : NULL;

	if (!row)
		return;
	row->counted += bytes;
	row->pending += pending ? bytes : 0;
}

static bool is_limited(const struct core *core)
{
	return core->p.limits.user.disk.unit != SPACE_UNLIMITED && core->p.limits.user.disk.n;
}

static void recount_locked(struct core *core)
{
	struct limits *l = &core->priv->limits;
	size_t n = 0;

	assert(lock_held(LOCK_LIMITS));
	for (size_t i = 0; i < l->n; i++) {
		l->row[i].counted = l->row[i].pending = 0;
		if (l->row[i].taken || l->row[i].geoids)
			l->row[n++] = l->row[i];
	}
	l->n = n;
	core->usage.each(core->usage.ctx, add_usage, l);
}

void limit_recount(struct core *core)
{
	THREAD_LOOP_ONLY();
	limit_release_and_recount(core, 0, 0, 0, 0);
}

/* Not below 0: if there was no memory for the row, its charges are missing. */
static uint64_t release(uint64_t taken, int64_t bytes)
{
	if (bytes < 0)
		return taken + (uint64_t)-bytes;
	return taken > (uint64_t)bytes ? taken - (uint64_t)bytes : 0;
}

void limit_release_and_recount(struct core *core, uint32_t uid, int64_t bytes, uint32_t other_uid, int64_t other_bytes)
{
	struct limits *l = &core->priv->limits;
	struct limit_row *row;

	lock_take(&l->lock);
	row = bytes ? row_of(l, uid) : NULL;
	if (row)
		row->taken = release(row->taken, bytes);
	row = other_bytes ? row_of(l, other_uid) : NULL;
	if (row)
		row->taken = release(row->taken, other_bytes);
	if (is_limited(core))
		recount_locked(core);
	lock_give(&l->lock);
}

void limit_geoids(struct core *core, const struct limit_geoid *all, size_t n)
{
	struct limits *l = &core->priv->limits;
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

static uint64_t disk_limit(const struct core *core)
{
	const struct space_limit *limit = &core->p.limits.user.disk;
	struct statvfs vfs;

	if (is_limited(core) && limit->unit == SPACE_BYTES)
		return limit->n;
	/* If the size is unknown, there is no limit here: the next write fails with the reason. */
	if (!is_limited(core) || io->fstatvfs(core->p.statefd, &vfs) != 0)
		return UINT64_MAX;
	return (uint64_t)((double)vfs.f_blocks * (double)vfs.f_frsize / 100 * (double)limit->n);
}

static uint64_t disk_of(const struct limit_row *row)
{
	return row ? row->counted + row->taken + row->geoids : 0;
}

static int refuse_disk(uint32_t uid, uint64_t bytes, uint64_t has, uint64_t pending, uint64_t limit, const char *what,
		       struct err *err)
{
	char need[32], have[32], may[32];

	err_set(err, ERR_LIMIT,
		"%s needs %s on the disk: the user with id %u has %s of the %s that one user may have (user-disk)", what,
		parse_size_text(bytes, need), uid, parse_size_text(has, have), parse_size_text(limit, may));
	if (pending)
		err_add_hint(err,
			     "ask an administrator for more, or make room first: interrupted pushes have %s of it (acutctl "
			     "dataset discard)",
			     parse_size_text(pending, have));
	else
		err_add_hint(err, "ask an administrator for more, or make room first");
	return err_add_place(err, ERR_NO_OFFSET, "user-disk");
}

int limit_disk_take(struct core *core, uint32_t uid, bool admin, uint64_t bytes, const char *what, struct err *err)
{
	uint64_t limit = admin || rights_of_user(uid, 0).admin ? UINT64_MAX : disk_limit(core), has, pending;
	struct limit_row *row;
	int r = 0;

	lock_take(&core->priv->limits.lock);
	row = row_of(&core->priv->limits, uid);
	has = disk_of(row);
	pending = row ? row->pending : 0;
	if (!row)
		r = err_set(err, ERR_NOMEM, "no memory for the account of a user");
	else if (bytes > limit || has > limit - bytes)
		r = -ERR_LIMIT;
	else
		row->taken += bytes;
	lock_give(&core->priv->limits.lock);
	return r == -ERR_LIMIT ? refuse_disk(uid, bytes, has, pending, limit, what, err) : r;
}

void limit_disk_give(struct core *core, uint32_t uid, uint64_t bytes)
{
	struct limit_row *row;

	if (!bytes)
		return;
	lock_take(&core->priv->limits.lock);
	row = row_of(&core->priv->limits, uid);
	if (row)
		row->taken = release(row->taken, (int64_t)bytes);
	lock_give(&core->priv->limits.lock);
}

void limit_disk_of(struct core *core, uint32_t uid, uint64_t state_bytes, uint64_t *ret_has, uint64_t *ret_most)
{
	const struct space_limit *limit = &core->p.limits.user.disk;

	*ret_has = *ret_most = 0;
	if (!is_limited(core))
		return;
	*ret_most = limit->unit == SPACE_BYTES ? limit->n : (uint64_t)((double)state_bytes / 100 * (double)limit->n);
	lock_take(&core->priv->limits.lock);
	for (size_t i = 0; i < core->priv->limits.n; i++)
		if (core->priv->limits.row[i].uid == uid)
			*ret_has = disk_of(&core->priv->limits.row[i]);
	lock_give(&core->priv->limits.lock);
}
