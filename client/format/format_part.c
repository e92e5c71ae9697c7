/*
 * An output that is kept while it is written: NAME.part, and NAME.part.faces for its annex.
 *
 * Every byte that gets to the file goes into a sum: a chain over chunks of SUM_CHUNK bytes, and the hash of the chunk
 * that is not full yet. The sum at a moment is what a later run finds in the state (format_keep.c); it reads the file
 * up to there, compares, cuts off what is behind, and goes on. What a writer overwrites at the end (a header) is not
 * in the sum. The lock on NAME.part is held as long as it is open: two fetches into one output do not meet.
 */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "err.h"
#include "format_output.h"
#include "io.h"

enum { SUM_CHUNK = 1 << 20, SUFFIX = FORMAT_PART_NAME - NAME_MAX };

struct format_part {
	XXH3_state_t *hash; /* of the chunk that is not full */
	uint64_t from;      /* offset in the file where the sum begins */
	uint64_t size, chain;
	bool on;                     /* the file goes on */
	struct format_sum annex_sum; /* then, of the annex */
};

static struct format_part *part_new(void)
{
	struct format_part *p = calloc(1, sizeof(*p));

	if (p)
		p->hash = XXH3_createState();
	if (!p || !p->hash) {
		free(p);
		return NULL;
	}
	XXH3_64bits_reset(p->hash);
	return p;
}

struct format_part *format_part_free(struct format_part *p)
{
	if (p)
		XXH3_freeState(p->hash);
	free(p);
	return NULL;
}

void format_part_add(struct format_part *p, const uint8_t *bytes, size_t n)
{
	while (n) {
		size_t left = SUM_CHUNK - (size_t)(p->size % SUM_CHUNK), k = n < left ? n : left;

		XXH3_64bits_update(p->hash, bytes, k);
		p->size += k;
		bytes += k;
		n -= k;
		if (p->size % SUM_CHUNK == 0) {
			uint64_t full = XXH3_64bits_digest(p->hash);

			p->chain = XXH3_64bits_withSeed(&full, sizeof(full), p->chain);
			XXH3_64bits_reset(p->hash);
		}
	}
}

static struct format_sum sum_of(const struct format_part *p)
{
	return (struct format_sum){p->from, p->size, p->chain, XXH3_64bits_digest(p->hash)};
}

struct format_sum format_part_sum(const struct format_output *o)
{
	return sum_of(o->part);
}

/* ---- names ---- */

static char *part_name(const struct format_output *o, const char *suffix, char buf[FORMAT_PART_NAME])
{
	snprintf(buf, FORMAT_PART_NAME, "%s.part%s", o->name, suffix);
	return buf;
}

bool format_part_can(const struct format_output *o)
{
	return o->dirfd >= 0 && o->seekable && strlen(o->name) + SUFFIX <= NAME_MAX;
}

const char *format_part_state_name(const struct format_output *o, char buf[FORMAT_PART_NAME])
{
	return part_name(o, ".state", buf);
}

/* ---- opening ---- */

static int part_open(const struct format_output *o, const char *suffix, bool on, int *ret_fd, struct err *err)
{
	char name[FORMAT_PART_NAME];
	struct stat st;
	int fd, r;

	r = io_open(o->dirfd, part_name(o, suffix, name), O_RDWR | O_NOFOLLOW | (on ? 0 : O_CREAT), 0666, &fd, err);
	if (r && on && err->sys == ENOENT) {
		*err = ERR_INIT;
		r = err_set(err, ERR_CORRUPT, "what an earlier fetch has kept is not there any more");
		err_add_hint(err, "fetch it without --resume: it is replaced then");
	}
	if (!r && (io->fstat(fd, &st) || !S_ISREG(st.st_mode))) {
		io_close(fd);
		r = err_set(err, ERR_IO, "it is not a regular file");
	}
	if (r) {
		err->file[0] = 0;
		return err_add_file(err, name);
	}
	*ret_fd = fd;
	return 0;
}

static int corrupt(const struct format_output *o, const char *suffix, const char *what, struct err *err)
{
	char name[FORMAT_PART_NAME];

	err_set(err, ERR_CORRUPT, "%s", what);
	err_add_file(err, part_name(o, suffix, name));
	return err_add_hint(err, "fetch it without --resume: it is replaced then");
}

/* Reads the file up to where it was kept, compares, cuts off the rest. */
static int part_verify(struct format_output *o, const struct format_output *named, const char *suffix,
		       const struct format_sum *want, struct err *err)
{
	uint64_t end = want->from + want->size;
	struct format_part *p = o->part;
	struct format_sum got;
	struct stat st;
	int r = 0;

	if (io->fstat(o->fd, &st) < 0 || end < want->from || (uint64_t)st.st_size < end)
		return corrupt(named, suffix, "it is shorter than what an earlier fetch has kept", err);
	p->from = want->from;
	while (!r && p->size < want->size) {
		size_t n = want->size - p->size < FORMAT_BUFFER ? (size_t)(want->size - p->size) : FORMAT_BUFFER;

		r = io_read_at(o->fd, o->buf, n, p->from + p->size, o->label, err);
		if (!r)
			format_part_add(p, o->buf, n);
	}
	if (r)
		return r;
	got = sum_of(p);
	if (got.chain != want->chain || got.part != want->part)
		return corrupt(named, suffix, "it is not what an earlier fetch has kept", err);
	if (io->ftruncate(o->fd, (off_t)end) < 0) {
		err_sys(err, errno, "it cannot be cut to what was kept");
		return err_add_file(err, o->label);
	}
	o->at = end;
	return 0;
}

/* The nameless or temporary file gives way. */
static void drop_own(struct format_output *o)
{
	if (o->temp)
		unlinkat(o->dirfd, o->temp, 0);
	free(o->temp);
	o->temp = NULL;
	if (o->own_fd)
		o->fd = io_close(o->fd);
	o->nameless = o->may_direct = false;
}

int format_part_begin(struct format_output *o, bool on, struct err *err)
{
	char name[FORMAT_PART_NAME];
	struct stat own, named;
	int r;

	drop_own(o);
	o->own_fd = false;
	r = part_open(o, "", on, &o->fd, err);
	if (r)
		return r;
	o->own_fd = true;
	if (flock(o->fd, LOCK_EX | LOCK_NB)) {
		err_set(err, ERR_BUSY, "another fetch writes it");
		return err_add_file(err, part_name(o, "", name));
	}
	/* One that has just ended may have given the file its name. */
	if (fstat(o->fd, &own) || fstatat(o->dirfd, part_name(o, "", name), &named, AT_SYMLINK_NOFOLLOW) ||
	    own.st_dev != named.st_dev || own.st_ino != named.st_ino) {
		err_set(err, ERR_BUSY, "another fetch has just written it");
		return err_add_file(err, part_name(o, "", name));
	}
	o->part = part_new();
	o->temp = o->part ? strdup(part_name(o, "", name)) : NULL;
	if (!o->temp)
		return err_set(err, ERR_NOMEM, "no memory for an output");
	o->part->on = on;
	if (on)
		return 0;
	/* The annex and the state first: they mean nothing without it. */
	format_part_clean(o);
	if (io->ftruncate(o->fd, 0) < 0) {
		err_sys(err, errno, "what an earlier fetch has kept cannot be replaced");
		return err_add_file(err, o->label);
	}
	return 0;
}

int format_part_go_on(struct format_output *o, const struct format_sum *sum, const struct format_sum *annex, struct err *err)
{
	o->part->annex_sum = *annex;
	return part_verify(o, o, "", sum, err);
}

int format_part_from_here(struct format_output *o, struct err *err)
{
	int r = o->part ? format_output_flush(o, err) : 0;

	if (r || !o->part)
		return r;
	o->part->from = o->at;
	o->part->size = o->part->chain = 0;
	XXH3_64bits_reset(o->part->hash);
	return 0;
}

int format_part_annex(struct format_output *host, struct format_output *o, struct err *err)
{
	int r = part_open(host, ".faces", host->part->on && host->part->annex_sum.size, &o->fd, err);

	if (r)
		return r;
	o->own_fd = true;
	o->part = part_new();
	if (!o->part)
		return err_set(err, ERR_NOMEM, "no memory for an output");
	host->annex = o;
	if (host->part->on)
		return part_verify(o, host, ".faces", &host->part->annex_sum, err);
	return 0;
}

int format_part_sync(struct format_output *o, struct err *err)
{
	int r = format_output_flush(o, err);

	if (!r)
		r = io_sync(o->fd, o->label, err);
	return r || !o->annex ? r : format_part_sync(o->annex, err);
}

void format_part_discard(const struct format_output *o)
{
	/* What is there of an earlier fetch is not ours to remove; what has its name needs nothing. */
	if (!o->part || o->part->on || !o->temp)
		return;
	unlinkat(o->dirfd, o->temp, 0);
	format_part_clean(o);
}

void format_part_clean(const struct format_output *o)
{
	char name[FORMAT_PART_NAME];

	unlinkat(o->dirfd, part_name(o, ".state", name), 0);
	unlinkat(o->dirfd, part_name(o, ".state.new", name), 0);
	unlinkat(o->dirfd, part_name(o, ".faces", name), 0);
}
