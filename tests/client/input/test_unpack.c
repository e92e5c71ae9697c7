/*
 * gzip and zip as streams: what zlib and minizip write comes out again; and of files that are cut or have flipped bits either the
 * very bytes come out, or an error with a sentence.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cmocka.h>
#include <minizip/zip.h>
#include <zlib.h>

#include "ctl_unpack.h"
#include "err.h"

enum { TEXT = 3000, ROOM = 1 << 16, MEMBERS = 8 };

static char text[TEXT];

static void make_text(void)
{
	unsigned state = 7;

	for (size_t i = 0; i < TEXT; i++) {
		state = state * 1103515245 + 12345;
		text[i] = i % 12 == 11 ? '\n' : (char)('0' + (state >> 16) % 10);
	}
}

static int file_of(const void *bytes, size_t n)
{
	int fd = memfd_create("packed", MFD_CLOEXEC);

	assert_true(fd >= 0 && write(fd, bytes, n) == (ssize_t)n);
	return fd;
}

static size_t make_gzip(uint8_t *to, size_t from, size_t n)
{
	z_stream z = {.next_in = (Bytef *)text + from, .avail_in = (uInt)n, .next_out = to, .avail_out = ROOM};

	assert_int_equal(deflateInit2(&z, 9, Z_DEFLATED, 16 + MAX_WBITS, 8, Z_DEFAULT_STRATEGY), Z_OK);
	assert_int_equal(deflate(&z, Z_FINISH), Z_STREAM_END);
	deflateEnd(&z);
	return z.total_out;
}

/* Members "0" (a folder), "1" and so on, each with the text from its number on. */
static size_t make_zip(uint8_t *to, unsigned n, int level)
{
	char path[] = "/tmp/acut-test-unpack-XXXXXX", name[16];
	int fd = mkstemp(path);
	ssize_t size;
	zipFile zip;

	assert_true(fd >= 0);
	zip = zipOpen64(path, APPEND_STATUS_CREATE);
	assert_non_null(zip);
	for (unsigned i = 0; i < n; i++) {
		snprintf(name, sizeof(name), i ? "d/%u" : "d/", i);
		assert_int_equal(
			zipOpenNewFileInZip64(zip, name, NULL, NULL, 0, NULL, 0, NULL, level ? Z_DEFLATED : 0, level, i == 2), 0);
		if (i)
			assert_int_equal(zipWriteInFileInZip(zip, text + i, TEXT - i), 0);
		zipCloseFileInZip(zip);
	}
	zipClose(zip, NULL);
	size = pread(fd, to, ROOM, 0);
	assert_true(size > 0 && size < ROOM);
	unlink(path);
	close(fd);
	return (size_t)size;
}

struct out {
	char *bytes;
	size_t n, most;
};

static int take(void *ctx, const void *bytes, size_t n, struct err *err)
{
	struct out *o = ctx;

	if (n > o->most - o->n)
		return err_set(err, ERR_NOSPACE, "too much");
	memcpy(o->bytes + o->n, bytes, n);
	o->n += n;
	return 0;
}

struct list {
	struct ctl_unpack_member m[MEMBERS];
	char name[MEMBERS][32];
	size_t n;
};

static int note(void *ctx, const struct ctl_unpack_member *m, struct err *err)
{
	struct list *l = ctx;

	if (l->n == MEMBERS)
		return err_set(err, ERR_LIMIT, "too many");
	snprintf(l->name[l->n], sizeof(l->name[0]), "%s", m->name);
	l->m[l->n] = *m;
	l->m[l->n].name = l->name[l->n];
	l->n++;
	return 0;
}

static void gzip_whole(void **state)
{
	static uint8_t packed[ROOM];
	static char room[ROOM];
	size_t first = make_gzip(packed, 0, 1000), n = first + make_gzip(packed + first, 1000, TEXT - 1000);
	struct {
		size_t size;
		uint64_t trailing;
		const char *behind;
	} rows[] = {
		{n, 0, ""},
		{n + 5, 0, "\0\0\0\0\0"},
		{n + 3, 3, "abc"},
		{n + 3, 1, "\0\0\x1f"},
	};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		struct out o = {room, 0, ROOM};
		struct err err = ERR_INIT;
		uint64_t trailing;
		bool cut;
		int fd;

		memcpy(packed + n, rows[i].behind, rows[i].size - n);
		fd = file_of(packed, rows[i].size);
		assert_int_equal(ctl_unpack_kind_of(fd), CTL_UNPACK_GZIP);
		assert_int_equal(ctl_unpack_gzip(fd, take, &o, &cut, &trailing, &err), 0);
		assert_true(!cut && trailing == rows[i].trailing && o.n == TEXT && !memcmp(room, text, TEXT));
		o = (struct out){room, 0, 2500};
		assert_int_equal(ctl_unpack_gzip(fd, take, &o, &cut, &trailing, &err), -ERR_NOSPACE);
		close(fd);
	}
}

/* Cut: what comes is a beginning, and it says so. Flipped: the very bytes, or an error. */
static void gzip_damaged(void **state)
{
	static uint8_t packed[ROOM];
	static char room[ROOM];
	size_t n = make_gzip(packed, 0, TEXT);

	for (size_t i = 0; i < 2 * n; i++) {
		struct out o = {room, 0, ROOM};
		struct err err = ERR_INIT;
		uint64_t trailing;
		bool cut, flip = i >= n;
		int fd, r;

		if (flip)
			packed[i - n] ^= (uint8_t)(1 << i % 8);
		fd = file_of(packed, flip ? n : i);
		if (flip)
			packed[i - n] ^= (uint8_t)(1 << i % 8);
		if (ctl_unpack_kind_of(fd) == CTL_UNPACK_GZIP) {
			r = ctl_unpack_gzip(fd, take, &o, &cut, &trailing, &err);
			assert_true(!r == !err.code && (!r || (*err.message && *err.hint)));
			assert_true(flip || (r == -ERR_TRUNCATED && cut && o.n <= TEXT && !memcmp(room, text, o.n)));
			assert_true(r || (o.n == TEXT && !memcmp(room, text, TEXT)));
		}
		close(fd);
	}
}

static void zip_whole(void **state)
{
	static uint8_t packed[ROOM];
	static char room[ROOM];

	for (int level = 0; level < 10; level += 9) {
		size_t n = make_zip(packed, 5, level);
		int fd = file_of(packed, n);
		struct list l = {.n = 0};
		struct err err = ERR_INIT;

		assert_int_equal(ctl_unpack_kind_of(fd), CTL_UNPACK_ZIP);
		assert_int_equal(ctl_unpack_list(fd, note, &l, &err), 0);
		assert_int_equal(l.n, 4);
		for (unsigned i = 4; i > 0; i--) { /* in any order */
			struct out o = {room, 0, ROOM};
			const struct ctl_unpack_member *m = &l.m[i - 1];

			assert_true(m->name[2] == (char)('0' + i) && m->size == TEXT - i && !m->why);
			assert_int_equal(ctl_unpack_zip(fd, m, take, &o, &err), 0);
			assert_true(o.n == TEXT - i && !memcmp(room, text + i, o.n));
			o = (struct out){room, 0, 100};
			assert_int_equal(ctl_unpack_zip(fd, m, take, &o, &err), -ERR_NOSPACE);
		}
		close(fd);
	}
}

static void zip_damaged(void **state)
{
	static uint8_t packed[ROOM];
	static char room[ROOM];
	size_t n = make_zip(packed, 3, 9);

	for (size_t i = 0; i < 2 * n; i++) {
		struct list l = {.n = 0};
		struct err err = ERR_INIT;
		bool flip = i >= n;
		int fd, r;

		if (flip)
			packed[i - n] ^= (uint8_t)(1 << i % 8);
		fd = file_of(packed, flip ? n : i);
		if (flip)
			packed[i - n] ^= (uint8_t)(1 << i % 8);
		r = ctl_unpack_kind_of(fd) == CTL_UNPACK_ZIP ? ctl_unpack_list(fd, note, &l, &err) : -1;
		assert_true(r == -1 || (!r == !err.code && (!r || (*err.message && *err.hint))));
		if (!flip && !r)
			fail_msg("cut at %zu of %zu: %zu members", i, n, l.n);
		for (size_t k = 0; !r && k < l.n; k++) {
			struct out o = {room, 0, ROOM};

			if (l.m[k].why)
				continue;
			err = ERR_INIT;
			if (ctl_unpack_zip(fd, &l.m[k], take, &o, &err)) {
				assert_true(*err.message);
				continue;
			}
			/* each is the text from somewhere on; a folder that is not named so any more is empty */
			if (o.n && !(o.n == TEXT - 1 && !memcmp(room, text + 1, o.n)) &&
			    !(o.n == TEXT - 2 && !memcmp(room, text + 2, o.n)))
				fail_msg("flip at %zu of %zu: member %zu comes out with %zu bytes", i - n, n, k, o.n);
		}
		close(fd);
	}
}

static void neither(void **state)
{
	static const char *const rows[] = {"", "PK", "PK\1\2", "\x1f\x8b\x07\x00", "LASF", "1 2 3\n"};

	for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
		int fd = file_of(rows[i], strlen(rows[i]));

		assert_int_equal(ctl_unpack_kind_of(fd), CTL_UNPACK_NONE);
		close(fd);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(gzip_whole),  cmocka_unit_test(gzip_damaged), cmocka_unit_test(zip_whole),
		cmocka_unit_test(zip_damaged), cmocka_unit_test(neither),
	};

	make_text();
	return cmocka_run_group_tests(tests, NULL, NULL);
}
