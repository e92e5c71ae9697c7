/*
 * Writing a spool. A record is one pwrite at the end of the file (two for a large one), so a kill leaves complete
 * records and perhaps the beginning of one. If writing fails, the incomplete record is cut off, the writer accepts
 * nothing more, and returns the error each time; the file stays valid.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "clock.h"
#include "cursor.h"
#include "io.h"
#include "io_place.h"
#include "spool_priv.h"

enum { ONE_WRITE = 256 << 10 }; /* payloads up to this size are copied behind their head */

static int no_memory(struct err *err)
{
	return err_set(err, ERR_NOMEM, "no memory to write a spool");
}

int spool_writer_new(int fd, const char *path, const uint8_t id[16], uint64_t offset, struct spool_writer **ret, struct err *err)
{
	struct spool_writer *w = calloc(1, sizeof(*w));
	int r;

	if (!w) {
		io_close(fd);
		return no_memory(err);
	}
	w->fd = fd;
	w->seed = spool_seed(id);
	w->offset = offset;
	r = spool_flush_init(w, err);
	if (r) {
		io_close(fd);
		free(w);
		return r;
	}
	w->path = strdup(path);
	w->buf = malloc(SPOOL_RECORD_HEAD + ONE_WRITE);
	sha256_init(&w->sha);
	if (!w->path || !w->buf) {
		spool_writer_free(w);
		return no_memory(err);
	}
	*ret = w;
	return 0;
}

struct spool_writer *spool_writer_free(struct spool_writer *w)
{
	if (!w)
		return NULL;
	spool_flush_stop(w);
	pthread_mutex_destroy(&w->lock);
	pthread_mutex_destroy(&w->syncing);
	pthread_cond_destroy(&w->changed);
	io_close(w->fd);
	free(w->buf);
	free(w->path);
	free(w);
	return NULL;
}

/* Fsyncs the folder of path, which makes a new name in it durable. */
static int sync_folder(const char *path, struct err *err)
{
	const char *slash = strrchr(path, '/');
	char *folder = slash == path ? strdup("/") : slash ? strndup(path, (size_t)(slash - path)) : strdup(".");
	int fd = -1, r;

	if (!folder)
		return no_memory(err);
	r = io_open(AT_FDCWD, folder, O_RDONLY | O_DIRECTORY, 0, &fd, err);
	if (!r)
		r = io_sync(fd, folder, err);
	io_close(fd);
	free(folder);
	return r;
}

/* Creates a file of this name that must not exist. */
static int create_file(const char *path, int *ret_fd, struct err *err)
{
	struct io_place at;
	int r = io_place_find(path, false, &at, err);

	if (r)
		return r;
	r = io_open(at.dirfd, at.name, O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW, 0666, ret_fd, err);
	io_place_done(&at);
	if (r && err->sys == EEXIST) {
		*err = ERR_INIT;
		err_set(err, ERR_USAGE, "there is a file of this name, and a spool is never written over another");
		err_add_hint(err, "give another name; --continue goes on in a spool that has no end");
		return err_add_file(err, path);
	}
	if (r)
		return r;
	if (io->flock(*ret_fd, LOCK_EX | LOCK_NB)) {
		err_sys(err, errno, "cannot lock");
		*ret_fd = io_close(*ret_fd);
		return err_add_file(err, path);
	}
	return 0;
}

int spool_create(const char *path, struct spool_head *head, struct spool_writer **ret, struct err *err)
{
	struct err ignored = ERR_INIT;
	uint8_t *bytes = NULL;
	size_t size = 0;
	int fd, r;

	spool_head_fill(head);
	r = spool_head_encode(head, &bytes, &size, err);
	if (r)
		return err_add_file(err, path);
	r = create_file(path, &fd, err);
	if (r) {
		free(bytes);
		return r;
	}
	r = io_write_at(fd, bytes, size, 0, path, err);
	if (!r)
		r = io_write_at(fd, bytes, size, size, path, err);
	free(bytes);
	if (!r)
		r = io_sync(fd, path, err);
	if (!r)
		r = sync_folder(path, err);
	if (r)
		io_close(fd);
	else
		r = spool_writer_new(fd, path, head->id, 2 * size, ret, err);
	if (r)
		io_remove(AT_FDCWD, path, &ignored);
	return r;
}

/* Keeps the first failure. */
static int fail(struct spool_writer *w, struct err *err)
{
	w->failed = true;
	w->why = *err;
	return -(int)err->code;
}

static int count(struct spool_writer *w, enum spool_kind kind, const void *at, size_t size, struct err *err)
{
	w->totals.records++;
	if (kind == SPOOL_EVENT)
		w->totals.events++;
	if (kind != SPOOL_DATA)
		return 0;
	w->totals.transfers++;
	w->totals.bytes += size;
	sha256_update(&w->sha, size, at);
	return 0;
}

int spool_writer_count(struct spool_writer *w, const struct spool_record *r, struct err *err)
{
	int rc = count(w, r->kind, r->at, r->size, err);

	w->totals.records = r->seq + 1; /* even if records before it are lost */
	return rc;
}

static int write_record(struct spool_writer *w, const uint8_t head[SPOOL_RECORD_HEAD], const void *at, size_t size,
			struct err *err)
{
	int r;

	if (size <= ONE_WRITE) {
		memcpy(w->buf, head, SPOOL_RECORD_HEAD);
		if (size)
			memcpy(w->buf + SPOOL_RECORD_HEAD, at, size);
		r = io_write_at(w->fd, w->buf, SPOOL_RECORD_HEAD + size, w->offset, w->path, err);
	} else {
		r = io_write_at(w->fd, head, SPOOL_RECORD_HEAD, w->offset, w->path, err);
		if (!r)
			r = io_write_at(w->fd, at, size, w->offset + SPOOL_RECORD_HEAD, w->path, err);
	}
	if (r && io->ftruncate(w->fd, (off_t)w->offset))
		return r; /* then an incomplete record stays at the end, which readers can handle */
	return r;
}

int spool_append(struct spool_writer *w, enum spool_kind kind, unsigned flags, int64_t time_ns, const void *at, size_t size,
		 struct err *err)
{
	struct spool_mark m = {.kind = kind, .flags = flags, .seq = w->totals.records, .time_ns = time_ns};
	uint8_t head[SPOOL_RECORD_HEAD];

	if (w->failed) {
		*err = w->why;
		return -(int)err->code;
	}
	if (w->ended || size > SPOOL_PAYLOAD_MAX || flags > 0xff)
		return err_set(err, ERR_INTERNAL, "no record for a spool: %zu bytes%s", size, w->ended ? " behind its end" : "");
	m.size = (uint32_t)size;
	m.check = spool_check(w->seed, at, size);
	spool_mark_encode(w->seed, &m, head);
	if (write_record(w, head, at, size, err))
		return fail(w, err);
	w->offset += SPOOL_RECORD_HEAD + size;
	if (count(w, kind, at, size, err) || spool_flush_appended(w, kind == SPOOL_DATA ? size : 0, err))
		return fail(w, err);
	return 0;
}

int spool_event(struct spool_writer *w, int64_t time_ns, struct err *err, const char *fmt, ...)
{
	char text[512];
	va_list ap;
	int n;

	va_start(ap, fmt);
	n = vsnprintf(text, sizeof(text), fmt, ap);
	va_end(ap);
	if (n < 0)
		return err_set(err, ERR_INTERNAL, "no text for an event");
	for (char *p = text; *p; p++)
		if ((unsigned char)*p < 0x20 || *p == 0x7f)
			*p = ' ';
	return spool_append(w, SPOOL_EVENT, 0, time_ns, text, strlen(text), err);
}

int spool_clock(struct spool_writer *w, struct err *err)
{
	uint8_t utc[8];
	struct packer p = packer_of(utc, sizeof(utc));

	packer_u64(&p, (uint64_t)clock_real_us() * 1000);
	return spool_append(w, SPOOL_CLOCK, 0, (int64_t)clock_mono_ns(), utc, sizeof(utc), err);
}

void spool_totals(struct spool_writer *w, struct spool_totals *ret)
{
	struct sha256_ctx sha = w->sha; /* goes on */

	pthread_mutex_lock(&w->lock);
	w->totals.durable = w->durable;
	pthread_mutex_unlock(&w->lock);
	*ret = w->totals;
	sha256_digest(&sha, sizeof(ret->sha256), ret->sha256);
}

int spool_end(struct spool_writer *w, struct err *err)
{
	struct spool_totals t;
	uint8_t at[SPOOL_END_SIZE];
	struct packer p = packer_of(at, sizeof(at));
	int r;

	spool_totals(w, &t);
	packer_u64(&p, t.records);
	packer_u64(&p, t.transfers);
	packer_u64(&p, t.bytes);
	packer_u64(&p, t.events);
	packer_bytes(&p, t.sha256, 32);
	r = spool_append(w, SPOOL_END, 0, (int64_t)clock_mono_ns(), at, sizeof(at), err);
	if (r)
		return r;
	w->ended = true;
	return spool_sync(w, err);
}
