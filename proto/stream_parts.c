/* Reading the mesh stream: the payloads of all frames but blocks. */
#include "stream_reader.h"

#include <stdlib.h>
#include <string.h>

static void get_text(struct cursor *c, char *text, size_t size)
{
	size_t n = cursor_u16(c);
	const uint8_t *bytes = cursor_bytes(c, n);

	if (!bytes)
		return;
	if (n >= size || memchr(bytes, 0, n)) {
		c->bad = true;
		return;
	}
	memcpy(text, bytes, n);
	text[n] = '\0';
}

#define GET_TEXT(c, array) get_text((c), (array), sizeof(array))

static void get_box(struct cursor *c, int32_t box[6])
{
	for (unsigned i = 0; i < 6; i++)
		box[i] = cursor_i32(c);
}

static struct digest get_digest(struct cursor *c)
{
	struct digest d;

	d.hi = cursor_u64(c);
	d.lo = cursor_u64(c);
	return d;
}

static void get_zeros(struct cursor *c, size_t n)
{
	const uint8_t *bytes = cursor_bytes(c, n);

	for (size_t i = 0; bytes && i < n; i++)
		if (bytes[i] != 0)
			c->bad = true;
}

int stream_read_end(struct cursor *c, const char *what, struct err *err)
{
	if (!c->bad && cursor_left(c) < 8)
		get_zeros(c, cursor_left(c));
	if (c->bad || cursor_left(c) > 0)
		return err_set(err, ERR_PROTO, "the %s of the mesh stream is malformed", what);
	return 0;
}

/* The texts that may be long. */
static int get_long(struct cursor *c, size_t most, char **ret, struct err *err)
{
	size_t n = cursor_u16(c);
	const uint8_t *bytes = cursor_bytes(c, n);

	if (!bytes || n > most || memchr(bytes, 0, n)) {
		c->bad = true;
		return 0;
	}
	*ret = malloc(n + 1);
	if (!*ret)
		return err_set(err, ERR_NOMEM, "there is no memory for the head of the mesh stream");
	memcpy(*ret, bytes, n);
	(*ret)[n] = '\0';
	return 0;
}

/* It came later: a head without it ends here, but for less than eight zeros, which are two empty texts. */
static int get_system(struct stream_reader *r, struct cursor *c, struct err *err)
{
	if (c->bad || cursor_left(c) < 4)
		return 0;
	r->head.system = true;
	GET_TEXT(c, r->head.geoid);
	return get_long(c, STREAM_WKT_MAX, &r->wkt, err);
}

int stream_read_head(struct stream_reader *r, struct err *err)
{
	struct cursor c = cursor_of(r->payload, r->length);
	struct stream_head *head = &r->head;
	uint8_t lines;
	int e;

	head->kind = cursor_u8(&c);
	lines = cursor_u8(&c);
	c.bad |= lines > 3;
	head->lines = lines & 1;
	head->bounded = lines >> 1 & 1;
	get_zeros(&c, 6);
	head->id = get_digest(&c);
	get_box(&c, head->box);
	GET_TEXT(&c, head->lattice);
	GET_TEXT(&c, head->crs);
	GET_TEXT(&c, head->unit_xy);
	GET_TEXT(&c, head->unit_z);
	e = get_long(&c, AREA_TEXT_MAX, &r->view, err);
	if (e == 0)
		e = get_system(r, &c, err);
	if (e < 0)
		return e;
	head->view = r->view;
	head->wkt = r->wkt;
	e = stream_read_end(&c, "head", err);
	if (e < 0)
		return e;
	if (head->kind < STREAM_WHOLE || head->kind > STREAM_CHANGES)
		return err_set(err, ERR_UNSUPPORTED, "the mesh stream is of kind %u, which this version cannot read", head->kind);
	r->has_head = true;
	return 0;
}

/* ---- changes ---- */

int stream_read_base(struct stream_reader *r, struct err *err)
{
	struct cursor c = cursor_of(r->payload, r->length);
	struct stream_base *b = &r->base;

	b->generation = cursor_u64(&c);
	b->job = cursor_u64(&c);
	b->old_digest = get_digest(&c);
	b->old_vertex_digest = get_digest(&c);
	b->digest = get_digest(&c);
	b->vertex_digest = get_digest(&c);
	b->gone = cursor_u64(&c);
	b->gone_triangles = cursor_u64(&c);
	b->kept = cursor_u64(&c);
	b->kept_triangles = cursor_u64(&c);
	r->has_base = true;
	return stream_read_end(&c, "base", err);
}

int stream_read_gone(struct stream_reader *r, struct err *err)
{
	if (r->length % STREAM_REGION_SIZE || r->length / STREAM_REGION_SIZE > STREAM_REGIONS)
		return err_set(err, ERR_PROTO, "a list of regions of the mesh stream is malformed");
	r->gone = (const struct stream_region *)(const void *)r->payload;
	r->ngone = r->length / STREAM_REGION_SIZE;
	for (size_t i = 0; i < r->ngone; i++) {
		const struct stream_region *g = &r->gone[i];

		if (g->box[0] >= g->box[2] || g->box[1] >= g->box[3] || !g->triangles)
			return err_set(err, ERR_PROTO, "the mesh stream says of a region that it is gone which is none");
		r->region_triangles += g->triangles;
	}
	r->regions += r->ngone;
	if (r->regions > r->base.gone)
		return err_set(err, ERR_PROTO, "more regions are gone than the mesh stream said");
	return 0;
}

int stream_check_gone(const struct stream_reader *r, struct err *err)
{
	if (r->head.kind != STREAM_CHANGES || r->any_block)
		return 0;
	if (!r->has_base)
		return err_set(err, ERR_PROTO, "a mesh stream of changes does not say what they are against");
	if (r->regions == r->base.gone && r->region_triangles == r->base.gone_triangles)
		return 0;
	return err_set(err, ERR_PROTO,
		       "the mesh stream counts %llu regions with %llu triangles that are gone, but %llu with %llu came",
		       (unsigned long long)r->base.gone, (unsigned long long)r->base.gone_triangles,
		       (unsigned long long)r->regions, (unsigned long long)r->region_triangles);
}

/* The tail of a complete stream must agree with what came. */
static int check_tail(const struct stream_reader *r, struct err *err)
{
	const struct {
		const char *what;
		uint64_t said, came;
	} row[] = {
		{"blocks", r->tail.blocks, r->blocks},
		{"vertices", r->tail.vertices, r->vertices},
		{"triangles", r->tail.triangles, r->triangles},
	};

	for (size_t i = 0; i < sizeof row / sizeof *row; i++)
		if (row[i].said != row[i].came)
			return err_set(err, ERR_PROTO, "the tail of the mesh stream counts %llu %s, but %llu came",
				       (unsigned long long)row[i].said, row[i].what, (unsigned long long)row[i].came);
	if (r->vertices > 0 && memcmp(r->box, r->tail.box, sizeof r->box) != 0)
		return err_set(err, ERR_PROTO, "the box in the tail of the mesh stream is not that of its vertices");
	return 0;
}

int stream_read_tail(struct stream_reader *r, struct err *err)
{
	struct cursor c = cursor_of(r->payload, r->length);
	struct stream_tail *tail = &r->tail;
	unsigned failed = cursor_u8(&c);
	int e;

	get_zeros(&c, 7);
	tail->failed = failed != 0;
	tail->blocks = cursor_u64(&c);
	tail->vertices = cursor_u64(&c);
	tail->triangles = cursor_u64(&c);
	tail->hull = cursor_u64(&c);
	get_box(&c, tail->box);
	tail->digest = get_digest(&c);
	tail->vertex_digest = get_digest(&c);
	GET_TEXT(&c, tail->error_code);
	GET_TEXT(&c, tail->error_message);
	GET_TEXT(&c, tail->error_hint);
	GET_TEXT(&c, tail->report);
	if (failed > 1)
		c.bad = true;
	e = stream_read_end(&c, "tail", err);
	if (e == 0 && !tail->failed)
		e = stream_check_gone(r, err);
	if (e == 0 && !tail->failed)
		e = check_tail(r, err);
	if (e < 0)
		return e;
	r->done = true;
	return 0;
}
