/*
 * LandXML 1.2: one TIN surface, exact decimals, points as "northing easting elevation", faces with 1-based numbers.
 *
 * All points come before the faces, so these go to an annex. Blanks fill the file up to a place where the annex is joined
 * without copying; between elements they have no meaning. format_landxml_head.c writes what is around points and faces.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "format_axis.h"
#include "format_digits.h"
#include "format_landxml.h"
#include "outfile.h"

enum { LINES = 64, POINT_LINE = 3 * FORMAT_COORDINATE + 48, FACE_LINE = 88 }; /* at once; bytes at most */

struct landxml {
	struct outfile *out, *faces;
	struct format_options opt;
	struct format_axis axis[3];
	uint64_t npoint, nface;
};

static int landxml_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	struct landxml *x = calloc(1, sizeof(*x));

	if (!x)
		return err_set(err, ERR_NOMEM, "no memory for a writer");
	x->out = out;
	x->opt = *opt;
	*ret = x;
	return 0;
}

static int landxml_head(void *writer, const struct acut_mesh_head *head, struct err *err)
{
	struct landxml *x = writer;
	int r = format_axis_init(x->axis, head, &x->opt, err);

	if (!r)
		r = format_landxml_head(x->out, head, &x->opt, err);
	return r ? r : outfile_annex(x->out, &x->faces, err);
}

static void landxml_save(const void *writer, struct packer *to)
{
	const struct landxml *x = writer;

	packer_u64(to, x->npoint);
	packer_u64(to, x->nface);
}

static int landxml_resume(void *writer, const struct acut_mesh_head *head, struct cursor *from, struct err *err)
{
	struct landxml *x = writer;
	int r = format_axis_init(x->axis, head, &x->opt, err);

	x->npoint = cursor_u64(from);
	x->nface = cursor_u64(from);
	return r ? r : outfile_annex(x->out, &x->faces, err);
}

static char *put_point(const struct landxml *x, uint64_t id, const int32_t v[3], char *at)
{
	at = stpcpy(at, "<P id=\"");
	at = format_digits_put(id, at);
	at = stpcpy(at, "\">");
	at = format_axis_text(&x->axis[1], v[1], at);
	*at++ = ' ';
	at = format_axis_text(&x->axis[0], v[0], at);
	*at++ = ' ';
	at = format_axis_text(&x->axis[2], v[2], at);
	return stpcpy(at, "</P>\n");
}

static char *put_face(const struct acut_mesh_block *b, const uint32_t t[3], char *at)
{
	at = stpcpy(at, "<F>");
	for (int j = 0; j < 3; j++) {
		uint64_t n = t[j] >= b->nforeign ? b->first + (t[j] - b->nforeign) : b->foreign[t[j]];

		at = format_digits_put(n + 1, at);
		*at++ = ' ';
	}
	return stpcpy(at - 1, "</F>\n");
}

static int landxml_block(void *writer, const struct format_block *block, struct err *err)
{
	struct landxml *x = writer;
	const struct acut_mesh_block *b = block->mesh;

	if (outfile_size(x->out) + (uint64_t)b->nnew * POINT_LINE > OUTFILE_ANNEX_AT) {
		err_set(err, ERR_LIMIT, "the points of a LandXML file cannot be more than 128 GiB");
		return err_add_hint(err, "write OBJ: -o NAME.obj, or tiles: --tile");
	}
	for (uint32_t i = 0, end; i < b->nnew; i = end) {
		char *start = outfile_room(x->out, LINES * POINT_LINE, err), *at = start;

		if (!start)
			return -err->code;
		for (end = b->nnew - i < LINES ? b->nnew : i + LINES; i < end; i++)
			at = put_point(x, b->first + i + 1, b->vertex[i], at);
		outfile_used(x->out, (size_t)(at - start));
	}
	for (uint32_t i = 0, end; i < b->ntriangle; i = end) {
		char *start = outfile_room(x->faces, LINES * FACE_LINE, err), *at = start;

		if (!start)
			return -err->code;
		for (end = b->ntriangle - i < LINES ? b->ntriangle : i + LINES; i < end; i++)
			at = put_face(b, b->triangle[i], at);
		outfile_used(x->faces, (size_t)(at - start));
	}
	x->npoint += b->nnew;
	x->nface += b->ntriangle;
	return 0;
}

static int landxml_finish(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	static const char faces[] = "</Pnts>\n<Faces>\n";
	struct landxml *x = writer;
	char counts[FORMAT_COMMENT], digest[FORMAT_COMMENT];
	int r = outfile_write(x->out, faces, sizeof(faces) - 1, err);

	if (!r)
		r = outfile_pad(x->out, x->faces, ' ', err);
	if (!r)
		r = outfile_join(x->out, x->faces, 0, err);
	snprintf(counts, sizeof(counts), "acut-counts %" PRIu64 " %" PRIu64, x->npoint, x->nface);
	snprintf(digest, sizeof(digest), "acut-digest %s %s", tail->digest, tail->vertex_digest);
	return r ? r : format_landxml_tail(x->out, counts, digest, err);
}

static void *landxml_free(void *writer)
{
	struct landxml *x = writer;

	if (x)
		outfile_free(x->faces);
	free(x);
	return NULL;
}

const struct format format_landxml = {
	.name = "landxml",
	.extensions = ".xml .landxml",
	.help = "LandXML 1.2: a TIN surface in exact decimals; units must be known",
	.purpose = "Civil 3D, road design",
	.kind = FORMAT_MESH,
	.takes = FORMAT_CANONICAL | FORMAT_ORIGIN | FORMAT_Z_UNIT,
	.open = landxml_open,
	.head = landxml_head,
	.block = landxml_block,
	.finish = landxml_finish,
	.free = landxml_free,
	.save = landxml_save,
	.resume = landxml_resume,
};
