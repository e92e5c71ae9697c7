/*
 * The accounts of the disk.
 *
 * The model: for each kind a sum of what was taken, and one of what other rooms count (datasets: from the catalogue). The sums
 * are compared with the quota. The free space of the file system, less what was taken and is not written yet, is compared with
 * keep-free. Taking queries the file system first, so the writes of other programs count. A file system may never answer: it is
 * queried without the lock, and the loop uses the last answer. Nothing is scanned at a start: the catalogue knows the size of the
 * state, and a worker measures the cache later.
 *
 * Sizes are lengths of files. Manifests, the catalogue and the overhead of the file system are not in the sums, but they reduce
 * the free space.
 */
#include "space.h"

#include <assert.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>

#include "clock.h"
#include "err.h"
#include "io.h"
#include "parse.h"
#include "space_priv.h"

static const struct {
	const char *text;
	bool state;
} kinds[SPACE_KINDS] = {
	[SPACE_DATASETS] = {"datasets", true},
	[SPACE_REMOVED] = {"removed", true},
	[SPACE_PENDING] = {"pending", true},
	[SPACE_MERGES] = {"merges", true},
	[SPACE_PLANS] = {"plans", true},
	[SPACE_DOMAINS] = {"domains", false},
	[SPACE_SELECTIONS] = {"selections", false},
	[SPACE_ONESTEP] = {"one_step", false},
	[SPACE_TEMPORARY] = {"temporary", false},
};

const char *space_kind_text(enum space_kind kind)
{
	return kinds[kind].text;
}

bool space_kind_state(enum space_kind kind)
{
	return kinds[kind].state;
}

static int side_of(enum space_kind kind)
{
	return kinds[kind].state ? SPACE_ON_STATE : SPACE_ON_CACHE;
}

int space_new(const struct space_params *p, struct space **ret, struct err *err)
{
	struct stat state, cache;
	struct space *s;

	if (io->fstat(p->statefd, &state) != 0 || io->fstat(p->cachefd, &cache) != 0)
		return err_sys(err, errno, "the folders of the daemon cannot be examined");
	s = calloc(1, sizeof *s);
	if (!s)
		return err_set(err, ERR_NOMEM, "no memory for the accounts of the disk");
	s->p = *p;
	s->one_fs = state.st_dev == cache.st_dev;
	s->running_since_us = INT64_MAX;
	lock_init(&s->lock, LOCK_SPACE);
	lock_init(&s->evicting, LOCK_EVICT);
	pthread_cond_init(&s->answered, NULL);
	space_query(s);
	*ret = s;
	return 0;
}

void space_set_limits(struct space *s, struct space_limit disk, struct space_limit keep_free)
{
	lock_take(&s->lock);
	s->p.disk = disk;
	s->p.keep_free = keep_free;
	memset(s->futile_ns, 0, sizeof s->futile_ns); /* there may be more to evict now */
	lock_give(&s->lock);
}

struct space *space_free(struct space *s)
{
	struct space_held *next;

	if (!s)
		return NULL;
	for (; s->held; s->held = next) {
		next = s->held->next;
		free(s->held);
	}
	lock_done(&s->lock);
	lock_done(&s->evicting);
	pthread_cond_destroy(&s->answered);
	free(s);
	return NULL;
}

/* ---- file systems ---- */

/* A file system that cannot be queried refuses nothing: the write will fail. */
static struct space_fs query_fs(const struct space *s, int side)
{
	struct space_fs fs = {UINT64_MAX / 128, UINT64_MAX / 128, clock_mono_ns()};
	struct statvfs v;

	if (io->fstatvfs(side == SPACE_ON_STATE ? s->p.statefd : s->p.cachefd, &v) != 0 || !v.f_blocks)
		return fs;
	fs.total = (uint64_t)v.f_blocks * v.f_frsize;
	fs.free = (uint64_t)v.f_bavail * v.f_frsize;
	return fs;
}

void space_query_side(struct space *s, int side)
{
	struct space_fs fs = query_fs(s, side);

	lock_take(&s->lock);
	for (int i = 0; i < SPACE_SIDES; i++)
		if ((i == side || s->one_fs) && fs.queried_ns >= s->fs[i].queried_ns)
			s->fs[i] = fs;
	pthread_cond_broadcast(&s->answered);
	lock_give(&s->lock);
}

void space_query(struct space *s)
{
	space_query_side(s, SPACE_ON_STATE);
	if (!s->one_fs)
		space_query_side(s, SPACE_ON_CACHE);
}

void space_query_wait(struct space *s, uint64_t since_ns, uint64_t until_ns)
{
	bool time_left = true;

	lock_take(&s->lock);
	while (time_left && (s->fs[SPACE_ON_STATE].queried_ns < since_ns || s->fs[SPACE_ON_CACHE].queried_ns < since_ns))
		time_left = lock_wait_until(&s->lock, &s->answered, until_ns);
	lock_give(&s->lock);
}

static uint64_t limit_of(const struct space_limit *limit, uint64_t total, uint64_t none)
{
	return limit->unit == SPACE_BYTES   ? limit->n :
	       limit->unit == SPACE_PERCENT ? total / 100 * limit->n + total % 100 * limit->n / 100 :
					      none;
}

/* State and cache share one quota. */
static bool is_quota_shared(const struct space *s)
{
	assert(lock_held(LOCK_SPACE));
	return s->one_fs || s->p.disk.unit != SPACE_PERCENT;
}

static uint64_t used_on(const struct space *s, int side)
{
	uint64_t sum = 0;

	for (int k = 0; k < SPACE_KINDS; k++)
		if (is_quota_shared(s) || side_of((enum space_kind)k) == side)
			sum += s->taken[k] + s->counted[k];
	return sum;
}

static uint64_t unwritten_on(const struct space *s, int side)
{
	return s->one_fs ? s->unwritten[0] + s->unwritten[1] : s->unwritten[side];
}

static uint64_t subtract(uint64_t a, uint64_t b)
{
	return a > b ? a - b : 0;
}

struct space_shortage space_shortage_of(struct space *s, int side, uint64_t bytes)
{
	const struct space_fs fs = s->fs[side];
	struct space_shortage l = {
		.used = used_on(s, side),
		.quota = limit_of(&s->p.disk, fs.total, UINT64_MAX),
		.free = subtract(fs.free, unwritten_on(s, side)),
		.keep_free = limit_of(&s->p.keep_free, fs.total, 0),
	};

	assert(lock_held(LOCK_SPACE));
	l.by_quota = subtract(bytes, subtract(l.quota, l.used)) + subtract(l.used, l.quota);
	l.by_free = subtract(bytes, subtract(l.free, l.keep_free)) + subtract(l.keep_free, l.free);
	l.bytes = l.by_quota > l.by_free ? l.by_quota : l.by_free;
	return l;
}

/* ---- accounts ---- */

/* Names the limit that is exceeded, with its numbers; of two the one with the larger shortage. */
static int refuse_bytes(struct space *s, int side, uint64_t bytes, const char *what, const struct space_shortage *l,
			struct err *err)
{
	static const char discard[] = ", or discard interrupted pushes (acutctl dataset discard)";
	char need[32], left[32], limit[32], most[32], used[32];
	const char *where = s->one_fs ? "" : side == SPACE_ON_STATE ? " of --state" : " of --cache";
	struct space_limit disk, keep_free;
	bool both, pending;

	lock_take(&s->lock);
	disk = s->p.disk;
	keep_free = s->p.keep_free;
	both = is_quota_shared(s);
	pending = s->counted[SPACE_PENDING];
	lock_give(&s->lock);
	parse_size_text(bytes, need);
	if (l->by_quota && l->by_quota >= l->by_free) {
		err_set(err, ERR_NOSPACE, "%s needs %s, %s are left of the quota%s: %s of %s are used (--disk %s)", what, need,
			parse_size_text(subtract(l->quota, l->used), left), both ? "" : where, parse_size_text(l->used, used),
			parse_size_text(l->quota, most), space_limit_text(&disk, limit));
		err_add_hint(err,
			     "give acutd a larger --disk%s, or remove datasets that nobody needs (acutctl dataset rm): "
			     "they count until they cannot be restored any more (--keep-removed)",
			     pending ? discard : "");
	} else {
		err_set(err, ERR_NOSPACE, "%s needs %s, %s are free on the file system%s, of which %s stay free (--keep-free %s)",
			what, need, parse_size_text(l->free, left), where, parse_size_text(l->keep_free, most),
			space_limit_text(&keep_free, limit));
		err_add_hint(err, "make room on the disk%s, or remove datasets that nobody needs (acutctl dataset rm)",
			     pending ? discard : "");
	}
	err->need = l->bytes;
	return -ERR_NOSPACE;
}

uint64_t space_evictable(const struct space *s, int side, const struct space_shortage *l)
{
	if (s->one_fs || side == SPACE_ON_CACHE)
		return l->bytes;
	return is_quota_shared(s) ? l->by_quota : 0;
}

/* Eviction removes the shortage; in_part: a part of it. */
static bool can_evict(const struct space *s, int side, const struct space_shortage *l, enum space_need need, bool in_part)
{
	enum { AGAIN_SECONDS = 2 };
	uint64_t derived = s->taken[SPACE_DOMAINS] + s->taken[SPACE_SELECTIONS];

	if (!derived && s->measured)
		return false;
	if (s->futile_ns[need] && clock_since(s->futile_ns[need]) < AGAIN_SECONDS)
		return false;
	if (!in_part && (space_evictable(s, side, l) < l->bytes || (s->measured && derived < l->bytes)))
		return false;
	return space_evictable(s, side, l) > 0;
}

int space_take(struct space *s, enum space_kind kind, uint64_t bytes, enum space_need need, const char *what, struct err *err)
{
	int side = side_of(kind), r = 0;
	struct space_shortage l;

	/* A wrong header may claim any size. */
	if (bytes > UINT64_MAX / 16)
		bytes = UINT64_MAX / 16;
	for (bool tried = false;; tried = true) {
		uint64_t gone, files;
		bool evict;

		space_query_side(s, side);
		lock_take(&s->lock);
		l = space_shortage_of(s, side, bytes);
		if (!l.bytes) {
			s->taken[kind] += bytes;
			s->uncommitted[kind] += bytes;
		}
		evict = l.bytes && !tried && can_evict(s, side, &l, need, false);
		lock_give(&s->lock);
		if (!l.bytes)
			return 0;
		if (!evict)
			return refuse_bytes(s, side, bytes, what, &l, err);
		r = space_evict_for(s, side, bytes, need, &gone, &files, err);
		if (r)
			return r;
	}
}

void space_give(struct space *s, enum space_kind kind, uint64_t bytes)
{
	lock_take(&s->lock);
	s->taken[kind] = subtract(s->taken[kind], bytes);
	lock_give(&s->lock);
}

void space_commit(struct space *s, enum space_kind kind, uint64_t taken, uint64_t bytes)
{
	lock_take(&s->lock);
	s->taken[kind] = subtract(s->taken[kind], taken) + bytes;
	s->uncommitted[kind] = subtract(s->uncommitted[kind], taken);
	s->committed[kind] += bytes;
	lock_give(&s->lock);
}

void space_count_entries(struct space *s, enum space_kind kind, int entries)
{
	lock_take(&s->lock);
	s->entries[kind] =
		entries < 0 ? subtract(s->entries[kind], (uint64_t) - (int64_t)entries) : s->entries[kind] + (uint64_t)entries;
	lock_give(&s->lock);
}

void space_add_unwritten(struct space *s, enum space_kind kind, int64_t bytes)
{
	uint64_t *to = &s->unwritten[side_of(kind)];

	lock_take(&s->lock);
	*to = bytes < 0 ? subtract(*to, (uint64_t)-bytes) : *to + (uint64_t)bytes;
	lock_give(&s->lock);
}

void space_set_counted(struct space *s, enum space_kind kind, uint64_t bytes)
{
	lock_take(&s->lock);
	s->counted[kind] = bytes;
	lock_give(&s->lock);
}

bool space_would_fit(struct space *s, enum space_kind kind, uint64_t bytes, uint64_t *ret_missing)
{
	int side = side_of(kind);
	struct space_shortage l;

	lock_take(&s->lock);
	l = space_shortage_of(s, side, bytes);
	if (can_evict(s, side, &l, SPACE_MUST, false))
		l.bytes = 0;
	lock_give(&s->lock);
	*ret_missing = l.bytes;
	return !l.bytes;
}

bool space_is_inexact(struct space *s)
{
	bool inexact;

	lock_take(&s->lock);
	inexact = s->inexact && !s->uncommitted[SPACE_DOMAINS] && !s->uncommitted[SPACE_SELECTIONS];
	lock_give(&s->lock);
	return inexact;
}

bool space_is_exceeded(struct space *s)
{
	bool exceeded = false;

	lock_take(&s->lock);
	for (int side = 0; side < SPACE_SIDES; side++) {
		struct space_shortage l = space_shortage_of(s, side, 0);

		exceeded |= l.bytes && can_evict(s, side, &l, SPACE_MUST, true);
	}
	lock_give(&s->lock);
	return exceeded;
}

/* ---- entries in use ---- */

void space_hold(struct space *s, struct digest selection)
{
	struct space_held *h;

	lock_take(&s->lock);
	for (h = s->held; h && !digest_equal(h->selection, selection); h = h->next)
		;
	/* Without memory the selection is not marked and may be evicted. Its reader has the files open. */
	if (!h && (h = calloc(1, sizeof *h))) {
		h->selection = selection;
		h->next = s->held;
		s->held = h;
	}
	if (h)
		h->users++;
	lock_give(&s->lock);
}

void space_release(struct space *s, struct digest selection)
{
	struct space_held **at, *h;

	lock_take(&s->lock);
	for (at = &s->held; (h = *at) && !digest_equal(h->selection, selection); at = &h->next)
		;
	if (h && !--h->users) {
		*at = h->next;
		free(h);
	}
	lock_give(&s->lock);
}

bool space_is_held(struct space *s, const char *selection)
{
	char name[DIGEST_HEX_SIZE];
	struct space_held *h;

	lock_take(&s->lock);
	for (h = s->held; h && strcmp(digest_hex(h->selection, name), selection); h = h->next)
		;
	lock_give(&s->lock);
	return h != NULL;
}

void space_running_since(struct space *s, int64_t us)
{
	lock_take(&s->lock);
	s->running_since_us = us;
	lock_give(&s->lock);
}

/* ---- reports ---- */

void space_stat(struct space *s, struct space_stat *ret)
{
	*ret = (struct space_stat){.one_fs = s->one_fs};
	lock_take(&s->lock);
	for (int k = 0; k < SPACE_KINDS; k++) {
		ret->kind[k].bytes = s->taken[k] + s->counted[k];
		ret->kind[k].entries = k == SPACE_DOMAINS || k == SPACE_SELECTIONS ? s->entries[k] : 0;
	}
	for (int side = 0; side < SPACE_SIDES; side++) {
		struct space_shortage l = space_shortage_of(s, side, 0);

		*(side == SPACE_ON_STATE ? &ret->state : &ret->cache) = (struct space_side){
			.used = l.used,
			.quota = l.quota,
			.total = s->fs[side].total,
			.free = s->fs[side].free,
			.keep_free = l.keep_free,
		};
	}
	ret->measured = s->measured;
	ret->evicted_bytes = s->evicted_bytes;
	ret->evicted_files = s->evicted_files;
	lock_give(&s->lock);
}
