/*
 * A PLY as acutctl writes it: binary little-endian, vertices of three doubles, triangles, and the comments
 * acut-lattice, acut-origin, acut-crs, acut-digest, acut-trimmed. Coordinates are converted back to lattice numbers: the number
 * whose coordinate is nearest must give exactly the double of the file; nothing is rounded silently.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "check_file.h"
#include "err.h"
#include "parse.h"

enum { BUFFER = 1 << 20, LINE = 2048, LINES = 4096, VERTEX = 24, FACE = 13, EDGES = 2 };

/* Bytes of a descriptor, sequentially. */
struct reader {
	int fd;
	const char *name;
	uint8_t buffer[BUFFER];
	size_t at, end;
	uint64_t offset; /* of buffer[0] */
};

struct ply_header {
	uint64_t nvertex, nface;
	unsigned doubles; /* properties x, y, z so far */
	bool format, has_lattice, faces, edges, converted;
	enum { IN_NONE, IN_VERTEX, IN_FACE } element;
};

static int read_error(const struct reader *r, enum err_code code, const char *text, struct err *err)
{
	err_set(err, code, "%s", text);
	err_add_place(err, r->offset + r->at, NULL);
	return err_add_file(err, r->name);
}

/* Ensures n bytes in the buffer; -ERR_TRUNCATED. */
static int need_bytes(struct reader *r, size_t n, struct err *err)
{
	if (r->end - r->at >= n)
		return 0;
	memmove(r->buffer, r->buffer + r->at, r->end - r->at);
	r->offset += r->at;
	r->end -= r->at;
	r->at = 0;
	while (r->end < n) {
		ssize_t got = read(r->fd, r->buffer + r->end, sizeof r->buffer - r->end);

		if (got < 0 && errno == EINTR)
			continue;
		if (got < 0) {
			err_sys(err, errno, "cannot read");
			return err_add_file(err, r->name);
		}
		if (got == 0)
			return read_error(r, ERR_TRUNCATED, "the file ends too early", err);
		r->end += (size_t)got;
	}
	return 0;
}

static int read_line(struct reader *r, char line[LINE], struct err *err)
{
	for (size_t n = 0; n < LINE; n++) {
		int rc = need_bytes(r, 1, err);

		if (rc)
			return rc;
		line[n] = (char)r->buffer[r->at++];
		if (line[n] == '\n') {
			line[n] = '\0';
			return 0;
		}
	}
	return read_error(r, ERR_INPUT, "this is no PLY file: a line of its header has no end", err);
}

static const char *text_after(const char *line, const char *head)
{
	size_t n = strlen(head);

	return strncmp(line, head, n) == 0 ? line + n : NULL;
}

static bool parse_digests(const char *text, struct check_mesh *m)
{
	char hex[2][40];
	int end = 0;

	return sscanf(text, "%39s %39s%n", hex[0], hex[1], &end) == 2 && !text[end] && digest_parse(hex[0], &m->digest) &&
	       digest_parse(hex[1], &m->vertex_digest);
}

static bool parse_origin(const char *text, struct check_mesh *m)
{
	char words[3][DECIMAL_TEXT_SIZE];
	int end = 0;

	if (sscanf(text, "%47s %47s %47s%n", words[0], words[1], words[2], &end) != 3 || text[end])
		return false;
	for (unsigned i = 0; i < 3; i++)
		if (!decimal_parse(words[i], &m->origin[i]))
			return false;
	return true;
}

static bool parse_comment(const char *text, struct ply_header *h, struct check_mesh *m)
{
	const char *value;

	if ((value = text_after(text, "acut-lattice ")))
		return !h->has_lattice && (h->has_lattice = lattice_parse(value, &m->lattice));
	if ((value = text_after(text, "acut-digest ")))
		return !m->has_digest && (m->has_digest = parse_digests(value, m));
	if ((value = text_after(text, "acut-origin ")))
		return parse_origin(value, m);
	if ((value = text_after(text, "acut-trimmed "))) {
		m->trimmed = true;
		m->bounded = strcmp(value, "bounded") == 0;
	}
	if ((value = text_after(text, "acut-units ")))
		sscanf(value, "%31s %31s", m->unit_xy, m->unit_z);
	if (text_after(text, "acut-z-unit "))
		h->converted = true;
	if ((value = text_after(text, "acut-crs ")))
		snprintf(m->crs, sizeof m->crs, "%.511s", value);
	return true;
}

static bool parse_property(const char *text, struct ply_header *h)
{
	static const char *const doubles[] = {"double x", "double y", "double z"};

	if (h->element == IN_VERTEX && h->doubles < 3)
		return strcmp(text, doubles[h->doubles++]) == 0;
	if (h->element == IN_FACE && h->faces && !h->edges)
		return h->edges = strcmp(text, "ushort edges") == 0;
	if (h->element != IN_FACE || h->faces)
		return false;
	h->faces = true;
	return strcmp(text, "list uchar int vertex_indices") == 0 || strcmp(text, "list uchar uint vertex_indices") == 0;
}

static bool parse_header_line(const char *line, struct ply_header *h, struct check_mesh *m)
{
	const char *value;

	if ((value = text_after(line, "comment ")))
		return parse_comment(value, h, m);
	if (strcmp(line, "format binary_little_endian 1.0") == 0)
		return h->format = true;
	if ((value = text_after(line, "element vertex ")) && h->element == IN_NONE) {
		h->element = IN_VERTEX;
		return parse_u64(value, &h->nvertex);
	}
	if ((value = text_after(line, "element face ")) && h->element == IN_VERTEX) {
		h->element = IN_FACE;
		return parse_u64(value, &h->nface);
	}
	value = text_after(line, "property ");
	return value && parse_property(value, h);
}

static int read_header(struct reader *r, struct ply_header *h, struct check_mesh *m, struct err *err)
{
	char line[LINE];
	int rc = read_line(r, line, err);

	if (rc)
		return rc;
	if (strcmp(line, "ply") != 0)
		return read_error(r, ERR_INPUT, "this is no PLY file", err);
	for (unsigned n = 0; n < LINES; n++) {
		if ((rc = read_line(r, line, err)))
			return rc;
		if (strcmp(line, "end_header") == 0)
			break;
		if (!parse_header_line(line, h, m)) {
			err_set(err, ERR_INPUT, "acutctl writes no such line: \"%.100s\"", line);
			err_add_place(err, r->offset + r->at, NULL);
			return err_add_file(err, r->name);
		}
	}
	if (!h->format || h->doubles != 3 || !h->faces)
		return read_error(r, ERR_INPUT, "the header lacks what acutctl writes", err);
	if (!h->has_lattice)
		return read_error(r, ERR_INPUT, "no comment acut-lattice: the coordinates cannot be taken back exactly", err);
	if (h->converted)
		return read_error(r, ERR_INPUT, "its heights were converted (comment acut-z-unit): write it without --z-unit",
				  err);
	if (h->nvertex > UINT32_MAX || h->nface > UINT32_MAX)
		return read_error(r, ERR_INPUT, "more vertices or faces than 32 bits can number", err);
	return 0;
}

/* One axis: coordinate = n * scale - origin, n = X + k, as one decimal: (n * a - b) * 10^e. */
struct axis {
	int64_t a, b, k;
	struct decimal unit; /* 10^e */
	double step, origin;
};

static bool shift_decimal(int64_t mantissa, int64_t exponent, int64_t *ret)
{
	for (; exponent > 0 && mantissa; exponent--)
		if (__builtin_mul_overflow(mantissa, (int64_t)10, &mantissa))
			return false;
	*ret = mantissa;
	return true;
}

static bool axis_init(struct axis *a, struct decimal scale, struct decimal origin, int64_t k)
{
	int32_t e = origin.mantissa && origin.exponent < scale.exponent ? origin.exponent : scale.exponent;

	a->k = k;
	a->unit = (struct decimal){1, e};
	a->step = decimal_double(scale);
	a->origin = decimal_double(origin);
	return shift_decimal(scale.mantissa, scale.exponent - e, &a->a) &&
	       shift_decimal(origin.mantissa, origin.exponent - e, &a->b);
}

static bool is_at(const struct axis *a, int64_t n, double v)
{
	int64_t whole;

	return !__builtin_mul_overflow(n, a->a, &whole) && !__builtin_sub_overflow(whole, a->b, &whole) &&
	       decimal_scaled_double(a->unit, whole) == v;
}

/* If two neighbours give the same double, doubles are too coarse for this lattice. */
static bool axis_number(const struct axis *a, double v, int32_t *ret)
{
	double guess = (v + a->origin) / a->step;
	int found = 0;

	if (!(fabs(guess) < 0x1p62))
		return false;
	for (int64_t n = (int64_t)guess - 3; n <= (int64_t)guess + 3; n++) {
		if (!is_at(a, n, v))
			continue;
		if (found++ || n - a->k < INT32_MIN || n - a->k > INT32_MAX)
			return false;
		*ret = (int32_t)(n - a->k);
	}
	return found == 1;
}

static int read_vertices(struct reader *r, struct check_mesh *m, struct err *err)
{
	struct axis axis[3];
	int rc;

	for (unsigned i = 0; i < 3; i++)
		if (!axis_init(&axis[i], i < 2 ? m->lattice.scale_xy : m->lattice.scale_z, m->origin[i], m->lattice.k[i]))
			return read_error(r, ERR_INPUT, "scale and origin have too many digits", err);
	for (size_t v = 0; v < m->nvertex; v++) {
		double xyz[3];

		if ((rc = need_bytes(r, VERTEX, err)))
			return rc;
		memcpy(xyz, r->buffer + r->at, sizeof xyz);
		for (unsigned i = 0; i < 3; i++) {
			if (axis_number(&axis[i], xyz[i], &m->vertex[v][i]))
				continue;
			err_set(err, ERR_INPUT, "%c of vertex %zu is %.17g, which is no coordinate of the lattice", "xyz"[i], v,
				xyz[i]);
			err_add_place(err, r->offset + r->at, NULL);
			return err_add_file(err, r->name);
		}
		r->at += VERTEX;
	}
	return 0;
}

static int read_faces(struct reader *r, struct check_mesh *m, struct err *err)
{
	const size_t face = FACE + (m->edges ? EDGES : 0);
	int rc;

	for (size_t t = 0; t < m->ntriangle; t++) {
		if ((rc = need_bytes(r, face, err)))
			return rc;
		if (r->buffer[r->at] != 3)
			return read_error(r, ERR_INPUT, "a face that is no triangle", err);
		memcpy(m->triangle[t], r->buffer + r->at + 1, 12);
		if (m->edges)
			m->edges[t] = r->buffer[r->at + FACE];
		r->at += face;
	}
	if (r->at < r->end || (rc = need_bytes(r, 1, err)) == 0)
		return read_error(r, ERR_INPUT, "bytes after the last face", err);
	if (rc != -ERR_TRUNCATED)
		return rc;
	err_clear(err); /* the end, at the right place */
	return 0;
}

int check_ply_read(int fd, const char *name, struct check_mesh *ret, struct err *err)
{
	struct reader *r = malloc(sizeof *r);
	struct check_mesh m = {0};
	struct ply_header h = {0};
	int rc;

	if (!r)
		return err_set(err, ERR_NOMEM, "no memory to read a file");
	r->fd = fd;
	r->name = name;
	r->at = r->end = 0;
	r->offset = 0;
	rc = read_header(r, &h, &m, err);
	if (rc == 0) {
		m.nvertex = h.nvertex;
		m.ntriangle = h.nface;
		m.vertex = malloc((m.nvertex ? m.nvertex : 1) * sizeof *m.vertex);
		m.triangle = malloc((m.ntriangle ? m.ntriangle : 1) * sizeof *m.triangle);
		m.edges = h.edges ? malloc(m.ntriangle ? m.ntriangle : 1) : NULL;
		if (!m.vertex || !m.triangle || (h.edges && !m.edges))
			rc = err_set(err, ERR_NOMEM, "no memory for %zu vertices and %zu triangles", m.nvertex, m.ntriangle);
	}
	if (rc == 0)
		rc = read_vertices(r, &m, err);
	if (rc == 0)
		rc = read_faces(r, &m, err);
	free(r);
	if (rc == 0)
		*ret = m;
	else
		check_mesh_clear(&m);
	return rc;
}

void check_mesh_clear(struct check_mesh *m)
{
	free(m->vertex);
	free(m->triangle);
	free(m->edges);
	m->edges = NULL;
	m->vertex = NULL;
	m->triangle = NULL;
}
