// An oracle that acut did not write: CGAL's triangulations, and the digest of their triangles as stream.md defines it, written a second
// time. One program, since CGAL's headers take most of the time that it takes to compile. Usage:
//
// cgal_digest FILE.las [metric=P,Q,K] [X,Y,X,Y...]... -> "TRIANGLES DIGEST" of the Delaunay triangulation of the file's records, of all
// triangles, and on a line for each polygon given by its corners (whole numbers, simple, not closed; one or two corners are a point or a
// segment) of those that meet it, closed. The file's offsets must be zero and its x and y scales equal, so that raw numbers are absolute
// lattice numbers. With a metric positions and polygons are mapped to P x + Q y, K (P y - Q x).
//
// cgal_digest pieces -> "TRIANGLES DIGEST" of the constrained Delaunay triangulation. Standard input has a row each:
//   v X Y          a position
//   p I J          a piece between two positions, by their numbers from 0
//   in X Y X Y ... a ring: only triangles whose centroid is in one of these count, if there are any
//   out X Y X Y .. a ring: triangles whose centroid is in one of these do not count
//   metric P Q K   positions are triangulated as P x + Q y, K (P y - Q x)
//
// cgal_digest weights -> "VERTICES TRIANGLES DIGEST" of the regular triangulation. Standard input has a row "X Y W" for each position.
#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_2_algorithms.h>
#include <CGAL/Regular_triangulation_2.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <iostream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#define XXH_INLINE_ALL
#include <xxhash.h>

typedef CGAL::Exact_predicates_inexact_constructions_kernel K;
typedef CGAL::Delaunay_triangulation_2<K> Triangulation;
typedef CGAL::Constrained_Delaunay_triangulation_2<K, CGAL::Default, CGAL::No_constraint_intersection_requiring_constructions_tag> Cdt;
typedef CGAL::Regular_triangulation_2<K> Rt;
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

static Metric metric;

static K::Point_2 mapped(int64_t x, int64_t y)
{
	Position at = metric.map(x, y);

	return K::Point_2(at.first, at.second);
}

struct Sum {
	uint64_t hi = 0, lo = 0, n = 0;

	void add(std::array<Position, 3> p)
	{
		std::rotate(p.begin(), std::min_element(p.begin(), p.end()), p.end());
		int64_t six[6] = { p[0].first, p[0].second, p[1].first, p[1].second, p[2].first, p[2].second };
		XXH128_hash_t h = XXH3_128bits(six, sizeof six);
		hi += h.high64;
		lo += h.low64;
		n++;
	}
	void print() const
	{
		printf("%llu %016llx%016llx\n", (unsigned long long)n, (unsigned long long)hi, (unsigned long long)lo);
	}
};

template <class Face> static std::array<Position, 3> corners(Face f)
{
	std::array<Position, 3> p;

	for (int i = 0; i < 3; i++)
		p[i] = metric.back((int64_t)f->vertex(i)->point().x(), (int64_t)f->vertex(i)->point().y());
	return p;
}

typedef std::vector<K::Point_2> Polygon;

static Polygon polygon_of(const char *text)
{
	Polygon p;
	char *end;
	for (;; text = end + 1) {
		long x = strtol(text, &end, 10);
		if (*end != ',')
			exit(2);
		long y = strtol(end + 1, &end, 10);
		p.push_back(mapped(x, y));
		if (*end != ',')
			return p;
	}
}

static bool meets(const Polygon &p, const K::Triangle_2 &t)
{
	if (p.size() == 1)
		return !t.has_on_unbounded_side(p[0]);
	for (size_t i = 0; i < p.size(); i++)
		if (CGAL::do_intersect(t, K::Segment_2(p[i], p[(i + 1) % p.size()])))
			return true;
	return p.size() > 2 && CGAL::bounded_side_2(p.begin(), p.end(), t[0], K()) != CGAL::ON_UNBOUNDED_SIDE;
}

static int digest(int argc, char **argv)
{
	unsigned char head[227];
	FILE *f = argc >= 2 ? fopen(argv[1], "rb") : nullptr;
	double scale[6];
	long long pqk[3];

	if (argc > 2 && sscanf(argv[2], "metric=%lld,%lld,%lld", &pqk[0], &pqk[1], &pqk[2]) == 3) {
		metric = {pqk[0], pqk[1], pqk[2]};
		argv[2] = argv[1];
		argv++;
		argc--;
	}
	if (!f || fread(head, 1, sizeof head, f) != sizeof head || memcmp(head, "LASF", 4))
		return fprintf(stderr, "usage: cgal_digest FILE.las\n"), 2;
	memcpy(scale, head + 131, sizeof scale);
	if (scale[0] != scale[1] || scale[3] != 0 || scale[4] != 0)
		return fprintf(stderr, "cgal_digest: %s: scales differ or offsets are not zero\n", argv[1]), 2;
	uint32_t offset, count;
	uint16_t length;
	memcpy(&offset, head + 96, 4);
	memcpy(&length, head + 105, 2);
	memcpy(&count, head + 107, 4);

	std::vector<K::Point_2> points;
	std::vector<unsigned char> record(length);
	fseek(f, offset, SEEK_SET);
	for (uint32_t i = 0; i < count; i++) {
		int32_t xy[2];
		if (fread(record.data(), 1, length, f) != length)
			return fprintf(stderr, "cgal_digest: %s is short\n", argv[1]), 1;
		memcpy(xy, record.data(), 8);
		points.push_back(mapped(xy[0], xy[1]));
	}
	fclose(f);

	Triangulation t(points.begin(), points.end());
	Sum all;
	std::vector<Polygon> polygon;
	std::vector<Sum> part(argc - 2);
	for (int i = 2; i < argc; i++)
		polygon.push_back(polygon_of(argv[i]));
	for (auto face = t.finite_faces_begin(); face != t.finite_faces_end(); ++face) {
		std::array<Position, 3> p = corners(face);

		all.add(p);
		for (size_t i = 0; i < polygon.size(); i++)
			if (meets(polygon[i], t.triangle(face)))
				part[i].add(p);
	}
	all.print();
	for (const Sum &sum : part)
		sum.print();
	return 0;
}

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

static int pieces()
{
	std::vector<Position> at;
	std::vector<std::pair<size_t, size_t>> pairs;
	std::vector<Ring> in, out;
	std::string row, word;

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
			pairs.emplace_back(ring.at(0).first, ring.at(0).second);
		else
			(word == "in" ? in : out).push_back(ring);
	}

	Cdt cdt;
	std::vector<Cdt::Vertex_handle> vertex;
	for (const Position &p : at)
		vertex.push_back(cdt.insert(mapped(p.first, p.second)));
	for (const auto &p : pairs)
		cdt.insert_constraint(vertex.at(p.first), vertex.at(p.second));

	Sum all;
	for (auto f = cdt.finite_faces_begin(); f != cdt.finite_faces_end(); ++f) {
		std::array<Position, 3> p = corners(f);
		int64_t x = p[0].first + p[1].first + p[2].first, y = p[0].second + p[1].second + p[2].second;

		if ((in.empty() || in_any(in, x, y)) && !in_any(out, x, y))
			all.add(p);
	}
	all.print();
	return 0;
}

static int weights()
{
	std::vector<Rt::Weighted_point> at;
	int64_t x, y, w;

	while (std::cin >> x >> y >> w)
		at.emplace_back(K::Point_2(x, y), w);

	Rt rt(at.begin(), at.end());
	Sum all;
	for (auto f = rt.finite_faces_begin(); f != rt.finite_faces_end(); ++f)
		all.add(corners(f));
	printf("%llu ", (unsigned long long)rt.number_of_vertices());
	all.print();
	return 0;
}

int main(int argc, char **argv)
{
	if (argc == 2 && !strcmp(argv[1], "pieces"))
		return pieces();
	if (argc == 2 && !strcmp(argv[1], "weights"))
		return weights();
	return digest(argc, argv);
}
