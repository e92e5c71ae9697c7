/*
 * COPC: compressed LAS whose chunks are the nodes of an octree. Its hierarchy has the cube of each node and its place in the file
 * (COPC 1.0). A crop box selects the nodes, of all levels, that meet it.
 *
 * Model: the hierarchy is read entry by entry from its root page, with a block of entries and a stack of the pages above the
 * current one; it is not kept. When the file is opened, all of it is read once and compared with the chunk table: both must have
 * the same chunks, in any order. A hierarchy that omits, repeats or moves a chunk is not used at all. Afterwards, and for each
 * part that is read, only the pages under nodes that meet the box are read.
 *
 * If a hierarchy cannot be used, the whole file is read, with a warning.
 *
 * Not here: a check whether the points of a node are in its cube. It would need the points.
 */
#include "input_las_parts.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "cursor.h"
#include "digest.h"
#include "io.h"

enum { INFO_BYTES = 160, ENTRY = 32, LEVELS = 31 };

/* How a walk ended. */
static const char bad_page[] = "a page lies outside of it";
static const char bad_node[] = "a node lies outside of its parent's page";
static const char bad_chunk[] = "a node's points lie outside of the file's";
static const char bad_cycle[] = "its pages go in circles";

static double axis_low(const struct input_copc *c, unsigned axis, unsigned level, double key)
{
	return c->low[axis] + ldexp(c->side, -(int)level) * key;
}

/* Whether a node's cube meets the box, borders and what rounding may have moved included. */
static bool meets(const struct input_copc *c, const int32_t key[4])
{
	for (unsigned axis = 0; axis < 2; axis++) {
		double low = axis_low(c, axis, (unsigned)key[0], key[1 + axis]);
		double high = axis_low(c, axis, (unsigned)key[0], key[1 + axis] + 1.0);

		if (high + c->margin < c->crop[axis] || low - c->margin > c->crop[2 + axis])
			return false;
	}
	return true;
}

void input_copc_walk_begin(struct input_copc_walk *w, const struct input_copc *c, bool whole)
{
	*w = (struct input_copc_walk){.copc = c, .whole = whole, .depth = 1, .left = c->bytes / ENTRY};
	w->page[0] = (struct input_copc_page){.at = c->root_at, .end = c->root_at + c->root_bytes};
}

static int read_entry(struct input *in, struct input_copc_walk *w, struct input_copc_page *page, uint8_t *entry, struct err *err)
{
	if (page->at < w->block_at || page->at - w->block_at >= w->block_n) {
		uint64_t n = page->end - page->at;
		int rc;

		n = n < sizeof w->block ? n : sizeof w->block;
		w->block_at = page->at;
		rc = io_read_some(in->fd, w->block, (size_t)n, page->at, in->name, &w->block_n, err);
		if (rc)
			return rc;
		if (w->block_n < n)
			return input_fail(in, err, ERR_TRUNCATED, page->at + w->block_n, "COPC hierarchy",
					  "the file ends in the middle of its COPC hierarchy");
	}
	memcpy(entry, w->block + (page->at - w->block_at), ENTRY);
	page->at += ENTRY;
	return 0;
}

/* Whether the entry is a valid node below the node of its page. */
static bool key_fits(const struct input_copc_page *page, const int32_t key[4])
{
	if (key[0] < page->key[0] || key[0] > LEVELS)
		return false;
	for (unsigned i = 1; i < 4; i++)
		if (key[i] < 0 || key[i] >> key[0] || key[i] >> (key[0] - page->key[0]) != page->key[i])
			return false;
	return true;
}

/* Enters the page at `at`, which belongs to the node `key`. */
static const char *descend(struct input_copc_walk *w, const int32_t key[4], uint64_t at, int32_t bytes)
{
	const struct input_copc *c = w->copc;
	const struct input_copc_page *page = &w->page[w->depth - 1];

	if (bytes <= 0 || bytes % ENTRY || at < c->at || at - c->at > c->bytes || (uint64_t)bytes > c->bytes - (at - c->at))
		return bad_page;
	if (w->depth > 1 && key[0] == page->key[0]) /* its own page again */
		return bad_cycle;
	if (!w->whole && !meets(c, key))
		return NULL;
	if (w->depth == sizeof w->page / sizeof *w->page)
		return bad_cycle;
	w->page[w->depth] = (struct input_copc_page){.at = at, .end = at + (uint64_t)bytes};
	memcpy(w->page[w->depth++].key, key, sizeof w->page->key);
	return NULL;
}

int input_copc_walk_next(struct input *in, struct input_copc_walk *w, struct laz_chunk *ret, bool *ret_meets, bool *ret_more,
			 const char **ret_why, struct err *err)
{
	const struct input_copc *c = w->copc;

	*ret_why = NULL;
	for (;;) {
		uint8_t bytes[ENTRY];
		struct cursor at;
		int32_t key[4], size, points;
		uint64_t offset;
		int rc;

		while (w->depth && w->page[w->depth - 1].at == w->page[w->depth - 1].end)
			w->depth--;
		*ret_more = w->depth > 0;
		if (!*ret_more)
			return 0;
		if (!w->left--) {
			*ret_why = bad_cycle;
			return 0;
		}
		rc = read_entry(in, w, &w->page[w->depth - 1], bytes, err);
		if (rc)
			return rc;
		at = cursor_of(bytes, sizeof bytes);
		for (unsigned i = 0; i < 4; i++)
			key[i] = cursor_i32(&at);
		offset = cursor_u64(&at);
		size = cursor_i32(&at);
		points = cursor_i32(&at);
		if (!key_fits(&w->page[w->depth - 1], key))
			*ret_why = bad_node;
		else if (points == -1)
			*ret_why = descend(w, key, offset, size);
		else if (points < 0 || (points > 0 && (size <= 0 || offset < c->data_at || offset >= c->data_end ||
						       (uint64_t)size > c->data_end - offset)))
			*ret_why = bad_chunk;
		if (*ret_why)
			return 0;
		*ret_meets = meets(c, key);
		if (points <= 0 || (!w->whole && !*ret_meets))
			continue;
		*ret = (struct laz_chunk){.at = offset, .bytes = (uint64_t)size, .points = (uint64_t)points};
		return 0;
	}
}

static void add_chunk(struct digest *sum, const struct laz_chunk *chunk)
{
	const uint64_t numbers[3] = {chunk->at, chunk->bytes, chunk->points};

	digest_add(sum, digest_hash(numbers, sizeof numbers));
}

/* Totals of all chunks in the table. */
static int sum_table(struct laz_table *table, struct digest *ret, struct err *err)
{
	struct laz_chunk chunk;
	bool more = true;

	*ret = (struct digest){0};
	for (;;) {
		int rc = laz_table_next(table, &chunk, &more, err);

		if (rc || !more)
			return rc;
		add_chunk(ret, &chunk);
	}
}

struct totals {
	struct digest all;
	uint64_t nodes, points, bytes, all_bytes; /* of the nodes that meet the box; of all */
};

static int sum_hierarchy(struct input *in, const struct input_copc *c, struct totals *t, const char **ret_why, struct err *err)
{
	struct input_copc_walk walk;
	struct laz_chunk chunk;
	bool in_box, more;

	memset(t, 0, sizeof *t);
	input_copc_walk_begin(&walk, c, true);
	for (;;) {
		int rc = input_copc_walk_next(in, &walk, &chunk, &in_box, &more, ret_why, err);

		if (rc || *ret_why || !more)
			return rc;
		add_chunk(&t->all, &chunk);
		t->all_bytes += chunk.bytes;
		if (!in_box)
			continue;
		t->nodes++;
		t->points += chunk.points;
		t->bytes += chunk.bytes;
	}
}

/* The record copc/1: the cube and the root page. */
static const char *read_info(struct input *in, struct input_copc *c, const uint8_t info[INFO_BYTES])
{
	const struct lattice_input *coords = &in->info.coords;
	struct cursor at = cursor_of(info, INFO_BYTES);
	double centre[3], half;

	for (unsigned i = 0; i < 3; i++)
		centre[i] = cursor_f64(&at);
	half = cursor_f64(&at);
	cursor_f64(&at); /* spacing */
	c->root_at = cursor_u64(&at);
	c->root_bytes = cursor_u64(&at);
	if (!(isfinite(centre[0]) && isfinite(centre[1]) && isfinite(half) && half > 0 && half < 1e12))
		return "its cube is not one";
	c->side = 2 * half;
	c->margin = 0;
	for (unsigned i = 0; i < 2; i++) {
		double scale = fabs(decimal_double(coords->scale[i]));
		double margin = 2 * scale + 1e-12 * (fabs(centre[i]) + half);

		c->margin = margin > c->margin ? margin : c->margin;
		c->low[i] = centre[i] - half;
	}
	for (unsigned i = 0; i < 2; i++)
		if (coords->min[i] < c->low[i] - c->margin || coords->max[i] > c->low[i] + c->side + c->margin)
			return "its cube does not hold the header's box";
	if (!c->root_bytes || c->root_bytes % ENTRY || c->root_at < c->at || c->root_at - c->at > c->bytes ||
	    c->root_bytes > c->bytes - (c->root_at - c->at))
		return bad_page;
	return NULL;
}

/* Selects the nodes with the hierarchy of the info record. *ret_why: why it cannot be used. */
static int select_nodes(struct input *in, struct laz_table *table, const char **ret_why, struct err *err)
{
	struct input_copc *c = &input_las_of(in)->copc;
	uint8_t info[INFO_BYTES];
	struct digest table_sum;
	struct totals t;
	size_t n;
	int rc = io_read_some(in->fd, info, sizeof info, c->info_at, in->name, &n, err);

	if (rc)
		return rc;
	*ret_why = n < sizeof info ? "its info record is cut short" : read_info(in, c, info);
	if (*ret_why)
		return 0;
	rc = sum_table(table, &table_sum, err);
	if (!rc)
		rc = sum_hierarchy(in, c, &t, ret_why, err);
	if (rc || *ret_why)
		return rc;
	if (!digest_equal(table_sum, t.all)) {
		*ret_why = "it does not list the chunks of the chunk table";
		return 0;
	}
	if (t.bytes == t.all_bytes)
		return 0;
	c->selects = true;
	c->nodes = t.nodes;
	in->info.partial = true;
	in->info.claimed = t.points;
	in->info.bytes_selected = in->info.bytes - (t.all_bytes - t.bytes);
	return 0;
}

int input_copc_open(struct input *in, struct laz_table *table, struct err *err)
{
	struct input_las *las = input_las_of(in);
	struct input_copc *c = &las->copc;
	const char *why = NULL;
	int rc;

	if (!in->has_crop || !c->info_at || las->laz.compressor != LAZ_COMPRESSOR_LAYERED)
		return 0;
	/* the points are degrees that will be projected: the box is in projected coordinates */
	if (in->info.crs.plane == CRS_PLANE_GEOGRAPHIC && !in->planar && !in->any_plane)
		return 0;
	c->data_at = las->point_offset;
	c->data_end = in->size;
	memcpy(c->crop, in->crop, sizeof c->crop);
	if (!c->at)
		why = "there is none";
	rc = why ? 0 : select_nodes(in, table, &why, err);
	if (why)
		input_warn(in, "the COPC hierarchy cannot be used (%s); the file is read whole", why);
	return rc;
}
