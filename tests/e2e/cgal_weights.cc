// An oracle that acut did not write: CGAL's regular triangulation of positions with weights, and the digest of its triangles as
// stream.md defines it, written a second time. Standard input has a row "X Y W" for each position.
// Output: "VERTICES TRIANGLES DIGEST".
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Regular_triangulation_2.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <iostream>
#include <utility>
#include <vector>

#define XXH_INLINE_ALL
#include <xxhash.h>

typedef CGAL::Exact_predicates_inexact_constructions_kernel K;
typedef CGAL::Regular_triangulation_2<K> Rt;
typedef std::pair<int64_t, int64_t> Position;

int main()
{
	std::vector<Rt::Weighted_point> at;
	int64_t x, y, w;

	while (std::cin >> x >> y >> w)
		at.emplace_back(K::Point_2(x, y), w);

	Rt rt(at.begin(), at.end());
	uint64_t hi = 0, lo = 0, n = 0;
	for (auto f = rt.finite_faces_begin(); f != rt.finite_faces_end(); ++f) {
		std::array<Position, 3> p;

		for (int i = 0; i < 3; i++)
			p[i] = Position((int64_t)f->vertex(i)->point().x(), (int64_t)f->vertex(i)->point().y());
		std::rotate(p.begin(), std::min_element(p.begin(), p.end()), p.end());
		int64_t six[6] = {p[0].first, p[0].second, p[1].first, p[1].second, p[2].first, p[2].second};
		XXH128_hash_t h = XXH3_128bits(six, sizeof six);
		hi += h.high64;
		lo += h.low64;
		n++;
	}
	printf("%llu %llu %016llx%016llx\n", (unsigned long long)rt.number_of_vertices(), (unsigned long long)n,
	       (unsigned long long)hi, (unsigned long long)lo);
}
