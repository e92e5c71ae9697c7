/*
 * The model: the homes of all workers are a permutation, as ranks among the processors that a worker may use. A worker that is
 * about to sleep elsewhere than at home changes homes with whoever lives there, if that one is awake: it is likely to be at
 * work elsewhere, and nobody has to move. Who is asleep keeps his.
 */
#include "sched_home.h"

#include <pthread.h>
#include <stdlib.h>

struct sched_homes {
	pthread_mutex_t lock;
	unsigned n;
	struct worker {
		unsigned home;
		bool asleep;
	} worker[];
};

struct sched_homes *sched_homes_new(unsigned workers)
{
	struct sched_homes *h = calloc(1, sizeof *h + workers * sizeof *h->worker);

	if (!h)
		return NULL;
	pthread_mutex_init(&h->lock, NULL);
	h->n = workers;
	for (unsigned i = 0; i < workers; i++)
		h->worker[i].home = i;
	return h;
}

struct sched_homes *sched_homes_free(struct sched_homes *h)
{
	if (!h)
		return NULL;
	pthread_mutex_destroy(&h->lock);
	free(h);
	return NULL;
}

/* How many of the set come before it. */
static unsigned rank_of(const cpu_set_t *set, int cpu)
{
	unsigned rank = 0;

	for (int i = 0; i < cpu; i++)
		rank += CPU_ISSET(i, set) != 0;
	return rank;
}

static int cpu_of(const cpu_set_t *set, unsigned rank)
{
	int i = 0;

	for (; rank || !CPU_ISSET(i, set); i++)
		rank -= CPU_ISSET(i, set) != 0;
	return i;
}

unsigned sched_homes_settle(struct sched_homes *h, unsigned worker, unsigned here)
{
	struct worker *me = &h->worker[worker];
	unsigned home;

	pthread_mutex_lock(&h->lock);
	for (unsigned i = 0; i < h->n; i++)
		if (h->worker[i].home == here && !h->worker[i].asleep) {
			h->worker[i].home = me->home;
			me->home = here;
			break;
		}
	me->asleep = true;
	home = me->home;
	pthread_mutex_unlock(&h->lock);
	return home;
}

void sched_home_go(struct sched_homes *h, unsigned worker, struct sched_home *s)
{
	int cpu = sched_getcpu();
	unsigned n;

	/* EINVAL: more processors than a set has room for. */
	if (s->bound || cpu < 0 || cpu >= CPU_SETSIZE || sched_getaffinity(0, sizeof s->away, &s->away) < 0)
		return;
	n = (unsigned)CPU_COUNT(&s->away);
	if (n < 2 || h->n < n || !CPU_ISSET(cpu, &s->away))
		return;
	CPU_ZERO(&s->home);
	CPU_SET(cpu_of(&s->away, sched_homes_settle(h, worker, rank_of(&s->away, cpu)) % n), &s->home);
	s->bound = sched_setaffinity(0, sizeof s->home, &s->home) == 0;
}

void sched_home_leave(struct sched_homes *h, unsigned worker, struct sched_home *s)
{
	cpu_set_t now;

	pthread_mutex_lock(&h->lock);
	h->worker[worker].asleep = false;
	pthread_mutex_unlock(&h->lock);
	if (!s->bound)
		return;
	s->bound = false;
	/* What somebody else set while it slept stays. */
	if (sched_getaffinity(0, sizeof now, &now) == 0 && CPU_EQUAL(&now, &s->home))
		sched_setaffinity(0, sizeof s->away, &s->away);
}
