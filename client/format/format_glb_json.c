/*
 * The JSON of a GLB file: one mesh of one primitive with one material, seen from both sides.
 *
 * What other formats have in comments, the exact origin among it, is in asset.extras. Bounds are those of the floats, with all of
 * their digits. Without triangles the primitive is points; without vertices there is an empty scene, since glTF has no empty
 * arrays.
 */
#include <float.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "format_axis.h"
#include "format_glb.h"
#include "format_text.h"

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory for a header");
}

static int add_extra(void *ctx, const char *text, struct err *err)
{
	struct glb_scene *s = ctx;
	size_t n = strcspn(text, " ");
	char value[FORMAT_TEXT_GROWTH * FORMAT_COMMENT], *grown;

	format_text(FORMAT_TEXT_JSON, text[n] ? text + n + 1 : "", value, sizeof(value));
	if (asprintf(&grown, "%s\"%.*s\":\"%s\",", s->extras ? s->extras : "", (int)n, text, value) < 0)
		return no_memory(err);
	free(s->extras);
	s->extras = grown;
	return 0;
}

int format_glb_extras(struct glb_scene *s, const struct acut_mesh_head *head, const struct format_options *opt, struct err *err)
{
	return format_comment_head(head, opt, add_extra, s, err);
}

static void put_bounds(FILE *f, const char *name, const float v[3])
{
	fprintf(f, ",\"%s\":[%.9g,%.9g,%.9g]", name, (double)v[0], (double)v[1], (double)v[2]);
}

static void put_mesh(FILE *f, const struct glb_scene *s)
{
	uint64_t vertices = 12 * s->nvertex, faces = 12 * s->nface;

	fputs(",\"nodes\":[{\"mesh\":0}],\"materials\":[{\"doubleSided\":true,\"pbrMetallicRoughness\":{\"baseColorFactor\":"
	      "[0.7,0.7,0.7,1],\"metallicFactor\":0,\"roughnessFactor\":1}}],\"meshes\":[{\"primitives\":[{\"attributes\":"
	      "{\"POSITION\":0},\"material\":0",
	      f);
	fputs(s->nface ? ",\"indices\":1}]}]" : ",\"mode\":0}]}]", f);
	fprintf(f, ",\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"type\":\"VEC3\",\"count\":%" PRIu64, s->nvertex);
	put_bounds(f, "min", s->min);
	put_bounds(f, "max", s->max);
	if (s->nface)
		fprintf(f, "},{\"bufferView\":1,\"componentType\":5125,\"type\":\"SCALAR\",\"count\":%" PRIu64, 3 * s->nface);
	fprintf(f, "}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":%" PRIu64 ",\"target\":34962", vertices);
	if (s->nface)
		fprintf(f, "},{\"buffer\":0,\"byteOffset\":%" PRIu64 ",\"byteLength\":%" PRIu64 ",\"target\":34963", s->faces_at,
			faces);
	fprintf(f, "}],\"buffers\":[{\"byteLength\":%" PRIu64 "}]", s->nface ? s->faces_at + faces : vertices);
}

static int make(const struct glb_scene *s, const struct acut_mesh_tail *tail, char **ret, size_t *ret_size, struct err *err)
{
	FILE *f = open_memstream(ret, ret_size);

	if (!f)
		return no_memory(err);
	fprintf(f,
		"{\"asset\":{\"version\":\"2.0\",\"generator\":\"acut\",\"extras\":{%s\"acut-digest\":\"%s %s\"}},\"scene\":0,\"scenes\":[{",
		s->extras, tail->digest, tail->vertex_digest);
	if (s->nvertex) {
		fputs("\"nodes\":[0]}]", f);
		put_mesh(f, s);
		fputc('}', f);
	} else {
		fputs("}]}", f);
	}
	return fclose(f) ? no_memory(err) : 0;
}

int format_glb_json_widest(const struct glb_scene *s, size_t *ret, struct err *err)
{
	static const char digest[] = "00000000000000000000000000000000";
	const struct acut_mesh_tail tail = {.digest = digest, .vertex_digest = digest};
	struct glb_scene widest = {.extras = s->extras, .nvertex = UINT32_MAX, .nface = UINT32_MAX, .faces_at = UINT32_MAX};
	char *text = NULL;
	int r;

	for (int i = 0; i < 3; i++)
		widest.min[i] = widest.max[i] = -FLT_MIN; /* -1.17549435e-38 */
	r = make(&widest, &tail, &text, ret, err);
	free(text);
	*ret = (*ret + 3) & ~(size_t)3;
	return r;
}

int format_glb_json(const struct glb_scene *s, const struct acut_mesh_tail *tail, char *to, size_t size, struct err *err)
{
	char *text = NULL;
	size_t n = 0;
	int r = make(s, tail, &text, &n, err);

	if (!r && n > size)
		r = err_set(err, ERR_INTERNAL, "the JSON of GLB does not fit its place");
	if (!r) {
		memcpy(to, text, n);
		memset(to + n, ' ', size - n);
	}
	free(text);
	return r;
}
