/*
 * Where the engine's time goes, one thread, without daemon: ingest, seal, plan, then the steps of each domain, its
 * emission, what the stream and the store add, CPU time a point. usage: bench-engine FILE.las FOLDER [MEMORY]
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "bench_grid.h"
#include "engine_domain.h"
#include "err.h"
#include "io.h"
#include "ledger.h"
#include "parse.h"
#include "pipe.h"

static double last;

static void line(const char *what, double seconds, uint64_t points)
{
	printf("%-15s %8.3f s %8.4f us a point\n", what, seconds, seconds * 1e6 / (double)(points ? points : 1));
}

static void lap(const char *what, uint64_t points)
{
	if (what)
		line(what, phase_cpu() - last, points);
	last = phase_cpu();
}

static void print(const struct phases *sum, const struct pipe_totals *t, uint64_t points)
{
	char text[32], a[DIGEST_HEX_SIZE], b[DIGEST_HEX_SIZE];
	double domains = 0, n = (double)points;

	for (unsigned i = 0; i < PHASES; i++) {
		snprintf(text, sizeof text, "  %s", phase_text[i]);
		line(text, sum->seconds[i], points);
		domains += i < PHASE_EMIT ? sum->seconds[i] : 0;
	}
	line("domains", domains, points);
	line("emission", sum->seconds[PHASE_EMIT], points);
	printf("read %.2f bytes, %.4f records a point, %.2f cells a domain for halos; open vertices %.2f %%\n",
	       (double)sum->bytes_read / n, (double)sum->records_read / n,
	       (double)sum->cells_read / (double)(t->domains ? t->domains : 1),
	       100.0 * (double)sum->open / (double)(sum->vertices ? sum->vertices : 1));
	printf("%llu domains, halo %.2f %%, %llu triangles, %s %s\n", (unsigned long long)t->domains,
	       100.0 * (double)t->counts.halo / (double)(t->counts.used ? t->counts.used : 1), (unsigned long long)t->triangles,
	       digest_hex(t->digest, a), digest_hex(t->vertex_digest, b));
}

/* As the daemon has it. */
static void *map(size_t size)
{
	const size_t huge = (size_t)2 << 20;
	void *p = aligned_alloc(huge, (size + huge - 1) & ~(huge - 1));

	if (p)
		madvise(p, size, MADV_HUGEPAGE);
	return p;
}

struct bench {
	struct grid *grid;
	struct view view;
	struct pipe_budget budget;
	struct grid_reader *reader;
	struct pipe_emitter *emitter;
	struct cut_plan plan;
	struct phases sum;
	void *memory, *spare, *twice;
	int dirfd;
};

static int each(struct bench *b, size_t i, struct err *err)
{
	struct mesh_domain domain;
	uint64_t need;
	int r;

	while ((r = phase_domain(b->grid, &b->view, &b->plan.leaf[i].region, b->plan.leaf[i].known ? b->plan.sites : NULL,
				 &b->budget, b->memory, b->twice, &b->sum, &domain, &need, err)) == PIPE_E_SPLIT)
		if ((r = cut_plan_split(&b->plan, i, b->reader, need, b->budget.cap, err)))
			break;
	if (!r && domain.ntriangle)
		r = phase_store(b->dirfd, &domain, b->spare, b->budget.domain_bytes, &b->sum, err);
	return r ? r : phase_emit(b->emitter, &domain, &b->plan.leaf[i].region, &b->sum, err);
}

static int mesh(struct grid *grid, uint64_t memory, int dirfd, struct err *err)
{
	size_t reader_size = grid_reader_bytes(grid);
	struct bench b = {.grid = grid, .view = VIEW_INIT, .dirfd = dirfd};
	struct pipe_totals totals;
	struct mesh_counts flat;
	int r = pipe_budget(memory, 2, grid, &b.budget, err);

	if (r)
		return r;
	view_bind(&b.view, &grid_manifest(grid)->lattice);
	b.memory = map(b.budget.domain_bytes);
	b.spare = map(b.budget.domain_bytes);
	b.twice = malloc(reader_size);
	r = grid_reader_new(grid, malloc(reader_size), reader_size, &b.reader, err);
	last = phase_cpu();
	if (!r)
		r = pipe_plan(grid, &b.view, &b.budget, b.memory, &b.plan, &flat, err);
	if (r == PIPE_E_EMPTY)
		r = 0;
	lap("plan", grid_points(grid));
	if (!r)
		r = pipe_emitter_new(&grid_manifest(grid)->lattice, 8 << 20, dirfd, &b.emitter, err);
	for (size_t i = 0; !r && i < b.plan.n; i++)
		r = each(&b, i, err);
	if (!r)
		r = pipe_emitter_finish(b.emitter, &totals, err);
	if (r)
		return r;
	printf("load %u\n", b.budget.load);
	print(&b.sum, &totals, grid_points(grid));
	return 0;
}

int main(int argc, char **argv)
{
	struct grid_segment_info info;
	uint64_t memory = 256 << 20;
	struct err err = ERR_INIT;
	struct grid *grid = NULL;
	struct ledger *ledger;
	char text[1600];
	int dirfd, r;

	if (argc < 3 || (argc > 3 && !parse_size(argv[3], &memory))) {
		fputs("usage: bench-engine FILE.las FOLDER [MEMORY]\n", stderr);
		return 2;
	}
	ledger = ledger_new(memory);
	r = io_open(AT_FDCWD, argv[2], O_RDONLY | O_DIRECTORY, 0, &dirfd, &err);
	if (!r)
		r = bench_grid(dirfd, argv[1], memory / 2, ledger, lap, &info, &grid, &err);
	if (!r)
		r = mesh(grid, memory * 7 / 8, dirfd, &err);
	grid_close(grid);
	if (r) {
		fprintf(stderr, "bench-engine: %s\n", err_format(&err, text, sizeof text));
		return 1;
	}
	return 0;
}
