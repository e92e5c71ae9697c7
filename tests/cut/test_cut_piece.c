/*
 * The rule for domains with pieces (docs/design/constraints.md, "Domains with pieces") on thousands of random sets and
 * partitions, with the kernel's pieces and the regions of this room: the triangles of all domains are those of the whole
 * constrained mesh, each once. Without the verification of flagged triangles they are not, which is tested as well.
 *
 * Cells and their boxes have no part here: a domain sees all positions, and takes those that the rule lets it read.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "brute.h"
#include "check.h"
#include "cut.h"
#include "geom.h"
#include "parts.h"
#include "random.h"
#include "repeat.h"

enum { MAX_N = 60, MAX_PIECES = 60, MAX_LEAVES = 16, MAX_TRIANGLES = 4 * MAX_N };

struct mesh {
	int32_t triangle[MAX_TRIANGLES][6]; /* smallest corner first */
	unsigned n;
};

static struct mesh_vertex pos[MAX_N];
static unsigned npos, npiece;
static unsigned piece[MAX_PIECES][2]; /* numbers of positions */
static struct mesh whole;
static uint64_t rounds, domains, constrained, new_triangles, loaded, halo;

static int compare(const void *a, const void *b)
{
	return memcmp(a, b, 6 * sizeof(int32_t));
}

static void mesh_add(struct mesh *m, const int32_t *a, const int32_t *b, const int32_t *c)
{
	const int32_t *v[3] = {a, b, c};
	unsigned first = 0;

	for (unsigned i = 1; i < 3; i++)
		if (geom_less(v[i], v[first]))
			first = i;
	assert_true(m->n < MAX_TRIANGLES);
	for (unsigned i = 0; i < 3; i++)
		memcpy(&m->triangle[m->n][2 * i], v[(first + i) % 3], 2 * sizeof(int32_t));
	m->n++;
}

static bool is_real(const struct tri_triangle *t)
{
	return t->corner[0] != TRI_GHOST && t->corner[1] != TRI_GHOST && t->corner[2] != TRI_GHOST;
}

static void make_positions(uint64_t *seed)
{
	static const int32_t ranges[] = {4, 7, 16, 400, 100000};
	int32_t range = ranges[random_below(seed, 5)], tall = random_below(seed, 4) ? 1 : 9;
	unsigned want = 4 + (unsigned)random_below(seed, MAX_N - 3);

	npos = 0;
	for (unsigned i = 0; i < want; i++) {
		struct mesh_vertex v = {(int32_t)random_below(seed, (uint64_t)range),
					(int32_t)random_below(seed, (uint64_t)range) * tall, 0};
		unsigned k = 0;

		while (k < npos && (pos[k].x != v.x || pos[k].y != v.y))
			k++;
		if (k == npos)
			pos[npos++] = v;
	}
}

/* Offers pieces to the mesh of all positions, and keeps those that it takes. False: the positions are flat. */
static bool make_whole(uint64_t *seed)
{
	struct tri *t = check_tri(pos, npos);
	unsigned tries = (unsigned)random_below(seed, 2 * MAX_PIECES);
	struct tri_pieces *p;
	struct tri_result r;

	npiece = whole.n = 0;
	if (!t)
		return false;
	p = check_pieces(t, 2 * npos);
	for (unsigned i = 0; i < tries && npiece < MAX_PIECES; i++) {
		unsigned a = (unsigned)random_below(seed, npos), b = (unsigned)random_below(seed, npos);
		uint32_t at;

		if (tri_piece_insert(p, a, b, &at))
			continue;
		piece[npiece][0] = a;
		piece[npiece++][1] = b;
	}
	tri_result(t, &r);
	for (uint32_t i = 0; i < r.ntriangle; i++)
		if (is_real(&r.triangle[i]))
			mesh_add(&whole, r.xy[r.triangle[i].corner[0]], r.xy[r.triangle[i].corner[1]],
				 r.xy[r.triangle[i].corner[2]]);
	qsort(whole.triangle, whole.n, sizeof(*whole.triangle), compare);
	free(p);
	free(t);
	return true;
}

static unsigned make_leaves(uint64_t *seed, struct cut_region *ret)
{
	int32_t box[4] = {INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN};
	unsigned want = 1 + (unsigned)random_below(seed, MAX_LEAVES);

	for (unsigned i = 0; i < npos; i++) {
		box[0] = pos[i].x < box[0] ? pos[i].x : box[0];
		box[1] = pos[i].y < box[1] ? pos[i].y : box[1];
		box[2] = pos[i].x > box[2] ? pos[i].x : box[2];
		box[3] = pos[i].y > box[3] ? pos[i].y : box[3];
	}
	cut_region_root(box, &ret[0]);
	return parts_halve(seed, want, 100, ret);
}

/* ---- one domain ---- */

struct domain {
	const struct cut_region *region;
	bool verify;
	bool has[MAX_N], has_piece[MAX_PIECES];
	struct mesh_vertex v[MAX_N]; /* what it has */
	unsigned n, number[MAX_N];   /* of each position: its number in v */
	struct tri *t;
	struct tri_pieces *p;
	struct tri_result r;
	struct tri_triangle own[MAX_TRIANGLES]; /* the owned triangles that pieces cross, before pieces were inserted */
	unsigned nown;
};

/* Loads the pieces whose box meets that of a triangle. True: there was a new one. */
static bool load_pieces(struct domain *d, const struct tri_triangle *t)
{
	bool new = false;

	for (unsigned i = 0; i < npiece; i++) {
		const struct mesh_vertex *a = &pos[piece[i][0]], *b = &pos[piece[i][1]];
		const int32_t ends[2][2] = {{a->x, a->y}, {b->x, b->y}};
		bool apart = false;

		for (unsigned k = 0; k < 2; k++) {
			int32_t c0 = d->r.xy[t->corner[0]][k], c1 = d->r.xy[t->corner[1]][k], c2 = d->r.xy[t->corner[2]][k];

			apart |= ends[0][k] < c0 && ends[0][k] < c1 && ends[0][k] < c2 && ends[1][k] < c0 && ends[1][k] < c1 &&
				 ends[1][k] < c2;
			apart |= ends[0][k] > c0 && ends[0][k] > c1 && ends[0][k] > c2 && ends[1][k] > c0 && ends[1][k] > c1 &&
				 ends[1][k] > c2;
		}
		if (apart || d->has_piece[i])
			continue;
		new = d->has_piece[i] = true;
		d->has[piece[i][0]] = d->has[piece[i][1]] = true;
	}
	return new;
}

/* Takes the positions that it does not have in the closed disc of a triangle. True: there was one. */
static bool load_disc(struct domain *d, const struct tri_triangle *t)
{
	const int32_t(*xy)[2] = d->r.xy;
	bool new = false;

	for (unsigned i = 0; i < npos; i++) {
		const int32_t at[2] = {pos[i].x, pos[i].y};

		if (d->has[i] || geom_incircle_plain(xy[t->corner[0]], xy[t->corner[1]], xy[t->corner[2]], at) < 0)
			continue;
		new = d->has[i] = true;
	}
	return new;
}

static bool owns(const struct domain *d, const struct tri_triangle *t)
{
	return is_real(t) && cut_region_owns(d->region, d->r.xy[t->corner[0]], d->r.xy[t->corner[1]], d->r.xy[t->corner[2]]);
}

/* The Delaunay triangulation of what it has. False: it is flat. */
static bool triangulate(struct domain *d)
{
	d->n = 0;
	for (unsigned i = 0; i < npos; i++)
		if (d->has[i]) {
			d->number[i] = d->n;
			d->v[d->n++] = pos[i];
		}
	d->t = check_tri(d->v, d->n);
	if (!d->t)
		return false;
	d->p = check_pieces(d->t, 2 * d->n);
	tri_result(d->t, &d->r);
	rounds++;
	return true;
}

/* Flags the owned triangles that its pieces cross. */
static void flag_crossed(struct domain *d)
{
	d->nown = 0;
	for (unsigned i = 0; i < npiece; i++) {
		uint32_t n, at;

		if (!d->has_piece[i])
			continue;
		assert_int_equal(tri_piece_find(d->p, d->number[piece[i][0]], d->number[piece[i][1]], &n, &at), 0);
		for (uint32_t k = 0; k < n; k++) {
			uint32_t found = tri_piece_found(d->p, k);

			if (tri_piece_flagged(d->p, found) || !owns(d, &d->r.triangle[found]))
				continue;
			tri_piece_flag(d->p, found);
			d->own[d->nown++] = d->r.triangle[found];
		}
	}
}

/* Whether the centroid of t is in the triangle o, or on a side of it that is directed upwards. */
static bool centroid_in(const struct domain *d, const struct tri_triangle *t, const struct tri_triangle *o)
{
	int64_t sum[2] = {0, 0};

	for (unsigned i = 0; i < 3; i++)
		for (unsigned k = 0; k < 2; k++)
			sum[k] += d->r.xy[t->corner[i]][k];
	for (unsigned i = 0; i < 3; i++) {
		const int32_t *a = d->r.xy[o->corner[i]], *b = d->r.xy[o->corner[(i + 1) % 3]];
		geom_i128 side = (geom_i128)((int64_t)b[0] - a[0]) * (sum[1] - 3 * (int64_t)a[1]) -
				 (geom_i128)((int64_t)b[1] - a[1]) * (sum[0] - 3 * (int64_t)a[0]);

		if (side < 0 || (side == 0 && !geom_less(a, b)))
			return false;
	}
	return true;
}

static void emit(const struct domain *d, const struct tri_triangle *t, struct mesh *ret)
{
	mesh_add(ret, d->r.xy[t->corner[0]], d->r.xy[t->corner[1]], d->r.xy[t->corner[2]]);
}

/* Inserts the pieces and verifies. True: more was loaded, and it is to be done again. */
static bool insert_and_verify(struct domain *d)
{
	bool new = false;

	for (unsigned i = 0; i < npiece; i++) {
		uint32_t at;

		if (d->has_piece[i])
			assert_int_equal(tri_piece_insert(d->p, d->number[piece[i][0]], d->number[piece[i][1]], &at), 0);
	}
	for (uint32_t i = 0; d->verify && i < d->r.ntriangle; i++)
		if (is_real(&d->r.triangle[i]) && tri_piece_flagged(d->p, i)) {
			new |= load_pieces(d, &d->r.triangle[i]);
			new |= load_disc(d, &d->r.triangle[i]);
		}
	return new;
}

static void emit_new(const struct domain *d, struct mesh *ret)
{
	for (uint32_t i = 0; i < d->r.ntriangle; i++) {
		if (!is_real(&d->r.triangle[i]) || !tri_piece_flagged(d->p, i))
			continue;
		for (unsigned k = 0; k < d->nown; k++)
			if (centroid_in(d, &d->r.triangle[i], &d->own[k])) {
				emit(d, &d->r.triangle[i], ret);
				new_triangles++;
			}
	}
}

/* One turn of the rule. True: again. */
static bool domain_turn(struct domain *d, bool first, struct mesh *ret)
{
	bool new = false;

	for (uint32_t i = 0; first && i < d->r.ntriangle; i++)
		if (owns(d, &d->r.triangle[i]))
			new |= load_pieces(d, &d->r.triangle[i]);
	if (new)
		return true;
	flag_crossed(d);
	for (uint32_t i = 0; i < d->r.ntriangle; i++)
		if (owns(d, &d->r.triangle[i]) && !tri_piece_flagged(d->p, i))
			emit(d, &d->r.triangle[i], ret);
	if (!d->nown)
		return false;
	if (insert_and_verify(d))
		return true;
	emit_new(d, ret);
	return false;
}

static void domain_make(const struct cut_region *region, bool verify, struct mesh *ret)
{
	struct domain d = {.region = region, .verify = verify};
	unsigned before = ret->n;
	bool again = true;
	int64_t box[4];

	cut_region_box(region, box);
	for (unsigned i = 0; i < npos; i++) {
		d.has[i] = brute_meets(pos, npos, i, box);
		halo += d.has[i];
	}
	for (bool first = true; again && triangulate(&d); first = false) {
		ret->n = before;
		again = domain_turn(&d, first, ret);
		free(d.p);
		free(d.t);
	}
	loaded += d.n;
	constrained += d.nown > 0;
	domains++;
}

/* Returns whether the domains of a partition are the whole. */
static bool partition_is_whole(uint64_t *seed, bool verify)
{
	struct cut_region leaf[MAX_LEAVES];
	unsigned n = make_leaves(seed, leaf);
	static struct mesh parts;

	parts.n = 0;
	for (unsigned i = 0; i < n; i++)
		domain_make(&leaf[i], verify, &parts);
	qsort(parts.triangle, parts.n, sizeof(*parts.triangle), compare);
	return parts.n == whole.n && !memcmp(parts.triangle, whole.triangle, whole.n * sizeof(*whole.triangle));
}

static uint64_t run(uint64_t cases, bool verify)
{
	uint64_t wrong = 0;

	for (uint64_t i = 0; i < cases; i++) {
		uint64_t seed = repeat_first() * 1000003 + i;

		make_positions(&seed);
		if (!make_whole(&seed) || partition_is_whole(&seed, verify))
			continue;
		wrong++;
		if (verify)
			fail_msg("case %llu: the domains are not the whole mesh", (unsigned long long)i);
	}
	return wrong;
}

static void domains_are_the_whole(void **unused)
{
	run(repeat_cases(3000), true);
	assert_true(new_triangles > rounds / 100);
	print_message(
		"%llu domains, %llu of them with crossed triangles, %llu turns, %llu new triangles, %llu positions of %llu in P_B\n",
		(unsigned long long)domains, (unsigned long long)constrained, (unsigned long long)rounds,
		(unsigned long long)new_triangles, (unsigned long long)loaded, (unsigned long long)halo);
}

/* The control: P_B with the ends of pieces is too little. */
static void verification_is_needed(void **unused)
{
	uint64_t wrong = run(300, false);

	print_message("%llu of 300 sets are wrong without it\n", (unsigned long long)wrong);
	assert_true(wrong > 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(domains_are_the_whole),
		cmocka_unit_test(verification_is_needed),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
