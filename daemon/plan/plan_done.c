/*
 * The records of finished domains in a plan's file: which stored files a job's blocks came from. Two jobs of a dataset
 * are compared by them.
 *
 * The records follow the leaves, between splits. A crash may leave the last one incomplete: each has a checksum, and a
 * reader ends at the first that does not agree. Nothing requires a record to be there.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>

#include "err.h"
#include "io.h"
#include "plan_record.h"

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
		if (!r && size == PLAN_RECORD && plan_done_unpack(record, &done))
			r = fn(ctx, &done, err);
		at += size;
	}
	io_close(fd);
	return r;
}
