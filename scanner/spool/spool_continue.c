/*
 * Continuing a spool that a kill or a power cut has left without its END. All of it is read, for the totals; only what
 * is behind the last complete record is cut off. Damage in the middle stays, and readers report it.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/file.h>

#include "clock.h"
#include "io.h"
#include "spool_priv.h"

/* A power cut while the spool was created may have left only the first head. */
static int mend_head(const struct spool_reader *r, struct spool_writer *w, struct err *err)
{
	uint8_t *bytes;
	size_t size;
	int rc = spool_head_encode(spool_reader_head(r), &bytes, &size, err);

	if (rc)
		return rc;
	if (w->offset < 2 * size) {
		rc = io_write_at(w->fd, bytes, size, size, w->path, err);
		w->offset = 2 * size;
	}
	free(bytes);
	return rc;
}

/* Counts the existing records; finds the end of the last complete record. */
static int read_all(struct spool_reader *r, struct spool_writer *w, struct err *err)
{
	struct spool_record record;
	struct spool_tail tail;
	uint64_t skipped;
	int rc;

	while ((rc = spool_next(r, &record, err))) {
		if (rc == -ERR_INPUT) {
			*err = ERR_INIT;
			rc = spool_skip(r, &skipped, err);
		} else if (rc > 0) {
			rc = spool_writer_count(w, &record, err);
		}
		if (rc < 0)
			return rc;
	}
	spool_tail(r, &tail);
	if (tail.ended) {
		err_set(err, ERR_USAGE, "this spool has its end; nothing can follow");
		return err_add_hint(err, "record into a new one");
	}
	w->offset = tail.whole;
	if (tail.torn && io->ftruncate(w->fd, (off_t)tail.whole))
		return err_sys(err, errno, "cannot cut off %llu bytes behind the last whole record",
			       (unsigned long long)tail.torn);
	return mend_head(r, w, err);
}

/* Opens a reader of the file, and reads its head. */
static int open_reader(const char *path, struct spool_reader **ret, struct err *err)
{
	int fd, r = io_open(AT_FDCWD, path, O_RDONLY, 0, &fd, err);

	return r ? r : spool_open(fd, path, ret, err);
}

static int append_continued(struct spool_writer *w, struct err *err)
{
	char boot[40];
	int r;

	w->dirty = true; /* existing records may not be durable */
	w->written = w->totals.bytes;
	spool_boot_id(boot);
	r = spool_event(w, (int64_t)clock_mono_ns(), err, "continued %s", *boot ? boot : "-");
	if (!r)
		r = spool_clock(w, err);
	return r ? r : spool_sync(w, err);
}

int spool_continue(const char *path, struct spool_head *ret_head, struct spool_writer **ret, struct err *err)
{
	struct spool_writer *w = NULL;
	struct spool_reader *reader = NULL;
	int fd, r;

	r = io_open(AT_FDCWD, path, O_RDWR | O_NOFOLLOW, 0, &fd, err);
	if (r)
		return r;
	if (io->flock(fd, LOCK_EX | LOCK_NB)) {
		if (errno == EWOULDBLOCK)
			err_set(err, ERR_BUSY, "another program is writing this spool");
		else
			err_sys(err, errno, "cannot lock");
		io_close(fd);
		return err_add_file(err, path);
	}
	r = open_reader(path, &reader, err);
	if (r) {
		io_close(fd);
		return r;
	}
	r = spool_writer_new(fd, path, spool_reader_head(reader)->id, 0, &w, err);
	if (!r)
		r = read_all(reader, w, err);
	if (!r)
		r = append_continued(w, err);
	if (!r)
		r = spool_head_copy(spool_reader_head(reader), ret_head, err);
	spool_reader_free(reader);
	if (r) {
		spool_writer_free(w);
		return err_add_file(err, path);
	}
	*ret = w;
	return 0;
}
