/*
 * Plans of datasets that grew a little.
 *
 * A plan is made from the points alone, so that its regions are those of the plan before wherever nothing changed. Where
 * something did, a region of half a million points is made again for a handful of new ones, by one thread while the
 * others have nothing to do. So regions that were stored and have changed are cut to half of the load, except into
 * what is in the store as it is: the cost of a change follows its own size more closely each time. Where much has changed
 * nothing is cut: large regions are faster.
 */
#include <stdlib.h>

#include "err.h"
#include "pipe.h"
#include "pipe_priv.h"

enum { FINE = 2, MOST = 4 /* of the positions, at most a quarter are in what is cut */, ABOVE = 3 };

enum state { NEW, CHANGED, THERE };

static int state_of(const struct pipe_reuse_params *p, struct cut_leaf *leaf, enum state *ret, struct err *err)
{
	struct pipe_reuse_params q = *p;
	struct pipe_found f;
	struct pipe_stored as;
	int r;

	q.region = &leaf->region;
	q.sums = true;
	r = pipe_find(&q, &f, err);
	if (r < 0)
		return r;
	leaf->fits |= f.fits;
	leaf->looked = true;
	leaf->there = r == 0;
	leaf->changed = r != 0 && f.versions;
	*ret = r == 0 ? THERE : f.versions ? CHANGED : NEW;
	if (r == 0 && p->there) {
		struct mesh_domain d = f.front.domain;

		d.link = NULL;
		d.vertex = NULL;
		pipe_found_stored(&f, &as);
		p->there(p->ctx, &leaf->region, &d, &as);
	}
	return 0;
}

/* A region that nothing is stored of: whether something is of one of the regions just above it. Then it was split off a
 * leaf that has outgrown the load. */
static int outgrown(const struct pipe_reuse_params *p, const struct cut_region *root, const struct cut_region *region,
		    bool *ret, struct err *err)
{
	struct cut_region above[ABOVE];
	size_t n = cut_region_above(root, region, above, ABOVE), found = 0;
	struct store_version version;
	int r = 0;

	for (size_t k = 0; !r && !found && k < n; k++)
		r = store_versions(p->storefd, pipe_key_of(p->key, &above[k]), &version, 1, &found, err);
	*ret = found > 0;
	return r;
}

/* The leaf at *i and what becomes of it; *i is then behind. */
static int cut_leaf(const struct pipe_reuse_params *p, struct grid_reader *reader, struct cut_plan *plan, size_t *i,
		    struct err *err)
{
	size_t end = *i + 1;

	const bool fits = plan->leaf[*i].fits;

	for (bool first = true; *i < end; first = false) {
		struct cut_leaf *leaf = &plan->leaf[*i];
		enum state state = CHANGED;
		bool halved = false;
		int r = 0;

		if (!first)
			r = state_of(p, leaf, &state, err);
		/* What meets a part meets the whole. */
		leaf->fits |= fits;
		if (!r && state != THERE && leaf->count > p->load / FINE)
			r = cut_plan_halve(plan, *i, reader, &halved, err);
		if (r)
			return r;
		end += halved;
		*i += !halved;
	}
	return 0;
}

/* *ret_few: what has changed is little. */
static int look(const struct pipe_reuse_params *p, struct cut_plan *plan, uint8_t *state, bool *ret_few, struct err *err)
{
	uint64_t changed = 0, all = 0;
	struct cut_region root;
	size_t stored = 0;
	int32_t box[4];
	int r = 0;

	*ret_few = false;
	for (size_t k = 0; !r && k < plan->n; k++) {
		struct cut_leaf *leaf = &plan->leaf[k];
		enum state is = NEW;

		r = state_of(p, leaf, &is, err);
		state[k] = (uint8_t)is;
		stored += is != NEW;
		changed += is == CHANGED ? leaf->count : 0;
		all += leaf->count;
	}
	if (!stored || !grid_box(p->grid, box))
		return r;
	cut_region_root(box, &root);
	for (size_t k = 0; !r && k < plan->n; k++) {
		bool is = false;

		/* What is not to be cut is not asked for: of a survey that doubled most leaves are new. */
		if (state[k] != NEW || changed > all / MOST)
			continue;
		r = outgrown(p, &root, &plan->leaf[k].region, &is, err);
		changed += is ? plan->leaf[k].count : 0;
		state[k] = is ? CHANGED : NEW;
		/* All above fitted, and what came is little. */
		plan->leaf[k].fits = is;
	}
	*ret_few = changed <= all / MOST;
	return r;
}

static int refine(const struct pipe_reuse_params *p, struct grid_reader *reader, struct cut_plan *plan, uint8_t *state,
		  struct err *err)
{
	size_t leaves = plan->n, i = 0;
	bool few;
	int r = look(p, plan, state, &few, err);

	for (size_t k = 0; !r && few && k < leaves; k++) {
		if (state[k] == CHANGED && plan->leaf[i].count > p->load / FINE)
			r = cut_leaf(p, reader, plan, &i, err);
		else
			i++;
	}
	return r;
}

int pipe_refine(const struct pipe_reuse_params *p, struct cut_plan *plan, struct err *err)
{
	struct pipe_reuse_params q = *p;
	struct grid_reader *reader = NULL;
	uint8_t *state;
	int r;

	/* Regions of a window are not those of the whole mesh. */
	if (p->view->window || plan->n < MOST)
		return 0;
	state = calloc(plan->n, 1);
	if (!state)
		return err_set(err, ERR_NOMEM, "no memory for a plan of %zu domains", plan->n);
	r = grid_reader_new(p->grid, (uint8_t *)p->memory + PIPE_TRACE, grid_reader_bytes(p->grid), &reader, err);
	q.reader = reader;
	if (!r)
		r = refine(&q, reader, plan, state, err);
	grid_reader_free(reader);
	free(state);
	return r;
}
