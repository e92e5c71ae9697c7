/*
 * Mapping a file's numbers to the lattice (lattice.h). Per axis the map is the rational (raw * a + b) / d,
 * rounded as floor(v + 1/2), which commutes with integer shifts. It grows with raw, so a batch is checked
 * by its least and largest number, and the loops run without checks. Nothing is rounded twice.
 */
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

/* coordinate = raw * fs + fo = (X + k) * ls, so X = (raw * fs + fo - k * ls) / ls; all over one power of ten.
 */
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

/* All numbers of the batch stay in range, and, if *ret_narrow, 2 * (raw * a + b) + d within 63 bits. */
static bool batch_fits(const struct lattice_map *m, const int64_t (*raw)[3], size_t n, bool *ret_narrow)
{
	int64_t lo[3], hi[3];
	__int128 off;

	memcpy(lo, raw[0], sizeof lo);
	memcpy(hi, raw[0], sizeof hi);
	for (size_t i = 1; i < n; i++) {
		for (unsigned a = 0; a < 3; a++) {
			lo[a] = raw[i][a] < lo[a] ? raw[i][a] : lo[a];
			hi[a] = raw[i][a] > hi[a] ? raw[i][a] : hi[a];
		}
	}
	*ret_narrow = true;
	for (unsigned i = 0; i < 3; i++) {
		__int128 a = m->axis[i].a, b = m->axis[i].b, d = m->axis[i].d;
		__int128 low = 2 * (lo[i] * a + b) + d, high = 2 * (hi[i] * a + b) + d, limit = (__int128)1 << 62;

		if (!in_range(map_one(a, b, d, lo[i], &off)) || !in_range(map_one(a, b, d, hi[i], &off)))
			return false;
		if (low < -limit || high > limit || d > limit / 2 || 2 * a > limit || 2 * b + d > limit || 2 * b + d < -limit)
			*ret_narrow = false;
	}
	return true;
}

/* Exact axes: numbers modulo 2^64, whose result is known to fit. */
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

static void apply_narrow(const struct lattice_map *m, const int64_t (*raw)[3], size_t n, int32_t (*ret)[3], uint64_t *moved,
			 __int128 most[3])
{
	for (size_t i = 0; i < n; i++) {
		bool rounded = false;

		for (unsigned k = 0; k < 3; k++) {
			int64_t d = (int64_t)m->axis[k].d;
			int64_t v = 2 * (raw[i][k] * (int64_t)m->axis[k].a + (int64_t)m->axis[k].b) + d;
			int64_t q = v / (2 * d), r = v % (2 * d);

			if (r < 0) {
				q--;
				r += 2 * d;
			}
			int64_t off = r < d ? d - r : r - d;

			ret[i][k] = (int32_t)q;
			rounded |= off != 0;
			if (off > most[k])
				most[k] = off;
		}
		*moved += rounded;
	}
}

static void apply_wide(const struct lattice_map *m, const int64_t (*raw)[3], size_t n, int32_t (*ret)[3], uint64_t *moved,
		       __int128 most[3])
{
	for (size_t i = 0; i < n; i++) {
		bool rounded = false;

		for (unsigned k = 0; k < 3; k++) {
			__int128 off;

			ret[i][k] = (int32_t)map_one(m->axis[k].a, m->axis[k].b, m->axis[k].d, raw[i][k], &off);
			rounded |= off != 0;
			if (off > most[k])
				most[k] = off;
		}
		*moved += rounded;
	}
}

int lattice_map_apply(const struct lattice_map *m, const int64_t (*raw)[3], size_t n, int32_t (*ret)[3], uint64_t *ret_moved,
		      double max_shift[3], size_t *ret_bad, struct err *err)
{
	__int128 most[3] = {0, 0, 0};
	bool narrow;

	if (!n)
		return 0;
	if (!batch_fits(m, raw, n, &narrow))
		return out_of_range(m, raw, n, ret_bad, err);
	if (m->axis[0].exact && m->axis[1].exact && m->axis[2].exact) {
		apply_exact(m, raw, n, ret);
		return 0;
	}
	if (narrow)
		apply_narrow(m, raw, n, ret, ret_moved, most);
	else
		apply_wide(m, raw, n, ret, ret_moved, most);
	for (unsigned k = 0; k < 3; k++) {
		double shift = (double)most[k] / (2 * (double)m->axis[k].d) * decimal_double(m->scale[k]);

		if (shift > max_shift[k])
			max_shift[k] = shift;
	}
	return 0;
}
