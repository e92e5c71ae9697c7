/*
 * Plans in files.
 *
 * A file is records of PLAN_RECORD bytes: a header, the leaves of the plan as it was made, then three records for each
 * split: the region that was split and its halves. Each record ends with its own checksum, and the header has a
 * digest of all leaves. The file appears whole (temporary name, fsync, rename); splits are appended, and durable
 * before a half of them is made. What a crash left of a split at the end is not there: no block of its halves has
 * left. Of a walk that sends no blocks neither waits for the disk: who reads the plan brings it there first. The same split may
 * be there twice, of two walks at once; the second finds nothing to split. Between splits there are records of finished domains,
 * which nothing waits for: a split that is durable makes those before it so, and the first that is torn ends the file.
 */
#include "plan_file.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#include "cursor.h"
#include "err.h"
#include "io.h"
#include "ledger.h"
#include "log.h"
#include "parse.h"
#include "plan_file_priv.h"

enum { TEXT_AT = 32, CHUNK = 512 };
_Static_assert(TEXT_AT + CUT_REGION_TEXT_SIZE + 8 == PLAN_RECORD, "FORMAT.md, \"Plans\"");

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
	pthread_mutex_t lock; /* of the file and the next two: held while the disk is waited for, so never taken by the loop */
	bool settled;         /* what is in it outlives a crash */
	bool fresh;           /* what is there under its name, if anything, is another's, or did not reach the disk */
	pthread_mutex_t list; /* of the splits below; who changes them holds both */
	uint64_t size;        /* of what is whole in the file */
	struct split *split;  /* of this run */
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
	pthread_mutex_init(&f->lock, NULL);
	pthread_mutex_init(&f->list, NULL);
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
	pthread_mutex_destroy(&f->lock);
	pthread_mutex_destroy(&f->list);
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

/* ---- plans that nobody has ---- */

/* Held by those who write a durable plan, and alone by who removes what writes left. */
static pthread_rwlock_t writing = PTHREAD_RWLOCK_INITIALIZER;

struct sweep {
	int dirfd;
	uint64_t last;
	bool (*there)(void *ctx, uint64_t job);
	void *ctx;
};

static int sweep_one(void *ctx, const struct dirent *e, struct err *err)
{
	const struct sweep *s = ctx;
	uint64_t job = plan_file_job(e->d_name);

	return job > s->last || (job && s->there(s->ctx, job)) ? 0 : io_remove(s->dirfd, e->d_name, err);
}

int plan_file_sweep(int plansfd, uint64_t last, bool (*there)(void *ctx, uint64_t job), void *ctx, struct err *err)
{
	int r;

	pthread_rwlock_wrlock(&writing);
	r = io_list(plansfd, ".", sweep_one, &(struct sweep){plansfd, last, there, ctx}, err);
	pthread_rwlock_unlock(&writing);
	return r;
}

/* ---- records ---- */

static void leaf_pack(unsigned kind, const struct cut_leaf *leaf, uint8_t record[PLAN_RECORD])
{
	struct packer p = packer_of(record, PLAN_RECORD);

	memset(record, 0, PLAN_RECORD);
	packer_u32(&p, PLAN_MAGIC);
	packer_u16(&p, PLAN_VERSION);
	packer_u8(&p, (uint8_t)kind);
	packer_u8(&p, leaf->exact);
	packer_u8(&p, leaf->stuck);
	packer_zero(&p, 7);
	packer_u64(&p, leaf->count);
	packer_u64(&p, leaf->above);
	cut_region_text(&leaf->region, (char *)record + TEXT_AT);
	/* Behind the text: zeros, whatever the function left there. */
	memset(record + TEXT_AT + strlen((char *)record + TEXT_AT), 0, CUT_REGION_TEXT_SIZE - strlen((char *)record + TEXT_AT));
	plan_record_seal(record);
}

static bool leaf_unpack(unsigned kind, const uint8_t record[PLAN_RECORD], struct cut_leaf *ret)
{
	struct cursor c = cursor_of(record, PLAN_RECORD);
	struct cut_leaf leaf = {0};

	if (!plan_record_sealed(record) || cursor_u32(&c) != PLAN_MAGIC || cursor_u16(&c) != PLAN_VERSION ||
	    cursor_u8(&c) != kind)
		return false;
	leaf.exact = cursor_u8(&c) != 0;
	leaf.stuck = cursor_u8(&c);
	cursor_skip(&c, 7);
	leaf.count = cursor_u64(&c);
	leaf.above = cursor_u64(&c);
	if (!memchr(record + TEXT_AT, 0, CUT_REGION_TEXT_SIZE) || !cut_region_parse((const char *)record + TEXT_AT, &leaf.region))
		return false;
	*ret = leaf;
	return true;
}

static void plan_head_pack(const struct plan_head *h, uint8_t record[PLAN_RECORD])
{
	struct packer p = packer_of(record, PLAN_RECORD);

	memset(record, 0, PLAN_RECORD);
	packer_u32(&p, PLAN_MAGIC);
	packer_u16(&p, PLAN_VERSION);
	packer_u8(&p, PLAN_HEAD);
	packer_zero(&p, 1);
	packer_u64(&p, h->job);
	packer_u64(&p, h->generation);
	packer_u64(&p, h->n);
	packer_u32(&p, h->kept.load);
	packer_u32(&p, h->kept.cap);
	packer_u64(&p, h->kept.base.hi);
	packer_u64(&p, h->kept.base.lo);
	packer_u64(&p, h->leaves.hi);
	packer_u64(&p, h->leaves.lo);
	plan_record_seal(record);
}

bool plan_head_unpack(const uint8_t record[PLAN_RECORD], struct plan_head *ret)
{
	struct cursor c = cursor_of(record, PLAN_RECORD);

	if (!plan_record_sealed(record) || cursor_u32(&c) != PLAN_MAGIC || cursor_u16(&c) != PLAN_VERSION ||
	    cursor_u8(&c) != PLAN_HEAD)
		return false;
	cursor_skip(&c, 1);
	ret->job = cursor_u64(&c);
	ret->generation = cursor_u64(&c);
	ret->n = cursor_u64(&c);
	ret->kept.load = cursor_u32(&c);
	ret->kept.cap = cursor_u32(&c);
	ret->kept.base.hi = cursor_u64(&c);
	ret->kept.base.lo = cursor_u64(&c);
	ret->leaves.hi = cursor_u64(&c);
	ret->leaves.lo = cursor_u64(&c);
	return true;
}

/* ---- plans in memory ---- */

/* A region that is not in the plan from `least` on was split before. */
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
			leaf_pack(PLAN_LEAF, &plan->leaf[i + k], chunk + k * PLAN_RECORD);
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

static int write_file(struct plan_file *f, const struct cut_plan *plan, bool settle, struct plan_kept *kept, struct err *err)
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
	if (!r && settle) {
		r = io_publish(f->dirfd, fd, temp, f->name, err);
	} else {
		if (!r && io->renameat(f->dirfd, temp, f->dirfd, f->name) < 0)
			r = err_sys(err, errno, "cannot publish %s", f->name);
		if (r)
			io->unlinkat(f->dirfd, temp, 0);
	}
	io_close(fd);
	if (r)
		return r;
	f->size = (plan->n + 1) * PLAN_RECORD;
	f->settled = settle;
	f->fresh = false;
	kept->base = head.kept.base;
	return 0;
}

static int write_plan(struct plan_file *f, const struct cut_plan *plan, bool later, struct plan_kept *kept, struct err *err)
{
	int r;

	if (!f->durable)
		return write_file(f, plan, false, kept, err);
	pthread_rwlock_rdlock(&writing);
	r = write_file(f, plan, !later, kept, err);
	pthread_rwlock_unlock(&writing);
	return r;
}

/* One that need not last is a help only: without it a later stream of the job is another one. */
static int forgive(const struct plan_file *f, int r, struct err *err)
{
	if (!r || f->durable || r == -ERR_NOMEM)
		return r;
	log_err(LOG_LEVEL_DEBUG, "a plan is not kept", err);
	err_clear(err);
	return 0;
}

static int keep(struct plan_file *f, const struct cut_plan *plan, bool later, struct plan_kept *kept, struct err *err)
{
	int r;

	pthread_mutex_lock(&f->lock);
	r = forgive(f, write_plan(f, plan, later, kept, err), err);
	pthread_mutex_unlock(&f->lock);
	return r;
}

int plan_file_write(struct plan_file *f, const struct cut_plan *plan, struct plan_kept *kept, struct err *err)
{
	return keep(f, plan, false, kept, err);
}

int plan_file_write_later(struct plan_file *f, const struct cut_plan *plan, struct plan_kept *kept, struct err *err)
{
	return keep(f, plan, true, kept, err);
}

/* Before anybody goes by what was read. What did not reach the disk goes: nobody may believe it later. */
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

	leaf_pack(PLAN_WHOLE, &whole, record);
	leaf_pack(PLAN_HALF, &s->half[0], record + PLAN_RECORD);
	leaf_pack(PLAN_HALF, &s->half[1], record + 2 * PLAN_RECORD);
	/* Of a plan that is not settled nobody has a block, and one that is lost nobody reads. */
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

	pthread_mutex_lock(&f->lock);
	if (!split_known(f, whole)) {
		if (f->n == f->room) {
			pthread_mutex_lock(&f->list);
			r = split_room(f, f->room ? 2 * f->room : 16, err);
			pthread_mutex_unlock(&f->list);
		}
		if (!r)
			r = forgive(f, append_split(f, &s, err), err);
		if (!r) {
			pthread_mutex_lock(&f->list);
			f->split[f->n++] = s;
			pthread_mutex_unlock(&f->list);
		}
	}
	pthread_mutex_unlock(&f->lock);
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
		pthread_mutex_lock(&f->lock);
		/* Without a header there is nothing to add to. */
		if (f->size && !f->fresh)
			r = append(f, record, some * PLAN_RECORD, false, err);
		pthread_mutex_unlock(&f->lock);
	}
	return r;
}

int plan_file_follow(struct plan_file *f, size_t *seen, size_t least, struct cut_plan *plan, struct err *err)
{
	int r = 0;

	pthread_mutex_lock(&f->list);
	while (!r && *seen < f->n) {
		r = plan_apply(plan, least, &f->split[*seen], err);
		*seen += !r;
	}
	pthread_mutex_unlock(&f->list);
	return r;
}

/* ---- reading ---- */

/* PLAN_FILE_ABSENT: damaged. */
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
			if (!leaf_unpack(PLAN_LEAF, chunk + k * PLAN_RECORD, &plan->leaf[plan->n++]))
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

/* As far as they are whole. */
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
			if (!leaf_unpack(PLAN_WHOLE, record, &whole) ||
			    !leaf_unpack(PLAN_HALF, record + PLAN_RECORD, &s.half[0]) ||
			    !leaf_unpack(PLAN_HALF, record + 2 * PLAN_RECORD, &s.half[1]))
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
	/* An empty one is what a power cut leaves of one that nobody had read yet. */
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
			  "the plan of job %llu is damaged: it is made again, streams of it cannot go on",
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

	pthread_mutex_lock(&f->lock);
	r = f->fresh ? io_remove(f->dirfd, f->name, err) : 0;
	if (!r)
		r = f->fresh ? PLAN_FILE_ABSENT : read_plan(f, &plan, ret_kept, err);
	*ret_seen = f->n;
	pthread_mutex_unlock(&f->lock);
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
