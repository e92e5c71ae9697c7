/*
 * The number of each vertex in a file that several tasks write at once.
 *
 * The model: the domain whose region holds a position numbers it. So the numbers of a domain begin at the sum of the positions of
 * all domains before it. These sums are known of packs and of groups of domains without opening a pack (gather_sum.c); in a group
 * they follow from its part of the index, which is read when something of the group is needed, and kept. So a task opens the
 * packs of its range and those of its neighbours. In a domain the order is: open vertices that its region holds, closed vertices,
 * positions of the region that none of its own triangles uses. Corners in regions of other domains are looked up
 * (gather_corner.c).
 */
#include <stdlib.h>
#include <string.h>

#include "gather_place.h"
#include "io.h"

enum { SOME = 16 };
/* ---- memory ---- */

int gather_places_new(const struct gather_input *in, uint64_t memory, struct gather_places **ret, struct err *err)
{
	struct gather_places *p = calloc(1, sizeof(*p));

	if (!p)
		return err_set(err, ERR_NOMEM, "no memory for the regions of domains");
	p->in = in;
	p->most = memory;
	for (unsigned i = 0; i < PLACE_PACKS; i++)
		p->opened[i].file.fd = -1;
	p->pack = calloc((size_t)in->npacks + 1, sizeof(struct place_groups *));
	p->held = sizeof(*p) + ((uint64_t)in->npacks + 1) * sizeof(struct place_groups *);
	*ret = p;
	if (p->pack)
		return 0;
	*ret = gather_places_free(p);
	return err_set(err, ERR_NOMEM, "no memory for the regions of domains");
}

void place_table_drop(struct gather_places *p, struct place_table *t)
{
	p->held -= t->n * sizeof(*t->seat) + t->nextra * sizeof(*t->extra);
	free(t->seat);
	free(t->extra);
	*t = (struct place_table){.n = 0};
}

struct place_table *place_table_oldest(struct gather_places *p)
{
	struct place_table *old = NULL;

	for (unsigned i = 0; i < PLACE_TABLES; i++)
		if (p->table[i].used && (!old || p->table[i].used < old->used))
			old = &p->table[i];
	return old;
}

/* Memory that stays in use. Tables that were not used for long go for it. */
static void *take_memory(struct gather_places *p, uint64_t bytes, struct err *err)
{
	struct place_table *old;
	void *at;

	while (p->held + bytes > p->most && (old = place_table_oldest(p)))
		place_table_drop(p, old);
	if (p->held + bytes > p->most) {
		err_set(err, ERR_LIMIT, "the regions of a task take more than %llu bytes of memory", (unsigned long long)p->most);
		err_add_hint(err, "give tasks more memory (--task-memory)");
		return NULL;
	}
	at = malloc(bytes);
	if (!at)
		err_set(err, ERR_NOMEM, "no memory for the regions of domains");
	else
		p->held += bytes;
	return at;
}

uint64_t gather_places_held(const struct gather_places *p)
{
	return p->held;
}

struct gather_places *gather_places_free(struct gather_places *p)
{
	if (!p)
		return NULL;
	for (unsigned i = 0; i < PLACE_TABLES; i++)
		place_table_drop(p, &p->table[i]);
	for (unsigned i = 0; i < PLACE_PACKS; i++)
		io_close(p->opened[i].file.fd);
	for (uint32_t i = 0; p->pack && i < p->in->npacks; i++) {
		for (unsigned k = 0; p->pack[i] && k < MESH_GROUPS; k++)
			free(p->pack[i]->place[k]);
		free(p->pack[i]);
	}
	free(p->pack);
	free(p->front);
	free(p);
	return NULL;
}

struct gather_place_counts gather_place_counts(const struct gather_places *p)
{
	return p->counts;
}

/* ---- packs ---- */

static int open_pack(struct gather_places *p, uint32_t pack, const struct store_pack **ret, struct err *err)
{
	struct place_opened *o;
	int r;

	for (unsigned i = 0; i < PLACE_PACKS; i++)
		if (p->opened[i].file.fd >= 0 && p->opened[i].pack == pack) {
			*ret = &p->opened[i].file.of;
			return 0;
		}
	o = &p->opened[p->next++ % PLACE_PACKS];
	o->file.fd = io_close(o->file.fd);
	r = gather_pack_open(p->in, pack, &o->file, err);
	o->pack = pack;
	if (!r)
		*ret = &o->file.of;
	return r;
}

int gather_place_entry(struct gather_places *p, const struct gather_place *at, const struct store_pack **ret_pack,
		       struct store_pack_entry *ret, struct err *err)
{
	int r = open_pack(p, at->pack, ret_pack, err);

	return r ? r : store_pack_entries(*ret_pack, at->entry, 1, ret, err);
}

/* Links and open vertices of a domain; valid until the next one. */
int place_front(struct gather_places *p, const struct gather_place *at, struct mesh_domain *ret, struct err *err)
{
	const struct store_pack *pack;
	struct store_pack_entry e;
	int r = gather_place_entry(p, at, &pack, &e, err);

	p->counts.fronts++;
	if (!r && store_pack_front_bytes(&e) > p->front_bytes) {
		free(p->front);
		p->front_bytes = store_pack_front_bytes(&e);
		p->front = malloc(p->front_bytes);
		if (!p->front) {
			p->front_bytes = 0;
			r = err_set(err, ERR_NOMEM, "no memory for the open vertices of a domain");
		}
	}
	return r ? r : store_pack_front(pack, &e, p->front, ret, err);
}

/* ---- groups ---- */

int place_groups(struct gather_places *p, uint32_t pack, struct place_groups **ret, struct err *err)
{
	const struct gather_pack *of = &p->in->pack[pack];
	struct place_groups *g = p->pack[pack];
	uint64_t first = of->first, triangles = of->first_triangle;
	int r;

	*ret = g;
	if (g)
		return 0;
	g = take_memory(p, sizeof(*g), err);
	if (!g)
		return -(int)err->code;
	p->pack[pack] = g;
	memset(g, 0, sizeof(*g));
	r = gather_groups(p->in, pack, g->group, err);
	for (uint32_t k = 0; k < of->ngroup && !r; k++) {
		g->first[k] = first;
		g->first_triangle[k] = triangles;
		first += g->group[k].vertices;
		triangles += g->group[k].triangles;
	}
	*ret = g;
	return r;
}

uint32_t place_group_size(const struct gather_pack *of, uint32_t k)
{
	const uint64_t left = of->domains - k * of->each;

	return (uint32_t)(left < of->each ? left : of->each);
}

static int set_place(struct gather_place *own, const struct store_pack *pack, const struct store_pack_entry *e, struct err *err)
{
	own->own = e->own;
	own->nvertex = e->nvertex;
	own->nopen = e->nopen;
	own->ntriangle = e->nvertex ? e->ntriangle : 0;
	memcpy(own->box, e->box, sizeof(own->box));
	if (cut_region_parse(e->region, &own->region))
		return 0;
	err_set(err, ERR_CORRUPT, "a pack has a domain of no region: \"%.64s\"", e->region);
	return err_add_file(err, pack->name);
}

static int read_places(struct gather_places *p, uint32_t pack, uint32_t k, struct place_groups *g, struct err *err)
{
	const struct gather_pack *of = &p->in->pack[pack];
	const uint32_t n = place_group_size(of, k);
	struct gather_place *place = g->place[k], before = {.first = g->first[k], .first_triangle = g->first_triangle[k]};
	struct store_pack_entry entry[SOME];
	const struct store_pack *file;
	int r = open_pack(p, pack, &file, err);

	for (uint32_t i = 0; i < n && !r; i++) {
		if (i % SOME == 0)
			r = store_pack_entries(file, k * of->each + i, n - i < SOME ? n - i : SOME, entry, err);
		place[i] = (struct gather_place){.pack = pack,
						 .entry = (uint32_t)(k * of->each + i),
						 .first = before.first + before.own,
						 .first_triangle = before.first_triangle + before.ntriangle};
		if (!r)
			r = set_place(&place[i], file, &entry[i % SOME], err);
		before = place[i];
	}
	if (r || (before.first + before.own == g->first[k] + g->group[k].vertices &&
		  before.first_triangle + before.ntriangle == g->first_triangle[k] + g->group[k].triangles))
		return r;
	err_set(err, ERR_CORRUPT, "the pack has other numbers of vertices and triangles than its record");
	return err_add_file(err, file->name);
}

int place_group(struct gather_places *p, uint32_t pack, uint32_t k, const struct gather_place **ret, struct err *err)
{
	struct place_groups *g;
	int r = place_groups(p, pack, &g, err);

	if (r || g->place[k]) {
		*ret = r ? NULL : g->place[k];
		return r;
	}
	g->place[k] = take_memory(p, place_group_size(&p->in->pack[pack], k) * sizeof(struct gather_place), err);
	if (!g->place[k])
		return -(int)err->code;
	*ret = g->place[k];
	return read_places(p, pack, k, g, err);
}

int gather_places_walk(struct gather_places *p, const struct gather_places_choice *choice, gather_place_fn each, void *ctx,
		       struct err *err)
{
	const struct gather_place *place;
	struct place_groups *g;
	int r = 0;

	for (uint32_t i = 0; i < p->in->npacks && !r; i++) {
		const struct gather_pack *of = &p->in->pack[i];

		if (!of->ngroup || !choice->wants(choice->ctx, of->first_domain, of->domains, of->first, of->all.vertices,
						  of->first_triangle, of->all.triangles))
			continue;
		r = place_groups(p, i, &g, err);
		for (uint32_t k = 0; k < of->ngroup && !r; k++) {
			const uint64_t first = of->first_domain + k * of->each;
			const uint32_t n = place_group_size(of, k);

			if (!choice->wants(choice->ctx, first, n, g->first[k], g->group[k].vertices, g->first_triangle[k],
					   g->group[k].triangles))
				continue;
			r = place_group(p, i, k, &place, err);
			for (uint32_t j = 0; j < n && !r; j++)
				if (choice->wants(choice->ctx, first + j, 1, place[j].first, place[j].own,
						  place[j].first_triangle, place[j].ntriangle))
					r = each(ctx, first + j, &place[j], err);
		}
	}
	return r;
}

/* ---- borders ---- */

struct part {
	unsigned __int128 all;
	uint32_t index, tasks;
};

static bool is_before(const struct part *of, uint64_t first, uint64_t first_triangle)
{
	return (unsigned __int128)(first + first_triangle) * of->tasks < of->all * of->index;
}

/* The last pack that begins before the border, and of that the last group; false: none does. */
static bool find_group(struct gather_places *p, const struct part *of, uint32_t *pack, uint32_t *group, int *r, struct err *err)
{
	const struct gather_input *in = p->in;
	struct place_groups *g;
	bool any = false;

	for (uint32_t i = 0; i < in->npacks; i++)
		if (in->pack[i].ngroup && is_before(of, in->pack[i].first, in->pack[i].first_triangle)) {
			*pack = i;
			any = true;
		}
	if (!any)
		return false;
	*r = place_groups(p, *pack, &g, err);
	*group = 0;
	for (uint32_t k = 0; k < in->pack[*pack].ngroup && !*r; k++)
		if (is_before(of, g->first[k], g->first_triangle[k]))
			*group = k;
	return !*r;
}

int gather_places_border(struct gather_places *p, uint32_t index, uint32_t tasks, struct gather_border *ret, struct err *err)
{
	const struct mesh_sums *s = &p->in->sums;
	const struct part of = {(unsigned __int128)s->vertices + s->triangles, index, tasks};
	const struct gather_place *place;
	uint32_t pack = 0, k = 0, n;
	int r = 0;

	*ret = index == tasks ? (struct gather_border){s->domains, s->vertices, s->triangles} : (struct gather_border){0, 0, 0};
	if (index == tasks || !find_group(p, &of, &pack, &k, &r, err))
		return r;
	r = place_group(p, pack, k, &place, err);
	n = place_group_size(&p->in->pack[pack], k);
	for (uint32_t i = 0; i < n && !r && is_before(&of, place[i].first, place[i].first_triangle); i++)
		*ret = (struct gather_border){p->in->pack[pack].first_domain + place[i].entry + 1, place[i].first + place[i].own,
					      place[i].first_triangle + place[i].ntriangle};
	return r;
}
