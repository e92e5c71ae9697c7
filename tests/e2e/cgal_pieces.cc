// An oracle that acut did not write: CGAL's constrained Delaunay triangulation of positions and pieces, and the digest of its
// triangles as stream.md defines it, written a second time. Standard input has a row each:
//   v X Y          a position
//   p I J          a piece between two positions, by their numbers from 0
//   in X Y X Y ... a ring: only triangles whose centroid is in one of these count, if there are any
//   out X Y X Y .. a ring: triangles whose centroid is in one of these do not count
//   metric P Q K   positions are triangulated as P x + Q y, K (P y - Q x)
// Output: "TRIANGLES DIGEST".
#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <iostream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#define XXH_INLINE_ALL
#include <xxhash.h>

typedef CGAL::Exact_predicates_inexact_constructions_kernel K;
typedef CGAL::Constrained_Delaunay_triangulation_2<K, CGAL::Default, CGAL::No_constraint_intersection_requiring_constructions_tag> Cdt;
typedef std::pair<int64_t, int64_t> Position;
typedef std::vector<Position> Ring;

// Mapped numbers stay below 2^53.
struct Metric {
	int64_t p = 1, q = 0, k = 1;

	Position map(int64_t x, int64_t y) const { return Position(p * x + q * y, k * (p * y - q * x)); }
	Position back(int64_t u, int64_t v) const
	{
		__int128 det = k * (p * p + q * q), x = (__int128)k * p * u - (__int128)q * v, y = (__int128)k * q * u + (__int128)p * v;

		if (x % det || y % det)
			abort();
		return Position((int64_t)(x / det), (int64_t)(y / det));
	}
};

// Even-odd, of a position times three; no side goes through it.
static bool is_in(const Ring &r, int64_t x, int64_t y)
{
	bool in = false;

	for (size_t i = 0; i < r.size(); i++) {
		int64_t ax = 3 * r[i].first, ay = 3 * r[i].second;
		int64_t bx = 3 * r[(i + 1) % r.size()].first, by = 3 * r[(i + 1) % r.size()].second;

		if ((ay > y) == (by > y))
			continue;
		__int128 turn = (__int128)(bx - ax) * (y - ay) - (__int128)(by - ay) * (x - ax);
		in ^= by > ay ? turn > 0 : turn < 0;
	}
	return in;
}

static bool in_any(const std::vector<Ring> &rings, int64_t x, int64_t y)
{
	return std::any_of(rings.begin(), rings.end(), [&](const Ring &r) { return is_in(r, x, y); });
}

int main()
{
	std::vector<Position> at;
	std::vector<std::pair<size_t, size_t>> pieces;
	std::vector<Ring> in, out;
	std::string row, word;
	Metric metric;

	while (std::getline(std::cin, row)) {
		std::istringstream words(row);
		int64_t a, b;
		Ring ring;

		words >> word;
		if (word == "metric") {
			words >> metric.p >> metric.q >> metric.k;
			continue;
		}
		while (words >> a >> b)
			ring.emplace_back(a, b);
		if (word == "v")
			at.push_back(ring.at(0));
		else if (word == "p")
			pieces.emplace_back(ring.at(0).first, ring.at(0).second);
		else
			(word == "in" ? in : out).push_back(ring);
	}

	Cdt cdt;
	std::vector<Cdt::Vertex_handle> vertex;
	for (const Position &p : at) {
		Position to = metric.map(p.first, p.second);
		vertex.push_back(cdt.insert(K::Point_2(to.first, to.second)));
	}
	for (const auto &p : pieces)
		cdt.insert_constraint(vertex.at(p.first), vertex.at(p.second));

	uint64_t hi = 0, lo = 0, n = 0;
	for (auto f = cdt.finite_faces_begin(); f != cdt.finite_faces_end(); ++f) {
		std::array<Position, 3> p;
		int64_t x = 0, y = 0;

		for (int i = 0; i < 3; i++) {
			p[i] = metric.back((int64_t)f->vertex(i)->point().x(), (int64_t)f->vertex(i)->point().y());
			x += p[i].first;
			y += p[i].second;
		}
		if ((!in.empty() && !in_any(in, x, y)) || in_any(out, x, y))
			continue;
		std::rotate(p.begin(), std::min_element(p.begin(), p.end()), p.end());
		int64_t six[6] = {p[0].first, p[0].second, p[1].first, p[1].second, p[2].first, p[2].second};
		XXH128_hash_t h = XXH3_128bits(six, sizeof six);
		hi += h.high64;
		lo += h.low64;
		n++;
	}
	printf("%llu %016llx%016llx\n", (unsigned long long)n, (unsigned long long)hi, (unsigned long long)lo);
}
