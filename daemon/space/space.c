/*
 * The accounts of the disk.
 *
 * The model: a sum for each kind, of what was taken and of what others keep count of (datasets: the catalogue). The
 * sums are held against the quota, and what the file system says is free, less what was promised and is not written
 * yet, against keep-free. Whoever takes asks the file system first, so what other programs write counts; it may never
 * answer, so nobody asks under the lock, and the loop goes by the last answer. Nothing is scanned at a
 * start: state is known from the catalogue, and of the cache only what is derived is measured, later, by a worker.
 *
 * Sizes are lengths of files: manifests, the catalogue and what the file system itself needs are in what is free, not
 * in the sums.
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
		return err_sys(err, errno, "the folders of the daemon cannot be looked at");
	s = calloc(1, sizeof *s);
	if (!s)
		return err_set(err, ERR_NOMEM, "no memory for the accounts of the disk");
	s->p = *p;
	s->one = state.st_dev == cache.st_dev;
	s->since_us = INT64_MAX;
	lock_init(&s->lock, LOCK_SPACE);
	lock_init(&s->evicting, LOCK_EVICT);
	pthread_cond_init(&s->answered, NULL);
	space_ask(s);
	*ret = s;
	return 0;
}

void space_set_limits(struct space *s, struct space_limit disk, struct space_limit keep_free)
{
	lock_take(&s->lock);
	s->p.disk = disk;
	s->p.keep_free = keep_free;
	memset(s->in_vain_ns, 0, sizeof s->in_vain_ns); /* more may be to be found now */
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

/* ---- what there is ---- */

/* Of a file system that cannot be asked nothing is refused: writing will tell. */
static struct space_fs fs_of(const struct space *s, int side)
{
	struct space_fs fs = {UINT64_MAX / 128, UINT64_MAX / 128, clock_mono_ns()};
	struct statvfs v;

	if (io->fstatvfs(side == SPACE_ON_STATE ? s->p.statefd : s->p.cachefd, &v) != 0 || !v.f_blocks)
		return fs;
	fs.total = (uint64_t)v.f_blocks * v.f_frsize;
	fs.free = (uint64_t)v.f_bavail * v.f_frsize;
	return fs;
}

void space_ask_side(struct space *s, int side)
{
	struct space_fs fs = fs_of(s, side);

	lock_take(&s->lock);
	for (int i = 0; i < SPACE_SIDES; i++)
		if ((i == side || s->one) && fs.asked_ns >= s->fs[i].asked_ns)
			s->fs[i] = fs;
	pthread_cond_broadcast(&s->answered);
	lock_give(&s->lock);
}

void space_ask(struct space *s)
{
	space_ask_side(s, SPACE_ON_STATE);
	if (!s->one)
		space_ask_side(s, SPACE_ON_CACHE);
}

void space_ask_wait(struct space *s, uint64_t since_ns, uint64_t until_ns)
{
	bool time_left = true;

	lock_take(&s->lock);
	while (time_left && (s->fs[SPACE_ON_STATE].asked_ns < since_ns || s->fs[SPACE_ON_CACHE].asked_ns < since_ns))
		time_left = lock_wait_until(&s->lock, &s->answered, until_ns);
	lock_give(&s->lock);
}

static uint64_t limit_of(const struct space_limit *limit, uint64_t total, uint64_t none)
{
	return limit->unit == SPACE_BYTES   ? limit->n :
	       limit->unit == SPACE_PERCENT ? total / 100 * limit->n + total % 100 * limit->n / 100 :
					      none;
}

/* One number for both, or one for each. */
static bool shared(const struct space *s)
{
	return s->one || s->p.disk.unit != SPACE_PERCENT;
}

static uint64_t used_on(const struct space *s, int side)
{
	uint64_t sum = 0;

	for (int k = 0; k < SPACE_KINDS; k++)
		if (shared(s) || side_of((enum space_kind)k) == side)
			sum += s->taken[k] + s->set[k];
	return sum;
}

static uint64_t promised_on(const struct space *s, int side)
{
	return s->one ? s->promised[0] + s->promised[1] : s->promised[side];
}

static uint64_t less(uint64_t a, uint64_t b)
{
	return a > b ? a - b : 0;
}

struct space_lack space_lack_of(struct space *s, int side, uint64_t bytes)
{
	const struct space_fs fs = s->fs[side];
	struct space_lack l = {
		.used = used_on(s, side),
		.quota = limit_of(&s->p.disk, fs.total, UINT64_MAX),
		.free = less(fs.free, promised_on(s, side)),
		.keep_free = limit_of(&s->p.keep_free, fs.total, 0),
	};

	assert(lock_held(LOCK_SPACE));
	l.by_quota = less(bytes, less(l.quota, l.used)) + less(l.used, l.quota);
	l.by_free = less(bytes, less(l.free, l.keep_free)) + less(l.keep_free, l.free);
	l.bytes = l.by_quota > l.by_free ? l.by_quota : l.by_free;
	return l;
}

/* ---- asking ---- */

/* Which bound it is that does not hold, in its numbers; of two the one that lacks more decides. */
static int refuse(struct space *s, int side, uint64_t bytes, const char *what, const struct space_lack *l, struct err *err)
{
	char need[32], left[32], limit[32], most[32], used[32];
	const char *where = s->one ? "" : side == SPACE_ON_STATE ? " of --state" : " of --cache";
	struct space_limit disk, keep_free;
	bool both;

	lock_take(&s->lock);
	disk = s->p.disk;
	keep_free = s->p.keep_free;
	both = shared(s);
	lock_give(&s->lock);
	parse_size_text(bytes, need);
	if (l->by_quota && l->by_quota >= l->by_free) {
		err_set(err, ERR_NOSPACE, "%s needs %s, %s are left of the quota%s: %s of %s are used (--disk %s)", what, need,
			parse_size_text(less(l->quota, l->used), left), both ? "" : where, parse_size_text(l->used, used),
			parse_size_text(l->quota, most), space_limit_text(&disk, limit));
		err_add_hint(err, "give acutd a larger --disk, or remove datasets that nobody needs (acutctl dataset rm): "
				  "they count until they cannot be restored any more (--keep-removed)");
	} else {
		err_set(err, ERR_NOSPACE, "%s needs %s, %s are free on the file system%s, of which %s stay free (--keep-free %s)",
			what, need, parse_size_text(l->free, left), where, parse_size_text(l->keep_free, most),
			space_limit_text(&keep_free, limit));
		err_add_hint(err, "make room on the disk, or remove datasets that nobody needs (acutctl dataset rm)");
	}
	err->need = l->bytes;
	return -ERR_NOSPACE;
}

uint64_t space_by_cache(const struct space *s, int side, const struct space_lack *l)
{
	if (s->one || side == SPACE_ON_CACHE)
		return l->bytes;
	return shared(s) ? l->by_quota : 0;
}

/* Removing derived data mends it; in part: makes it better. */
static bool helps(const struct space *s, int side, const struct space_lack *l, enum space_need need, bool in_part)
{
	enum { AGAIN_SECONDS = 2 };
	uint64_t derived = s->taken[SPACE_DOMAINS] + s->taken[SPACE_SELECTIONS];

	if (!derived && s->measured)
		return false;
	if (s->in_vain_ns[need] && clock_since(s->in_vain_ns[need]) < AGAIN_SECONDS)
		return false;
	if (!in_part && (space_by_cache(s, side, l) < l->bytes || (s->measured && derived < l->bytes)))
		return false;
	return space_by_cache(s, side, l) > 0;
}

int space_take(struct space *s, enum space_kind kind, uint64_t bytes, enum space_need need, const char *what, struct err *err)
{
	int side = side_of(kind), r = 0;
	struct space_lack l;

	/* What a lying header claims. */
	if (bytes > UINT64_MAX / 16)
		bytes = UINT64_MAX / 16;
	for (bool tried = false;; tried = true) {
		uint64_t gone, files;
		bool evicts;

		space_ask_side(s, side);
		lock_take(&s->lock);
		l = space_lack_of(s, side, bytes);
		if (!l.bytes) {
			s->taken[kind] += bytes;
			s->open[kind] += bytes;
		}
		evicts = l.bytes && !tried && helps(s, side, &l, need, false);
		lock_give(&s->lock);
		if (!l.bytes)
			return 0;
		if (!evicts)
			return refuse(s, side, bytes, what, &l, err);
		r = space_evict_for(s, side, bytes, need, &gone, &files, err);
		if (r)
			return r;
	}
}

void space_give(struct space *s, enum space_kind kind, uint64_t bytes)
{
	lock_take(&s->lock);
	s->taken[kind] = less(s->taken[kind], bytes);
	lock_give(&s->lock);
}

void space_change(struct space *s, enum space_kind kind, uint64_t taken, uint64_t bytes)
{
	lock_take(&s->lock);
	s->taken[kind] = less(s->taken[kind], taken) + bytes;
	s->open[kind] = less(s->open[kind], taken);
	s->come[kind] += bytes;
	lock_give(&s->lock);
}

void space_count(struct space *s, enum space_kind kind, int entries)
{
	lock_take(&s->lock);
	s->entries[kind] =
		entries < 0 ? less(s->entries[kind], (uint64_t) - (int64_t)entries) : s->entries[kind] + (uint64_t)entries;
	lock_give(&s->lock);
}

void space_promise(struct space *s, enum space_kind kind, int64_t bytes)
{
	uint64_t *to = &s->promised[side_of(kind)];

	lock_take(&s->lock);
	*to = bytes < 0 ? less(*to, (uint64_t)-bytes) : *to + (uint64_t)bytes;
	lock_give(&s->lock);
}

void space_set(struct space *s, enum space_kind kind, uint64_t bytes)
{
	lock_take(&s->lock);
	s->set[kind] = bytes;
	lock_give(&s->lock);
}

bool space_would(struct space *s, enum space_kind kind, uint64_t bytes, uint64_t *ret_lacks)
{
	int side = side_of(kind);
	struct space_lack l;

	lock_take(&s->lock);
	l = space_lack_of(s, side, bytes);
	if (helps(s, side, &l, SPACE_MUST, false))
		l.bytes = 0;
	lock_give(&s->lock);
	*ret_lacks = l.bytes;
	return !l.bytes;
}

bool space_over(struct space *s)
{
	bool over;

	lock_take(&s->lock);
	over = false;
	for (int side = 0; side < SPACE_SIDES; side++) {
		struct space_lack l = space_lack_of(s, side, 0);

		over |= l.bytes && helps(s, side, &l, SPACE_MUST, true);
	}
	lock_give(&s->lock);
	return over;
}

/* ---- what goes last ---- */

void space_hold(struct space *s, struct digest selection)
{
	struct space_held *h;

	lock_take(&s->lock);
	for (h = s->held; h && !digest_equal(h->selection, selection); h = h->next)
		;
	/* Without memory for that it may be evicted as any other: its reader has it open. */
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
	s->since_us = us;
	lock_give(&s->lock);
}

/* ---- telling ---- */

void space_stat(struct space *s, struct space_stat *ret)
{
	*ret = (struct space_stat){.one = s->one};
	lock_take(&s->lock);
	for (int k = 0; k < SPACE_KINDS; k++) {
		ret->kind[k].bytes = s->taken[k] + s->set[k];
		ret->kind[k].entries = k == SPACE_DOMAINS || k == SPACE_SELECTIONS ? s->entries[k] : 0;
	}
	for (int side = 0; side < SPACE_SIDES; side++) {
		struct space_lack l = space_lack_of(s, side, 0);

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
