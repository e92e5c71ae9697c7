/*
 * gzip by zlib, zip by its minizip.
 *
 * Files are read through the given descriptor, at explicit offsets. Memory is a few buffers of fixed size, whatever an
 * archive claims; unpacked bytes go to a sink, which decides when it is too much. Names in an archive are never opened.
 * Checksums of both formats are checked, and that a member of a zip archive has the size that it claims.
 *
 * Not here: encrypted members, Deflate64 and the rarer methods, archives in parts.
 */
#include "ctl_unpack.h"

#include <errno.h>
#include <minizip/unzip.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include "err.h"
#include "io.h"

enum { PIECE = 128 << 10, NAME_MOST = 4096, WINDOW = 64 << 10, STORED = 0, DEFLATED = 8, AES = 99, ENCRYPTED = 1 };

enum ctl_unpack_kind ctl_unpack_kind_of(int fd)
{
	unsigned char head[4] = {0};

	if (pread(fd, head, sizeof(head), 0) != sizeof(head))
		return CTL_UNPACK_NONE;
	if (!memcmp(head, "\x1f\x8b\x08", 3))
		return CTL_UNPACK_GZIP;
	return !memcmp(head, "PK\3\4", 4) || !memcmp(head, "PK\5\6", 4) ? CTL_UNPACK_ZIP : CTL_UNPACK_NONE;
}

/* ---- zip: a file for minizip, which reads byte by byte ---- */

struct source {
	int fd;
	uint64_t at, size;
	uint64_t window_at;
	size_t window_n;
	bool failed;
	unsigned char window[WINDOW];
};

static voidpf source_open(voidpf opaque, const void *name, int mode)
{
	return opaque;
}

static uLong source_read(voidpf opaque, voidpf stream, void *buf, uLong n)
{
	struct source *s = stream;
	uLong done = 0;

	while (done < n && s->at < s->size) {
		size_t from, piece;

		if (s->at < s->window_at || s->at >= s->window_at + s->window_n) {
			struct err err = ERR_INIT;

			s->window_at = s->at;
			s->window_n = 0;
			if (io_read_some(s->fd, s->window, WINDOW, s->at, "", &s->window_n, &err) || !s->window_n) {
				s->failed = true;
				return done;
			}
		}
		from = (size_t)(s->at - s->window_at);
		piece = s->window_n - from < n - done ? s->window_n - from : n - done;
		memcpy((char *)buf + done, s->window + from, piece);
		done += piece;
		s->at += piece;
	}
	s->failed |= done < n; /* minizip would read zeros at the end of a file */
	return done;
}

static uLong source_write(voidpf opaque, voidpf stream, const void *buf, uLong n)
{
	return 0;
}

static ZPOS64_T source_tell(voidpf opaque, voidpf stream)
{
	return ((struct source *)stream)->at;
}

static long source_seek(voidpf opaque, voidpf stream, ZPOS64_T offset, int origin)
{
	struct source *s = stream;
	uint64_t base = origin == ZLIB_FILEFUNC_SEEK_CUR ? s->at : origin == ZLIB_FILEFUNC_SEEK_END ? s->size : 0;

	if (base + offset > s->size) /* backwards it wraps around */
		return -1;
	s->at = base + offset;
	return 0;
}

static int source_close(voidpf opaque, voidpf stream)
{
	return 0;
}

static int source_error(voidpf opaque, voidpf stream)
{
	return ((struct source *)stream)->failed;
}

static int not_whole(struct err *err)
{
	err_set(err, ERR_TRUNCATED,
		"it begins as a zip archive, but has no directory of its members that could be read: it is not whole");
	return err_add_hint(err, "copy it again");
}

static int damaged(struct err *err)
{
	err_set(err, ERR_INPUT, "the zip archive is damaged");
	return err_add_hint(err, "copy it again; unzip -t has details");
}

static int open_zip(int fd, struct source **ret_source, unzFile *ret_zip, struct err *err)
{
	zlib_filefunc64_def calls = {source_open, source_read,  source_write, source_tell,
				     source_seek, source_close, source_error, NULL};
	struct source *s = calloc(1, sizeof(*s));
	struct stat st;
	unzFile zip;

	if (!s)
		return err_set(err, ERR_NOMEM, "no memory to read an archive");
	s->fd = fd;
	s->size = fstat(fd, &st) ? 0 : (uint64_t)st.st_size;
	calls.opaque = s;
	zip = unzOpen2_64("", &calls);
	if (!zip) {
		free(s);
		return not_whole(err);
	}
	*ret_source = s;
	*ret_zip = zip;
	return 0;
}

static void close_zip(struct source *s, unzFile zip)
{
	unzClose(zip);
	free(s);
}

/* ---- zip: the directory ---- */

static void judge(const unz_file_info64 *info, struct ctl_unpack_member *m)
{
	if (info->flag & ENCRYPTED || info->compression_method == AES) {
		m->why = "it is encrypted";
		m->todo = "unpack it with its password, 7z x asks for it, and name the file";
	} else if (info->compression_method != STORED && info->compression_method != DEFLATED) {
		m->why = info->compression_method == 9 ? "it is compressed by Deflate64, which is not read" :
							 "it is compressed by a method that is not read";
		m->todo = "unpack the archive with 7z x, and name the file";
	}
}

static int see_member(unzFile zip, ctl_unpack_each *seen, void *ctx, struct err *err)
{
	struct ctl_unpack_member m = {0};
	char name[NAME_MOST];
	unz_file_info64 info;
	unz64_file_pos pos;

	if (unzGetCurrentFileInfo64(zip, &info, name, sizeof(name) - 1, NULL, 0, NULL, 0) || unzGetFilePos64(zip, &pos))
		return damaged(err);
	name[info.size_filename < sizeof(name) - 1 ? info.size_filename : sizeof(name) - 1] = 0;
	if (!*name || name[strlen(name) - 1] == '/')
		return 0;
	m.name = name;
	m.size = info.uncompressed_size;
	m.place = pos.pos_in_zip_directory;
	m.number = pos.num_of_file;
	if (info.size_filename >= sizeof(name) - 1)
		m.why = "its name is too long";
	else
		judge(&info, &m);
	return seen(ctx, &m, err);
}

int ctl_unpack_list(int fd, ctl_unpack_each *seen, void *ctx, struct err *err)
{
	struct source *s;
	unz_global_info64 global;
	char head[4] = "";
	unzFile zip;
	int r, z;

	if (pread(fd, head, sizeof(head), 0) == sizeof(head) && !memcmp(head, "PK\5\6", 4))
		return 0; /* its directory is all of it; minizip does not open it */
	r = open_zip(fd, &s, &zip, err);
	if (r)
		return r;
	z = unzGetGlobalInfo64(zip, &global);
	if (!z && !global.number_entry)
		r = not_whole(err); /* a truncated directory looks empty */
	else if (!z)
		z = unzGoToFirstFile(zip);
	while (!r && !z) {
		r = see_member(zip, seen, ctx, err);
		z = r ? 0 : unzGoToNextFile(zip);
	}
	if (!r && z != UNZ_END_OF_LIST_OF_FILE)
		r = damaged(err);
	close_zip(s, zip);
	return r;
}

/* ---- zip: a member ---- */

static int copy_member(unzFile zip, uint64_t size, ctl_unpack_sink *sink, void *ctx, struct err *err)
{
	char *piece = malloc(PIECE);
	uint64_t done = 0;
	int n = 1, r = 0;

	if (!piece)
		return err_set(err, ERR_NOMEM, "no memory to unpack a file");
	while (!r && n > 0) {
		n = unzReadCurrentFile(zip, piece, PIECE);
		done += n > 0 ? (uint64_t)n : 0;
		if (n > 0)
			r = sink(ctx, piece, (size_t)n, err);
	}
	free(piece);
	return !r && (n < 0 || done != size) ? damaged(err) : r;
}

int ctl_unpack_zip(int fd, const struct ctl_unpack_member *m, ctl_unpack_sink *sink, void *ctx, struct err *err)
{
	unz64_file_pos pos = {.pos_in_zip_directory = m->place, .num_of_file = m->number};
	struct source *s;
	unzFile zip;
	int r = open_zip(fd, &s, &zip, err);

	if (r)
		return r;
	if (unzGoToFilePos64(zip, &pos) || unzOpenCurrentFile(zip)) {
		r = damaged(err);
	} else {
		r = copy_member(zip, m->size, sink, ctx, err);
		if (unzCloseCurrentFile(zip) && !r) {
			err_set(err, ERR_INPUT, "its checksum is not the one in the archive");
			r = err_add_hint(err, "copy the archive again; unzip -t has details");
		}
	}
	close_zip(s, zip);
	return r;
}

/* ---- gzip ---- */

struct gzip {
	z_stream z;
	int fd;
	uint64_t at; /* of the next bytes to be read */
	bool within; /* a stream has begun and not ended */
	unsigned char in[PIECE], out[PIECE];
};

/* So that there are `least` bytes, unless the file ends. */
static int refill(struct gzip *g, unsigned least, struct err *err)
{
	size_t n;
	int r;

	if (g->z.avail_in >= least)
		return 0;
	if (g->z.avail_in)
		memmove(g->in, g->z.next_in, g->z.avail_in);
	g->z.next_in = g->in;
	r = io_read_some(g->fd, g->in + g->z.avail_in, sizeof(g->in) - g->z.avail_in, g->at, "", &n, err);
	if (r)
		return r;
	g->at += n;
	g->z.avail_in += (unsigned)n;
	return 0;
}

static int bad_gzip(struct err *err)
{
	err_set(err, ERR_INPUT, "the gzip file is damaged");
	return err_add_hint(err, "copy it again; gzip -t has details");
}

static int cut_gzip(bool *ret_cut, struct err *err)
{
	*ret_cut = true;
	err_set(err, ERR_TRUNCATED, "the gzip file ends before its last byte: it is not whole");
	return err_add_hint(err, "copy it again, or accept the rest with --accept-truncated");
}

/* Whether another stream follows; zeros that pad are skipped. */
static bool next_stream(struct gzip *g, struct err *err)
{
	while (!refill(g, 2, err) && g->z.avail_in && !*g->z.next_in) {
		g->z.next_in++;
		g->z.avail_in--;
	}
	return !err->code && g->z.avail_in >= 2 && g->z.next_in[0] == 0x1f && g->z.next_in[1] == 0x8b;
}

static int inflate_streams(struct gzip *g, ctl_unpack_sink *sink, void *ctx, bool *ret_cut, struct err *err)
{
	int r = 0, z = Z_STREAM_END;

	while (!r && (g->within || next_stream(g, err))) {
		if (!g->within && inflateReset(&g->z))
			return bad_gzip(err);
		g->within = true;
		r = refill(g, 1, err);
		if (!r && !g->z.avail_in)
			return cut_gzip(ret_cut, err);
		g->z.next_out = g->out;
		g->z.avail_out = sizeof(g->out);
		z = r ? Z_OK : inflate(&g->z, Z_NO_FLUSH);
		if (z != Z_OK && z != Z_STREAM_END)
			return z == Z_MEM_ERROR ? err_set(err, ERR_NOMEM, "no memory to unpack a file") : bad_gzip(err);
		g->within = z != Z_STREAM_END;
		if (!r && g->z.avail_out < sizeof(g->out))
			r = sink(ctx, g->out, sizeof(g->out) - g->z.avail_out, err);
	}
	return r ? r : -(int)err->code;
}

int ctl_unpack_gzip(int fd, ctl_unpack_sink *sink, void *ctx, bool *ret_cut, uint64_t *ret_trailing, struct err *err)
{
	struct gzip *g = calloc(1, sizeof(*g));
	struct stat st;
	int r;

	*ret_cut = false;
	*ret_trailing = 0;
	if (!g || inflateInit2(&g->z, 16 + MAX_WBITS)) {
		free(g);
		return err_set(err, ERR_NOMEM, "no memory to unpack a file");
	}
	g->fd = fd;
	r = inflate_streams(g, sink, ctx, ret_cut, err);
	if (!r && !fstat(fd, &st))
		*ret_trailing = (uint64_t)st.st_size - (g->at - g->z.avail_in);
	inflateEnd(&g->z);
	free(g);
	return r;
}
