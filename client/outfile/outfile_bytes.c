/*
 * Bytes of an output: one buffer, and how it is written.
 *
 * A full buffer is written in whole blocks and the rest moves to its front, so offsets in file and memory agree in their low
 * bits. So regular outputs can be written past the page cache on file systems that are known to support it: they are written
 * once and not read, copying them would cost more than all other work on them, and they would displace more useful pages. Odd
 * sizes (the end, a patched header) go through the cache, and so does everything where direct writes are refused. A direct write
 * waits for the disk, so a thread does it (outfile_behind.c).
 *
 * An annex is a second place to append, for bytes that must follow the output while it is still being written. Its bytes are
 * in the same file, so far behind that the two never meet, and joining removes the hole between them
 * (FALLOC_FL_COLLAPSE_RANGE) without moving bytes. The hole must be whole blocks: records from the end of the annex are put
 * before its first until the rest starts on a block boundary, unless the output was filled up to one (outfile_pad). On other file
 * systems the annex is a file of its own and is copied, in the same order. An annex that fits its buffer is not a file, and keeps
 * its order.
 */
#include <errno.h>
#include <fcntl.h>
#include <linux/magic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include "err.h"
#include "outfile_priv.h"
#include "io.h"

#ifndef XFS_SUPER_MAGIC
#define XFS_SUPER_MAGIC 0x58465342
#endif
#ifndef F2FS_SUPER_MAGIC
#define F2FS_SUPER_MAGIC 0xF2F52010
#endif
#ifndef OVERLAYFS_SUPER_MAGIC
#define OVERLAYFS_SUPER_MAGIC 0x794c7630
#endif

_Static_assert(OUTFILE_BUFFER % OUTFILE_BLOCK == 0, "a full buffer is whole blocks");

/* ---- past the page cache ---- */

static struct outfile *owner(struct outfile *o)
{
	return o->inside ? o->host : o;
}

static void direct_set(struct outfile *o, bool on)
{
	int flags = o->direct == on ? -1 : fcntl(o->fd, F_GETFL);

	if (flags >= 0 && !fcntl(o->fd, F_SETFL, on ? flags | O_DIRECT : flags & ~O_DIRECT))
		o->direct = on;
}

static void direct_begin(struct outfile *o)
{
	struct statfs fs;

	if (!o->may_direct)
		return;
	o->may_direct = false;
	if (!fstatfs(o->fd, &fs) && (fs.f_type == EXT4_SUPER_MAGIC || fs.f_type == XFS_SUPER_MAGIC))
		direct_set(o, true);
	if (o->direct)
		outfile_behind_begin(o);
}

/* Never again. */
static void direct_end(struct outfile *o)
{
	o->may_direct = false;
	direct_set(o, false);
}

/* ---- to the descriptor ---- */

int outfile_put_at(struct outfile *o, const uint8_t *p, size_t n, uint64_t at, struct err *err)
{
	int r;

	if (o->direct && (n % OUTFILE_BLOCK || at % OUTFILE_BLOCK))
		direct_end(o);
	r = io_write_at(o->fd, p, n, at, o->label, err);
	if (r && o->direct && err->sys == EINVAL) {
		direct_end(o);
		err_clear(err);
		r = io_write_at(o->fd, p, n, at, o->label, err);
	}
	return r;
}

static int put_in_place(struct outfile *o, const uint8_t *p, size_t n, struct err *err)
{
	int r = outfile_put_at(owner(o), p, n, o->base + o->at, err);

	if (!r)
		o->at += n;
	if (!r && o->part)
		outfile_part_add(o->part, p, n);
	return r;
}

static int put_in_order(struct outfile *o, const uint8_t *p, size_t n, struct err *err)
{
	while (n) {
		ssize_t k = write(o->fd, p, n);
		if (k < 0 && errno == EINTR)
			continue;
		if (k < 0) {
			err_sys(err, errno, "writing failed");
			return err_add_file(err, o->label);
		}
		p += k;
		n -= (size_t)k;
		o->at += (uint64_t)k;
	}
	return 0;
}

static int put(struct outfile *o, const uint8_t *p, size_t n, struct err *err)
{
	return o->seekable ? put_in_place(o, p, n, err) : put_in_order(o, p, n, err);
}

static int annex_open(struct outfile *o, struct err *err);

/* It has a file, which no other thread writes. */
static int settle(struct outfile *o, struct err *err)
{
	int r = outfile_behind_wait(o->host ? o->host : o, err);

	return !r && o->fd < 0 ? annex_open(o, err) : r;
}

/* The buffer is full: whole blocks leave it. */
static int spill(struct outfile *o, struct err *err)
{
	size_t whole = o->seekable ? o->used - o->used % OUTFILE_BLOCK : o->used;
	const uint8_t *rest = o->buf + whole;
	struct outfile *of;
	int r = o->fd < 0 ? settle(o, err) : 0;

	if (r)
		return r;
	of = owner(o);
	if (!of->behind)
		direct_begin(of);
	if (of->behind) {
		r = outfile_behind_put(of, &o->buf, whole, o->base + o->at, err);
		o->at += whole;
	} else {
		r = put(o, o->buf, whole, err);
	}
	if (r)
		return r;
	o->used -= whole;
	memmove(o->buf, rest, o->used);
	return 0;
}

int outfile_flush(struct outfile *o, struct err *err)
{
	int r = o->used || o->fd >= 0 ? settle(o, err) : 0;

	if (!r && o->used)
		r = put(o, o->buf, o->used, err);
	if (!r)
		o->used = 0;
	return r;
}

size_t outfile_left(const struct outfile *o)
{
	return o->used < OUTFILE_BUFFER ? OUTFILE_BUFFER - o->used : 0;
}

void *outfile_room(struct outfile *o, size_t n, struct err *err)
{
	if (o->used + n > OUTFILE_BUFFER && spill(o, err))
		return NULL;
	return o->buf + o->used;
}

void outfile_used(struct outfile *o, size_t n)
{
	o->used += n;
}

int outfile_write(struct outfile *o, const void *bytes, size_t n, struct err *err)
{
	const uint8_t *p = bytes;

	while (n) {
		size_t left = outfile_left(o), k;

		if (!left) {
			if (spill(o, err))
				return -err->code;
			left = outfile_left(o);
		}
		k = n < left ? n : left;
		memcpy(o->buf + o->used, p, k);
		o->used += k;
		p += k;
		n -= k;
	}
	return 0;
}

int outfile_patch(struct outfile *o, uint64_t at, const void *bytes, size_t n, struct err *err)
{
	int r = outfile_flush(o, err);

	direct_end(owner(o));
	if (!r)
		r = io_write_at(o->fd, bytes, n, o->base + at, o->label, err);
	if (!r && at + n > o->at)
		o->at = at + n;
	return r;
}

int outfile_read(struct outfile *o, uint64_t at, void *bytes, size_t n, struct err *err)
{
	int r = outfile_flush(o, err);

	direct_end(owner(o));
	return r ? r : io_read_at(o->fd, bytes, n, o->base + at, o->label, err);
}

bool outfile_seekable(const struct outfile *o)
{
	return o->seekable;
}

uint64_t outfile_size(const struct outfile *o)
{
	return o->at + o->used;
}

const char *outfile_name(const struct outfile *o)
{
	return o->label;
}

/* ---- annexes ---- */

int outfile_annex(struct outfile *host, struct outfile **ret, struct err *err)
{
	struct outfile *o = outfile_alloc(host->label, err);

	if (!o)
		return -err->code;
	o->host = host;
	o->seekable = true;
	if (host->part && outfile_part_annex(host, o, err)) {
		outfile_free(o);
		return -err->code;
	}
	*ret = o;
	return 0;
}

static int cut_to(const struct outfile *o, off_t size, struct err *err)
{
	if (!io->ftruncate(o->fd, size))
		return 0;
	err_sys(err, errno, "cannot cut the output to its size");
	return err_add_file(err, o->label);
}

int outfile_annex_drop(struct outfile *annex, struct err *err)
{
	struct outfile *o = annex->host;
	int r = annex->inside ? outfile_flush(o, err) : 0;

	annex->used = 0;
	return r || !annex->inside ? r : cut_to(o, (off_t)o->at, err);
}

/* Others (memory sticks, shares) may fill the hole with zeros. */
static bool has_holes(int fd)
{
	struct statfs fs;

	if (fstatfs(fd, &fs))
		return false;
	return fs.f_type == EXT4_SUPER_MAGIC || fs.f_type == XFS_SUPER_MAGIC || fs.f_type == F2FS_SUPER_MAGIC ||
	       fs.f_type == OVERLAYFS_SUPER_MAGIC;
}

/* Whether the file system takes blocks out of this file, tried on the file itself while it ends before `base`.
 * A limit on the size of files would be met far too early. */
static int can_collapse(const struct outfile *host, bool *ret, struct err *err)
{
	const off_t end = (off_t)(OUTFILE_ANNEX_AT + OUTFILE_BLOCK), block = OUTFILE_BLOCK;
	struct rlimit most;
	struct stat st;

	*ret = false;
	if (!host->seekable || !has_holes(host->fd) || getrlimit(RLIMIT_FSIZE, &most) || most.rlim_cur != RLIM_INFINITY)
		return 0;
	if (io->fstat(host->fd, &st) || st.st_blksize <= 0 || OUTFILE_BLOCK % st.st_blksize || io->ftruncate(host->fd, end))
		return 0;
	*ret = !fallocate(host->fd, FALLOC_FL_COLLAPSE_RANGE, end - 2 * block, block);
	return cut_to(host, st.st_size, err);
}

/* An annex gets its first bytes. */
static int annex_open(struct outfile *o, struct err *err)
{
	bool inside;
	int r = can_collapse(o->host, &inside, err);

	if (r)
		return r;
	if (inside) {
		o->inside = true;
		o->fd = o->host->fd;
		o->base = OUTFILE_ANNEX_AT;
		return 0;
	}
	r = outfile_nameless(o->host->dirfd, &o->fd, err);
	o->own_fd = !r;
	return r ? err_add_file(err, o->label) : 0;
}

/* Inside the kernel where the file systems can; 0 done, 1 not possible here (nothing was copied). */
static int copy_inside(struct outfile *o, struct outfile *from, uint64_t start, uint64_t n, struct err *err)
{
	off_t off = (off_t)(from->base + start), to = (off_t)o->at;
	uint64_t left = n;

	if (!o->seekable)
		return 1;
	direct_end(owner(from));
	direct_end(owner(o));
	while (left) {
		size_t part = left > (1u << 30) ? (1u << 30) : (size_t)left;
		ssize_t k = copy_file_range(from->fd, &off, o->fd, &to, part, 0);
		if (k < 0 && errno == EINTR)
			continue;
		if (k <= 0 && left == n && (k == 0 || (errno != ENOSPC && errno != EDQUOT)))
			return 1;
		if (k <= 0) {
			err_sys(err, k ? errno : EIO, "copying a temporary file failed");
			return err_add_file(err, o->label);
		}
		left -= (uint64_t)k;
		o->at += (uint64_t)k;
	}
	return 0;
}

/* Appends n bytes of a flushed file from `start` on. */
static int copy(struct outfile *o, struct outfile *from, uint64_t start, uint64_t n, struct err *err)
{
	int r = n ? outfile_flush(o, err) : 0;

	if (r || !n)
		return r;
	r = copy_inside(o, from, start, n, err);
	if (r <= 0)
		return r;
	while (n) {
		size_t k = n < OUTFILE_BUFFER ? (size_t)n : OUTFILE_BUFFER;

		r = io_read_at(from->fd, o->buf, k, from->base + start, o->label, err);
		if (!r)
			r = put(o, o->buf, k, err);
		if (r)
			return r;
		start += k;
		n -= k;
	}
	return 0;
}

/* How many records of the annex must be put before its first so that this one starts on a block boundary. */
static uint64_t records_before(uint64_t end, size_t record)
{
	uint64_t n = 0;

	while ((end + n * record) % OUTFILE_BLOCK)
		n++;
	return n;
}

/* Removes the hole between the end of the output, on a block boundary, and the annex; false: it cannot. */
static bool collapse(struct outfile *o, const struct outfile *annex)
{
	return annex->inside && o->at % OUTFILE_BLOCK == 0 && o->at < annex->base &&
	       !fallocate(o->fd, FALLOC_FL_COLLAPSE_RANGE, (off_t)o->at, (off_t)(annex->base - o->at));
}

static int join_annex(struct outfile *o, struct outfile *annex, size_t record, struct err *err)
{
	uint64_t total = outfile_size(annex);
	uint64_t tail = record && total > OUTFILE_BUFFER ? records_before(outfile_size(o), record) * record : 0;
	int r = outfile_flush(annex, err);

	if (!r)
		r = copy(o, annex, total - tail, tail, err);
	if (!r)
		r = outfile_flush(o, err);
	if (r)
		return r;
	total -= tail;
	if (collapse(o, annex))
		o->at += total;
	else
		r = copy(o, annex, 0, total, err);
	return r || !annex->inside ? r : cut_to(o, (off_t)o->at, err);
}

uint64_t outfile_padded(uint64_t size, const struct outfile *annex)
{
	return outfile_size(annex) <= OUTFILE_BUFFER ? size : (size + OUTFILE_BLOCK - 1) & ~(uint64_t)(OUTFILE_BLOCK - 1);
}

int outfile_pad(struct outfile *o, const struct outfile *annex, uint8_t byte, struct err *err)
{
	uint8_t fill[OUTFILE_BLOCK];

	memset(fill, byte, sizeof(fill));
	return outfile_write(o, fill, (size_t)(outfile_padded(outfile_size(o), annex) - outfile_size(o)), err);
}

int outfile_join(struct outfile *o, struct outfile *from, size_t record, struct err *err)
{
	int r;

	/* Found with any annex, however small, since only a large one would be torn, or never end. */
	if (from->host && record && (record % 2 == 0 || outfile_size(from) % record))
		return err_set(err, ERR_INTERNAL, "an annex of %llu bytes has not records of one odd size (%zu)",
			       (unsigned long long)outfile_size(from), record);
	if (from->fd < 0)
		return outfile_write(o, from->buf, from->used, err);
	if (from->host && o->seekable)
		return join_annex(o, from, record, err);
	r = outfile_flush(from, err);
	return r ? r : copy(o, from, 0, from->at, err);
}
