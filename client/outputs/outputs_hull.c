/*
 * --trim-hull: leaves out the triangles that are reached from outside of the mesh through edges longer than the limit.
 *
 * The Delaunay triangulation fills the hull of the points: long triangles close the bays of a survey. The same long edges
 * around a lake or a roof inside of it are wanted. So a triangle goes only if a path leads to it from outside that crosses long
 * edges alone. In which order the triangles come makes no difference.
 *
 * Triangles without a long edge pass at once. The others wait in a nameless file, 96 bytes each. Each long edge has a set
 * (union-find), and a triangle joins the sets of its long edges. An edge that only one triangle has when the stream has ended is
 * on the hull, and what is in its set is left out; the rest is sent on at the end. Memory: 4 bytes for each long edge, and 48 for
 * one whose second triangle has not come yet.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "outputs_priv.h"

#define PIECE 4096 /* triangles in one block at the end */

enum { FLAGS_AT = 61 };
#define NUMBER (UINT64_MAX >> (64 - FLAGS_AT))

struct record {
	uint64_t number[3]; /* the first one has the triangle's flags from bit FLAGS_AT on */
	int32_t at[3][3];
	uint32_t edge;  /* one of its long edges */
	int64_t box[4]; /* of its domain */
};

/* A long edge that one triangle has so far. */
struct open {
	uint64_t low, high; /* vertices; high is above low, so 0: free */
	uint32_t edge;
};

struct outputs_hull {
	struct outputs_limit limit;
	struct outputs_left left;
	struct outfile *spool;
	uint64_t spooled; /* records */
	uint32_t *parent; /* of each long edge; 0 is outside */
	uint32_t edges;
	size_t room;
	struct open *open; /* a power of two */
	size_t size, used;
	uint64_t vertices;            /* that have come */
	struct outputs_passed passed; /* of the current block, those that pass */
	struct record *buf;
	uint64_t foreign[3 * PIECE];
	uint32_t local[PIECE][3];
	bool flags; /* some have */
	uint8_t local_flags[PIECE];
	int32_t position[3 * PIECE][3];
};

int outputs_hull_new(const struct outfile *beside, struct outputs_hull **ret, struct err *err)
{
	struct outputs_hull *h = calloc(1, sizeof(*h));
	int r;

	if (h)
		h->buf = malloc(PIECE * sizeof(*h->buf));
	r = h && h->buf ? outfile_spool(beside, &h->spool, err) : err_set(err, ERR_NOMEM, "no memory to trim a mesh");
	if (r)
		outputs_hull_free(h);
	else
		*ret = h;
	return r;
}

int outputs_hull_head(struct outputs_hull *h, const struct acut_mesh_head *head, const struct outputs_length *length,
		      struct err *err)
{
	if (head->view && strstr(head->view, " window=")) {
		err_set(err, ERR_USAGE, "--trim-hull needs the hull, which a window of a mesh does not have");
		return err_add_hint(err, "fetch the whole mesh, and cut it with --mask FILE, or use --max-edge");
	}
	memcpy(h->left.k, head->k, sizeof(h->left.k));
	h->edges = 1;
	return outputs_limit_init(&h->limit, head, length, "trim-hull", err);
}

/* ---- sets of long edges ---- */

static uint32_t find(struct outputs_hull *h, uint32_t edge)
{
	while (h->parent[edge] != edge)
		edge = h->parent[edge] = h->parent[h->parent[edge]];
	return edge;
}

/* The smaller one stays: outside remains the name of its set. */
static void join(struct outputs_hull *h, uint32_t a, uint32_t b)
{
	a = find(h, a);
	b = find(h, b);
	if (a < b)
		h->parent[b] = a;
	else
		h->parent[a] = b;
}

static int new_edge(struct outputs_hull *h, uint32_t *ret, struct err *err)
{
	if (h->edges >= h->room) {
		size_t room = h->room ? 2 * h->room : 4096;
		void *grown = room > UINT32_MAX ? NULL : realloc(h->parent, room * sizeof(*h->parent));

		if (!grown) {
			err_set(err, ERR_NOMEM, "no memory for %zu edges longer than --trim-hull", room);
			return err_add_hint(err, "give a greater length: at most one edge of a hundred should be longer");
		}
		h->parent = grown;
		h->parent[0] = 0;
		h->room = room;
	}
	*ret = h->edges++;
	h->parent[*ret] = *ret;
	return 0;
}

static size_t slot_of(const struct outputs_hull *h, uint64_t low, uint64_t high)
{
	return (size_t)((low * 0x9e3779b97f4a7c15u ^ high * 0xc2b2ae3d27d4eb4fu) >> 18) & (h->size - 1);
}

static int grow(struct outputs_hull *h, struct err *err)
{
	struct open *old = h->open;
	size_t size = h->size ? 2 * h->size : 16, old_size = h->size;
	struct open *made = calloc(size, sizeof(*made));

	if (!made)
		return err_set(err, ERR_NOMEM, "no memory for %zu open edges longer than --trim-hull", h->used);
	h->open = made;
	h->size = size;
	for (size_t i = 0; i < old_size; i++)
		if (old[i].high) {
			size_t at = slot_of(h, old[i].low, old[i].high);

			while (made[at].high)
				at = (at + 1) & (size - 1);
			made[at] = old[i];
		}
	free(old);
	return 0;
}

/* Linear probing: what follows a free slot moves up. */
static void take_out(struct outputs_hull *h, size_t at)
{
	for (size_t next = at;;) {
		size_t want;

		next = (next + 1) & (h->size - 1);
		if (!h->open[next].high)
			break;
		want = slot_of(h, h->open[next].low, h->open[next].high);
		if (((next - want) & (h->size - 1)) < ((next - at) & (h->size - 1)))
			continue;
		h->open[at] = h->open[next];
		at = next;
	}
	h->open[at].high = 0;
	h->used--;
}

/* The set of a long edge: that of the triangle beyond it, or a new one. */
static int edge_of(struct outputs_hull *h, uint64_t a, uint64_t b, uint32_t *ret, struct err *err)
{
	uint64_t low = a < b ? a : b, high = a < b ? b : a;
	size_t at;

	if (2 * h->used >= h->size && grow(h, err))
		return -(int)err->code;
	for (at = slot_of(h, low, high); h->open[at].high; at = (at + 1) & (h->size - 1))
		if (h->open[at].low == low && h->open[at].high == high) {
			*ret = h->open[at].edge;
			take_out(h, at);
			return 0;
		}
	if (new_edge(h, ret, err))
		return -(int)err->code;
	h->open[at] = (struct open){low, high, *ret};
	h->used++;
	return 0;
}

/* ---- the stream ---- */

static bool is_long(const struct outputs_hull *h, const int32_t *a, const int32_t *b)
{
	return outputs_edge_square(a, b) > h->limit.square;
}

/* The record of a triangle, whose set has all of its long edges; 0: it has none, 1: it has, or an error. */
static int record_of(struct outputs_hull *h, const struct acut_mesh_block *b, const int32_t (*pos)[3], uint32_t i,
		     struct record *ret, struct err *err)
{
	const uint32_t *t = b->triangle[i];
	bool any = false;

	for (int j = 0; j < 3; j++) {
		ret->number[j] = t[j] < b->nforeign ? b->foreign[t[j]] : b->first + t[j] - b->nforeign;
		memcpy(ret->at[j], pos[t[j]], sizeof(ret->at[j]));
	}
	for (int j = 0; j < 3; j++) {
		int k = j == 2 ? 0 : j + 1;
		uint32_t edge = 0;

		/* nothing is reached through a line: the side is across from the third corner */
		if (!is_long(h, ret->at[j], ret->at[k]) || (b->flags && b->flags[i] >> (3 - j - k) & 1))
			continue;
		if (edge_of(h, ret->number[j], ret->number[k], &edge, err))
			return -(int)err->code;
		if (any)
			join(h, ret->edge, edge);
		ret->edge = edge;
		any = true;
	}
	memcpy(ret->box, b->box, sizeof(ret->box));
	return any;
}

int outputs_hull_block(struct outputs_hull *h, const struct acut_mesh_block *b, const int32_t (*pos)[3],
		       struct acut_mesh_block *ret, struct err *err)
{
	h->vertices = b->first + b->nnew;
	*ret = *b;
	if (h->limit.none_longer)
		return 0;
	if (outputs_passed_begin(&h->passed, b, err))
		return -(int)err->code;
	for (uint32_t i = 0; i < b->ntriangle; i++) {
		struct record rec = {.edge = 0};
		int r = record_of(h, b, pos, i, &rec, err);

		rec.number[0] |= b->flags ? (uint64_t)b->flags[i] << FLAGS_AT : 0;
		if (!r)
			outputs_passed_add(&h->passed, b, i);
		else if (r < 0 || outfile_write(h->spool, &rec, sizeof(rec), err))
			return -(int)err->code;
		h->spooled += r;
	}
	h->flags |= b->flags != NULL;
	outputs_passed_end(&h->passed, b, ret);
	return 0;
}

/* Reads the next records of one domain: the triangles that stay make a block, whose corners are all foreign vertices. */
static int next_block(struct outputs_hull *h, uint64_t from, struct acut_mesh_block *ret, uint64_t *ret_n, struct err *err)
{
	uint64_t left = h->spooled - from, n = left < PIECE ? left : PIECE, i;
	uint32_t kept = 0;

	if (outfile_read(h->spool, from * sizeof(*h->buf), h->buf, n * sizeof(*h->buf), err))
		return -(int)err->code;
	for (i = 0; i < n && !memcmp(h->buf[i].box, h->buf[0].box, sizeof(h->buf[0].box)); i++) {
		const struct record *rec = &h->buf[i];

		if (!find(h, rec->edge)) {
			outputs_left_add(&h->left, rec->at[0], rec->at[1], rec->at[2]);
			continue;
		}
		for (uint32_t j = 0; j < 3; j++) {
			h->local[kept][j] = 3 * kept + j;
			h->foreign[3 * kept + j] = rec->number[j] & NUMBER;
			memcpy(h->position[3 * kept + j], rec->at[j], sizeof(rec->at[j]));
		}
		h->local_flags[kept++] = (uint8_t)(rec->number[0] >> FLAGS_AT);
	}
	*ret = (struct acut_mesh_block){.first = h->vertices,
					.flags = h->flags ? h->local_flags : NULL,
					.nforeign = 3 * kept,
					.foreign = h->foreign,
					.ntriangle = kept,
					.triangle = (const uint32_t(*)[3])h->local};
	memcpy(ret->box, h->buf[0].box, sizeof(ret->box));
	*ret_n = i;
	return 0;
}

int outputs_hull_rest(struct outputs_hull *h, int (*each)(void *ctx, const struct format_block *), void *ctx, struct err *err)
{
	for (size_t i = 0; i < h->size; i++)
		if (h->open[i].high)
			join(h, 0, h->open[i].edge);
	for (uint64_t from = 0, n = 0; from < h->spooled; from += n) {
		struct acut_mesh_block b;
		int r = next_block(h, from, &b, &n, err);
		const struct format_block block = {&b, (const int32_t(*)[3])h->position};

		if (!r && b.ntriangle)
			r = each(ctx, &block);
		if (r)
			return r;
	}
	return 0;
}

const struct outputs_left *outputs_hull_left(const struct outputs_hull *h)
{
	return &h->left;
}

struct outputs_hull *outputs_hull_free(struct outputs_hull *h)
{
	if (h) {
		outfile_free(h->spool);
		free(h->parent);
		free(h->open);
		outputs_passed_free(&h->passed);
		free(h->buf);
		free(h);
	}
	return NULL;
}
