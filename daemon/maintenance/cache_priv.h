/* Shared by cache_verify.c (the order of the steps) and cache_read.c (the reading). */
#ifndef CACHE_PRIV_H
#define CACHE_PRIV_H

#include <stdatomic.h>

#include "grid.h"
#include "grid_verify.h"
#include "maintenance_priv.h"
#include "lock.h"

enum cache_step { CACHE_CATALOGUE, CACHE_DATASETS, CACHE_PLANS, CACHE_SELECTIONS, CACHE_DOMAINS, CACHE_OVER };

/* Capacity of the list of damages; a worker that finds more waits until the loop has reported some. */
enum { CACHE_DAMAGES = 16 };

struct cache_verify {
	struct maintenance *maintenance;
	const struct cache_verify_calls *calls;
	void *token;
	struct sched_task task;
	enum cache_step step;
	bool busy;               /* a worker, or the catalogue's thread, is at it */
	uint64_t last;           /* the dataset that was read last */
	struct dataset *dataset; /* the one that is being read */
	char manifest[64];
	uint64_t pending[32]; /* its interrupted pushes */
	size_t npending;
	uint64_t wait_ns; /* when memory was lacking: it is tried again later; 0: it does not wait */
	uint64_t told_ns; /* when progress was reported last */

	struct lock lock;            /* of the list and `ended` */
	pthread_cond_t room;         /* the list has room */
	struct cache_damage *damage; /* CACHE_DAMAGES */
	size_t ndamage;
	bool ended;

	atomic_uint_fast64_t bytes, files;
	struct cache_verified found; /* damaged, derived */
	int r;
	struct err err;
	void *memory; /* of the worker: GRID_VERIFY_BYTES */
};

/* Finished domains of removed datasets (cache_gone.c). `_new` and `_free` on the loop, `_run` on a worker. */
struct gone;
struct gone *cache_gone_new(struct maintenance *, struct err *err);
int cache_gone_run(struct gone *, uint64_t *ret_bytes, uint64_t *ret_entries, struct err *err);
struct gone *cache_gone_free(struct gone *);

void cache_read_dataset(struct cache_verify *); /* workers; results in v->r, v->err */
void cache_read_plans(struct cache_verify *);
void cache_read_selections(struct cache_verify *);
void cache_read_domains(struct cache_verify *);
/* Any thread. */
void cache_found(struct cache_verify *, const char *what, bool derived, bool removed, const struct err *);
bool cache_ended(struct cache_verify *);

#endif
