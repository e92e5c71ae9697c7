/*
 * Converting the numbers of a file to the lattice (lattice.h). For each axis the conversion is the rational (raw * a +
 * b) / d, rounded as floor(v + 1/2), which commutes with integer shifts. It is monotone in raw, so a batch is checked
 * by its smallest and largest number, and the loops need no checks. No number is rounded twice.
 *
 * The loops avoid division: a double gives the quotient with an error below one (estimate), and the remainder, modulo
 * 2^64, determines the exact quotient.
 */
#include <math.h>
#include <string.h>

#include "err.h"
#include "lattice.h"

/* With |a| < 2^62, |b| and d < 2^124, 2 * (raw * a + b) + d is within 128 bits for every int64. */
static const __int128 a_limit = (__int128)1 << 62, bd_limit = (__int128)1 << 124;

static bool power_up(__int128 *v, int64_t exponent)
{
	for (; exponent > 0 && *v; exponent--)
		if (__builtin_mul_overflow(*v, (__int128)10, v))
			return false;
	return true;
}

static __int128 gcd(__int128 a, __int128 b)
{
	if (a < 0)
		a = -a;
	if (b < 0)
		b = -b;
	while (b) {
		__int128 r = a % b;

		a = b;
		b = r;
	}
	return a;
}

/* coordinate = raw * fs + fo = (X + k) * ls, so X = (raw * fs + fo - k * ls) / ls; all over a common power of ten. */
static bool axis_init(struct decimal fs, struct decimal fo, struct decimal ls, int64_t k, __int128 *ret_a, __int128 *ret_b,
		      __int128 *ret_d)
{
	int64_t least = ls.exponent < fs.exponent ? ls.exponent : fs.exponent;
	__int128 a = fs.mantissa, b = fo.mantissa, d = ls.mantissa, kd;

	if (fo.mantissa && fo.exponent < least)
		least = fo.exponent;
	if (!power_up(&a, fs.exponent - least) || !power_up(&b, fo.exponent - least) || !power_up(&d, ls.exponent - least) ||
	    __builtin_mul_overflow(d, (__int128)k, &kd) || __builtin_sub_overflow(b, kd, &b))
		return false;
	__int128 g = gcd(gcd(a, d), b);

	a /= g;
	b /= g;
	d /= g;
	if (a >= a_limit || b >= bd_limit || b <= -bd_limit || d >= bd_limit)
		return false;
	*ret_a = a;
	*ret_b = b;
	*ret_d = d;
	return true;
}

int lattice_map_init(struct lattice_map *map, const struct lattice *l, const struct lattice_input *in, struct err *err)
{
	char fs[DECIMAL_TEXT_SIZE], fo[DECIMAL_TEXT_SIZE], ls[DECIMAL_TEXT_SIZE];
	struct lattice_map m;

	for (unsigned i = 0; i < 3; i++) {
		struct decimal offset = in->has_offset ? in->offset[i] : (struct decimal){0, 0};

		m.scale[i] = i < 2 ? l->scale_xy : l->scale_z;
		if (in->scale[i].mantissa <= 0 ||
		    !axis_init(in->scale[i], offset, m.scale[i], l->k[i], &m.axis[i].a, &m.axis[i].b, &m.axis[i].d)) {
			err_set(err, ERR_INPUT, "%c scale %s and offset %s cannot be brought exactly to the scale %s", "xyz"[i],
				decimal_text(in->scale[i], fs), decimal_text(offset, fo), decimal_text(m.scale[i], ls));
			err_add_hint(err, "mend the header of the file: its numbers have too many digits");
			return err_add_file(err, in->name);
		}
		m.axis[i].exact = m.axis[i].d == 1;
	}
	*map = m;
	return 0;
}

/* floor((raw * a + b) / d + 1/2), and twice the distance from the exact value in units of 1 / d. */
static __int128 map_one(__int128 a, __int128 b, __int128 d, int64_t raw, __int128 *ret_off)
{
	__int128 v = 2 * (raw * a + b) + d, q = v / (2 * d), r = v % (2 * d);

	if (r < 0) {
		q--;
		r += 2 * d;
	}
	*ret_off = r < d ? d - r : r - d;
	return q;
}

static bool in_range(__int128 v)
{
	return v >= INT32_MIN && v <= INT32_MAX;
}

static int out_of_range(const struct lattice_map *m, const int64_t (*raw)[3], size_t n, size_t *ret_bad, struct err *err)
{
	__int128 off;

	for (size_t i = 0; i < n; i++) {
		for (unsigned a = 0; a < 3; a++) {
			__int128 v = map_one(m->axis[a].a, m->axis[a].b, m->axis[a].d, raw[i][a], &off);

			if (in_range(v))
				continue;
			*ret_bad = i;
			err_set(err, ERR_LIMIT,
				"%c of a point lies %.6g beyond the middle of the lattice, which reaches "
				"%.6g",
				"xyz"[a], (double)v * decimal_double(m->scale[a]), 0x1p31 * decimal_double(m->scale[a]));
			return err_add_hint(err, "use a coarser --scale, a dataset of its own, or mend the file");
		}
	}
	return err_set(err, ERR_INTERNAL, "a point is out of range, but none was found");
}

/* For one axis: round(raw * slope + base) is the number or a neighbour; if `certain`, it is the number. */
struct estimate {
	double slope, base;
	bool serves, certain;
};

/* The error of the double is less than 10 * 2^-53 of its terms, which are below 2^45: less than 1/16. So the remainder
 * of its number is less than 9/16 d, and twice that fits int64. Exact values are multiples of 1/d, so they are either
 * halves or at least 1/2d away from one. If the error is below 1/8d, adding 1/4d puts each value on the side of the
 * half to which it is rounded. The comparisons fail for values that are not finite. */
static struct estimate estimate_of(__int128 a, __int128 b, __int128 d, int64_t lo, int64_t hi)
{
	const double slope = (double)a / (double)d, base = (double)b / (double)d;
	const double part = fmax(fabs(base), fmax(fabs((double)lo * slope), fabs((double)hi * slope)));
	struct estimate e = {slope, base, .serves = d < (__int128)1 << 61 && part < 0x1p45};

	e.certain = e.serves && (part + 1) * 0x1p-49 * (double)d < 0.125;
	if (e.certain)
		e.base += 0.25 / (double)d;
	return e;
}

/* The smallest and the largest number of each axis. A separate loop: if all axes are only shifted, it is half of the work. */
static __attribute__((noinline)) void batch_range(const int64_t (*raw)[3], size_t n, int64_t ret_lo[3], int64_t ret_hi[3])
{
	int64_t lo[3], hi[3];

	memcpy(lo, raw[0], sizeof lo);
	memcpy(hi, raw[0], sizeof hi);
	for (size_t i = 1; i < n; i++) {
		for (unsigned a = 0; a < 3; a++) {
			lo[a] = raw[i][a] < lo[a] ? raw[i][a] : lo[a];
			hi[a] = raw[i][a] > hi[a] ? raw[i][a] : hi[a];
		}
	}
	memcpy(ret_lo, lo, sizeof lo);
	memcpy(ret_hi, hi, sizeof hi);
}

/* Whether all numbers of the batch are in range. */
static bool batch_fits(const struct lattice_map *m, const int64_t (*raw)[3], size_t n, struct estimate ret[3])
{
	int64_t lo[3], hi[3];
	__int128 off;

	batch_range(raw, n, lo, hi);
	for (unsigned i = 0; i < 3; i++) {
		__int128 a = m->axis[i].a, b = m->axis[i].b, d = m->axis[i].d;

		if (!in_range(map_one(a, b, d, lo[i], &off)) || !in_range(map_one(a, b, d, hi[i], &off)))
			return false;
		ret[i] = estimate_of(a, b, d, lo[i], hi[i]);
	}
	return true;
}

/* Exact axes: numbers modulo 2^64; the results are known to fit. */
static void apply_exact(const struct lattice_map *m, const int64_t (*restrict raw)[3], size_t n, int32_t (*restrict ret)[3])
{
	const uint64_t a[3] = {(uint64_t)m->axis[0].a, (uint64_t)m->axis[1].a, (uint64_t)m->axis[2].a};
	const uint64_t b[3] = {(uint64_t)m->axis[0].b, (uint64_t)m->axis[1].b, (uint64_t)m->axis[2].b};

	if (a[0] == 1 && a[1] == 1 && a[2] == 1) {
		const uint32_t s[3] = {(uint32_t)b[0], (uint32_t)b[1], (uint32_t)b[2]};

		for (size_t i = 0; i < n; i++) {
			ret[i][0] = (int32_t)((uint32_t)raw[i][0] + s[0]);
			ret[i][1] = (int32_t)((uint32_t)raw[i][1] + s[1]);
			ret[i][2] = (int32_t)((uint32_t)raw[i][2] + s[2]);
		}
		return;
	}
	for (size_t i = 0; i < n; i++)
		for (unsigned k = 0; k < 3; k++)
			ret[i][k] = (int32_t)(uint32_t)((uint64_t)raw[i][k] * a[k] + b[k]);
}

enum { BLOCK = 256 };

static uint64_t bits_of(double x)
{
	uint64_t bits;

	memcpy(&bits, &x, sizeof bits);
	return bits;
}

/* One axis of a block; sets moved[i] if a number is rounded. Returns the largest distance, as in map_one. */
static inline __attribute__((always_inline)) uint64_t round_axis(const struct lattice_map *m, const struct estimate *e,
								 unsigned k, bool certain, const int64_t (*restrict raw)[3],
								 size_t n, int32_t (*restrict ret)[3], uint8_t *restrict moved)
{
	/* added to a double below 2^51, this makes the last bit a one: the bits of the sum then count whole numbers */
	const double slope = e->slope, base = e->base, whole = 0x1.8p52;
	const uint64_t zero = bits_of(whole), a = (uint64_t)m->axis[k].a, b = (uint64_t)m->axis[k].b;
	const int64_t d = (int64_t)m->axis[k].d;
	int64_t low = 0, high = 0;

	for (size_t i = 0; i < n; i++) {
		int64_t q = (int64_t)(bits_of(((double)raw[i][k] * slope + base) + whole) - zero);
		int64_t t = (int64_t)((uint64_t)raw[i][k] * a + b - (uint64_t)q * (uint64_t)d);

		if (!certain) {
			int64_t up = 2 * t >= d, down = 2 * t < -d;

			q += up - down;
			t += (down - up) * d;
		}
		ret[i][k] = (int32_t)q;
		moved[i] |= t != 0;
		low = t < low ? t : low;
		high = t > high ? t : high;
	}
	return 2 * (uint64_t)(high > -low ? high : -low);
}

static uint64_t round_axis_certain(const struct lattice_map *m, const struct estimate *e, unsigned k, const int64_t (*raw)[3],
				   size_t n, int32_t (*ret)[3], uint8_t *moved)
{
	return round_axis(m, e, k, true, raw, n, ret, moved);
}

static uint64_t round_axis_near(const struct lattice_map *m, const struct estimate *e, unsigned k, const int64_t (*raw)[3],
				size_t n, int32_t (*ret)[3], uint8_t *moved)
{
	return round_axis(m, e, k, false, raw, n, ret, moved);
}

static __int128 round_axis_wide(const struct lattice_map *m, unsigned k, const int64_t (*raw)[3], size_t n, int32_t (*ret)[3],
				uint8_t *moved)
{
	__int128 most = 0, off;

	for (size_t i = 0; i < n; i++) {
		ret[i][k] = (int32_t)map_one(m->axis[k].a, m->axis[k].b, m->axis[k].d, raw[i][k], &off);
		moved[i] |= off != 0;
		if (off > most)
			most = off;
	}
	return most;
}

/* An axis whose numbers are all whole, or all have the same fraction. */
static __int128 shift_axis(const struct lattice_map *m, unsigned k, const int64_t (*restrict raw)[3], size_t n,
			   int32_t (*restrict ret)[3], uint8_t *restrict moved)
{
	__int128 off;
	const uint64_t b = (uint64_t)map_one(0, m->axis[k].b, m->axis[k].d, 0, &off), a = (uint64_t)(m->axis[k].a / m->axis[k].d);

	for (size_t i = 0; i < n; i++)
		ret[i][k] = (int32_t)(uint32_t)((uint64_t)raw[i][k] * a + b);
	if (off)
		memset(moved, 1, n);
	return off;
}

static void apply_rounding(const struct lattice_map *m, const struct estimate e[3], const int64_t (*raw)[3], size_t n,
			   int32_t (*ret)[3], uint64_t *ret_moved, __int128 most[3])
{
	for (size_t at = 0; at < n; at += BLOCK) {
		size_t part = n - at < BLOCK ? n - at : BLOCK;
		uint8_t moved[BLOCK] = {0};

		for (unsigned k = 0; k < 3; k++) {
			__int128 off;

			if (m->axis[k].a % m->axis[k].d == 0)
				off = shift_axis(m, k, raw + at, part, ret + at, moved);
			else if (e[k].certain)
				off = round_axis_certain(m, &e[k], k, raw + at, part, ret + at, moved);
			else if (e[k].serves)
				off = round_axis_near(m, &e[k], k, raw + at, part, ret + at, moved);
			else
				off = round_axis_wide(m, k, raw + at, part, ret + at, moved);
			most[k] = off > most[k] ? off : most[k];
		}
		for (size_t i = 0; i < part; i++)
			*ret_moved += moved[i];
	}
}

int lattice_map_apply(const struct lattice_map *m, const int64_t (*raw)[3], size_t n, int32_t (*ret)[3], uint64_t *ret_moved,
		      double max_shift[3], size_t *ret_bad, struct err *err)
{
	__int128 most[3] = {0, 0, 0};
	struct estimate e[3];

	if (!n)
		return 0;
	if (!batch_fits(m, raw, n, e))
		return out_of_range(m, raw, n, ret_bad, err);
	if (m->axis[0].exact && m->axis[1].exact && m->axis[2].exact) {
		apply_exact(m, raw, n, ret);
		return 0;
	}
	apply_rounding(m, e, raw, n, ret, ret_moved, most);
	for (unsigned k = 0; k < 3; k++) {
		double shift = (double)most[k] / (2 * (double)m->axis[k].d) * decimal_double(m->scale[k]);

		if (shift > max_shift[k])
			max_shift[k] = shift;
	}
	return 0;
}
