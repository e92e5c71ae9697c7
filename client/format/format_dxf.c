/*
 * DXF of release 12, ASCII: each triangle is a 3DFACE on layer TIN, with its third corner twice; or, with --polyface, triangles
 * are polyface meshes (format_dxf_polyface.c). Exact decimals. Release 12 has neither units nor coordinate systems: comments
 * (code 999) name them.
 *
 * Triangles are written as they come. $EXTMIN and $EXTMAX are those of the corners, patched at the end: their texts are filled up
 * with zeros behind the decimal point. Where the output cannot seek they are left out: the box of the head is not tight.
 */
#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "format_dxf.h"
#include "format_text.h"
#include "outfile.h"

enum { FACES = 16, FACE = 4 * DXF_POINT + 32, EXTENTS = 2 * DXF_POINT + 64 }; /* at once; bytes at most */

struct dxf {
	struct outfile *out;
	struct format_options opt;
	struct format_axis axis[3];
	struct dxf_polyface *polyface;
	uint64_t extents; /* where they are */
	int width[3];     /* of their texts */
	int32_t box[6];   /* of the corners; empty: min above max */
};

static int put(struct dxf *d, const char *text, struct err *err)
{
	return outfile_write(d->out, text, strlen(text), err);
}

static int put_comment(void *ctx, const char *text, struct err *err)
{
	struct dxf *d = ctx;
	char line[FORMAT_COMMENT];
	int r = put(d, "999\n", err);

	if (!r)
		r = put(d, format_text(FORMAT_TEXT_ASCII, text, line, sizeof(line)), err);
	return r ? r : put(d, "\n", err);
}

char *format_dxf_point(const struct format_axis axis[3], const int32_t v[3], int corner, char *at)
{
	for (int j = 0; j < 3; j++) {
		*at++ = (char)('1' + j);
		*at++ = (char)('0' + corner);
		*at++ = '\n';
		at = format_axis_text(&axis[j], v[j], at);
		*at++ = '\n';
	}
	return at;
}

/* ---- extents ---- */

static char *filled(const struct dxf *d, int axis, int32_t x, char *at)
{
	char *end = format_axis_text(&d->axis[axis], x, at), *to = at + d->width[axis];

	if (!memchr(at, '.', (size_t)(end - at)))
		*end++ = '.';
	assert(end <= to);
	while (end < to)
		*end++ = '0';
	return end;
}

static char *zeros(const struct dxf *d, int axis, char *at)
{
	memset(at, '0', (size_t)d->width[axis]);
	at[1] = '.';
	return at + d->width[axis];
}

/* Of nothing: zeros. */
static size_t put_extents(const struct dxf *d, const int32_t box[6], char buf[EXTENTS])
{
	bool none = box[0] > box[3];

	char *at = buf;

	for (int i = 0; i < 2; i++) {
		at = stpcpy(at, i ? "9\n$EXTMAX\n" : "9\n$EXTMIN\n");
		for (int j = 0; j < 3; j++) {
			*at++ = (char)('1' + j);
			*at++ = '0';
			*at++ = '\n';
			at = none ? zeros(d, j, at) : filled(d, j, box[3 * i + j], at);
			*at++ = '\n';
		}
	}
	return (size_t)(at - buf);
}

/* The longest text that a number of the axis may have, whatever the mesh: its extents are patched when they are known. */
static int width_of(const struct format_axis *ax)
{
	int decimals = ax->converted ? ax->decimals : ax->whole ? -ax->e : -ax->scale.exponent, whole = 0;

	for (int i = 0; i < 2; i++) {
		char text[FORMAT_COORDINATE + 8];
		int n;

		*format_axis_text(ax, i ? INT32_MAX : INT32_MIN, text) = 0;
		n = (int)strcspn(text, ".");
		whole = n > whole ? n : whole;
	}
	return whole + 2 + (decimals > 0 ? decimals : 1);
}

static int set_up(struct dxf *d, const struct acut_mesh_head *head, struct err *err)
{
	int r = format_axis_init(d->axis, head, &d->opt, err);

	for (int i = 0; i < 3; i++) {
		d->box[i] = INT32_MAX;
		d->box[i + 3] = INT32_MIN;
	}
	for (int i = 0; i < 3 && !r; i++)
		d->width[i] = width_of(&d->axis[i]);
	return r || !d->opt.polyface ? r : format_dxf_polyface_new(&d->polyface, err);
}

/* ---- the writer ---- */

static int dxf_open(struct outfile *out, const struct format_options *opt, void **ret, struct err *err)
{
	struct dxf *d = calloc(1, sizeof(*d));

	if (!d)
		return err_set(err, ERR_NOMEM, "no memory for a writer");
	d->out = out;
	d->opt = *opt;
	*ret = d;
	return 0;
}

static int dxf_head(void *writer, const struct acut_mesh_head *head, struct err *err)
{
	struct dxf *d = writer;
	char extents[EXTENTS];
	int r = set_up(d, head, err);

	if (!r)
		r = format_comment_head(head, &d->opt, put_comment, d, err);
	if (!r && d->opt.polyface)
		r = put_comment(d,
				"acut-polyface a mesh ends with a block of the stream, or at 32767 vertices or faces: "
				"vertices on its border are in several",
				err);
	if (!r)
		r = put(d, "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1009\n", err);
	if (r)
		return r;
	d->extents = outfile_size(d->out);
	if (outfile_seekable(d->out))
		r = outfile_write(d->out, extents, put_extents(d, d->box, extents), err);
	if (!r)
		r = put(d,
			"0\nENDSEC\n0\nSECTION\n2\nTABLES\n0\nTABLE\n2\nLTYPE\n70\n1\n0\nLTYPE\n2\nCONTINUOUS\n70\n64\n3\nSolid line\n"
			"72\n65\n73\n0\n40\n0.0\n0\nENDTAB\n0\nTABLE\n2\nLAYER\n70\n2\n0\nLAYER\n2\n0\n70\n64\n62\n7\n6\nCONTINUOUS\n"
			"0\nLAYER\n2\nTIN\n70\n64\n62\n7\n6\nCONTINUOUS\n0\nENDTAB\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n",
			err);
	return r ? r : outfile_part_from_here(d->out, err);
}

static void dxf_save(const void *writer, struct packer *to)
{
	const struct dxf *d = writer;

	packer_u64(to, d->extents);
	packer_u64(to, d->opt.polyface);
	for (int i = 0; i < 6; i++)
		packer_i32(to, d->box[i]);
}

static int dxf_resume(void *writer, const struct acut_mesh_head *head, struct cursor *from, struct err *err)
{
	struct dxf *d = writer;
	int r = set_up(d, head, err);

	d->extents = cursor_u64(from);
	if (!r && cursor_u64(from) != d->opt.polyface) {
		err_set(err, ERR_USAGE, "the kept part was written %s --polyface", d->opt.polyface ? "without" : "with");
		return err_add_hint(err, "resume with the options of the earlier fetch, or fetch without --resume");
	}
	for (int i = 0; i < 6; i++)
		d->box[i] = cursor_i32(from);
	return r;
}

static int put_faces(struct dxf *d, const struct format_block *block, struct err *err)
{
	const struct acut_mesh_block *b = block->mesh;

	for (uint32_t i = 0, end; i < b->ntriangle; i = end) {
		char *start = outfile_room(d->out, FACES * FACE, err), *at = start;

		if (!start)
			return -err->code;
		for (end = b->ntriangle - i < FACES ? b->ntriangle : i + FACES; i < end; i++) {
			char *third = NULL;
			size_t n;

			at = stpcpy(at, "0\n3DFACE\n" DXF_LAYER);
			for (int j = 0; j < 3; j++) {
				third = at;
				at = format_dxf_point(d->axis, block->position[b->triangle[i][j]], j, at);
			}
			n = (size_t)(at - third);
			memcpy(at, third, n);
			for (int j = 0; j < 3; j++) { /* the same lines with codes 13, 23, 33 */
				at[1] = '3';
				at = (char *)memchr(at + 3, '\n', n) + 1;
			}
		}
		outfile_used(d->out, (size_t)(at - start));
	}
	return 0;
}

static int dxf_block(void *writer, const struct format_block *block, struct err *err)
{
	struct dxf *d = writer;
	const struct acut_mesh_block *b = block->mesh;

	for (uint32_t i = 0; i < b->ntriangle; i++) {
		for (int j = 0; j < 9; j++) {
			int32_t x = block->position[b->triangle[i][j / 3]][j % 3];

			d->box[j % 3] = x < d->box[j % 3] ? x : d->box[j % 3];
			d->box[j % 3 + 3] = x > d->box[j % 3 + 3] ? x : d->box[j % 3 + 3];
		}
	}
	if (d->polyface)
		return format_dxf_polyface_block(d->polyface, d->axis, block, d->out, err);
	return put_faces(d, block, err);
}

static int dxf_finish(void *writer, const struct acut_mesh_tail *tail, struct err *err)
{
	struct dxf *d = writer;
	char text[FORMAT_COMMENT], extents[EXTENTS];
	int r = put(d, "0\nENDSEC\n", err);

	snprintf(text, sizeof(text), "acut-digest %s %s", tail->digest, tail->vertex_digest);
	if (!r)
		r = put_comment(d, text, err);
	if (!r)
		r = put(d, "0\nEOF\n", err);
	if (r || !outfile_seekable(d->out))
		return r;
	return outfile_patch(d->out, d->extents, extents, put_extents(d, d->box, extents), err);
}

static void *dxf_free(void *writer)
{
	struct dxf *d = writer;

	if (d)
		format_dxf_polyface_free(d->polyface);
	free(d);
	return NULL;
}

const struct format format_dxf = {
	.name = "dxf",
	.extensions = ".dxf",
	.help = "DXF R12: a 3DFACE a triangle, or polyface meshes (--polyface); exact decimals",
	.purpose = "CAD",
	.kind = FORMAT_MESH,
	.takes = FORMAT_CANONICAL | FORMAT_ORIGIN | FORMAT_Z_UNIT | FORMAT_POLYFACE,
	.positions = true,
	.open = dxf_open,
	.head = dxf_head,
	.block = dxf_block,
	.finish = dxf_finish,
	.free = dxf_free,
	.save = dxf_save,
	.resume = dxf_resume,
};
