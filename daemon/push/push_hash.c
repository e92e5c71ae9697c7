/*
 * The sum of an input's bytes, by which a dataset knows it again.
 *
 * The model: it is that of the whole file, whatever the file's records are, as any tool would make it. What is read for points is
 * shown to it; the rest is read for it alone, and while that takes long it is what the push tells of its progress. So a file
 * may be only so much larger than what its header tells of: a sparse one of terabytes would be read for hours for
 * nothing but its sum. One-step meshes make no sum, and take any file.
 */
#include <stdlib.h>
#include <string.h>

#include "io.h"
#include "parse.h"
#include "push_priv.h"

enum { HASH_BUFFER = 64 << 10, TOLD = 64 << 20 /* what takes a while */ };

/* From where the sum has come to, to `end` or the end of the file. */
static int hash_to(struct push_hashing *h, uint64_t end, struct err *err)
{
	uint8_t *buf = malloc(HASH_BUFFER);
	size_t n = 1;
	int r = h->sum && buf ? 0 : err_set(err, ERR_NOMEM, "no memory to read a file");
	bool told = end > h->at && end - h->at >= TOLD;

	if (told)
		atomic_store(&h->push->hash_end, end);
	while (!r && h->at < end && n) {
		n = end - h->at < HASH_BUFFER ? (size_t)(end - h->at) : HASH_BUFFER;
		r = io_read_some(h->fd, buf, n, h->at, h->name, &n, err);
		if (r)
			break;
		digest_stream_add(h->sum, buf, n);
		h->at += n;
		if (told)
			atomic_store(&h->push->hashed, h->at);
		if (atomic_load(&h->push->cancel))
			r = err_set(err, ERR_CANCELLED, "the push was ended");
	}
	if (told) {
		atomic_store(&h->push->hash_end, 0);
		atomic_store(&h->push->hashed, 0);
	}
	free(buf);
	return r;
}

void push_hash_begin(struct push_hashing *h, struct push *p, int fd, const char *name)
{
	*h = (struct push_hashing){.push = p, .sum = digest_stream_new(), .fd = fd, .name = name};
}

void push_hash_seen(void *ctx, uint64_t at, const void *bytes, size_t n)
{
	struct push_hashing *h = ctx;
	struct err ignored = ERR_INIT; /* what cannot be read is found, and told, when the rest is */

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

int push_hash_end(struct push_hashing *h, uint64_t size, struct digest *ret, struct err *err)
{
	int r;

	if (h->missed) {
		push_hash_free(h);
		push_hash_begin(h, h->push, h->fd, h->name);
	}
	r = hash_to(h, size, err);
	if (!r)
		*ret = digest_stream_end(h->sum);
	push_hash_free(h);
	return r;
}

void push_hash_free(struct push_hashing *h)
{
	h->sum = digest_stream_free(h->sum);
}

int push_hash(struct push *p, int fd, uint64_t size, const char *name, struct digest *ret, struct err *err)
{
	struct push_hashing h;

	push_hash_begin(&h, p, fd, name);
	return push_hash_end(&h, size, ret, err);
}

int push_hash_bounded(const struct input_info *info, uint64_t size, const char *name, struct err *err)
{
	uint64_t more = info->accounted && size > info->accounted ? size - info->accounted : 0;
	char rest[32], most[32];

	if (more <= PUSH_TRAILING_MOST)
		return 0;
	err_set(err, ERR_INPUT, "%s behind its records belong to nothing; a file may have %s of that",
		parse_size_text(more, rest), parse_size_text(PUSH_TRAILING_MOST, most));
	err_add_place(err, info->accounted, "end of the records");
	err_add_hint(err, "if they are of no use: truncate -s %llu FILE", (unsigned long long)info->accounted);
	return err_add_file(err, name);
}

int push_hash_look(struct push_ask *a, const struct input_options *options, struct err *err)
{
	struct input *in = NULL;
	uint8_t head[4] = {0};
	size_t n;
	int r;

	if (a->id.size <= PUSH_TRAILING_MOST)
		return 0;
	r = io_read_some(a->fd, head, sizeof head, 0, a->name, &n, err);
	if (r || memcmp(head, "LASF", sizeof head)) /* text is all records, and would be read whole for this */
		return r;
	r = input_open(a->fd, a->name, options, &in, err);
	if (!r)
		r = push_hash_bounded(input_info(in), a->id.size, a->name, err);
	input_close(in);
	return r;
}
