/*
 * STL, binary: triangles with their corners and normal, as 32-bit floats. No vertices, no units, no coordinate system.
 *
 * Triangles are written as they come, and their number goes to the header at the end. Where the output cannot seek they are kept
 * aside. The origin is in the header, as exact text.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "format_float.h"
#include "outfile.h"

enum { STL_TEXT = 80, STL_HEADER = 84, STL_TRIANGLE = 50 };

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "records are written as they lie in memory");

struct stl {
	struct outfile *out, *body; /* body: the output, or a spool */
	struct format_options opt;
	struct format_float floats;
	uint64_t nface;
	char text[STL_TEXT + 1];
};

static int stl_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	struct stl *s = calloc(1, sizeof(*s));

	if (!s)
		return err_set(err, ERR_NOMEM, "no memory for a writer");
	s->out = out;
	s->opt = *opt;
	*ret = s;
	return 0;
}

/* What both ways of a begin need. A text that begins with "solid" would be that of the other STL. */
static int stl_begin(struct stl *s, const struct acut_mesh_head *head, struct err *err)
{
	char origin[FORMAT_COMMENT];
	int r = format_float_init(&s->floats, "STL", head, &s->opt, err);

	if (r)
		return r;
	format_axis_origin(head, &s->opt, origin, sizeof(origin));
	if (strlen(origin) > STL_TEXT) {
		err_set(err, ERR_USAGE, "the origin has more digits than the header of STL has room for");
		return err_add_hint(err, "give --origin with fewer decimals");
	}
	memcpy(s->text, origin[0] ? origin : "acut", strlen(origin[0] ? origin : "acut"));
	return 0;
}

static int stl_head(void *writer, const struct acut_mesh_head *head, struct err *err)
{
	const uint8_t header[STL_HEADER] = {0};
	struct stl *s = writer;
	int r = stl_begin(s, head, err);

	if (!r && !outfile_seekable(s->out))
		return outfile_spool(s->out, &s->body, err);
	s->body = s->out;
	if (!r)
		r = outfile_write(s->out, header, sizeof(header), err);
	return r ? r : outfile_part_from_here(s->out, err);
}

static void stl_save(const void *writer, struct packer *to)
{
	packer_u64(to, ((const struct stl *)writer)->nface);
}

static int stl_resume(void *writer, const struct acut_mesh_head *head, struct cursor *from, struct err *err)
{
	struct stl *s = writer;

	s->body = s->out;
	s->nface = cursor_u64(from);
	return stl_begin(s, head, err);
}

/* The unit vector that the corners turn about; 0 where they are on a line. */
static void normal_of(const double p[9], float ret[3])
{
	double a[3], b[3], n[3], length;

	for (int i = 0; i < 3; i++) {
		a[i] = p[3 + i] - p[i];
		b[i] = p[6 + i] - p[i];
	}
	for (int i = 0; i < 3; i++)
		n[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
	length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
	for (int i = 0; i < 3; i++)
		ret[i] = length > 0 ? (float)(n[i] / length) : 0;
}

static void triangle(const struct stl *s, const int32_t (*position)[3], const uint32_t t[3], uint8_t to[STL_TRIANGLE])
{
	int32_t corner[3][3];
	double p[9];
	float f[12];

	for (int i = 0; i < 3; i++)
		memcpy(corner[i], position[t[i]], sizeof(corner[i]));
	format_axis_values(s->floats.axis, (const int32_t(*)[3])corner, 3, p);
	normal_of(p, f);
	for (int i = 0; i < 9; i++)
		f[3 + i] = (float)p[i];
	memcpy(to, f, sizeof(f));
	memset(to + sizeof(f), 0, STL_TRIANGLE - sizeof(f));
}

/* Those of the triangles: other vertices are not written. */
static int check_corners(const struct stl *s, const int32_t (*position)[3], const uint32_t (*triangle)[3], uint32_t n,
			 struct err *err)
{
	int32_t range[2][3] = FORMAT_FLOAT_NOTHING;

	for (uint32_t i = 0; i < n; i++)
		for (int j = 0; j < 3; j++)
			format_float_range(range, position[triangle[i][j]]);
	return format_float_check(&s->floats, (const int32_t(*)[3])range, err);
}

static int too_many(struct err *err)
{
	err_set(err, ERR_LIMIT, "STL cannot count more than 4294967295 triangles");
	return err_add_hint(err, "write PLY or OBJ, or tiles: --tile");
}

static int stl_block(void *writer, const struct format_block *block, struct err *err)
{
	struct stl *s = writer;
	const struct acut_mesh_block *b = block->mesh;

	if (s->nface + b->ntriangle > UINT32_MAX)
		return too_many(err);
	if (check_corners(s, block->position, b->triangle, b->ntriangle, err))
		return -err->code;
	for (uint32_t i = 0; i < b->ntriangle; i++) {
		uint8_t *to = outfile_room(s->body, STL_TRIANGLE, err);

		if (!to)
			return -err->code;
		triangle(s, block->position, b->triangle[i], to);
		outfile_used(s->body, STL_TRIANGLE);
	}
	s->nface += b->ntriangle;
	return 0;
}

static void stl_header(const struct stl *s, uint32_t n, uint8_t header[STL_HEADER])
{
	memcpy(header, s->text, STL_TEXT);
	memcpy(header + STL_TEXT, &n, sizeof(n));
}

static int stl_finish(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	struct stl *s = writer;
	uint8_t header[STL_HEADER];
	int r;

	stl_header(s, (uint32_t)s->nface, header);
	if (s->body == s->out)
		return outfile_patch(s->out, 0, header, sizeof(header), err);
	r = outfile_write(s->out, header, sizeof(header), err);
	return r ? r : outfile_join(s->out, s->body, STL_TRIANGLE, err);
}

/* ---- by several processes ---- */

static int stl_front(void *writer, const struct acut_mesh_head *head, const struct acut_mesh_tail *tail, uint8_t **ret,
		     size_t *ret_size, size_t *ret_triangle, struct err *err)
{
	struct stl *s = writer;
	uint8_t *header;
	int r = tail->triangles > UINT32_MAX ? too_many(err) : stl_begin(s, head, err);

	if (r)
		return r;
	header = malloc(STL_HEADER);
	if (!header)
		return err_set(err, ERR_NOMEM, "no memory for a header");
	stl_header(s, (uint32_t)tail->triangles, header);
	*ret = header;
	*ret_size = STL_HEADER;
	*ret_triangle = STL_TRIANGLE;
	return 0;
}

static int stl_fixed_triangles(const void *writer, const struct format_piece *piece, uint32_t first, uint32_t n, uint8_t *to,
			       struct err *err)
{
	const struct stl *s = writer;
	int r = check_corners(s, piece->position, piece->triangle + first, n, err);

	for (uint32_t i = first; i < first + n && !r; i++, to += STL_TRIANGLE)
		triangle(s, piece->position, piece->triangle[i], to);
	return r;
}

static const struct format_fixed stl_fixed = {0, stl_front, NULL, stl_fixed_triangles};

static void *stl_free(void *writer)
{
	struct stl *s = writer;

	if (s && s->body != s->out)
		outfile_free(s->body);
	free(s);
	return NULL;
}

const struct format format_stl = {
	.name = "stl",
	.extensions = ".stl",
	.help = "binary STL: 32-bit floats, so most meshes need --origin auto",
	.purpose = "printing, simulation",
	.kind = FORMAT_MESH,
	.takes = FORMAT_CANONICAL | FORMAT_ORIGIN | FORMAT_Z_UNIT,
	.positions = true,
	.open = stl_open,
	.head = stl_head,
	.block = stl_block,
	.finish = stl_finish,
	.free = stl_free,
	.save = stl_save,
	.resume = stl_resume,
	.fixed = &stl_fixed,
};
