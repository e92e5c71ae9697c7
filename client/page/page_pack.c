/*
 * Vertices and triangles to lines of text: numbers to bytes, deflate, base64.
 *
 * A line is a piece of a block, at most PIECE vertices or triangles, and can be read without any other line. So nothing is kept
 * between blocks, and a page can be continued after each of them. What is in a line: docs/design/page.md. Triangles of a piece
 * are sorted by their greatest number, which stands first: numbers that are near each other become small differences. Memory: 4
 * MiB, whatever the mesh.
 */
#include <libdeflate.h>
#include <stdlib.h>
#include <string.h>

#include "acut.h"
#include "err.h"
#include "outfile.h"
#include "page.h"

enum { PIECE = 1 << 16, NUMBER = 5, HEAD = 2 * NUMBER, LEVEL = 9 }; /* bytes of a number at most; before the rest of a line */

struct page_pack {
	struct libdeflate_compressor *deflate;
	uint32_t (*triangle)[3]; /* PIECE */
	uint8_t *raw, *packed;
	size_t packed_room;
};

int page_put(struct outfile *out, enum page_text which, struct err *err)
{
	return outfile_write(out, page_text[which], strlen(page_text[which]), err);
}

int page_pack_new(struct page_pack **ret, struct err *err)
{
	struct page_pack *p = calloc(1, sizeof(*p));
	size_t raw = HEAD + 3 * NUMBER * (size_t)PIECE;

	if (p) {
		p->deflate = libdeflate_alloc_compressor(LEVEL);
		p->triangle = malloc(PIECE * sizeof(*p->triangle));
		p->raw = malloc(raw);
	}
	if (p && p->deflate) {
		p->packed_room = libdeflate_deflate_compress_bound(p->deflate, raw);
		p->packed = malloc(p->packed_room + 2);
	}
	if (!p || !p->deflate || !p->triangle || !p->raw || !p->packed) {
		page_pack_free(p);
		return err_set(err, ERR_NOMEM, "no memory for a writer");
	}
	*ret = p;
	return 0;
}

struct page_pack *page_pack_free(struct page_pack *p)
{
	if (!p)
		return NULL;
	libdeflate_free_compressor(p->deflate);
	free(p->triangle);
	free(p->raw);
	free(p->packed);
	free(p);
	return NULL;
}

/* Seven bits a byte, the low ones first; the last byte is below 128. */
static uint8_t *put_number(uint8_t *at, uint64_t n)
{
	for (; n > 127; n >>= 7)
		*at++ = (uint8_t)(n | 128);
	*at++ = (uint8_t)n;
	return at;
}

/* Positive and negative numbers alternate: 0, -1, 1, -2, ... */
static uint8_t *put_difference(uint8_t *at, int64_t d)
{
	return put_number(at, (uint64_t)d << 1 ^ (uint64_t)(d >> 63));
}

/* Bytes in threes to four characters each; zeros behind the end become '='. */
static int put_base64(struct outfile *out, const uint8_t *from, size_t n, struct err *err)
{
	static const char digit[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
	enum { THREES = 4096 };
	size_t left = (n + 2) / 3;

	while (left) {
		size_t k = left < THREES ? left : THREES;
		char *at = outfile_room(out, 4 * k, err);

		if (!at)
			return -(int)err->code;
		for (size_t i = 0; i < k; i++, from += 3, at += 4) {
			uint32_t v = (uint32_t)from[0] << 16 | (uint32_t)from[1] << 8 | from[2];

			at[0] = digit[v >> 18];
			at[1] = digit[v >> 12 & 63];
			at[2] = digit[v >> 6 & 63];
			at[3] = digit[v & 63];
		}
		left -= k;
		for (size_t i = 0; !left && i < (3 - n % 3) % 3; i++)
			at[-1 - (int)i] = '=';
		outfile_used(out, 4 * k);
	}
	return outfile_write(out, "\n", 1, err);
}

static int put_line(struct page_pack *p, struct outfile *out, const uint8_t *end, struct err *err)
{
	size_t n = libdeflate_deflate_compress(p->deflate, p->raw, (size_t)(end - p->raw), p->packed, p->packed_room);

	if (!n)
		return err_set(err, ERR_INTERNAL, "a piece of a page cannot be compressed");
	memset(p->packed + n, 0, 2);
	return put_base64(out, p->packed, n, err);
}

int page_pack_vertices(struct page_pack *p, struct outfile *out, const int32_t (*v)[3], size_t n, struct err *err)
{
	for (size_t k; n; v += k, n -= k) {
		uint8_t *at = p->raw;
		int r;

		k = n < PIECE ? n : PIECE;
		at = put_number(at, k);
		for (int j = 0; j < 3; j++) {
			int64_t before = 0;

			for (size_t i = 0; i < k; i++) {
				at = put_difference(at, v[i][j] - before);
				before = v[i][j];
			}
		}
		r = put_line(p, out, at, err);
		if (r)
			return r;
	}
	return 0;
}

int page_pack_numbers(struct page_pack *p, struct outfile *out, const uint64_t *numbers, size_t n, struct err *err)
{
	uint8_t *at = p->raw;

	for (size_t i = 0; i < n; i++)
		at = put_number(at, numbers[i]);
	return put_line(p, out, at, err);
}

static int compare(const void *a, const void *b)
{
	const uint32_t *t = a, *u = b;

	for (int i = 0; i < 3; i++)
		if (t[i] != u[i])
			return t[i] < u[i] ? -1 : 1;
	return 0;
}

/* The numbers of a triangle, turned so that the greatest is the first. */
static void turn(const struct acut_mesh_block *b, const uint32_t local[3], uint32_t ret[3])
{
	uint32_t g[3];
	int most = 0;

	for (int j = 0; j < 3; j++) {
		uint32_t l = local[j];

		g[j] = (uint32_t)(l < b->nforeign ? b->foreign[l] : b->first + (l - b->nforeign));
		most = g[j] > g[most] ? j : most;
	}
	for (int j = 0; j < 3; j++)
		ret[j] = g[(most + j) % 3];
}

int page_pack_faces(struct page_pack *p, struct outfile *out, const struct acut_mesh_block *b, uint32_t domain, struct err *err)
{
	for (uint32_t from = 0, k; from < b->ntriangle; from += k) {
		uint32_t(*t)[3] = p->triangle, before = 0;
		uint8_t *at = p->raw;
		int r;

		k = b->ntriangle - from < PIECE ? b->ntriangle - from : PIECE;
		for (uint32_t i = 0; i < k; i++)
			turn(b, b->triangle[from + i], t[i]);
		qsort(t, k, sizeof(*t), compare);
		at = put_number(at, k);
		at = put_number(at, domain);
		for (uint32_t i = 0; i < k; i++) {
			at = put_number(at, t[i][0] - before);
			before = t[i][0];
		}
		for (int j = 1; j < 3; j++)
			for (uint32_t i = 0; i < k; i++)
				at = put_number(at, t[i][0] - t[i][j]);
		r = put_line(p, out, at, err);
		if (r)
			return r;
	}
	return 0;
}
