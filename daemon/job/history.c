/*
 * All jobs by number, finished ones packed.
 *
 * The model: a sorted array; each entry is an active job or a packed one. A packed job is struct job without its zero bytes
 * (history_image.c); the texts that it owns stay where they are. 10,000 packed jobs take less than 3 MiB, and no loop over active
 * jobs sees them.
 *
 * What all users share here is bounded: jobs, bytes, texts of views. An account a user says how much of it is his. When something
 * has to be dropped, it is the oldest packed job of the user who has most.
 */
#include "history.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "history_image.h"
#include "job_priv.h"
#include "plan_file.h"

/* COPIES: more than a caller uses at once. Few, so that the heap reuses their memory and the kernel need not clear it. */
enum { COPIES = 16, ENTRY_BYTES = 48 };

struct packed_job {
	int64_t finished_us;
	const struct dataset *dataset;
	uint32_t uid;
	size_t view_bytes, charged; /* they are not in the image */
	/* as history_image_pack makes it */
	uint8_t image[];
};

struct entry {
	uint64_t id;
	struct job *job; /* active; NULL: packed */
	struct packed_job *packed;
};

/* What one user with jobs has. */
struct account {
	uint32_t uid;
	uint64_t has[HISTORY_KINDS], packed_jobs, packed_views;
};

struct history {
	struct entry *all; /* ascending by id */
	size_t n, cap;
	uint64_t view_bytes, packed_views;
	struct account *account;
	size_t naccounts, accounts_cap;
	struct job *copies; /* COPIES in turn, and one more for entry_victim; NULL: no memory, or not used lately */
	unsigned next_copy; /* counts up in a round of the loop; beyond COPIES it wraps */
};

/* ---- entries ---- */

static uint64_t packed_bytes(size_t image, size_t view)
{
	return sizeof(struct packed_job) + image + view + ENTRY_BYTES;
}

/* ---- accounts of users ---- */

static struct account *account_of(const struct history *p, uint32_t uid)
{
	for (size_t i = 0; p && i < p->naccounts; i++)
		if (p->account[i].uid == uid)
			return &p->account[i];
	return NULL;
}

static struct account *account_make(struct history *p, uint32_t uid)
{
	struct account *a = account_of(p, uid), *more;
	size_t cap = p->accounts_cap ? 2 * p->accounts_cap : 8;

	if (a)
		return a;
	if (p->naccounts == p->accounts_cap) {
		more = realloc(p->account, cap * sizeof *more);
		if (!more)
			return NULL;
		p->account = more;
		p->accounts_cap = cap;
	}
	p->account[p->naccounts] = (struct account){.uid = uid};
	return &p->account[p->naccounts++];
}

static void account_drop_job(struct history *p, uint32_t uid, uint64_t view)
{
	struct account *a = account_of(p, uid);

	p->view_bytes -= view;
	a->has[HISTORY_VIEWS] -= view;
	if (!--a->has[HISTORY_JOBS])
		*a = p->account[--p->naccounts];
}

/* Counts a job as packed, or (less) no longer. */
static void account_packed(struct history *p, const struct packed_job *k, bool less)
{
	struct account *a = account_of(p, k->uid);

	if (less) {
		p->packed_views -= k->view_bytes;
		a->packed_views -= k->view_bytes;
		a->packed_jobs--;
		a->has[HISTORY_BYTES] -= k->charged;
	} else {
		p->packed_views += k->view_bytes;
		a->packed_views += k->view_bytes;
		a->packed_jobs++;
		a->has[HISTORY_BYTES] += k->charged;
	}
}

void history_views(const struct jobs *j, uint32_t uid, struct history_views *ret)
{
	const struct history *p = j->history;
	const struct account *a = account_of(p, uid);

	*ret = (struct history_views){0};
	if (p) {
		ret->all = p->view_bytes;
		ret->busy = p->view_bytes - p->packed_views;
	}
	if (a) {
		ret->own = a->has[HISTORY_VIEWS];
		ret->own_busy = ret->own - a->packed_views;
	}
}

/* ---- the array ---- */

/* Index of the first entry with that number or a larger one. */
static size_t entry_index(const struct history *p, uint64_t id)
{
	size_t lo = 0, hi = p ? p->n : 0;

	while (lo < hi) {
		size_t mid = lo + (hi - lo) / 2;

		if (p->all[mid].id < id)
			lo = mid + 1;
		else
			hi = mid;
	}
	return lo;
}

static struct entry *entry_of(const struct jobs *j, uint64_t id)
{
	size_t i = entry_index(j->history, id);

	return j->history && i < j->history->n && j->history->all[i].id == id ? &j->history->all[i] : NULL;
}

static int grow(struct history *p, struct err *err)
{
	size_t cap = p->cap ? p->cap + p->cap / 2 : 64;
	struct entry *all = p->n < p->cap ? p->all : realloc(p->all, cap * sizeof *all);

	if (!all)
		return err_set(err, ERR_NOMEM, "no memory for another job");
	if (p->n == p->cap)
		p->cap = cap;
	p->all = all;
	return 0;
}

/* Inserts it into the list of active jobs, which is sorted by id. */
static void link_job(struct job *job)
{
	struct job **at;

	for (at = &job->jobs->jobs; *at && (*at)->id < job->id; at = &(*at)->next)
		;
	job->next = *at;
	*at = job;
}

static void unlink_job(struct job *job)
{
	struct job **at;

	for (at = &job->jobs->jobs; *at && *at != job; at = &(*at)->next)
		;
	if (*at)
		*at = job->next;
}

int history_add(struct job *job, struct err *err)
{
	struct jobs *j = job->jobs;
	struct account *a;
	size_t i;

	if (!j->history && !(j->history = calloc(1, sizeof *j->history)))
		return err_set(err, ERR_NOMEM, "no memory for jobs");
	if (grow(j->history, err))
		return -(int)err->code;
	a = account_make(j->history, job->peer.uid);
	if (!a)
		return err_set(err, ERR_NOMEM, "no memory for the account of a user");
	i = entry_index(j->history, job->id);
	memmove(&j->history->all[i + 1], &j->history->all[i], (j->history->n - i) * sizeof j->history->all[0]);
	j->history->all[i] = (struct entry){.id = job->id, .job = job};
	j->history->n++;
	j->history->view_bytes += strlen(job->view);
	a->has[HISTORY_JOBS]++;
	a->has[HISTORY_VIEWS] += strlen(job->view);
	link_job(job);
	return 0;
}

static void entry_remove(struct jobs *j, struct entry *e, const struct job *job)
{
	size_t i = (size_t)(e - j->history->all);

	account_drop_job(j->history, job->peer.uid, strlen(job->view));
	j->history->n--;
	memmove(e, e + 1, (j->history->n - i) * sizeof *e);
}

void history_remove(struct job *job)
{
	struct entry *e = entry_of(job->jobs, job->id);

	unlink_job(job);
	if (e && e->job == job)
		entry_remove(job->jobs, e, job);
}

bool history_pack(struct job *job)
{
	struct jobs *j = job->jobs;
	struct entry *e = entry_of(j, job->id);
	struct packed_job all = {.finished_us = job->finished_us,
				 .dataset = job->dataset,
				 .uid = job->peer.uid,
				 .view_bytes = strlen(job->view),
				 .charged = job->charged},
			  *k;
	struct plan_file *plan = job->plan;
	struct job *next = job->next;
	uint8_t image[HISTORY_IMAGE_MAX];
	uint64_t bytes;
	size_t n;

	THREAD_LOOP_ONLY();
	assert(job_state_final(job->state) && !job->unpacked && !job->run && !job->fetches);
	/* Not packed: history_activate makes another plan file. */
	job->plan = NULL;
	job->next = NULL;
	job->charged = 0;
	n = history_image_pack(job, image);
	k = e ? malloc(sizeof *k + n) : NULL;
	if (!k) {
		job->plan = plan;
		job->next = next;
		job->charged = all.charged;
		return false;
	}
	job->next = next;
	unlink_job(job);
	plan_file_free(plan);
	bytes = packed_bytes(n, all.view_bytes);
	if (all.charged > bytes) {
		uncharge(j->core, all.charged - bytes);
		all.charged = (size_t)bytes;
	}
	*k = all;
	memcpy(k->image, image, n);
	e->packed = k;
	e->job = NULL;
	account_packed(j->history, k, false);
	if (j->core->loading && !j->spare)
		j->spare = job;
	else
		free(job);
	return true;
}

/* NULL: no memory. */
static struct job *copies_of(struct history *p)
{
	if (!p->copies)
		p->copies = calloc(COPIES + 1, sizeof *p->copies);
	return p->copies;
}

static struct job *unpack_into(const struct entry *e, struct job *g)
{
	history_image_unpack(e->packed->image, g);
	g->charged = e->packed->charged;
	g->unpacked = true;
	return g;
}

static struct job *entry_job(struct jobs *j, const struct entry *e)
{
	struct history *p = j->history;
	struct job *g = e->job ? NULL : copies_of(p);

	if (!g)
		return e->job;
	g += p->next_copy % COPIES;
	p->next_copy = p->next_copy + 1 < 2 * COPIES ? p->next_copy + 1 : COPIES;
	return unpack_into(e, g);
}

/* A copy of a job that is about to be dropped. It has a place of its own, so that the copies in use by callers stay valid. */
static struct job *entry_victim(struct jobs *j, const struct entry *e)
{
	struct job *g = e->job ? NULL : copies_of(j->history);

	return g ? unpack_into(e, g + COPIES) : e->job;
}

int history_activate(struct job *copy, struct job **ret, struct err *err)
{
	struct jobs *j = copy->jobs;
	struct entry *e = entry_of(j, copy->id);
	uint64_t more = 0;
	struct job *job;

	THREAD_LOOP_ONLY();
	if (!copy->unpacked || !e || e->job) {
		*ret = e && e->job ? e->job : copy;
		return 0;
	}
	more = job_bytes(strlen(copy->view));
	more = more > copy->charged ? more - copy->charged : 0;
	if (charge_lasting(j->core, CHARGE_JOB, copy->peer.uid, more, "another job", err))
		return -(int)err->code;
	/* Making room may have dropped jobs, and moved entries. */
	e = entry_of(j, copy->id);
	job = e ? malloc(sizeof *job) : NULL;
	if (!job) {
		uncharge(j->core, more);
		return err_set(err, e ? ERR_NOMEM : ERR_NOTFOUND, e ? "no memory for a job" : "the job is gone");
	}
	history_image_unpack(e->packed->image, job);
	job->charged = e->packed->charged + (size_t)more;
	account_packed(j->history, e->packed, true);
	free(e->packed);
	e->packed = NULL;
	e->job = job;
	link_job(job);
	if (job_plan_file_new(job, err))
		return -(int)err->code; /* it is packed again in the next round */
	*ret = job;
	return 0;
}

void history_delete(struct job *copy)
{
	struct jobs *j = copy->jobs;
	struct entry *e = entry_of(j, copy->id);
	struct err ignored = ERR_INIT;
	struct packed_job *k;

	THREAD_LOOP_ONLY();
	assert(copy->unpacked);
	if (!e || !e->packed)
		return;
	k = e->packed;
	account_packed(j->history, k, true);
	entry_remove(j, e, copy);
	free(k);
	if (!j->core->loading && !job_plan_file_new(copy, &ignored))
		job_plan_file_drop(copy);
	job_release(copy);
}

/* ---- searching ---- */

struct job *history_find(struct jobs *j, uint64_t id)
{
	struct entry *e = entry_of(j, id);

	return e ? entry_job(j, e) : NULL;
}

struct job *history_next(struct jobs *j, const struct dataset *of, uint64_t after)
{
	size_t i = after == UINT64_MAX || !j->history ? SIZE_MAX : entry_index(j->history, after + 1);

	for (; j->history && i < j->history->n; i++) {
		const struct entry *e = &j->history->all[i];

		if (!of || (e->job ? e->job->dataset : e->packed->dataset) == of)
			return entry_job(j, e);
	}
	return NULL;
}

struct job *history_before(struct jobs *j, uint64_t id)
{
	size_t i = entry_index(j->history, id);

	return i ? entry_job(j, &j->history->all[i - 1]) : NULL;
}

struct job *history_oldest(struct jobs *j, int64_t finished_us)
{
	for (size_t i = 0; j->history && i < j->history->n; i++)
		if (j->history->all[i].packed && j->history->all[i].packed->finished_us <= finished_us)
			return entry_victim(j, &j->history->all[i]);
	return NULL;
}

/* If several users have the same amount, the one who requests more is taken first. */
struct job *history_oldest_of_largest(struct jobs *j, enum history_kind kind, uint32_t uid, uint64_t more)
{
	const struct account *most = NULL;
	uint64_t n = 0;

	for (size_t i = 0; j->history && i < j->history->naccounts; i++) {
		const struct account *a = &j->history->account[i];
		uint64_t has = a->has[kind] + (a->uid == uid ? more : 0);

		if (a->packed_jobs && (!most || has > n || (has == n && a->uid == uid))) {
			most = a;
			n = has;
		}
	}
	for (size_t i = 0; most && i < j->history->n; i++)
		if (j->history->all[i].packed && j->history->all[i].packed->uid == most->uid)
			return entry_victim(j, &j->history->all[i]);
	return NULL;
}

bool history_has(const struct jobs *j, uint64_t id)
{
	return entry_of(j, id) != NULL;
}

void history_forget_dataset(struct jobs *j, struct dataset *d)
{
	struct history *p = j->history;
	uint8_t image[HISTORY_IMAGE_MAX];
	struct job job;

	for (size_t i = 0; p && i < p->n; i++) {
		struct packed_job *k = p->all[i].packed;

		if (!k || k->dataset != d)
			continue;
		/* The image does not grow: one word less is not zero. */
		history_image_unpack(k->image, &job);
		job.dataset = NULL;
		memcpy(k->image, image, history_image_pack(&job, image));
		k->dataset = NULL;
		dataset_unhold(d);
	}
	for (unsigned i = 0; p && p->copies && i <= COPIES; i++)
		if (p->copies[i].dataset == d)
			p->copies[i].dataset = NULL;
}

uint64_t history_bytes(const struct jobs *j)
{
	uint64_t n = 0;

	for (size_t i = 0; j->history && i < j->history->naccounts; i++)
		n += j->history->account[i].has[HISTORY_BYTES];
	return n;
}

size_t history_count(const struct jobs *j)
{
	return j->history ? j->history->n : 0;
}

void history_numbers(const struct jobs *j, uint64_t *ret)
{
	for (size_t i = 0; i < history_count(j); i++)
		ret[i] = j->history->all[i].id;
}

size_t history_list(const struct jobs *j, uint64_t *ret)
{
	const struct history *p = j->history;
	size_t with = 0, without = p ? p->n : 0;

	for (size_t i = 0; p && i < p->n; i++) {
		const struct entry *e = &p->all[i];

		if (e->job ? e->job->dataset : e->packed->dataset)
			ret[with++] = e->id;
		else
			ret[--without] = e->id;
	}
	return with;
}

void history_round(struct jobs *j)
{
	struct history *p = j->history;

	if (!p || !p->copies)
		return;
	/* Freed only after a round without copies: a list is often read over several rounds. */
	if (!p->next_copy) {
		free(p->copies);
		p->copies = NULL;
	}
	p->next_copy = 0;
}

void history_free(struct jobs *j)
{
	struct history *p = j->history;

	if (!p)
		return;
	for (size_t i = 0; i < p->n; i++) {
		struct job *g = p->all[i].packed ? entry_victim(j, &p->all[i]) : NULL;

		if (g) {
			g->dataset = NULL;
			job_release(g);
		}
		free(p->all[i].packed);
	}
	free(p->copies);
	free(p->account);
	free(p->all);
	free(p);
	j->history = NULL;
}
