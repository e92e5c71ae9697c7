/*
 * Queries by box: pieces, their number, sums (lineset.h). All are one descent of the tree of boxes.
 */
#include <string.h>

#include "err.h"
#include "geom.h"
#include "lineset_file.h"

static bool box_in(const int32_t inner[4], const int32_t outer[4])
{
	return inner[0] >= outer[0] && inner[1] >= outer[1] && inner[2] <= outer[2] && inner[3] <= outer[3];
}

bool lineset_meets(const struct lineset_piece *p, const int32_t box[4])
{
	bool up = p->b[1] >= p->a[1];
	const int32_t own[4] = {p->a[0], up ? p->a[1] : p->b[1], p->b[0], up ? p->b[1] : p->a[1]};
	/* The corners that are farthest to either side of the line. */
	const int32_t left[2] = {up ? box[0] : box[2], box[3]}, right[2] = {up ? box[2] : box[0], box[1]};

	if (!lineset_boxes_meet(own, box))
		return false;
	return box_in(own, box) || (geom_orient(p->a, p->b, left) >= 0 && geom_orient(p->a, p->b, right) <= 0);
}

static int visit_page(struct lineset_reader *r, const struct lineset_visit *v, unsigned level, uint64_t i, uint64_t check,
		      struct err *err)
{
	const struct lineset_page *p;
	int rc = lineset_page(r, level, i, check, &p, err);

	for (unsigned k = 0; rc == 0 && k < p->entries; k++) {
		if (!level) {
			const struct lineset_piece *piece = &lineset_page_pieces(p)[k];

			/* Most pieces of a page are beside the box. */
			if (piece->a[0] <= v->box[2] && piece->b[0] >= v->box[0] && (!v->turns || (piece->turns & v->turns)) &&
			    lineset_meets(piece, v->box))
				rc = v->piece(v->ctx, piece, err);
		} else {
			const struct lineset_inner *e = &lineset_page_inner(p)[k];

			if (lineset_boxes_meet(e->box, v->box) && (!v->turns || (e->turns & v->turns)) &&
			    (!v->inner || !v->inner(v->ctx, e)))
				rc = visit_page(r, v, level - 1, i * LINESET_ENTRIES + k, e->check, err);
		}
	}
	return rc;
}

int lineset_visit(struct lineset_reader *r, const struct lineset_visit *v, struct err *err)
{
	const struct lineset *s = r->set;

	if (!s->shape.height || !lineset_boxes_meet(s->info.box, v->box))
		return 0;
	return visit_page(r, v, s->shape.height - 1, 0, s->root_check, err);
}

int lineset_find(struct lineset_reader *r, const int32_t box[4], lineset_piece_fn piece, void *ctx, struct err *err)
{
	const struct lineset_visit v = {.box = {box[0], box[1], box[2], box[3]}, .piece = piece, .ctx = ctx};

	return lineset_visit(r, &v, err);
}

/* ---- count ---- */

struct count {
	uint64_t most, n;
};

static int count_piece(void *ctx, const struct lineset_piece *p, struct err *err)
{
	struct count *c = ctx;

	return ++c->n >= c->most;
}

int lineset_count(struct lineset_reader *r, const int32_t box[4], uint64_t most, uint64_t *ret, struct err *err)
{
	struct count c = {.most = most};
	int rc = most ? lineset_find(r, box, count_piece, &c, err) : 0;

	if (rc < 0)
		return rc;
	*ret = c.n;
	return 0;
}

/* ---- sums ---- */

struct sum {
	struct digest sum;
	int32_t box[4];
};

static bool sum_inner(void *ctx, const struct lineset_inner *e)
{
	struct sum *s = ctx;

	if (!box_in(e->box, s->box))
		return false;
	digest_add(&s->sum, (struct digest){e->sum_hi, e->sum_lo});
	return true;
}

static int sum_piece(void *ctx, const struct lineset_piece *p, struct err *err)
{
	struct sum *s = ctx;

	digest_add(&s->sum, lineset_piece_sum(p));
	return 0;
}

/* The corner takes part: states of two boxes that are exchanged must not give the same sum of both. */
static struct digest state_sum(const int32_t at[2], unsigned state)
{
	const int32_t all[3] = {at[0], at[1], (int32_t)state};

	return state ? digest_hash(all, sizeof all) : (struct digest){0, 0};
}

/* A box on all sides of which `clear` is added. */
static void widen(const int32_t box[4], int64_t clear, int32_t ret[4])
{
	for (unsigned k = 0; k < 2; k++) {
		int64_t low = box[k] - clear, high = box[k + 2] + clear;

		ret[k] = (int32_t)(low < INT32_MIN ? INT32_MIN : low);
		ret[k + 2] = (int32_t)(high > INT32_MAX ? INT32_MAX : high);
	}
}

static int sum_near(struct lineset_reader *r, const int32_t box[4], int64_t clear, struct digest *ret, struct err *err)
{
	struct sum s = {{0, 0}, {0}};
	struct lineset_visit v = {.inner = sum_inner, .piece = sum_piece, .ctx = &s};
	unsigned state;
	int rc = lineset_state(r, box[0], box[1], 1, &state, err);

	widen(box, clear, v.box);
	memcpy(s.box, v.box, sizeof s.box);
	if (rc == 0)
		rc = lineset_visit(r, &v, err);
	if (rc)
		return rc;
	digest_add(&s.sum, state_sum(box, state));
	*ret = s.sum;
	return 0;
}

int lineset_sum(struct lineset_reader *r, const int32_t box[4], struct digest *ret, struct err *err)
{
	return sum_near(r, box, 0, ret, err);
}

/* The box of the aligned cell of 2^bits keys from `lo` on. */
static void cell_box(uint64_t lo, unsigned bits, int32_t box[4])
{
	point_from_morton(lo, &box[0], &box[1]);
	point_from_morton(bits >= 64 ? UINT64_MAX : lo + ((uint64_t)1 << bits) - 1, &box[2], &box[3]);
}

/* The largest cell that begins at `lo` and ends at `hi` or before. */
static unsigned cell_bits(uint64_t lo, uint64_t hi)
{
	unsigned bits = lo ? (unsigned)__builtin_ctzll(lo) : 64;
	uint64_t keys = hi - lo;

	if (keys != UINT64_MAX && bits > 63u - (unsigned)__builtin_clzll(keys + 1))
		bits = 63u - (unsigned)__builtin_clzll(keys + 1);
	return bits;
}

/* Whether no piece meets the least aligned cell that has both keys, widened, and its state is 0: then that is so of all cells in
 * it. */
static int range_is_empty(struct lineset_reader *r, uint64_t lo, uint64_t hi, int64_t clear, bool *ret, struct err *err)
{
	unsigned bits = lo == hi ? 0 : 64 - (unsigned)__builtin_clzll(lo ^ hi), state = 0;
	int32_t box[4], near[4];
	uint64_t n;
	int rc;

	cell_box(bits >= 64 ? 0 : lo & ~(((uint64_t)1 << bits) - 1), bits, box);
	widen(box, clear, near);
	rc = lineset_count(r, near, 1, &n, err);
	if (rc == 0 && n == 0)
		rc = lineset_state(r, box[0], box[1], 1, &state, err);
	if (rc == 0)
		*ret = n == 0 && state == 0;
	return rc;
}

int lineset_sum_range(struct lineset_reader *r, uint64_t lo, uint64_t hi, int64_t clear, struct digest *ret, struct err *err)
{
	struct digest sum = {0, 0}, part;
	bool empty = lo > hi;
	int rc = empty ? 0 : range_is_empty(r, lo, hi, clear, &empty, err);

	for (unsigned bits; rc == 0 && !empty; lo += (uint64_t)1 << bits) {
		int32_t box[4];

		bits = cell_bits(lo, hi);
		cell_box(lo, bits, box);
		rc = sum_near(r, box, clear, &part, err);
		if (rc == 0)
			digest_add(&sum, part);
		if (bits >= 64 || lo + (((uint64_t)1 << bits) - 1) == hi)
			break;
	}
	if (rc == 0)
		*ret = sum;
	return rc;
}
