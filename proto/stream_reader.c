/*
 * Reading the mesh stream. The bytes of a frame are collected in one buffer of the frame's size. When the frame is
 * complete it is checked and returned as views into that buffer. The lengths in a header are used only after its
 * checksum agreed.
 *
 * Running totals of the stream (vertices, triangles, box) check the numbering and the tail.
 */
#include "stream_reader.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

enum { LARGE_PAGE = 2 << 20, TAIL_ROOM = 1 << 20, FREE_SHARE = 16 };

struct stream_reader *stream_reader_new(void)
{
	struct stream_reader *r = calloc(1, sizeof *r);

	if (r)
		for (unsigned i = 0; i < 3; i++) {
			r->box[i] = INT32_MAX;
			r->box[3 + i] = INT32_MIN;
		}
	return r;
}

void stream_reader_state(const struct stream_reader *r, struct stream_reader_state *ret)
{
	*ret = (struct stream_reader_state){
		.blocks = r->blocks,
		.vertices = r->vertices,
		.triangles = r->triangles,
		.last_index = r->last_index,
	};
	memcpy(ret->box, r->box, sizeof ret->box);
}

void stream_reader_start(struct stream_reader *r, const struct stream_reader_state *from)
{
	r->blocks = from->blocks;
	r->vertices = from->vertices;
	r->triangles = from->triangles;
	r->last_index = from->last_index;
	memcpy(r->box, from->box, sizeof r->box);
}

struct stream_reader *stream_reader_free(struct stream_reader *r)
{
	if (r) {
		free(r->memory);
		free(r->foreign);
		free(r->view);
		free(r->wkt);
		free(r);
	}
	return NULL;
}

const struct stream_head *stream_reader_head(const struct stream_reader *r)
{
	return &r->head;
}

const struct stream_block *stream_reader_block(const struct stream_reader *r)
{
	return &r->block;
}

const struct stream_base *stream_reader_base(const struct stream_reader *r)
{
	return &r->base;
}

const struct stream_region *stream_reader_gone(const struct stream_reader *r, size_t *ret_n)
{
	*ret_n = r->ngone;
	return r->gone;
}

const struct stream_tail *stream_reader_tail(const struct stream_reader *r)
{
	return &r->tail;
}

bool stream_reader_done(const struct stream_reader *r)
{
	return r->done;
}

uint64_t stream_reader_offset(const struct stream_reader *r)
{
	return r->offset;
}

/* Reports a violation `back` bytes before the end of what was fed. */
static int refuse(struct stream_reader *r, uint64_t back, struct err *err)
{
	err_add_place(err, r->offset - back, NULL);
	return -(int)err->code;
}

static void use_large(uint8_t *memory, size_t from, size_t to)
{
	from = (from + LARGE_PAGE - 1) & ~(size_t)(LARGE_PAGE - 1);
	to &= ~(size_t)(LARGE_PAGE - 1);
	if (to > from)
		madvise(memory + from, to - from, MADV_HUGEPAGE);
}

/* Large frames use huge pages if the system has some, because corners of triangles are read all over the frame: those that it
 * fills, since one is memory as a whole. A little more is allocated than needed, because the frames of a mesh have similar
 * sizes. A sixteenth before the frame is free, and is no memory until it is written to. */
static int make_room(struct stream_reader *r)
{
	size_t room = r->length, before = 0;

	free(r->memory);
	r->memory = NULL;
	r->room = 0;
	if (room >= LARGE_PAGE) {
		before = room / FREE_SHARE & ~(size_t)63;
		room = (before + room + room / 8 + LARGE_PAGE - 1) & ~(size_t)(LARGE_PAGE - 1);
		r->memory = aligned_alloc(LARGE_PAGE, room);
		room -= before;
		if (r->memory)
			use_large(r->memory, before, before + r->length);
	}
	if (!r->memory) {
		room = r->length;
		before = room / FREE_SHARE & ~(size_t)63;
		r->memory = malloc(before + room);
	}
	if (!r->memory)
		return -1;
	r->payload = r->memory + before;
	r->room = room;
	return 0;
}

/* What the blocks needed is free before the sink hears of the tail, since it may have much to do then. */
static bool fits(const struct stream_reader *r)
{
	return r->length <= r->room && !(r->type == STREAM_TYPE_TAIL && r->room > TAIL_ROOM);
}

int stream_reader_space(struct stream_reader *r, void **ret, size_t *ret_size, struct err *err)
{
	if (r->got < STREAM_HEADER_SIZE) {
		*ret = r->header + r->got;
		*ret_size = STREAM_HEADER_SIZE - r->got;
		return 0;
	}
	if (r->got == STREAM_HEADER_SIZE && !fits(r) && make_room(r) < 0)
		return err_set(err, ERR_NOMEM, "there is no memory for a frame of %zu bytes of the mesh stream", r->length);
	*ret = r->payload + (r->got - STREAM_HEADER_SIZE);
	*ret_size = r->length - (r->got - STREAM_HEADER_SIZE);
	return 0;
}

/* Changes: head, base, invalid regions, blocks. A tail may come anywhere, because it may report an error. */
static bool in_order(const struct stream_reader *r)
{
	bool changes = r->head.kind == STREAM_CHANGES;

	switch (r->type) {
	case STREAM_TYPE_BASE:
		return changes && !r->has_base;
	case STREAM_TYPE_GONE:
		return r->has_base && !r->any_block;
	case STREAM_TYPE_BLOCK:
		return !changes || r->has_base;
	default:
		return true;
	}
}

static int read_header(struct stream_reader *r, struct err *err)
{
	struct cursor c = cursor_of(r->header, STREAM_HEADER_SIZE);
	uint32_t magic = cursor_u32(&c);
	unsigned version = cursor_u16(&c);
	unsigned type = cursor_u16(&c);
	uint64_t length = cursor_u64(&c);

	r->checksum = cursor_u64(&c);
	if (magic != STREAM_MAGIC)
		return err_set(err, ERR_PROTO, "what was received is no frame of a mesh stream (0x%08x)", magic);
	if (XXH3_64bits(r->header, STREAM_HEADER_CHECKED) != cursor_u64(&c))
		return err_set(err, ERR_PROTO, "the header of a frame of the mesh stream does not agree with its checksum");
	if (version != STREAM_VERSION)
		return err_set(err, ERR_VERSION, "the mesh stream has version %u; this build reads version %u", version,
			       STREAM_VERSION);
	if (type < STREAM_TYPE_HEAD || type > STREAM_TYPE_GONE)
		return err_set(err, ERR_PROTO, "a frame of the mesh stream has the unknown type %u", type);
	if ((type == STREAM_TYPE_HEAD) == r->has_head)
		return err_set(err, ERR_PROTO,
			       r->has_head ? "the mesh stream has a second head" :
					     "the mesh stream does not start with its head");
	r->type = type;
	if (type != STREAM_TYPE_HEAD && !in_order(r))
		return err_set(err, ERR_PROTO, "a frame of the type %u stands where the mesh stream has none", type);
	if (length == 0 || length % 8 != 0 || length > STREAM_FRAME_MAX)
		return err_set(err, ERR_PROTO, "a frame of the mesh stream announces %llu bytes", (unsigned long long)length);
	r->length = length;
	return 0;
}

static int check_vertices(struct stream_reader *r, const struct stream_block *b, struct err *err)
{
	int32_t box[6];

	memcpy(box, r->box, sizeof box);
	for (uint32_t i = 0; i < b->nnew; i++)
		for (unsigned k = 0; k < 3; k++) {
			int32_t v = b->vertex[i][k];

			box[k] = v < box[k] ? v : box[k];
			box[3 + k] = v > box[3 + k] ? v : box[3 + k];
		}
	memcpy(r->box, box, sizeof box);
	for (unsigned k = 0; k < 3 && b->nnew > 0; k++)
		if (box[k] < r->head.box[k] || box[3 + k] > r->head.box[3 + k])
			return err_set(err, ERR_PROTO, "block %llu has a vertex outside the box in the head",
				       (unsigned long long)b->index);
	return 0;
}

static int check_triangles(const struct stream_block *b, struct err *err)
{
	uint32_t locals = b->nforeign + b->nnew;
	unsigned bad = 0;

	for (uint32_t i = 0; i < b->ntriangle; i++) {
		const uint32_t *t = b->triangle[i];

		bad |= (t[0] >= locals) | (t[1] >= locals) | (t[2] >= locals) | (t[0] == t[1]) | (t[1] == t[2]) | (t[2] == t[0]);
	}
	if (bad)
		return err_set(err, ERR_PROTO, "block %llu has a triangle whose corners are not three of its %u vertices",
			       (unsigned long long)b->index, locals);
	return 0;
}

static int check_block(struct stream_reader *r, const struct stream_block *b, struct err *err)
{
	uint64_t locals = (uint64_t)b->nforeign + b->nnew;
	int e;

	if (b->index < r->last_index) /* pieces of one domain have the same index */
		return err_set(err, ERR_PROTO, "block %llu comes after block %llu", (unsigned long long)b->index,
			       (unsigned long long)r->last_index);
	if (b->first != r->vertices)
		return err_set(err, ERR_PROTO, "block %llu numbers its vertices from %llu, but %llu vertices came before",
			       (unsigned long long)b->index, (unsigned long long)b->first, (unsigned long long)r->vertices);
	for (uint32_t i = 0; i < b->nforeign; i++)
		if (b->foreign[i] >= b->first)
			return err_set(err, ERR_PROTO, "block %llu uses vertex %llu, which has not come yet",
				       (unsigned long long)b->index, (unsigned long long)b->foreign[i]);
	if (locals % 8 != 0 && b->final[locals / 8] >> (locals % 8) != 0)
		return err_set(err, ERR_PROTO, "block %llu marks vertices as final that it does not have",
			       (unsigned long long)b->index);
	e = check_triangles(b, err);
	return e < 0 ? e : check_vertices(r, b, err);
}

/* The numbers of foreign vertices move away, if that and the free bytes make room for their positions before the new ones. */
static int make_local(struct stream_reader *r, struct stream_block *b, struct err *err)
{
	size_t n = b->nforeign, need = n * sizeof *b->vertex;
	uint8_t *vertex = r->payload + ((const uint8_t *)b->vertex - r->payload);

	b->local = NULL;
	if (need > (size_t)(vertex - r->memory))
		return 0;
	if (n > r->foreign_room) {
		free(r->foreign);
		r->foreign_room = 0;
		r->foreign = malloc((n + n / 8) * sizeof *r->foreign);
		if (!r->foreign)
			return err_set(err, ERR_NOMEM, "there is no memory for %zu vertices of earlier blocks", n);
		r->foreign_room = n + n / 8;
	}
	if (n)
		memcpy(r->foreign, b->foreign, n * sizeof *r->foreign);
	b->foreign = r->foreign;
	b->local = (int32_t(*)[3])(void *)(vertex - need);
	return 0;
}

static int read_block(struct stream_reader *r, struct err *err)
{
	struct cursor c = cursor_of(r->payload, r->length);
	struct stream_block b = {.index = cursor_u64(&c)};
	uint64_t bytes;
	unsigned flags;
	int e;

	for (unsigned i = 0; i < 4; i++)
		b.box[i] = cursor_i64(&c);
	b.first = cursor_u64(&c);
	b.nforeign = cursor_u32(&c);
	b.nnew = cursor_u32(&c);
	b.ntriangle = cursor_u32(&c);
	flags = cursor_u32(&c);
	bytes = stream_block_bytes(b.nforeign, b.nnew, b.ntriangle, flags);
	if (c.bad || flags > (STREAM_BLOCK_FLAG_BYTES | STREAM_BLOCK_ORIGINS) || stream_padded(bytes) != r->length ||
	    (uint64_t)b.nforeign + b.nnew > UINT32_MAX)
		return err_set(err, ERR_PROTO, "a block of the mesh stream is malformed");
	/* The payload is aligned to 16, and wide arrays come first, so all of them are aligned. */
	b.foreign = (const uint64_t *)(const void *)cursor_bytes(&c, (size_t)b.nforeign * sizeof *b.foreign);
	b.vertex = (const int32_t(*)[3])(const void *)cursor_bytes(&c, (size_t)b.nnew * sizeof *b.vertex);
	b.triangle = (const uint32_t(*)[3])(const void *)cursor_bytes(&c, (size_t)b.ntriangle * sizeof *b.triangle);
	b.origin = flags & STREAM_BLOCK_ORIGINS ? (const void *)cursor_bytes(&c, (size_t)b.nnew * sizeof *b.origin) : NULL;
	b.flags = flags & STREAM_BLOCK_FLAG_BYTES ? cursor_bytes(&c, b.ntriangle) : NULL;
	b.final = cursor_bytes(&c, ((size_t)b.nforeign + b.nnew + 7) / 8);
	e = stream_read_end(&c, "block", err);
	if (e == 0)
		e = stream_check_gone(r, err);
	if (e == 0)
		e = check_block(r, &b, err);
	if (e == 0)
		e = make_local(r, &b, err);
	if (e < 0)
		return e;
	r->any_block = true;
	r->block = b;
	r->blocks++;
	r->vertices += b.nnew;
	r->triangles += b.ntriangle;
	r->last_index = b.index;
	return 0;
}

static int read_payload(struct stream_reader *r, enum stream_event *ret_event, struct err *err)
{
	static const struct {
		enum stream_event event;
		int (*read)(struct stream_reader *, struct err *);
	} row[] = {{0},
		   {STREAM_HEAD, stream_read_head},
		   {STREAM_BLOCK, read_block},
		   {STREAM_TAIL, stream_read_tail},
		   {STREAM_BASE, stream_read_base},
		   {STREAM_GONE, stream_read_gone}};
	int e;

	if (XXH3_64bits(r->payload, r->length) != r->checksum)
		return err_set(err, ERR_PROTO, "a frame of the mesh stream does not agree with its checksum");
	e = row[r->type].read(r, err);
	if (e < 0)
		return e;
	r->got = 0;
	*ret_event = row[r->type].event;
	return 0;
}

static int feed(struct stream_reader *r, size_t n, enum stream_event *ret_event, struct err *err)
{
	int e;

	if (r->done)
		return err_set(err, ERR_PROTO, "the mesh stream goes on after its tail");
	r->got += n;
	if (r->got == STREAM_HEADER_SIZE) {
		e = read_header(r, err);
		return e < 0 ? refuse(r, STREAM_HEADER_SIZE, err) : 0;
	}
	if (r->got > STREAM_HEADER_SIZE && r->got == STREAM_HEADER_SIZE + r->length) {
		e = read_payload(r, ret_event, err);
		return e < 0 ? refuse(r, r->length + STREAM_HEADER_SIZE, err) : 0;
	}
	return 0;
}

int stream_reader_feed(struct stream_reader *r, size_t n, enum stream_event *ret_event, struct err *err)
{
	int e;

	*ret_event = STREAM_MORE;
	if (r->failed) {
		*err = r->why;
		return -(int)err->code;
	}
	if (n == 0)
		return 0;
	r->offset += n;
	e = feed(r, n, ret_event, err);
	if (e < 0) {
		r->failed = true;
		r->why = *err;
	}
	return e;
}
