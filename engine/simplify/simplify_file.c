/*
 * Files of a simplification in progress. They appear by rename when they are complete. Only the report is fsynced: what a
 * crash of the machine tears is found by its checksum; acutd then empties the folder and begins again. They stay on one machine,
 * so numbers have its byte order.
 *
 * An array has a head, written last, and its records.
 */
#include "simplify_file.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "err.h"
#include "io.h"

struct head {
	char magic[8];
	uint64_t each, n, info[SIMPLIFY_INFO];
	struct digest sum;  /* of the records */
	struct digest self; /* of the head before it */
};

static const char MAGIC[8] = "acutsim1";

enum { TEXT_MAX = 4096 };

/* ---- writing ---- */

int simplify_out_begin(struct simplify_out *o, int dirfd, const char *name, size_t each, struct err *err)
{
	const struct head none = {.n = 0};
	int r;

	o->each = each;
	o->n = 0;
	o->file = GRID_FILE_INIT;
	o->hash = digest_stream_new();
	if (!o->hash)
		return err_set(err, ERR_NOMEM, "no memory to write %s", name);
	r = grid_file_create(&o->file, dirfd, name, o->buf, sizeof o->buf, err);
	if (!r)
		r = grid_file_append(&o->file, &none, sizeof none, err);
	if (r)
		simplify_out_abort(o);
	return r;
}

int simplify_out_add(struct simplify_out *o, const void *records, size_t n, struct err *err)
{
	o->n += n;
	digest_stream_add(o->hash, records, n * o->each);
	return grid_file_append(&o->file, records, n * o->each, err);
}

int simplify_out_end(struct simplify_out *o, const uint64_t info[SIMPLIFY_INFO], struct err *err)
{
	struct head h = {.each = o->each, .n = o->n, .sum = digest_stream_end(o->hash)};
	int r;

	memcpy(h.magic, MAGIC, sizeof h.magic);
	if (info)
		memcpy(h.info, info, sizeof h.info);
	h.self = digest_hash(&h, offsetof(struct head, self));
	r = grid_file_patch(&o->file, 0, &h, sizeof h, err);
	if (!r)
		r = grid_file_publish(&o->file, GRID_TEMPORARY, err);
	simplify_out_abort(o);
	return r;
}

void simplify_out_abort(struct simplify_out *o)
{
	grid_file_abort(&o->file);
	o->hash = digest_stream_free(o->hash);
}

/* ---- reading ---- */

static int damaged(const char *name, struct err *err)
{
	err_set(err, ERR_CORRUPT, "a file of a simplification is damaged");
	return err_add_file(err, name);
}

/* The power went before the data was on the disk, so the file is too short, or not there: that is damage, too. */
static int damaged_if_lost(int r, const char *name, struct err *err)
{
	if (r != -ERR_TRUNCATED && !(r == -ERR_IO && err->sys == ENOENT))
		return r;
	err_clear(err);
	return damaged(name, err);
}

int simplify_in_begin(struct simplify_in *in, int dirfd, const char *name, size_t each, struct err *err)
{
	struct head h = {.n = 0};
	struct stat st;
	int r;

	*in = (struct simplify_in){.dirfd = dirfd, .fd = -1, .each = each};
	snprintf(in->name, sizeof in->name, "%s", name);
	r = io_open(dirfd, name, O_RDONLY, 0, &in->fd, err);
	if (!r)
		r = io_read_at(in->fd, &h, sizeof h, 0, name, err);
	if (r) {
		simplify_in_end(in);
		return damaged_if_lost(r, name, err);
	}
	if (io->fstat(in->fd, &st) || memcmp(h.magic, MAGIC, sizeof MAGIC) || h.each != each ||
	    !digest_equal(h.self, digest_hash(&h, offsetof(struct head, self))) ||
	    (uint64_t)st.st_size != sizeof h + h.n * h.each) {
		simplify_in_end(in);
		return damaged(name, err);
	}
	in->n = h.n;
	in->sum = h.sum;
	memcpy(in->info, h.info, sizeof in->info);
	in->hash = digest_stream_new();
	if (in->hash)
		return 0;
	simplify_in_end(in);
	return err_set(err, ERR_NOMEM, "no memory to read %s", name);
}

int simplify_in_some(const struct simplify_in *in, void *records, uint64_t from, size_t n, struct err *err)
{
	int r = io_read_at(in->fd, records, n * in->each, sizeof(struct head) + from * in->each, in->name, err);

	return damaged_if_lost(r, in->name, err);
}

int simplify_in_read(struct simplify_in *in, void *records, size_t most, size_t *ret, struct err *err)
{
	size_t n = in->n - in->at < most ? (size_t)(in->n - in->at) : most;
	int r = n ? simplify_in_some(in, records, in->at, n, err) : 0;

	if (r)
		return r;
	digest_stream_add(in->hash, records, n * in->each);
	in->at += n;
	if (!n && !digest_equal(digest_stream_end(in->hash), in->sum))
		return damaged(in->name, err);
	*ret = n;
	return 0;
}

void simplify_in_end(struct simplify_in *in)
{
	in->fd = io_close(in->fd);
	in->hash = digest_stream_free(in->hash);
}

bool simplify_file_exists(int dirfd, const char *name)
{
	return io->faccessat(dirfd, name, F_OK, 0) == 0;
}

static int head_size(int dirfd, const char *name, size_t *ret)
{
	struct err ignored = ERR_INIT;
	struct head h = {.n = 0};
	int fd, r = io_open(dirfd, name, O_RDONLY, 0, &fd, &ignored);

	if (r)
		return r;
	r = io_read_at(fd, &h, sizeof h, 0, name, &ignored);
	io_close(fd);
	*ret = h.each;
	return r;
}

bool simplify_file_whole(int dirfd, const char *name)
{
	struct err ignored = ERR_INIT;
	struct simplify_in in;
	uint8_t some[4096];
	size_t each, n = 0;
	int r = head_size(dirfd, name, &each);

	if (r || !each || each > sizeof some || simplify_in_begin(&in, dirfd, name, each, &ignored))
		return false;
	do
		r = simplify_in_read(&in, some, sizeof some / each, &n, &ignored);
	while (!r && n);
	simplify_in_end(&in);
	return !r;
}

/* ---- texts ---- */

int simplify_text_write(int dirfd, const char *name, const char *head, const struct simplify_row *rows, size_t n,
			const void *from, enum grid_durability durability, struct err *err)
{
	int at, r;
	char text[TEXT_MAX], hex[DIGEST_HEX_SIZE], buf[TEXT_MAX];
	struct grid_file file;

	at = snprintf(text, TEXT_MAX, "%s\n", head);
	for (size_t i = 0; i < n; i++) {
		uint64_t value;

		memcpy(&value, (const char *)from + rows[i].at, sizeof value);
		at += snprintf(text + at, TEXT_MAX - (size_t)at, "%s %" PRIu64 "\n", rows[i].name, value);
	}
	at += snprintf(text + at, TEXT_MAX - (size_t)at, "check %s\n", digest_hex(digest_hash(text, (size_t)at), hex));
	r = grid_file_create(&file, dirfd, name, buf, sizeof buf, err);
	if (r)
		return r;
	r = grid_file_append(&file, text, (size_t)at, err);
	if (!r)
		return grid_file_publish(&file, durability, err);
	grid_file_abort(&file);
	return r;
}

static void read_row(const char *line, const struct simplify_row *rows, size_t n, void *to)
{
	char name[32];
	uint64_t value;

	if (sscanf(line, "%31s %" SCNu64, name, &value) != 2)
		return;
	for (size_t i = 0; i < n; i++)
		if (!strcmp(rows[i].name, name))
			memcpy((char *)to + rows[i].at, &value, sizeof value);
}

int simplify_text_read(int dirfd, const char *name, const char *head, const struct simplify_row *rows, size_t n, void *to,
		       struct err *err)
{
	char text[TEXT_MAX] = "", hex[DIGEST_HEX_SIZE], *check;
	size_t size = 0, head_size = strlen(head);
	int fd, r = io_open(dirfd, name, O_RDONLY, 0, &fd, err);

	if (r)
		return damaged_if_lost(r, name, err);
	r = io_read_some(fd, text, sizeof text - 1, 0, name, &size, err);
	io_close(fd);
	if (r)
		return r;
	text[size] = 0;
	check = strstr(text, "\ncheck ");
	if (!check || strncmp(text, head, head_size) || text[head_size] != '\n')
		return damaged(name, err);
	digest_hex(digest_hash(text, (size_t)(check + 1 - text)), hex);
	if (strncmp(check + 7, hex, DIGEST_HEX_SIZE - 1))
		return damaged(name, err);
	for (const char *line = text + head_size; line < check; line = strchr(line + 1, '\n'))
		read_row(line + 1, rows, n, to);
	return 0;
}
