/*
 * The bytes of stored domains: every domain is read back unchanged, and takes as few bytes as its extents allow; files
 * of version 4 are read, earlier ones removed, later ones left alone.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <fcntl.h>
#include <unistd.h>
#include <cmocka.h>
#include <xxhash.h>

#include "err.h"
#include "io.h"
#include "made.h"
#include "store.h"
#include "repeat.h"

static const struct store_id ID = {{UINT64_C(0xab00000000001234), 5}, {6, 7}};
enum { HEADER = 384, PROOF = MADE_PROOF };

static char path[64];
static int dirfd = -1;

static void check(int r, const struct err *err)
{
	if (r)
		fail_msg("%d: %s", r, err->message);
}

static const char *name_of(void)
{
	return "ab/d-ab000000000012340000000000000005-00000000000000060000000000000007";
}

static int in_folder(int (*fn)(int, const char *, void *, size_t, struct err *), void *memory, size_t size, struct err *err)
{
	int fd = openat(dirfd, "ab", O_RDONLY | O_DIRECTORY), r;

	assert_true(fd >= 0);
	r = fn(fd, name_of() + 3, memory, size, err);
	close(fd);
	return r;
}

static bool is_there(void)
{
	return faccessat(dirfd, name_of(), F_OK, 0) == 0;
}

/* ---- domains ---- */

/* All ways to read what is stored of `m`, in memory of exactly the promised size, with a guard behind it. */
static void check_stored(const struct made *m, const struct store_front *want)
{
	struct store_front f;
	struct mesh_domain d;
	struct err err = ERR_INIT;
	uint8_t *memory, small[100];

	check(store_head(dirfd, &ID, &f, &err), &err);
	assert_true(f.bytes == want->bytes && f.payload == want->payload && f.front == want->front && f.whole == want->whole);
	assert_int_equal(f.bytes, store_size(dirfd, &ID));
	memory = malloc(f.whole + 8);
	memset(memory + f.whole, 0x77, 8);
	assert_int_equal(store_get(dirfd, &ID, memory, f.whole - 1, &d, &err), STORE_E_ABSENT);
	check(store_get(dirfd, &ID, memory, f.whole, &d, &err), &err);
	made_same(&m->d, &d);
	assert_true((uint8_t *)d.final + (d.nvertex + 7) / 8 <= memory + f.whole);
	assert_true(!d.nedges || (d.edges >= d.final + (d.nvertex + 7) / 8 && d.edges + d.nedges <= memory + f.whole));
	for (unsigned i = 0; i < 8; i++)
		assert_int_equal(memory[f.whole + i], 0x77);
	free(memory);
	memory = malloc(f.front + 1);
	memory[f.front] = 0x77;
	check(store_front(dirfd, &ID, memory, f.front, &f, &err), &err);
	assert_int_equal(memory[f.front], 0x77);
	assert_memory_equal(f.domain.link, m->d.link, m->d.nopen * sizeof *m->d.link);
	assert_memory_equal(f.domain.vertex, m->d.vertex, m->d.nopen * sizeof *m->d.vertex);
	assert_memory_equal(f.beside.proof, m->proof, m->beside.proof_size);
	free(memory);
	check(in_folder(store_check, small, sizeof small, &err), &err);
}

/* ---- what fits in two bytes, and what does not ---- */

static void test_extents(void **state)
{
	static const struct {
		int32_t low[3], high[3];
		unsigned vertex; /* bytes */
	} c[] = {
		{{0, 0, 0}, {65535, 65535, 65535}, 6},
		{{-40000, 1 << 30, INT32_MIN}, {25535, (1 << 30) + 9, INT32_MIN + 65535}, 6},
		{{INT32_MAX - 65535, INT32_MAX, -7}, {INT32_MAX, INT32_MAX, -7}, 6},
		{{0, 0, 0}, {65536, 65535, 65535}, 8},
		{{0, 0, 0}, {65535, 65536, 65535}, 8},
		{{0, 0, 0}, {65535, 65535, 65536}, 8},
		{{-5, -5, 100}, {1 << 20, 1 << 20, 65635}, 10},
		{{INT32_MIN, 5, INT32_MIN}, {INT32_MAX, 70, INT32_MAX}, 10},
		{{INT32_MIN, INT32_MIN, INT32_MIN}, {INT32_MAX, INT32_MAX, INT32_MAX}, 12},
	};
	static const struct {
		uint32_t vertices, open, triangles;
	} size[] = {
		{3, 3, 1}, {4, 3, 3}, {5, 3, 4}, {13, 4, 19}, {1000, 100, 1900}, {65536, 7, 20001}, {65537, 7, 20001},
	};

	(void)state;
	for (unsigned i = 0; i < sizeof c / sizeof c[0]; i++) {
		for (unsigned k = 0; k < sizeof size / sizeof size[0]; k++) {
			uint32_t closed = size[k].vertices - size[k].open;
			struct err err = ERR_INIT;
			struct store_front f;
			struct made m;
			uint64_t least;

			made_domain(size[k].vertices, size[k].open, size[k].triangles, c[i].low, c[i].high, &m);
			check(store_put(dirfd, &ID, &m.beside, &m.d, &f, &err), &err);
			least = HEADER + PROOF + 4 + 36 * (uint64_t)size[k].open +
				size[k].triangles * (size[k].vertices > 65536 ? 12 : 6);
			/* A single one has no extent. */
			least += closed * (uint64_t)(closed > 1 ? c[i].vertex : closed ? 6 : 0) + m.d.nedges;
			assert_in_range(f.bytes, least, least + 14);
			check_stored(&m, &f);
			made_free(&m);
		}
	}
}

static void test_nothing(void **state)
{
	static const int32_t zero[3];
	struct err err = ERR_INIT;
	struct store_front f;
	struct mesh_domain d;
	struct made m;
	uint8_t memory[8];

	(void)state;
	made_domain(0, 0, 0, zero, zero, &m);
	m.beside.proof_size = 0;
	check(store_put(dirfd, &ID, &m.beside, &m.d, &f, &err), &err);
	assert_int_equal(f.bytes, HEADER);
	check(store_get(dirfd, &ID, memory, 0, &d, &err), &err);
	assert_true(!d.nvertex && !d.ntriangle && digest_equal(d.digest, m.d.digest));
	made_free(&m);
}

/* ---- other versions ---- */

static size_t padded(size_t n)
{
	return (n + 7) & ~(size_t)7;
}

static void pwrite_all(int fd, const void *bytes, size_t n, size_t at)
{
	assert_int_equal(pwrite(fd, bytes, n, (off_t)at), n);
}

/* The existing header, as version `version` writes it. */
static void header_set(uint32_t version, const uint64_t *rest)
{
	int fd = openat(dirfd, name_of(), O_RDWR);
	uint8_t header[HEADER];
	uint64_t sum;

	assert_int_equal(pread(fd, header, HEADER, 0), HEADER);
	memcpy(header + 4, &version, 4);
	if (rest)
		memcpy(header + 280, rest, 8);
	if (version < 5)
		memset(header + 308, 0, 68);
	sum = XXH3_64bits(header, HEADER - 8);
	memcpy(header + HEADER - 8, &sum, 8);
	pwrite_all(fd, header, HEADER, 0);
	close(fd);
}

/* format.md, version 4: everything as in memory. */
static void write_4(const struct made *m, uint64_t *ret_payload, uint64_t *ret_bytes)
{
	const struct mesh_domain *d = &m->d;
	size_t at = HEADER + padded(m->beside.proof_size), open = d->nopen * sizeof *d->link + d->nopen * sizeof *d->vertex,
	       closed = (d->nvertex - d->nopen) * sizeof *d->vertex, triangles = d->ntriangle * sizeof *d->triangle;
	uint8_t *all = calloc(1, open + closed + triangles);
	int fd = openat(dirfd, name_of(), O_RDWR);
	uint64_t rest, first;

	memcpy(all, d->link, d->nopen * sizeof *d->link);
	memcpy(all + d->nopen * sizeof *d->link, d->vertex, d->nvertex * sizeof *d->vertex);
	memcpy(all + open + closed, d->triangle, triangles);
	first = XXH3_64bits(all, open);
	rest = XXH3_64bits(all + open, closed + triangles);
	pwrite_all(fd, all, open + closed, at);
	at += padded(open + closed);
	pwrite_all(fd, all + open + closed, triangles, at);
	*ret_bytes = at + padded(triangles);
	assert_int_equal(ftruncate(fd, (off_t)*ret_bytes), 0);
	close(fd);
	header_set(4, &rest);
	*ret_payload = XXH3_64bits_withSeed(&rest, sizeof rest, first);
	free(all);
}

static void test_version_4(void **state)
{
	static const int32_t low[3] = {-3, 5, 0}, high[3] = {900, 7000, 50};
	struct err err = ERR_INIT;
	struct store_front f, narrow;
	struct made m;

	(void)state;
	made_domain(1001, 33, 1902, low, high, &m); /* without edges, which came later */
	memset(m.d.counts.removed, 0, sizeof m.d.counts.removed);
	check(store_put(dirfd, &ID, &m.beside, &m.d, &narrow, &err), &err);
	f = narrow;
	write_4(&m, &f.payload, &f.bytes);
	assert_true(f.bytes > narrow.bytes + 18 * 900);
	check_stored(&m, &f);
	/* Its checksums are checked, too. */
	for (unsigned i = 0; i < 3; i++) {
		const off_t at[3] = {HEADER + PROOF + 4 + 36 * 33 + 100, (off_t)f.bytes - 20, 100};
		uint8_t byte, *memory = malloc(f.whole);
		struct mesh_domain d;
		uint64_t payload, bytes;
		int fd;

		check(store_put(dirfd, &ID, &m.beside, &m.d, &narrow, &err), &err);
		write_4(&m, &payload, &bytes);
		fd = openat(dirfd, name_of(), O_RDWR);
		assert_int_equal(pread(fd, &byte, 1, at[i]), 1);
		byte ^= 1;
		pwrite_all(fd, &byte, 1, (size_t)at[i]);
		close(fd);
		assert_int_equal(store_get(dirfd, &ID, memory, f.whole, &d, &err), STORE_E_DAMAGED);
		assert_false(is_there());
		free(memory);
	}
	made_free(&m);
}

/* Forged files: every checksum is valid. */
static void test_forged(void **state)
{
	static const int32_t low[3] = {0, 0, 0}, high[3] = {9, 9, 9};
	static const struct {
		uint32_t vertices, corner;
		bool fits;
	} c[] = {
		{10, 9, true},        {10, 10, false},       {10, 65535, false},
		{65535, 65534, true}, {65535, 65535, false}, {65536, 65535, true},
		{65537, 65536, true}, {65537, 65537, false}, {65537, UINT32_MAX, false},
	};

	(void)state;
	for (unsigned i = 0; i < sizeof c / sizeof c[0]; i++) {
		struct err err = ERR_INIT;
		struct store_front f;
		struct mesh_domain d;
		uint8_t small[64], *memory;
		struct made m;

		made_domain(c[i].vertices, 4, 77, low, high, &m);
		m.d.triangle[70][1] = c[i].corner;
		check(store_put(dirfd, &ID, &m.beside, &m.d, &f, &err), &err);
		memory = malloc(f.whole);
		assert_int_equal(in_folder(store_check, small, sizeof small - 1, &err), c[i].fits ? 0 : -ERR_CORRUPT);
		assert_int_equal(!*err.message, c[i].fits);
		err_clear(&err);
		assert_int_equal(store_get(dirfd, &ID, memory, f.whole, &d, &err), c[i].fits ? 0 : STORE_E_DAMAGED);
		assert_int_equal(is_there(), c[i].fits);
		free(memory);
		made_free(&m);
	}
	/* Triangles, but no vertices for their corners. */
	{
		struct err err = ERR_INIT;
		struct store_front f;
		struct made m;

		made_domain(3, 3, 1, low, high, &m);
		m.d.nvertex = m.d.nopen = 0;
		check(store_put(dirfd, &ID, &m.beside, &m.d, &f, &err), &err);
		assert_int_equal(store_head(dirfd, &ID, &f, &err), STORE_E_DAMAGED);
		made_free(&m);
	}
}

static void test_other_versions(void **state)
{
	static const int32_t low[3] = {0, 0, 0}, high[3] = {9, 9, 9};
	struct err err = ERR_INIT;
	struct store_front f;
	uint8_t memory[256];
	struct mesh_domain d;
	struct made m;

	(void)state;
	made_domain(10, 4, 12, low, high, &m);
	/* A later version: absent, and not damaged. */
	check(store_put(dirfd, &ID, &m.beside, &m.d, &f, &err), &err);
	header_set(8, NULL);
	assert_int_equal(store_head(dirfd, &ID, &f, &err), STORE_E_ABSENT);
	assert_int_equal(store_get(dirfd, &ID, memory, sizeof memory, &d, &err), STORE_E_ABSENT);
	assert_int_equal(in_folder(store_check, memory, sizeof memory, &err), -ERR_VERSION);
	assert_non_null(strstr(err.message, "of version 8"));
	err_clear(&err);
	assert_true(is_there());
	/* An earlier version: absent, and removed. */
	header_set(3, NULL);
	assert_int_equal(in_folder(store_check, memory, sizeof memory, &err), -ERR_CORRUPT);
	assert_int_equal(store_head(dirfd, &ID, &f, &err), STORE_E_ABSENT);
	assert_false(is_there());
	/* Widths that no version has, although the size of the file is right. */
	for (unsigned i = 308; i < 310; i++) {
		const uint8_t bytes[2] = {1, 3};
		int fd;

		check(store_put(dirfd, &ID, &m.beside, &m.d, &f, &err), &err);
		fd = openat(dirfd, name_of(), O_RDWR);
		pwrite_all(fd, bytes, 2, i);
		close(fd);
		header_set(7, NULL);
		assert_int_equal(store_head(dirfd, &ID, &f, &err), STORE_E_DAMAGED);
		assert_false(is_there());
	}
	made_free(&m);
}

/* Version 5 does not record how many points share a position: it is used if none was removed. */
static void test_version_5(void **state)
{
	static const int32_t low[3] = {0, 0, 0}, high[3] = {9, 9, 9};
	struct err err = ERR_INIT;
	struct store_front f;
	struct made m;

	(void)state;
	for (unsigned out = 0; out < 2; out++) {
		made_domain(10, 4, 12, low, high, &m);
		memset(m.d.counts.removed, 0, sizeof m.d.counts.removed);
		m.d.counts.removed[11] = out;
		m.d.counts.most = (struct mesh_most){2, -3, 4};
		check(store_put(dirfd, &ID, &m.beside, &m.d, &f, &err), &err);
		check(store_head(dirfd, &ID, &f, &err), &err);
		assert_true(f.domain.counts.most.points == 2 && f.domain.counts.most.x == -3 && f.domain.counts.most.y == 4);
		header_set(5, NULL);
		assert_int_equal(store_head(dirfd, &ID, &f, &err), out ? STORE_E_ABSENT : 0);
		assert_int_equal(is_there(), !out);
		assert_true(out || !f.domain.counts.most.points);
		store_remove(dirfd, &ID, &err);
		made_free(&m);
	}
}

/* Version 6 counts by 12 rules; what is there for the others is not read. */
static void test_version_6(void **state)
{
	static const int32_t low[3] = {0, 0, 0}, high[3] = {9, 9, 9};
	struct err err = ERR_INIT;
	struct store_front f;
	struct made m;

	(void)state;
	made_domain(10, 4, 12, low, high, &m);
	for (unsigned i = 0; i < MESH_RULES; i++)
		m.d.counts.removed[i] = 100 + i;
	check(store_put(dirfd, &ID, &m.beside, &m.d, &f, &err), &err);
	check(store_head(dirfd, &ID, &f, &err), &err);
	assert_memory_equal(f.domain.counts.removed, m.d.counts.removed, sizeof m.d.counts.removed);
	header_set(6, NULL);
	check(store_head(dirfd, &ID, &f, &err), &err);
	assert_memory_equal(f.domain.counts.removed, m.d.counts.removed, 12 * sizeof(uint64_t));
	for (unsigned i = 12; i < MESH_RULES; i++)
		assert_true(f.domain.counts.removed[i] == 0);
	store_remove(dirfd, &ID, &err);
	made_free(&m);
}

/* Whether a file exists, and when it was last used. */
static void test_there(void **state)
{
	static const int32_t low[3] = {0, 0, 0}, high[3] = {9, 9, 9};
	const struct timespec times[2] = {{77, 0}, {77, 3}};
	struct store_front put, read;
	struct err err = ERR_INIT;
	int64_t used_ns = 0;
	struct made m;
	int fd;

	(void)state;
	assert_false(store_there(dirfd, &ID, 0, &used_ns));
	made_domain(10, 4, 12, low, high, &m);
	check(store_put(dirfd, &ID, &m.beside, &m.d, &put, &err), &err);
	check(store_head(dirfd, &ID, &read, &err), &err);
	assert_true(read.used_ns > 0 && put.bytes == read.bytes);
	assert_true(store_there(dirfd, &ID, put.bytes, &used_ns));
	assert_true(used_ns == read.used_ns);
	assert_false(store_there(dirfd, &ID, put.bytes + 1, &used_ns));
	assert_int_equal(utimensat(dirfd, name_of(), times, 0), 0);
	assert_true(store_there(dirfd, &ID, put.bytes, &used_ns));
	assert_true(used_ns == INT64_C(77000000003));
	fd = openat(dirfd, name_of(), O_RDWR);
	assert_int_equal(ftruncate(fd, (off_t)put.bytes - 1), 0);
	close(fd);
	assert_false(store_there(dirfd, &ID, put.bytes, &used_ns));
	check(store_remove(dirfd, &ID, &err), &err);
	assert_false(store_there(dirfd, &ID, put.bytes, &used_ns));
	made_free(&m);
}

static int begin(void **state)
{
	(void)state;
	srand(5);
	repeat_folder(path, sizeof path, "store");
	dirfd = open(path, O_RDONLY | O_DIRECTORY);
	return dirfd < 0;
}

static int end(void **state)
{
	(void)state;
	unlinkat(dirfd, name_of(), 0);
	unlinkat(dirfd, "ab", AT_REMOVEDIR);
	close(dirfd);
	return rmdir(path);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_extents),   cmocka_unit_test(test_nothing),        cmocka_unit_test(test_version_4),
		cmocka_unit_test(test_forged),    cmocka_unit_test(test_other_versions), cmocka_unit_test(test_version_5),
		cmocka_unit_test(test_version_6), cmocka_unit_test(test_there),
	};

	return cmocka_run_group_tests(tests, begin, end);
}
