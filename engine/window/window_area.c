/*
 * Area queries: the triangles of the whole mesh that meet a closed area, from the cells concerned alone.
 *
 * The whole mesh DT(P) is never made. S is what was read so far; at the start the points of all cells that meet the
 * piece (window_piece.h), and the nearest others until S is not collinear. DT(S) is triangulated, and tested: for each
 * triangle that meets the piece, and each ghost whose closed outer half plane does, every cell whose box meets its
 * closed circumdisc (the half plane) must have been read. The nearest unread ones are read and their points
 * inserted, until none is left. The loop ends, because each round reads a cell. Of a rectangle S begins with the points
 * of P in a box around the piece, and a disc in that box needs no other cell.
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
 * The proof holds although boxes may be larger than their points, A is larger than a polygonal window (it is the cover),
 * and more cells are read than necessary.
 *
 * Sometimes most points of the cells are not needed: beside a long strip of land every box along its edge meets the
 * circles of the thin triangles there, but few points lie in them. Then cells are sifted: their points are tested against
 * the discs, and only those inside are inserted. A sifted cell counts as not read. The loop ends with a round in which
 * each triangle was tested against all points of all cells that its disc meets, and no point was inserted: (1) and (2)
 * then hold for points instead of cells.
 *
 * With pieces (engine/constrain): they are inserted into DT(S), and the triangles that meet A are verified. (1) holds for the
 * constrained mesh: no piece that was not loaded meets the box of T, and no position outside of S is in its closed disc. (2) is
 * about the hull, which pieces do not change, and (3) uses nothing else.
 *
 * Memory: a reader, the kernel's arena, and tables behind it, all passed in. If the points do not fit, the result is
 * WINDOW_E_SPLIT, and the caller halves the piece.
 */
#include "window_area.h"

#include <string.h>

#include "align.h"
#include "err.h"
#include "finish.h"

enum { SEEN_LEAST = 64, DISCS_LEAST = 16, NEAREST_FIRST = 4, SPARSE = 16, BATCH = 64, WEIGHT_TABLES = 8 };

/* ---- memory ---- */

static uint32_t seen_size(uint32_t cap)
{
	uint32_t n = SEEN_LEAST;

	while (2 * n * sizeof(struct window_seen) <= (size_t)cap * WINDOW_CAP_BYTES / 2)
		n *= 2;
	return n;
}

static uint32_t disc_room(uint32_t cap)
{
	size_t n = (size_t)cap * WINDOW_CAP_BYTES / 2 / sizeof(struct window_disc);

	return n < DISCS_LEAST ? DISCS_LEAST : n > WINDOW_DISCS ? WINDOW_DISCS : (uint32_t)n;
}

size_t window_area_tables(uint32_t cap)
{
	return align_line(sizeof(struct window_area)) + align_line(seen_size(cap) * sizeof(struct window_seen)) +
	       align_line(disc_room(cap) * sizeof(struct window_disc));
}

struct window_limits window_limits_of(struct window_limits l)
{
	l.round = l.round ? l.round : WINDOW_PICK;
	l.guess = l.guess ? l.guess : 1 << 15;
	l.inner = l.inner ? l.inner : 1 << 15;
	l.spacings = l.spacings > 0 ? l.spacings : 8;
	l.squares = l.squares ? l.squares : 16;
	return l;
}

struct window_area *window_area_init(const struct cut_source *src, const struct view *view, const struct cut_region *region,
				     struct window_limits limits, struct tri *tri, uint32_t cap, void *tables)
{
	struct window_area *a = tables;
	uint8_t *at = (uint8_t *)tables + align_line(sizeof(*a));
	uint8_t *behind = (uint8_t *)tri_input(tri) + (size_t)cap * sizeof(struct mesh_vertex);

	memset(a, 0, sizeof(*a));
	a->src = *src;
	a->view = view;
	a->region = region;
	a->cap = a->most = cap;
	a->limits = window_limits_of(limits);
	a->tri = tri;
	a->highest = view_prefers(view, &(struct point){.z = 1}, &(struct point){.z = 0});
	/* The points, and as much memory again to sort them, fit between the kernel's input and the end of the arena: 12 of
	 * its 64 bytes per position lie before them. */
	a->pts = (struct point *)(behind + (-(uintptr_t)behind & 15));
	a->seen = (struct window_seen *)at;
	a->seen_size = seen_size(cap);
	memset(a->seen, 0, a->seen_size * sizeof(*a->seen));
	a->disc = (struct window_disc *)(at + align_line(a->seen_size * sizeof(*a->seen)));
	a->disc_room = disc_room(cap);
	return a;
}

/* ---- the rounds ---- */

/* Half of the room for points around the piece is used: from now on cells are sifted. */
static bool is_crowded(const struct window_area *a, uint32_t n)
{
	return n > a->base + (a->cap - a->base) / 2 || window_area_full(a);
}

/* The first points. *ret_flat: all points are collinear. */
static int read_first(struct window_area *a, bool *ret_flat, struct err *err)
{
	int r = window_area_begin(a, err);

	a->base = a->npts;
	if (!r && a->npts)
		r = window_area_around(a, err);
	for (uint32_t n = NEAREST_FIRST; !r && !window_area_build(a); n = 2 * n < WINDOW_PICK ? 2 * n : WINDOW_PICK) {
		if (is_crowded(a, a->npts)) {
			if (a->guessed)
				return WINDOW_E_SPLIT;
			r = window_area_apex(a, err);
			*ret_flat = !r && !window_area_build(a);
			return r;
		}
		r = window_area_pick_nearest(a, n < a->limits.round ? n : a->limits.round, err);
		if (!r && a->npick == 0) {
			*ret_flat = true;
			return 0;
		}
		if (!r)
			r = window_area_read_picked(a, err);
	}
	return r;
}

static uint64_t count_positions(const struct window_area *a)
{
	uint64_t n = 0;

	for (uint32_t i = 0; i < a->npick; i++)
		n += a->pick[i].cell.distinct < a->pick[i].cell.count ? a->pick[i].cell.distinct : a->pick[i].cell.count;
	return n;
}

int window_area_run(struct window_area *a, bool *ret_flat, uint64_t *ret_need, struct err *err)
{
	int32_t data[4];
	int r;

	*ret_flat = false;
	if (!a->src.box(a->src.ctx, data) || !window_piece_init(&a->window, a->view, data, a->region)) {
		*ret_flat = true;
		return 0;
	}
	r = read_first(a, ret_flat, err);
	while (!r && !*ret_flat) {
		uint32_t before = tri_count(a->tri);

		a->sift = a->sift || is_crowded(a, before);
		if (a->sift && a->guessed)
			return WINDOW_E_SPLIT;
		a->waiting = before;
		r = window_area_test(a, err);
		if (r != WINDOW_AGAIN)
			break;
		r = 0;
		if (a->sift)
			continue;
		r = window_area_read_picked(a, err);
		a->thorough = (uint64_t)(tri_count(a->tri) - before) * SPARSE < count_positions(a);
		a->waiting = before + count_positions(a);
	}
	*ret_need = a->waiting > a->cap ? a->waiting : (uint64_t)a->cap + 1;
	return r;
}

/* ---- the result ---- */

/* Packs the triangles that the piece sends to the front, with their digest, and marks vertices, as finish_owned does. */
static void pick_triangles(struct finish *f, const struct window_piece *w)
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
		bool take = !ghost && window_piece_sends(w, xy[c[0]], xy[c[1]], xy[c[2]]);

		for (unsigned k = 0; k < 3; k++)
			if (c[k] != TRI_GHOST)
				mark[c[k]] |= take ? FINISH_USED : FINISH_OPEN;
		if (!take)
			continue;
		for (unsigned k = 0; k < 3; k++) {
			out[n][k] = c[k];
			place[batch][k] = finish_place(f, xy[c[k]]);
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

/* ---- with pieces ---- */

static bool piece_meets(void *ctx, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	return window_piece_meets(&((const struct window_area *)ctx)->window, a, b, c);
}

static bool piece_sends(void *ctx, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	return window_piece_sends(&((const struct window_area *)ctx)->window, a, b, c);
}

static bool area_has(void *ctx, const struct grid_cell *cell)
{
	return window_area_has_read(ctx, cell);
}

/* The triangles of the constrained mesh that meet the piece: ret->chosen, or NULL if they are those of the plain mesh. */
static int constrain(struct window_area *a, const struct window_from *from, struct finish_choice *ret, uint64_t *ret_need,
		     struct err *err)
{
	const struct constrain_area area = {.ctx = a, .meets = piece_meets, .takes = piece_sends, .has = area_has};
	struct constrain c = {.src = from->src,
			      .view = from->view,
			      .region = from->region,
			      .lines = from->lines,
			      .area = &area,
			      .lattice = from->lattice,
			      .arena = from->memory,
			      .size = from->room,
			      .used = tri_bytes(from->cap),
			      .tri = a->tri};
	int r = constrain_run(&c, ret_need, err);

	a->tri = c.tri;
	a->counts.cells_read += c.cells_read;
	a->counts.points_read += c.points_read;
	*ret = (struct finish_choice){c.chosen, c.special};
	return r == CONSTRAIN_E_SPLIT ? WINDOW_E_SPLIT : r;
}

static int finish_domain(struct window_area *a, const struct window_from *from, const int64_t k[3], struct mesh_domain *ret,
			 uint64_t *ret_need, struct err *err)
{
	struct finish_choice choice = {NULL, NULL};
	struct finish f = {0};
	int r = from->lines ? constrain(a, from, &choice, ret_need, err) : 0;

	if (r)
		return r;
	a->counts.points = a->counts.points_read;
	f.out.counts = a->counts;
	finish_init(&f, a->region, k, a->tri);
	finish_map(&f, from->view);
	if (choice.chosen)
		finish_chosen(&f, &choice);
	else
		pick_triangles(&f, &a->window);
	if (!finish_vertices(&f)) {
		*ret_need = (uint64_t)tri_count(a->tri) * 2;
		return WINDOW_E_SPLIT;
	}
	finish_numbers(&f);
	*ret = f.out;
	return 0;
}

/* Pieces of lines need the positions of whole cells. */
static bool clips(const struct window_from *from)
{
	return !from->lines && view_window_is_box(from->view);
}

/* A capacity that suffices for most pieces. The arrays of a smaller arena are close to each other, so fewer huge pages are
 * touched, which the kernel clears. */
static int guess_cap(const struct window_from *from, uint32_t *ret, struct err *err)
{
	struct window_piece window;
	int32_t data[4];
	uint64_t n = 0, more = window_limits_of(from->limits).guess;
	int r = 0;

	*ret = from->cap;
	if (from->lines || !from->src->box(from->src->ctx, data) || !window_piece_init(&window, from->view, data, from->region))
		return 0;
	r = window_positions(from->src, &window, &n, err);
	/* What a piece without cells depends on is not known, and little less memory gains little. */
	more += clips(from) ? n : 2 * n + 2 * more;
	if (n && more < from->cap / 2)
		*ret = (uint32_t)more;
	return r;
}

static int domain_within(const struct window_from *from, uint32_t cap, const int64_t k[3], struct mesh_domain *ret,
			 uint64_t *ret_need, struct err *err)
{
	const size_t room = cap < from->cap ? tri_bytes(cap) : from->room;
	struct window_area *a = window_area_init(from->src, from->view, from->region, from->limits, tri_init(from->memory, cap),
						 cap, (uint8_t *)from->memory + align_line(room));
	bool flat;
	int r;

	a->guessed = cap < from->cap;
	a->clips = clips(from);
	r = window_area_run(a, &flat, ret_need, err);
	if (r)
		return r;
	if (!flat)
		return finish_domain(a, from, k, ret, ret_need, err);
	a->counts.points = a->counts.points_read;
	*ret = (struct mesh_domain){.counts = a->counts};
	return 0;
}

int window_domain_from(const struct window_from *from, const int64_t k[3], struct mesh_domain *ret, uint64_t *ret_need,
		       struct err *err)
{
	uint32_t cap;
	int r;

	if (from->view->nweight)
		return window_regular(from, k, ret, ret_need, err);
	r = guess_cap(from, &cap, err);
	r = r ? r : domain_within(from, cap, k, ret, ret_need, err);
	return r == WINDOW_E_SPLIT && cap < from->cap ? domain_within(from, from->cap, k, ret, ret_need, err) : r;
}

uint32_t window_cap(uint32_t cap)
{
	size_t room = tri_bytes(cap);
	uint32_t n = cap;

	while (n && align_line(tri_bytes(n)) + window_area_tables(n) > room)
		n -= n / 64 + 1;
	return n;
}

/* With lines half of the positions, so that the arena has room for the kernel and tables of engine/constrain. */
uint32_t window_cap_of(const struct grid *grid, uint32_t arena_cap)
{
	uint32_t cap = window_cap(arena_cap);

	return grid_lines(grid) ? cap / 2 : cap;
}

int window_domain(const struct grid *grid, const struct view *view, struct window_weights weights,
		  const struct cut_region *region, uint32_t arena_cap, void *reader_memory, void *arena, struct mesh_domain *ret,
		  uint64_t *ret_need, struct err *err)
{
	struct window_from from = {.view = view,
				   .region = region,
				   .lattice = &grid_manifest(grid)->lattice,
				   .weights = weights,
				   .cap = window_cap_of(grid, arena_cap),
				   .memory = arena,
				   .room = tri_bytes(window_cap(arena_cap))};
	struct grid_reader *reader = NULL;
	struct constrain_lines lines;
	struct cut_source src;
	int r;

	/* The tables of engine/regular share the arena. */
	if (view->nweight)
		from.cap -= from.cap / WEIGHT_TABLES;
	if (!from.cap)
		return err_set(err, ERR_INTERNAL, "an arena of %u positions is too small for an area", arena_cap);
	r = grid_reader_new(grid, reader_memory, grid_reader_bytes(grid), &reader, err);
	if (r)
		return r;
	cut_source_grid(reader, &src);
	from.src = &src;
	from.lines = constrain_lines_of(reader, &lines) ? &lines : NULL;
	r = window_domain_from(&from, grid_manifest(grid)->lattice.k, ret, ret_need, err);
	grid_reader_free(reader);
	/* The need is compared with window_cap_of. */
	if (r == WINDOW_E_SPLIT && view->nweight && *ret_need <= window_cap_of(grid, arena_cap))
		*ret_need = (uint64_t)window_cap_of(grid, arena_cap) + 1;
	return r;
}
