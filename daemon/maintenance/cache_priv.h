/* What cache_verify.c (what comes next) and cache_read.c (reading it) share. */
#ifndef CACHE_PRIV_H
#define CACHE_PRIV_H

#include <stdatomic.h>

#include "grid.h"
#include "grid_verify.h"
#include "maintenance_priv.h"
#include "lock.h"

enum cache_step { CACHE_CATALOGUE, CACHE_DATASETS, CACHE_PLANS, CACHE_SELECTIONS, CACHE_DOMAINS, CACHE_OVER };

/* As many as are told at a time; whoever finds more waits until they are. */
enum { CACHE_DAMAGES = 16 };

struct cache_verify {
	struct maintenance *maintenance;
	const struct cache_verify_calls *calls;
	void *token;
	struct sched_task task;
	enum cache_step step;
	bool busy;               /* a worker, or the catalogue's thread, has it */
	uint64_t last;           /* dataset that was read last */
	struct dataset *dataset; /* that is being read */
	char manifest[64];
	uint64_t pending[32]; /* its interrupted pushes */
	size_t npending;
	uint64_t wait_ns; /* there was no memory for it then: again later */
	uint64_t told_ns;

	struct lock lock; /* of what workers and the loop share */
	pthread_cond_t room;
	struct cache_damage *damage; /* CACHE_DAMAGES */
	size_t ndamage;
	bool ended;

	atomic_uint_fast64_t bytes, files;
	struct cache_verified found; /* damaged, derived */
	int r;
	struct err err;
	void *memory; /* of the worker: GRID_VERIFY_BYTES */
};

/* Finished domains of datasets that are gone (cache_gone.c). On the loop, by a worker, on the loop. */
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
