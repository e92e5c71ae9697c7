/*
 * Packs: a domain in one has the bytes that it has in a file of the store, and becomes such a file again; every damage, every cut
 * and every call that fails is an error with the name of the pack.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>
#include <cmocka.h>
#include <xxhash.h>

#include "err.h"
#include "io.h"
#include "made.h"
#include "store_format.h"
#include "store_pack.h"
#include "store_pack_format.h"
#include "repeat.h"

enum { MOST = 200, ROOM = 1 << 20 };
static const struct digest OF = {77, 78};
static char path[64];
static int dirfd = -1;

static void check(int r, const struct err *err)
{
	if (r)
		fail_msg("%d: %s", r, err->message);
}

struct packed {
	struct made made[MOST];
	struct store_pack_entry want[MOST];
	size_t n;
	int fd;
	uint64_t bytes;
};

static void make_one(struct packed *p, size_t i)
{
	const uint32_t n = rand() % 9 ? 3 + (uint32_t)rand() % 40 : 0;
	const int32_t low[3] = {-100, rand() % 1000, 5}, high[3] = {100, rand() % 2 ? 2000 : 1 << 20, 5 + rand() % 100000};
	struct made *m = &p->made[i];
	struct store_pack_entry *e = &p->want[i];

	if (n) {
		made_domain(n, (uint32_t)rand() % (n + 1), 1 + (uint32_t)rand() % 90, low, high, m);
	} else {
		made_domain(0, 0, 0, low, high, m);
	}
	m->beside.proof = m->proof;
	m->beside.proof_size = (size_t)rand() % (MADE_PROOF + 1);
	m->d.digest = (struct digest){(uint64_t)rand(), i};
	m->d.own_digest = (struct digest){i, (uint64_t)rand()};
	m->d.counts.used = (uint64_t)rand();
	m->d.nhull = (uint32_t)rand();
	for (unsigned k = 0; k < 6; k++)
		m->d.box[k] = rand() - rand();
	*e = (struct store_pack_entry){.id = {{(uint64_t)(rand() % 3) << 56, i}, {7, (uint64_t)rand()}},
				       .flat = rand() % 7 == 0,
				       .own = m->d.counts.used,
				       .nvertex = m->d.nvertex,
				       .nopen = m->d.nopen,
				       .ntriangle = m->d.ntriangle,
				       .nedges = m->d.nedges,
				       .nhull = m->d.nhull,
				       .digest = m->d.digest,
				       .own_digest = m->d.own_digest};
	memcpy(e->box, m->d.box, sizeof e->box);
	snprintf(e->region, sizeof e->region, "region %zu%.*s", i, rand() % 50,
		 "..................................................");
}

static int temp_file(void)
{
	int fd = memfd_create("pack", MFD_CLOEXEC);

	assert_true(fd >= 0);
	return fd;
}

static int write_pack(struct packed *p, struct err *err)
{
	struct store_packer *k = NULL;
	struct store_front f;
	int r = store_packer_new(p->fd, "pack", OF, &k, err);

	for (size_t i = 0; !r && i < p->n; i++) {
		const struct store_pack_entry *e = &p->want[i];

		r = store_packer_add(k, e->region, &e->id, &p->made[i].beside, e->flat, &p->made[i].d, &f, err);
		if (!r)
			p->want[i].bytes = f.bytes;
	}
	if (!r)
		r = store_packer_finish(k, &p->bytes, err);
	store_packer_free(k);
	return r;
}

static void make(struct packed *p, size_t n)
{
	struct err err = ERR_INIT;

	memset(p, 0, sizeof *p);
	p->n = n;
	for (size_t i = 0; i < n; i++)
		make_one(p, i);
	p->fd = temp_file();
	check(write_pack(p, &err), &err);
}

static void done(struct packed *p)
{
	for (size_t i = 0; i < p->n; i++)
		made_free(&p->made[i]);
	close(p->fd);
}

static void same_entry(const struct store_pack_entry *a, const struct store_pack_entry *b)
{
	assert_string_equal(a->region, b->region);
	assert_memory_equal(&a->id, &b->id, sizeof a->id);
	assert_true(a->bytes == b->bytes && a->own == b->own && a->flat == b->flat && a->nhull == b->nhull);
	assert_true(a->nvertex == b->nvertex && a->nopen == b->nopen && a->ntriangle == b->ntriangle && a->nedges == b->nedges);
	assert_memory_equal(a->box, b->box, sizeof a->box);
	assert_true(digest_equal(a->digest, b->digest) && digest_equal(a->own_digest, b->own_digest));
}

static void in_pack(int fd, uint64_t at, const void *want, size_t n)
{
	uint8_t *got = malloc(n);

	assert_int_equal(pread(fd, got, n, (off_t)at), n);
	assert_memory_equal(got, want, n);
	free(got);
}

/* Its file in the store, if it is written there by store_put, or adopted: the same. */
static void check_file(const struct packed *p, const struct store_pack *k, size_t i, const struct store_pack_entry *e)
{
	uint8_t *file = malloc(e->bytes + 1), small[600];
	struct err err = ERR_INIT;
	struct store_front f, g;
	char name[STORE_NAME];

	store_name(&e->id, name);
	check(store_put(dirfd, &e->id, &p->made[i].beside, &p->made[i].d, &f, &err), &err);
	for (unsigned again = 0; again < 2; again++) {
		int fd = openat(dirfd, name, O_RDONLY);

		assert_int_equal(pread(fd, file, e->bytes + 1, 0), e->bytes);
		close(fd);
		in_pack(k->fd, e->at, file, e->bytes);
		check(store_remove(dirfd, &e->id, &err), &err);
		if (again || e->flat)
			break;
		check(store_pack_adopt(k, e, dirfd, small, sizeof small, &g, &err), &err);
		assert_true(g.payload == f.payload && g.bytes == f.bytes);
	}
	free(file);
}

static void check_pack(const struct packed *p)
{
	struct store_pack_entry *e = calloc(MOST, sizeof *e), one;
	struct err err = ERR_INIT;
	struct store_pack k;

	check(store_pack_open(p->fd, "pack", &k, &err), &err);
	assert_true(k.n == p->n && digest_equal(k.of, OF) && k.bytes == p->bytes);
	check(store_pack_entries(&k, 0, p->n, e, &err), &err);
	for (size_t i = 0; i < p->n; i++) {
		size_t size = store_pack_memory(&e[i]);
		uint8_t *memory = malloc(size + 1);
		struct store_front f;
		struct mesh_domain d;

		same_entry(&e[i], &p->want[i]);
		check(store_pack_entries(&k, i, 1, &one, &err), &err);
		same_entry(&one, &e[i]);
		check(store_pack_head(&k, &e[i], &f, &err), &err);
		assert_int_equal(f.whole, size);
		memory[size] = 0x77;
		check(store_pack_get(&k, &e[i], memory, size, &d, &err), &err);
		assert_int_equal(memory[size], 0x77);
		made_same(&d, &p->made[i].d);
		free(memory);
		check_file(p, &k, i, &e[i]);
	}
	free(e);
}

static void test_random(void **state)
{
	static struct packed p;

	(void)state;
	for (uint64_t i = 0; i < repeat_cases(30); i++) {
		srand((unsigned)(i + repeat_first()));
		make(&p, i < 4 ? i : (size_t)rand() % MOST);
		check_pack(&p);
		done(&p);
	}
}

static void add(struct store_packer *k, struct packed *p, size_t i)
{
	const struct store_pack_entry *e = &p->want[i];
	struct err err = ERR_INIT;
	struct store_front f;

	check(store_packer_add(k, e->region, &e->id, &p->made[i].beside, e->flat, &p->made[i].d, &f, &err), &err);
}

static int fail_ftruncate(int fd, off_t size)
{
	(void)fd;
	(void)size;
	errno = ENOSPC;
	return -1;
}

/* What was added and dropped leaves no byte. */
static void test_dropped(void **state)
{
	static struct packed p;

	(void)state;
	srand(11);
	make(&p, 20);
	for (size_t kept = 0; kept <= p.n; kept++) {
		uint8_t *bytes = malloc(p.bytes);
		struct packed q = {.fd = temp_file()};
		struct store_packer *k = NULL;
		struct err err = ERR_INIT;
		struct io_table full = io_system;

		check(store_packer_new(q.fd, "pack", OF, &k, &err), &err);
		for (size_t i = 0; i < kept; i++)
			add(k, &p, i);
		for (size_t i = 0; i < 3; i++)
			add(k, &p, (kept + 7 * i) % p.n);
		assert_int_equal(store_packer_domains(k), kept + 3);
		full.ftruncate = fail_ftruncate;
		io = &full;
		assert_int_equal(store_packer_keep(k, kept, &err), -ERR_NOSPACE);
		assert_string_equal(err.file, "pack");
		io = &io_system;
		err = ERR_INIT;
		check(store_packer_keep(k, kept, &err), &err);
		for (size_t i = kept; i < p.n; i++)
			add(k, &p, i);
		check(store_packer_finish(k, &q.bytes, &err), &err);
		assert_int_equal(q.bytes, p.bytes);
		assert_int_equal(pread(p.fd, bytes, p.bytes, 0), p.bytes);
		in_pack(q.fd, 0, bytes, p.bytes);
		assert_int_equal(lseek(q.fd, 0, SEEK_END), p.bytes);
		store_packer_free(k);
		free(bytes);
		close(q.fd);
	}
	done(&p);
}

/* Reads all of it. Returns what a reader says. */
static int read_all(int fd, struct err *err)
{
	struct store_pack_entry e;
	uint8_t small[600];
	struct store_pack k;
	int r = store_pack_open(fd, "pack", &k, err);

	for (uint64_t i = 0; !r && i < k.n; i++) {
		struct mesh_domain d;
		struct store_front f;
		void *memory;

		r = store_pack_entries(&k, i, 1, &e, err);
		if (r)
			return r;
		memory = malloc(store_pack_memory(&e) + 1);
		r = store_pack_get(&k, &e, memory, store_pack_memory(&e), &d, err);
		free(memory);
		if (!r && !e.flat) {
			r = store_pack_adopt(&k, &e, dirfd, small, sizeof small, &f, err);
			if (!r)
				check(store_remove(dirfd, &e.id, err), err);
		}
	}
	return r;
}

static void refused(int r, const struct err *err)
{
	assert_true(r == -ERR_CORRUPT || r == -ERR_VERSION || r == -ERR_TRUNCATED);
	assert_string_equal(err->file, "pack");
}

/* The zeros between arrays and domains are no part of anything. */
static bool is_padding(const struct packed *p, uint64_t at)
{
	struct err err = ERR_INIT;
	struct store_pack k;

	check(store_pack_open(p->fd, "pack", &k, &err), &err);
	if (at < STORE_PACK_HEAD || at >= k.index)
		return false;
	for (size_t i = 0; i < p->n; i++) {
		uint8_t header[STORE_HEADER];
		struct store_pack_entry e;
		struct store_header h;
		struct store_extent x;
		struct store_front f = {0};
		uint64_t in;

		check(store_pack_entries(&k, i, 1, &e, &err), &err);
		if (at < e.at || at >= e.at + e.bytes)
			continue;
		in = at - e.at;
		assert_int_equal(pread(p->fd, header, sizeof header, (off_t)e.at), sizeof header);
		assert_int_equal(store_header_unpack(header, &e.id, &f, &h), STORE_HEADER_GOOD);
		x = store_extent_of(&f.domain, &h.code, f.beside.proof_size);
		/* Nobody reads the proof of one that is not for a store. */
		return in >= STORE_HEADER &&
		       ((in >= STORE_HEADER + (e.flat ? 0 : f.beside.proof_size) && in < x.open_at) ||
			(in >= x.closed_at + x.closed && in < x.triangle_at) || in >= x.triangle_at + x.triangle + x.edges);
	}
	return true;
}

static void test_damage(void **state)
{
	static struct packed p;

	(void)state;
	srand(5);
	make(&p, 6);
	for (uint64_t at = 0; at < p.bytes; at += repeat_step(7)) {
		struct err err = ERR_INIT;
		bool padding = is_padding(&p, at);
		uint8_t was, now;
		int r;

		assert_int_equal(pread(p.fd, &was, 1, (off_t)at), 1);
		now = (uint8_t)(was ^ 1 << at % 8);
		assert_int_equal(pwrite(p.fd, &now, 1, (off_t)at), 1);
		r = read_all(p.fd, &err);
		if (padding)
			check(r, &err);
		else
			refused(r, &err);
		assert_int_equal(pwrite(p.fd, &was, 1, (off_t)at), 1);
	}
	for (uint64_t size = 0; size < p.bytes; size += 1 + repeat_step(70) / 10) {
		struct err err = ERR_INIT;
		int fd = memfd_create("cut", MFD_CLOEXEC);
		uint8_t *all = malloc(p.bytes);

		assert_int_equal(pread(p.fd, all, p.bytes, 0), p.bytes);
		assert_int_equal(write(fd, all, size), size);
		refused(read_all(fd, &err), &err);
		free(all);
		close(fd);
	}
	check_pack(&p);
	done(&p);
}

static void seal(uint8_t *bytes, size_t size, uint64_t seed)
{
	uint64_t sum = XXH3_64bits_withSeed(bytes, size - 8, seed);

	memcpy(bytes + size - 8, &sum, 8);
}

/* Valid checksums, but numbers that no pack has. */
static void test_forged(void **state)
{
	static const struct {
		unsigned at, bytes;
		uint64_t value;
	} entry[] = {
		{63, 1, 'x'},         {96, 8, 0},         {96, 8, 65},     {96, 8, UINT64_MAX - 63},
		{104, 8, UINT64_MAX}, {104, 8, 383},      {112, 8, 1},     {120, 4, 1u << 31},
		{124, 4, 5000},       {128, 4, 1u << 31}, {132, 4, 99999}, {136, 4, 1u << 30},
		{140, 4, 2},          {144, 4, 9},        {168, 8, 9},     {184, 8, 9},
		{64, 8, 123},         {80, 8, 123},
	};
	static struct packed p;
	struct store_pack k;
	struct err err = ERR_INIT;

	(void)state;
	srand(7);
	make(&p, 3);
	check(store_pack_open(p.fd, "pack", &k, &err), &err);
	for (size_t i = 0; i < sizeof entry / sizeof entry[0]; i++) {
		uint8_t was[STORE_PACK_ENTRY], now[STORE_PACK_ENTRY];

		err_clear(&err);
		assert_int_equal(pread(p.fd, was, sizeof was, (off_t)k.index), sizeof was);
		memcpy(now, was, sizeof now);
		memcpy(now + entry[i].at, &entry[i].value, entry[i].bytes);
		seal(now, sizeof now, k.index);
		assert_int_equal(pwrite(p.fd, now, sizeof now, (off_t)k.index), sizeof now);
		refused(read_all(p.fd, &err), &err);
		assert_int_equal(pwrite(p.fd, was, sizeof was, (off_t)k.index), sizeof was);
	}
	/* Head and end of a later version; an end with other counts, or of another mesh. */
	for (unsigned i = 0; i < 6; i++) {
		static const unsigned field[6] = {4, 4, 8, 24, 32, 32};
		const uint64_t at = i ? p.bytes - STORE_PACK_END : 0;
		uint8_t was[STORE_PACK_END], now[STORE_PACK_END];

		err_clear(&err);
		assert_int_equal(pread(p.fd, was, sizeof was, (off_t)at), sizeof was);
		memcpy(now, was, sizeof now);
		now[field[i] + (i == 5)]++;
		seal(now, sizeof now, at);
		assert_int_equal(pwrite(p.fd, now, sizeof now, (off_t)at), sizeof now);
		refused(read_all(p.fd, &err), &err);
		assert_int_equal(err.code, i < 2 ? ERR_VERSION : ERR_CORRUPT);
		assert_int_equal(pwrite(p.fd, was, sizeof was, (off_t)at), sizeof was);
	}
	check_pack(&p);
	done(&p);
}

/* ---- calls that fail ---- */

static struct io_table failing;
static unsigned calls, fail_at;

static bool fails(void)
{
	return ++calls == fail_at;
}

static ssize_t fail_pwrite(int fd, const void *buf, size_t n, off_t off)
{
	errno = ENOSPC;
	return fails() ? -1 : io_system.pwrite(fd, buf, n, off);
}

static ssize_t fail_pread(int fd, void *buf, size_t n, off_t off)
{
	errno = EIO;
	return fails() ? -1 : io_system.pread(fd, buf, n, off);
}

static int fail_renameat(int from, const char *old, int to, const char *name)
{
	errno = EIO;
	return fails() ? -1 : io_system.renameat(from, old, to, name);
}

static void test_calls(void **state)
{
	static struct packed p;
	int r = 1;

	(void)state;
	srand(9);
	make(&p, 5);
	failing = io_system;
	failing.pwrite = fail_pwrite;
	failing.pread = fail_pread;
	failing.renameat = fail_renameat;
	io = &failing;
	for (fail_at = 1; r; fail_at++) {
		struct err err = ERR_INIT;

		calls = 0;
		assert_int_equal(ftruncate(p.fd, 0), 0);
		r = write_pack(&p, &err);
		assert_true(!r || r == -ERR_NOSPACE);
	}
	assert_true(fail_at > 13);
	r = 1;
	for (fail_at = 1; r; fail_at++) {
		struct err err = ERR_INIT;

		calls = 0;
		r = read_all(p.fd, &err);
		assert_true(!r || r == -ERR_IO || r == -ERR_NOSPACE);
	}
	assert_true(fail_at > 30);
	io = &io_system;
	check_pack(&p);
	done(&p);
}

static int setup(void **state)
{
	(void)state;
	repeat_folder(path, sizeof path, "pack");
	dirfd = open(path, O_RDONLY | O_DIRECTORY);
	return dirfd < 0;
}

static int teardown(void **state)
{
	(void)state;
	close(dirfd);
	repeat_remove(path);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_random), cmocka_unit_test(test_dropped), cmocka_unit_test(test_damage),
		cmocka_unit_test(test_forged), cmocka_unit_test(test_calls),
	};

	return cmocka_run_group_tests(tests, setup, teardown);
}
