/*
 * Jobs by number, and how those that are over are kept.
 *
 * The model: an array by number, each entry a job at work or what is kept of one that is over. That is the job as it
 * lies in memory, words that are zero left out, and of the others the bytes that are zero: most of a job is. Texts that
 * it owns stay where they are. 10,000 such jobs take less than 3 MiB, and no loop over jobs at work comes by them.
 *
 * What all users share here is bounded: jobs, bytes, texts of views. Of each user who has a job it is known how much of that is
 * his, so that who has most gives way first, with the oldest of his that is over.
 */
#include "history.h"

#include <endian.h>
#include <stdlib.h>
#include <string.h>

#include "job_priv.h"
#include "plan_file.h"

_Static_assert(sizeof(struct job) % 8 == 0, "packed by words");
/* GUESTS: that a caller may have in hand at once, and more; few, so that the heap has them and the kernel need not clear them. */
enum {
	GUESTS = 16,
	WORDS = (sizeof(struct job) + 7) / 8,
	MAP = (WORDS + 7) / 8,
	SLACK = 8,
	IMAGE_MAX = MAP + 9 * WORDS + SLACK,
	ENTRY_BYTES = 48
};

struct kept {
	int64_t finished_us;
	const struct dataset *dataset;
	uint32_t uid;
	size_t view_bytes, charged; /* of it, and not in the image */
	/* A bit for each word that is not zero; of each such word a bit for each byte, and the bytes. SLACK more are there to be
	 * read. */
	uint8_t image[];
};

struct entry {
	uint64_t id;
	struct job *job; /* at work; NULL: kept */
	struct kept *kept;
};

/* Of one user who has a job. */
struct account {
	uint32_t uid;
	uint64_t has[HISTORY_KINDS], kept_jobs, kept_views;
};

struct history {
	struct entry *all; /* ascending */
	size_t n, room;
	uint64_t view_bytes, kept_views;
	struct account *account;
	size_t naccounts, accounts_room;
	struct job *guests; /* GUESTS that take turns, and one that is about to go */
	unsigned guest;     /* that comes next; of this round */
};

/* ---- packing ---- */

/* A bit for each byte that is not zero. */
static uint8_t bytes_set(uint64_t word)
{
	const uint64_t low = UINT64_C(0x7f7f7f7f7f7f7f7f);
	uint64_t high = (((word & low) + low) | word) & ~low;

	return (uint8_t)((high >> 7) * UINT64_C(0x0102040810204080) >> 56);
}

/* Whether any of eight words is not zero. */
static bool any_word(const uint8_t *at)
{
	uint64_t w[8];

	memcpy(w, at, sizeof w);
	return (w[0] | w[1] | w[2] | w[3]) | (w[4] | w[5] | w[6] | w[7]);
}

/* The size that it takes, SLACK included. */
static size_t pack(const struct job *job, uint8_t out[IMAGE_MAX])
{
	size_t n = MAP;

	memset(out, 0, MAP);
	for (size_t i = 0; i < WORDS; i++) {
		uint64_t word;
		unsigned mask, first, run;

		if (i % 8 == 0 && i + 8 <= WORDS && !any_word((const uint8_t *)job + 8 * i)) {
			i += 7;
			continue;
		}
		memcpy(&word, (const uint8_t *)job + 8 * i, 8);
		if (!word)
			continue;
		word = htole64(word);
		out[i / 8] |= (uint8_t)(1u << i % 8);
		mask = out[n++] = bytes_set(word);
		first = (unsigned)__builtin_ctz(mask);
		run = mask >> first;
		if (!(run & (run + 1))) { /* they stand together */
			word = htole64(word >> 8 * first);
			memcpy(out + n, &word, 8);
			n += (unsigned)__builtin_ctz(run + 1);
		} else {
			for (unsigned m = mask; m; m &= m - 1)
				out[n++] = (uint8_t)(word >> 8 * __builtin_ctz(m));
		}
	}
	memset(out + n, 0, SLACK);
	return n + SLACK;
}

static void unpack(const uint8_t *in, struct job *ret)
{
	size_t n = MAP;

	memset(ret, 0, sizeof *ret);
	for (size_t g = 0; g < MAP; g++) {
		for (unsigned set = in[g]; set; set &= set - 1) {
			size_t i = 8 * g + (size_t)__builtin_ctz(set);
			uint64_t word = 0;

			unsigned m = in[n++], first = (unsigned)__builtin_ctz(m), run = m >> first;

			if (!(run & (run + 1))) { /* of most, those that are not zero stand together */
				unsigned bytes = (unsigned)__builtin_ctz(run + 1);

				memcpy(&word, in + n, 8);
				n += bytes;
				word = (le64toh(word) & (UINT64_MAX >> (64 - 8 * bytes))) << 8 * first;
			} else {
				for (; m; m &= m - 1)
					word |= (uint64_t)in[n++] << 8 * __builtin_ctz(m);
			}
			word = le64toh(word);
			memcpy((uint8_t *)ret + 8 * i, &word, 8);
		}
	}
}

static uint64_t kept_bytes(size_t image, size_t view)
{
	return sizeof(struct kept) + image + view + ENTRY_BYTES;
}

/* ---- who has how much ---- */

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
	size_t room = p->accounts_room ? 2 * p->accounts_room : 8;

	if (a)
		return a;
	if (p->naccounts == p->accounts_room) {
		more = realloc(p->account, room * sizeof *more);
		if (!more)
			return NULL;
		p->account = more;
		p->accounts_room = room;
	}
	p->account[p->naccounts] = (struct account){.uid = uid};
	return &p->account[p->naccounts++];
}

static void account_gone(struct history *p, uint32_t uid, uint64_t view)
{
	struct account *a = account_of(p, uid);

	p->view_bytes -= view;
	a->has[HISTORY_VIEWS] -= view;
	if (!--a->has[HISTORY_JOBS])
		*a = p->account[--p->naccounts];
}

/* It is kept from now on, or (less) no longer. */
static void account_kept(struct history *p, const struct kept *k, bool less)
{
	struct account *a = account_of(p, k->uid);

	if (less) {
		p->kept_views -= k->view_bytes;
		a->kept_views -= k->view_bytes;
		a->kept_jobs--;
		a->has[HISTORY_BYTES] -= k->charged;
	} else {
		p->kept_views += k->view_bytes;
		a->kept_views += k->view_bytes;
		a->kept_jobs++;
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
		ret->busy = p->view_bytes - p->kept_views;
	}
	if (a) {
		ret->own = a->has[HISTORY_VIEWS];
		ret->own_busy = ret->own - a->kept_views;
	}
}

/* ---- the array ---- */

/* Of the first entry whose number is not below. */
static size_t place_of(const struct history *p, uint64_t id)
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
	size_t i = place_of(j->history, id);

	return j->history && i < j->history->n && j->history->all[i].id == id ? &j->history->all[i] : NULL;
}

static int make_room(struct history *p, struct err *err)
{
	size_t room = p->room ? p->room + p->room / 2 : 64;
	struct entry *all = p->n < p->room ? p->all : realloc(p->all, room * sizeof *all);

	if (!all)
		return err_set(err, ERR_NOMEM, "no memory for another job");
	if (p->n == p->room)
		p->room = room;
	p->all = all;
	return 0;
}

/* Among those at work, by number. */
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
	if (make_room(j->history, err))
		return -(int)err->code;
	a = account_make(j->history, job->peer.uid);
	if (!a)
		return err_set(err, ERR_NOMEM, "no memory for the account of a user");
	i = place_of(j->history, job->id);
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

	account_gone(j->history, job->peer.uid, strlen(job->view));
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

bool history_keep(struct job *job)
{
	struct jobs *j = job->jobs;
	struct entry *e = entry_of(j, job->id);
	struct kept all = {.finished_us = job->finished_us,
			   .dataset = job->dataset,
			   .uid = job->peer.uid,
			   .view_bytes = strlen(job->view),
			   .charged = job->charged},
		    *k;
	struct plan_file *plan = job->plan;
	struct job *next = job->next;
	uint8_t image[IMAGE_MAX];
	uint64_t bytes;
	size_t n;

	THREAD_LOOP_ONLY();
	/* history_awake makes another plan. */
	job->plan = NULL;
	job->next = NULL;
	job->charged = 0;
	n = pack(job, image);
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
	bytes = kept_bytes(n, all.view_bytes);
	if (all.charged > bytes) {
		uncharge(j->core, all.charged - bytes);
		all.charged = (size_t)bytes;
	}
	*k = all;
	memcpy(k->image, image, n);
	e->kept = k;
	e->job = NULL;
	account_kept(j->history, k, false);
	if (j->core->loading && !j->spare)
		j->spare = job;
	else
		free(job);
	return true;
}

/* NULL: no memory. */
static struct job *guests_of(struct history *p)
{
	if (!p->guests)
		p->guests = calloc(GUESTS + 1, sizeof *p->guests);
	return p->guests;
}

static struct job *guest_in(const struct entry *e, struct job *g)
{
	unpack(e->kept->image, g);
	g->charged = e->kept->charged;
	g->guest = true;
	return g;
}

static struct job *guest_of(struct jobs *j, const struct entry *e)
{
	struct history *p = j->history;
	struct job *g = e->job ? NULL : guests_of(p);

	if (!g)
		return e->job;
	g += p->guest % GUESTS;
	p->guest = p->guest + 1 < 2 * GUESTS ? p->guest + 1 : GUESTS;
	return guest_in(e, g);
}

/* The same, for a job that is about to go: however many do, whoever makes room for a guest in hand does not lose it. */
static struct job *goer_of(struct jobs *j, const struct entry *e)
{
	struct job *g = e->job ? NULL : guests_of(j->history);

	return g ? guest_in(e, g + GUESTS) : e->job;
}

int history_awake(struct job *guest, struct job **ret, struct err *err)
{
	struct jobs *j = guest->jobs;
	struct entry *e = entry_of(j, guest->id);
	uint64_t more = 0;
	struct job *job;

	if (!guest->guest || !e || e->job) {
		*ret = e && e->job ? e->job : guest;
		return 0;
	}
	more = job_bytes(strlen(guest->view));
	more = more > guest->charged ? more - guest->charged : 0;
	if (charge_lasting(j->core, CHARGE_JOB, guest->peer.uid, more, "another job", err))
		return -(int)err->code;
	/* Others may have made room, by going. */
	e = entry_of(j, guest->id);
	job = e ? malloc(sizeof *job) : NULL;
	if (!job) {
		uncharge(j->core, more);
		return err_set(err, e ? ERR_NOMEM : ERR_NOTFOUND, e ? "no memory for a job" : "the job is gone");
	}
	unpack(e->kept->image, job);
	job->charged = e->kept->charged + (size_t)more;
	account_kept(j->history, e->kept, true);
	free(e->kept);
	e->kept = NULL;
	e->job = job;
	link_job(job);
	if (job_plan_new(job, err))
		return -(int)err->code; /* kept again, next round */
	*ret = job;
	return 0;
}

void history_drop(struct job *guest)
{
	struct jobs *j = guest->jobs;
	struct entry *e = entry_of(j, guest->id);
	struct err ignored = ERR_INIT;
	struct kept *k;

	if (!e || !e->kept)
		return;
	k = e->kept;
	account_kept(j->history, k, true);
	entry_remove(j, e, guest);
	free(k);
	if (!j->core->loading && !job_plan_new(guest, &ignored))
		job_plan_drop(guest);
	job_done_with(guest);
}

/* ---- looking ---- */

struct job *history_find(struct jobs *j, uint64_t id)
{
	struct entry *e = entry_of(j, id);

	return e ? guest_of(j, e) : NULL;
}

struct job *history_next(struct jobs *j, const struct dataset *of, uint64_t after)
{
	size_t i = after == UINT64_MAX || !j->history ? SIZE_MAX : place_of(j->history, after + 1);

	for (; j->history && i < j->history->n; i++) {
		const struct entry *e = &j->history->all[i];

		if (!of || (e->job ? e->job->dataset : e->kept->dataset) == of)
			return guest_of(j, e);
	}
	return NULL;
}

struct job *history_before(struct jobs *j, uint64_t id)
{
	size_t i = place_of(j->history, id);

	return i ? guest_of(j, &j->history->all[i - 1]) : NULL;
}

struct job *history_oldest(struct jobs *j, int64_t finished_us)
{
	for (size_t i = 0; j->history && i < j->history->n; i++)
		if (j->history->all[i].kept && j->history->all[i].kept->finished_us <= finished_us)
			return goer_of(j, &j->history->all[i]);
	return NULL;
}

/* Who asks gives way to those who have as much. */
struct job *history_of_most(struct jobs *j, enum history_kind kind, uint32_t uid, uint64_t more)
{
	const struct account *most = NULL;
	uint64_t n = 0;

	for (size_t i = 0; j->history && i < j->history->naccounts; i++) {
		const struct account *a = &j->history->account[i];
		uint64_t has = a->has[kind] + (a->uid == uid ? more : 0);

		if (a->kept_jobs && (!most || has > n || (has == n && a->uid == uid))) {
			most = a;
			n = has;
		}
	}
	for (size_t i = 0; most && i < j->history->n; i++)
		if (j->history->all[i].kept && j->history->all[i].kept->uid == most->uid)
			return goer_of(j, &j->history->all[i]);
	return NULL;
}

bool history_has(const struct jobs *j, uint64_t id)
{
	return entry_of(j, id) != NULL;
}

void history_forget_dataset(struct jobs *j, struct dataset *d)
{
	struct history *p = j->history;
	uint8_t image[IMAGE_MAX];
	struct job job;

	for (size_t i = 0; p && i < p->n; i++) {
		struct kept *k = p->all[i].kept;

		if (!k || k->dataset != d)
			continue;
		/* With a word less it takes no more than before. */
		unpack(k->image, &job);
		job.dataset = NULL;
		memcpy(k->image, image, pack(&job, image));
		k->dataset = NULL;
		dataset_unhold(d);
	}
	for (unsigned i = 0; p && p->guests && i <= GUESTS; i++)
		if (p->guests[i].dataset == d)
			p->guests[i].dataset = NULL;
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
	size_t there = 0, gone = p ? p->n : 0;

	for (size_t i = 0; p && i < p->n; i++) {
		const struct entry *e = &p->all[i];

		if (e->job ? e->job->dataset : e->kept->dataset)
			ret[there++] = e->id;
		else
			ret[--gone] = e->id;
	}
	return there;
}

void history_round(struct jobs *j)
{
	struct history *p = j->history;

	if (!p || !p->guests)
		return;
	/* Who goes through a list is here again next round. */
	if (!p->guest) {
		free(p->guests);
		p->guests = NULL;
	}
	p->guest = 0;
}

void history_free(struct jobs *j)
{
	struct history *p = j->history;

	if (!p)
		return;
	for (size_t i = 0; i < p->n; i++) {
		struct job *g = p->all[i].kept ? goer_of(j, &p->all[i]) : NULL;

		if (g) {
			g->dataset = NULL;
			job_done_with(g);
		}
		free(p->all[i].kept);
	}
	free(p->guests);
	free(p->account);
	free(p->all);
	free(p);
	j->history = NULL;
}
