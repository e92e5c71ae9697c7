/*
 * --canonical: one order of vertices and triangles, whatever order the stream had.
 *
 * Vertices are numbered by (x, y); triangles begin with their smallest number and are sorted by their numbers. As positions
 * are distinct, the order of numbers is the order of positions: triangles are sorted as three positions and need no old
 * numbers. Sorted vertices are sent to the writer; their keys go to a nameless file, with heights if the format asks for
 * positions, and the first key of each page is kept in memory. Each corner is looked up there, most of them in a small table
 * of recent answers. Memory: two sort buffers, 8 bytes for 512 vertices, 4 MiB.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grow.h"
#include "outputs_priv.h"

#define PAGE_KEYS 512
#define PAGES 256 /* kept in memory */
#define RECENT (1u << 16)
#define PIECE 8192 /* vertices or triangles in one block for the writer */

struct page {
	uint64_t number;                /* + 1; 0 = empty */
	uint64_t record[2 * PAGE_KEYS]; /* keys; with positions each with its height */
};

struct outputs_canonical {
	const struct format *format;
	void *writer;
	struct sort *vertices, *triangles;
	struct outfile *keys;     /* of the vertices, in order */
	size_t words;             /* of a record of it: 1, or 2 with positions */
	bool lines;               /* triangles have flags */
	bool merge;               /* the same vertex comes more than once */
	uint64_t nvertex, *first; /* first key of each page */
	size_t npage, first_room;
	struct page *page;
	struct {
		uint64_t key, number, height;
	} * recent;
	uint64_t *foreign; /* 3 * PIECE */
	uint32_t (*index)[3];
	uint8_t *flags;
	int32_t (*position)[3]; /* PIECE of vertices; with positions 3 * PIECE of corners */
};

/* A record of a triangle: its corners, and in a mesh with lines its flags, both from the corner with the lowest key on. */
enum { CORNERS = 3 };

static uint64_t key_of(const int32_t *p)
{
	return (uint64_t)((uint32_t)p[0] ^ 1u << 31) << 32 | ((uint32_t)p[1] ^ 1u << 31);
}

int outputs_canonical_new(const struct format *format, void *writer, const struct outfile *beside,
			  const struct outputs_options *run, uint64_t memory, unsigned how, struct outputs_canonical **ret,
			  struct err *err)
{
	struct outputs_canonical *c = calloc(1, sizeof(*c));
	int r = c ? 0 : err_set(err, ERR_NOMEM, "no memory to sort with");

	if (!r)
		r = sort_new(2, 1, memory / 3, beside, &c->vertices, err);
	if (!r)
		r = sort_new(CORNERS + !!(how & OUTPUTS_LINES), CORNERS, memory - memory / 3, beside, &c->triangles, err);
	if (!r)
		r = outfile_spool(beside, &c->keys, err);
	if (!r) {
		c->format = format;
		c->writer = writer;
		c->words = format->positions ? 2 : 1;
		c->lines = how & OUTPUTS_LINES;
		c->merge = how & OUTPUTS_MERGE;
		sort_interrupt(c->vertices, run->interrupted, run->ctx);
		sort_interrupt(c->triangles, run->interrupted, run->ctx);
		c->page = calloc(PAGES, sizeof(*c->page));
		c->recent = calloc(RECENT, sizeof(*c->recent));
		c->foreign = malloc(3 * PIECE * sizeof(*c->foreign));
		c->index = malloc(PIECE * sizeof(*c->index));
		c->flags = malloc(PIECE);
		c->position = malloc(3 * PIECE * sizeof(*c->position));
		if (!c->page || !c->recent || !c->foreign || !c->index || !c->flags || !c->position)
			r = err_set(err, ERR_NOMEM, "no memory to sort with");
	}
	if (r) {
		outputs_canonical_free(c);
		return r;
	}
	*ret = c;
	return 0;
}

int outputs_canonical_block(struct outputs_canonical *c, const struct format_block *block, struct err *err)
{
	const struct acut_mesh_block *b = block->mesh;
	int r = 0;

	for (uint32_t i = 0; i < b->nnew && !r; i++) {
		uint64_t rec[2] = {key_of(b->vertex[i]), (uint32_t)b->vertex[i][2]};
		r = sort_add(c->vertices, rec, err);
	}
	for (uint32_t i = 0; i < b->ntriangle && !r; i++) {
		uint64_t k[3], rec[CORNERS + 1];
		int low = 0;

		for (int j = 0; j < 3; j++) {
			k[j] = key_of(block->position[b->triangle[i][j]]);
			if (k[j] < k[low])
				low = j;
		}
		for (int j = 0; j < 3; j++)
			rec[j] = k[(low + j) % 3];
		rec[CORNERS] = b->flags ? (b->flags[i] >> low | b->flags[i] << (3 - low)) & 7 : 0;
		r = sort_add(c->triangles, rec, err);
	}
	return r;
}

static int first_add(struct outputs_canonical *c, uint64_t key, struct err *err)
{
	if (!grow(&c->first, &c->first_room, c->npage + 1, 1024, sizeof(*c->first)))
		return err_set(err, ERR_NOMEM, "no memory for an index of %zu pages", c->npage + 1);
	c->first[c->npage++] = key;
	return 0;
}

static int send(struct outputs_canonical *c, const struct acut_mesh_block *b, struct err *err)
{
	const struct format_block block = {b, c->format->positions ? (const int32_t(*)[3])c->position : NULL};

	return c->format->block(c->writer, &block, err);
}

static void set_position(int32_t *to, uint64_t key, uint64_t height)
{
	to[0] = (int32_t)((uint32_t)(key >> 32) ^ 1u << 31);
	to[1] = (int32_t)((uint32_t)key ^ 1u << 31);
	to[2] = (int32_t)(uint32_t)height;
}

static int send_vertices(struct outputs_canonical *c, struct err *err)
{
	const uint64_t *rec;
	uint64_t last[2] = {0};
	uint32_t n = 0;
	int r = sort_start(c->vertices, err);

	while (!r && !(r = sort_next(c->vertices, &rec, err))) {
		if (c->merge && rec && c->nvertex && rec[0] == last[0]) {
			if (rec[1] != last[1])
				r = err_set(err, ERR_PROTO, "the stream has two heights for one vertex");
			continue;
		}
		if (n == PIECE || (!rec && n)) {
			struct acut_mesh_block b = {
				.first = c->nvertex - n, .nnew = n, .vertex = (const int32_t(*)[3])c->position};
			r = send(c, &b, err);
			n = 0;
		}
		if (r || !rec)
			break;
		memcpy(last, rec, sizeof(last));
		set_position(c->position[n++], rec[0], rec[1]);
		if (c->nvertex++ % PAGE_KEYS == 0)
			r = first_add(c, rec[0], err);
		if (!r)
			r = outfile_write(c->keys, rec, c->words * sizeof(*rec), err);
	}
	c->vertices = sort_free(c->vertices);
	return r;
}

/* The number of the last entry of a sorted array that is not above `key`; the keys are `words` apart. */
static size_t last_not_above(const uint64_t *a, size_t words, size_t n, uint64_t key)
{
	size_t low = 0;

	while (n > 1) {
		size_t half = n / 2;
		if (a[words * (low + half)] <= key)
			low += half;
		n -= half;
	}
	return low;
}

/* The vertex of a key: its number and its height, which is 0 without positions. */
static int look_up(struct outputs_canonical *c, uint64_t key, uint64_t *ret, uint64_t *ret_height, struct err *err)
{
	const size_t record = c->words * sizeof(*c->page->record);
	size_t slot = (size_t)(key * 0x9e3779b97f4a7c15u >> 48) & (RECENT - 1), at;
	uint64_t number, n;
	struct page *p;
	int r;

	if (c->recent[slot].number && c->recent[slot].key == key) {
		*ret = c->recent[slot].number - 1;
		*ret_height = c->recent[slot].height;
		return 0;
	}
	if (!c->npage)
		return err_set(err, ERR_PROTO, "the stream has triangles and no vertices");
	number = last_not_above(c->first, 1, c->npage, key);
	n = c->nvertex - number * PAGE_KEYS < PAGE_KEYS ? c->nvertex - number * PAGE_KEYS : PAGE_KEYS;
	p = &c->page[number % PAGES];
	if (p->number != number + 1) {
		p->number = 0;
		r = outfile_read(c->keys, number * PAGE_KEYS * record, p->record, n * record, err);
		if (r)
			return r;
		p->number = number + 1;
	}
	at = last_not_above(p->record, c->words, n, key);
	if (p->record[c->words * at] != key)
		return err_set(err, ERR_PROTO, "a triangle of the stream has a corner that is no vertex");
	*ret = number * PAGE_KEYS + at;
	*ret_height = c->words > 1 ? p->record[2 * at + 1] : 0;
	c->recent[slot].key = key;
	c->recent[slot].number = *ret + 1;
	c->recent[slot].height = *ret_height;
	return 0;
}

static int send_triangles(struct outputs_canonical *c, struct err *err)
{
	const uint64_t *rec;
	uint32_t n = 0;
	int r = sort_start(c->triangles, err);

	while (!r && !(r = sort_next(c->triangles, &rec, err))) {
		if (n == PIECE || (!rec && n)) {
			struct acut_mesh_block b = {.first = c->nvertex,
						    .nforeign = 3 * n,
						    .foreign = c->foreign,
						    .ntriangle = n,
						    .flags = c->lines ? c->flags : NULL,
						    .triangle = (const uint32_t(*)[3])c->index};
			r = send(c, &b, err);
			n = 0;
		}
		if (r || !rec)
			break;
		for (uint32_t j = 0; j < 3 && !r; j++) {
			uint64_t height = 0;

			c->index[n][j] = 3 * n + j;
			r = look_up(c, rec[j], &c->foreign[3 * n + j], &height, err);
			set_position(c->position[3 * n + j], rec[j], height);
		}
		c->flags[n++] = c->lines ? (uint8_t)rec[CORNERS] : 0;
	}
	return r;
}

int outputs_canonical_finish(struct outputs_canonical *c, struct err *err)
{
	int r = send_vertices(c, err);

	return r ? r : send_triangles(c, err);
}

struct outputs_canonical *outputs_canonical_free(struct outputs_canonical *c)
{
	if (!c)
		return NULL;
	sort_free(c->vertices);
	sort_free(c->triangles);
	outfile_free(c->keys);
	free(c->first);
	free(c->page);
	free(c->recent);
	free(c->foreign);
	free(c->index);
	free(c->flags);
	free(c->position);
	free(c);
	return NULL;
}
