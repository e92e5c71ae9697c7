// The peer of the whole way: CGAL's Delaunay triangulation of a LAS file's points, in memory, one thread.
// Timed is the bare triangulation (range insertion with its own spatial sort): reading the file is not.
// usage: bench-whole-cgal FILE.las -> one line: points, vertices, faces, CPU seconds, wall seconds, peak bytes
#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <sys/resource.h>
#include <vector>

typedef CGAL::Exact_predicates_inexact_constructions_kernel K;
typedef CGAL::Delaunay_triangulation_2<K> Triangulation;

static double cpu_seconds()
{
	timespec t;
	clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
	return t.tv_sec + t.tv_nsec * 1e-9;
}

int main(int argc, char **argv)
{
	unsigned char head[375];
	FILE *f = argc == 2 ? fopen(argv[1], "rb") : nullptr;

	if (!f || fread(head, 1, sizeof head, f) != sizeof head || memcmp(head, "LASF", 4)) {
		fprintf(stderr, "usage: bench-whole-cgal FILE.las\n");
		return 2;
	}
	uint32_t offset, legacy;
	uint16_t length;
	uint64_t count;
	memcpy(&offset, head + 96, 4);
	memcpy(&length, head + 105, 2);
	memcpy(&legacy, head + 107, 4);
	memcpy(&count, head + 247, 8);
	if (legacy)
		count = legacy;

	std::vector<K::Point_2> points;
	std::vector<unsigned char> batch(size_t(length) * 65536);
	points.reserve(count);
	fseek(f, offset, SEEK_SET);
	while (points.size() < count) {
		size_t want = count - points.size() < 65536 ? count - points.size() : 65536;
		if (fread(batch.data(), length, want, f) != want) {
			fprintf(stderr, "bench-whole-cgal: %s is short\n", argv[1]);
			return 1;
		}
		for (size_t i = 0; i < want; i++) {
			int32_t xy[2];
			memcpy(xy, &batch[i * length], 8);
			points.emplace_back(xy[0], xy[1]);
		}
	}
	fclose(f);

	auto wall = std::chrono::steady_clock::now();
	double cpu = cpu_seconds();
	Triangulation t(points.begin(), points.end());
	cpu = cpu_seconds() - cpu;
	double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - wall).count();
	rusage u;
	getrusage(RUSAGE_SELF, &u);
	printf("%zu %zu %zu %.3f %.3f %ld\n", points.size(), (size_t)t.number_of_vertices(),
	       (size_t)t.number_of_faces(), cpu, seconds, u.ru_maxrss * 1024L);
}
