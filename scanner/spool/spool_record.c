/* The heads of records, and their checks. Both are seeded by the spool's id, so that neither a spool inside a payload
 * nor old bytes of a disk are taken for records. */
#include <xxhash.h>

#include "cursor.h"
#include "spool_priv.h"

uint64_t spool_seed(const uint8_t id[16])
{
	return XXH3_64bits(id, 16);
}

uint64_t spool_check(uint64_t seed, const void *at, size_t size)
{
	return XXH3_64bits_withSeed(at, size, seed);
}

void spool_mark_encode(uint64_t seed, const struct spool_mark *m, uint8_t ret[SPOOL_RECORD_HEAD])
{
	struct packer p = packer_of(ret, SPOOL_RECORD_HEAD);

	packer_u32(&p, SPOOL_MARK);
	packer_u32(&p, 0);
	packer_u8(&p, (uint8_t)m->kind);
	packer_u8(&p, (uint8_t)m->flags);
	packer_u16(&p, 0);
	packer_u32(&p, m->size);
	packer_u64(&p, m->seq);
	packer_u64(&p, (uint64_t)m->time_ns);
	packer_u64(&p, m->check);
	p = packer_of(ret + 4, 4);
	packer_u32(&p, (uint32_t)spool_check(seed, ret + 8, SPOOL_RECORD_HEAD - 8));
}

bool spool_mark_decode(uint64_t seed, const uint8_t at[SPOOL_RECORD_HEAD], struct spool_mark *ret)
{
	struct cursor c = cursor_of(at, SPOOL_RECORD_HEAD);
	bool marked = cursor_u32(&c) == SPOOL_MARK;
	uint32_t check = cursor_u32(&c);
	struct spool_mark m;
	uint16_t zero;

	if (!marked || check != (uint32_t)spool_check(seed, at + 8, SPOOL_RECORD_HEAD - 8))
		return false;
	m.kind = (enum spool_kind)cursor_u8(&c);
	m.flags = cursor_u8(&c);
	zero = cursor_u16(&c);
	m.size = cursor_u32(&c);
	m.seq = cursor_u64(&c);
	m.time_ns = cursor_i64(&c);
	m.check = cursor_u64(&c);
	if (zero || m.kind < SPOOL_DATA || m.kind > SPOOL_END || m.size > SPOOL_PAYLOAD_MAX || m.seq == UINT64_MAX)
		return false;
	*ret = m;
	return true;
}

int spool_totals_read(const struct spool_record *r, struct spool_totals *ret, struct err *err)
{
	struct cursor c = cursor_of(r->at, r->size);
	struct spool_totals t = {0};
	const uint8_t *sha;

	if (r->kind != SPOOL_END || r->size != SPOOL_END_SIZE)
		return err_set(err, ERR_INPUT, "record %llu has no totals", (unsigned long long)r->seq);
	t.records = cursor_u64(&c);
	t.transfers = cursor_u64(&c);
	t.bytes = cursor_u64(&c);
	t.events = cursor_u64(&c);
	sha = cursor_bytes(&c, 32);
	for (int i = 0; i < 32; i++)
		t.sha256[i] = sha[i];
	*ret = t;
	return 0;
}
