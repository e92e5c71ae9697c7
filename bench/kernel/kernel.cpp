/*
 * The kernel beside CGAL's Delaunay_triangulation_2 in one process, run alternately: CPU time of the
 * thread, median of five. Both get the same distinct positions in Morton order, as the store has them, and are
 * built with the same flags. What is timed: all of tri_run; all of the range insert (its sort included).
 *
 *	bench-kernel [--n POINTS] [--runs N] [KIND...]
 */
#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <vector>

extern "C" {
#include "tri.h"
}
#include "inputs.h"

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Dt = CGAL::Delaunay_triangulation_2<Kernel>;

static double cpu_seconds()
{
	timespec t;

	clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
	return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

static double median(std::vector<double> v)
{
	std::sort(v.begin(), v.end());
	return v[v.size() / 2];
}

struct run {
	double seconds;
	size_t triangles; /* without ghosts */
};

static run run_kernel(void *arena, const mesh_vertex *v, uint32_t n)
{
	tri *t = tri_init(arena, n);
	struct tri_result result;
	size_t real = 0;

	memcpy(static_cast<void *>(tri_input(t)), v, n * sizeof(*v));
	double from = cpu_seconds();
	tri_run(t, n);
	double took = cpu_seconds() - from;

	tri_result(t, &result);
	for (uint32_t i = 0; i < result.ntriangle; i++) {
		const uint32_t *c = result.triangle[i].corner;

		real += c[0] != TRI_GHOST && c[1] != TRI_GHOST && c[2] != TRI_GHOST;
	}
	return {took, real};
}

static run run_cgal(const std::vector<Kernel::Point_2> &points)
{
	double from = cpu_seconds();
	Dt dt;

	dt.insert(points.begin(), points.end());
	double took = cpu_seconds() - from;
	return {took, dt.number_of_faces()};
}

static bool measure(const char *kind, uint32_t n, int runs)
{
	uint32_t have;
	mesh_vertex *v = input_make(kind, n, 1, &have);

	if (!v) {
		fprintf(stderr, "bench-kernel: no input of the kind '%s', or no memory for it\n", kind);
		return false;
	}

	std::vector<Kernel::Point_2> points;
	std::vector<double> ours, theirs;
	size_t bytes = tri_bytes(have);
	void *arena = aligned_alloc(64, (bytes + 63) / 64 * 64);
	run a = {}, b = {};

	if (!arena) {
		fprintf(stderr, "bench-kernel: no memory for an arena of %zu bytes\n", bytes);
		free(v);
		return false;
	}
	memset(arena, 0, bytes);
	for (uint32_t i = 0; i < have; i++)
		points.emplace_back(v[i].x, v[i].y);
	for (int i = 0; i < runs; i++) {
		a = run_kernel(arena, v, have);
		b = run_cgal(points);
		ours.push_back(a.seconds);
		theirs.push_back(b.seconds);
	}
	printf("%-10s %10u %10zu %8.3f %8.3f %7.3f %8.1f%s\n", kind, have, a.triangles,
	       1e6 * median(ours) / have, 1e6 * median(theirs) / have, median(ours) / median(theirs),
	       double(bytes) / have, a.triangles == b.triangles ? "" : "  TRIANGLES DIFFER");
	fflush(stdout);
	free(arena);
	free(v);
	return a.triangles == b.triangles;
}

int main(int argc, char **argv)
{
	std::vector<const char *> kinds;
	uint32_t n = 1000000;
	int runs = 5;
	bool good = true;

	for (int i = 1; i < argc; i++) {
		if (!strcmp(argv[i], "--n") && i + 1 < argc) {
			n = uint32_t(strtoul(argv[++i], nullptr, 10));
		} else if (!strcmp(argv[i], "--runs") && i + 1 < argc) {
			runs = atoi(argv[++i]);
		} else if (argv[i][0] == '-') {
			fprintf(stderr,
				"usage: bench-kernel [--n POINTS] [--runs N] [KIND...]\n");
			return 2;
		} else {
			kinds.push_back(argv[i]);
		}
	}
	if (n < 3 || n > TRI_MAX_POINTS || runs < 1) {
		fprintf(stderr, "bench-kernel: --n from 3 to %u, --runs at least 1\n", TRI_MAX_POINTS);
		return 2;
	}
	if (kinds.empty())
		kinds = {"uniform", "scan", "grid", "cluster"};
	printf("%-10s %10s %10s %8s %8s %7s %8s\n", "input", "points", "triangles", "acut us", "CGAL us",
	       "ratio", "B/point");
	for (const char *kind : kinds)
		good &= measure(kind, n, runs);
	return good ? 0 : 1;
}
