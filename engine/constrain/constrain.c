/*
 * The steps of a domain with pieces, in turns. A turn begins with the Delaunay triangulation of what was loaded. The owned
 * triangles of it are the same in every turn (algorithm.md 3), so the pieces that may cross them are searched once, in the first.
 * Those that are crossed get a flag, the pieces are inserted, and flagged triangles are verified. If that loads a position or a
 * piece, another turn begins.
 *
 * Memory: the arena has the kernel at its start, behind it the tables of the turn, then the points that it loads, and at its end
 * the pieces. A turn needs about 80 bytes for a position, more with many pieces.
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
#include "cut_owner.h"
#include "decimal.h"
#include "err.h"
#include "lattice.h"

/* P(B) of a region that is halved no further is at most this part of the arena's positions; a piece crosses so many triangles
 * at least. */
enum { SMALL = 32, MOST_LEAST = 16 };

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

/* ---- the pieces of owned triangles ---- */

/* Whether a triangle is owned, or meets the area. */
static bool owns(const struct constrain_work *w, const struct cut_owner *o, uint32_t i)
{
	const struct constrain_area *area = w->c->area;
	const uint32_t *c = w->r.triangle[i].corner;
	const int32_t(*xy)[2] = w->r.xy;

	if (!constrain_real(&w->r.triangle[i]))
		return false;
	return area ? area->meets(area->ctx, xy[c[0]], xy[c[1]], xy[c[2]]) : cut_owner_has(o, xy[c[0]], xy[c[1]], xy[c[2]]);
}

static uint64_t *take_bits(struct constrain_work *w)
{
	size_t bytes = ((size_t)w->r.ntriangle + 63) / 64 * sizeof(uint64_t);
	uint64_t *bits = constrain_take(w, bytes);

	if (bits)
		memset(bits, 0, bytes);
	return bits;
}

/* Sets the bits of owned triangles, and the box of all of them. */
static void find_owned(struct constrain_work *w, uint64_t *owned)
{
	int32_t all[4] = CUT_BOX_EMPTY;
	struct cut_owner o;

	cut_owner_init(&o, w->c->region);
	for (uint32_t i = 0; i < w->r.ntriangle; i++) {
		if (!owns(w, &o, i))
			continue;
		owned[i / 64] |= UINT64_C(1) << i % 64;
		for (unsigned k = 0; k < 3; k++) {
			const int32_t *at = w->r.xy[w->r.triangle[i].corner[k]];

			all[0] = at[0] < all[0] ? at[0] : all[0];
			all[1] = at[1] < all[1] ? at[1] : all[1];
			all[2] = at[0] > all[2] ? at[0] : all[2];
			all[3] = at[1] > all[3] ? at[1] : all[3];
		}
	}
	memcpy(w->c->depends.box, all, sizeof(all));
}

/* Finds the pieces that meet the box of an owned triangle: first those that meet the box of all together. */
static int find_pieces(struct constrain_work *w)
{
	uint64_t *owned;
	int rc;

	if (!constrain_points_reserve(w))
		return CONSTRAIN_E_SPLIT;
	owned = take_bits(w);
	if (!owned)
		return CONSTRAIN_E_SPLIT;
	w->point = (struct point *)w->at;
	find_owned(w, owned);
	if (w->c->depends.box[0] > w->c->depends.box[2])
		return 0;
	rc = constrain_lines_all(w, w->c->depends.box);
	for (uint32_t i = 0; !rc && (w->nfar || w->many) && i < w->r.ntriangle; i++) {
		int32_t box[4];

		if (!constrain_bit(owned, i))
			continue;
		constrain_triangle_box(&w->r, w->r.triangle[i].corner, box);
		rc = constrain_lines_box(w, box);
	}
	return rc ? rc : constrain_lines_flush(w);
}

/* ---- a turn ---- */

static int lines_wrong(const struct constrain_work *w, const struct constrain_piece *p, int wrong, uint32_t at)
{
	if (wrong == TRI_E_MOST)
		return CONSTRAIN_E_SPLIT;
	return err_set(w->err, ERR_INTERNAL, "the piece from (%d, %d) to (%d, %d) cannot be inserted: %s, vertex %u", p->a[0],
		       p->a[1], p->b[0], p->b[1], wrong == TRI_E_CROSSING ? "it crosses another one" : "a position is on it", at);
}

/* The ids of the ends. */
static void ends_of(const struct constrain_work *w, const struct constrain_piece *p, uint32_t ret[2])
{
	ret[0] = w->r.id[constrain_points_find(w, p->a[0], p->a[1])];
	ret[1] = w->r.id[constrain_points_find(w, p->b[0], p->b[1])];
}

/* Chooses the owned triangles that no piece crosses: the others keep their places. */
static void choose_owned(struct constrain_work *w)
{
	struct cut_owner o;

	cut_owner_init(&o, w->c->region);
	for (uint32_t i = 0; i < w->r.ntriangle; i++) {
		bool owned = !constrain_bit(w->crossed, i) && owns(w, &o, i);

		w->chosen[i / 64] |= (uint64_t)owned << i % 64;
	}
}

static bool tables(struct constrain_work *w)
{
	w->at = (uint8_t *)(w->slot + w->nslot);
	w->at += align_line((uintptr_t)w->at) - (uintptr_t)w->at;
	w->chosen = take_bits(w);
	w->crossed = w->chosen ? take_bits(w) : NULL;
	if (!w->crossed)
		return false;
	w->point = (struct point *)w->at;
	w->npoint = 0;
	return true;
}

/* Memory for pieces: half of what is left is for crossed triangles of one piece and for the list of owned ones. */
static bool pieces_begin(struct constrain_work *w)
{
	size_t room = (size_t)((uint8_t *)w->piece - w->at) / 2, fixed = tri_pieces_bytes(w->r.nvertex, 0);
	uint64_t most = 2 * (uint64_t)w->r.nvertex;
	size_t each = tri_pieces_bytes(0, 1) - tri_pieces_bytes(0, 0);
	void *memory;

	if (room < fixed + MOST_LEAST * each + 2 * ALIGN_LINE)
		return false;
	most = most < (room - fixed) / each ? most : (room - fixed) / each;
	memory = constrain_take(w, tri_pieces_bytes(w->r.nvertex, (uint32_t)most));
	if (!memory)
		return false;
	w->p = tri_pieces_init(memory, w->c->tri, (uint32_t)most);
	w->before = (struct constrain_before *)w->at;
	w->nbefore = 0;
	return true;
}

/* An owned triangle that a piece crosses gets a flag. */
static int take_crossed(struct constrain_work *w, const struct cut_owner *o, uint32_t i)
{
	struct constrain_before *before = &w->before[w->nbefore];

	if (constrain_bit(w->crossed, i))
		return 0;
	if ((uint8_t *)(before + 1) > (uint8_t *)w->piece)
		return CONSTRAIN_E_SPLIT;
	w->crossed[i / 64] |= UINT64_C(1) << i % 64;
	*before = (struct constrain_before){i, w->r.triangle[i]};
	w->nbefore++;
	if (!w->c->area && owns(w, o, i))
		tri_piece_flag(w->p, i);
	return 0;
}

/* The list of owned triangles that are crossed. */
static int list_own(struct constrain_work *w)
{
	w->at = (uint8_t *)w->before + align_line(w->nbefore * sizeof(*w->before));
	w->own = (uint32_t(*)[3])w->at;
	w->nown = 0;
	if (w->at > (uint8_t *)w->piece)
		return CONSTRAIN_E_SPLIT;
	for (uint32_t i = 0; i < w->nbefore; i++) {
		if (!tri_piece_flagged(w->p, w->before[i].place))
			continue;
		if ((uint8_t *)(w->own + w->nown + 1) > (uint8_t *)w->piece)
			return CONSTRAIN_E_SPLIT;
		memcpy(w->own[w->nown++], w->before[i].triangle.corner, sizeof(*w->own));
	}
	w->at = (uint8_t *)w->own + align_line(w->nown * sizeof(*w->own));
	return w->at > (uint8_t *)w->piece || !constrain_owner_index(w) ? CONSTRAIN_E_SPLIT : 0;
}

static int find_crossed(struct constrain_work *w)
{
	struct cut_owner o;

	cut_owner_init(&o, w->c->region);
	for (uint32_t i = 0; i < w->npiece; i++) {
		uint32_t end[2], n = 0, at = 0;
		int wrong, rc = 0;

		if (w->piece[i].gone)
			continue;
		ends_of(w, &w->piece[i], end);
		wrong = tri_piece_find(w->p, end[0], end[1], &n, &at);
		if (wrong)
			return lines_wrong(w, &w->piece[i], wrong, at);
		for (uint32_t k = 0; k < n && !rc; k++)
			rc = take_crossed(w, &o, tri_piece_found(w->p, k));
		if (rc)
			return rc;
	}
	return list_own(w);
}

static int insert_pieces(struct constrain_work *w)
{
	for (uint32_t i = 0; i < w->npiece; i++) {
		uint32_t end[2], at = 0;
		int wrong;

		if (w->piece[i].gone)
			continue;
		ends_of(w, &w->piece[i], end);
		wrong = tri_piece_insert(w->p, end[0], end[1], &at);
		if (wrong)
			return lines_wrong(w, &w->piece[i], wrong, at);
	}
	return 0;
}

/* Loads what flagged triangles depend on. */
static int verify(struct constrain_work *w)
{
	int rc = 0;

	w->point = (struct point *)w->at;
	w->npoint = 0;
	w->found = 0;
	for (uint32_t i = 0; i < w->r.ntriangle && !rc; i++) {
		int32_t box[4];

		if (w->c->area ? !owns(w, NULL, i) : !tri_piece_flagged(w->p, i) || !constrain_real(&w->r.triangle[i]))
			continue;
		if (constrain_verified(w, i))
			continue;
		constrain_verified_add(w, i);
		constrain_triangle_box(&w->r, w->r.triangle[i].corner, box);
		point_box_join(w->c->depends.box, box);
		rc = constrain_lines_box(w, box);
		if (!rc)
			rc = constrain_disc_add(w, i);
	}
	if (!rc)
		rc = constrain_lines_flush(w);
	if (!rc)
		rc = constrain_disc_flush(w);
	if (rc)
		return rc;
	constrain_lines_sort(w);
	return constrain_lines_ends(w);
}

/* *ret_again: more was loaded. */
static int turn(struct constrain_work *w, bool first, bool *ret_again)
{
	int rc = tables(w) ? 0 : CONSTRAIN_E_SPLIT;

	w->c->turns++;
	w->nbefore = 0;
	*ret_again = true;
	if (!rc && first)
		rc = constrain_lines_ends(w);
	if (rc || (first && w->npoint))
		return rc;
	if (!pieces_begin(w))
		return CONSTRAIN_E_SPLIT;
	rc = find_crossed(w);
	*ret_again = false;
	if (rc)
		return rc;
	/* Also where no triangle is crossed, so that their sides are marked. */
	rc = insert_pieces(w);
	if (rc || (!w->c->area && !w->nown) || w->c->not_verified)
		return rc;
	rc = verify(w);
	*ret_again = w->npoint || w->found;
	return rc;
}

static void choose_area(struct constrain_work *w)
{
	const struct constrain_area *area = w->c->area;

	for (uint32_t i = 0; i < w->r.ntriangle; i++) {
		const uint32_t *c = w->r.triangle[i].corner;
		const int32_t(*xy)[2] = w->r.xy;
		bool takes = owns(w, NULL, i) && area->takes(area->ctx, xy[c[0]], xy[c[1]], xy[c[2]]);

		w->chosen[i / 64] |= (uint64_t)takes << i % 64;
	}
}

/* Without pieces: the owned triangles that are not out. */
static int choose_plain(struct constrain_work *w)
{
	bool any = false;
	int rc;

	if (!w->c->lines->state)
		return 0;
	if (!tables(w))
		return CONSTRAIN_E_SPLIT;
	if (w->c->area)
		choose_area(w);
	else
		choose_owned(w);
	rc = constrain_out(w, &any);
	if (!rc && any)
		w->c->chosen = w->chosen;
	return rc;
}

/* Beside owned triangles that no piece crosses those that are not in the plain mesh. */
static int choose(struct constrain_work *w)
{
	bool any;

	if (w->c->area)
		choose_area(w);
	else
		choose_owned(w);
	for (uint32_t i = 0; w->nown && i < w->r.ntriangle; i++)
		if (tri_piece_flagged(w->p, i) && constrain_real(&w->r.triangle[i]) &&
		    constrain_owner_has(w, w->r.triangle[i].corner))
			w->chosen[i / 64] |= UINT64_C(1) << i % 64;
	w->c->chosen = w->chosen;
	w->c->pieces = w->npiece;
	w->c->crossed = w->nown;
	return w->c->lines->state ? constrain_out(w, &any) : 0;
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
	size_t sights = sights_of(size), discs = sights / SIGHTS_DISC, verified = sights / SIGHTS_VERIFIED;
	struct constrain_work *w;

	return align_line(sizeof(*w)) + align_line(sights * sizeof(*w->sight)) + align_line(discs * sizeof(*w->disc)) +
	       align_line(discs * HITS * sizeof(*w->hit)) + align_line(verified * sizeof(*w->verified));
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
	w->nverified = w->mostsight / SIGHTS_VERIFIED;
	w->sight = take_work(&at, w->mostsight * sizeof(*w->sight));
	w->disc = take_work(&at, w->mostdisc * sizeof(*w->disc));
	w->mosthit = w->mostdisc * HITS;
	w->hit = take_work(&at, w->mosthit * sizeof(*w->hit));
	w->verified = take_work(&at, w->nverified * sizeof(*w->verified));
	w->piece = (struct constrain_piece *)(end - bytes);
	w->point = (struct point *)((uint8_t *)c->arena + align_line(c->used));
	w->nrange = cut_region_ranges(c->region, w->range);
	cut_region_box(c->region, w->border);
	tri_result(c->tri, &w->r);
	w->first = w->r.nvertex;
	/* The kernel may have more, but that may depend on segments. */
	w->cap = (uint32_t)((c->used - tri_bytes(0)) / TRI_BYTES_PER_POINT);
	w->cap = w->cap < constrain_kernel_cap(w->first) ? w->cap : constrain_kernel_cap(w->first);
	constrain_verified_clear(w);
	*ret = w;
	return true;
}

int constrain_run(struct constrain *c, uint64_t *ret_need, struct err *err)
{
	struct constrain_work *w;
	bool again = true;
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
	for (bool first = true; !rc && again && w->npiece; first = false) {
		rc = turn(w, first, &again);
		if (!rc && again)
			rc = constrain_points_merge(w);
	}
	if (!rc && w->npiece)
		rc = choose(w);
	return rc == CONSTRAIN_E_SPLIT ? does_not_fit(w, ret_need) : rc;
}
