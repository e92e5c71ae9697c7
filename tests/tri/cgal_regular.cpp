/*
 * The kernel with weights against CGAL's Regular_triangulation_2, triangle by triangle: its perturbation is the same. The numbers
 * of hidden positions must agree, too. One position in `PART` has a weight.
 *
 *   test-tri-cgal-regular KIND N RADIUS [SEED]
 *   test-tri-cgal-regular tiny SETS 0 [SEED]   small sets with many ties
 */
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Regular_triangulation_2.h>

#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

extern "C" {
#include "tri_regular.h"
}

#include "check.h"
#include "inputs.h"

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Regular = CGAL::Regular_triangulation_2<Kernel>;

struct found {
	check_sum sum;
	uint32_t visible;
};

static bool same(const found &a, const found &b)
{
	return a.visible == b.visible && a.sum.n == b.sum.n && a.sum.lo == b.sum.lo && a.sum.hi == b.sum.hi;
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
	for (auto t = rt.finite_faces_begin(); t != rt.finite_faces_end(); ++t) {
		int32_t p[3][2];

		for (int i = 0; i < 3; i++) {
			p[i][0] = int32_t(t->vertex(i)->point().x());
			p[i][1] = int32_t(t->vertex(i)->point().y());
		}
		check_sum_add(&f.sum, p[0], p[1], p[2]);
	}
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

int main(int argc, char **argv)
{
	uint32_t n = argc > 3 ? uint32_t(strtoul(argv[2], nullptr, 10)) : 0, have = 0;
	uint64_t seed = argc > 4 ? strtoull(argv[4], nullptr, 10) : 1, s = seed, hidden = 0;
	int64_t radius = argc > 3 ? strtoll(argv[3], nullptr, 10) : 0;
	int64_t weight[TRI_WEIGHTS] = {0, radius * radius, radius * radius / 9};

	if (n && !strcmp(argv[1], "tiny"))
		return tiny(n, seed);
	mesh_vertex *made = n ? input_make(argv[1], n, seed, &have) : nullptr;
	if (!made || have < 3) {
		fprintf(stderr, "usage: test-tri-cgal-regular KIND N RADIUS [SEED]\n");
		free(made);
		return 2;
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
