/*
 * PLY, binary little-endian: all vertices (double x, y, z), then all faces (list uchar int, and of a mesh with lines ushort
 * edges: bit k says that the side across from corner k is a piece of a line).
 *
 * The stream mixes both, and its counts come at the end. Vertices are written in place, faces to an annex that is joined at
 * the end. The header is written first at its largest size and patched when the counts are known; a comment fills the rest.
 * Faces are in the order of the stream, but for fewer than 4096 that joining moves to the front. In canonical order all
 * vertices come before all faces, so both are written in place. If the output cannot seek both are kept aside. Face numbers
 * have 32 bits: int up to 2^31 - 1 vertices, uint up to 2^32 - 1; more are refused.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "format_axis.h"
#include "outfile.h"

#define PLY_HEADER 8192
#define PLY_FILL "comment "
#define PLY_VERTEX 24 /* bytes */
#define PLY_FACE 13   /* without edges */
#define PLY_EDGES 2   /* so that a face has an odd size, as outfile_join wants it */

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "records are written as they lie in memory");
_Static_assert(((uint64_t)UINT32_MAX + 1) * PLY_VERTEX + PLY_HEADER < OUTFILE_ANNEX_AT, "all vertices fit before it");

struct ply {
	struct outfile *out, *vertices, *faces; /* vertices: the output, or a spool */
	struct format_options opt;
	struct format_axis axis[3];
	uint64_t nvertex, nface;
	size_t face;    /* bytes of one */
	bool edges;     /* the mesh has lines */
	size_t header;  /* bytes kept for it */
	char *comments; /* lines of the head */
};

static int ply_comment(void *ctx, const char *text, struct err *err)
{
	struct ply *p = ctx;
	char *grown;

	if (asprintf(&grown, "%scomment %s\n", p->comments ? p->comments : "", text) < 0)
		return err_set(err, ERR_NOMEM, "no memory for a header");
	free(p->comments);
	p->comments = grown;
	return 0;
}

static int ply_header(const struct ply *p, const char *digest, const char *vertex_digest, uint64_t nvertex, uint64_t nface,
		      char buf[PLY_HEADER], struct err *err)
{
	const char *index = nvertex > (1u << 31) - 1 ? "uint" : "int";
	int n = snprintf(buf, PLY_HEADER,
			 "ply\nformat binary_little_endian 1.0\n%scomment acut-digest %s %s\n"
			 "element vertex %" PRIu64 "\nproperty double x\nproperty double y\nproperty double z\n"
			 "element face %" PRIu64 "\nproperty list uchar %s vertex_indices\n%send_header\n",
			 p->comments, digest, vertex_digest, nvertex, nface, index, p->edges ? "property ushort edges\n" : "");

	if (n < 0 || n >= PLY_HEADER - 64)
		return err_set(err, ERR_INTERNAL, "the PLY header is longer than %d bytes", PLY_HEADER);
	return n;
}

/* The header at exactly p->header bytes: a comment of dots before "end_header". */
static int ply_header_fill(const struct ply *p, char buf[PLY_HEADER], int n, struct err *err)
{
	static const char end[] = "end_header\n";
	size_t fill = p->header - (size_t)n, tail = sizeof(end) - 1;
	char *at = buf + n - tail;

	if (fill < sizeof(PLY_FILL) || p->header > PLY_HEADER)
		return err_set(err, ERR_INTERNAL, "the PLY header does not fit its place");
	memcpy(at, PLY_FILL, sizeof(PLY_FILL) - 1);
	memset(at + sizeof(PLY_FILL) - 1, '.', fill - sizeof(PLY_FILL));
	at[fill - 1] = '\n';
	memcpy(at + fill, end, tail);
	return 0;
}

static int ply_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	struct ply *p = calloc(1, sizeof(*p));

	if (!p)
		return err_set(err, ERR_NOMEM, "no memory for a writer");
	p->out = out;
	p->opt = *opt;
	*ret = p;
	return 0;
}

static int ply_begin(struct ply *p, const struct acut_mesh_head *head, struct err *err)
{
	int r = format_axis_init(p->axis, head, &p->opt, err);

	p->edges = head->lines;
	p->face = PLY_FACE + (p->edges ? PLY_EDGES : 0);
	return r ? r : format_comment_head(head, &p->opt, ply_comment, p, err);
}

/* Bytes that the header takes with the largest counts. */
static int ply_room(struct ply *p, struct err *err)
{
	static const char widest[] = "00000000000000000000000000000000";
	char buf[PLY_HEADER];
	int n = ply_header(p, widest, widest, UINT64_MAX, UINT64_MAX, buf, err);

	if (n < 0)
		return n;
	p->header = ((size_t)n + 2 * sizeof(PLY_FILL) + 7) & ~(size_t)7; /* keeps the doubles aligned */
	return 0;
}

static int ply_head(void *writer, const struct acut_mesh_head *head, struct err *err)
{
	struct ply *p = writer;
	char buf[PLY_HEADER];
	int r = ply_begin(p, head, err);

	if (!r && !outfile_seekable(p->out))
		r = outfile_spool(p->out, &p->vertices, err);
	if (!r && (p->vertices || !p->opt.canonical))
		r = outfile_annex(p->out, &p->faces, err);
	if (r || p->vertices)
		return r;
	if (!p->faces)
		p->faces = p->out;
	r = ply_room(p, err);
	if (r)
		return r;
	memset(buf, 0, sizeof(buf));
	p->vertices = p->out;
	r = outfile_write(p->out, buf, p->header, err);
	return r ? r : outfile_part_from_here(p->out, err);
}

static void ply_save(const void *writer, struct packer *to)
{
	const struct ply *p = writer;

	packer_u64(to, p->nvertex);
	packer_u64(to, p->nface);
	packer_u64(to, p->header);
}

static int ply_resume(void *writer, const struct acut_mesh_head *head, struct cursor *from, struct err *err)
{
	struct ply *p = writer;
	int r = ply_begin(p, head, err);

	if (!r)
		r = outfile_annex(p->out, &p->faces, err);
	p->vertices = p->out;
	p->nvertex = cursor_u64(from);
	p->nface = cursor_u64(from);
	p->header = cursor_u64(from);
	return r;
}

static int ply_vertices(struct ply *p, const int32_t (*v)[3], uint32_t n, struct err *err)
{
	while (n) {
		uint32_t left = (uint32_t)(outfile_left(p->vertices) / PLY_VERTEX), k = n < left ? n : left ? left : 1;
		double *to = outfile_room(p->vertices, k * (size_t)PLY_VERTEX, err);
		double aligned[3 * 512];

		if (!to)
			return -err->code;
		if ((uintptr_t)to % sizeof(double) == 0) {
			format_axis_values(p->axis, v, k, to);
		} else {
			k = k < 512 ? k : 512;
			format_axis_values(p->axis, v, k, aligned);
			memcpy(to, aligned, k * (size_t)PLY_VERTEX);
		}
		outfile_used(p->vertices, k * (size_t)PLY_VERTEX);
		v += k;
		n -= k;
	}
	return 0;
}

/* Two stores; the last bytes of the second are overwritten by the next face. */
static inline void ply_face(uint8_t *to, const uint64_t g[3], uint8_t flags)
{
	const uint64_t head = 3 | g[0] << 8 | g[1] << 40, rest = g[1] >> 24 | g[2] << 8 | (uint64_t)flags << 40;

	memcpy(to, &head, 8);
	memcpy(to + 8, &rest, 8);
}

static int ply_faces(struct ply *p, const struct acut_mesh_block *b, struct err *err)
{
	const uint32_t nf = b->nforeign, base = (uint32_t)(b->first - nf);

	for (uint32_t i = 0; i < b->ntriangle;) {
		uint32_t left = (uint32_t)(outfile_left(p->faces) / p->face), n = b->ntriangle - i;
		uint32_t k = n < left ? n : left ? left : 1;
		uint8_t *to = outfile_room(p->faces, k * p->face, err);

		if (!to)
			return -err->code;
		for (uint32_t end = i + k; i < end; i++, to += p->face) {
			uint64_t g[3];
			for (int j = 0; j < 3; j++) {
				uint32_t l = b->triangle[i][j];
				g[j] = l >= nf ? l + base : (uint32_t)b->foreign[l];
			}
			ply_face(to, g, b->flags ? b->flags[i] : 0);
		}
		outfile_used(p->faces, k * p->face);
	}
	return 0;
}

static int too_many(struct err *err)
{
	err_set(err, ERR_LIMIT, "PLY cannot number more than 4294967295 vertices");
	return err_add_hint(err, "write OBJ: -o NAME.obj");
}

static int ply_block(void *writer, const struct format_block *block, struct err *err)
{
	struct ply *p = writer;
	const struct acut_mesh_block *b = block->mesh;
	int r;

	if (p->nvertex + b->nnew > UINT32_MAX)
		return too_many(err);
	if (p->faces == p->out && p->nface && b->nnew)
		return err_set(err, ERR_INTERNAL, "a vertex comes after the faces");
	r = ply_vertices(p, b->vertex, b->nnew, err);
	if (!r)
		r = ply_faces(p, b, err);
	p->nvertex += b->nnew;
	p->nface += b->ntriangle;
	return r;
}

static int ply_finish(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	struct ply *p = writer;
	char buf[PLY_HEADER];
	int n = ply_header(p, tail->digest, tail->vertex_digest, p->nvertex, p->nface, buf, err), r = 0;

	if (n < 0)
		return n;
	if (p->vertices == p->out) {
		r = ply_header_fill(p, buf, n, err);
		if (!r)
			r = outfile_patch(p->out, 0, buf, p->header, err);
	} else {
		r = outfile_write(p->out, buf, (size_t)n, err);
		if (!r)
			r = outfile_join(p->out, p->vertices, PLY_VERTEX, err);
	}
	return r || p->faces == p->out ? r : outfile_join(p->out, p->faces, p->face, err);
}

/* ---- by several processes ---- */

static int ply_front(void *writer, const struct acut_mesh_head *head, const struct acut_mesh_tail *tail, uint8_t **ret,
		     size_t *ret_size, size_t *ret_triangle, struct err *err)
{
	struct ply *p = writer;
	char *buf;
	int n, r = tail->vertices > UINT32_MAX ? too_many(err) : ply_begin(p, head, err);

	if (!r)
		r = ply_room(p, err);
	if (r)
		return r;
	buf = malloc(PLY_HEADER);
	if (!buf)
		return err_set(err, ERR_NOMEM, "no memory for a header");
	n = ply_header(p, tail->digest, tail->vertex_digest, tail->vertices, tail->triangles, buf, err);
	r = n < 0 ? n : ply_header_fill(p, buf, n, err);
	if (r) {
		free(buf);
		return r;
	}
	*ret = (uint8_t *)buf;
	*ret_size = p->header;
	*ret_triangle = p->face;
	return 0;
}

static void ply_fixed_vertices(const void *writer, const int32_t (*v)[3], size_t n, uint8_t *to)
{
	const struct ply *p = writer;
	double value[3 * 512];

	for (size_t some; n; n -= some, v += some, to += some * PLY_VERTEX) {
		some = n < 512 ? n : 512;
		format_axis_values(p->axis, v, some, value);
		memcpy(to, value, some * PLY_VERTEX);
	}
}

static int ply_fixed_faces(const void *writer, const struct format_piece *piece, uint32_t first, uint32_t n, uint8_t *to,
			   struct err *err)
{
	const struct ply *p = writer;

	for (uint32_t i = first; i < first + n; i++, to += p->face) {
		uint64_t g[3];

		for (int j = 0; j < 3; j++) {
			uint32_t l = piece->triangle[i][j];
			g[j] = l < piece->nnumber ? piece->number[l] : (uint32_t)(l + piece->shift);
		}
		ply_face(to, g, piece->flags ? piece->flags[i] : 0);
	}
	return 0;
}

static const struct format_fixed ply_fixed = {PLY_VERTEX, ply_front, ply_fixed_vertices, ply_fixed_faces};

static void *ply_free(void *writer)
{
	struct ply *p = writer;

	if (!p)
		return NULL;
	if (p->vertices != p->out)
		outfile_free(p->vertices);
	if (p->faces != p->out)
		outfile_free(p->faces);
	free(p->comments);
	free(p);
	return NULL;
}

const struct format format_ply = {
	.name = "ply",
	.extensions = ".ply",
	.help = "binary little-endian PLY: double x, y, z; triangles counter-clockwise",
	.purpose = "QGIS (mesh layer), CloudCompare",
	.kind = FORMAT_MESH,
	.takes = FORMAT_CANONICAL | FORMAT_ORIGIN | FORMAT_Z_UNIT,
	.open = ply_open,
	.head = ply_head,
	.block = ply_block,
	.finish = ply_finish,
	.free = ply_free,
	.save = ply_save,
	.resume = ply_resume,
	.fixed = &ply_fixed,
};
