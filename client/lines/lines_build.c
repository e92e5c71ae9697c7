/*
 * The feature that a reader reads: its lines in one list, its vertices in another. Beyond the limits vertices are counted and
 * dropped, and the feature is refused; so it is where a number is not finite or absurd.
 */
#include "lines_priv.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "grow.h"

/* Beyond it no unit is one of a survey: 10^12 mm are a million kilometres. */
#define ABSURD 1e12

const char lines_no_z[] = "it has no z", lines_no_name[] = "its row has no name of a line";

void lines_begin(struct lines *l, const struct lines_layer *layer, uint64_t number, uint64_t place)
{
	l->f = (struct lines_feature){.number = number, .place = place, .layer = layer, .geometry = ""};
	l->dropped = 0;
}

void lines_geometry(struct lines *l, const char *name)
{
	l->f.geometry = name;
}

void lines_refuse(struct lines *l, const char *why)
{
	if (l->f.state != LINES_USABLE)
		return;
	l->f.state = LINES_REFUSED;
	l->f.why = why;
}

void lines_no_line(struct lines *l, const char *what)
{
	if (l->f.state != LINES_USABLE)
		return;
	l->f.state = LINES_NO_LINE;
	l->f.why = what;
}

void lines_kind(struct lines *l, const char *text, size_t n)
{
	while (n && lines_is_blank(*text))
		text++, n--;
	while (n && (lines_is_blank(text[n - 1]) || !text[n - 1]))
		n--;
	lines_utf8(text, n, l->kind, sizeof l->kind);
	l->f.kind = l->kind;
}

int lines_part(struct lines *l, bool ring, struct err *err)
{
	if (l->f.nparts == LINES_PARTS_MOST) {
		lines_refuse(l, "it has more than 65536 lines or rings");
		return 0;
	}
	if (!grow(&l->part, &l->parts_room, l->f.nparts + 1, 16, sizeof(*l->part)))
		return err_set(err, ERR_NOMEM, "no memory for a feature");
	l->part[l->f.nparts++] = (struct lines_part){.first = l->f.nvertices, .ring = ring};
	return 0;
}

/* Room for one more; *ret NULL: it is beyond the limit. */
static int more_room(struct lines *l, size_t size, void **ret, struct err *err)
{
	*ret = NULL;
	if (l->f.nvertices == LINES_VERTICES_MOST) {
		lines_refuse(l, "it has more than 524288 vertices");
		l->dropped++;
		return 0;
	}
	if (!grow(&l->vertex, &l->vertices_room, l->f.nvertices + 1, 256, size))
		return err_set(err, ERR_NOMEM, "no memory for a feature");
	*ret = (char *)l->vertex + size * l->f.nvertices++;
	return 0;
}

static void judge(struct lines *l, double v)
{
	if (!isfinite(v))
		lines_refuse(l, "a coordinate is not finite");
	else if (fabs(v) > ABSURD)
		lines_refuse(l, "a coordinate is beyond 1e12");
}

int lines_vertex_exact(struct lines *l, const struct decimal d[3], struct err *err)
{
	void *to;
	int rc = more_room(l, sizeof(struct decimal[3]), &to, err);

	if (rc || !to)
		return rc;
	memcpy(to, d, sizeof(struct decimal[3]));
	for (unsigned k = 0; k < 3; k++)
		judge(l, decimal_double(d[k]));
	return 0;
}

int lines_vertex_number(struct lines *l, const double d[3], struct err *err)
{
	void *to;
	int rc = more_room(l, sizeof(double[3]), &to, err);

	if (rc || !to)
		return rc;
	memcpy(to, d, sizeof(double[3]));
	for (unsigned k = 0; k < 3; k++)
		judge(l, d[k]);
	return 0;
}

void lines_all_z(struct lines *l, struct decimal z)
{
	struct decimal(*d)[3] = l->vertex;

	for (size_t i = 0; i < l->f.nvertices; i++)
		d[i][2] = z;
	if (l->f.nvertices)
		judge(l, decimal_double(z));
}

void lines_make_ring(struct lines *l)
{
	if (l->f.nparts)
		l->part[0].ring = true;
}

/* Equal in the axes from..to. */
static bool same(const struct lines *l, size_t a, size_t b, unsigned from, unsigned to)
{
	const struct decimal(*d)[3] = l->vertex;
	const double(*v)[3] = l->vertex;

	for (unsigned k = from; k <= to; k++)
		if (l->reader->exact ? decimal_compare(d[a][k], d[b][k]) != 0 : v[a][k] != v[b][k])
			return false;
	return true;
}

static void end_part(struct lines *l, struct lines_part *p)
{
	size_t last = p->first + p->n - 1;

	if (p->ring && p->n > 1 && same(l, p->first, last, 0, 1)) {
		if (!same(l, p->first, last, 2, 2))
			lines_refuse(l, "a ring ends where it begins, at another z");
		p->n--;
	}
	if (p->n < (p->ring ? 3 : 2))
		lines_refuse(l, p->ring ? "a ring has fewer than three vertices" : "a line has fewer than two vertices");
}

void lines_end(struct lines *l)
{
	struct lines_feature *f = &l->f;
	size_t kept = 0;

	for (size_t i = 0; i < f->nparts; i++) {
		size_t end = i + 1 < f->nparts ? l->part[i + 1].first : f->nvertices;
		struct lines_part *p = &l->part[kept];

		*p = l->part[i];
		p->n = end - p->first;
		kept += p->n > 0; /* an empty one is none */
	}
	f->nparts = kept;
	for (size_t i = 0; i < kept && f->state != LINES_REFUSED; i++)
		end_part(l, &l->part[i]);
	if (f->state == LINES_USABLE && !kept)
		f->state = LINES_EMPTY;
	f->part = l->part;
	f->exact = l->reader->exact ? l->vertex : NULL;
	f->number_of = l->reader->exact ? NULL : l->vertex;
}
