/*
 * The bytes of a plan in two levels. The head has the hash of everything behind it, which identifies the plan; each part that is
 * read alone has a checksum of its own, because a task reads its leaves and not those of others.
 */
#include "mesh_plan_file.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "cursor.h"
#include "digest_pack.h"
#include "err.h"
#include "io.h"
#include "view.h"

#define MAGIC UINT32_C(0x50544341) /* "ACTP" */
enum { VERSION = 1, BUFFER = 64 << 10, RULES = 16, FLAT = 1 };
_Static_assert(RULES == MESH_RULES, "format.md");

static int wrong(const struct mesh_plan *p, uint64_t at, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "the plan of a mesh is damaged: %s", what);
	err_add_file(err, p->name);
	return err_add_place(err, at, NULL);
}

/* ---- writing ---- */

/* Everything behind the head, in order. */
struct out {
	int fd;
	const char *name;
	uint64_t at;
	size_t used;
	struct digest_stream *hash;
	uint8_t buf[BUFFER];
};

static int out_flush(struct out *o, struct err *err)
{
	int r = io_write_at(o->fd, o->buf, o->used, o->at, o->name, err);

	digest_stream_add(o->hash, o->buf, o->used);
	o->at += o->used;
	o->used = 0;
	return r;
}

/* `n` at most a buffer. */
static int out_room(struct out *o, size_t n, struct packer *ret, struct err *err)
{
	int r = sizeof o->buf - o->used < n ? out_flush(o, err) : 0;

	*ret = packer_of(o->buf + o->used, n);
	o->used += n;
	return r;
}

static int put_bytes(struct out *o, const void *bytes, size_t n, struct err *err)
{
	int r = 0;

	for (const uint8_t *from = bytes; !r && n;) {
		size_t some = n < 4096 ? n : 4096;
		struct packer p;

		r = out_room(o, some, &p, err);
		packer_bytes(&p, from, some);
		from += some;
		n -= some;
	}
	return r;
}

static size_t padded(size_t n)
{
	return (n + 7) & ~(size_t)7;
}

/* The text, zeros, and a check of both. */
static int put_view(struct out *o, const char *view, struct err *err)
{
	size_t n = strlen(view), size = padded(n) + 8;
	uint8_t *bytes = calloc(1, size);
	struct packer p;
	int r;

	if (!bytes)
		return err_set(err, ERR_NOMEM, "no memory for a plan");
	memcpy(bytes, view, n);
	p = packer_of(bytes + size - 8, 8);
	packer_u64(&p, XXH3_64bits_withSeed(bytes, size - 8, MESH_PLAN_HEAD));
	r = put_bytes(o, bytes, size, err);
	free(bytes);
	return r;
}

static void leaf_pack(const struct cut_leaf *leaf, uint8_t bytes[MESH_PLAN_LEAF])
{
	struct packer p = packer_of(bytes, MESH_PLAN_LEAF);

	packer_u32(&p, leaf->region.x);
	packer_u32(&p, leaf->region.y);
	packer_u8(&p, leaf->region.wx);
	packer_u8(&p, leaf->region.wy);
	packer_u8(&p, leaf->region.inf);
	packer_u8(&p, 0);
	packer_u32(&p, leaf->count < UINT32_MAX ? (uint32_t)leaf->count : UINT32_MAX);
}

static uint64_t leaves_check(const struct cut_leaf *leaf, uint64_t n)
{
	XXH3_state_t *state = XXH3_createState();
	uint8_t bytes[MESH_PLAN_LEAF];
	uint64_t sum;

	if (!state)
		return 0;
	XXH3_64bits_reset(state);
	for (uint64_t i = 0; i < n; i++) {
		leaf_pack(&leaf[i], bytes);
		XXH3_64bits_update(state, bytes, sizeof bytes);
	}
	sum = XXH3_64bits_digest(state);
	XXH3_freeState(state);
	return sum;
}

static int put_task(struct out *o, const struct cut_leaf *leaf, uint64_t first, uint64_t end, struct err *err)
{
	uint64_t at = o->at + o->used;
	struct packer p;
	uint8_t *bytes;
	int r = out_room(o, MESH_PLAN_TASK, &p, err);

	bytes = p.start;
	packer_u64(&p, first);
	packer_u64(&p, end - first);
	packer_u64(&p, leaves_check(leaf + first, end - first));
	packer_u64(&p, XXH3_64bits_withSeed(bytes, MESH_PLAN_TASK - 8, at));
	return r;
}

static int put_leaf(struct out *o, const struct cut_leaf *leaf, struct err *err)
{
	struct packer p;
	int r = out_room(o, MESH_PLAN_LEAF, &p, err);

	leaf_pack(leaf, p.start);
	return r;
}

static void counts_pack(struct packer *p, const struct mesh_counts *c)
{
	packer_u64(p, c->points);
	for (unsigned i = 0; i < RULES; i++)
		packer_u64(p, c->removed[i]);
	packer_u64(p, c->used);
	packer_u64(p, c->most.points);
	packer_i32(p, c->most.x);
	packer_i32(p, c->most.y);
	packer_u64(p, c->halo);
	packer_u64(p, c->cells_read);
	packer_u64(p, c->points_read);
}

static int put_head(struct out *o, struct mesh_plan *plan, struct err *err)
{
	uint8_t bytes[MESH_PLAN_HEAD];
	struct packer p = packer_of(bytes, sizeof bytes);

	packer_u32(&p, MAGIC);
	packer_u32(&p, VERSION);
	packer_u64(&p, plan->leaves);
	packer_u32(&p, plan->tasks);
	packer_u32(&p, plan->load);
	packer_u32(&p, plan->cap);
	packer_u32(&p, plan->top);
	digest_pack(&p, plan->content);
	packer_u32(&p, plan->flat ? FLAT : 0);
	packer_u32(&p, (uint32_t)strlen(plan->view));
	digest_pack(&p, digest_stream_end(o->hash));
	counts_pack(&p, &plan->empty);
	packer_zero(&p, sizeof bytes - 8 - packer_size(&p));
	packer_u64(&p, XXH3_64bits(bytes, sizeof bytes - 8));
	plan->of = digest_hash(bytes, sizeof bytes);
	return io_write_at(o->fd, bytes, sizeof bytes, 0, o->name, err);
}

int mesh_plan_write(int fd, const char *name, struct mesh_plan *p, const struct cut_leaf *leaf, const uint64_t *first,
		    struct err *err)
{
	struct out *o = malloc(sizeof *o);
	int r = 0;

	if (o) {
		o->fd = fd;
		o->name = name;
		o->at = MESH_PLAN_HEAD;
		o->used = 0;
		o->hash = digest_stream_new();
	}
	if (!o || !o->hash) {
		free(o);
		return err_set(err, ERR_NOMEM, "no memory for a plan");
	}
	r = put_view(o, p->view, err);
	for (uint32_t i = 0; !r && i < p->tasks; i++)
		r = put_task(o, leaf, first[i], first[i + 1], err);
	for (uint64_t i = 0; !r && i < p->leaves; i++)
		r = put_leaf(o, &leaf[i], err);
	if (!r)
		r = out_flush(o, err);
	if (!r)
		r = put_head(o, p, err);
	digest_stream_free(o->hash);
	free(o);
	return r;
}

/* ---- reading ---- */

static void counts_unpack(struct cursor *c, struct mesh_counts *ret)
{
	ret->points = cursor_u64(c);
	for (unsigned i = 0; i < RULES; i++)
		ret->removed[i] = cursor_u64(c);
	ret->used = cursor_u64(c);
	ret->most.points = cursor_u64(c);
	ret->most.x = cursor_i32(c);
	ret->most.y = cursor_i32(c);
	ret->halo = cursor_u64(c);
	ret->cells_read = cursor_u64(c);
	ret->points_read = cursor_u64(c);
}

static int read_head(struct mesh_plan *p, size_t *ret_view, struct err *err)
{
	uint8_t bytes[MESH_PLAN_HEAD];
	struct cursor c = cursor_of(bytes, sizeof bytes), last = cursor_of(bytes + sizeof bytes - 8, 8);
	int r = io_read_at(p->fd, bytes, sizeof bytes, 0, p->name, err);
	uint32_t version, flags;

	if (r)
		return r;
	if (cursor_u32(&c) != MAGIC || cursor_u64(&last) != XXH3_64bits(bytes, sizeof bytes - 8))
		return wrong(p, 0, "its head is invalid", err);
	version = cursor_u32(&c);
	if (version > VERSION) {
		err_set(err, ERR_VERSION, "a plan of version %" PRIu32 "; this acut is too old to read it", version);
		return err_add_file(err, p->name);
	}
	p->leaves = cursor_u64(&c);
	p->tasks = cursor_u32(&c);
	p->load = cursor_u32(&c);
	p->cap = cursor_u32(&c);
	p->top = cursor_u32(&c);
	p->content = digest_unpack(&c);
	flags = cursor_u32(&c);
	*ret_view = cursor_u32(&c);
	digest_unpack(&c);
	counts_unpack(&c, &p->empty);
	p->flat = flags == FLAT;
	p->of = digest_hash(bytes, sizeof bytes);
	p->at = MESH_PLAN_HEAD + padded(*ret_view) + 8;
	if (flags > FLAT || *ret_view > VIEW_TEXT_MAX || !p->load || !p->cap || p->at > p->size ||
	    (p->size - p->at) / MESH_PLAN_TASK < p->tasks ||
	    (p->size - p->at - (uint64_t)p->tasks * MESH_PLAN_TASK) % MESH_PLAN_LEAF ||
	    (p->size - p->at - (uint64_t)p->tasks * MESH_PLAN_TASK) / MESH_PLAN_LEAF != p->leaves)
		return wrong(p, 0, "its head does not agree with its size", err);
	return 0;
}

static int read_view(struct mesh_plan *p, size_t n, struct err *err)
{
	size_t size = padded(n) + 8;
	char *bytes = calloc(1, size);
	struct cursor c;
	int r;

	if (!bytes)
		return err_set(err, ERR_NOMEM, "no memory for a plan");
	r = io_read_at(p->fd, bytes, size, MESH_PLAN_HEAD, p->name, err);
	c = cursor_of(bytes + size - 8, 8);
	if (!r && (cursor_u64(&c) != XXH3_64bits_withSeed(bytes, size - 8, MESH_PLAN_HEAD) || strnlen(bytes, n) != n))
		r = wrong(p, MESH_PLAN_HEAD, "its view is invalid", err);
	if (r) {
		free(bytes);
		return r;
	}
	bytes[n] = 0;
	p->view = bytes;
	return 0;
}

int mesh_plan_read(int fd, const char *name, struct mesh_plan *ret, struct err *err)
{
	struct mesh_plan p = {.fd = fd, .name = name};
	struct stat st;
	size_t view = 0;
	int r;

	if (io->fstat(fd, &st) < 0) {
		err_sys(err, errno, "cannot look at a plan");
		return err_add_file(err, name);
	}
	p.size = (uint64_t)st.st_size;
	r = read_head(&p, &view, err);
	if (!r)
		r = read_view(&p, view, err);
	if (!r)
		*ret = p;
	return r;
}

void mesh_plan_done(struct mesh_plan *p)
{
	free(p->view);
	p->view = NULL;
}

static bool leaf_unpack(struct cursor *c, struct cut_region *ret)
{
	ret->x = cursor_u32(c);
	ret->y = cursor_u32(c);
	ret->wx = cursor_u8(c);
	ret->wy = cursor_u8(c);
	ret->inf = cursor_u8(c);
	cursor_u8(c);
	cursor_u32(c);
	return ret->wx <= 32 && ret->wy <= 32 && ret->inf <= 15;
}

static int read_leaves(const struct mesh_plan *p, uint64_t first, uint64_t n, uint64_t check, struct cut_region **ret,
		       struct err *err)
{
	uint64_t at = p->at + (uint64_t)p->tasks * MESH_PLAN_TASK + first * MESH_PLAN_LEAF;
	uint8_t *bytes = calloc(n, MESH_PLAN_LEAF);
	struct cut_region *region = malloc(n * sizeof *region);
	struct cursor c = cursor_of(bytes, n * MESH_PLAN_LEAF);
	int r = 0;

	if (!bytes || !region)
		r = err_set(err, ERR_NOMEM, "no memory for %" PRIu64 " regions", n);
	if (!r)
		r = io_read_at(p->fd, bytes, n * MESH_PLAN_LEAF, at, p->name, err);
	if (!r && XXH3_64bits(bytes, n * MESH_PLAN_LEAF) != check)
		r = wrong(p, at, "the checksum of its regions does not agree", err);
	for (uint64_t i = 0; !r && i < n; i++)
		if (!leaf_unpack(&c, &region[i]))
			r = wrong(p, at + i * MESH_PLAN_LEAF, "it has a region that there cannot be", err);
	free(bytes);
	if (r)
		free(region);
	else
		*ret = region;
	return r;
}

int mesh_plan_leaves(const struct mesh_plan *p, uint32_t task, struct cut_region **ret, uint64_t *ret_n, struct err *err)
{
	uint64_t at = p->at + (uint64_t)task * MESH_PLAN_TASK, first, n, check;
	uint8_t bytes[MESH_PLAN_TASK];
	struct cursor c;
	int r;

	if (task >= p->tasks)
		return err_set(err, ERR_CONFLICT, "the plan is for %" PRIu32 " tasks, and this is number %" PRIu32, p->tasks,
			       task);
	r = io_read_at(p->fd, bytes, sizeof bytes, at, p->name, err);
	if (r)
		return r;
	c = cursor_of(bytes, sizeof bytes);
	first = cursor_u64(&c);
	n = cursor_u64(&c);
	check = cursor_u64(&c);
	if (cursor_u64(&c) != XXH3_64bits_withSeed(bytes, sizeof bytes - 8, at) || first > p->leaves || n > p->leaves - first)
		return wrong(p, at, "the range of a task is invalid", err);
	*ret = NULL;
	*ret_n = n;
	return n ? read_leaves(p, first, n, check, ret, err) : 0;
}
