/*
 * Plans in files.
 *
 * A file is records of PLAN_RECORD bytes: a header, the leaves of the plan as it was made, then three records for each
 * split: the region that was split and its halves. Each record ends with its own checksum, and the header has a
 * digest of all leaves. The file appears complete (temporary name, rename). A run that sends no blocks does not wait for
 * the disk: plan_file_settle calls fsync before the first block, and plan_file_read before a plan is used again. From then
 * on a split is durable before one of its halves is triangulated. An incomplete split at the end of the file is ignored: no
 * block of its halves was sent. Two concurrent runs may append the same split; the second one finds no region to split.
 * Records of finished domains stand between the splits, and nothing waits for them: the fsync of a split makes all records
 * before it durable. The first incomplete record ends the file.
 */
#include "plan_file.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "err.h"
#include "io.h"
#include "ledger.h"
#include "lock.h"
#include "log.h"
#include "parse.h"
#include "plan_record.h"

enum { CHUNK = 512 };

struct split {
	struct cut_region whole;
	struct cut_leaf half[2];
};

struct plan_file {
	int dirfd;
	uint64_t job, generation;
	bool durable;
	struct ledger *ledger; /* borrowed; NULL: none */
	char name[PLAN_NAME];
	struct lock lock;    /* guards the file, settled, fresh and size. Held during an fsync, so the loop never takes it */
	bool settled;        /* the file survives a crash */
	bool fresh;          /* a file of that name belongs to another job, or did not reach the disk */
	struct lock list;    /* guards the splits below; a writer of them holds `lock`, then `list` */
	uint64_t size;       /* of the complete records in the file */
	struct split *split; /* since the daemon started */
	size_t n, room;
};

struct plan_file *plan_file_new(int dirfd, uint64_t job, uint64_t generation, bool durable, struct ledger *ledger)
{
	struct plan_file *f = calloc(1, sizeof *f);

	if (!f)
		return NULL;
	f->dirfd = dirfd;
	f->job = job;
	f->generation = generation;
	f->durable = durable;
	f->ledger = ledger;
	snprintf(f->name, sizeof f->name, "plan-%llu", (unsigned long long)job);
	lock_init(&f->lock, LOCK_PLAN_FILE);
	lock_init(&f->list, LOCK_PLAN_SPLITS);
	return f;
}

void plan_file_fresh(struct plan_file *f)
{
	f->fresh = true;
}

struct plan_file *plan_file_free(struct plan_file *f)
{
	if (!f)
		return NULL;
	lock_done(&f->lock);
	lock_done(&f->list);
	free(f->split);
	if (f->ledger && f->room)
		ledger_give(f->ledger, LEDGER_PLAN, f->room * sizeof *f->split);
	free(f);
	return NULL;
}

uint64_t plan_file_job(const char *name)
{
	uint64_t job;

	return !strncmp(name, "plan-", 5) && parse_u64(name + 5, &job) ? job : 0;
}

/* ---- plans of removed jobs ---- */

/* Read lock: writing a durable plan. Write lock: removing what interrupted writes left. */
static pthread_rwlock_t sweep_lock = PTHREAD_RWLOCK_INITIALIZER;

struct sweep {
	int dirfd;
	uint64_t last;
	bool (*there)(void *ctx, uint64_t job);
	void *ctx;
	const atomic_bool *stop;
};

static int sweep_one(void *ctx, const struct dirent *e, struct err *err)
{
	const struct sweep *s = ctx;
	uint64_t job = plan_file_job(e->d_name);

	if (s->stop && atomic_load(s->stop))
		return err_set(err, ERR_CANCELLED, "ended before all was removed");
	return job > s->last || (job && s->there(s->ctx, job)) ? 0 : io_remove(s->dirfd, e->d_name, err);
}

int plan_file_sweep(int plansfd, uint64_t last, bool (*there)(void *ctx, uint64_t job), void *ctx, const atomic_bool *stop,
		    struct err *err)
{
	int r;

	lock_enter(LOCK_PLAN_SWEEP);
	pthread_rwlock_wrlock(&sweep_lock);
	r = io_list(plansfd, ".", sweep_one, &(struct sweep){plansfd, last, there, ctx, stop}, err);
	pthread_rwlock_unlock(&sweep_lock);
	lock_leave(LOCK_PLAN_SWEEP);
	return r;
}

/* ---- plans in memory ---- */

/* A region that is not among the leaves from `least` on was split before. */
static int plan_apply(struct cut_plan *plan, size_t least, const struct split *s, struct err *err)
{
	size_t i;
	int r;

	for (i = least; i < plan->n && !cut_region_same(&plan->leaf[i].region, &s->whole); i++)
		;
	if (i >= plan->n)
		return 0;
	r = cut_plan_room(plan, plan->n + 1, err);
	if (r)
		return r;
	memmove(plan->leaf + i + 2, plan->leaf + i + 1, (plan->n - i - 1) * sizeof *plan->leaf);
	plan->leaf[i] = s->half[0];
	plan->leaf[i + 1] = s->half[1];
	plan->n++;
	return 0;
}

/* ---- writing ---- */

static int write_leaves(const struct plan_file *f, int fd, const struct cut_plan *plan, struct digest *ret, struct err *err)
{
	struct digest_stream *sum = digest_stream_new();
	uint8_t *chunk = malloc(CHUNK * PLAN_RECORD);
	int r = 0;

	if (!sum || !chunk)
		r = err_set(err, ERR_NOMEM, "no memory to keep a plan");
	for (size_t i = 0; !r && i < plan->n;) {
		size_t n = plan->n - i < CHUNK ? plan->n - i : CHUNK;

		for (size_t k = 0; k < n; k++)
			plan_leaf_pack(PLAN_LEAF, &plan->leaf[i + k], chunk + k * PLAN_RECORD);
		digest_stream_add(sum, chunk, n * PLAN_RECORD);
		r = io_write_at(fd, chunk, n * PLAN_RECORD, (i + 1) * PLAN_RECORD, f->name, err);
		i += n;
	}
	if (!r)
		*ret = digest_stream_end(sum);
	digest_stream_free(sum);
	free(chunk);
	return r;
}

static int write_file(struct plan_file *f, const struct cut_plan *plan, struct plan_kept *kept, struct err *err)
{
	struct plan_head head = {.job = f->job, .generation = f->generation, .n = plan->n, .kept = *kept};
	uint8_t record[PLAN_RECORD];
	char temp[PLAN_NAME + 8];
	uint64_t cap = kept->cap;
	int fd, r;

	snprintf(temp, sizeof temp, "%s.tmp", f->name);
	r = io_open(f->dirfd, temp, O_WRONLY | O_CREAT | O_TRUNC, 0600, &fd, err);
	if (r)
		return r;
	r = write_leaves(f, fd, plan, &head.leaves, err);
	head.kept.base = digest_hash(&cap, sizeof cap);
	digest_add(&head.kept.base, head.leaves);
	plan_head_pack(&head, record);
	if (!r)
		r = io_write_at(fd, record, PLAN_RECORD, 0, f->name, err);
	/* ext4 writes a file that replaces another one at once, and an error of that is lost: no fsync would tell it. */
	if (!r)
		io->unlinkat(f->dirfd, f->name, 0);
	if (!r && io->renameat(f->dirfd, temp, f->dirfd, f->name) < 0)
		r = err_sys(err, errno, "cannot publish %s", f->name);
	if (r)
		io->unlinkat(f->dirfd, temp, 0);
	io_close(fd);
	if (r)
		return r;
	f->size = (plan->n + 1) * PLAN_RECORD;
	f->settled = false;
	f->fresh = false;
	kept->base = head.kept.base;
	return 0;
}

static int write_plan(struct plan_file *f, const struct cut_plan *plan, struct plan_kept *kept, struct err *err)
{
	int r;

	if (!f->durable)
		return write_file(f, plan, kept, err);
	lock_enter(LOCK_PLAN_SWEEP);
	pthread_rwlock_rdlock(&sweep_lock);
	r = write_file(f, plan, kept, err);
	pthread_rwlock_unlock(&sweep_lock);
	lock_leave(LOCK_PLAN_SWEEP);
	return r;
}

/* A plan that is not durable may be lost: a later stream of the job then has a plan, and a stream id, of its own. */
static int forgive(const struct plan_file *f, int r, struct err *err)
{
	if (!r || f->durable || r == -ERR_NOMEM)
		return r;
	log_err(LOG_LEVEL_DEBUG, "a plan is not kept", err);
	err_clear(err);
	return 0;
}

int plan_file_write(struct plan_file *f, const struct cut_plan *plan, struct plan_kept *kept, struct err *err)
{
	int r;

	lock_take(&f->lock);
	r = forgive(f, write_plan(f, plan, kept, err), err);
	lock_give(&f->lock);
	return r;
}

/* A file whose fsync failed is removed, so that no later read trusts it. */
static int settle(struct plan_file *f, int fd, struct err *err)
{
	int r;

	if (!f->durable || f->settled)
		return 0;
	r = io_sync(fd, f->name, err);
	if (!r)
		r = io_sync(f->dirfd, f->name, err);
	if (r)
		io->unlinkat(f->dirfd, f->name, 0);
	f->settled = !r;
	f->fresh = r != 0;
	return r;
}

int plan_file_settle(struct plan_file *f, struct err *err)
{
	int fd, r = 0;

	lock_take(&f->lock);
	if (f->durable && !f->settled) {
		r = io_open(f->dirfd, f->name, O_RDONLY, 0, &fd, err);
		if (!r) {
			r = settle(f, fd, err);
			io_close(fd);
		}
	}
	lock_give(&f->lock);
	return r;
}

/* ---- splits ---- */

static bool split_known(const struct plan_file *f, const struct cut_region *whole)
{
	for (size_t i = 0; i < f->n; i++)
		if (cut_region_same(&f->split[i].whole, whole))
			return true;
	return false;
}

static int append(struct plan_file *f, const uint8_t *records, size_t size, bool durable, struct err *err)
{
	int fd, r = io_open(f->dirfd, f->name, O_WRONLY, 0, &fd, err);

	if (r)
		return r;
	r = io_write_at(fd, records, size, f->size, f->name, err);
	if (!r && durable)
		r = io_sync(fd, f->name, err);
	io_close(fd);
	if (!r)
		f->size += size;
	return r;
}

static int append_split(struct plan_file *f, const struct split *s, struct err *err)
{
	const struct cut_leaf whole = {.region = s->whole};
	uint8_t record[3 * PLAN_RECORD];

	plan_leaf_pack(PLAN_WHOLE, &whole, record);
	plan_leaf_pack(PLAN_HALF, &s->half[0], record + PLAN_RECORD);
	plan_leaf_pack(PLAN_HALF, &s->half[1], record + 2 * PLAN_RECORD);
	/* No block of an unsettled plan was sent, so its splits need no fsync; nobody reads a lost plan. */
	return f->fresh ? 0 : append(f, record, sizeof record, f->durable && f->settled, err);
}

static int split_room(struct plan_file *f, size_t room, struct err *err)
{
	uint64_t bytes = (room - f->room) * sizeof *f->split;
	struct split *grown;

	if (f->ledger && !ledger_take(f->ledger, LEDGER_PLAN, bytes))
		return err_set(err, ERR_BUSY, "the memory has no room for the splits of a plan");
	grown = realloc(f->split, room * sizeof *grown);
	if (!grown) {
		if (f->ledger)
			ledger_give(f->ledger, LEDGER_PLAN, bytes);
		return err_set(err, ERR_NOMEM, "no memory for the splits of a plan");
	}
	f->split = grown;
	f->room = room;
	return 0;
}

int plan_file_split(struct plan_file *f, const struct cut_region *whole, const struct cut_leaf half[2], struct err *err)
{
	const struct split s = {*whole, {half[0], half[1]}};
	int r = 0;

	lock_take(&f->lock);
	if (!split_known(f, whole)) {
		if (f->n == f->room) {
			lock_take(&f->list);
			r = split_room(f, f->room ? 2 * f->room : 16, err);
			lock_give(&f->list);
		}
		if (!r)
			r = forgive(f, append_split(f, &s, err), err);
		if (!r) {
			lock_take(&f->list);
			f->split[f->n++] = s;
			lock_give(&f->list);
		}
	}
	lock_give(&f->lock);
	return r;
}

int plan_file_done(struct plan_file *f, const struct plan_done *done, size_t n, struct err *err)
{
	enum { AT_ONCE = 128 };
	uint8_t record[AT_ONCE * PLAN_RECORD];
	int r = 0;

	while (!r && n) {
		size_t some = n < AT_ONCE ? n : AT_ONCE;

		for (size_t i = 0; i < some; i++)
			plan_done_pack(done++, record + i * PLAN_RECORD);
		n -= some;
		lock_take(&f->lock);
		/* A file without a header takes no records. */
		if (f->size && !f->fresh)
			r = append(f, record, some * PLAN_RECORD, false, err);
		lock_give(&f->lock);
	}
	return r;
}

int plan_file_follow(struct plan_file *f, size_t *seen, size_t least, struct cut_plan *plan, struct err *err)
{
	int r = 0;

	lock_take(&f->list);
	while (!r && *seen < f->n) {
		r = plan_apply(plan, least, &f->split[*seen], err);
		*seen += !r;
	}
	lock_give(&f->list);
	return r;
}

/* ---- reading ---- */

/* PLAN_FILE_ABSENT: the leaves are damaged. */
static int read_leaves(const struct plan_file *f, int fd, const struct plan_head *head, struct cut_plan *plan, struct err *err)
{
	struct digest_stream *sum = digest_stream_new();
	uint8_t *chunk = malloc(CHUNK * PLAN_RECORD);
	int r = cut_plan_room(plan, head->n, err);

	if (!r && (!sum || !chunk))
		r = err_set(err, ERR_NOMEM, "no memory to read a plan");
	while (!r && plan->n < head->n) {
		size_t n = head->n - plan->n < CHUNK ? head->n - plan->n : CHUNK, got = 0;

		r = io_read_some(fd, chunk, n * PLAN_RECORD, (plan->n + 1) * PLAN_RECORD, f->name, &got, err);
		if (!r && got < n * PLAN_RECORD)
			r = PLAN_FILE_ABSENT;
		for (size_t k = 0; !r && k < n; k++)
			if (!plan_leaf_unpack(PLAN_LEAF, chunk + k * PLAN_RECORD, &plan->leaf[plan->n++]))
				r = PLAN_FILE_ABSENT;
		if (!r)
			digest_stream_add(sum, chunk, n * PLAN_RECORD);
	}
	if (!r && !digest_equal(digest_stream_end(sum), head->leaves))
		r = PLAN_FILE_ABSENT;
	digest_stream_free(sum);
	free(chunk);
	return r;
}

/* Applies all complete splits, and finds the end of the complete records. */
static int read_splits(struct plan_file *f, int fd, struct cut_plan *plan, struct err *err)
{
	uint8_t record[3 * PLAN_RECORD];

	f->size = (plan->n + 1) * PLAN_RECORD;
	for (;;) {
		struct cut_leaf whole;
		struct split s;
		size_t size;
		int r = plan_record_next(f->name, fd, f->size, record, &size, err);

		if (r || !size)
			return r;
		if (size > PLAN_RECORD) {
			if (!plan_leaf_unpack(PLAN_WHOLE, record, &whole) ||
			    !plan_leaf_unpack(PLAN_HALF, record + PLAN_RECORD, &s.half[0]) ||
			    !plan_leaf_unpack(PLAN_HALF, record + 2 * PLAN_RECORD, &s.half[1]))
				return 0;
			s.whole = whole.region;
			r = plan_apply(plan, 0, &s, err);
			if (r)
				return r;
		}
		f->size += size;
	}
}

static int read_plan(struct plan_file *f, struct cut_plan *plan, struct plan_kept *kept, struct err *err)
{
	uint8_t record[PLAN_RECORD];
	struct plan_head head;
	struct stat st;
	size_t got = 0;
	int fd = io->openat(f->dirfd, f->name, O_RDONLY | O_CLOEXEC, 0), r;

	if (fd < 0)
		return errno == ENOENT ? PLAN_FILE_ABSENT : err_sys(err, errno, "cannot open %s", f->name);
	/* A power cut leaves an empty or torn file of a plan of which no block has left. */
	r = io_read_some(fd, record, PLAN_RECORD, 0, f->name, &got, err);
	if (!r && (got < PLAN_RECORD || !plan_head_unpack(record, &head) || head.job != f->job ||
		   head.generation != f->generation || io->fstat(fd, &st) < 0 || head.n >= (uint64_t)st.st_size / PLAN_RECORD))
		r = PLAN_FILE_ABSENT;
	if (!r)
		r = read_leaves(f, fd, &head, plan, err);
	if (!r)
		r = read_splits(f, fd, plan, err);
	if (!r)
		r = settle(f, fd, err);
	if (r == PLAN_FILE_ABSENT && got)
		log_event(LOG_EVENT_DAMAGE_DERIVED, &(struct log_about){.job = f->job},
			  "the plan of job %llu is damaged: it is made again, and streams that had begun cannot go on",
			  (unsigned long long)f->job);
	io_close(fd);
	if (!r)
		*kept = head.kept;
	return r;
}

int plan_file_read(struct plan_file *f, struct cut_plan *ret, struct plan_kept *ret_kept, size_t *ret_seen, struct err *err)
{
	struct cut_plan plan = {.ledger = f->ledger};
	int r;

	lock_take(&f->lock);
	r = f->fresh ? io_remove(f->dirfd, f->name, err) : 0;
	if (!r)
		r = f->fresh ? PLAN_FILE_ABSENT : read_plan(f, &plan, ret_kept, err);
	*ret_seen = f->n;
	lock_give(&f->lock);
	if (r)
		cut_plan_done(&plan);
	else
		*ret = plan;
	return r;
}

int plan_file_remove(struct plan_file *f, struct err *err)
{
	return io_remove(f->dirfd, f->name, err);
}
