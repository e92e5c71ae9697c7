/*
 * The records of finished domains in a plan's file: what a job's blocks are, for whoever compares two of its dataset.
 *
 * They stand behind the leaves, between splits, and may be torn by a crash: each has its own checksum, and whoever
 * reads them ends at the first that is not whole. Nothing depends on them being there.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <xxhash.h>

#include "cursor.h"
#include "err.h"
#include "io.h"
#include "plan_file_priv.h"

void plan_record_seal(uint8_t record[PLAN_RECORD])
{
	struct packer p = packer_of(record + PLAN_RECORD - 8, 8);

	packer_u64(&p, XXH3_64bits(record, PLAN_RECORD - 8));
}

bool plan_record_sealed(const uint8_t record[PLAN_RECORD])
{
	struct cursor c = cursor_of(record + PLAN_RECORD - 8, 8);

	return cursor_u64(&c) == XXH3_64bits(record, PLAN_RECORD - 8);
}

void plan_done_pack(const struct plan_done *d, uint8_t record[PLAN_RECORD])
{
	struct packer p = packer_of(record, PLAN_RECORD);

	memset(record, 0, PLAN_RECORD);
	packer_u32(&p, PLAN_MAGIC);
	packer_u16(&p, PLAN_VERSION);
	packer_u8(&p, PLAN_DONE);
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
	plan_record_seal(record);
}

static bool done_unpack(const uint8_t record[PLAN_RECORD], struct plan_done *ret)
{
	struct cursor c = cursor_of(record, PLAN_RECORD);
	char text[CUT_REGION_TEXT_SIZE];
	struct plan_done d;

	if (!plan_record_sealed(record) || cursor_u32(&c) != PLAN_MAGIC || cursor_u16(&c) != PLAN_VERSION ||
	    cursor_u8(&c) != PLAN_DONE)
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

int plan_file_each_done(int plansfd, uint64_t job, int (*fn)(void *ctx, const struct plan_done *, struct err *), void *ctx,
			struct err *err)
{
	uint8_t record[3 * PLAN_RECORD];
	struct plan_done done;
	struct plan_head head;
	char name[PLAN_NAME];
	size_t size = 0;
	uint64_t at;
	int fd, r;

	snprintf(name, sizeof name, "plan-%llu", (unsigned long long)job);
	fd = io->openat(plansfd, name, O_RDONLY | O_CLOEXEC, 0);
	if (fd < 0)
		return errno == ENOENT ? 0 : err_sys(err, errno, "cannot open %s", name);
	r = io_read_some(fd, record, PLAN_RECORD, 0, name, &size, err);
	if (!r && (size < PLAN_RECORD || !plan_head_unpack(record, &head) || head.job != job || head.n > UINT32_MAX))
		size = 0;
	for (at = size ? (head.n + 1) * PLAN_RECORD : 0; !r && size;) {
		r = plan_record_next(name, fd, at, record, &size, err);
		if (!r && size == PLAN_RECORD && done_unpack(record, &done))
			r = fn(ctx, &done, err);
		at += size;
	}
	io_close(fd);
	return r;
}
