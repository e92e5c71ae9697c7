/* What the domains of a mesh count together, beside what the indexes of packs have: read from the head of each. */
#include "gather_priv.h"
#include "decimal.h"
#include "view.h"

struct counting {
	const struct gather_input *in;
	struct mesh_counts sum;
};

static int count(void *ctx, const struct store_pack *pack, const struct store_pack_entry *e, struct err *err)
{
	struct counting *c = ctx;
	struct store_front front;
	const struct mesh_counts *one = &front.domain.counts;
	int r = store_pack_head(pack, e, &front, err);

	if (r)
		return r;
	c->sum.points += one->points;
	c->sum.halo += one->halo;
	c->sum.cells_read += one->cells_read;
	c->sum.points_read += one->points_read;
	mesh_most_add(&c->sum.most, one->most.points, one->most.x, one->most.y);
	for (int i = 0; i < MESH_RULES; i++)
		c->sum.removed[i] += one->removed[i];
	return 0;
}

int gather_counts(const struct gather_input *in, struct acut_report *p, struct acut_removed *removed, struct err *err)
{
	const struct lattice *l = &in->manifest->lattice;
	struct counting c = {.in = in};
	const struct gather_walk walk = {NULL, count, &c};
	int r = gather_walk(in, &walk, err);

	p->points = c.sum.points;
	p->halo = c.sum.halo;
	p->cells_read = c.sum.cells_read;
	p->points_read = c.sum.points_read;
	p->most_points = c.sum.most.points;
	if (c.sum.most.points) {
		p->most_at[0] = decimal_scaled_double(l->scale_xy, c.sum.most.x + l->k[0]);
		p->most_at[1] = decimal_scaled_double(l->scale_xy, c.sum.most.y + l->k[1]);
	}
	for (int i = 0; i < VIEW_RULES; i++)
		removed[i] = (struct acut_removed){view_rule_text((enum view_rule)i), c.sum.removed[i]};
	p->removed = removed;
	p->nremoved = VIEW_RULES;
	return r;
}
