/*
 * Area queries: the triangles of the whole mesh that meet a closed area, from the cells concerned alone.
 *
 * The whole mesh DT(P) is never made. S is what was read so far; at the start the points of all cells that meet the
 * piece (pipe_window.h), and the nearest others until S is not collinear. DT(S) is triangulated, and tested: for each
 * triangle that meets the piece, and each ghost whose closed outer half plane does, every cell whose box meets its
 * closed circumdisc (the half plane) must have been read. The nearest ones that were not are read, their points
 * inserted, and so on until there are none. It ends: each round reads a cell.
 *
 * Then the triangles of DT(S) that meet the piece are those of DT(P) that do. Let A be the piece.
 * (1) A tested triangle T is in DT(P): its perturbed circle holds no point of S, and all points of P in the closed disc
 *     are in S. The perturbation is of points: S and P rank them alike, and decide a tie on the circle alike.
 *     Of its corners all records were read too, for these lie in the disc: heights of duplicates are those of P.
 * (2) A tested ghost is one of DT(P): all points of P in its closed half plane are in S, so none is beyond its side, and
 *     none on it between its ends.
 * (3) Let T' of DT(P) meet A, at q. q lies in the hull of S: else it lay strictly beyond the line of a side of the hull,
 *     whose ghost was tested then, so that no point of P is beyond it; but q is in the hull of P. So q is in a triangle of
 *     DT(S), and all triangles and ghosts of DT(S) around q meet A, in q: they were tested, and belong to DT(P). (Of a
 *     q on the hull of S the ghosts on either side of it touch A, which is why half planes are closed.) Together they
 *     leave no room around q, which T' needs, so T' is one of them.
 *
 * That tests are made by boxes that may be larger than what they hold, that A is larger than the window where it is a
 * polygon (its cover), and that more is read than need be, harms none of this.
 *
 * Where much would have to be read that is not needed (beside a long strip of land every box along its edge meets the
 * circles of the thin triangles there, and few points do), cells are sifted: their points are held against the discs,
 * and those in the way inserted. Such a cell counts as not read. The end is a round in which each triangle was held
 * against all points of all cells that its disc meets, and none came in: what (1) and (2) say of cells holds of points.
 *
 * Memory: a reader, the kernel's arena, and tables behind it, all handed in. What does not fit is told, and the
 * piece is halved by who planned it.
 */
#include "pipe_area.h"

#include <string.h>

#include "err.h"
#include "pipe.h"
#include "pipe_finish.h"
#include "pipe_priv.h"

enum { SEEN_LEAST = 64, DISCS_LEAST = 16, NEAREST_FIRST = 4, SPARSE = 16, BATCH = 64 };

/* ---- memory ---- */

static uint32_t seen_size(uint32_t cap)
{
	uint32_t n = SEEN_LEAST;

	while (2 * n * sizeof(struct area_seen) <= (size_t)cap * AREA_CAP_BYTES / 2)
		n *= 2;
	return n;
}

static uint32_t disc_room(uint32_t cap)
{
	size_t n = (size_t)cap * AREA_CAP_BYTES / 2 / sizeof(struct area_disc);

	return n < DISCS_LEAST ? DISCS_LEAST : n > AREA_DISCS ? AREA_DISCS : (uint32_t)n;
}

size_t pipe_area_tables(uint32_t cap)
{
	return pipe_round(sizeof(struct pipe_area)) + pipe_round(seen_size(cap) * sizeof(struct area_seen)) +
	       pipe_round(disc_room(cap) * sizeof(struct area_disc));
}

struct pipe_area *pipe_area_find(const struct cut_source *src, const struct view *view, const struct cut_region *region,
				 uint32_t round, struct tri *tri, uint32_t cap, void *tables)
{
	struct pipe_area *a = tables;
	uint8_t *at = (uint8_t *)tables + pipe_round(sizeof(*a));
	uint8_t *behind = (uint8_t *)tri_input(tri) + (size_t)cap * sizeof(struct mesh_vertex);

	memset(a, 0, sizeof(*a));
	a->src = *src;
	a->view = view;
	a->region = region;
	a->cap = cap;
	a->round = round && round < AREA_PICK ? round : AREA_PICK;
	a->tri = tri;
	a->highest = view_prefers(view, &(struct point){.z = 1}, &(struct point){.z = 0});
	/* Points, and as much again to sort them, fit between the kernel's input and the arena's end: 28 of its 64
	 * bytes a position lie before them. */
	a->pts = (struct point *)(behind + (-(uintptr_t)behind & 15));
	a->seen = (struct area_seen *)at;
	a->seen_size = seen_size(cap);
	memset(a->seen, 0, a->seen_size * sizeof(*a->seen));
	a->disc = (struct area_disc *)(at + pipe_round(a->seen_size * sizeof(*a->seen)));
	a->disc_room = disc_room(cap);
	return a;
}

/* ---- the rounds ---- */

/* Half of what is left for what lies around the piece is used: now only what is in the way is taken. */
static bool crowded(const struct pipe_area *a, uint32_t n)
{
	return n > a->base + (a->cap - a->base) / 2 || pipe_area_seen_full(a);
}

/* The first points. *ret_flat: all of them are on one line. */
static int first(struct pipe_area *a, bool *ret_flat, struct err *err)
{
	int r = pipe_area_begin(a, err);

	a->base = a->npts;
	for (uint32_t n = NEAREST_FIRST; !r && !pipe_area_build(a); n = 2 * n < AREA_PICK ? 2 * n : AREA_PICK) {
		if (crowded(a, a->npts)) {
			r = pipe_area_apex(a, err);
			*ret_flat = !r && !pipe_area_build(a);
			return r;
		}
		r = pipe_area_nearest(a, n < a->round ? n : a->round, err);
		if (!r && a->npick == 0) {
			*ret_flat = true;
			return 0;
		}
		if (!r)
			r = pipe_area_picked(a, err);
	}
	return r;
}

static uint64_t positions(const struct pipe_area *a)
{
	uint64_t n = 0;

	for (uint32_t i = 0; i < a->npick; i++)
		n += a->pick[i].cell.distinct < a->pick[i].cell.count ? a->pick[i].cell.distinct : a->pick[i].cell.count;
	return n;
}

int pipe_area_run(struct pipe_area *a, bool *ret_flat, uint64_t *ret_need, struct err *err)
{
	int32_t data[4];
	int r;

	*ret_flat = false;
	if (!a->src.box(a->src.ctx, data) || !pipe_window_init(&a->window, a->view, data, a->region)) {
		*ret_flat = true;
		return 0;
	}
	r = first(a, ret_flat, err);
	while (!r && !*ret_flat) {
		uint32_t before = tri_count(a->tri);

		a->sift = a->sift || crowded(a, before);
		a->waiting = before;
		r = pipe_area_test(a, err);
		if (r != AREA_AGAIN)
			break;
		r = 0;
		if (a->sift)
			continue;
		r = pipe_area_picked(a, err);
		a->thorough = (uint64_t)(tri_count(a->tri) - before) * SPARSE < positions(a);
		a->waiting = before + positions(a);
	}
	*ret_need = a->waiting > a->cap ? a->waiting : (uint64_t)a->cap + 1;
	return r;
}

/* ---- the result ---- */

/* The triangles that the piece sends, packed to the front, with their digest; marks of vertices. As
 * pipe_finish_owned. */
static void pick(struct pipe_finish *f, const struct pipe_window *w)
{
	const int32_t(*xy)[2] = f->tri.xy;
	uint32_t(*out)[3] = (uint32_t(*)[3])f->tri.triangle;
	uint8_t *mark = (uint8_t *)f->tri.id;
	uint64_t place[BATCH][3];
	uint32_t n = 0, batch = 0;

	memset(mark, 0, f->tri.nvertex);
	for (uint32_t i = 0; i < f->tri.ntriangle; i++) {
		const struct tri_triangle *t = &f->tri.triangle[i];
		const uint32_t c[3] = {t->corner[0], t->corner[1], t->corner[2]};
		bool ghost = c[0] == TRI_GHOST || c[1] == TRI_GHOST || c[2] == TRI_GHOST;
		bool take = !ghost && pipe_window_has(w, xy[c[0]], xy[c[1]], xy[c[2]]) &&
			    pipe_window_sends(w, xy[c[0]], xy[c[1]], xy[c[2]]);

		for (unsigned k = 0; k < 3; k++)
			if (c[k] != TRI_GHOST)
				mark[c[k]] |= take ? PIPE_USED : PIPE_OPEN;
		if (!take)
			continue;
		for (unsigned k = 0; k < 3; k++) {
			out[n][k] = c[k];
			place[batch][k] = digest_place(xy[c[k]][0], xy[c[k]][1]);
		}
		n++;
		if (++batch < BATCH)
			continue;
		digest_add_triangles(&f->out.digest, (const uint64_t(*)[3])place, batch, f->k);
		batch = 0;
	}
	digest_add_triangles(&f->out.digest, (const uint64_t(*)[3])place, batch, f->k);
	f->out.triangle = out;
	f->out.ntriangle = n;
}

static int finish(struct pipe_area *a, const int64_t k[3], struct mesh_domain *ret, uint64_t *ret_need)
{
	struct pipe_finish f = {.out.counts = a->counts};

	pipe_finish_init(&f, a->region, k, a->tri);
	pick(&f, &a->window);
	if (!pipe_finish_vertices(&f)) {
		*ret_need = (uint64_t)tri_count(a->tri) * 2;
		return PIPE_E_SPLIT;
	}
	pipe_finish_numbers(&f);
	*ret = f.out;
	return 0;
}

int pipe_area_from(const struct cut_source *src, const struct view *view, const struct cut_region *region, uint32_t round,
		   uint32_t cap, void *memory, const int64_t k[3], struct mesh_domain *ret, uint64_t *ret_need, struct err *err)
{
	struct tri *tri = tri_init(memory, cap);
	struct pipe_area *a = pipe_area_find(src, view, region, round, tri, cap, (uint8_t *)memory + pipe_round(tri_bytes(cap)));
	bool flat;
	int r = pipe_area_run(a, &flat, ret_need, err);

	if (r)
		return r;
	a->counts.points = a->counts.points_read;
	if (!flat)
		return finish(a, k, ret, ret_need);
	*ret = (struct mesh_domain){.counts = a->counts};
	return 0;
}

/* The positions that an arena with tables carries in the place of an arena of `cap`. 0: none. */
uint32_t pipe_area_cap(uint32_t cap)
{
	size_t room = tri_bytes(cap);
	uint32_t n = cap;

	while (n && pipe_round(tri_bytes(n)) + pipe_area_tables(n) > room)
		n -= n / 64 + 1;
	return n;
}

int pipe_area(const struct grid *grid, const struct view *view, const struct cut_region *region, const struct pipe_budget *budget,
	      void *memory, struct mesh_domain *ret, uint64_t *ret_need, struct err *err)
{
	size_t reader_size = grid_reader_bytes(grid);
	uint32_t cap = pipe_area_cap(budget->cap);
	struct grid_reader *reader = NULL;
	struct cut_source src;
	int r;

	if (!cap)
		return err_set(err, ERR_INTERNAL, "an arena of %u positions is too small for an area", budget->cap);
	r = grid_reader_new(grid, memory, reader_size, &reader, err);
	if (r)
		return r;
	cut_source_grid(reader, &src);
	r = pipe_area_from(&src, view, region, 0, cap, pipe_domain_arena(grid, memory), grid_manifest(grid)->lattice.k, ret,
			   ret_need, err);
	grid_reader_free(reader);
	return r;
}
