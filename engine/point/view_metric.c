/*
 * Metrics (view_metric.h). Numbers: P, Q and K are below 2^14, positions within 2^33, so mapped numbers are within 2^62, and the
 * products on the way back within 2^89, in 128 bits.
 */
#include "view_metric.h"

#include <string.h>

#include "err.h"

static int64_t magnitude(int64_t v)
{
	return v < 0 ? -v : v;
}

/* P and Q without their common divisor. */
static struct view_metric reduced(struct view_metric m)
{
	uint64_t a = m.p < 0 ? -(uint64_t)m.p : (uint64_t)m.p, b = m.q < 0 ? -(uint64_t)m.q : (uint64_t)m.q;

	while (b) {
		uint64_t rest = a % b;

		a = b;
		b = rest;
	}
	if (!a)
		return m;
	/* 2^63 divides nothing else but itself and 0. */
	if (a >> 63)
		return (struct view_metric){m.p ? -1 : 0, m.q ? -1 : 0, m.k};
	return (struct view_metric){m.p / (int64_t)a, m.q / (int64_t)a, m.k};
}

struct view_metric view_metric_normal(struct view_metric m)
{
	if (m.k <= 1)
		return (struct view_metric){0, 0, 0};
	m = reduced(m);
	if (m.p < 0 || (m.p == 0 && m.q < 0)) {
		m.p = -m.p;
		m.q = -m.q;
	}
	return m;
}

int view_metric_check(struct view_metric m, struct err *err)
{
	if (!m.k && !m.p && !m.q)
		return 0;
	if (!m.p && !m.q) {
		err_set(err, ERR_USAGE, "--metric: 0,0 is no direction");
		return err_add_hint(
			err, "give whole numbers P,Q,K: the direction, and how often distances across it count, as in 3,1,10");
	}
	if (m.k < 1) {
		err_set(err, ERR_USAGE, "--metric: K is %lld; it must be at least 1", (long long)m.k);
		return err_add_hint(err, "give the direction across this one for what should count less");
	}
	m = reduced(m);
	if (m.p < -VIEW_METRIC_MOST || m.p > VIEW_METRIC_MOST || m.q < -VIEW_METRIC_MOST || m.q > VIEW_METRIC_MOST ||
	    m.k > VIEW_METRIC_MOST) {
		err_set(err, ERR_USAGE, "--metric: %c is more than %d",
			m.k > VIEW_METRIC_MOST                            ? 'K' :
			m.p < -VIEW_METRIC_MOST || m.p > VIEW_METRIC_MOST ? 'P' :
									    'Q',
			VIEW_METRIC_MOST);
		return err_add_hint(err, "give numbers of at most %d; the direction needs few digits", VIEW_METRIC_MOST);
	}
	return 0;
}

/* ---- maps ---- */

static int64_t determinant(const struct view_metric *m)
{
	return m->k * (m->p * m->p + m->q * m->q);
}

void view_map_init(struct view_map *map, struct view_metric m, const int64_t from[2])
{
	uint64_t odd = (uint64_t)determinant(&m), inverse;

	*map = (struct view_map){.is = m, .from = {from[0], from[1]}};
	map->shift = (unsigned)__builtin_ctzll(odd);
	odd >>= map->shift;
	inverse = odd; /* right in the last 3 bits, and in twice as many after each step */
	for (unsigned bits = 3; bits < 64; bits *= 2)
		inverse *= 2 - odd * inverse;
	map->a[0] = (uint64_t)(m.k * m.p) * inverse;
	map->a[1] = (uint64_t)-m.q * inverse;
	map->b[0] = (uint64_t)(m.k * m.q) * inverse;
	map->b[1] = (uint64_t)m.p * inverse;
	map->a[2] = map->a[0] * (uint64_t)from[0] + map->a[1] * (uint64_t)from[1];
	map->b[2] = map->b[0] * (uint64_t)from[0] + map->b[1] * (uint64_t)from[1];
}

static int64_t clamp(__int128 v, int64_t most)
{
	return v < -most ? -most : v > most ? most : (int64_t)v;
}

void view_map_box(const struct view_map *map, const int64_t box[4], int64_t ret[4])
{
	for (unsigned i = 0; i < 4; i++) {
		int64_t at[2];

		view_metric_image(&map->is, box[i & 1 ? 2 : 0], box[i & 2 ? 3 : 1], at);
		for (unsigned k = 0; k < 2; k++) {
			int64_t v = at[k] - map->from[k];

			ret[k] = !i || v < ret[k] ? v : ret[k];
			ret[2 + k] = !i || v > ret[2 + k] ? v : ret[2 + k];
		}
	}
}

static __int128 floor_div(__int128 n, int64_t d)
{
	return n / d - (n % d < 0);
}

void view_map_box_back(const struct view_map *map, const int64_t box[4], int64_t ret[4])
{
	const struct view_metric *m = &map->is;
	int64_t det = determinant(m);

	for (unsigned i = 0; i < 4; i++) {
		__int128 u = (__int128)box[i & 1 ? 2 : 0] + map->from[0], v = (__int128)box[i & 2 ? 3 : 1] + map->from[1];
		const __int128 at[2] = {m->k * m->p * u - m->q * v, m->k * m->q * u + m->p * v};

		for (unsigned k = 0; k < 2; k++) {
			int64_t low = clamp(floor_div(at[k], det), INT64_C(1) << 61);
			int64_t high = clamp(-floor_div(-at[k], det), INT64_C(1) << 61);

			ret[k] = !i || low < ret[k] ? low : ret[k];
			ret[2 + k] = !i || high > ret[2 + k] ? high : ret[2 + k];
		}
	}
}

/* ---- what fits ---- */

static bool origin_fits(int64_t low, int64_t high, int64_t from)
{
	return low - from >= INT32_MIN && high - from <= INT32_MAX;
}

bool view_metric_origin(int64_t low, int64_t high, int64_t *ret)
{
	int64_t middle = low + (high - low) / 2;

	for (unsigned bits = 32; bits > 0; bits--) {
		/* The multiple of 2^bits that is next to the middle. */
		int64_t step = INT64_C(1) << bits, from = bits == 32 ? 0 : ((middle + step / 2) >> bits) * step;

		*ret = from;
		if (origin_fits(low, high, from))
			return true;
	}
	*ret = low - INT32_MIN;
	return origin_fits(low, high, *ret);
}

static bool box_fits(const struct view_metric *m, int64_t width, int64_t height)
{
	int64_t p = magnitude(m->p), q = magnitude(m->q);

	return p * width + q * height <= UINT32_MAX && m->k * (q * width + p * height) <= UINT32_MAX;
}

/* Within three degrees. */
static bool is_near(const struct view_metric *a, const struct view_metric *b)
{
	return 20 * magnitude(a->p * b->q - a->q * b->p) <= magnitude(a->p * b->p + a->q * b->q);
}

bool view_metric_simpler(const struct view_metric *m, int64_t width, int64_t height, struct view_metric *ret)
{
	/* Convergents of |Q| / |P|, beginning with the nearer axis. */
	int64_t n = magnitude(m->q), d = magnitude(m->p), q[2] = {1, 0}, p[2] = {0, 1};
	const struct view_metric upright = {0, 1, m->k};
	bool found = n > d && box_fits(&upright, width, height);

	if (found)
		*ret = view_metric_normal(upright);
	while (d) {
		int64_t whole = n / d, rest = n % d, q2 = whole * q[0] + q[1], p2 = whole * p[0] + p[1];
		struct view_metric next = {p2, m->q < 0 ? -q2 : q2, m->k};

		n = d;
		d = rest;
		q[1] = q[0];
		p[1] = p[0];
		q[0] = q2;
		p[0] = p2;
		if (!box_fits(&next, width, height))
			break;
		*ret = view_metric_normal(next);
		found = true;
	}
	return found && is_near(m, ret);
}
