/* Well-known binary (lines_wkb.h). Nothing is believed: each count is compared with the bytes that are left. */
#include "lines_wkb.h"

#include <inttypes.h>
#include <string.h>

enum { NEST_MOST = 8 };

struct wkb {
	struct lines *l;
	const uint8_t *at, *end;
	struct err *err;
	bool big, points, lines;
};

static const char *const names[18] = {
	NULL,
	"Point",
	"LineString",
	"Polygon",
	"MultiPoint",
	"MultiLineString",
	"MultiPolygon",
	"GeometryCollection",
	"CircularString",
	"CompoundCurve",
	"CurvePolygon",
	"MultiCurve",
	"MultiSurface",
	"Curve",
	"Surface",
	"PolyhedralSurface",
	"TIN",
	"Triangle",
};

static int bad(struct wkb *w, const char *what)
{
	return lines_bad(w->l, w->err, w->l->f.place, "its geometry %s", what);
}

static bool take_u32(struct wkb *w, uint32_t *ret)
{
	const uint8_t *p = w->at;

	if (w->end - p < 4)
		return false;
	*ret = w->big ? (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3] :
			(uint32_t)p[3] << 24 | (uint32_t)p[2] << 16 | (uint32_t)p[1] << 8 | p[0];
	w->at += 4;
	return true;
}

/* There are eight bytes. */
static double take_double(struct wkb *w)
{
	uint64_t bits = 0;
	double v;

	for (int i = 0; i < 8; i++)
		bits |= (uint64_t)w->at[i] << (w->big ? 56 - 8 * i : 8 * i);
	w->at += 8;
	memcpy(&v, &bits, sizeof v);
	return v;
}

struct kind {
	uint32_t type;
	bool z, m;
};

static int take_kind(struct wkb *w, struct kind *ret)
{
	uint32_t code, srid;

	if (w->at == w->end || *w->at > 1)
		return bad(w, w->at == w->end ? "is cut" : "has no order of bytes");
	w->big = !*w->at++;
	if (!take_u32(w, &code))
		return bad(w, "is cut");
	ret->z = code & 0x80000000u;
	ret->m = code & 0x40000000u;
	if (code & 0x20000000u && !take_u32(w, &srid))
		return bad(w, "is cut");
	code &= 0x1fffffffu;
	ret->z |= code / 1000 == 1 || code / 1000 == 3;
	ret->m |= code / 1000 == 2 || code / 1000 == 3;
	ret->type = code % 1000;
	if (code >= 4000 || ret->type >= sizeof names / sizeof *names || !names[ret->type])
		return bad(w, "has a type that does not exist");
	return 0;
}

/* The vertices of a line or ring, or of a point. */
static int take_vertices(struct wkb *w, struct kind k, uint32_t n)
{
	size_t size = 8 * (size_t)(2 + k.z + k.m);
	int rc = 0;

	if ((size_t)(w->end - w->at) / size < n)
		return bad(w, "claims more vertices than it has");
	if (!k.z && n)
		lines_refuse(w->l, lines_no_z);
	if (!k.z || w->l->f.state == LINES_REFUSED) {
		w->at += size * n;
		return 0;
	}
	for (uint32_t i = 0; i < n && !rc; i++) {
		double v[3];

		for (int axis = 0; axis < 3; axis++)
			v[axis] = take_double(w);
		if (k.m)
			take_double(w);
		rc = lines_vertex_number(w->l, v, w->err);
	}
	return rc;
}

static int take_line(struct wkb *w, struct kind k, bool ring)
{
	uint32_t n;
	int rc;

	if (!take_u32(w, &n))
		return bad(w, "is cut");
	rc = n ? lines_part(w->l, ring, w->err) : 0;
	return rc ? rc : take_vertices(w, k, n);
}

static int take_geometry(struct wkb *w, unsigned nest);

static int take_members(struct wkb *w, struct kind k, unsigned nest)
{
	uint32_t n;
	int rc = 0;

	if (!take_u32(w, &n))
		return bad(w, "is cut");
	/* A ring has four bytes at least, a geometry nine. */
	if ((size_t)(w->end - w->at) / 4 < n)
		return bad(w, "claims more members than it has");
	for (uint32_t i = 0; i < n && !rc; i++)
		rc = k.type == 3 ? take_line(w, k, true) : take_geometry(w, nest + 1);
	return rc;
}

static const char *refused_name(uint32_t type)
{
	return type >= 15 ? "it is a surface of faces (TIN, PolyhedralSurface, Triangle)" :
			    "it is a curve (CircularString, CompoundCurve, CurvePolygon and the like)";
}

static int take_geometry(struct wkb *w, unsigned nest)
{
	struct kind k = {0};
	uint32_t skipped;
	int rc = nest > NEST_MOST ? bad(w, "has collections in collections in collections") : take_kind(w, &k);

	if (rc)
		return rc;
	if (!nest)
		lines_geometry(w->l, names[k.type]);
	switch (k.type) {
	case 1:
		w->points = true;
		if ((size_t)(w->end - w->at) / 8 < (size_t)(2 + k.z + k.m))
			return bad(w, "is cut");
		w->at += 8 * (size_t)(2 + k.z + k.m);
		return 0;
	case 4:
		if (!take_u32(w, &skipped))
			return bad(w, "is cut");
		w->points = true;
		if ((size_t)(w->end - w->at) / (5 + 8 * (size_t)(2 + k.z + k.m)) < skipped)
			return bad(w, "is cut");
		w->at += (5 + 8 * (size_t)(2 + k.z + k.m)) * skipped;
		return 0;
	case 2:
		w->lines = true;
		return take_line(w, k, false);
	case 3:
		w->lines = true;
		return take_members(w, k, nest);
	case 5:
	case 6:
	case 7:
		return take_members(w, k, nest);
	default:
		/* The rest cannot be told apart from what follows it. */
		lines_refuse(w->l, refused_name(k.type));
		w->at = w->end;
		return 0;
	}
}

int lines_wkb(struct lines *l, const uint8_t *bytes, size_t n, struct err *err)
{
	struct wkb w = {.l = l, .at = bytes, .end = bytes + n, .err = err};
	int rc = take_geometry(&w, 0);

	if (rc)
		return rc;
	if (w.at != w.end)
		return bad(&w, "is followed by other bytes");
	if (w.points && w.lines)
		lines_refuse(l, "it is a collection of lines and points");
	else if (w.points)
		lines_no_line(l, "points");
	return 0;
}
