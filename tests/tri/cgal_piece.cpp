/*
 * Pieces against CGAL's Constrained_Delaunay_triangulation_2 (the same tie order), triangle by triangle. Pieces are
 * offered between vertices that are near in the order of the input, and between any; those that cross an earlier one or
 * a vertex are refused, and CGAL gets the others.
 *
 *   test-tri-cgal-piece KIND N [SEED]
 */
#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <utility>
#include <vector>

extern "C" {
#include "tri_piece.h"
}
#include "check.h"
#include "inputs.h"

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Cdt =
    CGAL::Constrained_Delaunay_triangulation_2<Kernel, CGAL::Default,
                                               CGAL::No_constraint_intersection_requiring_constructions_tag>;

using Pieces = std::vector<std::pair<uint32_t, uint32_t>>;

static check_sum cgal_sum(const mesh_vertex *v, const struct tri_result &r, const Pieces &pieces)
{
	std::vector<Cdt::Vertex_handle> at(r.nvertex);
	Cdt::Face_handle near;
	check_sum sum = {};
	Cdt cdt;

	/* In the order of insertion, so that each is near the one before. */
	for (uint32_t k = 0; k < r.nvertex; k++) {
		uint32_t i = r.id[k];

		at[i] = cdt.insert(Kernel::Point_2(v[i].x, v[i].y), near);
		near = at[i]->face();
	}
	for (auto &piece : pieces)
		cdt.insert_constraint(at[piece.first], at[piece.second]);
	for (auto f = cdt.finite_faces_begin(); f != cdt.finite_faces_end(); ++f) {
		int32_t p[3][2];

		for (int i = 0; i < 3; i++) {
			p[i][0] = int32_t(f->vertex(i)->point().x());
			p[i][1] = int32_t(f->vertex(i)->point().y());
		}
		check_sum_add(&sum, p[0], p[1], p[2]);
	}
	return sum;
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

int main(int argc, char **argv)
{
	uint32_t n = argc > 2 ? uint32_t(strtoul(argv[2], nullptr, 10)) : 0, have = 0;
	uint64_t seed = argc > 3 ? strtoull(argv[3], nullptr, 10) : 1;
	mesh_vertex *v = n ? input_make(argv[1], n, seed, &have) : nullptr;
	tri *t = v && have > 2 ? check_tri(v, have) : nullptr;

	if (!t) {
		fprintf(stderr, "usage: test-tri-cgal-piece KIND N [SEED]\n");
		free(v);
		return 2;
	}

	tri_pieces *p = check_pieces(t, 2 * have);
	Pieces pieces = insert_random(p, have, seed);
	std::vector<uint32_t> ends;
	struct tri_result result;

	for (auto &piece : pieces) {
		ends.push_back(piece.first);
		ends.push_back(piece.second);
	}
	tri_result(t, &result);
	const char *wrong = check_constrained(&result, v, have, reinterpret_cast<const uint32_t(*)[2]>(ends.data()),
	                                      uint32_t(pieces.size()));
	check_sum ours = check_sum_of(&result), theirs = cgal_sum(v, result, pieces);
	bool same = ours.n == theirs.n && ours.lo == theirs.lo && ours.hi == theirs.hi;

	printf("%s %" PRIu32 ": %zu pieces, %" PRIu64 " triangles, sum %016" PRIx64 "%016" PRIx64 "%s\n", argv[1], have,
	       pieces.size(), ours.n, ours.hi, ours.lo, same ? "" : "; CGAL's differ");
	if (wrong)
		printf("%s: %s\n", argv[1], wrong);
	free(p);
	free(t);
	free(v);
	return same && !wrong && pieces.size() > have / 100 ? 0 : 1;
}
