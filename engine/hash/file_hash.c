/*
 * The hash of an input, by which a dataset recognises it.
 *
 * The model: the hash covers the whole file, so any tool can make it. What is read for points is hashed on the way; the rest is
 * read only for the hash, with its own progress reports. So a file may be only a little longer than its header accounts for: a
 * sparse file of terabytes would be read for hours for its hash alone. One-step meshes make no hash, and accept any file.
 */
#include "file_hash.h"

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "input.h"
#include "io.h"
#include "parse.h"

enum { HASH_BUFFER = 64 << 10, REPORTED_LEAST = 64 << 20 /* bytes that take long enough for progress */ };

/* Hashes up to `end`, or to the end of the file. */
static int hash_to(struct file_hashing *h, uint64_t end, struct err *err)
{
	uint8_t *buf = malloc(HASH_BUFFER);
	size_t n = 1;
	int r = h->sum && buf ? 0 : err_set(err, ERR_NOMEM, "no memory to read a file");
	bool reported = end > h->at && end - h->at >= REPORTED_LEAST;

	if (reported)
		atomic_store(h->watch.end, end);
	while (!r && h->at < end && n) {
		n = end - h->at < HASH_BUFFER ? (size_t)(end - h->at) : HASH_BUFFER;
		r = io_read_some(h->fd, buf, n, h->at, h->name, &n, err);
		if (r)
			break;
		digest_stream_add(h->sum, buf, n);
		h->at += n;
		if (reported)
			atomic_store(h->watch.done, h->at);
		if (atomic_load(h->watch.cancel))
			r = err_set(err, ERR_CANCELLED, "the push was ended");
	}
	if (reported) {
		atomic_store(h->watch.end, 0);
		atomic_store(h->watch.done, 0);
	}
	free(buf);
	return r;
}

void file_hash_begin(struct file_hashing *h, const struct file_hash_watch *watch, int fd, const char *name)
{
	*h = (struct file_hashing){.watch = *watch, .sum = digest_stream_new(), .fd = fd, .name = name};
}

void file_hash_seen(void *ctx, uint64_t at, const void *bytes, size_t n)
{
	struct file_hashing *h = ctx;
	struct err ignored = ERR_INIT; /* an error comes again, and is reported, when the rest is read */

	if (!h->sum || h->missed)
		return;
	if (at > h->at && hash_to(h, at, &ignored))
		h->missed = true;
	if (at != h->at) {
		h->missed = true;
		return;
	}
	digest_stream_add(h->sum, bytes, n);
	h->at += n;
}

int file_hash_end(struct file_hashing *h, uint64_t size, struct digest *ret, struct err *err)
{
	const struct file_hash_watch watch = h->watch;
	int r;

	if (h->missed) {
		file_hash_free(h);
		file_hash_begin(h, &watch, h->fd, h->name);
	}
	r = hash_to(h, size, err);
	if (!r)
		*ret = digest_stream_end(h->sum);
	file_hash_free(h);
	return r;
}

void file_hash_free(struct file_hashing *h)
{
	h->sum = digest_stream_free(h->sum);
}

int file_hash(const struct file_hash_watch *watch, int fd, uint64_t size, const char *name, struct digest *ret, struct err *err)
{
	struct file_hashing h;

	file_hash_begin(&h, watch, fd, name);
	return file_hash_end(&h, size, ret, err);
}

int file_hash_bounded(const struct input_info *info, uint64_t size, const char *name, struct err *err)
{
	uint64_t more = info->accounted && size > info->accounted ? size - info->accounted : 0;
	char rest[32], most[32];

	if (more <= FILE_TRAILING_MOST)
		return 0;
	err_set(err, ERR_INPUT, "%s behind its records belong to nothing; a file may have %s of that",
		parse_size_text(more, rest), parse_size_text(FILE_TRAILING_MOST, most));
	err_add_place(err, info->accounted, "end of the records");
	err_add_hint(err, "if they are of no use: truncate -s %llu FILE", (unsigned long long)info->accounted);
	return err_add_file(err, name);
}

int file_hash_look(int fd, uint64_t size, const char *name, const struct input_options *options, struct err *err)
{
	struct input *in = NULL;
	uint8_t head[4] = {0};
	size_t n;
	int r;

	if (size <= FILE_TRAILING_MOST)
		return 0;
	r = io_read_some(fd, head, sizeof head, 0, name, &n, err);
	if (r || memcmp(head, "LASF", sizeof head)) /* a text is all records, and would be read whole for this check */
		return r;
	r = input_open(fd, name, options, &in, err);
	if (!r)
		r = file_hash_bounded(input_info(in), size, name, err);
	input_close(in);
	return r;
}
