/*
 * The kernel against CGAL, triangle by triangle: the sums over all triangles and their numbers must agree. One program, since
 * CGAL's headers take most of the time that it takes to compile.
 *
 *   test-tri-cgal KIND N [SEED]                  Delaunay_triangulation_2 (the same tie order); the result must pass check.h, too
 *   test-tri-cgal pieces KIND N [SEED]           Constrained_Delaunay_triangulation_2 (the same tie order); check.h, too
 *   test-tri-cgal weights KIND N RADIUS [SEED]   Regular_triangulation_2: its perturbation is the same
 *   test-tri-cgal weights tiny SETS 0 [SEED]     small sets with many ties
 *
 * Pieces are offered between vertices that are near in the order of the input, and between any; those that cross an earlier one
 * or a vertex are refused, and CGAL gets the others. With weights the numbers of hidden positions must agree, too. One position
 * in four has a weight.
 */
#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Regular_triangulation_2.h>

#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <utility>
#include <vector>

extern "C" {
#include "tri_piece.h"
#include "tri_regular.h"
}
#include "check.h"
#include "inputs.h"

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Dt = CGAL::Delaunay_triangulation_2<Kernel>;
using Cdt = CGAL::Constrained_Delaunay_triangulation_2<Kernel, CGAL::Default,
						       CGAL::No_constraint_intersection_requiring_constructions_tag>;
using Regular = CGAL::Regular_triangulation_2<Kernel>;

using Pieces = std::vector<std::pair<uint32_t, uint32_t>>;

template <class Triangulation> static check_sum sum_of(const Triangulation &dt)
{
	check_sum sum = {};

	for (auto f = dt.finite_faces_begin(); f != dt.finite_faces_end(); ++f) {
		int32_t p[3][2];

		for (int i = 0; i < 3; i++) {
			p[i][0] = int32_t(f->vertex(i)->point().x());
			p[i][1] = int32_t(f->vertex(i)->point().y());
		}
		check_sum_add(&sum, p[0], p[1], p[2]);
	}
	return sum;
}

static bool same(const check_sum &a, const check_sum &b)
{
	return a.n == b.n && a.lo == b.lo && a.hi == b.hi;
}

static int usage()
{
	fprintf(stderr,
		"usage: test-tri-cgal [pieces] KIND N [SEED]\n       test-tri-cgal weights KIND N RADIUS [SEED]\n       test-tri-cgal weights tiny SETS 0 [SEED]\n");
	return 2;
}

static check_sum cgal_sum(const mesh_vertex *v, uint32_t n)
{
	std::vector<Kernel::Point_2> points;
	Dt dt;

	points.reserve(n);
	for (uint32_t i = 0; i < n; i++)
		points.emplace_back(v[i].x, v[i].y);
	dt.insert(points.begin(), points.end());
	return sum_of(dt);
}

static int plain(int argc, char **argv)
{
	uint32_t n = argc > 2 ? uint32_t(strtoul(argv[2], nullptr, 10)) : 0, have = 0;
	mesh_vertex *v = n ? input_make(argv[1], n, argc > 3 ? strtoull(argv[3], nullptr, 10) : 1, &have) : nullptr;

	if (!v || have < 3) {
		free(v);
		return usage();
	}

	struct tri_result result;
	void *arena;
	int status = check_run(v, have, &arena, &result);
	const char *wrong = status ? "flat" : check_result(&result, v, have);
	check_sum ours = check_sum_of(&result), theirs = cgal_sum(v, have);
	bool equal = same(ours, theirs);

	printf("%s %" PRIu32 ": %" PRIu64 " triangles, sum %016" PRIx64 "%016" PRIx64 "%s\n", argv[1], have, ours.n, ours.hi,
	       ours.lo, equal ? "" : "; CGAL's differ");
	if (wrong)
		printf("%s: %s\n", argv[1], wrong);
	free(arena);
	free(v);
	return equal && !wrong ? 0 : 1;
}

static check_sum cgal_sum(const mesh_vertex *v, const struct tri_result &r, const Pieces &pieces)
{
	std::vector<Cdt::Vertex_handle> at(r.nvertex);
	Cdt::Face_handle near;
	Cdt cdt;

	/* In the order of insertion, so that each is near the one before. */
	for (uint32_t k = 0; k < r.nvertex; k++) {
		uint32_t i = r.id[k];

		at[i] = cdt.insert(Kernel::Point_2(v[i].x, v[i].y), near);
		near = at[i]->face();
	}
	for (auto &piece : pieces)
		cdt.insert_constraint(at[piece.first], at[piece.second]);
	return sum_of(cdt);
}

static Pieces insert_random(tri_pieces *p, uint32_t n, uint64_t seed)
{
	uint64_t state = seed * 2 + 1;
	Pieces pieces;

	for (uint32_t i = 0; i < n; i++) {
		uint32_t a = uint32_t(input_random(&state) >> 32) % n, far = i % 64 ? 30 : i % 1024 ? 1000 : n, at;
		uint32_t b = uint32_t((a + input_random(&state) % far) % n);

		if (tri_piece_insert(p, a, b, &at) == 0)
			pieces.emplace_back(a, b);
	}
	return pieces;
}

static int pieces(int argc, char **argv)
{
	uint32_t n = argc > 2 ? uint32_t(strtoul(argv[2], nullptr, 10)) : 0, have = 0;
	uint64_t seed = argc > 3 ? strtoull(argv[3], nullptr, 10) : 1;
	mesh_vertex *v = n ? input_make(argv[1], n, seed, &have) : nullptr;
	tri *t = v && have > 2 ? check_tri(v, have) : nullptr;

	if (!t) {
		free(v);
		return usage();
	}

	tri_pieces *p = check_pieces(t, 2 * have);
	Pieces inserted = insert_random(p, have, seed);
	std::vector<uint32_t> ends;
	struct tri_result result;

	for (auto &piece : inserted) {
		ends.push_back(piece.first);
		ends.push_back(piece.second);
	}
	tri_result(t, &result);
	const char *wrong = check_constrained(&result, v, have, reinterpret_cast<const uint32_t(*)[2]>(ends.data()),
					      uint32_t(inserted.size()));
	check_sum ours = check_sum_of(&result), theirs = cgal_sum(v, result, inserted);
	bool equal = same(ours, theirs);

	printf("%s %" PRIu32 ": %zu pieces, %" PRIu64 " triangles, sum %016" PRIx64 "%016" PRIx64 "%s\n", argv[1], have,
	       inserted.size(), ours.n, ours.hi, ours.lo, equal ? "" : "; CGAL's differ");
	if (wrong)
		printf("%s: %s\n", argv[1], wrong);
	free(p);
	free(t);
	free(v);
	return equal && !wrong && inserted.size() > have / 100 ? 0 : 1;
}

struct found {
	check_sum sum;
	uint32_t visible;
};

static bool same(const found &a, const found &b)
{
	return a.visible == b.visible && same(a.sum, b.sum);
}

static found of_cgal(const std::vector<mesh_vertex> &v, const std::vector<uint8_t> &kind, const int64_t *weight)
{
	std::vector<Regular::Weighted_point> points;
	found f = {};
	Regular rt;

	for (size_t i = 0; i < v.size(); i++)
		points.emplace_back(Kernel::Point_2(v[i].x, v[i].y), double(weight[kind[i]]));
	rt.insert(points.begin(), points.end());
	if (rt.dimension() < 2)
		return f;
	f.visible = uint32_t(rt.number_of_vertices());
	f.sum = sum_of(rt);
	return f;
}

static found of_kernel(const std::vector<mesh_vertex> &v, const std::vector<uint8_t> &kind, const int64_t *weight)
{
	size_t bytes = (tri_bytes(uint32_t(v.size())) + 63) / 64 * 64;
	void *arena = aligned_alloc(64, bytes);
	struct tri_regular r = {};
	struct tri_result t;
	found f = {};
	std::vector<bool> seen(v.size());

	r.tri = tri_init(arena, uint32_t(v.size()));
	r.weight = weight;
	memcpy(tri_input(r.tri), v.data(), v.size() * sizeof v[0]);
	tri_regular_run(&r, uint32_t(v.size()), kind.data());
	tri_result(r.tri, &t);
	for (uint32_t i = 0; i < t.ntriangle; i++) {
		const uint32_t *c = t.triangle[i].corner;

		if (c[0] == TRI_GHOST || c[1] == TRI_GHOST || c[2] == TRI_GHOST)
			continue;
		check_sum_add(&f.sum, t.xy[c[0]], t.xy[c[1]], t.xy[c[2]]);
		for (int k = 0; k < 3; k++) {
			f.visible += !seen[c[k]];
			seen[c[k]] = true;
		}
	}
	free(arena);
	return f;
}

static int compare(const std::vector<mesh_vertex> &v, const std::vector<uint8_t> &kind, const int64_t *weight, uint64_t *hidden)
{
	found ours = of_kernel(v, kind, weight), theirs = of_cgal(v, kind, weight);

	*hidden += ours.sum.n ? v.size() - ours.visible : 0;
	if (same(ours, theirs))
		return 0;
	printf("%zu positions: %" PRIu64 " triangles of %" PRIu32 "; CGAL: %" PRIu64 " of %" PRIu32 "\n", v.size(), ours.sum.n,
	       ours.visible, theirs.sum.n, theirs.visible);
	for (size_t i = 0; i < v.size() && v.size() < 100; i++)
		printf(" (%d,%d:%" PRId64 ")", v[i].x, v[i].y, weight[kind[i]]);
	return 1;
}

static int tiny(uint64_t sets, uint64_t seed)
{
	uint64_t s = seed * 2 + 1, hidden = 0;

	for (uint64_t i = 0; i < sets; i++) {
		uint32_t range = 2 + uint32_t(input_random(&s) >> 33) % 9, n = 3 + uint32_t(input_random(&s) >> 33) % 28;
		uint32_t most = 1 + uint32_t(input_random(&s) >> 33) % 6;
		std::vector<mesh_vertex> v(n);
		std::vector<uint8_t> kind;
		int64_t weight[TRI_WEIGHTS] = {};

		for (int k = 1; k < 8; k++) {
			int64_t radius = int64_t(input_random(&s) >> 33) % (most + 1);

			weight[k] = radius * radius;
		}
		for (uint32_t k = 0; k < n; k++)
			v[k] = {int32_t(input_random(&s) >> 40) % int32_t(range),
				int32_t(input_random(&s) >> 40) % int32_t(range), 0};
		v.resize(input_unique(v.data(), n));
		for (uint32_t k = 0; k < v.size(); k++)
			kind.push_back(uint8_t(input_random(&s) >> 61));
		if (compare(v, kind, weight, &hidden))
			return 1;
	}
	printf("%" PRIu64 " sets as CGAL's, %" PRIu64 " positions hidden\n", sets, hidden);
	return 0;
}

static int weights(int argc, char **argv)
{
	uint32_t n = argc > 3 ? uint32_t(strtoul(argv[2], nullptr, 10)) : 0, have = 0;
	uint64_t seed = argc > 4 ? strtoull(argv[4], nullptr, 10) : 1, s = seed, hidden = 0;
	int64_t radius = argc > 3 ? strtoll(argv[3], nullptr, 10) : 0;
	int64_t weight[TRI_WEIGHTS] = {0, radius * radius, radius * radius / 9};

	if (n && !strcmp(argv[1], "tiny"))
		return tiny(n, seed);
	mesh_vertex *made = n ? input_make(argv[1], n, seed, &have) : nullptr;
	if (!made || have < 3) {
		free(made);
		return usage();
	}
	std::vector<mesh_vertex> v(made, made + have);
	std::vector<uint8_t> kind(have);
	int failed;

	free(made);
	for (auto &k : kind)
		k = input_random(&s) >> 62 ? 0 : uint8_t(1 + (input_random(&s) >> 63));
	failed = compare(v, kind, weight, &hidden);
	printf("%s %" PRIu32 ": %" PRIu64 " hidden\n", argv[1], have, hidden);
	return failed;
}

int main(int argc, char **argv)
{
	if (argc > 1 && !strcmp(argv[1], "pieces"))
		return pieces(argc - 1, argv + 1);
	if (argc > 1 && !strcmp(argv[1], "weights"))
		return weights(argc - 1, argv + 1);
	return plain(argc, argv);
}
