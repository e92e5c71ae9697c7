/*
 * Bytes on the disk that one user may have (user-disk). No limit holds for admins.
 *
 * The model: each user who has something has a row: what the lists of datasets and interrupted pushes say (counted by the loop
 * when they change, and now and then), and what open pushes and imports have taken beside it (by workers, under the lock). What
 * is pushed counts with the owner of the dataset, as a file does; until it is published, with the user who pushes, and with both
 * while the push goes on. So pushes at the same time never have more together than there is. What was taken is given back and
 * counted in one step (limit_count_given): nobody finds room, or none, between the two. A geoid grid counts with each user who
 * gave it a name.
 */
#include <assert.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>

#include "core.h"
#include "core_priv.h"
#include "io.h"
#include "parse.h"

struct limit_row {
	uint32_t uid;
	uint64_t counted, taken, geoids;
};

int limit_refused(const char *setting, struct err *err)
{
	err_add_hint(err, "ask an administrator for more, or make room first");
	return err_add_place(err, ERR_NO_OFFSET, setting);
}

void limit_init(struct core *core)
{
	lock_init(&core->limits.lock, LOCK_LIMITS);
}

void limit_done(struct core *core)
{
	free(core->limits.row);
	lock_done(&core->limits.lock);
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

static void count(void *to, uint32_t uid, uint64_t bytes)
{
	struct limit_row *row = bytes ? row_of(to, uid) : NULL;

	if (row)
		row->counted += bytes;
}

static bool limits_disk(const struct core *core)
{
	return core->p.user.disk.unit != SPACE_UNLIMITED && core->p.user.disk.n;
}

static void count_all(struct core *core)
{
	struct limits *l = &core->limits;
	size_t n = 0;

	assert(lock_held(LOCK_LIMITS));
	for (size_t i = 0; i < l->n; i++) {
		l->row[i].counted = 0;
		if (l->row[i].taken || l->row[i].geoids)
			l->row[n++] = l->row[i];
	}
	l->n = n;
	core->used.each(core->used.ctx, count, l);
}

void limit_count(struct core *core)
{
	THREAD_LOOP_ONLY();
	limit_count_given(core, 0, 0, 0, 0);
}

/* An account that there was no memory for has taken nothing. */
static uint64_t given(uint64_t taken, int64_t bytes)
{
	if (bytes < 0)
		return taken + (uint64_t)-bytes;
	return taken > (uint64_t)bytes ? taken - (uint64_t)bytes : 0;
}

void limit_count_given(struct core *core, uint32_t uid, int64_t bytes, uint32_t other, int64_t others)
{
	struct limits *l = &core->limits;
	struct limit_row *row;

	lock_take(&l->lock);
	row = bytes ? row_of(l, uid) : NULL;
	if (row)
		row->taken = given(row->taken, bytes);
	row = others ? row_of(l, other) : NULL;
	if (row)
		row->taken = given(row->taken, others);
	if (limits_disk(core))
		count_all(core);
	lock_give(&l->lock);
}

void limit_geoids(struct core *core, const struct limit_geoid *all, size_t n)
{
	struct limits *l = &core->limits;
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
	const struct space_limit *limit = &core->p.user.disk;
	struct statvfs vfs;

	if (limits_disk(core) && limit->unit == SPACE_BYTES)
		return limit->n;
	/* What cannot be found out limits nothing here: whoever writes next meets the reason. */
	if (!limits_disk(core) || io->fstatvfs(core->p.statefd, &vfs) != 0)
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
	return limit_refused("user-disk", err);
}

int limit_disk_take(struct core *core, uint32_t uid, bool admin, uint64_t bytes, const char *what, struct err *err)
{
	uint64_t limit = admin || rights_stored(uid, 0).admin ? UINT64_MAX : disk_limit(core), has;
	struct limit_row *row;
	int r = 0;

	lock_take(&core->limits.lock);
	row = row_of(&core->limits, uid);
	has = disk_of(row);
	if (!row)
		r = err_set(err, ERR_NOMEM, "no memory for the account of a user");
	else if (bytes > limit || has > limit - bytes)
		r = -ERR_LIMIT;
	else
		row->taken += bytes;
	lock_give(&core->limits.lock);
	return r == -ERR_LIMIT ? disk_refused(uid, bytes, has, limit, what, err) : r;
}

void limit_disk_give(struct core *core, uint32_t uid, uint64_t bytes)
{
	struct limit_row *row;

	if (!bytes)
		return;
	lock_take(&core->limits.lock);
	row = row_of(&core->limits, uid);
	if (row)
		row->taken -= bytes;
	lock_give(&core->limits.lock);
}

void limit_disk_of(struct core *core, uint32_t uid, uint64_t state_bytes, uint64_t *ret_has, uint64_t *ret_most)
{
	const struct space_limit *limit = &core->p.user.disk;

	*ret_has = *ret_most = 0;
	if (!limits_disk(core))
		return;
	*ret_most = limit->unit == SPACE_BYTES ? limit->n : (uint64_t)((double)state_bytes / 100 * (double)limit->n);
	lock_take(&core->limits.lock);
	for (size_t i = 0; i < core->limits.n; i++)
		if (core->limits.row[i].uid == uid)
			*ret_has = disk_of(&core->limits.row[i]);
	lock_give(&core->limits.lock);
}
