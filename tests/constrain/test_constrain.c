/*
 * Domains with pieces (engine/constrain) on thousands of random sets, tilings, views and partitions: the triangles of all domains
 * are those of the whole constrained mesh, each once, and the emitter takes them. A domain depends on points and pieces alone,
 * not on cells. Without the verification of flagged triangles the result is wrong, which is tested as well.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "check.h"
#include "constrain.h"
#include "constrain_priv.h"
#include "cut_order.h"
#include "err.h"
#include "geom.h"
#include "made.h"
#include "parts.h"
#include "pipe.h"
#include "repeat.h"
#include "sets.h"

enum { MAX_N = SETS_MAX_N, MAX_PIECES = 120, MAX_LEAVES = 40, MAX_TRIANGLES = PARTS_TRIANGLES };

/* What is out: by triangle of the whole mesh; reversed in a box whose sides are pieces that the view does not keep. */
struct area {
	bool any, far, boxed;
	bool out[MAX_TRIANGLES];
	int32_t box[4];
};

static struct sets set;
static struct view view;
static struct lineset_piece piece[MAX_PIECES];
static unsigned npiece, ninserted;
static struct parts_mesh whole, all, parts; /* all: also what is out */
static struct area area;
static void *arena, *other;
static uint64_t cases, domains, constrained, turns, added, loaded, crossed, gone, splits, asked, outs, boxes, marked;

static unsigned below(uint64_t *seed, unsigned n)
{
	return sets_below(seed, n);
}

/* ---- pieces ---- */

static void piece_set(struct lineset_piece *p, const struct mesh_vertex *a, const struct mesh_vertex *b)
{
	const int32_t ends[2][2] = {{a->x, a->y}, {b->x, b->y}};
	bool swap = !geom_less(ends[0], ends[1]);

	*p = (struct lineset_piece){.turns = 0};
	memcpy(p->a, ends[swap], sizeof(p->a));
	memcpy(p->b, ends[!swap], sizeof(p->b));
}

/* A piece with an end that is no kept position is ignored, whatever it crosses. */
static void add_gone(uint64_t *seed)
{
	const struct mesh_vertex *a = &set.pos[below(seed, set.n)];
	struct mesh_vertex b = *a;

	b.x = (int32_t)((uint32_t)b.x + below(seed, 50));
	b.y = (int32_t)((uint32_t)b.y + below(seed, 50));
	for (unsigned i = 0; i < set.n; i++)
		if (set.pos[i].x == b.x && set.pos[i].y == b.y)
			return;
	piece_set(&piece[npiece++], a, &b);
	gone++;
}

/* Pieces among the positions in some fashion: anywhere, from one vertex, or between neighbours in Morton order. */
static void draw(uint64_t *seed, unsigned fashion, unsigned i, unsigned ret[2])
{
	ret[0] = fashion == 1 ? 0 : below(seed, set.n);
	ret[1] = fashion == 2 ? (ret[0] + 1 + below(seed, 3)) % set.n : below(seed, set.n);
	if (fashion == 3)
		ret[0] = i % set.n;
}

/* Offers pieces to the mesh of all positions, and keeps those that it takes. False: the positions are flat. */
static bool make_whole(uint64_t *seed)
{
	struct tri *t = check_tri(set.pos, set.n);
	unsigned fashion = below(seed, 5), tries = below(seed, 2 * MAX_PIECES);
	struct tri_pieces *p;
	struct tri_result r;

	npiece = whole.n = 0;
	if (!t)
		return false;
	p = check_pieces(t, 2 * set.n);
	for (unsigned i = 0; i < tries && npiece < MAX_PIECES / 2; i++) {
		unsigned end[2];
		uint32_t at;

		draw(seed, fashion, i, end);
		if (!tri_piece_insert(p, end[0], end[1], &at))
			piece_set(&piece[npiece++], &set.pos[end[0]], &set.pos[end[1]]);
	}
	ninserted = npiece;
	for (unsigned i = below(seed, 4); i > 0; i--)
		add_gone(seed);
	tri_result(t, &r);
	for (uint32_t i = 0; i < r.ntriangle; i++) {
		const uint32_t *c = r.triangle[i].corner;
		int32_t at[3][3];

		if (c[0] == TRI_GHOST || c[1] == TRI_GHOST || c[2] == TRI_GHOST)
			continue;
		for (unsigned k = 0; k < 3; k++) {
			memcpy(at[k], r.xy[c[k]], sizeof(r.xy[0]));
			at[k][2] = r.z[c[k]];
		}
		parts_add(&whole, (const int32_t(*)[3])at);
	}
	parts_sort(&whole);
	free(p);
	free(t);
	return true;
}

/* ---- what is out ---- */

static bool in_box(int64_t x, int64_t y, unsigned den)
{
	return area.boxed && x >= (int64_t)den * area.box[0] && x < (int64_t)den * area.box[2] &&
	       y >= (int64_t)den * area.box[1] && y < (int64_t)den * area.box[3];
}

static int side_of(const int32_t *a, const int32_t *b, int64_t x, int64_t y, unsigned den)
{
	geom_i128 side = (geom_i128)((int64_t)b[0] - a[0]) * (y - (int64_t)den * a[1]) -
			 (geom_i128)((int64_t)b[1] - a[1]) * (x - (int64_t)den * a[0]);

	return geom_sign128(side);
}

static int state(void *ctx, int64_t x, int64_t y, unsigned den, unsigned *ret, struct err *err)
{
	bool out = area.far;

	(void)ctx;
	(void)err;
	for (unsigned i = 0; i < all.n; i++) {
		const int32_t *t = all.triangle[i];

		if (side_of(t, t + 3, x, y, den) > 0 && side_of(t + 3, t + 6, x, y, den) > 0 && side_of(t + 6, t, x, y, den) > 0)
			out = area.out[i];
	}
	*ret = out ^ in_box(x, y, den) ? LINESET_OUT : 0;
	asked++;
	return 0;
}

/* Adds the sides of a box that is reversed; its corners are no kept positions. */
static void make_box(uint64_t *seed)
{
	const struct mesh_vertex *a = &set.pos[below(seed, set.n)], *b = &set.pos[below(seed, set.n)];
	int32_t box[4] = {a->x < b->x ? a->x : b->x, a->y < b->y ? a->y : b->y, a->x < b->x ? b->x : a->x,
			  a->y < b->y ? b->y : a->y};
	struct mesh_vertex corner[4];

	box[0] = box[0] > INT32_MIN ? box[0] - (int32_t)below(seed, 2) : box[0];
	box[3] = box[3] < INT32_MAX ? box[3] + (int32_t)below(seed, 2) : box[3];
	for (unsigned i = 0; i < 4; i++)
		corner[i] = (struct mesh_vertex){box[i == 1 || i == 2 ? 2 : 0], box[i >= 2 ? 3 : 1], 0};
	if (box[0] == box[2] || box[1] == box[3])
		return;
	for (unsigned i = 0; i < set.n; i++)
		for (unsigned k = 0; k < 4; k++)
			if (set.pos[i].x == corner[k].x && set.pos[i].y == corner[k].y)
				return;
	memcpy(area.box, box, sizeof(box));
	area.boxed = true;
	for (unsigned i = 0; i < 4; i++) {
		piece_set(&piece[npiece], &corner[i], &corner[(i + 1) % 4]);
		piece[npiece++].turns = LINESET_OUT;
	}
	boxes++;
}

static bool has_edge(const int32_t *t, const struct lineset_piece *p)
{
	unsigned n = 0;

	for (unsigned i = 0; i < 3; i++)
		n += !memcmp(t + 3 * i, p->a, sizeof(p->a)) || !memcmp(t + 3 * i, p->b, sizeof(p->b));
	return n == 2;
}

/* Two triangles share an edge that is no piece. */
static bool linked(const int32_t *t, const int32_t *u)
{
	struct lineset_piece shared;
	const int32_t *end[3];
	unsigned n = 0;

	for (unsigned i = 0; i < 3; i++)
		for (unsigned k = 0; k < 3; k++)
			if (!memcmp(t + 3 * i, u + 3 * k, 2 * sizeof(int32_t)))
				end[n++] = t + 3 * i;
	if (n != 2)
		return false;
	piece_set(&shared, &(struct mesh_vertex){end[0][0], end[0][1], 0}, &(struct mesh_vertex){end[1][0], end[1][1], 0});
	for (unsigned i = 0; i < ninserted; i++)
		if (!memcmp(shared.a, piece[i].a, sizeof(shared.a)) && !memcmp(shared.b, piece[i].b, sizeof(shared.b)))
			return false;
	return true;
}

/* Draws which parts of the plane between pieces are out; pieces between different ones turn it. */
static void make_area(uint64_t *seed)
{
	unsigned part[MAX_TRIANGLES];
	bool out[MAX_TRIANGLES + 1];

	area = (struct area){.any = below(seed, 3) == 0};
	all = whole;
	if (!area.any)
		return;
	for (unsigned i = 0; i < all.n; i++)
		part[i] = i;
	for (bool changed = true; changed;) {
		changed = false;
		for (unsigned i = 0; i < all.n; i++)
			for (unsigned k = 0; k < all.n; k++)
				if (part[k] < part[i] && linked(all.triangle[i], all.triangle[k])) {
					part[i] = part[k];
					changed = true;
				}
	}
	for (unsigned i = 0; i <= all.n; i++)
		out[i] = below(seed, 2);
	area.far = out[all.n];
	for (unsigned i = 0; i < all.n; i++)
		area.out[i] = out[part[i]];
	for (unsigned i = 0; i < ninserted; i++) {
		unsigned n = 0, there = 0;

		for (unsigned k = 0; k < all.n; k++)
			if (has_edge(all.triangle[k], &piece[i])) {
				n++;
				there += area.out[k];
			}
		there += n == 1 && area.far;
		piece[i].turns = there == 1 ? LINESET_OUT : 0;
	}
	if (below(seed, 2))
		make_box(seed);
	whole.n = 0;
	for (unsigned i = 0; i < all.n; i++) {
		const int32_t *t = all.triangle[i];
		unsigned at;

		state(NULL, (int64_t)t[0] + t[3] + t[6], (int64_t)t[1] + t[4] + t[7], 3, &at, NULL);
		if (!at)
			parts_add(&whole, (const int32_t(*)[3])t);
	}
}

static int find(void *ctx, const int32_t box[4], lineset_piece_fn fn, void *sink, struct err *err)
{
	(void)ctx;
	for (unsigned i = 0; i < npiece; i++) {
		const struct lineset_piece *p = &piece[i];
		int32_t low = p->a[1] < p->b[1] ? p->a[1] : p->b[1], high = p->a[1] < p->b[1] ? p->b[1] : p->a[1];
		int rc = p->a[0] > box[2] || p->b[0] < box[0] || low > box[3] || high < box[1] ? 0 : fn(sink, p, err);

		if (rc)
			return rc;
	}
	return 0;
}

/* ---- domains ---- */

static struct constrain_lines lines = {.find = find};

/* The domain of a region, in `memory`. */
static void domain_make(const struct cut_source *src, const struct cut_region *region, bool verify, void *memory,
			struct mesh_domain *ret)
{
	struct made m = {.src = src, .view = &view, .region = region, .lines = &lines, .not_verified = !verify, .memory = memory};

	made_domain(&m, ret);
	turns += m.c.turns;
	added += m.c.added;
	loaded += m.n;
	crossed += m.c.crossed;
	constrained += m.c.crossed > 0;
	domains++;
}

/* The kernel may be in less memory: then it says so, and names how much would suffice. */
static void domain_in_less(uint64_t *seed, const struct cut_source *src, const struct cut_region *region)
{
	struct tri *tri = tri_init(other, MAX_N);
	struct cut_load load = {
		.out = tri_input(tri), .cap = MAX_N, .scratch = made_scratch(), .scratch_size = made_scratch_size()};
	struct constrain c = {.src = src,
			      .view = &view,
			      .region = region,
			      .lines = &lines,
			      .arena = other,
			      .size = tri_bytes(MAX_N) + below(seed, MADE_BYTES / 2),
			      .used = tri_bytes(MAX_N)};
	struct err err = ERR_INIT;
	uint64_t need = 0;
	int rc;

	assert_int_equal(cut_load_from(src, &view, region, &load, &need, &err), 0);
	if (tri_run(tri, load.n) == TRI_E_FLAT)
		return;
	c.tri = tri;
	rc = constrain_run(&c, &need, &err);
	assert_true(rc == 0 || rc == CONSTRAIN_E_SPLIT || rc == -ERR_LIMIT);
	splits += rc != 0;
	if (rc == CONSTRAIN_E_SPLIT)
		assert_true(need > c.size / TRI_BYTES_PER_POINT);
}

static bool is_piece(const int32_t p[3], const int32_t q[3])
{
	for (unsigned i = 0; i < npiece; i++)
		if ((!memcmp(piece[i].a, p, sizeof(piece[i].a)) && !memcmp(piece[i].b, q, sizeof(piece[i].b))) ||
		    (!memcmp(piece[i].a, q, sizeof(piece[i].a)) && !memcmp(piece[i].b, p, sizeof(piece[i].b))))
			return true;
	return false;
}

/* A side is marked if and only if it is a piece. */
static void check_edges(const struct mesh_domain *d, uint32_t i, int32_t at[3][3])
{
	assert_true(!d->nedges || d->nedges == d->ntriangle);
	for (unsigned k = 0; k < 3; k++) {
		bool is = is_piece(at[(k + 1) % 3], at[(k + 2) % 3]);

		if (is != (d->nedges && d->edges[i] >> k & 1))
			fail_msg("case %llu: a side is %s", (unsigned long long)cases,
				 is ? "a piece, and not marked" : "marked, and no piece");
		marked += is;
	}
}

static void take(const struct mesh_domain *d, bool verify)
{
	for (uint32_t i = 0; i < d->ntriangle; i++) {
		int32_t at[3][3];

		parts_corners(d, i, at);
		parts_add(&parts, (const int32_t(*)[3])at);
		if (verify)
			check_edges(d, i, at);
	}
}

static void check_totals(const struct pipe_totals *t)
{
	struct digest vertices = {0, 0};

	assert_int_equal(t->triangles, whole.n);
	for (unsigned i = 0; i < set.n; i++)
		digest_add_vertex(&vertices, set.pos[i].x, set.pos[i].y, set.pos[i].z);
	if (area.any)
		return;
	assert_int_equal(t->vertices, set.n);
	assert_true(digest_equal(t->vertex_digest, vertices));
}

/* Emits all domains of a partition; `sums`: only their totals. Returns whether they are the whole. */
static bool partition(const struct cut_source *src, const struct cut_source *again, const struct cut_region *leaf, unsigned n,
		      bool verify, bool sums)
{
	const struct lattice lattice = {.scale_xy = {1, 0}, .scale_z = {1, 0}};
	struct pipe_emitter *e;
	struct pipe_totals totals;
	struct err err = ERR_INIT;
	bool same;
	int rc = 0;

	assert_int_equal(pipe_emitter_new(&lattice, 1 << 16, -1, &e, &err), 0);
	pipe_emitter_sums(e, sums && !area.any);
	if (area.any)
		pipe_emitter_part(e);
	parts.n = 0;
	for (unsigned i = 0; i < n; i++) {
		struct mesh_domain d, o;

		domain_make(src, &leaf[i], verify, arena, &d);
		take(&d, verify);
		if (verify) {
			domain_make(again, &leaf[i], verify, other, &o);
			made_check_same(&d, &o);
		}
		rc = rc ? rc : pipe_emit(e, &d, &leaf[i], NULL, &err);
	}
	parts_sort(&parts);
	same = parts_same(&parts, &whole);
	if (verify && same) {
		rc = rc ? rc : pipe_emitter_finish(e, &totals, &err);
		if (rc)
			fail_msg("case %llu: %s", (unsigned long long)cases, err.message);
		check_totals(&totals);
	}
	pipe_emitter_free(e);
	return same;
}

static bool one_case(uint64_t seed, bool verify)
{
	struct cut_region leaf[MAX_LEAVES];
	struct cut_source src, again;
	struct tiling t, u;
	unsigned n;

	sets_make(&seed, &set, &view);
	cases++;
	if (set.n < 3 || !make_whole(&seed))
		return true;
	make_area(&seed);
	lines.state = area.any ? state : NULL;
	outs += all.n - whole.n;
	sets_tiling(&seed, &set, &t);
	sets_tiling(&seed, &set, &u);
	tiling_source(&t, &src);
	tiling_source(&u, &again);
	n = parts_make(&seed, &src, MAX_LEAVES, leaf);
	if (verify)
		domain_in_less(&seed, &src, &leaf[below(&seed, n)]);
	return partition(&src, &again, leaf, n, verify, below(&seed, 2));
}

static uint64_t run(uint64_t n, bool verify)
{
	uint64_t wrong = 0;

	cases = domains = 0;
	for (uint64_t i = 0; i < n; i++) {
		if (one_case((repeat_first() + i) * UINT64_C(0x2545f4914f6cdd1d), verify))
			continue;
		wrong++;
		if (verify)
			fail_msg("case %llu: the domains are not the whole mesh", (unsigned long long)(repeat_first() + i));
	}
	return wrong;
}

static void domains_are_the_whole(void **unused)
{
	uint64_t n = repeat_cases(6000);

	run(n, true);
	print_message(
		"%llu cases, %llu domains, %llu of them with crossed triangles (%llu), %llu turns, %llu pieces without an end, "
		"%llu positions beyond %llu of P_B; %llu did not fit; %llu triangles are out (%llu boxes), %llu were asked\n",
		(unsigned long long)cases, (unsigned long long)domains, (unsigned long long)constrained,
		(unsigned long long)crossed, (unsigned long long)turns, (unsigned long long)gone, (unsigned long long)added,
		(unsigned long long)loaded, (unsigned long long)splits, (unsigned long long)outs, (unsigned long long)boxes,
		(unsigned long long)asked);
	assert_true(n < 1000 ||
		    (constrained > domains / 20 && added > 0 && gone > 0 && splits > 0 && outs > 0 && boxes > 0 && marked > 0));
}

/* The control: P_B with the ends of pieces is too little. */
static void verification_is_needed(void **unused)
{
	uint64_t wrong = run(1500, false);

	print_message("%llu of 1500 sets are wrong without it\n", (unsigned long long)wrong);
	assert_true(wrong > 20);
}

/* ---- a long piece ---- */

enum { STRIP = 4000, WIDE = 1000000 };

static bool point_less(const void *ctx, const struct point *a, const struct point *b)
{
	(void)ctx;
	return point_compare(a, b) < 0;
}

static void name(void *ctx, const int32_t a[2], const int32_t b[2], struct err *err)
{
	assert_true(a[0] == -5 && a[1] == 0 && b[0] == WIDE + 5 && b[1] == 0);
	err_add_file(err, "roads.shp");
}

/* The region around the middle of a strip of points, and a piece along all of it. */
static int strip_run(size_t size, unsigned halvings, struct constrain *c, struct err *err)
{
	static struct point strip[STRIP];
	struct tiling t = {.pts = {strip}, .n = {STRIP}, .segments = 1, .cell_records = 64};
	const int32_t box[4] = {0, -100, WIDE, 100};
	struct cut_region region, half[2];
	struct cut_source src;
	uint64_t seed = 3, need = 0;
	static struct mesh_vertex out[STRIP];
	struct cut_load load = {.out = out, .cap = STRIP, .scratch = made_scratch(), .scratch_size = made_scratch_size()};
	struct tri *tri;

	for (unsigned i = 0; i < STRIP; i++) {
		int32_t y = 1 + (int32_t)below(&seed, 99);

		strip[i] = (struct point){.x = (int32_t)below(&seed, WIDE), .y = below(&seed, 2) ? y : -y, .cls = 1, .ret = 0x11};
	}
	strip[0] = (struct point){.x = -5, .cls = 1, .ret = 0x11};
	strip[1] = (struct point){.x = WIDE + 5, .cls = 1, .ret = 0x11};
	cut_order_sort(strip, STRIP, point_less, NULL);
	piece[0] = (struct lineset_piece){.a = {-5, 0}, .b = {WIDE + 5, 0}};
	npiece = 1;
	view = VIEW_INIT;
	tiling_source(&t, &src);
	cut_region_root(box, &region);
	for (unsigned i = 0; i < halvings && cut_region_split(&region, half); i++)
		region = half[i % 2 ? cut_region_holds(&half[1], WIDE / 2, 1) : cut_region_holds(&half[1], WIDE / 2 + 1, 1)];
	assert_int_equal(cut_load_from(&src, &view, &region, &load, &need, err), 0);
	tri = tri_init(arena, load.n);
	memcpy(tri_input(tri), out, load.n * sizeof(*out));
	assert_int_equal(tri_run(tri, load.n), 0);
	*c = (struct constrain){.src = &src,
				.view = &view,
				.region = &region,
				.lines = &(const struct constrain_lines){.find = find, .name = name},
				.arena = arena,
				.size = size,
				.used = tri_bytes(load.n),
				.tri = tri};
	return constrain_run(c, &need, err);
}

static void a_long_piece_is_named(void **unused)
{
	struct constrain c;
	struct err err = ERR_INIT;
	size_t little = constrain_work_bytes(0) + (32 << 10);

	assert_int_equal(strip_run(4 * MADE_BYTES, 0, &c, &err), 0);
	assert_true(c.crossed > 1000);
	assert_int_equal(strip_run(little, 10, &c, &err), CONSTRAIN_E_SPLIT);
	assert_int_equal(strip_run(little, 14, &c, &err), -ERR_LIMIT);
	print_message("%s; %s\n", err.message, err.hint);
	assert_non_null(strstr(err.message, "from (-5, 0) to (1000005, 0), of length 1.00001e+06,"));
	assert_non_null(strstr(err.hint, "--densify"));
	assert_string_equal(err.file, "roads.shp");
	assert_true(err.need > 0);
}

static int set_up(void **unused)
{
	arena = aligned_alloc(64, 4 * MADE_BYTES);
	other = aligned_alloc(64, MADE_BYTES);
	return arena && other ? 0 : -1;
}

static int tear_down(void **unused)
{
	free(arena);
	free(other);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(domains_are_the_whole),
		cmocka_unit_test(verification_is_needed),
		cmocka_unit_test(a_long_piece_is_named),
	};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
