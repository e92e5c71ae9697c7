/*
 * The shape of a mesh (verify.h). Half-edges (3 * triangle + side, from the corner `side` to the next) are grouped by
 * the vertex that they leave and sorted by the vertex that they reach. So the opposite half-edge is found by bisection,
 * and a vertex of high degree costs no more than n log n. Signs are 128-bit integers.
 */
#include "verify.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "verify_place.h"

enum { SHORT_LIST = 24 };
#define NO_EDGE UINT32_MAX

struct check {
	const struct verify_mesh *mesh;
	struct verify_report *report;
	uint32_t *first;      /* nvertex + 1: the start, in `edge`, of the half-edges that leave a vertex */
	uint32_t *edge;       /* half-edges by the vertex they leave, then by the one they reach */
	uint32_t *rim;        /* boundary half-edges, in no order */
	int32_t (*mapped)[2]; /* vertices, if there is a metric, or else NULL */
	size_t nrim;
	uint32_t wrong, tie, half_piece; /* the first faulty inner edges, or NO_EDGE; reported after the shape was checked */
};

void verify_fault_set(struct verify_report *r, enum verify_fault fault, const int32_t *place, const char *fmt, ...)
{
	va_list ap;

	if (r->fault)
		return;
	r->fault = fault;
	r->has_place = place != NULL;
	if (place)
		memcpy(r->place, place, sizeof r->place);
	va_start(ap, fmt);
	vsnprintf(r->text, sizeof r->text, fmt, ap);
	va_end(ap);
}

static inline uint32_t from(const struct check *c, uint32_t h)
{
	return c->mesh->triangle[h / 3][h % 3];
}

static inline uint32_t to(const struct check *c, uint32_t h)
{
	return c->mesh->triangle[h / 3][h % 3 == 2 ? 0 : h % 3 + 1];
}

static inline uint32_t apex(const struct check *c, uint32_t h)
{
	return c->mesh->triangle[h / 3][h % 3 == 0 ? 2 : h % 3 - 1];
}

static inline const int32_t *xy(const struct check *c, uint32_t v)
{
	return c->mesh->vertex[v];
}

static const int32_t *circle_xy(const struct check *c, uint32_t v)
{
	return c->mapped ? c->mapped[v] : c->mesh->vertex[v];
}

/* Orientation and the hull are those of the vertices; circles and the tie rule those of the mapped ones. */
static int map_vertices(struct check *c, struct err *err)
{
	const struct verify_mesh *m = c->mesh;
	int64_t low[2] = {INT64_MAX, INT64_MAX}, high[2] = {INT64_MIN, INT64_MIN};

	for (int turn = 0; turn < 2; turn++)
		for (size_t v = 0; v < m->nvertex; v++) {
			int64_t x = m->vertex[v][0], y = m->vertex[v][1];
			const int64_t at[2] = {m->p * x + m->q * y, m->k * (m->p * y - m->q * x)};

			for (int i = 0; i < 2; i++) {
				low[i] = at[i] < low[i] ? at[i] : low[i];
				high[i] = at[i] > high[i] ? at[i] : high[i];
				if (turn)
					c->mapped[v][i] = (int32_t)(at[i] - low[i] + INT32_MIN);
			}
			if (high[0] - low[0] > UINT32_MAX || high[1] - low[1] > UINT32_MAX)
				return err_set(err, ERR_LIMIT, "the metric maps the vertices to more than 32 bits");
		}
	return 0;
}

static void check_triangles(struct check *c)
{
	const struct verify_mesh *m = c->mesh;

	for (size_t t = 0; t < m->ntriangle; t++) {
		const uint32_t *v = m->triangle[t];

		for (unsigned i = 0; i < 3; i++) {
			if (v[i] >= m->nvertex) {
				verify_fault_set(c->report, VERIFY_INDEX, NULL, "triangle %zu names vertex %u of %zu", t, v[i],
						 m->nvertex);
				return;
			}
		}
		if (v[0] == v[1] || v[1] == v[2] || v[2] == v[0]) {
			verify_fault_set(c->report, VERIFY_INDEX, xy(c, v[0]), "triangle %zu (%u, %u, %u) names a vertex twice",
					 t, v[0], v[1], v[2]);
			return;
		}
		if (verify_area(xy(c, v[0]), xy(c, v[1]), xy(c, v[2])) <= 0) {
			verify_fault_set(c->report, VERIFY_ORIENTATION, xy(c, v[0]),
					 "triangle %zu (%u, %u, %u) is not counter-clockwise", t, v[0], v[1], v[2]);
			return;
		}
	}
}

static void sort_list_short(const struct check *c, uint32_t *list, size_t n)
{
	for (size_t i = 1; i < n; i++) {
		uint32_t h = list[i], key = to(c, h);
		size_t j = i;

		for (; j > 0 && to(c, list[j - 1]) > key; j--)
			list[j] = list[j - 1];
		list[j] = h;
	}
}

/* Heap sort: needs no memory and has no bad case. */
static void sort_list(const struct check *c, uint32_t *list, size_t n)
{
	if (n <= SHORT_LIST) {
		sort_list_short(c, list, n);
		return;
	}
	for (size_t left = n / 2, end = n; end > 1;) {
		uint32_t h;
		size_t hole, child;

		if (left > 0) {
			h = list[--left];
		} else {
			h = list[--end];
			list[end] = list[0];
		}
		for (hole = left; (child = 2 * hole + 1) < end; hole = child) {
			if (child + 1 < end && to(c, list[child + 1]) > to(c, list[child]))
				child++;
			if (to(c, list[child]) <= to(c, h))
				break;
			list[hole] = list[child];
		}
		list[hole] = h;
	}
}

/* Fills first and edge; reports the first edge that has the same direction in two triangles. */
static void group_edges(struct check *c)
{
	const struct verify_mesh *m = c->mesh;
	uint32_t nedge = (uint32_t)(3 * m->ntriangle);

	memset(c->first, 0, (m->nvertex + 1) * sizeof *c->first);
	for (uint32_t h = 0; h < nedge; h++)
		c->first[from(c, h)]++;
	uint32_t sum = 0;

	for (size_t v = 0; v <= m->nvertex; v++) {
		sum += c->first[v];
		c->first[v] = sum; /* ends of the groups; filling backwards turns them into starts */
	}
	for (uint32_t h = nedge; h-- > 0;)
		c->edge[--c->first[from(c, h)]] = h;
	for (size_t v = 0; v < m->nvertex; v++) {
		uint32_t *list = c->edge + c->first[v];
		size_t n = c->first[v + 1] - c->first[v];

		sort_list(c, list, n);
		for (size_t i = 1; i < n; i++) {
			if (to(c, list[i]) != to(c, list[i - 1]))
				continue;
			verify_fault_set(c->report, VERIFY_EDGE, xy(c, (uint32_t)v),
					 "the edge from vertex %zu to %u is in triangles %u and %u in one direction", v,
					 to(c, list[i]), list[i - 1] / 3, list[i] / 3);
			return;
		}
		if (!n && !m->trimmed) {
			verify_fault_set(c->report, VERIFY_UNUSED, xy(c, (uint32_t)v), "vertex %zu is in no triangle", v);
			return;
		}
	}
}

static uint32_t opposite(const struct check *c, uint32_t h)
{
	uint32_t a = from(c, h), b = to(c, h), low = c->first[b], high = c->first[b + 1];

	while (low < high) {
		uint32_t middle = low + (high - low) / 2, reached = to(c, c->edge[middle]);

		if (reached == a)
			return c->edge[middle];
		if (reached < a)
			low = middle + 1;
		else
			high = middle;
	}
	return NO_EDGE;
}

/* Twice the area of (b - a, c - a) times the height of d above the plane of a, b, c lifted to x^2 + y^2: positive if d
 * is strictly inside. The value is below 2^127; the arithmetic is modulo 2^128. */
static int in_circle(const int32_t *a, const int32_t *b, const int32_t *c, const int32_t *d)
{
	typedef unsigned __int128 u;
	const int32_t *p[3] = {a, b, c};
	__int128 x[3], y[3], lift[3];

	for (unsigned i = 0; i < 3; i++) {
		x[i] = (int64_t)p[i][0] - d[0];
		y[i] = (int64_t)p[i][1] - d[1];
		lift[i] = x[i] * x[i] + y[i] * y[i];
	}
	u det = (u)lift[0] * (u)(x[1] * y[2] - x[2] * y[1]) + (u)lift[1] * (u)(x[2] * y[0] - x[0] * y[2]) +
		(u)lift[2] * (u)(x[0] * y[1] - x[1] * y[0]);
	__int128 s = (__int128)det;

	return (s > 0) - (s < 0);
}

static bool comes_later(const int32_t *a, const int32_t *b)
{
	return a[0] > b[0] || (a[0] == b[0] && a[1] > b[1]);
}

/* For cocircular a, b, c, d with the inner edge a b: false if the tie rule requires the edge c d. The last of the four
 * is an ear, so it must not be an end of the inner edge. */
static bool tie_is_right(const int32_t *a, const int32_t *b, const int32_t *c, const int32_t *d)
{
	const int32_t *ends = comes_later(a, b) ? a : b, *tips = comes_later(c, d) ? c : d;

	return comes_later(tips, ends);
}

/* Whether an inner edge is wrong: the two triangles at it, and their apexes. *ret_tie: by the tie rule. */
static bool edge_is_wrong(const struct check *c, uint32_t h, uint32_t o, bool *ret_tie)
{
	const uint32_t v[4] = {from(c, h), to(c, h), apex(c, h), apex(c, o)};
	const int64_t *w = c->mesh->weight;
	const int32_t *p[4];
	int side;

	for (unsigned i = 0; i < 4; i++)
		p[i] = circle_xy(c, v[i]);
	if (w)
		return verify_power(p, (const int64_t[4]){w[v[0]], w[v[1]], w[v[2]], w[v[3]]}, ret_tie) > 0;
	side = in_circle(p[0], p[1], p[2], p[3]);
	*ret_tie = side == 0;
	return side > 0 || (side == 0 && !tie_is_right(p[0], p[1], p[2], p[3]));
}

static bool is_piece(const struct check *c, uint32_t h)
{
	return c->mesh->edges && c->mesh->edges[h / 3] >> (h % 3 + 2) % 3 & 1;
}

/* Tests the inner edges (once each) and collects the boundary. */
static void check_edges(struct check *c)
{
	uint32_t nedge = (uint32_t)(3 * c->mesh->ntriangle);

	for (uint32_t h = 0; h < nedge; h++) {
		uint32_t o = opposite(c, h);

		if (o == NO_EDGE) {
			c->report->pieces += is_piece(c, h);
			c->rim[c->nrim++] = h;
			continue;
		}
		if (o < h)
			continue;
		if (is_piece(c, h) != is_piece(c, o) && c->half_piece == NO_EDGE)
			c->half_piece = h;
		c->report->pieces += is_piece(c, h);
		c->report->inner++;
		if (is_piece(c, h) && is_piece(c, o))
			continue;
		bool tie, wrong = edge_is_wrong(c, h, o, &tie);

		c->report->ties += tie;
		if (wrong && tie && c->tie == NO_EDGE)
			c->tie = h;
		if (wrong && !tie && c->wrong == NO_EDGE)
			c->wrong = h;
	}
	c->report->edges = c->report->inner + c->nrim;
	c->report->hull = c->nrim;
}

static void check_circles(struct check *c)
{
	uint32_t wrong = c->wrong, tie = c->tie;

	if (c->half_piece != NO_EDGE)
		verify_fault_set(c->report, VERIFY_PIECE, xy(c, from(c, c->half_piece)),
				 "the edge from vertex %u to %u is a piece of a line in one of its triangles only",
				 from(c, c->half_piece), to(c, c->half_piece));
	else if (wrong != NO_EDGE)
		verify_fault_set(c->report, c->mesh->weight ? VERIFY_POWER : VERIFY_DELAUNAY, xy(c, from(c, wrong)),
				 "the edge from vertex %u to %u (triangle %u) is not %s", from(c, wrong), to(c, wrong), wrong / 3,
				 c->mesh->weight ? "the one of the weights" : "Delaunay");
	else if (tie != NO_EDGE)
		verify_fault_set(c->report, VERIFY_TIE, xy(c, from(c, tie)),
				 "the edge from vertex %u to %u (triangle %u) is not the one of the tie rule", from(c, tie),
				 to(c, tie), tie / 3);
}

/* Links the boundary half-edges to one loop: next[v] is the one that leaves v. */
static void check_loop(struct check *c, uint32_t *next)
{
	memset(next, 0xff, c->mesh->nvertex * sizeof *next);
	for (size_t i = 0; i < c->nrim; i++) {
		uint32_t v = from(c, c->rim[i]);

		if (next[v] != NO_EDGE) {
			verify_fault_set(c->report, VERIFY_BOUNDARY, xy(c, v), "the boundary passes vertex %u twice", v);
			return;
		}
		next[v] = c->rim[i];
	}
	if (!c->nrim) {
		verify_fault_set(c->report, VERIFY_BOUNDARY, NULL, "there is no outer boundary");
		return;
	}
	uint32_t start = from(c, c->rim[0]), v = start;
	size_t length = 0;

	do {
		if (next[v] == NO_EDGE) {
			verify_fault_set(c->report, VERIFY_BOUNDARY, xy(c, v), "the boundary ends at vertex %u", v);
			return;
		}
		v = to(c, next[v]);
	} while (++length < c->nrim && v != start);
	if (v != start || length != c->nrim)
		verify_fault_set(c->report, VERIFY_BOUNDARY, xy(c, start),
				 "the boundary is not one loop: the one through vertex %u has %zu of %zu edges", start, length,
				 c->nrim);
}

/* 0 for directions in [0, 180) degrees, 1 for the others. */
static int half(const int32_t *a, const int32_t *b)
{
	return b[1] > a[1] || (b[1] == a[1] && b[0] > a[0]) ? 0 : 1;
}

static void check_convex(struct check *c, const uint32_t *next)
{
	unsigned turns = 0;

	for (size_t i = 0; i < c->nrim; i++) {
		uint32_t vb = to(c, c->rim[i]);
		const int32_t *p = xy(c, from(c, c->rim[i])), *q = xy(c, vb), *r = xy(c, to(c, next[vb]));
		__int128 area = verify_area(p, q, r);

		turns += half(p, q) == 1 && half(q, r) == 0;
		if (area < 0 || (area == 0 && half(p, q) != half(q, r))) {
			verify_fault_set(c->report, VERIFY_CONVEX, q, "the boundary is not convex at vertex %u", vb);
			return;
		}
	}
	if (turns != 1)
		verify_fault_set(c->report, VERIFY_CONVEX, xy(c, from(c, c->rim[0])), "the boundary turns %u times, not once",
				 turns);
}

static void check_euler(struct check *c)
{
	const struct verify_mesh *m = c->mesh;

	if (m->nvertex + m->ntriangle != c->report->edges + 1)
		verify_fault_set(c->report, VERIFY_EULER, NULL, "%zu vertices, %llu edges and %zu triangles are no disc",
				 m->nvertex, (unsigned long long)c->report->edges, m->ntriangle);
}

static void check_all(struct check *c)
{
	check_triangles(c);
	if (c->report->fault)
		return;
	group_edges(c);
	if (c->report->fault)
		return;
	check_edges(c);
	uint32_t *next = c->first; /* the groups are no longer needed */

	if (!c->mesh->trimmed)
		check_loop(c, next);
	if (!c->report->fault && !c->mesh->trimmed)
		check_euler(c);
	if (!c->report->fault && !c->mesh->trimmed)
		check_convex(c, next);
	if (!c->report->fault)
		check_circles(c);
}

/* Without triangles: checks that all vertices are on the line through the first vertex and the first different one. */
static void check_flat(const struct verify_mesh *m, struct verify_report *r)
{
	size_t second = 1;

	while (second < m->nvertex && m->vertex[second][0] == m->vertex[0][0] && m->vertex[second][1] == m->vertex[0][1])
		second++;
	for (size_t v = second + 1; v < m->nvertex && !r->fault; v++)
		if (verify_area(m->vertex[0], m->vertex[second], m->vertex[v]))
			verify_fault_set(r, VERIFY_UNUSED, m->vertex[v],
					 "vertex %zu is in no triangle, and not all vertices lie on one line", v);
}

int verify_mesh(const struct verify_mesh *m, struct verify_report *ret, struct err *err)
{
	struct verify_report r = {0};
	struct check c = {.mesh = m, .report = &r, .wrong = NO_EDGE, .tie = NO_EDGE, .half_piece = NO_EDGE};

	if (m->nvertex >= UINT32_MAX || m->ntriangle >= UINT32_MAX / 3)
		return err_set(err, ERR_LIMIT, "the verifier takes meshes of up to %u triangles", UINT32_MAX / 3 - 1);
	if (!m->ntriangle) {
		if (!m->trimmed)
			check_flat(m, &r);
		*ret = r;
		return 0;
	}
	c.first = malloc((m->nvertex + 1) * sizeof *c.first);
	c.edge = malloc(3 * m->ntriangle * sizeof *c.edge);
	c.rim = malloc(3 * m->ntriangle * sizeof *c.rim);
	if (m->k)
		c.mapped = malloc(m->nvertex * sizeof *c.mapped);
	if (c.first && c.edge && c.rim && (c.mapped || !m->k)) {
		if (!m->k || !map_vertices(&c, err))
			check_all(&c);
		*ret = r;
	} else {
		err_set(err, ERR_NOMEM, "no memory to verify %zu triangles", m->ntriangle);
	}
	free(c.first);
	free(c.edge);
	free(c.rim);
	free(c.mapped);
	return -(int)err->code;
}

const char *verify_fault_text(enum verify_fault fault)
{
	static const char *const text[VERIFY_FAULTS] = {
		[VERIFY_GOOD] = "good",     [VERIFY_INDEX] = "index",     [VERIFY_ORIENTATION] = "orientation",
		[VERIFY_EDGE] = "edge",     [VERIFY_UNUSED] = "unused",   [VERIFY_BOUNDARY] = "boundary",
		[VERIFY_EULER] = "euler",   [VERIFY_CONVEX] = "convex",   [VERIFY_DELAUNAY] = "delaunay",
		[VERIFY_TIE] = "tie",       [VERIFY_MISSING] = "missing", [VERIFY_EXTRA] = "extra",
		[VERIFY_HEIGHT] = "height", [VERIFY_PIECE] = "piece",     [VERIFY_POWER] = "power",
	};

	return (unsigned)fault < VERIFY_FAULTS ? text[fault] : "unknown";
}
