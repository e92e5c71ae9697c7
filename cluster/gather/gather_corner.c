/*
 * Numbers of corners that the region of their domain does not hold.
 *
 * The model: a corner in the region of another domain is an open vertex there, or a position of it that no triangle of that
 * domain uses. So of the other domain only its open vertices are read (store_pack_front), and only if a triangle at the border of
 * a range needs them. They become a table by position; the last such tables are kept.
 *
 * Positions that no triangle of their own domain uses are about three in ten million, and as many as there are where survey and
 * regions are sparse. Nothing says where they are, but their number is known, and they are open vertices of other domains: those
 * whose box meets the region are read. So a pack needs nothing more for them.
 */
#include <stdlib.h>
#include <string.h>

#include "gather_place.h"

static uint64_t place_of(const struct mesh_vertex *v)
{
	return digest_place(v->x, v->y);
}

/* ---- tables ---- */

static int by_seat(const void *a, const void *b)
{
	const struct place_seat *x = a, *y = b;

	return x->place < y->place ? -1 : x->place > y->place;
}

static const struct place_seat *find(const struct place_table *t, uint64_t place)
{
	const struct place_seat key = {.place = place};

	return t->n ? bsearch(&key, t->seat, t->n, sizeof(*t->seat), by_seat) : NULL;
}

static int by_vertex(const void *a, const void *b)
{
	const uint64_t x = place_of(a), y = place_of(b);

	return x < y ? -1 : x > y;
}

struct extras {
	struct mesh_vertex *v;
	size_t n, room;
};

static int add_extra(struct extras *x, const struct mesh_vertex *v, struct err *err)
{
	if (x->n == x->room) {
		size_t room = x->room ? 2 * x->room : 16;
		struct mesh_vertex *more = realloc(x->v, room * sizeof(*more));

		if (!more)
			return err_set(err, ERR_NOMEM, "no memory for the vertices of a region");
		x->v = more;
		x->room = room;
	}
	x->v[x->n++] = *v;
	return 0;
}

static bool meets(const struct gather_place *of, const int64_t box[4])
{
	/* doubled numbers of the region */
	return of->nopen && 2 * (int64_t)of->box[0] <= box[2] && 2 * (int64_t)of->box[3] >= box[0] &&
	       2 * (int64_t)of->box[1] <= box[3] && 2 * (int64_t)of->box[4] >= box[1];
}

/* Whether triangles of one of the domains can have a corner in the region. */
static bool group_meets(const struct mesh_group *g, const int64_t box[4])
{
	return g->triangles && 2 * (int64_t)g->box[0] <= box[2] && 2 * (int64_t)g->box[2] >= box[0] &&
	       2 * (int64_t)g->box[1] <= box[3] && 2 * (int64_t)g->box[3] >= box[1];
}

static int look_in(struct gather_places *p, const struct gather_place *at, const struct place_table *t, struct extras *x,
		   struct err *err)
{
	struct mesh_domain d;
	int r = place_front(p, at, &d, err);

	for (uint32_t i = 0; !r && i < d.nopen; i++)
		if (cut_region_holds(&t->of->region, d.vertex[i].x, d.vertex[i].y) && !find(t, place_of(&d.vertex[i])))
			r = add_extra(x, &d.vertex[i], err);
	return r;
}

static int look_in_pack(struct gather_places *p, uint32_t pack, const struct place_table *t, const int64_t box[4],
			struct extras *x, struct err *err)
{
	const struct gather_pack *of = &p->in->pack[pack];
	const struct gather_place *place;
	struct place_groups *g;
	int r = place_groups(p, pack, &g, err);

	for (uint32_t k = 0; k < of->ngroup && !r; k++) {
		if (!group_meets(&g->group[k], box))
			continue;
		r = place_group(p, pack, k, &place, err);
		for (uint32_t i = 0; i < place_group_size(of, k) && !r; i++)
			if (&place[i] != t->of && meets(&place[i], box))
				r = look_in(p, &place[i], t, x, err);
	}
	return r;
}

/* The `want` positions of a domain that are not in its table yet. */
static int find_extras(struct gather_places *p, struct place_table *t, uint64_t want, struct err *err)
{
	struct extras x = {NULL, 0, 0};
	int64_t box[4];
	size_t n = 0;
	int r = 0;

	cut_region_box(&t->of->region, box);
	for (uint32_t i = 0; i < p->in->npacks && !r; i++)
		if (group_meets(&p->in->pack[i].all, box))
			r = look_in_pack(p, i, t, box, &x, err);
	if (!r && x.n)
		qsort(x.v, x.n, sizeof(*x.v), by_vertex);
	for (size_t i = 0; i < x.n; i++)
		if (!n || place_of(&x.v[n - 1]) != place_of(&x.v[i]))
			x.v[n++] = x.v[i];
	if (!r && n != want)
		r = err_set(err, ERR_INTERNAL,
			    "a region has %llu positions without triangles of its own, and others use %zu of it",
			    (unsigned long long)want, n);
	if (r) {
		free(x.v);
		return r;
	}
	t->extra = x.v;
	t->nextra = n;
	p->counts.found += n;
	return 0;
}

static int add_extra_seats(struct place_table *t, uint64_t first, struct err *err)
{
	struct place_seat *more = realloc(t->seat, (t->n + t->nextra + 1) * sizeof(*more));

	if (!more)
		return err_set(err, ERR_NOMEM, "no memory for the vertices of a region");
	t->seat = more;
	for (size_t i = 0; i < t->nextra; i++)
		t->seat[t->n++] = (struct place_seat){place_of(&t->extra[i]), first + i};
	qsort(t->seat, t->n, sizeof(*t->seat), by_seat);
	return 0;
}

static int fill(struct gather_places *p, struct place_table *t, struct err *err)
{
	const struct gather_place *of = t->of;
	uint64_t have = of->nvertex - of->nopen;
	struct mesh_domain d = {.nopen = 0};
	int r = of->nopen ? place_front(p, of, &d, err) : 0;

	t->seat = malloc(((size_t)of->nopen + 1) * sizeof(*t->seat));
	if (!r && !t->seat)
		r = err_set(err, ERR_NOMEM, "no memory for the vertices of a region");
	for (uint32_t i = 0; !r && i < d.nopen; i++)
		if (cut_region_holds(&of->region, d.vertex[i].x, d.vertex[i].y)) {
			t->seat[t->n] = (struct place_seat){place_of(&d.vertex[i]), of->first + t->n};
			t->n++;
		}
	have += t->n;
	if (!r && have > of->own)
		r = err_set(err, ERR_INTERNAL, "a region has %llu positions, and its domain %llu of them",
			    (unsigned long long)of->own, (unsigned long long)have);
	if (!r && t->n)
		qsort(t->seat, t->n, sizeof(*t->seat), by_seat);
	if (r || have == of->own)
		return r;
	r = find_extras(p, t, of->own - have, err);
	return r ? r : add_extra_seats(t, of->first + have, err);
}

/* A free one; tables that were not used for long go, so that all fit their memory. */
static struct place_table *take(struct gather_places *p)
{
	struct place_table *t = NULL, *old;

	while (p->held > p->most && (old = place_table_oldest(p)))
		place_table_drop(p, old);
	for (unsigned i = 0; i < PLACE_TABLES && !t; i++)
		t = p->table[i].used ? NULL : &p->table[i];
	if (!t) {
		t = place_table_oldest(p);
		place_table_drop(p, t);
	}
	return t;
}

static int table_of(struct gather_places *p, const struct gather_place *of, const struct place_table **ret, struct err *err)
{
	struct place_table *t = NULL;
	int r;

	for (unsigned i = 0; i < PLACE_TABLES && !t; i++)
		t = p->table[i].used && p->table[i].of == of ? &p->table[i] : NULL;
	if (!t) {
		t = take(p);
		*t = (struct place_table){.of = of};
		p->counts.tables++;
		r = fill(p, t, err);
		p->held += t->n * sizeof(*t->seat) + t->nextra * sizeof(*t->extra);
		if (r) {
			place_table_drop(p, t);
			return r;
		}
	}
	t->used = ++p->clock;
	*ret = t;
	return 0;
}

/* ---- numbers ---- */

int gather_place_extras(struct gather_places *p, const struct gather_place *at, const struct mesh_vertex **ret, size_t *ret_n,
			struct err *err)
{
	const struct place_table *t;
	int r = table_of(p, at, &t, err);

	if (r)
		return r;
	*ret = t->extra;
	*ret_n = t->nextra;
	return 0;
}

static bool group_holds(const struct mesh_group *g, const struct mesh_vertex *v)
{
	return v->x >= g->region[0] && v->x <= g->region[2] && v->y >= g->region[1] && v->y <= g->region[3];
}

/* Regions hold no position twice, but the boxes of groups may. */
static int find_in_pack(struct gather_places *p, uint32_t pack, const struct mesh_vertex *v, const struct gather_place **ret,
			struct err *err)
{
	const struct gather_pack *of = &p->in->pack[pack];
	const struct gather_place *place;
	struct place_groups *g;
	int r = place_groups(p, pack, &g, err);

	for (uint32_t k = 0; k < of->ngroup && !r && !*ret; k++) {
		if (!group_holds(&g->group[k], v))
			continue;
		r = place_group(p, pack, k, &place, err);
		for (uint32_t i = 0; i < place_group_size(of, k) && !r && !*ret; i++)
			if (cut_region_holds(&place[i].region, v->x, v->y))
				*ret = &place[i];
	}
	return r;
}

static int find_holder(struct gather_places *p, const struct mesh_vertex *v, const struct gather_place **ret, struct err *err)
{
	int r = 0;

	*ret = p->last && cut_region_holds(&p->last->region, v->x, v->y) ? p->last : NULL;
	for (uint32_t i = 0; i < p->in->npacks && !r && !*ret; i++)
		if (p->in->pack[i].ngroup && group_holds(&p->in->pack[i].all, v))
			r = find_in_pack(p, i, v, ret, err);
	p->last = *ret;
	return r;
}

int gather_place_number(struct gather_places *p, const struct mesh_vertex *v, uint64_t *ret, struct err *err)
{
	const struct gather_place *of;
	const struct place_seat *seat = NULL;
	const struct place_table *t;
	int r = find_holder(p, v, &of, err);

	if (!r && of) {
		r = table_of(p, of, &t, err);
		seat = r ? NULL : find(t, place_of(v));
	}
	if (!r && !seat)
		r = err_set(err, ERR_INTERNAL, "the vertex at (%d, %d) is of no region", v->x, v->y);
	if (r)
		return r;
	p->counts.looked_up++;
	*ret = seat->number;
	return 0;
}
