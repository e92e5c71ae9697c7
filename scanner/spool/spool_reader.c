/*
 * Reading a spool, from a file or a pipe, sequentially, through one window of memory that is as large as the largest
 * record so far.
 *
 * After an incomplete record the reader searches for the next complete one: mark, check of the head, a number that is
 * not lower, check of the payload. If there is none up to the end, the rest is what a kill or a power cut left, and the
 * spool ends. If there is one, something in the middle is damaged; that is an error with its offset, until spool_skip
 * continues behind it. If only the payload is invalid, its length may include bytes that were lost, so complete records
 * can be inside it; these are searched, too, but no stretch twice. So each byte is examined a bounded number of times,
 * whatever it contains.
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "grow.h"
#include "io.h"
#include "spool_priv.h"

enum { WINDOW = 1 << 20 };

struct spool_reader {
	int fd;
	char name[256];
	struct spool_head head;
	uint64_t seed;
	uint8_t *buf;
	size_t room, at, end; /* read and not used yet: buf[at..end) */
	uint64_t base;        /* offset of buf[0] in the file */
	bool eof;
	uint64_t expect;          /* number of the next record */
	uint64_t whole;           /* offset behind the last complete record */
	uint64_t spanned;         /* end of the last invalid payload */
	bool damaged;             /* reported and not skipped yet: [damage, offset of at) */
	uint64_t damage, missing; /* records lost there: from expect - missing */
	bool over, head_damaged, ended;
	uint64_t torn;
};

static uint64_t offset_of_at(const struct spool_reader *r)
{
	return r->base + r->at;
}

static size_t bytes_left(const struct spool_reader *r)
{
	return r->end - r->at;
}

/* Makes room for n bytes from `at`. */
static int make_room(struct spool_reader *r, size_t n, struct err *err)
{
	if (r->room - r->at >= n)
		return 0;
	memmove(r->buf, r->buf + r->at, bytes_left(r));
	r->base += r->at;
	r->end -= r->at;
	r->at = 0;
	return grow(&r->buf, &r->room, n, n, 1) ? 0 : err_set(err, ERR_NOMEM, "no memory to read a spool");
}

/* 1: n bytes are there; 0: the file ends before; negative. Never waits for more than n. */
static int need_bytes(struct spool_reader *r, size_t n, struct err *err)
{
	while (bytes_left(r) < n && !r->eof) {
		ssize_t got;

		if (make_room(r, n, err))
			return err_add_file(err, r->name);
		got = io->read(r->fd, r->buf + r->end, r->room - r->end);
		if (got < 0 && errno == EINTR)
			continue;
		if (got < 0) {
			err_sys(err, errno, "cannot read");
			err_add_place(err, r->base + r->end, NULL);
			return err_add_file(err, r->name);
		}
		r->end += (size_t)got;
		r->eof = !got;
	}
	return bytes_left(r) >= n;
}

/* ---- the head ---- */

static int newer(const struct spool_reader *r, struct err *err)
{
	struct cursor c = cursor_of(r->buf + 8, 4);

	err_set(err, ERR_VERSION, "this spool has version %u; this acut-scan reads version %d", cursor_u32(&c), SPOOL_VERSION);
	err_add_hint(err, "read it with the version of acut that wrote it, or a newer one");
	return err_add_file(err, r->name);
}

static int no_spool(const struct spool_reader *r, const char *why, struct err *err)
{
	err_set(err, ERR_INPUT, "%s", why);
	err_add_place(err, 0, "head");
	return err_add_file(err, r->name);
}

static int cut_head(const struct spool_reader *r, struct err *err)
{
	err_set(err, ERR_TRUNCATED,
		bytes_left(r) ? "its head was not written whole: nothing was captured into this spool" :
				"the file is empty: nothing was captured into it");
	return err_add_file(err, r->name);
}

static uint32_t size_at(const uint8_t *at)
{
	struct cursor c = cursor_of(at + 12, 4);

	return cursor_u32(&c);
}

static uint32_t version_at(const uint8_t *at)
{
	struct cursor c = cursor_of(at + 8, 4);

	return cursor_u32(&c);
}

/* Tries both copies: one of `size` bytes at 0, then one of `size` bytes at `size`. */
static int find_head(struct spool_reader *r, size_t *ret_size, size_t *ret_from, struct err *err)
{
	for (size_t copy = 0; copy < 2; copy++) {
		for (size_t size = SPOOL_BLOCK; size <= SPOOL_HEAD_MAX; size += SPOOL_BLOCK) {
			int rc = need_bytes(r, (copy + 1) * size, err);

			if (rc < 0)
				return rc;
			if (!rc)
				break;
			if (spool_head_whole(r->buf + copy * size, size)) {
				*ret_size = size;
				*ret_from = copy * size;
				return 1;
			}
		}
	}
	return 0;
}

static int read_head(struct spool_reader *r, struct err *err)
{
	size_t size = 0, from = 0, n;
	int rc = need_bytes(r, 16, err);

	if (rc < 0)
		return rc;
	n = bytes_left(r) < 8 ? bytes_left(r) : 8;
	if (!rc && !memcmp(r->buf, SPOOL_MAGIC, n))
		return cut_head(r, err);
	rc = find_head(r, &size, &from, err);
	if (rc < 0)
		return rc;
	if (!rc && memcmp(r->buf, SPOOL_MAGIC, n))
		return no_spool(r, "this is no spool of acut-scan", err);
	if (!rc && r->eof && bytes_left(r) < size_at(r->buf))
		return cut_head(r, err);
	if (!rc)
		return no_spool(r, "both heads of the spool are damaged", err);
	if (version_at(r->buf + from) > SPOOL_VERSION)
		return newer(r, err);
	if (version_at(r->buf + from) != SPOOL_VERSION)
		return no_spool(r, "the version of the spool is none that there ever was", err);
	rc = spool_head_decode(r->buf + from, size, &r->head, err);
	if (rc)
		return err_add_file(err, r->name);
	r->head_damaged = from > 0;
	rc = need_bytes(r, 2 * size, err);
	if (rc < 0)
		return rc;
	r->whole = 2 * size;
	if (!rc) { /* the file ends in the second head */
		r->whole = size;
		r->torn = bytes_left(r) - size;
		r->over = true;
		return 0;
	}
	r->at += 2 * size;
	r->seed = spool_seed(r->head.id);
	return 0;
}

int spool_open(int fd, const char *name, struct spool_reader **ret, struct err *err)
{
	struct spool_reader *r = calloc(1, sizeof(*r));
	int rc;

	if (r)
		r->buf = malloc(WINDOW);
	if (!r || !r->buf) {
		free(r);
		io_close(fd);
		return err_set(err, ERR_NOMEM, "no memory to read a spool");
	}
	r->fd = fd;
	r->room = WINDOW;
	snprintf(r->name, sizeof(r->name), "%s", name);
	rc = read_head(r, err);
	if (rc) {
		spool_reader_free(r);
		return rc;
	}
	*ret = r;
	return 0;
}

struct spool_reader *spool_reader_free(struct spool_reader *r)
{
	if (!r)
		return NULL;
	io_close(r->fd);
	spool_head_clear(&r->head);
	free(r->buf);
	free(r);
	return NULL;
}

const struct spool_head *spool_reader_head(const struct spool_reader *r)
{
	return &r->head;
}

/* ---- records ---- */

/* Reads to the end of the file; everything behind `from` is incomplete. */
static int run_out(struct spool_reader *r, uint64_t from, struct err *err)
{
	int rc;

	do {
		r->at = r->end;
		rc = need_bytes(r, 1, err);
	} while (rc > 0);
	if (rc < 0)
		return rc;
	r->torn = offset_of_at(r) - from;
	r->over = true;
	return 0;
}

static int report_damage(const struct spool_reader *r, struct err *err)
{
	uint64_t n = offset_of_at(r) - r->damage, first = r->expect - r->missing;

	if (!n)
		err_set(err, ERR_INPUT, "records %llu to %llu are missing", (unsigned long long)first,
			(unsigned long long)(r->expect - 1));
	else if (r->missing)
		err_set(err, ERR_INPUT, "%llu bytes are damaged; records %llu to %llu are lost", (unsigned long long)n,
			(unsigned long long)first, (unsigned long long)(r->expect - 1));
	else
		err_set(err, ERR_INPUT, "%llu bytes are no record, though none is missing", (unsigned long long)n);
	err_add_place(err, r->damage, "record");
	return err_add_file(err, r->name);
}

static int found_next(struct spool_reader *r, uint64_t damage, uint64_t seq, struct err *err)
{
	r->damaged = true;
	r->damage = damage;
	r->missing = seq - r->expect;
	r->expect = seq;
	return report_damage(r, err);
}

/* Whether there is a head of a record at `at`, with a number that is not lower. */
static bool head_here(const struct spool_reader *r, struct spool_mark *ret)
{
	return spool_mark_decode(r->seed, r->buf + r->at, ret) && ret->seq >= r->expect;
}

/* 1: the payload is valid; 0: it is invalid; 2: the file ends in it. */
static int payload_here(struct spool_reader *r, const struct spool_mark *m, struct err *err)
{
	int rc = need_bytes(r, SPOOL_RECORD_HEAD + (size_t)m->size, err);

	if (rc < 0)
		return rc;
	if (!rc)
		return 2;
	return spool_check(r->seed, r->buf + r->at + SPOOL_RECORD_HEAD, m->size) == m->check;
}

/* Continues after a head whose payload is invalid, or would extend beyond the end of the file. */
static void pass_record(struct spool_reader *r, const struct spool_mark *m)
{
	uint64_t end = offset_of_at(r) + SPOOL_RECORD_HEAD + m->size;
	bool nested = offset_of_at(r) < r->spanned;

	r->at += SPOOL_RECORD_HEAD;
	if (end > r->base + r->end)
		return; /* none of it was examined */
	if (nested)
		r->at += m->size;
	if (end > r->spanned)
		r->spanned = end;
}

/* Searches from `at` on, after something invalid that begins at `damage`. */
static int find_next(struct spool_reader *r, uint64_t damage, struct err *err)
{
	static const uint8_t mark[4] = {SPOOL_MARK & 0xff, SPOOL_MARK >> 8 & 0xff, SPOOL_MARK >> 16 & 0xff, SPOOL_MARK >> 24};
	struct spool_mark m;
	int rc;

	for (;;) {
		const uint8_t *p;

		rc = need_bytes(r, SPOOL_RECORD_HEAD, err);
		if (rc <= 0)
			return rc < 0 ? rc : run_out(r, damage, err);
		p = memmem(r->buf + r->at, bytes_left(r), mark, sizeof(mark));
		if (!p) {
			r->at = r->end - (sizeof(mark) - 1);
			continue;
		}
		r->at = (size_t)(p - r->buf);
		rc = need_bytes(r, SPOOL_RECORD_HEAD, err);
		if (rc <= 0)
			return rc < 0 ? rc : run_out(r, damage, err);
		if (!head_here(r, &m)) {
			r->at++;
			continue;
		}
		rc = payload_here(r, &m, err);
		if (rc < 0)
			return rc;
		if (rc == 1)
			return found_next(r, damage, m.seq, err);
		pass_record(r, &m);
	}
}

static void deliver_record(struct spool_reader *r, const struct spool_mark *m, struct spool_record *ret)
{
	ret->kind = m->kind;
	ret->flags = m->flags;
	ret->seq = m->seq;
	ret->time_ns = m->time_ns;
	ret->at = r->buf + r->at + SPOOL_RECORD_HEAD;
	ret->size = m->size;
	ret->offset = offset_of_at(r);
	r->at += SPOOL_RECORD_HEAD + (size_t)m->size;
	r->whole = offset_of_at(r);
	r->expect = m->seq + 1;
	r->ended = m->kind == SPOOL_END;
}

int spool_next(struct spool_reader *r, struct spool_record *ret, struct err *err)
{
	uint64_t from = offset_of_at(r);
	struct spool_mark m;
	int rc;

	if (r->damaged)
		return report_damage(r, err);
	if (r->over)
		return 0;
	if (r->ended)
		return run_out(r, from, err);
	rc = need_bytes(r, SPOOL_RECORD_HEAD, err);
	if (rc <= 0)
		return rc < 0 ? rc : run_out(r, from, err);
	if (!head_here(r, &m)) {
		r->at++;
		return find_next(r, from, err);
	}
	if (m.seq > r->expect)
		return found_next(r, from, m.seq, err);
	rc = payload_here(r, &m, err);
	if (rc < 0)
		return rc;
	if (rc != 1) {
		pass_record(r, &m);
		return find_next(r, from, err);
	}
	deliver_record(r, &m, ret);
	return 1;
}

int spool_skip(struct spool_reader *r, uint64_t *ret_bytes, struct err *err)
{
	if (!r->damaged) {
		err_set(err, ERR_INTERNAL, "nothing damaged is to be skipped here");
		return err_add_file(err, r->name);
	}
	*ret_bytes = offset_of_at(r) - r->damage;
	r->damaged = false;
	return 0;
}

void spool_tail(const struct spool_reader *r, struct spool_tail *ret)
{
	*ret = (struct spool_tail){.ended = r->ended, .head_damaged = r->head_damaged, .torn = r->torn, .whole = r->whole};
}
