/*
 * GLB, glTF 2.0 in one binary file: positions as 32-bit floats, y up (east, height, -north), and indices of 32 bits.
 *
 * A file is a header, a chunk of JSON and a chunk of bytes, positions first. Positions are written in place, indices to an annex.
 * The JSON is written first at its largest size and patched when counts, sizes and bounds are known (format_glb_json.c). If the
 * output cannot seek, positions are kept aside, too. All sizes in the file have 32 bits. Normals are left out: viewers shade flat
 * then.
 */
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "format_float.h"
#include "format_glb.h"
#include "outfile.h"

enum { GLB_RECORD = 12, GLB_PIECE = 512, GLB_HEADER = 20, GLB_CHUNK = 8 }; /* a vertex or triangle; at once; bytes */

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "records are written as they lie in memory");

struct glb {
	struct outfile *out, *vertices, *faces; /* vertices: the output, or a spool */
	struct format_options opt;
	struct format_float floats;
	struct glb_scene scene;
	size_t json; /* bytes kept for it */
};

static int glb_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	struct glb *g = calloc(1, sizeof(*g));

	if (!g)
		return err_set(err, ERR_NOMEM, "no memory for a writer");
	g->out = out;
	g->opt = *opt;
	*ret = g;
	return 0;
}

/* Bytes before the positions. */
static size_t before(const struct glb *g)
{
	return GLB_HEADER + g->json + GLB_CHUNK;
}

static int glb_begin(struct glb *g, const struct acut_mesh_head *head, struct err *err)
{
	int r = format_float_init(&g->floats, "GLB", head, &g->opt, err);

	return r ? r : format_glb_extras(&g->scene, head, &g->opt, err);
}

static int glb_head(void *writer, const struct acut_mesh_head *head, struct err *err)
{
	struct glb *g = writer;
	int r = glb_begin(g, head, err);
	char *text;

	if (!r)
		r = format_glb_json_widest(&g->scene, &g->json, err);
	if (!r && !outfile_seekable(g->out))
		r = outfile_spool(g->out, &g->vertices, err);
	if (!r)
		r = outfile_annex(g->out, &g->faces, err);
	if (r || g->vertices)
		return r;
	g->vertices = g->out;
	text = calloc(1, before(g));
	r = text ? outfile_write(g->out, text, before(g), err) : err_set(err, ERR_NOMEM, "no memory for a header");
	free(text);
	return r ? r : outfile_part_from_here(g->out, err);
}

static void glb_save(const void *writer, struct packer *to)
{
	const struct glb *g = writer;

	packer_u64(to, g->scene.nvertex);
	packer_u64(to, g->scene.nface);
	packer_u64(to, g->json);
	packer_bytes(to, g->scene.min, sizeof(g->scene.min));
	packer_bytes(to, g->scene.max, sizeof(g->scene.max));
}

static int glb_resume(void *writer, const struct acut_mesh_head *head, struct cursor *from, struct err *err)
{
	struct glb *g = writer;
	int r = glb_begin(g, head, err);
	const uint8_t *bounds;

	g->vertices = g->out;
	g->scene.nvertex = cursor_u64(from);
	g->scene.nface = cursor_u64(from);
	g->json = cursor_u64(from);
	bounds = cursor_bytes(from, sizeof(g->scene.min) + sizeof(g->scene.max));
	if (bounds) {
		memcpy(g->scene.min, bounds, sizeof(g->scene.min));
		memcpy(g->scene.max, bounds + sizeof(g->scene.min), sizeof(g->scene.max));
	}
	return r ? r : outfile_annex(g->out, &g->faces, err);
}

static int glb_vertices(struct glb *g, const int32_t (*v)[3], uint32_t n, struct err *err)
{
	struct glb_scene *s = &g->scene;

	for (uint32_t i = 0, k; i < n; i += k) {
		double p[3 * GLB_PIECE];
		float f[3 * GLB_PIECE];
		int r;

		k = n - i < GLB_PIECE ? n - i : GLB_PIECE;
		format_axis_values(g->floats.axis, v + i, k, p);
		for (uint32_t j = 0; j < k; j++) {
			f[3 * j] = (float)p[3 * j];
			f[3 * j + 1] = (float)p[3 * j + 2];
			f[3 * j + 2] = (float)(0 - p[3 * j + 1]); /* no -0 */
		}
		for (uint32_t j = 0; j < 3 * k; j++) {
			bool first = !s->nvertex && j < 3;

			s->min[j % 3] = first || f[j] < s->min[j % 3] ? f[j] : s->min[j % 3];
			s->max[j % 3] = first || f[j] > s->max[j % 3] ? f[j] : s->max[j % 3];
		}
		r = outfile_write(g->vertices, f, k * (size_t)GLB_RECORD, err);
		if (r)
			return r;
		s->nvertex += k;
	}
	return 0;
}

static int glb_faces(struct glb *g, const struct acut_mesh_block *b, struct err *err)
{
	const uint32_t nf = b->nforeign, base = (uint32_t)(b->first - nf);

	for (uint32_t i = 0, k; i < b->ntriangle; i += k) {
		uint32_t *to = outfile_room(g->faces, GLB_PIECE * GLB_RECORD, err);

		if (!to)
			return -err->code;
		k = b->ntriangle - i < GLB_PIECE ? b->ntriangle - i : GLB_PIECE;
		for (uint32_t j = 0; j < 3 * k; j++) {
			uint32_t l = b->triangle[i + j / 3][j % 3];

			to[j] = l >= nf ? l + base : (uint32_t)b->foreign[l];
		}
		outfile_used(g->faces, k * (size_t)GLB_RECORD);
	}
	g->scene.nface += b->ntriangle;
	return 0;
}

static int glb_block(void *writer, const struct format_block *block, struct err *err)
{
	struct glb *g = writer;
	const struct acut_mesh_block *b = block->mesh;
	int32_t range[2][3] = FORMAT_FLOAT_NOTHING;
	uint64_t records = g->scene.nvertex + g->scene.nface + b->nnew + b->ntriangle;
	int r;

	if (records > UINT32_MAX || before(g) + records * GLB_RECORD + OUTFILE_BUFFER_KEPT > UINT32_MAX) {
		err_set(err, ERR_LIMIT, "a GLB file cannot be larger than 4 GiB, and the mesh needs more");
		return err_add_hint(err, "write PLY, -o NAME.ply, or tiles: --tile");
	}
	for (uint32_t i = 0; i < b->nnew; i++)
		format_float_range(range, b->vertex[i]);
	r = format_float_check(&g->floats, (const int32_t(*)[3])range, err);
	if (!r)
		r = glb_vertices(g, b->vertex, b->nnew, err);
	return r ? r : glb_faces(g, b, err);
}

/* All before the positions. Without any, the place of the other chunk's header is filled, too. */
static int glb_put_header(struct glb *g, const struct acut_mesh_tail *tail, struct err *err)
{
	const struct glb_scene *s = &g->scene;
	uint64_t bytes = s->nface ? s->faces_at + s->nface * GLB_RECORD : s->nvertex * GLB_RECORD;
	uint32_t json = (uint32_t)(g->json + (bytes ? 0 : GLB_CHUNK));
	uint32_t header[5] = {0x46546c67, 2, (uint32_t)(before(g) + bytes), json, 0x4e4f534a}; /* "glTF", "JSON" */
	uint32_t chunk[2] = {(uint32_t)bytes, 0x004e4942};                                     /* "BIN" */
	char *text = malloc(before(g));
	int r = text ? 0 : err_set(err, ERR_NOMEM, "no memory for a header");

	if (!r)
		r = format_glb_json(s, tail, text + GLB_HEADER, json, err);
	if (!r) {
		memcpy(text, header, sizeof(header));
		if (bytes)
			memcpy(text + GLB_HEADER + g->json, chunk, sizeof(chunk));
		r = g->vertices == g->out ? outfile_patch(g->out, 0, text, before(g), err) :
					    outfile_write(g->out, text, before(g), err);
	}
	free(text);
	return r;
}

static int glb_finish(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	struct glb *g = writer;
	struct glb_scene *s = &g->scene;
	bool aside = g->vertices != g->out;
	uint64_t end = before(g) + s->nvertex * GLB_RECORD;
	int r;

	s->faces_at = outfile_padded(end, g->faces) - before(g);
	r = aside ? glb_put_header(g, tail, err) : 0;
	if (!r && aside)
		r = outfile_join(g->out, g->vertices, GLB_RECORD, err);
	if (!r)
		r = outfile_pad(g->out, g->faces, 0, err);
	if (!r)
		r = outfile_join(g->out, g->faces, 0, err);
	return r || aside ? r : glb_put_header(g, tail, err);
}

static void *glb_free(void *writer)
{
	struct glb *g = writer;

	if (!g)
		return NULL;
	if (g->vertices != g->out)
		outfile_free(g->vertices);
	outfile_free(g->faces);
	free(g->scene.extras);
	free(g);
	return NULL;
}

const struct format format_glb = {
	.name = "glb",
	.extensions = ".glb",
	.help = "glTF 2.0, binary: y up, 32-bit floats, so most meshes need --origin auto",
	.purpose = "Blender, viewers, browsers",
	.kind = FORMAT_MESH,
	.takes = FORMAT_CANONICAL | FORMAT_ORIGIN | FORMAT_Z_UNIT,
	.open = glb_open,
	.head = glb_head,
	.block = glb_block,
	.finish = glb_finish,
	.free = glb_free,
	.save = glb_save,
	.resume = glb_resume,
};
