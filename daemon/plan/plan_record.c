/*
 * Records of a plan's file, to bytes and back (format.md, "Plans").
 *
 * Every record has PLAN_RECORD bytes, begins with magic, version and kind, and ends with its own checksum. Unpacking a
 * record that is damaged, or of another kind or version, fails and leaves the output untouched.
 */
#include "plan_record.h"

#include <string.h>
#include <xxhash.h>

#include "cursor.h"
#include "io.h"

enum { TEXT_AT = 32 };
_Static_assert(TEXT_AT + CUT_REGION_TEXT_SIZE + 8 == PLAN_RECORD, "format.md, \"Plans\"");

static void seal(uint8_t record[PLAN_RECORD])
{
	struct packer p = packer_of(record + PLAN_RECORD - 8, 8);

	packer_u64(&p, XXH3_64bits(record, PLAN_RECORD - 8));
}

bool plan_record_sealed(const uint8_t record[PLAN_RECORD])
{
	struct cursor c = cursor_of(record + PLAN_RECORD - 8, 8);

	return cursor_u64(&c) == XXH3_64bits(record, PLAN_RECORD - 8);
}

/* Writes the bytes that all records begin with. */
static void common_pack(struct packer *p, uint8_t record[PLAN_RECORD], unsigned kind)
{
	memset(record, 0, PLAN_RECORD);
	*p = packer_of(record, PLAN_RECORD);
	packer_u32(p, PLAN_MAGIC);
	packer_u16(p, PLAN_VERSION);
	packer_u8(p, (uint8_t)kind);
}

/* False: the record is damaged, or of another kind or version. */
static bool common_unpack(struct cursor *c, const uint8_t record[PLAN_RECORD], unsigned kind)
{
	*c = cursor_of(record, PLAN_RECORD);
	return plan_record_sealed(record) && cursor_u32(c) == PLAN_MAGIC && cursor_u16(c) == PLAN_VERSION && cursor_u8(c) == kind;
}

void plan_leaf_pack(unsigned kind, const struct cut_leaf *leaf, uint8_t record[PLAN_RECORD])
{
	struct packer p;

	common_pack(&p, record, kind);
	packer_u8(&p, leaf->exact);
	packer_u8(&p, leaf->stuck);
	packer_u8(&p, leaf->flat);
	packer_zero(&p, 6);
	packer_u64(&p, leaf->count);
	packer_u64(&p, leaf->above);
	cut_region_text(&leaf->region, (char *)record + TEXT_AT);
	/* Zeros after the text: cut_region_text may leave other bytes there. */
	memset(record + TEXT_AT + strlen((char *)record + TEXT_AT), 0, CUT_REGION_TEXT_SIZE - strlen((char *)record + TEXT_AT));
	seal(record);
}

bool plan_leaf_unpack(unsigned kind, const uint8_t record[PLAN_RECORD], struct cut_leaf *ret)
{
	struct cursor c;
	struct cut_leaf leaf = {0};

	if (!common_unpack(&c, record, kind))
		return false;
	leaf.exact = cursor_u8(&c) != 0;
	leaf.stuck = cursor_u8(&c);
	leaf.flat = cursor_u8(&c) != 0;
	cursor_skip(&c, 6);
	leaf.count = cursor_u64(&c);
	leaf.above = cursor_u64(&c);
	if (!memchr(record + TEXT_AT, 0, CUT_REGION_TEXT_SIZE) || !cut_region_parse((const char *)record + TEXT_AT, &leaf.region))
		return false;
	*ret = leaf;
	return true;
}

void plan_head_pack(const struct plan_head *h, uint8_t record[PLAN_RECORD])
{
	struct packer p;

	common_pack(&p, record, PLAN_HEAD);
	packer_zero(&p, 1);
	packer_u64(&p, h->job);
	packer_u64(&p, h->generation);
	packer_u64(&p, h->n);
	packer_u32(&p, h->kept.load);
	packer_u32(&p, h->kept.cap);
	packer_u64(&p, h->kept.base.hi);
	packer_u64(&p, h->kept.base.lo);
	packer_u64(&p, h->leaves.hi);
	packer_u64(&p, h->leaves.lo);
	seal(record);
}

bool plan_head_unpack(const uint8_t record[PLAN_RECORD], struct plan_head *ret)
{
	struct cursor c;

	if (!common_unpack(&c, record, PLAN_HEAD))
		return false;
	cursor_skip(&c, 1);
	ret->job = cursor_u64(&c);
	ret->generation = cursor_u64(&c);
	ret->n = cursor_u64(&c);
	ret->kept.load = cursor_u32(&c);
	ret->kept.cap = cursor_u32(&c);
	ret->kept.base.hi = cursor_u64(&c);
	ret->kept.base.lo = cursor_u64(&c);
	ret->leaves.hi = cursor_u64(&c);
	ret->leaves.lo = cursor_u64(&c);
	return true;
}

void plan_done_pack(const struct plan_done *d, uint8_t record[PLAN_RECORD])
{
	struct packer p;

	common_pack(&p, record, PLAN_DONE);
	packer_u8(&p, d->region.inf);
	packer_u32(&p, d->region.x);
	packer_u32(&p, d->region.y);
	packer_u8(&p, d->region.wx);
	packer_u8(&p, d->region.wy);
	packer_zero(&p, 6);
	packer_u64(&p, d->base.hi);
	packer_u64(&p, d->base.lo);
	packer_u64(&p, d->list.hi);
	packer_u64(&p, d->list.lo);
	packer_u64(&p, d->digest.hi);
	packer_u64(&p, d->digest.lo);
	packer_u64(&p, d->payload);
	packer_u64(&p, d->triangles);
	packer_u64(&p, d->bytes);
	seal(record);
}

bool plan_done_unpack(const uint8_t record[PLAN_RECORD], struct plan_done *ret)
{
	struct cursor c;
	char text[CUT_REGION_TEXT_SIZE];
	struct plan_done d;

	if (!common_unpack(&c, record, PLAN_DONE))
		return false;
	d.region.inf = cursor_u8(&c);
	d.region.x = cursor_u32(&c);
	d.region.y = cursor_u32(&c);
	d.region.wx = cursor_u8(&c);
	d.region.wy = cursor_u8(&c);
	cursor_skip(&c, 6);
	d.base.hi = cursor_u64(&c);
	d.base.lo = cursor_u64(&c);
	d.list.hi = cursor_u64(&c);
	d.list.lo = cursor_u64(&c);
	d.digest.hi = cursor_u64(&c);
	d.digest.lo = cursor_u64(&c);
	d.payload = cursor_u64(&c);
	d.triangles = cursor_u64(&c);
	d.bytes = cursor_u64(&c);
	if (!cut_region_parse(cut_region_text(&d.region, text), &d.region))
		return false;
	*ret = d;
	return true;
}

int plan_record_next(const char *name, int fd, uint64_t at, uint8_t record[3 * PLAN_RECORD], size_t *ret_size, struct err *err)
{
	size_t got = 0;
	int r = io_read_some(fd, record, 3 * PLAN_RECORD, at, name, &got, err);

	*ret_size = 0;
	if (r || got < PLAN_RECORD || !plan_record_sealed(record))
		return r;
	if (record[6] == PLAN_DONE)
		*ret_size = PLAN_RECORD;
	else if (got == 3 * PLAN_RECORD)
		*ret_size = 3 * PLAN_RECORD;
	return 0;
}
