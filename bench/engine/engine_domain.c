/*
 * pipe_domain taken apart: the same steps in the same order, with a clock between them. The engine itself has no
 * clock. What reading alone costs is told by scanning the region once more with nothing behind it.
 */
#include "engine_domain.h"

#include <time.h>

#include "cut_source.h"
#include "finish.h"
#include "pipe_priv.h"
#include "store.h"
#include "mesh_stream.h"
#include "stream.h"
#include "tri_priv.h"

const char *const phase_text[PHASES] = {
	"read", "view", "halo", "order", "triangulate", "owned, digest", "vertices", "numbers", "emit", "encode", "store", "load",
};

double phase_cpu(void)
{
	struct timespec t;

	clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
	return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static void lap(struct phases *sum, enum phase phase, double *from)
{
	double now = phase_cpu();

	sum->seconds[phase] += now - *from;
	*from = now;
}

/* ---- the grid as a source whose scans are timed ---- */

struct timed {
	struct grid_reader *reader, *twice;
	struct phases *sum;
};

static int nothing(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	return 0;
}

static int timed_scan(void *ctx, uint64_t lo, uint64_t hi, grid_points_fn fn, void *sink, struct err *err)
{
	struct timed *t = ctx;
	double from = phase_cpu(), whole;
	int r = grid_scan(t->reader, lo, hi, fn, sink, err);

	whole = phase_cpu() - from;
	from += whole;
	if (!r)
		r = grid_scan(t->twice, lo, hi, nothing, NULL, err);
	from = phase_cpu() - from;
	t->sum->seconds[PHASE_READ] += from;
	t->sum->seconds[PHASE_VIEW] += whole - from;
	/* What this took is no part of the halo. */
	t->sum->seconds[PHASE_HALO] -= whole + from;
	return r;
}

static int timed_walk(void *ctx, uint64_t lo, uint64_t hi, const struct grid_visitor *v, struct err *err)
{
	return grid_walk(((struct timed *)ctx)->reader, lo, hi, v, err);
}

static int timed_read(void *ctx, const struct grid_cell *cell, grid_points_fn fn, void *sink, struct err *err)
{
	return grid_cell_read(((struct timed *)ctx)->reader, cell, fn, sink, err);
}

static int timed_count(void *ctx, uint64_t lo, uint64_t hi, uint64_t *ret_count, bool *ret_exact, struct err *err)
{
	return grid_count(((struct timed *)ctx)->reader, lo, hi, ret_count, ret_exact, err);
}

static bool timed_box(void *ctx, int32_t ret_box[4])
{
	return grid_box(grid_reader_grid(((struct timed *)ctx)->reader), ret_box);
}

static int load(const struct grid *grid, const struct view *view, const struct cut_region *region, void *memory, void *twice,
		struct cut_load *load, struct phases *sum, uint64_t *ret_need, struct err *err)
{
	struct timed t = {.sum = sum};
	const struct cut_source source = {
		.ctx = &t,
		.walk = timed_walk,
		.read = timed_read,
		.scan = timed_scan,
		.count = timed_count,
		.box = timed_box,
	};
	double from;
	int r = grid_reader_new(grid, memory, grid_reader_bytes(grid), &t.reader, err);

	if (!r)
		r = grid_reader_new(grid, twice, grid_reader_bytes(grid), &t.twice, err);
	if (r)
		return r;
	from = phase_cpu();
	r = cut_load_from(&source, view, region, load, ret_need, err);
	lap(sum, PHASE_HALO, &from);
	sum->bytes_read += grid_reader_stats(t.reader).bytes;
	sum->records_read += load->counts.points_read;
	sum->cells_read += load->counts.cells_read;
	return r == CUT_E_FULL ? PIPE_E_SPLIT : r;
}

/* ---- a domain ---- */

static bool triangulate(struct tri *tri, uint32_t n, struct phases *sum)
{
	double from = phase_cpu();
	bool flat;

	tri->nvertex = n;
	if (!n)
		return false;
	tri_order(tri, tri_input(tri), n);
	lap(sum, PHASE_ORDER, &from);
	flat = tri_build(tri, tri_narrow(&tri->extent));
	lap(sum, PHASE_TRIANGULATE, &from);
	return !flat;
}

int phase_domain(const struct grid *grid, const struct view *view, const struct cut_region *region, const struct cut_sites *sites,
		 const struct pipe_budget *budget, void *memory, void *twice, struct phases *sum, struct mesh_domain *ret,
		 uint64_t *ret_need, struct err *err)
{
	struct finish f = {0};
	struct cut_load room;
	struct tri *tri;
	uint32_t cap;
	double from;
	bool fits;
	int r;

	pipe_domain_room(grid, budget, budget->cap, true, memory, &room);
	room.sites = sites;
	r = load(grid, view, region, memory, twice, &room, sum, ret_need, err);
	if (r)
		return r;
	tri = pipe_domain_tri(grid, budget, budget->cap, memory, &room, 0, &cap);
	f.out.counts = room.counts;
	if (triangulate(tri, room.n, sum)) {
		finish_init(&f, region, grid_manifest(grid)->lattice.k, tri);
		from = phase_cpu();
		finish_owned(&f);
		lap(sum, PHASE_OWNED, &from);
		fits = finish_vertices(&f);
		lap(sum, PHASE_VERTICES, &from);
		if (!fits) {
			*ret_need = (uint64_t)room.n * 2;
			return PIPE_E_SPLIT;
		}
		finish_numbers(&f);
		lap(sum, PHASE_NUMBERS, &from);
	}
	sum->open += f.out.nopen;
	sum->vertices += f.out.nvertex;
	*ret = f.out;
	return 0;
}

int phase_store(int dirfd, const struct mesh_domain *d, void *memory, size_t size, struct phases *sum, struct err *err)
{
	const struct store_id id = {{1, 2}, {3, 4}};
	const struct store_beside beside = {.proof = ""};
	struct store_front front;
	struct mesh_domain back;
	double from = phase_cpu();
	int r = store_put(dirfd, &id, &beside, d, &front, err);

	lap(sum, PHASE_STORE, &from);
	if (!r)
		r = store_get(dirfd, &id, memory, size, &back, err);
	lap(sum, PHASE_LOAD, &from);
	return r ? r : store_remove(dirfd, &id, err);
}

/* ---- emission ---- */

static int encode(void *ctx, const struct mesh_block *b, struct err *err)
{
	struct phases *sum = ctx;
	const struct stream_block block = mesh_stream_block(b);
	static uint8_t scratch[STREAM_SCRATCH];
	struct stream_piece piece[STREAM_PIECES];
	double from = phase_cpu();

	stream_put_block(&block, scratch, piece);
	from = phase_cpu() - from;
	sum->seconds[PHASE_ENCODE] += from;
	sum->seconds[PHASE_EMIT] -= from;
	return 0;
}

int phase_emit(struct pipe_emitter *e, struct mesh_domain *d, const struct cut_region *region, struct phases *sum,
	       struct err *err)
{
	const struct mesh_sink sink = {.ctx = sum, .block = encode};
	double from = phase_cpu();
	int r = pipe_emit(e, d, region, &sink, err);

	lap(sum, PHASE_EMIT, &from);
	return r;
}
