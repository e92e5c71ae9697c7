/*
 * The order of the scheduler: fair between users, then between the flows (jobs, streams, pushes) of a user.
 *
 * The model: hierarchical start-time fair queueing (Goyal, Vin, Cheng 1996). Each user has a tag, the worker time that the user's
 * tasks got; so has each flow. The next task is of the user with the smallest tag; of this user's flows, of the one with the
 * smallest tag; in this flow the most urgent, then the oldest. A user or flow that was idle begins at the smallest tag of those
 * that have tasks, so idle time earns nothing, and a new user has no disadvantage. A task is charged the average time of its flow
 * when it starts, and the difference when it ends, so several running tasks count at once.
 *
 * Ranks are strict, except that one start in LOWER_EVERY goes to a lower rank: deferred work still ends. SCHED_LAST is below all
 * ranks. Each rank has its own tags.
 *
 * Memory: the first task that lacks memory has a claim on all that comes free. Until it starts, no other task that needs memory
 * starts, whatever its rank. So a large task gets its memory at the latest when everything that is taken now has come back; the
 * order above only decides which task has the next claim. Tasks that need no memory pass. They are the ones that release memory:
 * a domain is emitted, stored, spooled. SCHED_LAST never has a claim: its tasks use idle memory.
 *
 * Not here: threads, clocks, what a task does.
 */
#include "sched_queue.h"

#include <assert.h>
#include <stdlib.h>

#include "ledger.h"

/* Nanoseconds that a task is expected to take, until one has ended. */
enum { MEAN_FIRST = 1000000 };
enum { CLASSES = 4, CLASS_LAST = 3, LOWER_EVERY = 16, MEAN_PARTS = 4, ACCOUNTS_KEPT = 64 };

/* Worker time of a user, or of a flow of a user. */
struct sched_account {
	struct sched_account *next, *user; /* user: the account of the flow's user; NULL: this is a user's */
	uint32_t uid;
	unsigned class;
	uint64_t flow, number; /* number: order of creation, breaks ties */
	int64_t tag, mean;
	bool known;     /* mean is measured for this account */
	int64_t now;    /* of a user: the tag that new flows begin at */
	unsigned tasks; /* waiting or running */
};

struct sched_queue {
	struct ledger *ledger;
	struct sched_task *waiting, **waiting_end, *running;
	struct sched_task *claim; /* one of `waiting`: has the claim on memory */
	struct sched_account *accounts, common;
	unsigned naccounts, sweep_at;
	int64_t now[CLASSES]; /* the tag that new users begin at */
	uint64_t order, number, starts;
	int64_t mean; /* of all tasks; expected of new users */
};

struct sched_queue *sched_queue_new(struct ledger *ledger)
{
	struct sched_queue *q = calloc(1, sizeof *q);

	if (!q)
		return NULL;
	q->ledger = ledger;
	q->waiting_end = &q->waiting;
	q->mean = MEAN_FIRST;
	return q;
}

struct sched_queue *sched_queue_free(struct sched_queue *q)
{
	struct sched_account *a;

	if (!q)
		return NULL;
	while ((a = q->accounts)) {
		q->accounts = a->next;
		free(a);
	}
	free(q);
	return NULL;
}

/* ---- accounts ---- */

static unsigned class_of(const struct sched_task *t)
{
	static const unsigned of_rank[] = {[SCHED_RANK_HIGH] = 0, [SCHED_RANK_NORMAL] = 1, [SCHED_RANK_LOW] = 2};

	return t->priority == SCHED_LAST ? CLASS_LAST : of_rank[t->owner.rank];
}

static int64_t max_tag(int64_t a, int64_t b)
{
	return a > b ? a : b;
}

/* user NULL: the account of the task's user. Without memory for a new account it is a common one: not fair, but it works. */
static struct sched_account *account_of(struct sched_queue *q, const struct sched_task *t, struct sched_account *user)
{
	unsigned class = class_of(t);
	struct sched_account *a;

	for (a = q->accounts; a; a = a->next)
		if (a->user == user && a->uid == t->owner.uid && a->class == class && (!user || a->flow == t->owner.flow))
			return a;
	a = user == &q->common ? NULL : calloc(1, sizeof *a);
	if (!a)
		return &q->common;
	*a = (struct sched_account){
		.next = q->accounts,
		.user = user,
		.uid = t->owner.uid,
		.class = class,
		.flow = user ? t->owner.flow : 0,
		.number = q->number++,
		.mean = user ? user->mean : q->mean,
	};
	q->accounts = a;
	q->naccounts++;
	return a;
}

static void charge_time(struct sched_account *flow, int64_t ns)
{
	flow->tag += ns;
	if (flow->user)
		flow->user->tag += ns;
}

/* The smallest tag of the accounts that have tasks; `otherwise` if none has. */
static int64_t smallest_tag(const struct sched_queue *q, const struct sched_account *user, unsigned class, int64_t otherwise)
{
	const struct sched_account *a;
	int64_t found = otherwise;
	bool any = false;

	for (a = q->accounts; a; a = a->next) {
		if (!a->tasks || a->user != user || a->class != class)
			continue;
		found = any && found < a->tag ? found : a->tag;
		any = true;
	}
	return found;
}

/* Removes accounts without tasks whose tag others have passed. A user's account goes after those of its flows. */
static void sweep_accounts(struct sched_queue *q)
{
	for (int users = 0; users < 2; users++) {
		struct sched_account **at = &q->accounts, *a;

		while ((a = *at)) {
			int64_t now = smallest_tag(q, a->user, a->class, a->user ? a->user->now : q->now[a->class]);
			bool used = a->tasks > 0 || a->tag > now || (a->user == NULL) != (users > 0);

			for (struct sched_account *f = q->accounts; users && !used && f; f = f->next)
				used = f->user == a;
			if (used) {
				at = &a->next;
				continue;
			}
			*at = a->next;
			free(a);
			q->naccounts--;
		}
	}
	q->sweep_at = 2 * q->naccounts + ACCOUNTS_KEPT;
}

/* Nothing waits and nothing runs, so past time does not count. */
static void clear_accounts(struct sched_queue *q)
{
	struct sched_account *a;

	while ((a = q->accounts)) {
		q->accounts = a->next;
		free(a);
	}
	q->naccounts = 0;
	q->common = (struct sched_account){0};
	for (int c = 0; c < CLASSES; c++)
		q->now[c] = 0;
}

/* ---- the lists ---- */

static void leave_account(struct sched_queue *q, struct sched_task *t)
{
	t->account->tasks--;
	if (t->account->user)
		t->account->user->tasks--;
	t->account = NULL;
	if (!q->waiting && !q->running)
		clear_accounts(q);
	else if (q->naccounts > q->sweep_at)
		sweep_accounts(q);
}

void sched_queue_add(struct sched_queue *q, struct sched_task *t)
{
	struct sched_account *user = account_of(q, t, NULL), *flow = account_of(q, t, user);

	if (!user->tasks) {
		q->now[user->class] = smallest_tag(q, NULL, user->class, q->now[user->class]);
		user->tag = max_tag(user->tag, q->now[user->class]);
	}
	if (!flow->tasks && flow->user) {
		user->now = smallest_tag(q, user, user->class, user->now);
		flow->tag = max_tag(flow->tag, user->now);
	}
	flow->tasks++;
	if (flow->user)
		user->tasks++;
	t->account = flow;
	t->order = q->order++;
	t->next = NULL;
	*q->waiting_end = t;
	q->waiting_end = &t->next;
}

static bool unlink_task(struct sched_task **list, struct sched_task ***end, struct sched_task *t)
{
	struct sched_task **at;

	for (at = list; *at && *at != t; at = &(*at)->next)
		;
	if (!*at)
		return false;
	*at = t->next;
	if (end && !t->next)
		*end = at;
	t->next = NULL;
	return true;
}

bool sched_queue_remove(struct sched_queue *q, struct sched_task *t)
{
	if (!unlink_task(&q->waiting, &q->waiting_end, t))
		return false;
	if (q->claim == t)
		q->claim = NULL;
	leave_account(q, t);
	return true;
}

static struct sched_task *start_task(struct sched_queue *q, struct sched_task *t)
{
	struct sched_account *flow = t->account;

	unlink_task(&q->waiting, &q->waiting_end, t);
	if (q->claim == t)
		q->claim = NULL;
	t->took = true;
	t->next = q->running;
	q->running = t;
	q->starts++;
	t->charged = flow->mean;
	charge_time(flow, t->charged);
	return t;
}

void sched_queue_over(struct sched_queue *q, struct sched_task *t, uint64_t ns)
{
	struct sched_account *flow = t->account;

	bool running = unlink_task(&q->running, NULL, t);

	assert(running && t->account == flow);
	if (!running)
		return;
	charge_time(flow, (int64_t)ns - t->charged);
	flow->mean = flow->known ? flow->mean + ((int64_t)ns - flow->mean) / MEAN_PARTS : (int64_t)ns;
	flow->known = true;
	q->mean = flow->mean;
	if (flow->user)
		flow->user->mean = flow->mean;
	leave_account(q, t);
}

/* ---- which task is next ---- */

/* What may start now, apart from its memory. */
struct start_rules {
	bool spare, no_memory, one_reader;
	unsigned first; /* this class goes before the others */
};

/* Tasks that are held have no thread of the machine's. */
static bool has_running(const struct sched_queue *q, uint32_t uid, bool reads)
{
	for (const struct sched_task *t = q->running; t; t = t->next)
		if (t->owner.uid == uid && !t->held && (t->reads || !reads))
			return true;
	return false;
}

/* The first running task of the flow that is held. */
static const struct sched_task *held_of(const struct sched_queue *q, uint64_t flow)
{
	const struct sched_task *t;

	for (t = q->running; t && !(t->held && t->owner.flow == flow); t = t->next)
		;
	return t;
}

unsigned sched_queue_hanging(const struct sched_queue *q, const struct sched_owner *o)
{
	unsigned n = 0;

	for (const struct sched_task *t = q->running; t; t = t->next)
		n += t->held && t->owner.uid == o->uid && t->owner.flow != o->flow && held_of(q, t->owner.flow) == t;
	return n;
}

bool sched_queue_hangs(const struct sched_queue *q, const struct sched_owner *o)
{
	return held_of(q, o->flow) || sched_queue_hanging(q, o) >= SCHED_HELD_EACH;
}

/* One more would take a thread from others, too. */
static bool may_hang(const struct sched_queue *q, const struct sched_task *t)
{
	return t->reads && sched_queue_hangs(q, &t->owner);
}

static bool is_eligible(const struct sched_queue *q, const struct sched_task *t, const struct start_rules *r)
{
	if ((t->bytes && r->no_memory) || may_hang(q, t))
		return false;
	if (t->bytes && t->priority == SCHED_LAST && t->bytes > ledger_available(q->ledger, t->name))
		return false;
	if (r->spare && t->lengthy && has_running(q, t->owner.uid, false))
		return false;
	return !r->one_reader || !t->reads || !has_running(q, t->owner.uid, true);
}

static bool is_before(const struct sched_task *a, const struct sched_task *b, const struct start_rules *r)
{
	const struct sched_account *f = a->account, *g = b->account;
	const struct sched_account *u = f->user ? f->user : f, *v = g->user ? g->user : g;

	if (u->class != v->class)
		return u->class == r->first || (v->class != r->first && u->class < v->class);
	if (u != v)
		return u->tag != v->tag ? u->tag < v->tag : u->number < v->number;
	if (f != g)
		return f->tag != g->tag ? f->tag < g->tag : f->number < g->number;
	return a->priority != b->priority ? a->priority < b->priority : a->order < b->order;
}

unsigned (*sched_queue_choice)(unsigned n);

static struct sched_task *choose_by_test(const struct sched_queue *q, const struct start_rules *r)
{
	struct sched_task *t;
	unsigned n = 0;

	for (t = q->waiting; t; t = t->next)
		n += is_eligible(q, t, r);
	if (!n)
		return NULL;
	n = sched_queue_choice(n) + 1;
	for (t = q->waiting; !is_eligible(q, t, r) || --n; t = t->next)
		;
	return t;
}

static struct sched_task *find_next(const struct sched_queue *q, const struct start_rules *r)
{
	struct sched_task *t, *found = NULL;

	if (sched_queue_choice)
		return choose_by_test(q, r);
	for (t = q->waiting; t; t = t->next)
		if (is_eligible(q, t, r) && (!found || is_before(t, found, r)))
			found = t;
	return found;
}

/* A task of one user waits while a task of another user reads a file. */
static bool other_users_wait(const struct sched_queue *q)
{
	for (const struct sched_task *t = q->waiting; t; t = t->next)
		for (const struct sched_task *o = q->running; o; o = o->next)
			if (o->reads && !o->held && o->owner.uid != t->owner.uid)
				return true;
	return false;
}

static bool take_memory(struct sched_queue *q, const struct sched_task *t)
{
	return !t->bytes || ledger_take(q->ledger, t->name, t->bytes);
}

struct sched_task *sched_queue_take(struct sched_queue *q, bool spare)
{
	/* Others do not wait for the memory of a task that may not start. */
	if (q->claim && may_hang(q, q->claim))
		q->claim = NULL;

	struct start_rules r = {
		.spare = spare,
		.no_memory = q->claim != NULL,
		.one_reader = other_users_wait(q),
		.first = q->starts % LOWER_EVERY < LOWER_EVERY - 1 ? 0 : 1 + q->starts / LOWER_EVERY % (CLASSES - 1),
	};
	struct sched_task *t = q->claim;

	if (t && is_eligible(q, t, &(struct start_rules){.spare = spare}) && take_memory(q, t))
		return start_task(q, t);
	for (;;) {
		t = find_next(q, &r);
		if (!t && r.one_reader) {
			/* No other user can use the worker. */
			r.one_reader = false;
			continue;
		}
		if (!t || take_memory(q, t))
			return t ? start_task(q, t) : NULL;
		if (t->priority != SCHED_LAST)
			q->claim = t;
		r.no_memory = true;
	}
}

/* ---- state ---- */

bool sched_queue_empty(const struct sched_queue *q)
{
	return !q->waiting;
}

bool sched_queue_others_wait(const struct sched_queue *q, uint64_t flow)
{
	const struct sched_task *t;

	for (t = q->waiting; t && t->owner.flow == flow; t = t->next)
		;
	return t != NULL;
}

struct sched_task *sched_queue_first(const struct sched_queue *q)
{
	return q->waiting;
}

struct sched_task *sched_queue_running(const struct sched_queue *q)
{
	return q->running;
}

uint64_t sched_queue_starved(const struct sched_queue *q)
{
	return q->claim ? q->claim->bytes : 0;
}

int64_t sched_queue_service(const struct sched_queue *q, uint32_t uid)
{
	const struct sched_account *a;
	int64_t most = 0;

	for (a = q->accounts; a; a = a->next)
		if (!a->user && a->uid == uid && a->class != CLASS_LAST)
			most = max_tag(most, a->tag - smallest_tag(q, NULL, a->class, q->now[a->class]));
	return most;
}

void sched_queue_flow(const struct sched_queue *q, uint64_t flow, struct sched_flow *ret)
{
	const struct sched_task *t;

	*ret = (struct sched_flow){.running = 0};
	for (t = q->running; t; t = t->next)
		ret->running += t->owner.flow == flow;
	for (t = q->waiting; t; t = t->next) {
		if (t->owner.flow != flow)
			continue;
		ret->waiting++;
		if (t == q->claim || (t->bytes > ret->bytes && q->claim))
			ret->bytes = t->bytes;
	}
}
