/*
 * Verification of a plan's file: the checksum of every record. A run takes a damaged plan for absent (plan_file.c); this
 * check says what is damaged, and where.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>

#include "cursor.h"
#include "err.h"
#include "io.h"
#include "plan_record.h"

enum { CHUNK = 64, SPLIT = 3 };

static int damaged(const char *name, uint64_t place, const char *what, struct err *err)
{
	err_set(err, ERR_CORRUPT, "the plan of a job is damaged: %s", what);
	err_add_file(err, name);
	return err_add_place(err, place, NULL);
}

/* The version of an otherwise valid header that a later acut wrote; 0: it is no such header. */
static unsigned newer_version(const uint8_t record[PLAN_RECORD])
{
	struct cursor c = cursor_of(record, PLAN_RECORD);
	unsigned version;

	if (!plan_record_sealed(record) || cursor_u32(&c) != PLAN_MAGIC)
		return 0;
	version = cursor_u16(&c);
	return version > PLAN_VERSION ? version : 0;
}

static int not_a_head(const char *name, const uint8_t record[PLAN_RECORD], struct err *err)
{
	unsigned version = newer_version(record);

	if (!version)
		return damaged(name, 0, "its header is not one", err);
	err_set(err, ERR_VERSION, "the plan of a job of version %u; this acut reads version %u", version, PLAN_VERSION);
	return err_add_file(err, name);
}

/* A crash interrupts at most one append, of up to three records; the leaves were published complete. */
static bool may_be_cut(uint64_t i, uint64_t n, uint64_t leaves)
{
	return i > leaves && i + SPLIT >= n;
}

static int check_records(int fd, const char *name, uint64_t n, struct err *err)
{
	uint8_t chunk[CHUNK * PLAN_RECORD];
	struct plan_head head = {0};

	for (uint64_t at = 0; at < n; at += CHUNK) {
		size_t k = n - at < CHUNK ? (size_t)(n - at) : CHUNK;
		int r = io_read_at(fd, chunk, k * PLAN_RECORD, at * PLAN_RECORD, name, err);

		if (r)
			return r;
		if (!at && !plan_head_unpack(chunk, &head))
			return not_a_head(name, chunk, err);
		if (!at && head.n >= n)
			return damaged(name, 0, "it ends before its last region", err);
		for (size_t i = at ? 0 : 1; i < k; i++)
			if (!plan_record_sealed(chunk + i * PLAN_RECORD) && !may_be_cut(at + i, n, head.n))
				return damaged(name, (at + i) * PLAN_RECORD, "the checksum of a region does not agree", err);
	}
	return 0;
}

int plan_file_check(int plansfd, uint64_t job, uint64_t *ret_bytes, struct err *err)
{
	char name[PLAN_NAME];
	struct stat st;
	int fd, r;

	snprintf(name, sizeof name, "plan-%llu", (unsigned long long)job);
	fd = io->openat(plansfd, name, O_RDONLY | O_CLOEXEC, 0);
	if (fd < 0 && errno == ENOENT)
		return 0;
	if (fd < 0) {
		err_sys(err, errno, "cannot open");
		return err_add_file(err, name);
	}
	if (io->fstat(fd, &st) != 0) {
		err_sys(err, errno, "cannot look at");
		r = err_add_file(err, name);
	} else if (!st.st_size) {
		r = 0; /* a power cut came before the plan was durable, and it was never read */
	} else if (st.st_size < PLAN_RECORD) {
		r = damaged(name, 0, "it has no header", err);
	} else {
		*ret_bytes = (uint64_t)st.st_size;
		r = check_records(fd, name, (uint64_t)st.st_size / PLAN_RECORD, err);
	}
	io_close(fd);
	return r;
}
