/*
 * Going on with a fetch: what reader and check know between two blocks, as bytes (format.md, "State of a fetch"), and a
 * fetch that begins with them. A block that was checked but not taken, or half of it, spoils that (`torn`).
 */
#include "fetch.h"

#include <stdlib.h>
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

enum { STATE_HEAD = 8 + 8 + 16 + 3 * 8 + 4 * 8 + 6 * 4, STATE_SUM = 8 };
static const uint32_t STATE_MAGIC = 0x53464341; /* "ACFS" */
static const uint32_t STATE_VERSION = 2;

int acut_fetch_state(struct acut *a, void **ret, size_t *ret_size)
{
	const struct fetch *f = a->fetch;
	struct stream_reader_state at;
	struct packer p;
	uint8_t *bytes;
	size_t size;

	if (!f || !f->feed.check || f->torn || f->changes)
		return err_set(&a->err, ERR_USAGE, "there is no fetch to go on with");
	stream_reader_state(f->reader, &at);
	size = STATE_HEAD + check_packed_size(f->feed.check) + STATE_SUM;
	bytes = malloc(size);
	if (!bytes)
		return err_set(&a->err, ERR_NOMEM, "there is no memory for the state of a fetch");
	p = packer_of(bytes, size);
	packer_u32(&p, STATE_MAGIC);
	packer_u32(&p, STATE_VERSION);
	packer_u64(&p, f->job);
	packer_u64(&p, f->id.hi);
	packer_u64(&p, f->id.lo);
	for (unsigned i = 0; i < 3; i++)
		packer_i64(&p, f->feed.head.k[i]);
	packer_u64(&p, at.blocks);
	packer_u64(&p, at.vertices);
	packer_u64(&p, at.triangles);
	packer_u64(&p, at.last_index);
	for (unsigned i = 0; i < 6; i++)
		packer_i32(&p, at.box[i]);
	check_pack(f->feed.check, &p);
	packer_u64(&p, XXH3_64bits(bytes, size - STATE_SUM));
	*ret = bytes;
	*ret_size = size;
	return 0;
}

static int damaged(struct err *err)
{
	err_set(err, ERR_CORRUPT, "the state of a fetch is damaged");
	return err_add_hint(err, "fetch it again, from the start");
}

int fetch_read_state(struct fetch *f, const uint8_t *bytes, size_t size, struct err *err)
{
	struct cursor c = cursor_of(bytes, size), sum;

	if (size < STATE_HEAD + STATE_SUM)
		return damaged(err);
	sum = cursor_of(bytes + size - STATE_SUM, STATE_SUM);
	if (cursor_u64(&sum) != XXH3_64bits(bytes, size - STATE_SUM) || cursor_u32(&c) != STATE_MAGIC)
		return damaged(err);
	if (cursor_u32(&c) != STATE_VERSION) {
		err_set(err, ERR_VERSION, "the state of a fetch is of another version");
		return err_add_hint(err, "fetch it again, from the start");
	}
	f->job = cursor_u64(&c);
	f->id.hi = cursor_u64(&c);
	f->id.lo = cursor_u64(&c);
	for (unsigned i = 0; i < 3; i++)
		f->k[i] = cursor_i64(&c);
	f->from.blocks = cursor_u64(&c);
	f->from.vertices = cursor_u64(&c);
	f->from.triangles = cursor_u64(&c);
	f->from.last_index = cursor_u64(&c);
	for (unsigned i = 0; i < 6; i++)
		f->from.box[i] = cursor_i32(&c);
	f->state = c;
	f->continued = true;
	return 0;
}

int acut_fetch_from(struct acut *a, const void *state, size_t size, const struct acut_mesh_sink *sink)
{
	int r = call_begin(a);
	struct fetch *f = r < 0 ? NULL : fetch_new(a, sink);

	if (!f)
		return -(int)a->err.code;
	r = fetch_read_state(f, state, size, &a->err);
	return r < 0 ? r : fetch_run(f);
}
