/*
 * Pieces beside CGAL's Constrained_Delaunay_triangulation_2::insert_constraint in one process, run alternately: CPU time
 * of the thread, median of the runs. Both get the same pieces in the same order, in triangulations that are there
 * already. Only the insertion of pieces is timed. The kernel needs a table of the vertices before the first one, which
 * is the last column.
 *
 * "short": between positions that are near in the order of insertion, those that cross nothing inserted before. "long": one from
 * side to side.
 *
 *	bench-piece [--n POINTS] [--runs N] [KIND...]
 */
#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <utility>
#include <vector>

extern "C" {
#include "tri_piece.h"
}
#include "inputs.h"

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Cdt =
    CGAL::Constrained_Delaunay_triangulation_2<Kernel, CGAL::Default,
                                               CGAL::No_constraint_intersection_requiring_constructions_tag>;
using Pieces = std::vector<std::pair<uint32_t, uint32_t>>;

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

struct bench {
	const char *kind;
	mesh_vertex *v;
	uint32_t n;
	void *arena, *memory;
	std::vector<Kernel::Point_2> points;
	std::vector<uint32_t> order; /* of insertion */
};

static tri *kernel_mesh(const bench &b)
{
	tri *t = tri_init(b.arena, b.n);

	memcpy(static_cast<void *>(tri_input(t)), b.v, b.n * sizeof(*b.v));
	tri_run(t, b.n);
	return t;
}

static double run_kernel(const bench &b, const Pieces &pieces, double *ret_table)
{
	tri *t = kernel_mesh(b);
	double from = cpu_seconds();
	tri_pieces *p = tri_pieces_init(b.memory, t, 2 * b.n);
	uint32_t at;

	*ret_table = cpu_seconds() - from;
	from = cpu_seconds();

	for (auto &piece : pieces)
		if (tri_piece_insert(p, piece.first, piece.second, &at))
			abort();
	return cpu_seconds() - from;
}

static double run_cgal(const bench &b, const Pieces &pieces)
{
	std::vector<Cdt::Vertex_handle> at(b.n);
	Cdt cdt;

	Cdt::Face_handle near;

	for (uint32_t i : b.order) {
		at[i] = cdt.insert(b.points[i], near);
		near = at[i]->face();
	}
	double from = cpu_seconds();
	for (auto &piece : pieces)
		cdt.insert_constraint(at[piece.first], at[piece.second]);
	return cpu_seconds() - from;
}

/* Every 32nd vertex in the order of insertion, and the one that comes 12 later. */
static Pieces short_pieces(const bench &b, uint64_t *ret_crossed)
{
	tri *t = kernel_mesh(b);
	tri_pieces *p = tri_pieces_init(b.memory, t, 2 * b.n);
	struct tri_result r;
	Pieces pieces;

	tri_result(t, &r);
	*ret_crossed = 0;
	for (uint32_t i = 0; i + 12 < b.n; i += 32) {
		uint32_t n, at;

		if (tri_piece_find(p, r.id[i], r.id[i + 12], &n, &at) ||
		    tri_piece_insert(p, r.id[i], r.id[i + 12], &at))
			continue;
		*ret_crossed += n;
		pieces.emplace_back(r.id[i], r.id[i + 12]);
	}
	return pieces;
}

static Pieces long_piece(const bench &b, uint64_t *ret_crossed)
{
	tri_pieces *p = tri_pieces_init(b.memory, kernel_mesh(b), 2 * b.n);
	uint32_t low = 0, high = 0, n, at;

	for (uint32_t i = 0; i < b.n; i++) {
		int64_t sum = int64_t(b.v[i].x) + b.v[i].y;

		if (sum < int64_t(b.v[low].x) + b.v[low].y)
			low = i;
		if (sum > int64_t(b.v[high].x) + b.v[high].y)
			high = i;
	}
	if (tri_piece_find(p, low, high, &n, &at))
		return {};
	*ret_crossed = n;
	return {{low, high}};
}

static void measure(const bench &b, const char *what, const Pieces &pieces, uint64_t crossed, int runs)
{
	std::vector<double> ours, theirs;
	double table = 0;

	for (int i = 0; i < runs && !pieces.empty(); i++) {
		ours.push_back(run_kernel(b, pieces, &table));
		theirs.push_back(run_cgal(b, pieces));
	}
	if (!pieces.empty())
		printf("%-10s %-6s %9u %8zu %10lu %9.4f %9.4f %7.3f %9.4f\n", b.kind, what, b.n, pieces.size(),
		       (unsigned long)crossed, 1e6 * median(ours) / double(crossed),
		       1e6 * median(theirs) / double(crossed), median(ours) / median(theirs),
		       1e6 * table / b.n);
	fflush(stdout);
}

static bool measure_kind(const char *kind, uint32_t n, int runs)
{
	bench b = {kind, nullptr, 0, nullptr, nullptr, {}, {}};
	uint64_t crossed = 0;

	b.v = input_make(kind, n, 1, &b.n);
	if (!b.v || b.n < 3)
		return false;
	b.arena = aligned_alloc(64, (tri_bytes(b.n) + 63) / 64 * 64);
	b.memory = aligned_alloc(64, (tri_pieces_bytes(b.n, 2 * b.n) + 63) / 64 * 64);
	if (!b.arena || !b.memory)
		return false;
	for (uint32_t i = 0; i < b.n; i++)
		b.points.emplace_back(b.v[i].x, b.v[i].y);
	struct tri_result r;

	tri_result(kernel_mesh(b), &r);
	b.order.assign(r.id, r.id + r.nvertex);
	Pieces pieces = short_pieces(b, &crossed);
	measure(b, "short", pieces, crossed, runs);
	pieces = long_piece(b, &crossed);
	measure(b, "long", pieces, crossed, runs);
	free(b.memory);
	free(b.arena);
	free(b.v);
	return true;
}

int main(int argc, char **argv)
{
	std::vector<const char *> kinds;
	uint32_t n = 300000;
	int runs = 3;

	for (int i = 1; i < argc; i++) {
		if (!strcmp(argv[i], "--n") && i + 1 < argc) {
			n = uint32_t(strtoul(argv[++i], nullptr, 10));
		} else if (!strcmp(argv[i], "--runs") && i + 1 < argc) {
			runs = atoi(argv[++i]);
		} else if (argv[i][0] == '-') {
			fprintf(stderr, "usage: bench-piece [--n POINTS] [--runs N] [KIND...]\n");
			return 2;
		} else {
			kinds.push_back(argv[i]);
		}
	}
	if (kinds.empty())
		kinds = {"uniform", "scan", "grid", "cluster"};
	printf("%-10s %-6s %9s %8s %10s %9s %9s %7s %9s\n", "input", "what", "points", "pieces", "crossed", "acut us",
	       "CGAL us", "ratio", "table us");
	for (const char *kind : kinds)
		if (!measure_kind(kind, n, runs)) {
			fprintf(stderr, "bench-piece: no input of the kind '%s', or no memory for it\n", kind);
			return 1;
		}
	return 0;
}
