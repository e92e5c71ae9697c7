// An oracle that acut did not write: CGAL's Delaunay triangulation of a LAS file's records, and the digest of its
// triangles as stream.md defines it, written a second time.
// usage: cgal_digest FILE.las [metric=P,Q,K] [X,Y,X,Y...]... -> "TRIANGLES DIGEST", of all triangles, and on a line for each polygon given by
// its corners (whole numbers, simple, not closed; one or two corners are a point or a segment) of those that meet it, closed.
// The file's offsets must be zero and its x and y scales equal,
// so that raw numbers are absolute lattice numbers. With a metric positions and polygons are mapped to P x + Q y, K (P y - Q x).
#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Polygon_2_algorithms.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <utility>
#include <vector>

#define XXH_INLINE_ALL
#include <xxhash.h>

typedef CGAL::Exact_predicates_inexact_constructions_kernel K;
typedef CGAL::Delaunay_triangulation_2<K> Triangulation;
typedef std::pair<int64_t, int64_t> Position;

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

int main(int argc, char **argv)
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
		std::array<Position, 3> p;
		for (int i = 0; i < 3; i++)
			p[i] = metric.back((int64_t)face->vertex(i)->point().x(), (int64_t)face->vertex(i)->point().y());
		all.add(p);
		for (size_t i = 0; i < polygon.size(); i++)
			if (meets(polygon[i], t.triangle(face)))
				part[i].add(p);
	}
	all.print();
	for (const Sum &sum : part)
		sum.print();
}
