/*
 * Finished domains of removed datasets: finds their files in the store and removes them.
 *
 * The model: the plan of a job lists the domains of its mesh, and a job is kept for some time after its dataset is gone. A domain
 * in such a plan is removed, unless the plan of a job whose dataset exists has it, too. The domains to keep are too many for a
 * list, so they go into a Bloom filter of fixed size: each sets a few bits, and a domain whose bits are all set is kept. Now and
 * then this keeps a domain that could go; it never removes one that is in a plan of an existing dataset. Domains that are in no
 * plan are evicted in time, since they are not used.
 */
#include <stdlib.h>

#include "cache_priv.h"
#include "plan_file.h"
#include "store.h"

enum { TABLE_BYTES = 512 << 10, BITS_EACH = 4 };

struct gone {
	struct maintenance *maintenance;
	uint64_t *job; /* numbers; first `nexisting` whose dataset exists */
	size_t nexisting, n;
	uint8_t *table;
	uint64_t bytes, entries; /* removed */
};

struct gone *cache_gone_new(struct maintenance *m, struct err *err)
{
	size_t n = jobs_kept(m->jobs);
	uint64_t bytes = TABLE_BYTES + n * sizeof(uint64_t);
	struct gone *g;

	if (charge(m->core, bytes, "looking for what is not needed", err))
		return NULL;
	g = calloc(1, sizeof *g);
	if (g) {
		*g = (struct gone){
			.maintenance = m, .job = calloc(n + 1, sizeof *g->job), .table = calloc(1, TABLE_BYTES), .n = n};
		if (g->job && g->table) {
			g->nexisting = jobs_list(m->jobs, g->job);
			return g;
		}
		free(g->job);
		free(g->table);
		free(g);
	}
	uncharge(m->core, bytes);
	err_set(err, ERR_NOMEM, "no memory to look for what is not needed");
	return NULL;
}

struct gone *cache_gone_free(struct gone *g)
{
	if (!g)
		return NULL;
	uncharge(g->maintenance->core, TABLE_BYTES + g->n * sizeof(uint64_t));
	free(g->job);
	free(g->table);
	free(g);
	return NULL;
}

/* Digests are uniformly distributed, so their parts serve as hashes. */
static uint64_t bit_of(const struct plan_done *d, unsigned i)
{
	return (d->base.lo + d->list.hi + i * ((d->base.hi ^ d->list.lo) | 1)) % (8 * (uint64_t)TABLE_BYTES);
}

static int keep(void *ctx, const struct plan_done *d, struct err *err)
{
	struct gone *g = ctx;

	for (unsigned i = 0; i < BITS_EACH; i++) {
		uint64_t bit = bit_of(d, i);

		g->table[bit / 8] |= (uint8_t)(1u << bit % 8);
	}
	return 0;
}

static int drop(void *ctx, const struct plan_done *d, struct err *err)
{
	const struct store_id id = {d->base, d->list};
	struct gone *g = ctx;
	uint64_t bytes;
	unsigned set = 0;
	int r;

	for (unsigned i = 0; i < BITS_EACH; i++) {
		uint64_t bit = bit_of(d, i);

		set += g->table[bit / 8] >> bit % 8 & 1;
	}
	if (set == BITS_EACH)
		return 0;
	r = space_remove_domain(g->maintenance->core->space, g->maintenance->core->domainsfd, &id, &bytes, err);
	if (!r && bytes) {
		g->bytes += bytes;
		g->entries++;
	}
	return r;
}

int cache_gone_run(struct gone *g, uint64_t *ret_bytes, uint64_t *ret_entries, struct err *err)
{
	int r = 0;

	if (g->nexisting < g->n)
		for (size_t i = 0; i < g->nexisting && !r; i++)
			r = plan_file_each_done(g->maintenance->core->plansfd, g->job[i], keep, g, err);
	for (size_t i = g->nexisting; i < g->n && !r; i++)
		r = plan_file_each_done(g->maintenance->core->plansfd, g->job[i], drop, g, err);
	*ret_bytes = g->bytes;
	*ret_entries = g->entries;
	return r;
}
