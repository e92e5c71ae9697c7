/*
 * One file a tile, made from the sorted triangles of all.
 *
 * The triangles of a tile come as three positions each. They go through the canonical order (outputs_canonical.c), which
 * gives each vertex one number: a tile's file depends on its triangles alone, neither on the order of the stream nor on how
 * the mesh was cut into domains, and vertices on a shared edge have the same coordinates in both tiles. A tile larger than
 * memory is sorted on the disk as a whole mesh is. Pictures need no numbers and get the triangles as they are; their vertices
 * are only counted.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "outputs_tile.h"

enum { PIECE = 1024 }; /* triangles in one block */

struct maker {
	struct outputs_tiles *tiles;
	struct outputs_tile *tile;
	size_t at; /* which one */
	struct outfile *out;
	void *writer;
	struct outputs_canonical *canonical;
	struct format counter; /* between the canonical order and the writer */
	int32_t vertex[3 * PIECE][3];
	uint32_t triangle[PIECE][3];
	uint8_t flags[PIECE];
	uint32_t n;
};

static bool is_picture(const struct outputs_tiles *t)
{
	return t->format->kind == FORMAT_PICTURE;
}

static int count_block(void *ctx, const struct format_block *block, struct err *err)
{
	struct maker *m = ctx;
	const struct acut_mesh_block *b = block->mesh;

	digest_add_vertices(&m->tile->vertex_digest, m->tiles->head.k, b->vertex, b->nnew);
	m->tile->vertices += b->nnew;
	return is_picture(m->tiles) ? 0 : m->tiles->format->block(m->writer, block, err);
}

static int send(struct maker *m, struct err *err)
{
	struct acut_mesh_block b = {.nnew = 3 * m->n,
				    .ntriangle = m->n,
				    .vertex = (const int32_t(*)[3])m->vertex,
				    .flags = m->tiles->head.lines ? m->flags : NULL,
				    .triangle = (const uint32_t(*)[3])m->triangle};
	const struct format_block block = {&b, b.vertex};
	int r = 0;

	if (m->n && is_picture(m->tiles))
		r = m->tiles->format->block(m->writer, &block, err);
	if (m->n && !r)
		r = outputs_canonical_block(m->canonical, &block, err);
	m->n = 0;
	return r;
}

static int add(struct maker *m, const uint64_t *rec, struct err *err)
{
	const uint32_t z[3] = {(uint32_t)(rec[4] >> 32), (uint32_t)rec[4], (uint32_t)rec[5]};
	int r = 0;

	if (m->n == PIECE) {
		r = outputs_interrupted(&m->tiles->run, err);
		r = r ? r : send(m, err);
	}
	for (uint32_t j = 0; j < 3; j++) {
		int32_t *v = m->vertex[3 * m->n + j];

		v[0] = (int32_t)((uint32_t)(rec[1 + j] >> 32) ^ 1u << 31);
		v[1] = (int32_t)((uint32_t)rec[1 + j] ^ 1u << 31);
		v[2] = (int32_t)z[j];
		m->triangle[m->n][j] = 3 * m->n + j;
	}
	m->flags[m->n++] = (uint8_t)(rec[5] >> 32);
	return r;
}

/* A tile needs 72 bytes a triangle to be sorted in memory, and most need no more than a part of what there is. */
static uint64_t memory_of(const struct outputs_tiles *t, const struct outputs_tile *tile)
{
	uint64_t most = t->run.sort_memory / 2, need = (tile->triangles + 1) * 3 * 48;

	return need < most ? need : most;
}

static int start(struct maker *m, const char *name, struct err *err)
{
	struct outputs_tiles *t = m->tiles;
	struct acut_mesh_head head = t->head;
	int r = outfile_folder_file(t->place, name, &m->out, err);

	m->counter = (struct format){.block = count_block, .positions = t->format->positions && !is_picture(t)};
	if (is_picture(t)) {
		memcpy(head.box, m->tile->box, sizeof(head.box));
		head.box[2] = t->tail.is.box[2]; /* one range of heights for all */
		head.box[5] = t->tail.is.box[5];
	}
	if (!r)
		r = t->format->open(m->out, &t->opt, &m->writer, err);
	if (!r)
		r = t->format->head(m->writer, &head, err);
	if (!r)
		r = outputs_canonical_new(&m->counter, m, m->out, &t->run, memory_of(t, m->tile),
					  OUTPUTS_MERGE | (t->head.lines ? OUTPUTS_LINES : 0), &m->canonical, err);
	return r;
}

static int finish(struct maker *m, struct err *err)
{
	char digest[DIGEST_HEX_SIZE], vertex_digest[DIGEST_HEX_SIZE];
	struct acut_mesh_tail tail = {.triangles = m->tile->triangles, .report = "{}"};
	int r = send(m, err);

	if (!r)
		r = outputs_canonical_finish(m->canonical, err);
	tail.vertices = m->tile->vertices;
	tail.digest = digest_hex(m->tile->digest, digest);
	tail.vertex_digest = digest_hex(m->tile->vertex_digest, vertex_digest);
	memcpy(tail.box, m->tile->box, sizeof(tail.box));
	if (!r)
		r = m->tiles->format->finish(m->writer, &tail, err);
	if (!r)
		r = outfile_publish(m->out, err);
	if (!r)
		m->tile->bytes = outfile_size(m->out);
	return r;
}

static void done(struct maker *m)
{
	m->canonical = outputs_canonical_free(m->canonical);
	if (m->writer)
		m->writer = m->tiles->format->free(m->writer);
	m->out = outfile_free(m->out);
}

/* The next tile, that of *rec; *rec becomes the first record after it, or NULL. */
static int make(struct maker *m, const uint64_t **rec, struct err *err)
{
	struct outputs_tiles *t = m->tiles;
	uint64_t number = (*rec)[0], n = 0;
	char name[OUTFILE_NAME];
	int r = outputs_interrupted(&t->run, err);

	m->tile = &t->tile[m->at];
	if (!r && (m->at == t->ntile || m->tile->number != number))
		return err_set(err, ERR_INTERNAL, "triangles of no tile came back from the sort");
	if (!r)
		r = start(m, outputs_tiles_name(t, m->at, name), err);
	while (!r && *rec && (*rec)[0] == number) {
		r = add(m, *rec, err);
		n++;
		if (!r)
			r = sort_next(t->sort, rec, err);
	}
	if (!r && n != m->tile->triangles)
		r = err_set(err, ERR_INTERNAL, "a tile lost triangles: %llu of %llu came back from the sort",
			    (unsigned long long)n, (unsigned long long)m->tile->triangles);
	if (!r)
		r = finish(m, err);
	done(m);
	m->at++;
	return r;
}

int outputs_tiles_make(struct outputs_tiles *t, struct err *err)
{
	struct maker *m = calloc(1, sizeof(*m));
	const uint64_t *rec = NULL;
	int r = m ? sort_start(t->sort, err) : err_set(err, ERR_NOMEM, "no memory to make tiles");

	if (!r)
		r = sort_next(t->sort, &rec, err);
	outputs_tiles_order(t);
	if (!r)
		m->tiles = t;
	while (!r && rec)
		r = make(m, &rec, err);
	t->sort = sort_free(t->sort);
	free(m);
	return r;
}
