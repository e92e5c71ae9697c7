/*
 * An output that is kept while it is written: NAME.part, and NAME.part.faces for its annex.
 *
 * Every byte of the file is in a sum: a chain over chunks of SUM_CHUNK bytes, and the hash of the chunk that is not full yet.
 * A later run finds the sum in the state; it reads the file up to there, compares, cuts off the rest, and goes on. Bytes that
 * a writer patches at the end (a header) are not in the sum. NAME.part is locked as long as it is open, so two fetches never
 * write one output.
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
#include "outfile_priv.h"
#include "io.h"

enum { SUM_CHUNK = 1 << 20, SUFFIX = 25, PART_NAME = NAME_MAX + SUFFIX + 1 };
#define STATE_MOST (1ull << 32)

struct outfile_part {
	XXH3_state_t *hash; /* of the chunk that is not full */
	uint64_t from;      /* offset in the file where the sum begins */
	uint64_t size, chain;
	bool on;                      /* the file goes on */
	struct outfile_sum annex_sum; /* then, of the annex */
};

static struct outfile_part *part_new(void)
{
	struct outfile_part *p = calloc(1, sizeof(*p));

	if (p)
		p->hash = XXH3_createState();
	if (!p || !p->hash) {
		free(p);
		return NULL;
	}
	XXH3_64bits_reset(p->hash);
	return p;
}

struct outfile_part *outfile_part_free(struct outfile_part *p)
{
	if (p)
		XXH3_freeState(p->hash);
	free(p);
	return NULL;
}

void outfile_part_add(struct outfile_part *p, const uint8_t *bytes, size_t n)
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

static struct outfile_sum sum_of(const struct outfile_part *p)
{
	return (struct outfile_sum){p->from, p->size, p->chain, XXH3_64bits_digest(p->hash)};
}

uint64_t outfile_part_size(const struct outfile *o)
{
	return outfile_size(o) + (o->annex ? outfile_size(o->annex) : 0);
}

void outfile_part_sums(const struct outfile *o, struct outfile_sum *ret, struct outfile_sum *ret_annex)
{
	*ret = sum_of(o->part);
	*ret_annex = o->annex ? sum_of(o->annex->part) : (struct outfile_sum){0};
}

/* ---- names ---- */

static char *part_name(const struct outfile *o, const char *suffix, char buf[PART_NAME])
{
	snprintf(buf, PART_NAME, "%s.part%s", o->name, suffix);
	return buf;
}

bool outfile_part_can(const struct outfile *o)
{
	return o->dirfd >= 0 && o->seekable && strlen(o->name) + SUFFIX <= NAME_MAX;
}

/* ---- opening ---- */

static int part_open(const struct outfile *o, const char *suffix, bool on, int *ret_fd, struct err *err)
{
	char name[PART_NAME];
	struct stat st;
	int fd, r;

	r = io_open(o->dirfd, part_name(o, suffix, name), O_RDWR | O_NOFOLLOW | (on ? 0 : O_CREAT), 0666, &fd, err);
	if (r && on && err->sys == ENOENT) {
		*err = ERR_INIT;
		r = err_set(err, ERR_CORRUPT, "the part of an earlier fetch is gone");
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

static int corrupt(const struct outfile *o, const char *suffix, const char *what, struct err *err)
{
	char name[PART_NAME];

	err_set(err, ERR_CORRUPT, "%s", what);
	err_add_file(err, part_name(o, suffix, name));
	return err_add_hint(err, "fetch it without --resume: it is replaced then");
}

/* Reads the file up to where it was kept, compares, cuts off the rest. */
static int part_verify(struct outfile *o, const struct outfile *named, const char *suffix, const struct outfile_sum *want,
		       struct err *err)
{
	uint64_t end = want->from + want->size;
	struct outfile_part *p = o->part;
	struct outfile_sum got;
	struct stat st;
	int r = 0;

	if (io->fstat(o->fd, &st) < 0 || end < want->from || (uint64_t)st.st_size < end)
		return corrupt(named, suffix, "it is shorter than the part of an earlier fetch", err);
	p->from = want->from;
	while (!r && p->size < want->size) {
		size_t n = want->size - p->size < OUTFILE_BUFFER ? (size_t)(want->size - p->size) : OUTFILE_BUFFER;

		r = io_read_at(o->fd, o->buf, n, p->from + p->size, o->label, err);
		if (!r)
			outfile_part_add(p, o->buf, n);
	}
	if (r)
		return r;
	got = sum_of(p);
	if (got.chain != want->chain || got.part != want->part)
		return corrupt(named, suffix, "it is not the part of an earlier fetch", err);
	if (io->ftruncate(o->fd, (off_t)end) < 0) {
		err_sys(err, errno, "it cannot be cut to the kept part");
		return err_add_file(err, o->label);
	}
	o->at = end;
	return 0;
}

/* The nameless or temporary file gives way. */
static void drop_own(struct outfile *o)
{
	if (o->temp)
		unlinkat(o->dirfd, o->temp, 0);
	free(o->temp);
	o->temp = NULL;
	if (o->own_fd)
		o->fd = io_close(o->fd);
	o->nameless = o->may_direct = false;
}

int outfile_part_begin(struct outfile *o, bool on, struct err *err)
{
	char name[PART_NAME];
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
	outfile_part_clean(o);
	if (io->ftruncate(o->fd, 0) < 0) {
		err_sys(err, errno, "the part of an earlier fetch cannot be replaced");
		return err_add_file(err, o->label);
	}
	return 0;
}

int outfile_part_go_on(struct outfile *o, const struct outfile_sum *sum, const struct outfile_sum *annex, struct err *err)
{
	o->part->annex_sum = *annex;
	return part_verify(o, o, "", sum, err);
}

int outfile_part_from_here(struct outfile *o, struct err *err)
{
	int r = o->part ? outfile_flush(o, err) : 0;

	if (r || !o->part)
		return r;
	o->part->from = o->at;
	o->part->size = o->part->chain = 0;
	XXH3_64bits_reset(o->part->hash);
	return 0;
}

int outfile_part_annex(struct outfile *host, struct outfile *o, struct err *err)
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

int outfile_part_sync(struct outfile *o, struct err *err)
{
	int r = outfile_flush(o, err);

	if (!r)
		r = io_sync(o->fd, o->label, err);
	return r || !o->annex ? r : outfile_part_sync(o->annex, err);
}

void outfile_part_discard(const struct outfile *o)
{
	/* The files of an earlier fetch are not ours to remove; a published file needs nothing. */
	if (!o->part || o->part->on || !o->temp)
		return;
	unlinkat(o->dirfd, o->temp, 0);
	outfile_part_clean(o);
}

void outfile_part_clean(const struct outfile *o)
{
	char name[PART_NAME];

	unlinkat(o->dirfd, part_name(o, ".state", name), 0);
	unlinkat(o->dirfd, part_name(o, ".state.new", name), 0);
	unlinkat(o->dirfd, part_name(o, ".faces", name), 0);
}

/* ---- the state ---- */

void outfile_part_name_state(const struct outfile *o, struct err *err)
{
	char name[PART_NAME];

	err_add_file(err, part_name(o, ".state", name));
}

int outfile_part_damaged(const struct outfile *o, struct err *err)
{
	return corrupt(o, ".state", "the part of an earlier fetch is damaged, or of another version", err);
}

int outfile_part_load(const struct outfile *o, uint8_t **ret, size_t *ret_size, struct err *err)
{
	char name[PART_NAME];
	uint8_t *bytes = NULL;
	struct stat st;
	int fd, r = io_open(o->dirfd, part_name(o, ".state", name), O_RDONLY | O_NOFOLLOW, 0, &fd, err);

	if (r && err->sys == ENOENT) {
		*err = ERR_INIT;
		err_set(err, ERR_GONE, "nothing is kept of an earlier fetch");
		err_add_file(err, name);
		return err_add_hint(err, "fetch it without --resume");
	}
	if (r)
		return r;
	if (io->fstat(fd, &st) < 0)
		r = err_sys(err, errno, "cannot examine %s", name);
	else if (!S_ISREG(st.st_mode) || (uint64_t)st.st_size > STATE_MOST)
		r = outfile_part_damaged(o, err);
	else if (!(bytes = malloc((size_t)st.st_size + 1)))
		r = err_set(err, ERR_NOMEM, "no memory for %s", name);
	else
		r = io_read_at(fd, bytes, (size_t)st.st_size, 0, name, err);
	io_close(fd);
	if (r) {
		free(bytes);
		return r;
	}
	*ret = bytes;
	*ret_size = (size_t)st.st_size;
	return 0;
}

int outfile_part_store(const struct outfile *o, const uint8_t *bytes, size_t size, struct err *err)
{
	char name[PART_NAME], temp[PART_NAME];
	int fd, r;

	part_name(o, ".state", name);
	part_name(o, ".state.new", temp);
	unlinkat(o->dirfd, temp, 0);
	r = io_open(o->dirfd, temp, O_WRONLY | O_CREAT | O_EXCL, 0666, &fd, err);
	if (r)
		return r;
	r = io_write_at(fd, bytes, size, 0, name, err);
	if (r)
		unlinkat(o->dirfd, temp, 0);
	else
		r = io_publish(o->dirfd, fd, temp, name, err);
	io_close(fd);
	return r;
}
