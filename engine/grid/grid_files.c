/*
 * The descriptors of the segments of a grid (grid_priv.h). Up to GRID_FILES_OPEN segments are open as long as the grid. Of more,
 * and of those that are opened late, so many are open at a time, and the file that nobody reads is closed for another, in turn.
 * Opening takes microseconds, and a read has at least a page.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>

#include "err.h"
#include "grid_file.h"
#include "grid_priv.h"
#include "io.h"
#include "lock.h"

enum { NONE = UINT32_MAX };

struct grid_files {
	struct lock lock;
	int dirfd;
	int (*open)(void *ctx, const char *file, uint64_t bytes, int *ret_fd, struct err *err); /* NULL: openat */
	void *ctx;
	bool pooled;
	size_t nsegments;
	struct grid_segment *segments;
	uint32_t hand; /* of the slots, where the search for a free one begins */
	struct slot {
		int fd;
		uint32_t segment, users;
	} slot[GRID_FILES_OPEN];
	uint32_t at[]; /* the slot of each segment; NONE: not open. Only if `pooled` */
};

size_t grid_files_bytes(size_t segments)
{
	return sizeof(struct grid_files) + segments * sizeof(uint32_t);
}

struct grid_files *grid_files_new(int dirfd, const struct grid_use *use, bool all_open, struct grid_segment *segments, size_t n,
				  struct err *err)
{
	struct grid_files *f = calloc(1, grid_files_bytes(n));

	for (size_t i = 0; i < n; i++)
		segments[i].fd = -1;
	if (!f) {
		err_set(err, ERR_NOMEM, "no memory for the files of %zu segments", n);
		return NULL;
	}
	lock_init(&f->lock, LOCK_GRID_FILES);
	f->nsegments = n;
	f->segments = segments;
	f->dirfd = -1;
	f->open = use->open;
	f->ctx = use->open_ctx;
	f->pooled = !all_open || n > GRID_FILES_OPEN;
	for (size_t i = 0; i < GRID_FILES_OPEN; i++)
		f->slot[i] = (struct slot){.fd = -1, .segment = NONE};
	if (!f->pooled)
		return f;
	for (size_t i = 0; i < n; i++)
		f->at[i] = NONE;
	f->dirfd = io->openat(dirfd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC, 0);
	if (f->dirfd >= 0)
		return f;
	err_sys(err, errno, "cannot open the folder of a dataset");
	return grid_files_free(f);
}

struct grid_files *grid_files_free(struct grid_files *f)
{
	if (!f)
		return NULL;
	for (size_t i = 0; i < f->nsegments; i++)
		f->segments[i].fd = io_close(f->segments[i].fd);
	for (size_t i = 0; i < GRID_FILES_OPEN; i++)
		io_close(f->slot[i].fd);
	io_close(f->dirfd);
	lock_done(&f->lock);
	free(f);
	return NULL;
}

/* A slot that nobody uses, with its file closed; NULL: there is none. */
static struct slot *free_slot(struct grid_files *f)
{
	for (unsigned i = 0; i < GRID_FILES_OPEN; i++) {
		struct slot *s = &f->slot[f->hand];

		f->hand = (f->hand + 1) % GRID_FILES_OPEN;
		if (s->users)
			continue;
		if (s->segment != NONE)
			f->at[s->segment] = NONE;
		*s = (struct slot){.fd = io_close(s->fd), .segment = NONE};
		return s;
	}
	return NULL;
}

/* Puts the file into a slot. False: all of them are used. */
static bool put(struct grid_files *f, uint32_t segment, int fd, uint32_t users)
{
	struct slot *s = free_slot(f);

	if (!s)
		return false;
	*s = (struct slot){.fd = fd, .segment = segment, .users = users};
	f->at[segment] = (uint32_t)(s - f->slot);
	return true;
}

int grid_files_open(const struct grid_files *f, int dirfd, const struct grid_segment *p, int *ret_fd, struct err *err)
{
	return f->open ? f->open(f->ctx, p->name, p->bytes, ret_fd, err) :
			 grid_file_open(dirfd, p->name, "the segment", ret_fd, err);
}

void grid_files_add(struct grid_files *f, uint32_t segment)
{
	struct grid_segment *p = &f->segments[segment];

	if (!f->pooled)
		return;
	lock_take(&f->lock);
	if (!put(f, segment, p->fd, 0))
		io_close(p->fd);
	p->fd = -1;
	lock_give(&f->lock);
}

/* The open file of the segment, -1: it is not open. */
static int use_open(struct grid_files *f, uint32_t segment)
{
	struct slot *s = f->at[segment] == NONE ? NULL : &f->slot[f->at[segment]];

	if (!s)
		return -1;
	s->users++;
	return s->fd;
}

int grid_files_take(struct grid_files *f, uint32_t segment, struct grid_segment *ret, struct err *err)
{
	int fd, rc;

	*ret = f->segments[segment];
	if (!f->pooled)
		return 0;
	lock_take(&f->lock);
	ret->fd = use_open(f, segment);
	lock_give(&f->lock);
	if (ret->fd >= 0)
		return 0;
	rc = grid_files_open(f, f->dirfd, ret, &ret->fd, err);
	if (rc)
		return rc;
	lock_take(&f->lock);
	fd = use_open(f, segment); /* another reader may have opened it meanwhile */
	if (fd < 0)
		put(f, segment, ret->fd, 1);
	lock_give(&f->lock);
	if (fd < 0)
		return 0;
	io_close(ret->fd);
	ret->fd = fd;
	return 0;
}

void grid_files_give(struct grid_files *f, uint32_t segment, const struct grid_segment *taken)
{
	if (!f->pooled)
		return;
	lock_take(&f->lock);
	if (f->at[segment] != NONE && f->slot[f->at[segment]].fd == taken->fd)
		f->slot[f->at[segment]].users--;
	else
		io_close(taken->fd); /* there was no slot for it */
	lock_give(&f->lock);
}
