/*
 * Files of tiles: scripts that call one function of the page, which has their data as lines of base64 (docs/design/page.md). A
 * page from a folder may not read files by itself, but it may run scripts.
 */
#include <stdlib.h>

#include "acut.h"
#include "levels_priv.h"

enum { SLOTS = 1 << 19 }; /* more than twice the corners of a leaf */

struct ranked {
	uint64_t key;
	uint32_t vertex;
};

struct levels_buffers {
	struct levels_triangle *t; /* of a leaf */
	uint32_t *slot;            /* 1 + vertex, by place; 0: nothing */
	int32_t (*vertex)[3], (*sorted)[3];
	struct ranked *order;
	uint32_t *rank, (*face)[3];
	uint64_t number[LEVELS_SAMPLES + 4 * (1 + LEVELS_QUADS)];
};

int levels_buffers_new(struct levels *lv, struct err *err)
{
	struct levels_buffers *b = lv->buffers = calloc(1, sizeof(*b));
	size_t n = lv->opt.leaf, corners = 3 * n;

	if (!b)
		return levels_no_memory(err);
	b->t = malloc(n * sizeof(*b->t));
	b->slot = malloc(SLOTS * sizeof(*b->slot));
	b->vertex = malloc(corners * sizeof(*b->vertex));
	b->sorted = malloc(corners * sizeof(*b->sorted));
	b->order = malloc(corners * sizeof(*b->order));
	b->rank = malloc(corners * sizeof(*b->rank));
	b->face = malloc(n * sizeof(*b->face));
	if (!b->t || !b->slot || !b->vertex || !b->sorted || !b->order || !b->rank || !b->face)
		return levels_no_memory(err);
	return page_pack_new(&lv->pack, err);
}

void levels_buffers_free(struct levels *lv)
{
	struct levels_buffers *b = lv->buffers;

	page_pack_free(lv->pack);
	if (!b)
		return;
	free(b->t);
	free(b->slot);
	free(b->vertex);
	free(b->sorted);
	free(b->order);
	free(b->rank);
	free(b->face);
	free(b);
}

/* ---- files ---- */

const char *levels_tile_name(const struct levels_tile *tile, char *buf)
{
	snprintf(buf, OUTFILE_NAME, "tile_%u_%u_%u.js", tile->depth, tile->x, tile->y);
	return buf;
}

static int put(struct outfile *out, const char *text, struct err *err)
{
	return outfile_write(out, text, strlen(text), err);
}

static int begin(struct levels *lv, const struct levels_cell *cell, struct outfile **ret, struct err *err)
{
	char name[OUTFILE_NAME], text[OUTFILE_NAME + 100];
	uint64_t corner[2];
	struct levels_tile tile = {.depth = (uint8_t)cell->depth};
	int r = levels_grow((void **)&lv->tile, &lv->tile_room, lv->ntile, sizeof(*lv->tile), err);

	levels_corner(lv, cell, corner);
	tile.x = (uint32_t)(corner[0] >> (lv->bits - cell->depth));
	tile.y = (uint32_t)(corner[1] >> (lv->bits - cell->depth));
	if (!r)
		r = outfile_folder_file(lv->opt.folder, levels_tile_name(&tile, name), ret, err);
	if (r)
		return r;
	lv->tile[lv->ntile++] = tile;
	snprintf(text, sizeof(text), "acutTile(\"%s\",\"%u_%u_%u\",", lv->stamp, tile.depth, tile.x, tile.y);
	return put(*ret, text, err);
}

static int end(struct levels *lv, struct outfile *out, struct err *err)
{
	int r = put(out, "`);\n", err);

	if (!r)
		r = outfile_publish(out, err);
	lv->bytes += outfile_size(out);
	return r;
}

/* ---- leaves ---- */

/* The number of a vertex, a new one or one that was there. */
static uint32_t vertex_of(struct levels_buffers *b, const struct levels *lv, const struct levels_triangle *t, int j, uint32_t *n)
{
	uint64_t place = (uint64_t)t->at[j][0] << 32 | t->at[j][1];
	uint32_t slot = (uint32_t)(place * 0x9e3779b97f4a7c15u >> 45);
	int32_t v[3] = {(int32_t)(lv->low[0] + (int64_t)t->at[j][0]), (int32_t)(lv->low[1] + (int64_t)t->at[j][1]), t->z[j]};

	for (; b->slot[slot]; slot = (slot + 1) & (SLOTS - 1))
		if (!memcmp(b->vertex[b->slot[slot] - 1], v, 2 * sizeof(*v)))
			return b->slot[slot] - 1;
	memcpy(b->vertex[*n], v, sizeof(v));
	b->order[*n] = (struct ranked){levels_place_key(t->at[j]), *n};
	b->slot[slot] = ++*n;
	return *n - 1;
}

static int by_key(const void *a, const void *b)
{
	const struct ranked *x = a, *y = b;

	return x->key < y->key ? -1 : x->key > y->key;
}

static void grow_box(int32_t box[6], const int32_t *v, bool first)
{
	for (int k = 0; k < 3; k++) {
		box[k] = first || v[k] < box[k] ? v[k] : box[k];
		box[k + 3] = first || v[k] > box[k + 3] ? v[k] : box[k + 3];
	}
}

/* Vertices in the order of a curve through the plane, in which neighbours have near numbers. */
static uint32_t number_vertices(struct levels *lv, uint32_t count, struct levels_about *about)
{
	struct levels_buffers *b = lv->buffers;
	uint32_t n = 0;

	memset(b->slot, 0, SLOTS * sizeof(*b->slot));
	for (uint32_t i = 0; i < count; i++)
		for (int j = 0; j < 3; j++)
			b->face[i][j] = vertex_of(b, lv, &b->t[i], j, &n);
	qsort(b->order, n, sizeof(*b->order), by_key);
	for (uint32_t i = 0; i < n; i++) {
		memcpy(b->sorted[i], b->vertex[b->order[i].vertex], sizeof(*b->sorted));
		b->rank[b->order[i].vertex] = i;
		grow_box(about->box, b->sorted[i], !i);
	}
	for (uint32_t i = 0; i < count; i++)
		for (int j = 0; j < 3; j++)
			b->face[i][j] = b->rank[b->face[i][j]];
	return n;
}

int levels_put_leaf(struct levels *lv, const struct levels_leaf *leaf, uint64_t first, struct levels_about *about,
		    struct err *err)
{
	struct levels_buffers *b = lv->buffers;
	struct outfile *out = NULL;
	struct acut_mesh_block block = {.triangle = (const uint32_t(*)[3])b->face, .ntriangle = leaf->count};
	int r = outfile_read(lv->own, first * sizeof(*b->t), b->t, leaf->count * sizeof(*b->t), err);
	char text[60];

	if (r)
		return r;
	about->grid = false;
	about->triangles = leaf->count;
	block.nnew = number_vertices(lv, leaf->count, about);
	snprintf(text, sizeof(text), "{\"vertices\":%u,\"triangles\":%u},`\n", block.nnew, leaf->count);
	r = begin(lv, &leaf->cell, &out, err);
	if (!r)
		r = put(out, text, err);
	if (!r)
		r = page_pack_vertices(lv->pack, out, (const int32_t(*)[3])b->sorted, block.nnew, err);
	if (!r)
		r = put(out, "`,`\n", err);
	if (!r)
		r = page_pack_faces(lv->pack, out, &block, 0, err);
	if (!r)
		r = end(lv, out, err);
	outfile_free(out);
	return r;
}

/* ---- grids ---- */

void levels_put_about(FILE *f, const struct levels_about *a)
{
	if (!a->triangles) {
		fputs("null", f);
		return;
	}
	fprintf(f, "{\"triangles\":%llu,\"grid\":%s,\"error\":%.3f,\"lost\":%.3f,\"box\":[%d,%d,%d,%d,%d,%d]}",
		(unsigned long long)a->triangles, a->grid ? "true" : "false", a->grid ? a->error : 0, a->grid ? a->lost : 0,
		a->box[0], a->box[1], a->box[2], a->box[3], a->box[4], a->box[5]);
}

/* Heights, each as the difference from the one before it in its row, or at the row's begin from that of the row before; 0 where
 * there is none. */
static size_t put_heights(const struct levels_grid *g, uint64_t *to)
{
	int64_t row = 0;

	for (int j = 0; j < LEVELS_ROW; j++) {
		int64_t last = row;
		bool first = true;

		for (int i = 0; i < LEVELS_ROW; i++) {
			size_t at = (size_t)j * LEVELS_ROW + i;
			int64_t d = g->z[at] - last;

			to[at] = g->has[at] ? 1 + ((uint64_t)d << 1 ^ (uint64_t)(d >> 63)) : 0;
			if (!g->has[at])
				continue;
			last = g->z[at];
			if (first)
				row = last;
			first = false;
		}
	}
	return LEVELS_SAMPLES;
}

/* For each child how many runs of quads there are, and their lengths: those that are not met first, then those that are, ... */
static size_t put_border(const uint8_t *border, uint64_t *to)
{
	size_t n = 0;
	uint8_t now = 0;

	for (size_t i = 0; i < LEVELS_QUADS;) {
		size_t from = i;

		while (i < LEVELS_QUADS && border[i] == now)
			i++;
		now = !now;
		to[++n] = i - from;
	}
	to[0] = n;
	return 1 + n;
}

static int put_children(struct outfile *out, const struct levels_grid *g, struct err *err)
{
	char *text = NULL;
	size_t size = 0;
	FILE *f = open_memstream(&text, &size);
	int r = 0;

	if (f) {
		fputs("{\"children\":[", f);
		for (int i = 0; i < 4; i++) {
			fputs(i ? "," : "", f);
			levels_put_about(f, &g->child[i]);
		}
		fputs("]},`\n", f);
	}
	if (!f || fclose(f))
		r = levels_no_memory(err);
	if (!r)
		r = outfile_write(out, text, size, err);
	free(text);
	return r;
}

int levels_put_grid(struct levels *lv, const struct levels_grid *g, struct err *err)
{
	uint64_t *number = lv->buffers->number;
	struct outfile *out = NULL;
	size_t n = put_heights(g, number);
	int r = begin(lv, &g->cell, &out, err);

	for (int i = 0; i < 4; i++)
		n += put_border(g->border[i], number + n);
	if (!r)
		r = put_children(out, g, err);
	if (!r)
		r = page_pack_numbers(lv->pack, out, number, n, err);
	if (!r)
		r = end(lv, out, err);
	outfile_free(out);
	return r;
}
