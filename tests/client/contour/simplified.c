/* See simplified.h. */
#include "simplified.h"
#include "quad.h"

typedef __int128 wide;

static int sign_of(wide v)
{
	return (v > 0) - (v < 0);
}

static int turn(const int64_t *a, const int64_t *b, const int64_t *c)
{
	return sign_of((wide)(b[0] - a[0]) * (c[1] - a[1]) - (wide)(b[1] - a[1]) * (c[0] - a[0]));
}

static bool on(const int64_t *a, const int64_t *b, const int64_t *q) /* of points on one line */
{
	for (int i = 0; i < 2; i++)
		if ((q[i] < a[i] && q[i] < b[i]) || (q[i] > a[i] && q[i] > b[i]))
			return false;
	return true;
}

static bool meet(const int64_t *a, const int64_t *b, const int64_t *c, const int64_t *d)
{
	int s = turn(a, b, c), t = turn(a, b, d), u = turn(c, d, a), v = turn(c, d, b);

	return (s * t < 0 && u * v < 0) || (!s && on(a, b, c)) || (!t && on(a, b, d)) || (!u && on(c, d, a)) ||
	       (!v && on(c, d, b));
}

/* Whether a - b - c goes back over itself. */
static bool back(const int64_t *a, const int64_t *b, const int64_t *c)
{
	return !turn(a, b, c) && (wide)(a[0] - b[0]) * (c[0] - b[0]) + (wide)(a[1] - b[1]) * (c[1] - b[1]) > 0;
}

static bool same(const int64_t *a, const int64_t *b)
{
	return a[0] == b[0] && a[1] == b[1];
}

/* ---- parts of lines ---- */

struct part {
	const struct simplified *line;
	size_t from, to; /* points */
};

static bool follows(const struct part *a, const struct part *b)
{
	return a->line == b->line && (a->to == b->from || (a->line->closed && a->to + 1 == a->line->n && !b->from));
}

/* Segments a - b and c - d of which the second may follow the first. */
static bool meet_more(const int64_t *a, const int64_t *b, const int64_t *c, const int64_t *d, bool first, bool second)
{
	if (first && second) /* both ends in common */
		return true;
	if (first)
		return back(a, b, d);
	if (second)
		return back(c, d, b);
	return meet(a, b, c, d);
}

static bool parts_meet(const struct part *a, const struct part *b)
{
	const int64_t(*p)[2] = (const int64_t(*)[2])a->line->at, (*q)[2] = (const int64_t(*)[2])b->line->at;

	for (size_t i = a->from; i < a->to; i++)
		for (size_t k = b->from; k < b->to; k++)
			if (meet_more(p[i], p[i + 1], q[k], q[k + 1], follows(a, b) && i + 1 == a->to && k == b->from,
				      follows(b, a) && k + 1 == b->to && i == a->from))
				return true;
	return false;
}

static struct part part_of(const struct simplified *s, size_t k)
{
	return (struct part){s, s->kept[k], s->kept[k + 1]};
}

static size_t met(const struct simplified *a, const struct simplified *b)
{
	size_t n = 0;

	for (size_t i = 0; i + 1 < a->m; i++) {
		for (size_t k = a == b ? i + 1 : 0; k + 1 < b->m; k++) {
			struct part p = part_of(a, i), q = part_of(b, k);

			n += meet_more(a->at[p.from], a->at[p.to], b->at[q.from], b->at[q.to], follows(&p, &q),
				       follows(&q, &p)) &&
			     !parts_meet(&p, &q);
		}
	}
	return n;
}

static bool is_far(const int64_t *a, const int64_t *b, const int64_t *q, quad tolerance)
{
	quad x = b[0] - a[0], y = b[1] - a[1], u = q[0] - a[0], v = q[1] - a[1], length = x * x + y * y;
	quad along = u * x + v * y, across = u * y - v * x, w = q[0] - b[0], z = q[1] - b[1];

	if (along <= 0)
		return u * u + v * v > tolerance * tolerance;
	if (along >= length)
		return w * w + z * z > tolerance * tolerance;
	return across * across > tolerance * tolerance * length;
}

static size_t places(const struct simplified *s, bool all)
{
	size_t n = 0, of = all ? s->n : s->m;

	for (size_t i = 0; i < of; i++) {
		bool first = true;

		for (size_t k = 0; k < i; k++)
			first = first && !same(s->at[all ? i : s->kept[i]], s->at[all ? k : s->kept[k]]);
		n += first;
	}
	return n;
}

struct faults simplified_faults(const struct simplified *s, size_t lines, double tolerance)
{
	struct faults f = {0};

	for (size_t i = 0; i < lines; i++) {
		f.ends += s[i].kept[0] != 0 || s[i].kept[s[i].m - 1] != s[i].n - 1;
		f.collapsed += s[i].closed && places(&s[i], false) < 3 && places(&s[i], true) > 2;
		for (size_t k = 0; k + 1 < s[i].m; k++)
			for (size_t q = s[i].kept[k] + 1; q < s[i].kept[k + 1]; q++)
				f.far += is_far(s[i].at[s[i].kept[k]], s[i].at[s[i].kept[k + 1]], s[i].at[q], tolerance);
		for (size_t k = i; k < lines; k++)
			f.met += met(&s[i], &s[k]);
	}
	return f;
}
