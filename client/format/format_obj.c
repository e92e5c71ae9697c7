/*
 * Wavefront OBJ: text, exact decimals of the lattice numbers, faces with 1-based numbers.
 *
 * Vertices and faces may alternate in this format, so blocks are written as they come and nothing is kept. Counts and digests
 * are comments at the end, where they are known.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "cursor.h"
#include "err.h"
#include "format_digits.h"
#include "format_axis.h"
#include "outfile.h"

enum { LINES = 64, VERTEX_LINE = 3 * FORMAT_COORDINATE + 8, FACE_LINE = 72 }; /* at once; bytes at most */

struct obj {
	struct outfile *out;
	struct format_options opt;
	struct format_axis axis[3];
	uint64_t nvertex, nface;
};

static int obj_comment(void *ctx, const char *text, struct err *err)
{
	struct obj *o = ctx;
	char line[FORMAT_COMMENT + 8];
	int n = snprintf(line, sizeof(line), "# %s\n", text);

	return outfile_write(o->out, line, (size_t)n, err);
}

static int obj_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	struct obj *o = calloc(1, sizeof(*o));

	if (!o)
		return err_set(err, ERR_NOMEM, "no memory for a writer");
	o->out = out;
	o->opt = *opt;
	*ret = o;
	return 0;
}

static int obj_head(void *writer, const struct acut_mesh_head *head, struct err *err)
{
	struct obj *o = writer;
	int r = format_axis_init(o->axis, head, &o->opt, err);

	return r ? r : format_comment_head(head, &o->opt, obj_comment, o, err);
}

static void obj_save(const void *writer, struct packer *to)
{
	const struct obj *o = writer;

	packer_u64(to, o->nvertex);
	packer_u64(to, o->nface);
}

static int obj_resume(void *writer, const struct acut_mesh_head *head, struct cursor *from, struct err *err)
{
	struct obj *o = writer;

	o->nvertex = cursor_u64(from);
	o->nface = cursor_u64(from);
	return format_axis_init(o->axis, head, &o->opt, err);
}

static int obj_block(void *writer, const struct format_block *block, struct err *err)
{
	struct obj *o = writer;
	const struct acut_mesh_block *b = block->mesh;

	for (uint32_t i = 0, end; i < b->nnew; i = end) {
		char *start = outfile_room(o->out, LINES * VERTEX_LINE, err), *at = start;

		if (!start)
			return -err->code;
		for (end = b->nnew - i < LINES ? b->nnew : i + LINES; i < end; i++) {
			*at++ = 'v';
			for (int j = 0; j < 3; j++) {
				*at++ = ' ';
				at = format_axis_text(&o->axis[j], b->vertex[i][j], at);
			}
			*at++ = '\n';
		}
		outfile_used(o->out, (size_t)(at - start));
	}
	for (uint32_t i = 0, end; i < b->ntriangle; i = end) {
		char *start = outfile_room(o->out, LINES * FACE_LINE, err), *at = start;

		if (!start)
			return -err->code;
		for (end = b->ntriangle - i < LINES ? b->ntriangle : i + LINES; i < end; i++) {
			*at++ = 'f';
			for (int j = 0; j < 3; j++) {
				uint32_t l = b->triangle[i][j];
				uint64_t n = l >= b->nforeign ? b->first + (l - b->nforeign) : b->foreign[l];
				*at++ = ' ';
				at = format_digits_put(n + 1, at);
			}
			*at++ = '\n';
		}
		outfile_used(o->out, (size_t)(at - start));
	}
	o->nvertex += b->nnew;
	o->nface += b->ntriangle;
	return 0;
}

static int obj_finish(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	struct obj *o = writer;
	char text[FORMAT_COMMENT];
	int r;

	snprintf(text, sizeof(text), "acut-counts %" PRIu64 " %" PRIu64, o->nvertex, o->nface);
	r = obj_comment(o, text, err);
	snprintf(text, sizeof(text), "acut-digest %s %s", tail->digest, tail->vertex_digest);
	return r ? r : obj_comment(o, text, err);
}

static void *obj_free(void *writer)
{
	free(writer);
	return NULL;
}

const struct format format_obj = {
	.name = "obj",
	.extensions = ".obj",
	.help = "Wavefront OBJ: exact decimals as text",
	.purpose = "modelling programs, scripts",
	.kind = FORMAT_MESH,
	.takes = FORMAT_CANONICAL | FORMAT_ORIGIN | FORMAT_Z_UNIT,
	.open = obj_open,
	.head = obj_head,
	.block = obj_block,
	.finish = obj_finish,
	.free = obj_free,
	.save = obj_save,
	.resume = obj_resume,
};
