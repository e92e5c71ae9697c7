/*
 * The kernel against CGAL's Delaunay_triangulation_2 (the same tie order), triangle by triangle: the sums over all
 * triangles and their numbers must agree, and the result must pass the checks of check.h.
 *
 *   test-tri-cgal KIND N [SEED]
 */
#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "check.h"
#include "inputs.h"

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Dt = CGAL::Delaunay_triangulation_2<Kernel>;

static check_sum cgal_sum(const mesh_vertex *v, uint32_t n)
{
	std::vector<Kernel::Point_2> points;
	check_sum sum = {};
	Dt dt;

	points.reserve(n);
	for (uint32_t i = 0; i < n; i++)
		points.emplace_back(v[i].x, v[i].y);
	dt.insert(points.begin(), points.end());
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

int main(int argc, char **argv)
{
	uint32_t n = argc > 2 ? uint32_t(strtoul(argv[2], nullptr, 10)) : 0, have = 0;
	mesh_vertex *v =
	    n ? input_make(argv[1], n, argc > 3 ? strtoull(argv[3], nullptr, 10) : 1, &have) : nullptr;

	if (!v || have < 3) {
		fprintf(stderr, "usage: test-tri-cgal KIND N [SEED]\n");
		free(v);
		return 2;
	}

	struct tri_result result;
	void *arena;
	int status = check_run(v, have, &arena, &result);
	const char *wrong = status ? "flat" : check_result(&result, v, have);
	check_sum ours = check_sum_of(&result), theirs = cgal_sum(v, have);
	bool same = ours.n == theirs.n && ours.lo == theirs.lo && ours.hi == theirs.hi;

	printf("%s %" PRIu32 ": %" PRIu64 " triangles, sum %016" PRIx64 "%016" PRIx64 "%s\n", argv[1], have,
	       ours.n, ours.hi, ours.lo, same ? "" : "; CGAL's differ");
	if (wrong)
		printf("%s: %s\n", argv[1], wrong);
	free(arena);
	free(v);
	return same && !wrong ? 0 : 1;
}
