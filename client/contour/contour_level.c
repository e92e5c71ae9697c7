/*
 * Levels in lattice numbers, and the crossings of edges.
 *
 * interval / (scale * unit) and the base are fractions of whole numbers, brought to one denominator q. So whether a vertex is at
 * a level or above is one division of whole numbers a vertex, and every comparison afterwards is one of whole numbers.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "contour_priv.h"
#include "err.h"
#include "wide.h"

typedef contour_i128 i128;
typedef unsigned __int128 u128;

#define Q_MOST ((i128)1 << 28) /* so that q times a lattice number fits 60 bits */
#define P_MOST ((i128)1 << 60)
#define SHIFT_MOST ((i128)1 << 61)
#define DIVISOR_MOST ((i128)1 << 60)
#define PART_MOST ((i128)1 << 118)

enum { DECIMALS_LEAST = 6, DECIMALS_MOST = 12 }; /* of converted heights: text has no exponent */

struct fraction {
	i128 n, d;
};

static void reduce(struct fraction *f)
{
	i128 g = wide_gcd(f->n, f->d);

	if (g > 1) {
		f->n /= g;
		f->d /= g;
	}
}

/* f * n / d * 10^e; false: it does not fit. */
static bool times(struct fraction *f, int64_t n, int64_t d, int e)
{
	struct fraction by = {n, d};

	reduce(&by);
	reduce(f);
	if (__builtin_mul_overflow(f->n, by.n, &f->n) || __builtin_mul_overflow(f->d, by.d, &f->d))
		return false;
	reduce(f);
	for (; e && f->n; e -= e > 0 ? 1 : -1) {
		if (f->n > PART_MOST || f->n < -PART_MOST || f->d > PART_MOST)
			return false;
		*(e > 0 ? &f->n : &f->d) *= 10;
		reduce(f);
	}
	return f->n < PART_MOST && f->n > -PART_MOST && f->d < PART_MOST;
}

/* The length over the height of a lattice step. */
static bool in_steps(const struct contour_length *l, struct decimal scale, const struct contour_options *o, struct fraction *ret)
{
	*ret = (struct fraction){l->value.mantissa, 1};
	return times(ret, l->num, l->den, l->value.exponent) && times(ret, o->z_den, o->z_num, -scale.exponent) &&
	       times(ret, 1, scale.mantissa, 0);
}

/* Heights of levels as they are written. */
static bool heights_init(struct contour_levels *l, const struct contour_options *o)
{
	struct decimal base = o->base.value, interval = o->interval.value;
	struct fraction i = {interval.mantissa, 1}, b = {base.mantissa, 1};

	l->decimal = o->interval.num == o->interval.den && (o->base.num == o->base.den || !base.mantissa);
	l->decimals = DECIMALS_LEAST;
	l->exponent = base.mantissa && base.exponent < interval.exponent ? base.exponent : interval.exponent;
	l->interval = interval.mantissa;
	l->base = base.mantissa;
	for (int e = interval.exponent; l->decimal && e > l->exponent; e--)
		l->decimal = !__builtin_mul_overflow(l->interval, 10, &l->interval);
	for (int e = base.exponent; l->decimal && l->base && e > l->exponent; e--)
		l->decimal = !__builtin_mul_overflow(l->base, 10, &l->base);
	if (l->decimal)
		return true;
	if (!times(&i, o->interval.num, o->interval.den, interval.exponent) ||
	    !times(&b, o->base.num, o->base.den, base.exponent))
		return false;
	if (__builtin_mul_overflow(i.d / wide_gcd(i.d, b.d), b.d, &l->den) || l->den >= DIVISOR_MOST ||
	    __builtin_mul_overflow(l->den / i.d, i.n, &l->interval_n) || __builtin_mul_overflow(l->den / b.d, b.n, &l->base_n))
		return false;
	for (double step = (double)l->interval_n / (double)l->den, ten = 1e6; l->decimals < DECIMALS_MOST && step * ten < 100;
	     ten *= 10)
		l->decimals++;
	return l->interval_n < P_MOST && l->base_n < PART_MOST && l->base_n > -PART_MOST;
}

static int too_fine(const struct acut_mesh_head *head, struct err *err)
{
	err_set(err, ERR_USAGE, "--interval or --base is too large, or has too many digits beside the scale %s of z",
		head->scale_z);
	return err_add_hint(err, "give them with fewer digits, or as multiples of the scale");
}

int contour_levels_init(struct contour_levels *l, const struct acut_mesh_head *head, const struct contour_options *o,
			struct err *err)
{
	struct fraction interval, base;
	struct decimal scale;
	i128 q, p, r, shift;

	*l = (struct contour_levels){0};
	if (!decimal_parse(head->scale_z, &scale) || scale.mantissa <= 0 || abs(scale.exponent) > 40)
		return err_set(err, ERR_PROTO, "the stream's z scale is not a number above zero");
	if (o->interval.value.mantissa <= 0)
		return err_set(err, ERR_USAGE, "--interval is not a length above zero");
	if (!in_steps(&o->interval, scale, o, &interval) || !in_steps(&o->base, scale, o, &base) || !heights_init(l, o))
		return too_fine(head, err);
	if (interval.d >= Q_MOST || base.d >= Q_MOST)
		return too_fine(head, err);
	q = interval.d / wide_gcd(interval.d, base.d) * base.d;
	if (q >= Q_MOST || __builtin_mul_overflow(q / interval.d, interval.n, &p) || p >= P_MOST || base.n > (i128)1 << 90 ||
	    base.n < -((i128)1 << 90))
		return too_fine(head, err);
	r = q / base.d * base.n - (i128)head->k[2] * q;
	shift = wide_floor(r, p);
	if (shift > SHIFT_MOST || shift < -SHIFT_MOST)
		return too_fine(head, err);
	l->p = (int64_t)p;
	l->inverse = 1 / (double)l->p;
	l->q = (int64_t)q;
	l->r = (int64_t)(r - shift * p);
	l->shift = (int64_t)shift;
	return 0;
}

static struct decimal height_of(const struct contour_levels *l, int64_t level)
{
	i128 n = (i128)level * l->interval + l->base;
	double ten = pow(10, l->decimals), v;
	struct decimal d = {0, 0};

	if (l->decimal && (int64_t)n == n)
		return (struct decimal){(int64_t)n, l->exponent};
	v = l->decimal ? (double)n * pow(10, l->exponent) : contour_nearest(level * l->interval_n + l->base_n, l->den);
	if (!l->decimal && fabs(v) < 9e15 / ten)
		return (struct decimal){llrint(v * ten), -l->decimals};
	decimal_from_double(v, &d);
	return d;
}

double contour_height(const struct contour *c, int64_t level)
{
	return decimal_double(height_of(&c->levels, level));
}

char *contour_height_text(const struct contour *c, int64_t level, char buf[DECIMAL_TEXT_SIZE])
{
	struct decimal d = height_of(&c->levels, level);

	while (d.mantissa && d.mantissa % 10 == 0) {
		d.mantissa /= 10;
		d.exponent++;
	}
	d.exponent = d.mantissa ? d.exponent : 0;
	return decimal_text(d, buf);
}

/* ---- crossings ---- */

double contour_nearest(i128 n, i128 d)
{
	u128 size = n < 0 ? -(u128)n : (u128)n, quotient;
	int shift = 0;
	double v;

	if (size < (u128)1 << 53 && d < (i128)1 << 53)
		return (double)(int64_t)n / (double)(int64_t)d;
	if (!n)
		return 0;
	shift = (size >> 64 ? __builtin_clzll((uint64_t)(size >> 64)) : 64 + __builtin_clzll((uint64_t)size)) - 1;
	size = shift > 0 ? size << shift : size;
	shift = shift > 0 ? shift : 0;
	/* At least 66 bits, so that the last one can represent all lower ones. */
	quotient = size / (u128)d;
	quotient |= size % (u128)d != 0;
	v = ldexp((double)quotient, -shift);
	return n < 0 ? -v : v;
}

struct contour_crossing contour_cross(const struct contour_levels *l, const int32_t *a, const int32_t *b, int64_t level)
{
	struct contour_crossing c = {.end = {contour_key(a), contour_key(b)}};
	int32_t from = a[2], to = b[2];

	if (c.end[0] > c.end[1]) {
		c.end[0] = contour_key(b);
		c.end[1] = contour_key(a);
		from = b[2];
		to = a[2];
	}
	c.n = level * l->p + l->r - from * l->q;
	c.d = ((int64_t)to - from) * l->q;
	if (c.d < 0) {
		c.n = -c.n;
		c.d = -c.d;
	}
	return c;
}

static i128 divisor(i128 d, int e)
{
	for (; e < 0 && d < DIVISOR_MOST; e++)
		d *= 10;
	return d;
}

/* (from + (to - from) * n / d) as a coordinate. */
static double place(const struct contour_axis *x, int32_t from, int32_t to, int64_t n, int64_t d)
{
	i128 q, sum;

	if (x->whole && x->e <= 0) {
		q = divisor(d, x->e);
		if (q >= DIVISOR_MOST && d > 1) {
			int64_t g = (int64_t)wide_gcd(n, d);

			n /= g;
			d /= g;
			q = divisor(d, x->e);
		}
		sum = (i128)(from * x->a + x->b) * d + (i128)(((int64_t)to - from) * x->a) * n;
		if (q < DIVISOR_MOST)
			return contour_nearest(sum, q);
	}
	return contour_between(x, from + ((double)to - from) * ((double)n / (double)d));
}

void contour_place(const struct contour_axis axis[2], const struct contour_crossing *c, double ret[2])
{
	ret[0] = place(&axis[0], contour_key_x(c->end[0]), contour_key_x(c->end[1]), c->n, c->d);
	ret[1] = place(&axis[1], contour_key_y(c->end[0]), contour_key_y(c->end[1]), c->n, c->d);
}

double contour_border(const struct contour_axis *x, i128 n, int64_t q)
{
	i128 sum, more, d = x->whole && x->e <= 0 ? divisor(q, x->e) : DIVISOR_MOST;

	if (d < DIVISOR_MOST && !__builtin_mul_overflow(n, x->a, &sum) && !__builtin_mul_overflow((i128)x->b, q, &more) &&
	    !__builtin_add_overflow(sum, more, &sum))
		return contour_nearest(sum, d);
	return contour_between(x, contour_nearest(n, q));
}

double contour_between(const struct contour_axis *x, double number)
{
	double low = floor(number), part = number - low;
	double from = x->whole ? decimal_scaled_double((struct decimal){1, x->e}, (int64_t)low * x->a + x->b) :
				 decimal_scaled_double(x->scale, (int64_t)low + x->k);

	return from + part * (x->whole ? decimal_scaled_double((struct decimal){1, x->e}, x->a) : decimal_double(x->scale));
}
