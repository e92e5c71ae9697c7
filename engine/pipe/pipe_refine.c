/*
 * Plans of datasets that grew a little.
 *
 * A plan is made from the points alone, so that its regions are those of the plan before wherever nothing changed. Where
 * something did, a region of half a million points is made again for a handful of new ones, by one thread while the
 * others have nothing to do. So regions that were stored and have changed are cut to a quarter of the load, except into
 * what is in the store as it is: the cost of a change follows its own size more closely each time. Where much has changed
 * nothing is cut: large regions are faster.
 */
#include <stdlib.h>

#include "err.h"
#include "pipe.h"
#include "pipe_priv.h"

enum { FINE = 4, VERSIONS = 8, MOST = 4 /* of the leaves, at most a quarter are cut */ };

enum state { NEW, CHANGED, THERE };

/* By header and index: of as many records as the region has now, or of the very content. */
static int state_of(const struct pipe_reuse_params *p, struct grid_reader *reader, const struct cut_region *region,
		    enum state *ret, struct err *err)
{
	struct store_id id = {.base = pipe_key_of(p->key, region)};
	struct store_version version[VERSIONS];
	struct cut_range range[4];
	uint64_t points = 0;
	size_t n = 0;
	int r = store_versions(p->storefd, id.base, version, VERSIONS, &n, err);

	*ret = NEW;
	if (r || !n)
		return r;
	*ret = CHANGED;
	for (unsigned k = cut_region_ranges(region, range); k-- > 0;) {
		uint64_t count;
		bool exact;

		r = grid_count(reader, range[k].lo, range[k].hi, &count, &exact, err);
		if (r)
			return r;
		points += count;
	}
	for (size_t i = 0; i < n; i++) {
		struct store_front f;

		id.list = version[i].list;
		r = store_head(p->storefd, &id, &f, err);
		if (r < 0)
			return r;
		if (!r && (f.domain.counts.points == points || digest_equal(f.beside.content, p->key->content))) {
			*ret = THERE;
			return 0;
		}
	}
	return 0;
}

/* The leaf at *i and what becomes of it; *i is then behind. */
static int cut_leaf(const struct pipe_reuse_params *p, struct grid_reader *reader, struct cut_plan *plan, size_t *i,
		    struct err *err)
{
	size_t end = *i + 1;

	for (bool first = true; *i < end; first = false) {
		enum state state = CHANGED;
		bool halved = false;
		int r = 0;

		if (!first)
			r = state_of(p, reader, &plan->leaf[*i].region, &state, err);
		if (!r && state != THERE && plan->leaf[*i].count > p->load / FINE)
			r = cut_plan_halve(plan, *i, reader, &halved, err);
		if (r)
			return r;
		end += halved;
		*i += !halved;
	}
	return 0;
}

static int refine(const struct pipe_reuse_params *p, struct grid_reader *reader, struct cut_plan *plan, bool *cut,
		  struct err *err)
{
	size_t leaves = plan->n, some = 0, i = 0;

	for (size_t k = 0; k < leaves; k++) {
		enum state state;
		int r = state_of(p, reader, &plan->leaf[k].region, &state, err);

		if (r)
			return r;
		cut[k] = state == CHANGED && plan->leaf[k].count > p->load / FINE;
		some += state == CHANGED;
	}
	for (size_t k = 0; some <= leaves / MOST && k < leaves; k++) {
		int r = 0;

		if (cut[k])
			r = cut_leaf(p, reader, plan, &i, err);
		else
			i++;
		if (r)
			return r;
	}
	return 0;
}

int pipe_refine(const struct pipe_reuse_params *p, struct cut_plan *plan, struct err *err)
{
	struct grid_reader *reader = NULL;
	bool *cut;
	int r;

	/* Regions of a window are not those of the whole mesh. */
	if (p->view->window || plan->n < MOST)
		return 0;
	cut = calloc(plan->n, sizeof *cut);
	if (!cut)
		return err_set(err, ERR_NOMEM, "no memory for a plan of %zu domains", plan->n);
	r = grid_reader_new(p->grid, (uint8_t *)p->memory + PIPE_TRACE, grid_reader_bytes(p->grid), &reader, err);
	if (!r)
		r = refine(p, reader, plan, cut, err);
	grid_reader_free(reader);
	free(cut);
	return r;
}
