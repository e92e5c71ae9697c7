/*
 * The steps of a domain with pieces. First the Delaunay triangulation of P(B): its owned triangles are the same whatever else is
 * loaded (algorithm.md 3), so the pieces that may cross them are searched once. Their ends are added, the triangles that they
 * cross get a flag, and the pieces are inserted. Then turns begin: flagged triangles are verified, and what is missing is added
 * to the triangulation with pieces, until nothing is. Only triangles that are new since they were last looked at are verified.
 *
 * Nothing here takes time or memory for each triangle of the region beyond some bits, but what pieces change.
 *
 * Memory: the arena has the kernel at its start, behind it the tables, then the points that a turn loads, and at its end the
 * pieces. If the kernel has no room for more positions, all is triangulated again in a larger one.
 *
 * When a region does not fit, a smaller one usually does. But triangles along a long piece depend on all positions along it,
 * however small the region is. So if P(B) is only a small part of what does not fit, halving is given up, and the longest of the
 * pieces is named.
 */
#include "constrain_priv.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "align.h"
#include "decimal.h"
#include "err.h"
#include "lattice.h"

/* P(B) of a region that is halved no further is at most this part of the arena's positions; a piece crosses so many triangles
 * at least. A disc is wide if its box has room for so many positions. */
enum { SMALL = 32, MOST_LEAST = 16, WIDE = 256, HINT_EACH = 64 };

uint32_t constrain_kernel_cap(uint64_t n)
{
	n += n / 3 + 64;
	return n < TRI_MAX_POINTS ? (uint32_t)n : TRI_MAX_POINTS;
}

void *constrain_take(struct constrain_work *w, size_t n)
{
	void *taken = w->at;

	if ((size_t)((uint8_t *)w->piece - w->at) < align_line(n))
		return NULL;
	w->at += align_line(n);
	return taken;
}

void constrain_triangle_box(const struct tri_result *r, const uint32_t corner[3], int32_t ret[4])
{
	const int32_t *first = r->xy[corner[0]];

	ret[0] = ret[2] = first[0];
	ret[1] = ret[3] = first[1];
	for (unsigned i = 1; i < 3; i++) {
		const int32_t *at = r->xy[corner[i]];

		point_box_join(ret, (const int32_t[4]){at[0], at[1], at[0], at[1]});
	}
}

bool constrain_owns(const struct constrain_work *w, uint32_t triangle)
{
	const struct constrain_area *area = w->c->area;
	const uint32_t *c = w->r.triangle[triangle].corner;
	const int32_t(*xy)[2] = w->r.xy;

	if (!constrain_real(&w->r.triangle[triangle]))
		return false;
	return area ? area->meets(area->ctx, xy[c[0]], xy[c[1]], xy[c[2]]) :
		      cut_owner_has(&w->owner, xy[c[0]], xy[c[1]], xy[c[2]]);
}

static uint32_t *hint_of(struct constrain_work *w, const int32_t at[2])
{
	uint32_t place[2];

	for (unsigned k = 0; k < 2; k++) {
		int64_t size = (int64_t)w->all[2 + k] - w->all[k] + 1, from = (int64_t)at[k] - w->all[k];

		place[k] = from < 0 ? 0 : from >= size ? HINTS - 1 : (uint32_t)(from * HINTS / size);
	}
	return &w->hint[place[0] * HINTS + place[1]];
}

void constrain_hints(struct constrain_work *w)
{
	memset(w->hint, 0xff, sizeof(w->hint));
	for (uint32_t i = 0; i < w->r.ntriangle; i += HINT_EACH) {
		uint32_t corner = w->r.triangle[i].corner[0];

		if (corner != TRI_GHOST)
			*hint_of(w, w->r.xy[corner]) = i;
	}
}

static double distance(const struct constrain_work *w, uint32_t triangle, const int32_t at[2])
{
	const uint32_t *corner = w->r.triangle[triangle].corner;
	const int32_t *there = w->r.xy[corner[0] == TRI_GHOST ? corner[1] : corner[0]];

	return fabs((double)there[0] - at[0]) + fabs((double)there[1] - at[1]);
}

uint32_t constrain_vertex(struct constrain_work *w, const int32_t at[2])
{
	uint32_t hint = *hint_of(w, at);
	const uint32_t *corner;

	if (hint != NONE && distance(w, hint, at) < distance(w, w->near, at))
		w->near = hint;
	w->near = tri_walk(w->c->tri, at, w->near);
	corner = w->r.triangle[w->near].corner;
	for (unsigned i = 0; i < 3; i++)
		if (corner[i] != TRI_GHOST && w->r.xy[corner[i]][0] == at[0] && w->r.xy[corner[i]][1] == at[1])
			return corner[i];
	return NONE;
}

/* ---- the first steps ---- */

/* Finds the pieces that meet the box of P(B), in which all owned triangles are. */
static int find_pieces(struct constrain_work *w)
{
	int32_t all[4] = CUT_BOX_EMPTY;

	for (uint32_t v = 0; v < w->r.nvertex; v++) {
		const int32_t x = w->r.xy[v][0], y = w->r.xy[v][1];

		all[0] = x < all[0] ? x : all[0];
		all[1] = y < all[1] ? y : all[1];
		all[2] = x > all[2] ? x : all[2];
		all[3] = y > all[3] ? y : all[3];
	}
	w->wide = ((double)all[2] - all[0]) * ((double)all[3] - all[1]) / w->r.nvertex * WIDE;
	memcpy(w->c->depends.box, all, sizeof(all));
	return constrain_lines_all(w, all);
}

static uint64_t *take_bits(struct constrain_work *w)
{
	size_t bytes = (2 * (size_t)w->most + 63) / 64 * sizeof(uint64_t);
	uint64_t *bits = constrain_take(w, bytes);

	if (bits)
		memset(bits, 0, bytes);
	return bits;
}

/* The tables, behind the kernel. */
static bool tables(struct constrain_work *w)
{
	uint32_t most = w->cap > 64 ? (uint32_t)(((uint64_t)w->cap - 64) * 4 / 5) : 0;

	w->most = most > w->r.nvertex ? most : w->r.nvertex;
	w->at = (uint8_t *)w->c->arena + align_line(w->c->used);
	if (w->at > (uint8_t *)w->piece)
		return false;
	w->special = take_bits(w);
	w->todo = w->special ? take_bits(w) : NULL;
	w->point = (struct point *)w->at;
	return w->todo;
}

/* Memory for pieces: half of what is left is for crossed triangles of one piece and for the list of owned ones. */
static bool pieces_begin(struct constrain_work *w)
{
	size_t room = (size_t)((uint8_t *)w->piece - w->at) / 2, fixed = tri_pieces_bytes(w->most, 0);
	uint64_t most = 2 * (uint64_t)w->most;
	size_t each = tri_pieces_bytes(0, 1) - tri_pieces_bytes(0, 0);
	void *memory;

	if (room < fixed + MOST_LEAST * each + 2 * ALIGN_LINE)
		return false;
	most = most < (room - fixed) / each ? most : (room - fixed) / each;
	memory = constrain_take(w, tri_pieces_bytes(w->most, (uint32_t)most));
	if (!memory)
		return false;
	w->p = tri_pieces_open(memory, w->c->tri, w->most, (uint32_t)most);
	return true;
}

static int lines_wrong(const struct constrain_work *w, const struct constrain_piece *p, int wrong, uint32_t at)
{
	if (wrong == TRI_E_MOST)
		return CONSTRAIN_E_SPLIT;
	return err_set(w->err, ERR_INTERNAL, "the piece from (%d, %d) to (%d, %d) cannot be inserted: %s, vertex %u", p->a[0],
		       p->a[1], p->b[0], p->b[1], wrong == TRI_E_CROSSING ? "it crosses another one" : "a position is on it", at);
}

/* The owned triangles that pieces cross get flags; a list of them is made. */
static int find_crossed(struct constrain_work *w)
{
	uint32_t words = (w->r.ntriangle + 63) / 64;

	for (uint32_t i = 0; i < w->npiece; i++) {
		struct constrain_piece *p = &w->piece[i];
		uint32_t n = 0, at = 0;
		int wrong;

		if (p->gone)
			continue;
		constrain_lines_known(w, p);
		wrong = tri_piece_find(w->p, w->r.id[p->end[0]], w->r.id[p->end[1]], &n, &at);
		if (wrong)
			return lines_wrong(w, p, wrong, at);
		for (uint32_t k = 0; k < n; k++)
			constrain_bit_set(w->special, tri_piece_found(w->p, k));
	}
	w->own = (uint32_t(*)[3])w->at;
	w->nown = 0;
	for (uint32_t k = 0; !w->c->area && k < words; k++)
		for (uint64_t bits = w->special[k]; bits; bits &= bits - 1) {
			uint32_t i = k * 64 + (uint32_t)__builtin_ctzll(bits);

			if (!constrain_owns(w, i))
				continue;
			if ((uint8_t *)(w->own + w->nown + 1) > (uint8_t *)w->piece)
				return CONSTRAIN_E_SPLIT;
			memcpy(w->own[w->nown++], w->r.triangle[i].corner, sizeof(*w->own));
			tri_piece_flag(w->p, i);
		}
	w->at = (uint8_t *)w->own + align_line(w->nown * sizeof(*w->own));
	return w->at > (uint8_t *)w->piece || !constrain_owner_index(w) ? CONSTRAIN_E_SPLIT : 0;
}

/* Inserts the pieces that are not in the triangulation yet. New triangles are to be verified. */
static int insert_pieces(struct constrain_work *w, bool later)
{
	for (uint32_t i = 0; i < w->npiece; i++) {
		struct constrain_piece *p = &w->piece[i];
		uint32_t at = 0, n = 0;
		int wrong = 0;

		if (p->gone || p->in)
			continue;
		if (later) {
			constrain_lines_known(w, p);
			wrong = tri_piece_find(w->p, w->r.id[p->end[0]], w->r.id[p->end[1]], &n, &at);
		}
		for (uint32_t k = 0; k < n && !wrong; k++) {
			constrain_bit_set(w->special, tri_piece_found(w->p, k));
			constrain_bit_set(w->todo, tri_piece_found(w->p, k));
		}
		if (!wrong)
			wrong = tri_piece_insert(w->p, w->r.id[p->end[0]], w->r.id[p->end[1]], &at);
		if (wrong)
			return lines_wrong(w, p, wrong, at);
		p->in = true;
	}
	return 0;
}

/* ---- verification ---- */

/* All triangles of an area, else those with a flag. */
static void todo_all(struct constrain_work *w)
{
	uint32_t n = w->r.ntriangle;

	if (w->c->area)
		for (uint32_t i = 0; i < n; i++)
			constrain_bit_set(w->todo, i);
	else
		memcpy(w->todo, tri_piece_flags(w->p), ((size_t)n + 63) / 64 * sizeof(*w->todo));
}

static bool must_verify(const struct constrain_work *w, uint32_t i, bool later)
{
	if (w->c->area)
		return constrain_owns(w, i);
	if (!tri_piece_flagged(w->p, i) || !constrain_real(&w->r.triangle[i]))
		return false;
	/* Flags of triangles around an added position are too many. */
	return !later || constrain_owner_overlaps(w, w->r.triangle[i].corner);
}

static int verify_one(struct constrain_work *w, uint32_t i)
{
	int32_t box[4];
	int rc;

	constrain_triangle_box(&w->r, w->r.triangle[i].corner, box);
	point_box_join(w->c->depends.box, box);
	rc = constrain_lines_box(w, box);
	return rc ? rc : constrain_disc_add(w, i);
}

/* Loads what the triangles depend on that are to be verified. What loads something stays among these. */
static int verify(struct constrain_work *w, bool later)
{
	uint32_t words = (w->r.ntriangle + 63) / 64;
	int rc = 0;

	w->point = (struct point *)w->at;
	w->npoint = 0;
	w->found = 0;
	for (uint32_t k = 0; k < words; k++) {
		uint64_t bits = w->todo[k];

		w->todo[k] = 0;
		for (; bits && !rc; bits &= bits - 1) {
			uint32_t i = k * 64 + (uint32_t)__builtin_ctzll(bits);

			if (i < w->r.ntriangle && must_verify(w, i, later))
				rc = verify_one(w, i);
		}
	}
	if (!rc)
		rc = constrain_lines_flush(w);
	if (!rc)
		rc = constrain_disc_flush(w);
	if (!rc && w->nnew)
		constrain_lines_sort(w);
	return rc || !w->found ? rc : constrain_lines_ends(w);
}

/* From a triangulation without pieces to one of which all that the domain needs is verified. *ret_again: it was triangulated
 * again, without pieces. */
static int attempt(struct constrain_work *w, bool *ret_again)
{
	int rc;

	*ret_again = false;
	w->point = (struct point *)((uint8_t *)w->c->arena + align_line(w->c->used));
	w->npoint = 0;
	rc = constrain_lines_ends(w);
	if (!rc && w->npoint)
		rc = constrain_points_plain(w);
	if (!rc && (!tables(w) || !pieces_begin(w)))
		rc = CONSTRAIN_E_SPLIT;
	if (!rc)
		rc = find_crossed(w);
	/* Also where no triangle is crossed, so that their sides are marked. */
	if (!rc)
		rc = insert_pieces(w, false);
	w->c->turns++;
	if (rc || (!w->c->area && !w->nown) || w->c->not_verified)
		return rc;
	todo_all(w);
	for (bool later = false; !rc && !*ret_again; later = true) {
		rc = verify(w, later);
		if (rc || (!w->npoint && !w->found))
			return rc;
		w->c->turns++;
		rc = constrain_points_insert(w, ret_again);
		if (!rc && !*ret_again && w->found)
			rc = constrain_lines_ends(w);
		if (!rc && !*ret_again)
			rc = insert_pieces(w, true);
	}
	return rc;
}

/* ---- the result ---- */

static void choose_area(struct constrain_work *w, uint64_t *chosen)
{
	const struct constrain_area *area = w->c->area;

	for (uint32_t i = 0; i < w->r.ntriangle; i++) {
		const uint32_t *c = w->r.triangle[i].corner;
		const int32_t(*xy)[2] = w->r.xy;

		if (constrain_owns(w, i) && area->takes(area->ctx, xy[c[0]], xy[c[1]], xy[c[2]]))
			constrain_bit_set(chosen, i);
	}
}

/* Also those that are chosen because the region owns them; without those that are out. */
static int choose_all(struct constrain_work *w, const uint64_t *special, uint64_t *chosen)
{
	bool any = false;
	int rc = 0;

	if (w->c->area)
		choose_area(w, chosen);
	for (uint32_t i = 0; !w->c->area && i < w->r.ntriangle; i++)
		if (!(special && constrain_bit(special, i)) && constrain_owns(w, i))
			constrain_bit_set(chosen, i);
	if (w->c->lines->state)
		rc = constrain_out(w, chosen, &any);
	if (special || any)
		w->c->chosen = chosen;
	w->c->special = NULL;
	return rc;
}

/* Without pieces: the owned triangles that are not out. */
static int choose_plain(struct constrain_work *w)
{
	if (!w->c->lines->state)
		return 0;
	return tables(w) ? choose_all(w, NULL, w->todo) : CONSTRAIN_E_SPLIT;
}

/* Beside owned triangles that no piece crosses those that are not in the plain mesh. */
static int choose(struct constrain_work *w)
{
	uint32_t words = (w->r.ntriangle + 63) / 64;
	uint64_t *chosen = w->todo;

	for (uint32_t k = 0; k < words; k++) {
		uint64_t bits = w->nown ? tri_piece_flags(w->p)[k] : 0;

		chosen[k] = 0;
		for (; bits; bits &= bits - 1) {
			uint32_t i = k * 64 + (uint32_t)__builtin_ctzll(bits);

			if (constrain_real(&w->r.triangle[i]) && constrain_owner_has(w, w->r.triangle[i].corner))
				constrain_bit_set(chosen, i);
		}
	}
	w->c->chosen = chosen;
	w->c->special = w->special;
	w->c->inserted = w->p;
	w->c->pieces = w->npiece;
	w->c->crossed = w->nown;
	return w->c->area || w->c->lines->state ? choose_all(w, w->special, chosen) : 0;
}

/* ---- what does not fit ---- */

static double length_of(const struct constrain_piece *p)
{
	return hypot((double)p->b[0] - p->a[0], (double)p->b[1] - p->a[1]);
}

/* The end of a piece as the lattice has it. */
static void end_of(const struct constrain_work *w, const int32_t at[2], int32_t ret[2])
{
	const struct view_map *map = &w->c->view->map;

	if (map->is.k)
		view_map_back(map, at, ret);
	else
		memcpy(ret, at, sizeof(int32_t[2]));
}

static int name_longest(struct constrain_work *w, uint64_t points, uint64_t need)
{
	const struct lattice lattice = w->c->lattice ? *w->c->lattice : (struct lattice){.scale_xy = {1, 0}};
	const struct constrain_piece *longest = &w->piece[0];
	struct constrain_piece end = *longest;
	char at[4][DECIMAL_TEXT_SIZE];

	for (uint32_t i = 1; i < w->npiece; i++)
		if (length_of(&w->piece[i]) > length_of(longest))
			longest = &w->piece[i];
	end_of(w, longest->a, end.a);
	end_of(w, longest->b, end.b);
	for (unsigned k = 0; k < 2; k++) {
		decimal_scaled_text(lattice.scale_xy, end.a[k] + lattice.k[k], at[k]);
		decimal_scaled_text(lattice.scale_xy, end.b[k] + lattice.k[k], at[2 + k]);
	}
	err_set(w->err, ERR_LIMIT,
		"the segment of a line from (%s, %s) to (%s, %s), of length %.6g, does not fit the memory: triangles along it depend on "
		"more than %" PRIu64 " points",
		at[0], at[1], at[2], at[3], length_of(&end) * decimal_double(lattice.scale_xy), points);
	w->err->need = need;
	if (w->c->lines->name)
		w->c->lines->name(w->c->lines->ctx, end.a, end.b, w->err);
	return err_add_hint(w->err, "send the lines with --densify LENGTH, so that their segments are shorter");
}

static int does_not_fit(struct constrain_work *w, uint64_t *ret_need)
{
	uint64_t fits = w->c->size / TRI_BYTES_PER_POINT, points = (uint64_t)w->r.nvertex + w->npoint;
	uint64_t need = 2 * points > fits ? 2 * points : fits + 1;

	*ret_need = need;
	if (w->npiece && w->first <= fits / SMALL)
		return name_longest(w, points, need);
	return CONSTRAIN_E_SPLIT;
}

static uint32_t sights_of(size_t size)
{
	size_t sights = size / SIGHTS_PART / sizeof(struct constrain_sight);

	return sights < SIGHTS ? SIGHTS : sights < SIGHTS_MOST ? (uint32_t)sights : SIGHTS_MOST;
}

size_t constrain_work_bytes(size_t size)
{
	size_t sights = sights_of(size), discs = sights / SIGHTS_DISC;
	struct constrain_work *w;

	return align_line(sizeof(*w)) + align_line(sights * sizeof(*w->sight)) + align_line(discs * sizeof(*w->disc)) +
	       align_line(discs * HITS * sizeof(*w->hit));
}

/* Takes n bytes. */
static void *take_work(uint8_t **at, size_t n)
{
	void *taken = *at;

	*at += align_line(n);
	return taken;
}

static bool begin(struct constrain_work **ret, struct constrain *c, struct err *err)
{
	uintptr_t end = ((uintptr_t)c->arena + c->size) & ~(uintptr_t)(ALIGN_LINE - 1);
	size_t bytes = constrain_work_bytes(c->size);
	struct constrain_work *w;
	uint8_t *at;

	if (c->size < bytes + 2 * ALIGN_LINE + align_line(c->used))
		return false;
	at = (uint8_t *)(end - bytes);
	w = take_work(&at, sizeof(*w));
	memset(w, 0, sizeof(*w));
	w->c = c;
	w->err = err;
	w->mostsight = sights_of(c->size);
	w->mostdisc = w->mostsight / SIGHTS_DISC;
	w->sight = take_work(&at, w->mostsight * sizeof(*w->sight));
	w->disc = take_work(&at, w->mostdisc * sizeof(*w->disc));
	w->mosthit = w->mostdisc * HITS;
	w->hit = take_work(&at, w->mosthit * sizeof(*w->hit));
	w->piece = (struct constrain_piece *)(end - bytes);
	w->point = (struct point *)((uint8_t *)c->arena + align_line(c->used));
	w->nrange = cut_region_ranges(c->region, w->range);
	cut_region_box(c->region, w->border);
	tri_result(c->tri, &w->r);
	w->first = w->r.nvertex;
	/* The kernel may have more, but that may depend on segments. */
	w->cap = (uint32_t)((c->used - tri_bytes(0)) / TRI_BYTES_PER_POINT);
	w->cap = w->cap < constrain_kernel_cap(w->first) ? w->cap : constrain_kernel_cap(w->first);
	cut_owner_init(&w->owner, c->region);
	*ret = w;
	return true;
}

int constrain_run(struct constrain *c, uint64_t *ret_need, struct err *err)
{
	struct constrain_work *w;
	int rc;

	if (!begin(&w, c, err)) {
		*ret_need = c->size / TRI_BYTES_PER_POINT + 1;
		return CONSTRAIN_E_SPLIT;
	}
	c->depends = (struct cut_lines){.box = CUT_BOX_EMPTY, .disc = CUT_BOX_EMPTY};
	rc = find_pieces(w);
	constrain_lines_sort(w);
	if (!rc && !w->npiece)
		rc = choose_plain(w);
	for (bool again = w->npiece; !rc && again;)
		rc = attempt(w, &again);
	if (!rc && w->npiece)
		rc = choose(w);
	return rc == CONSTRAIN_E_SPLIT ? does_not_fit(w, ret_need) : rc;
}
