/*
 * Entities of DXF: LINE, POLYLINE, LWPOLYLINE and 3DFACE become lines; curves are refused by name, all else is left out by name.
 *
 * A polyline in a plane has one elevation (LWPOLYLINE 38, POLYLINE 30). Programs write 0 or nothing where there is none, so 0 is
 * no z. A plane that is not level, or seen from below (210 to 230), is refused.
 */
#include "lines_dxf.h"

#include <string.h>

enum { CLOSED = 1, CURVE_FIT = 2, SPLINE_FIT = 4, IN_SPACE = 8, MESH = 16, POLYFACE = 64 };

struct entity {
	char layer[LINES_NAME_SIZE];
	int64_t flags;
	struct decimal corner[4][3];
	unsigned has[4]; /* bits of axes */
	struct decimal elevation;
	bool has_elevation, paper, bulge, tilted;
};

static const struct {
	const char *name, *why;
} curves[] = {
	{"ARC", "it is an arc (ARC)"},         {"CIRCLE", "it is a circle (CIRCLE)"}, {"ELLIPSE", "it is an ellipse (ELLIPSE)"},
	{"SPLINE", "it is a spline (SPLINE)"}, {"HELIX", "it is a helix (HELIX)"},    {"MLINE", "it is a multiline (MLINE)"},
	{"RAY", "it has no end (RAY)"},        {"XLINE", "it has no end (XLINE)"},
};

static const char *const others[] = {
	"POINT",  "TEXT",  "MTEXT", "INSERT",   "ATTDEF", "ATTRIB",  "DIMENSION",  "LEADER",    "MULTILEADER",
	"HATCH",  "SOLID", "TRACE", "VIEWPORT", "IMAGE",  "WIPEOUT", "TOLERANCE",  "SHAPE",     "3DSOLID",
	"REGION", "BODY",  "MESH",  "SURFACE",  "LIGHT",  "SECTION", "ACAD_TABLE", "OLE2FRAME", "ACAD_PROXY_ENTITY",
};

static const char *other_name(const char *name)
{
	for (size_t i = 0; i < sizeof others / sizeof *others; i++)
		if (!strcmp(others[i], name))
			return others[i];
	return "other entities";
}

/* ---- the pairs of one entity ---- */

/* Codes 10 to 13 are x, 20 to 23 y, 30 to 33 z of corners. */
static int take_corner(struct lines_dxf *d, struct entity *e)
{
	unsigned corner = (unsigned)d->code % 10, axis = (unsigned)d->code / 10 - 1;

	e->has[corner] |= 1u << axis;
	return lines_dxf_number(d, &e->corner[corner][axis]);
}

static int take_pair(struct lines_dxf *d, struct entity *e)
{
	struct decimal v;
	int64_t n;
	int rc = 0;

	switch (d->code) {
	case 8:
		lines_utf8(d->value, strlen(d->value), e->layer, sizeof e->layer);
		break;
	case 10:
	case 11:
	case 12:
	case 13:
	case 20:
	case 21:
	case 22:
	case 23:
	case 30:
	case 31:
	case 32:
	case 33:
		return take_corner(d, e);
	case 38:
		e->has_elevation = true;
		return lines_dxf_number(d, &e->elevation);
	case 42:
		rc = lines_dxf_number(d, &v);
		e->bulge |= !rc && v.mantissa;
		break;
	case 67:
		rc = lines_dxf_integer(d, &n);
		e->paper = !rc && n == 1;
		break;
	case 70:
		return lines_dxf_integer(d, &e->flags);
	case 210:
	case 220:
		rc = lines_dxf_number(d, &v);
		e->tilted |= !rc && v.mantissa;
		break;
	case 230:
		rc = lines_dxf_number(d, &v);
		e->tilted |= !rc && v.mantissa <= 0;
		break;
	default:
		break;
	}
	return rc;
}

/* All of its pairs; that of the next entity is read too. `each` sees those with coordinates. */
static int take_entity(struct lines_dxf *d, struct entity *e, int (*each)(struct lines_dxf *, struct entity *))
{
	int rc;

	*e = (struct entity){.layer = "0"};
	while (!(rc = lines_dxf_pair(d)) && d->code) {
		rc = take_pair(d, e);
		if (!rc && each)
			rc = each(d, e);
		if (rc)
			return rc;
	}
	return rc;
}

static int set_layer(struct lines_dxf *d, const struct entity *e)
{
	struct lines_layer *layer;
	int rc = lines_layer(d->l, e->layer, &layer, d->source.err);

	if (rc)
		return rc;
	layer->crs = d->crs;
	d->l->f.layer = layer;
	if (e->paper)
		lines_no_line(d->l, "in paper space");
	return 0;
}

static int add_corner(struct lines_dxf *d, const struct entity *e, unsigned k)
{
	if ((e->has[k] & 3) != 3)
		return lines_bad(d->l, d->source.err, d->l->f.place, "a vertex lacks x or y");
	if (!(e->has[k] & 4))
		lines_refuse(d->l, lines_no_z);
	return lines_vertex_exact(d->l, e->corner[k], d->source.err);
}

/* ---- kinds of entities ---- */

static int read_line(struct lines_dxf *d)
{
	struct entity e;
	int rc = take_entity(d, &e, NULL);

	lines_geometry(d->l, "LINE");
	if (!rc)
		rc = set_layer(d, &e);
	if (!rc)
		rc = lines_part(d->l, false, d->source.err);
	for (unsigned k = 0; k < 2 && !rc; k++)
		rc = add_corner(d, &e, k);
	return rc;
}

static bool same_corner(const struct entity *e, unsigned a, unsigned b)
{
	for (unsigned k = 0; k < 3; k++)
		if (decimal_compare(e->corner[a][k], e->corner[b][k]))
			return false;
	return true;
}

/* A ring of its corners, or lines for its edges if some are invisible. */
static int read_face(struct lines_dxf *d)
{
	struct entity e;
	unsigned n;
	int rc = take_entity(d, &e, NULL);

	lines_geometry(d->l, "3DFACE");
	if (!rc)
		rc = set_layer(d, &e);
	n = e.has[3] && !same_corner(&e, 2, 3) ? 4 : 3;
	if (!rc && !(e.flags & 15)) {
		rc = lines_part(d->l, true, d->source.err);
		for (unsigned k = 0; k < n && !rc; k++)
			rc = add_corner(d, &e, k);
		return rc;
	}
	for (unsigned k = 0; k < n && !rc; k++) {
		/* With equal corners 3 and 4 the edge back to the first one is the fourth. */
		unsigned edge = n == 3 && k == 2 ? 3 : k;

		if (e.flags >> edge & 1)
			continue;
		rc = lines_part(d->l, false, d->source.err);
		if (!rc)
			rc = add_corner(d, &e, k);
		if (!rc)
			rc = add_corner(d, &e, (k + 1) % n);
	}
	return rc;
}

/* LWPOLYLINE repeats 10 and 20: y ends a vertex. */
static int take_light(struct lines_dxf *d, struct entity *e)
{
	struct decimal v[3] = {e->corner[0][0], e->corner[0][1], {0, 0}};

	if (d->code != 20)
		return 0;
	if (!(e->has[0] & 1))
		return lines_bad(d->l, d->source.err, d->line, "a vertex lacks x");
	e->has[0] = 0;
	return lines_vertex_exact(d->l, v, d->source.err);
}

static void set_elevation(struct lines_dxf *d, const struct entity *e, bool has)
{
	if (!has || !e->elevation.mantissa)
		lines_refuse(d->l, lines_no_z);
	if (e->tilted)
		lines_refuse(d->l, "its plane is not level (210 to 230)");
	lines_all_z(d->l, e->elevation);
}

static int read_light(struct lines_dxf *d)
{
	struct entity e;
	int rc = lines_part(d->l, false, d->source.err);

	lines_geometry(d->l, "LWPOLYLINE");
	if (!rc)
		rc = take_entity(d, &e, take_light);
	if (!rc)
		rc = set_layer(d, &e);
	if (rc)
		return rc;
	if (e.bulge)
		lines_refuse(d->l, "it has an arc (a bulge)");
	set_elevation(d, &e, e.has_elevation);
	if (e.flags & CLOSED)
		lines_make_ring(d->l);
	return 0;
}

/* The VERTEX entities of a POLYLINE, up to its SEQEND. */
static int read_vertices(struct lines_dxf *d, bool in_space, bool *ret_bulge)
{
	struct entity e;
	int rc = 0;

	*ret_bulge = false;
	while (!rc && !strcmp(d->value, "VERTEX")) {
		rc = take_entity(d, &e, NULL);
		if (rc)
			break;
		*ret_bulge |= e.bulge;
		if (!in_space)
			e.has[0] |= 4;
		rc = d->l->f.state == LINES_USABLE ? add_corner(d, &e, 0) : 0;
	}
	if (rc || strcmp(d->value, "SEQEND") != 0)
		return rc ? rc : lines_bad(d->l, d->source.err, d->line, "a POLYLINE has no SEQEND");
	return take_entity(d, &e, NULL);
}

static int read_polyline(struct lines_dxf *d)
{
	struct entity e;
	bool bulge;
	int rc = take_entity(d, &e, NULL);

	lines_geometry(d->l, "POLYLINE");
	if (!rc)
		rc = set_layer(d, &e);
	if (rc)
		return rc;
	if (e.flags & (MESH | POLYFACE))
		lines_refuse(d->l, "it is a mesh (POLYLINE 70)");
	if (e.flags & (CURVE_FIT | SPLINE_FIT))
		lines_refuse(d->l, "it is a smoothed polyline");
	rc = lines_part(d->l, false, d->source.err);
	if (!rc)
		rc = read_vertices(d, e.flags & (IN_SPACE | MESH | POLYFACE), &bulge);
	if (rc)
		return rc;
	if (bulge)
		lines_refuse(d->l, "it has an arc (a bulge)");
	e.elevation = e.corner[0][2];
	if (!(e.flags & IN_SPACE))
		set_elevation(d, &e, e.has[0] & 4);
	if (e.flags & CLOSED)
		lines_make_ring(d->l);
	return 0;
}

static int read_other(struct lines_dxf *d)
{
	const char *curve = NULL, *name = other_name(d->value);
	struct entity e;
	int rc;

	for (size_t i = 0; i < sizeof curves / sizeof *curves; i++)
		if (!strcmp(curves[i].name, d->value)) {
			curve = curves[i].why;
			name = curves[i].name;
		}
	/* Its pairs have other meanings, so only layer and space are read. */
	e = (struct entity){.layer = "0"};
	while (!(rc = lines_dxf_pair(d)) && d->code)
		if (d->code == 8 || d->code == 67)
			if ((rc = take_pair(d, &e)))
				return rc;
	if (!rc)
		rc = set_layer(d, &e);
	lines_geometry(d->l, name);
	if (curve && !e.paper)
		lines_refuse(d->l, curve);
	else
		lines_no_line(d->l, name);
	return rc;
}

int lines_dxf_entity(struct lines_dxf *d, bool *ret_none)
{
	struct entity e;
	int rc;

	if (!strcmp(d->value, "SEQEND") || !strcmp(d->value, "VERTEX"))
		return take_entity(d, &e, NULL);
	*ret_none = false;
	lines_begin(d->l, NULL, ++d->number, d->line);
	if (!strcmp(d->value, "LINE"))
		rc = read_line(d);
	else if (!strcmp(d->value, "POLYLINE"))
		rc = read_polyline(d);
	else if (!strcmp(d->value, "LWPOLYLINE"))
		rc = read_light(d);
	else if (!strcmp(d->value, "3DFACE"))
		rc = read_face(d);
	else
		rc = read_other(d);
	if (!rc)
		lines_end(d->l);
	return rc;
}
