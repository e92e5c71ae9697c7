/*
 * Regions: dyadic boxes of the lattice, infinite on the sides that are on the root's border.
 *
 * Numbers are lattice numbers + 2^31, so a region is [x, x + 2^wx) x [y, y + 2^wy) of uint32. A square is halved along
 * x first, so a region is a square or twice as high as wide. Every region is one aligned range of Morton keys, except a
 * few near a root that straddles a cut. Borders are between lattice numbers (odd when doubled), so no point is ever on
 * one. Infinite sides are flags and not large numbers, because circumcentres of lattice triangles are up to 2^97 away.
 */
#include "cut_owner.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "geom.h"
#include "point.h"

#define BIAS ((int64_t)1 << 31)
/* The margin of a root on each side of the data, as a fraction of their longer side. */
enum { ROOM = 8 };

static char *put_number(char *at, uint32_t v)
{
	char digit[10];
	unsigned n = 0;

	do
		digit[n++] = (char)('0' + v % 10);
	while (v /= 10);
	while (n)
		*at++ = digit[--n];
	return at;
}

/* A plan formats each leaf several times, and printf would take ten times as long. */
char *cut_region_text(const struct cut_region *r, char buf[CUT_REGION_TEXT_SIZE])
{
	const uint32_t number[5] = {r->x, r->y, r->wx, r->wy, r->inf};
	char *at = buf;

	for (unsigned i = 0; i < 5; i++) {
		at = put_number(at, number[i]);
		*at++ = i < 4 ? ':' : 0;
	}
	return buf;
}

static bool aligned(uint32_t v, unsigned w)
{
	return w >= 32 ? v == 0 : (v & (((uint32_t)1 << w) - 1)) == 0;
}

/* Whether a side of the box is valid on one axis: aligned, or (only with both sides infinite) two aligned halves. */
static bool axis_valid(uint32_t v, unsigned w, bool both_infinite)
{
	if (w > 32 || (uint64_t)v + ((uint64_t)1 << w) > (uint64_t)1 << 32)
		return false;
	return aligned(v, w) || (both_infinite && w > 0 && aligned(v, w - 1));
}

bool cut_region_parse(const char *text, struct cut_region *ret)
{
	struct cut_region r;
	uint32_t wx, wy, inf;
	char back[CUT_REGION_TEXT_SIZE];

	if (strlen(text) >= CUT_REGION_TEXT_SIZE ||
	    sscanf(text, "%" SCNu32 ":%" SCNu32 ":%" SCNu32 ":%" SCNu32 ":%" SCNu32, &r.x, &r.y, &wx, &wy, &inf) != 5)
		return false;
	if (wx > 32 || wy > 32 || inf > 15 || (wy != wx && wy != wx + 1))
		return false;
	r.wx = (uint8_t)wx;
	r.wy = (uint8_t)wy;
	r.inf = (uint8_t)inf;
	if (!axis_valid(r.x, wx, (inf & 3) == 3) || !axis_valid(r.y, wy, (inf & 12) == 12))
		return false;
	/* Only the canonical spelling: blanks, signs, leading zeros and trailing text do not match. */
	if (strcmp(cut_region_text(&r, back), text) != 0)
		return false;
	*ret = r;
	return true;
}

void cut_region_box(const struct cut_region *r, int64_t ret[4])
{
	int64_t x = (int64_t)r->x - BIAS, y = (int64_t)r->y - BIAS;

	ret[0] = r->inf & CUT_INF_X0 ? INT64_MIN : 2 * x - 1;
	ret[1] = r->inf & CUT_INF_Y0 ? INT64_MIN : 2 * y - 1;
	ret[2] = r->inf & CUT_INF_X1 ? INT64_MAX : 2 * (x + ((int64_t)1 << r->wx)) - 1;
	ret[3] = r->inf & CUT_INF_Y1 ? INT64_MAX : 2 * (y + ((int64_t)1 << r->wy)) - 1;
}

/* The lower corner, on one axis, of the block of side 2^(w + 1) that starts at a multiple of 2^w. If both ends are in
 * one square of side 2^w, the aligned pair is taken, which never leaves the lattice. */
static uint32_t block_start(uint32_t lo, uint32_t hi, unsigned w)
{
	uint32_t a = lo >> w, b = hi >> w;

	return (a == b ? a & ~(uint32_t)1 : a) << w;
}

static uint32_t less(uint32_t at, uint32_t by)
{
	return at > by ? at - by : 0;
}

static uint32_t more(uint32_t at, uint32_t by)
{
	return at < UINT32_MAX - by ? at + by : UINT32_MAX;
}

/*
 * The margin around the box gives empty regions. A region at the root's side is infinite there, and its borders would
 * see all of the hull: new points at one end of a survey would change full regions at the other end. With a margin,
 * full regions have finite sides, which also stay the same when the survey outgrows its root.
 */
void cut_region_root(const int32_t box[4], struct cut_region *ret)
{
	uint32_t x0 = (uint32_t)(box[0] + BIAS), y0 = (uint32_t)(box[1] + BIAS);
	uint32_t x1 = (uint32_t)(box[2] + BIAS), y1 = (uint32_t)(box[3] + BIAS);
	uint32_t room;
	unsigned w = 0;

	ret->inf = CUT_INF_X0 | CUT_INF_X1 | CUT_INF_Y0 | CUT_INF_Y1;
	if (x0 == x1 && y0 == y1) {
		ret->x = x0;
		ret->y = y0;
		ret->wx = ret->wy = 0;
		return;
	}
	room = (x1 - x0 > y1 - y0 ? x1 - x0 : y1 - y0) / ROOM + 1;
	x0 = less(x0, room);
	y0 = less(y0, room);
	x1 = more(x1, room);
	y1 = more(y1, room);
	while ((x1 >> w) - (x0 >> w) > 1 || (y1 >> w) - (y0 >> w) > 1)
		w++;
	ret->x = block_start(x0, x1, w);
	ret->y = block_start(y0, y1, w);
	ret->wx = ret->wy = (uint8_t)(w + 1);
}

bool cut_region_split(const struct cut_region *r, struct cut_region ret[2])
{
	struct cut_region a = *r, b = *r;

	if (r->wx == 0 && r->wy == 0)
		return false;
	if (r->wx == r->wy) {
		a.wx = b.wx = (uint8_t)(r->wx - 1);
		b.x += (uint32_t)1 << a.wx;
		a.inf &= (uint8_t)~CUT_INF_X1;
		b.inf &= (uint8_t)~CUT_INF_X0;
	} else {
		a.wy = b.wy = (uint8_t)(r->wy - 1);
		b.y += (uint32_t)1 << a.wy;
		a.inf &= (uint8_t)~CUT_INF_Y1;
		b.inf &= (uint8_t)~CUT_INF_Y0;
	}
	ret[0] = a;
	ret[1] = b;
	return true;
}

size_t cut_region_above(const struct cut_region *root, const struct cut_region *r, struct cut_region *ret, size_t most)
{
	int32_t x = (int32_t)((int64_t)r->x - BIAS), y = (int32_t)((int64_t)r->y - BIAS);
	struct cut_region at = *root, half[2];
	size_t n = 0;

	while (most && !cut_region_same(&at, r) && cut_region_split(&at, half)) {
		n += n < most;
		memmove(ret + 1, ret, (n - 1) * sizeof *ret);
		ret[0] = at;
		at = half[cut_region_holds(&half[1], x, y)];
	}
	return cut_region_same(&at, r) ? n : 0;
}

static unsigned add_ranges(const struct cut_region *r, struct cut_range *ret)
{
	struct cut_region half[2];
	unsigned n;

	if (aligned(r->x, r->wx) && aligned(r->y, r->wy)) {
		unsigned bits = (unsigned)r->wx + r->wy;
		uint64_t span = bits >= 64 ? UINT64_MAX : ((uint64_t)1 << bits) - 1;

		ret->lo = point_morton((int32_t)((int64_t)r->x - BIAS), (int32_t)((int64_t)r->y - BIAS));
		ret->hi = ret->lo + span;
		return 1;
	}
	if (!cut_region_split(r, half))
		return 0; /* side 1 is always aligned */
	n = add_ranges(&half[0], ret);
	return n + add_ranges(&half[1], ret + n);
}

unsigned cut_region_ranges(const struct cut_region *r, struct cut_range ret[4])
{
	unsigned n = add_ranges(r, ret), k = 0;

	/* The quarters of a block that straddles a cut are not in the order of their keys. */
	for (unsigned i = 1; i < n; i++)
		for (unsigned j = i; j > 0 && ret[j].lo < ret[j - 1].lo; j--) {
			struct cut_range t = ret[j];

			ret[j] = ret[j - 1];
			ret[j - 1] = t;
		}
	for (unsigned i = 1; i < n; i++) {
		if (ret[i].lo == ret[k].hi + 1)
			ret[k].hi = ret[i].hi;
		else
			ret[++k] = ret[i];
	}
	return k + 1;
}

bool cut_region_holds(const struct cut_region *r, int32_t x, int32_t y)
{
	uint32_t dx = (uint32_t)(x + BIAS) - r->x, dy = (uint32_t)(y + BIAS) - r->y;

	/* Left of or below the corner the difference wraps to 2^32 - d, which is beyond the width because the box ends
	 * within 2^32. */
	return (uint64_t)dx >> r->wx == 0 && (uint64_t)dy >> r->wy == 0;
}

/*
 * The circumcentre minus the border, times the doubled area, in doubles: numerators without the border, and bounds of
 * their absolute products. The differences are exact. Every product and sum below has at most seven roundings, so the
 * error is never more than 4e-15 times the absolute products.
 */
struct centre {
	double n[2], nabs[2], area, area_abs;
};

static void centre_of(const int32_t a[2], const int32_t b[2], const int32_t c[2], struct centre *ret)
{
	double bx = (double)b[0] - a[0], by = (double)b[1] - a[1];
	double cx = (double)c[0] - a[0], cy = (double)c[1] - a[1];
	double bz = bx * bx + by * by, cz = cx * cx + cy * cy;

	ret->n[0] = bz * cy - cz * by;
	ret->nabs[0] = bz * fabs(cy) + cz * fabs(by);
	ret->n[1] = cz * bx - bz * cx;
	ret->nabs[1] = cz * fabs(bx) + bz * fabs(cx);
	ret->area = bx * cy - by * cx;
	ret->area_abs = fabs(bx * cy) + fabs(by * cx);
}

bool cut_region_owns(const struct cut_region *r, const int32_t a[2], const int32_t b[2], const int32_t c[2])
{
	struct centre o;
	int64_t box[4];

	cut_region_box(r, box);
	centre_of(a, b, c, &o);
	for (unsigned side = 0; side < 4; side++) {
		int64_t border = box[side];
		unsigned axis = side & 1;
		double off, value, error;
		bool upper;

		if (border == INT64_MIN || border == INT64_MAX)
			continue;
		off = (double)(2 * (int64_t)a[axis] - border);
		value = o.n[axis] + o.area * off;
		error = 4e-15 * (o.nabs[axis] + o.area_abs * fabs(off));
		if (value > error || value < -error)
			upper = value > 0;
		else
			upper = geom_cut_side(a, b, c, border, axis == 0) > 0;
		if (upper != (side < 2))
			return false;
	}
	return true;
}

/*
 * The ray is the Voronoi edge of a and b, so the theorem of algorithm.md 3 holds at its end, too: the region that owns
 * that end has loaded a and b, and whatever would be beyond their edge.
 */
bool cut_region_owns_hull(const struct cut_region *r, const int32_t a[2], const int32_t b[2])
{
	int64_t box[4], to[2] = {(int64_t)a[1] - b[1], (int64_t)b[0] - a[0]};

	cut_region_box(r, box);
	for (unsigned axis = 0; axis < 2; axis++) {
		int64_t lower = box[axis], upper = box[axis + 2], middle = (int64_t)a[axis] + b[axis];

		if (to[axis] > 0 ? upper != INT64_MAX : to[axis] < 0 && lower != INT64_MIN)
			return false;
		/* INT64_MIN and INT64_MAX are beyond any midpoint. */
		if (!to[axis] && (middle <= lower || middle > upper))
			return false;
	}
	return true;
}

void cut_owner_init(struct cut_owner *o, const struct cut_region *r)
{
	/* Farther than any border of the lattice (2^32 doubled) is from any point of it. */
	const double far = 0x1p36;
	int64_t box[4];

	cut_region_box(r, box);
	o->region = r;
	for (unsigned i = 0; i < 2; i++) {
		o->low[i] = box[i] == INT64_MIN ? -far : (double)box[i];
		o->high[i] = box[2 + i] == INT64_MAX ? far : (double)box[2 + i];
	}
}
