/*
 * From what a stream says of a mesh to what a sink gets. Nothing here talks to a daemon, so a program that makes a mesh itself
 * has the same checks, and its sinks get the same numbers and texts.
 */
#include "feed.h"

#include <string.h>

#include "call.h"
#include "parse.h"

static int from_sink(int r, struct err *err)
{
	return r == 0 ? 0 : err_set(err, ERR_CANCELLED, "the receiver of the mesh gave up");
}

/* ---- the lattice's text: "SXY SZ KX KY KZ" ---- */

static int get_lattice(struct feed *f, const char *text, struct err *err)
{
	char *word[5], *save = NULL, *at = f->lattice;
	struct decimal scale[2];
	unsigned n = 0;
	bool ok;

	strcpy(f->lattice, text);
	for (char *w = strtok_r(at, " ", &save); w && n < 5; w = strtok_r(NULL, " ", &save))
		word[n++] = w;
	ok = n == 5;
	for (unsigned i = 0; ok && i < 2; i++)
		ok = decimal_parse(word[i], &scale[i]) && scale[i].mantissa > 0 && strlen(word[i]) < DECIMAL_TEXT_SIZE;
	for (unsigned i = 0; ok && i < 3; i++)
		ok = parse_i64(word[2 + i], &f->head.k[i]) && f->head.k[i] >= -INT64_MAX / 2 && f->head.k[i] <= INT64_MAX / 2;
	if (!ok)
		return err_set(err, ERR_PROTO, "the mesh stream has no good lattice: \"%s\"", text);
	for (unsigned i = 0; i < 2; i++) {
		strcpy(f->scale[i], word[i]);
		f->head.scale_mantissa[i] = scale[i].mantissa;
		f->head.scale_exponent[i] = scale[i].exponent;
	}
	return 0;
}

int feed_begin(struct feed *f, const struct stream_head *head, struct err *err)
{
	int r = get_lattice(f, head->lattice, err);

	if (r < 0)
		return r;
	f->check = check_new(f->head.k);
	return f->check ? 0 : err_set(err, ERR_NOMEM, "there is no memory to check a mesh");
}

int feed_head(struct feed *f, const struct stream_head *head, struct err *err)
{
	f->head.lattice = head->lattice;
	f->head.scale_xy = f->scale[0];
	f->head.scale_z = f->scale[1];
	f->head.crs = head->crs;
	f->head.unit_xy = head->unit_xy;
	f->head.unit_z = head->unit_z;
	f->head.view = head->view;
	f->head.stream_id = digest_hex(head->id, f->stream_id);
	f->head.wkt = head->wkt ? head->wkt : "";
	f->head.geoid = head->geoid;
	f->head.lines = head->lines;
	f->head.bounded = head->bounded;
	call_system(head->crs, &f->head.epsg, &f->head.epsg_z, &f->head.vertical);
	memcpy(f->head.box, head->box, sizeof f->head.box);
	return f->sink->head ? from_sink(f->sink->head(f->sink->ctx, &f->head), err) : 0;
}

int feed_block(struct feed *f, const struct stream_block *b, struct err *err)
{
	struct acut_mesh_block out = {
		.index = b->index,
		.first = b->first,
		.foreign = b->foreign,
		.vertex = b->vertex,
		.triangle = b->triangle,
		.final = b->final,
		.flags = b->flags,
		.nforeign = b->nforeign,
		.nnew = b->nnew,
		.ntriangle = b->ntriangle,
		.origin = (const struct acut_mesh_origin *)(const void *)b->origin,
	};
	int r = check_block(f->check, b, &out.local, err);

	if (r < 0 || !f->sink->block)
		return r;
	memcpy(out.box, b->box, sizeof out.box);
	return from_sink(f->sink->block(f->sink->ctx, &out), err);
}

int feed_tail(struct feed *f, const struct stream_tail *tail, struct err *err)
{
	char digest[DIGEST_HEX_SIZE], vertex_digest[DIGEST_HEX_SIZE];
	struct acut_mesh_tail out = {
		.blocks = tail->blocks,
		.vertices = tail->vertices,
		.triangles = tail->triangles,
		.hull = tail->hull,
		.digest = digest_hex(tail->digest, digest),
		.vertex_digest = digest_hex(tail->vertex_digest, vertex_digest),
		.report = tail->report,
	};

	memcpy(out.box, tail->box, sizeof out.box);
	return f->sink->tail ? from_sink(f->sink->tail(f->sink->ctx, &out), err) : 0;
}

void feed_done(struct feed *f)
{
	f->check = check_free(f->check);
}
