/*
 * The number of each vertex in a file that several tasks write at once.
 *
 * The model: the domain whose region holds a position numbers it. So the numbers of a domain begin at the sum of the positions of
 * all domains before it, which are in the indexes of the packs, and a task knows where they begin without reading a vertex. In a
 * domain the order is: open vertices that its region holds, closed vertices, positions of the region that none of its own
 * triangles uses. A corner in the region of another domain is open there, or is one of the latter. So of another domain only its
 * open vertices are read (store_pack_front), and only if a triangle at the border of a range needs them. The last such domains
 * are kept.
 *
 * Positions that no triangle of their own domain uses are about three in ten million, and as many as there are where survey and
 * regions are sparse. Nothing says where they are, but their number is known, and they are open vertices of other domains: those
 * whose box meets the region are read. So a pack needs nothing more for them.
 */
#include <stdlib.h>
#include <string.h>

#include "cut.h"
#include "gather_priv.h"
#include "io.h"
#include "point.h"

enum { TABLES = 256, PACKS = 8 };

/* Morton keys of a part of a region. */
struct span {
	uint64_t low, high;
	uint32_t domain;
};
struct seat {
	uint64_t place, number;
};
/* What others need of a domain. */
struct table {
	uint32_t domain;
	size_t n, nextra;
	struct seat *seat;         /* by place */
	struct mesh_vertex *extra; /* by place: positions without a triangle of the domain's own */
	uint64_t used;             /* when */
};
struct opened {
	uint32_t pack;
	int fd; /* -1: none */
	struct store_pack of;
};
struct gather_places {
	const struct gather_input *in;
	struct gather_place *place;
	struct span *span;
	size_t n, room, nspan, room_spans;
	struct table table[TABLES];
	uint64_t clock, held, most; /* bytes of tables */
	struct opened opened[PACKS];
	unsigned next;
	void *front;
	size_t front_bytes;
	struct gather_place_counts counts;
};

static uint64_t place_of(const struct mesh_vertex *v)
{
	return digest_place(v->x, v->y);
}

/* ---- all domains ---- */

static int add_spans(struct gather_places *p, const struct cut_region *region, uint32_t domain, struct err *err)
{
	struct cut_range range[4];
	unsigned n = cut_region_ranges(region, range);

	if (p->nspan + n > p->room_spans) {
		size_t room = 2 * (p->nspan + n) + 64;
		struct span *more = realloc(p->span, room * sizeof(*more));

		if (!more)
			return err_set(err, ERR_NOMEM, "no memory for the regions of %zu domains", p->n);
		p->span = more;
		p->room_spans = room;
	}
	for (unsigned i = 0; i < n; i++)
		p->span[p->nspan++] = (struct span){range[i].lo, range[i].hi, domain};
	return 0;
}

/* Packs come in order, each with its own name. */
static int add_place(void *ctx, const struct store_pack *pack, const struct store_pack_entry *e, struct err *err)
{
	struct gather_places *p = ctx;
	const struct gather_place *before = p->n ? &p->place[p->n - 1] : NULL;
	struct gather_place own = {.pack = before ? before->pack : 0,
				   .own = e->own,
				   .nvertex = e->nvertex,
				   .nopen = e->nopen,
				   .ntriangle = e->nvertex ? e->ntriangle : 0};

	if (p->n == p->room)
		return err_set(err, ERR_INTERNAL, "the packs have more domains than before");
	while (pack->name != p->in->pack[own.pack].name)
		own.pack++;
	if (before && before->pack == own.pack)
		own.entry = before->entry + 1;
	if (before) {
		own.first = before->first + before->own;
		own.first_triangle = before->first_triangle + before->ntriangle;
	}
	memcpy(own.box, e->box, sizeof(own.box));
	if (!cut_region_parse(e->region, &own.region)) {
		err_set(err, ERR_CORRUPT, "a pack has a domain of no region: \"%.64s\"", e->region);
		return err_add_file(err, pack->name);
	}
	p->place[p->n++] = own;
	return add_spans(p, &own.region, (uint32_t)p->n - 1, err);
}

static int by_low(const void *a, const void *b)
{
	const struct span *x = a, *y = b;

	return x->low < y->low ? -1 : x->low > y->low;
}

uint64_t gather_places_bytes(uint64_t domains)
{
	return domains * (sizeof(struct gather_place) + 2 * sizeof(struct span)) + sizeof(struct gather_places);
}

int gather_places_new(const struct gather_input *in, uint64_t memory, struct gather_places **ret, struct err *err)
{
	struct gather_places *p = calloc(1, sizeof(*p));
	int r;

	if (!p)
		return err_set(err, ERR_NOMEM, "no memory for the regions of domains");
	p->in = in;
	p->most = memory;
	p->room = in->sums.domains;
	for (unsigned i = 0; i < PACKS; i++)
		p->opened[i].fd = -1;
	p->place = calloc(p->room + 1, sizeof(*p->place));
	r = p->place ? gather_walk(in, NULL, add_place, p, err) : err_set(err, ERR_NOMEM, "no memory for %zu domains", p->room);
	if (!r && p->nspan)
		qsort(p->span, p->nspan, sizeof(*p->span), by_low);
	if (r)
		gather_places_free(p);
	else
		*ret = p;
	return r;
}

static void table_drop(struct gather_places *p, struct table *t)
{
	p->held -= t->n * sizeof(*t->seat) + t->nextra * sizeof(*t->extra);
	free(t->seat);
	free(t->extra);
	*t = (struct table){.n = 0};
}

struct gather_places *gather_places_free(struct gather_places *p)
{
	if (!p)
		return NULL;
	for (unsigned i = 0; i < TABLES; i++)
		table_drop(p, &p->table[i]);
	for (unsigned i = 0; i < PACKS; i++)
		io_close(p->opened[i].fd);
	free(p->front);
	free(p->place);
	free(p->span);
	free(p);
	return NULL;
}

const struct gather_place *gather_place(const struct gather_places *p, size_t *ret_n)
{
	*ret_n = p->n;
	return p->place;
}

struct gather_place_counts gather_place_counts(const struct gather_places *p)
{
	return p->counts;
}

/* ---- packs ---- */

static int open_pack(struct gather_places *p, uint32_t pack, const struct store_pack **ret, struct err *err)
{
	struct opened *o;
	int r;

	for (unsigned i = 0; i < PACKS; i++)
		if (p->opened[i].fd >= 0 && p->opened[i].pack == pack) {
			*ret = &p->opened[i].of;
			return 0;
		}
	o = &p->opened[p->next++ % PACKS];
	o->fd = io_close(o->fd);
	r = gather_pack_open(p->in, pack, &o->fd, &o->of, err);
	o->pack = pack;
	if (!r)
		*ret = &o->of;
	return r;
}

int gather_place_entry(struct gather_places *p, size_t domain, const struct store_pack **ret_pack, struct store_pack_entry *ret,
		       struct err *err)
{
	const struct gather_place *at = &p->place[domain];
	int r = open_pack(p, at->pack, ret_pack, err);

	return r ? r : store_pack_entries(*ret_pack, at->entry, 1, ret, err);
}

/* Links and open vertices of a domain; valid until the next one. */
static int read_front(struct gather_places *p, size_t domain, struct mesh_domain *ret, struct err *err)
{
	const struct store_pack *pack;
	struct store_pack_entry e;
	int r = gather_place_entry(p, domain, &pack, &e, err);

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

/* ---- tables ---- */

static int by_seat(const void *a, const void *b)
{
	const struct seat *x = a, *y = b;

	return x->place < y->place ? -1 : x->place > y->place;
}

static const struct seat *find(const struct table *t, uint64_t place)
{
	const struct seat key = {.place = place};

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

static int look_in(struct gather_places *p, size_t domain, const struct table *t, const struct cut_region *region,
		   struct extras *x, struct err *err)
{
	struct mesh_domain d;
	int r = read_front(p, domain, &d, err);

	for (uint32_t i = 0; !r && i < d.nopen; i++)
		if (cut_region_holds(region, d.vertex[i].x, d.vertex[i].y) && !find(t, place_of(&d.vertex[i])))
			r = add_extra(x, &d.vertex[i], err);
	return r;
}

/* The `want` positions of a domain that are not in its table yet. */
static int find_extras(struct gather_places *p, struct table *t, uint64_t want, struct err *err)
{
	const struct gather_place *of = &p->place[t->domain];
	struct extras x = {NULL, 0, 0};
	int64_t box[4];
	size_t n = 0;
	int r = 0;

	cut_region_box(&of->region, box);
	for (size_t i = 0; i < p->n && !r; i++)
		if (i != t->domain && meets(&p->place[i], box))
			r = look_in(p, i, t, &of->region, &x, err);
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

static int add_extra_seats(struct table *t, uint64_t first, struct err *err)
{
	struct seat *more = realloc(t->seat, (t->n + t->nextra + 1) * sizeof(*more));

	if (!more)
		return err_set(err, ERR_NOMEM, "no memory for the vertices of a region");
	t->seat = more;
	for (size_t i = 0; i < t->nextra; i++)
		t->seat[t->n++] = (struct seat){place_of(&t->extra[i]), first + i};
	qsort(t->seat, t->n, sizeof(*t->seat), by_seat);
	return 0;
}

static int fill(struct gather_places *p, struct table *t, struct err *err)
{
	const struct gather_place *of = &p->place[t->domain];
	uint64_t have = of->nvertex - of->nopen;
	struct mesh_domain d = {.nopen = 0};
	int r = of->nopen ? read_front(p, t->domain, &d, err) : 0;

	t->seat = malloc(((size_t)of->nopen + 1) * sizeof(*t->seat));
	if (!r && !t->seat)
		r = err_set(err, ERR_NOMEM, "no memory for the vertices of a region");
	for (uint32_t i = 0; !r && i < d.nopen; i++)
		if (cut_region_holds(&of->region, d.vertex[i].x, d.vertex[i].y)) {
			t->seat[t->n] = (struct seat){place_of(&d.vertex[i]), of->first + t->n};
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

static struct table *oldest(struct gather_places *p)
{
	struct table *old = NULL;

	for (unsigned i = 0; i < TABLES; i++)
		if (p->table[i].used && (!old || p->table[i].used < old->used))
			old = &p->table[i];
	return old;
}

/* A free one; tables that were not used for long go, so that all fit their memory. */
static struct table *take(struct gather_places *p)
{
	struct table *t = NULL, *old;

	while (p->held > p->most && (old = oldest(p)))
		table_drop(p, old);
	for (unsigned i = 0; i < TABLES && !t; i++)
		t = p->table[i].used ? NULL : &p->table[i];
	if (!t) {
		t = oldest(p);
		table_drop(p, t);
	}
	return t;
}

static int table_of(struct gather_places *p, size_t domain, const struct table **ret, struct err *err)
{
	struct table *t = NULL;
	int r;

	for (unsigned i = 0; i < TABLES && !t; i++)
		t = p->table[i].used && p->table[i].domain == domain ? &p->table[i] : NULL;
	if (!t) {
		t = take(p);
		*t = (struct table){.domain = (uint32_t)domain};
		p->counts.tables++;
		r = fill(p, t, err);
		p->held += t->n * sizeof(*t->seat) + t->nextra * sizeof(*t->extra);
		if (r) {
			table_drop(p, t);
			return r;
		}
	}
	t->used = ++p->clock;
	*ret = t;
	return 0;
}

/* ---- numbers ---- */

int gather_place_extras(struct gather_places *p, size_t domain, const struct mesh_vertex **ret, size_t *ret_n, struct err *err)
{
	const struct table *t;
	int r = table_of(p, domain, &t, err);

	if (r)
		return r;
	*ret = t->extra;
	*ret_n = t->nextra;
	return 0;
}

static const struct gather_place *holder(const struct gather_places *p, const struct mesh_vertex *v, size_t *ret)
{
	const uint64_t key = point_morton(v->x, v->y);
	size_t low = 0, high = p->nspan;

	while (low < high) {
		size_t middle = low + (high - low) / 2;

		if (p->span[middle].low <= key)
			low = middle + 1;
		else
			high = middle;
	}
	if (!low || p->span[low - 1].high < key)
		return NULL;
	*ret = p->span[low - 1].domain;
	return &p->place[*ret];
}

int gather_place_number(struct gather_places *p, const struct mesh_vertex *v, uint64_t *ret, struct err *err)
{
	const struct seat *seat = NULL;
	const struct table *t;
	size_t domain;
	int r = 0;

	if (holder(p, v, &domain)) {
		r = table_of(p, domain, &t, err);
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
