/*
 * Plans of datasets that grew a little.
 *
 * A plan is made from the points alone, so its regions are those of the previous plan wherever nothing changed. Where
 * something changed, one thread would remake a region of half a million points for a few new ones while the others have
 * nothing to do. So regions that were stored and have changed are split to half of the load, but not below regions that
 * are stored and valid. With each change the cost comes closer to the size of the change. If much has changed, nothing
 * is split, because large regions are faster.
 *
 * Checking the store opens a file for each leaf; any number of threads can share that, some leaves each.
 */
#include <stdatomic.h>
#include <stdlib.h>

#include "err.h"
#include "pipe.h"
#include "pipe_priv.h"

enum { FINE = 2, MOST = 4 /* at most a quarter of the positions are in leaves that are split */, ABOVE = 3 };

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
	leaf->checked = true;
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

/* For a region that is not stored: whether one of the regions just above it is stored. Then it was split from a
 * leaf that has outgrown the load. */
static int find_outgrown(const struct pipe_reuse_params *p, const struct cut_region *root, const struct cut_region *region,
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

/* Splits the leaf at *i; *i is then behind its parts. */
static int split_leaf(const struct pipe_reuse_params *p, struct grid_reader *reader, struct cut_plan *plan, size_t *i,
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
		/* Everything that meets a part meets the whole. */
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

/* ---- checking the store ---- */

enum { LOOK = 16 /* leaves at once: half a millisecond, or more if their files are not in the page cache */ };

struct pipe_refine {
	struct cut_plan *plan;
	size_t leaves; /* before any was split */
	atomic_size_t next;
	uint8_t state[];
};

int pipe_refine_new(struct cut_plan *plan, struct pipe_refine **ret, struct err *err)
{
	struct pipe_refine *f = calloc(1, sizeof *f + plan->n);

	if (!f)
		return err_set(err, ERR_NOMEM, "no memory for a plan of %zu domains", plan->n);
	f->plan = plan;
	f->leaves = plan->n;
	*ret = f;
	return 0;
}

struct pipe_refine *pipe_refine_free(struct pipe_refine *f)
{
	free(f);
	return NULL;
}

int pipe_refine_reader(struct pipe_reuse_params *p, struct err *err)
{
	return grid_reader_new(p->grid, (uint8_t *)p->memory + PIPE_TRACE, grid_reader_bytes(p->grid), &p->reader, err);
}

int pipe_refine_step(struct pipe_refine *f, const struct pipe_reuse_params *p, struct err *err)
{
	size_t from = atomic_fetch_add(&f->next, LOOK);
	int r = 0;

	if (from >= f->leaves)
		return PIPE_E_REFINED;
	for (size_t k = from; !r && k < from + LOOK && k < f->leaves; k++) {
		enum state is = NEW;

		r = state_of(p, &f->plan->leaf[k], &is, err);
		f->state[k] = (uint8_t)is;
	}
	return r;
}

/* ---- splitting ---- */

/* *ret_few: little has changed. */
static int measure_change(const struct pipe_reuse_params *p, struct pipe_refine *f, bool *ret_few, struct err *err)
{
	const struct cut_leaf *leaf = f->plan->leaf;
	uint64_t changed = 0, all = 0;
	struct cut_region root;
	size_t stored = 0;
	int32_t box[4];
	int r = 0;

	*ret_few = false;
	for (size_t k = 0; k < f->leaves; k++) {
		stored += f->state[k] != NEW;
		changed += f->state[k] == CHANGED ? leaf[k].count : 0;
		all += leaf[k].count;
	}
	if (!stored || !grid_box(p->grid, box))
		return 0;
	cut_region_root(box, &root);
	for (size_t k = 0; !r && k < f->leaves; k++) {
		bool is = false;

		/* Leaves that will not be split are not checked: most leaves of a survey that doubled are new. */
		if (f->state[k] != NEW || changed > all / MOST)
			continue;
		r = find_outgrown(p, &root, &leaf[k].region, &is, err);
		changed += is ? leaf[k].count : 0;
		f->state[k] = is ? CHANGED : NEW;
		/* All leaves above it fitted, and little was added. */
		f->plan->leaf[k].fits = is;
	}
	*ret_few = changed <= all / MOST;
	return r;
}

int pipe_refine_split(struct pipe_refine *f, const struct pipe_reuse_params *p, struct err *err)
{
	size_t i = 0;
	bool few;
	int r = measure_change(p, f, &few, err);

	for (size_t k = 0; !r && few && k < f->leaves; k++) {
		if (f->state[k] == CHANGED && f->plan->leaf[i].count > p->load / FINE)
			r = split_leaf(p, p->reader, f->plan, &i, err);
		else
			i++;
	}
	return r;
}

bool pipe_refine_applies(const struct view *view, const struct cut_plan *plan)
{
	/* Regions of a window are not those of the whole mesh. */
	return !view->window && !cut_plan_flat(plan) && plan->n >= MOST;
}

int pipe_refine(const struct pipe_reuse_params *p, struct cut_plan *plan, struct err *err)
{
	struct pipe_reuse_params q = *p;
	struct pipe_refine *f;
	int r;

	if (!pipe_refine_applies(p->view, plan))
		return 0;
	r = pipe_refine_reader(&q, err);
	if (r)
		return r;
	r = pipe_refine_new(plan, &f, err);
	if (r)
		return r;
	while (!r)
		r = pipe_refine_step(f, &q, err);
	r = r == PIPE_E_REFINED ? pipe_refine_split(f, &q, err) : r;
	pipe_refine_free(f);
	return r;
}
