/*
 * Places that a report names: where lines cross, and where vertices at one position have different heights.
 *
 * Model: records of 24 bytes, each with a checksum of its own, so that any of them can be read alone: x, y, lower and upper
 * height (i32), kind (u32), and the low half of the check of these with the place of the record as seed.
 */
#include "places.h"

#include <fcntl.h>
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "grid_block.h"
#include "io.h"

struct record {
	int32_t x, y, lower, upper;
	uint32_t event, check;
};
_Static_assert(sizeof(struct record) == GRID_PLACE_BYTES, "the record of format.md");

static uint32_t check_of(const struct record *r, uint64_t number)
{
	return (uint32_t)grid_check(r, offsetof(struct record, check), number * sizeof *r);
}

int places_begin(struct places *w, int dirfd, const char *name, struct err *err)
{
	*w = (struct places){.dirfd = dirfd, .fd = -1};
	snprintf(w->name, sizeof w->name, "%s", name);
	snprintf(w->temp, sizeof w->temp, "%s.tmp", name);
	return 0;
}

static int flush(struct places *w, struct err *err)
{
	size_t bytes = w->n * GRID_PLACE_BYTES;
	int r = 0;

	if (w->fd < 0)
		r = io_open(w->dirfd, w->temp, O_WRONLY | O_CREAT | O_TRUNC, 0640, &w->fd, err);
	if (!r)
		r = io_write_at(w->fd, w->buffer, bytes, w->written * GRID_PLACE_BYTES, w->name, err);
	w->written += w->n;
	w->n = 0;
	return r;
}

int places_add(struct places *w, enum breakline_event event, int32_t x, int32_t y, int32_t lower, int32_t upper, struct err *err)
{
	struct record r = {x, y, lower, upper, (uint32_t)event, 0};

	r.check = check_of(&r, w->written + w->n);
	memcpy(w->buffer + w->n++ * sizeof r, &r, sizeof r);
	return w->n == PLACES_BUFFERED ? flush(w, err) : 0;
}

int places_finish(struct places *w, struct err *err)
{
	int r = w->n ? flush(w, err) : 0;

	if (!r && w->fd >= 0)
		r = io_publish(w->dirfd, w->fd, w->temp, w->name, err);
	w->published = !r && w->fd >= 0;
	return r;
}

void places_end(struct places *w)
{
	if (w->fd >= 0 && !w->published)
		io->unlinkat(w->dirfd, w->temp, 0);
	w->fd = io_close(w->fd);
}

static int damaged(const char *name, uint64_t number, struct err *err)
{
	err_set(err, ERR_CORRUPT, "the places of lines are damaged");
	err_add_place(err, number * GRID_PLACE_BYTES, NULL);
	err_add_file(err, name);
	return err_add_hint(err, "check the disk, and restore the file, or push the lines again");
}

int places_read(int dirfd, const char *name, uint64_t count, uint64_t first, size_t most, struct breaklines_place *ret,
		size_t *ret_n, struct err *err)
{
	size_t n = first < count ? (count - first < most ? (size_t)(count - first) : most) : 0;
	int fd = -1, r = n ? io_open(dirfd, name, O_RDONLY, 0, &fd, err) : 0;

	*ret_n = 0;
	for (size_t i = 0; !r && i < n; i++) {
		struct record rec;

		r = io_read_at(fd, &rec, sizeof rec, (first + i) * sizeof rec, name, err);
		if (r)
			break;
		if (rec.check != check_of(&rec, first + i) || rec.event >= BREAKLINE_EVENTS)
			r = damaged(name, first + i, err);
		else
			ret[(*ret_n)++] = (struct breaklines_place){rec.event, rec.x, rec.y, rec.lower, rec.upper};
	}
	io_close(fd);
	return r;
}
