/*
 * Spools: what is written is read, from files and pipes. Whatever happens to the bytes of a spool (truncated anywhere,
 * any bit flipped, pieces removed), a reader returns every complete record and reports what is missing.
 */
#include "spool_make.h"
#include "spool_priv.h"

#include <errno.h>
#include <fcntl.h>
#include <nettle/sha2.h>
#include <pthread.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <xxhash.h>

#include "clock.h"
#include "io.h"
#include "no_sync.h"

static void test_round(void **state)
{
	struct spool_totals said, end;
	struct spool_head head, all = {0};
	struct spool_record record;
	struct spool_reader *r;
	struct spool_writer *w;
	struct spool_tail tail;
	struct err err = ERR_INIT;
	uint8_t sha[32], at[MAKE_SIZE_MAX], *bytes = malloc(1 << 20);
	struct sha256_ctx sum;
	size_t n = 0;
	int pipes[2];

	make_head(&head);
	strcpy(head.model, "T\x1b[31m\xc3\xa4\xff"); /* what a device may claim */
	assert_int_equal(spool_create(make_path, &head, &w, &err), 0);
	for (uint64_t i = 0; i < 200; i++) {
		make_append(w, i);
		if (make_kind(i) == SPOOL_DATA) {
			size_t k = make_payload(i, at);

			memcpy(bytes + n, at, k);
			n += k;
		}
	}
	spool_totals(w, &said);
	sha256_init(&sum);
	sha256_update(&sum, n, bytes);
	sha256_digest(&sum, sizeof(sha), sha);
	assert_memory_equal(said.sha256, sha, 32);
	assert_int_equal(said.bytes, n);
	assert_int_equal(said.records, 200);
	assert_int_equal(said.durable, 0);
	assert_int_equal(spool_sync(w, &err), 0);
	spool_totals(w, &said);
	assert_int_equal(said.durable, n);
	assert_int_equal(spool_end(w, &err), 0);
	assert_int_equal(spool_append(w, SPOOL_DATA, 0, 0, "x", 1, &err), -ERR_INTERNAL); /* nothing after END */
	spool_writer_free(w);
	free(bytes);

	/* Through a pipe that provides a byte, then some, then all. */
	bytes = make_read(make_path, &n);
	assert_int_equal(pipe(pipes), 0);
	assert_int_equal(fcntl(pipes[1], F_SETPIPE_SZ, 1 << 20) >= (int)n, 1);
	assert_int_equal(write(pipes[1], bytes, n), n);
	close(pipes[1]);
	free(bytes);
	err = ERR_INIT;
	assert_int_equal(spool_open(pipes[0], "-", &r, &err), 0);
	all = *spool_reader_head(r);
	assert_memory_equal(all.id, head.id, 16);
	assert_string_equal(all.model, "T?[31m\xc3\xa4?");
	assert_string_equal(all.serial, "20370043");
	assert_string_equal(all.port, "1-2.4");
	assert_string_equal(all.profile, head.profile);
	assert_int_equal(all.vendor, 0x19a2);
	assert_int_equal(all.product, 0x5001);
	assert_int_equal(all.utc_ns, head.utc_ns);
	assert_int_equal(all.monotonic_ns, head.monotonic_ns);
	for (uint64_t i = 0; i < 200; i++) {
		assert_int_equal(spool_next(r, &record, &err), 1);
		assert_int_equal(record.seq, i);
		make_check(&record);
	}
	assert_int_equal(spool_next(r, &record, &err), 1);
	assert_int_equal(spool_totals_read(&record, &end, &err), 0);
	assert_int_equal(end.bytes, said.bytes);
	assert_int_equal(end.records, 200);
	assert_int_equal(end.transfers, said.transfers);
	assert_int_equal(end.events, said.events);
	assert_memory_equal(end.sha256, sha, 32);
	assert_int_equal(spool_next(r, &record, &err), 0);
	assert_int_equal(spool_next(r, &record, &err), 0);
	spool_tail(r, &tail);
	assert_true(tail.ended && !tail.torn && !tail.head_damaged && tail.whole == n);
	spool_reader_free(r);
	spool_head_clear(&head);
}

static void test_large(void **state)
{
	struct spool_head head = {0};
	struct spool_writer *w;
	struct spool_reader *r;
	struct spool_record record;
	struct err err = ERR_INIT;
	uint8_t *at = malloc(SPOOL_PAYLOAD_MAX + 1);

	memset(at, 'a', SPOOL_PAYLOAD_MAX);
	assert_int_equal(spool_create(make_path, &head, &w, &err), 0);
	assert_int_equal(spool_append(w, SPOOL_DATA, 0, 1, at, SPOOL_PAYLOAD_MAX, &err), 0);
	assert_int_equal(spool_append(w, SPOOL_DATA, 0, 2, at, 0, &err), 0);
	assert_int_equal(spool_append(w, SPOOL_DATA, 0, 2, at, SPOOL_PAYLOAD_MAX + 1, &err), -ERR_INTERNAL);
	spool_writer_free(w);
	err = ERR_INIT;
	assert_int_equal(spool_open(open(make_path, O_RDONLY), make_path, &r, &err), 0);
	assert_true(spool_reader_head(r)->utc_ns > 0 && spool_reader_head(r)->monotonic_ns > 0);
	assert_int_equal(spool_next(r, &record, &err), 1);
	assert_int_equal(record.size, SPOOL_PAYLOAD_MAX);
	assert_memory_equal(record.at, at, SPOOL_PAYLOAD_MAX);
	assert_int_equal(spool_next(r, &record, &err), 1);
	assert_int_equal(record.size, 0);
	assert_int_equal(spool_next(r, &record, &err), 0);
	spool_reader_free(r);
	free(at);
}

static void test_no_overwriting(void **state)
{
	struct spool_head head = {0}, same;
	struct spool_writer *w;
	struct err err = ERR_INIT;
	uint8_t *before, *after;
	size_t n, m;

	make_spool(make_path, 5, false);
	before = make_read(make_path, &n);
	assert_int_equal(spool_create(make_path, &head, &w, &err), -ERR_USAGE);
	assert_string_equal(err.file, make_path);
	after = make_read(make_path, &m);
	assert_true(n == m && !memcmp(before, after, n));
	free(before);
	free(after);
	/* Nor while another process writes: the lock is released with its holder. */
	err = ERR_INIT;
	assert_int_equal(spool_continue(make_path, &same, &w, &err), 0);
	spool_head_clear(&same);
	struct spool_writer *second;

	err = ERR_INIT;
	assert_int_equal(spool_continue(make_path, &same, &second, &err), -ERR_BUSY);
	spool_writer_free(w);
}

/* Truncated after any byte: every complete record, and the number of incomplete bytes; continuing gives a spool without
 * a gap. */
static void test_truncations(void **state)
{
	struct make_seen seen;
	struct err err = ERR_INIT;
	uint64_t last = 0, ends[24] = {0}, whole = 8192;
	size_t n, records = 0;
	uint8_t *bytes;

	make_spool(make_path, 20, true);
	bytes = make_read(make_path, &n);
	make_read_all(make_path, 20, &seen);
	assert_int_equal(seen.records, 20);
	for (size_t i = 0, at = 8192; i < 21; i++) {
		uint8_t payload[MAKE_SIZE_MAX];

		at += 40 + (i < 20 ? make_payload(i, payload) : 64);
		ends[i] = at;
	}
	assert_int_equal(ends[20], n);
	for (size_t cut = 0; cut <= n; cut += cut < 8100 ? 97 : 1) {
		make_write(make_other, bytes, cut);
		make_read_all(make_other, 20, &seen);
		if (cut < 4096) {
			assert_int_equal(seen.error, -ERR_TRUNCATED);
			continue;
		}
		for (records = 0, whole = cut < 8192 ? 4096 : 8192; records < 21 && ends[records] <= cut; records++)
			whole = ends[records];
		assert_int_equal(seen.error, 0);
		assert_int_equal(seen.damages, 0);
		assert_int_equal(seen.records + seen.others, records);
		assert_int_equal(seen.tail.whole, whole);
		assert_int_equal(seen.tail.torn, cut - whole);
		assert_int_equal(seen.tail.ended, cut == n);
		last = records;
	}
	assert_int_equal(last, 21);
	free(bytes);
	(void)err;
}

static void test_continue(void **state)
{
	struct make_seen seen;
	size_t n;
	uint8_t *bytes;

	make_spool(make_path, 20, false);
	bytes = make_read(make_path, &n);
	no_sync();
	for (size_t cut = 4096; cut <= n; cut += cut < 8192 ? 512 : 13) {
		struct spool_head head;
		struct spool_writer *w;
		struct spool_totals totals;
		struct err err = ERR_INIT;
		uint64_t there;

		make_write(make_other, bytes, cut);
		make_read_all(make_other, 20, &seen);
		there = seen.records;
		assert_int_equal(spool_continue(make_other, &head, &w, &err), 0);
		assert_string_equal(head.serial, "20370043");
		assert_int_equal(head.profile_size, strlen(head.profile));
		spool_head_clear(&head);
		spool_totals(w, &totals);
		assert_int_equal(totals.durable, totals.bytes);
		assert_int_equal(totals.records, there + 2);
		assert_int_equal(spool_append(w, SPOOL_DATA, 0, 5, "more", 4, &err), 0);
		assert_int_equal(spool_end(w, &err), 0);
		spool_writer_free(w);
		make_read_all(make_other, there, &seen);
		assert_int_equal(seen.damages, 0);
		assert_int_equal(seen.tail.torn, 0);
		assert_true(seen.tail.ended);
		assert_int_equal(seen.records, there);
		assert_int_equal(seen.others, 4); /* continued, CLOCK, more, END */
	}
	free(bytes);
	/* A spool with END cannot be continued. */
	struct spool_head head;
	struct spool_writer *w;
	struct err err = ERR_INIT;

	assert_int_equal(spool_continue(make_other, &head, &w, &err), -ERR_USAGE);
}

/* Any bit of any byte: all records except that one, and the offset is reported. */
static void test_flips(void **state)
{
	struct make_seen seen;
	size_t n;
	uint8_t *bytes;

	make_spool(make_path, 20, true);
	bytes = make_read(make_path, &n);
	for (size_t at = 0; at < n; at += at < 8192 ? 61 : 1) {
		uint64_t place = 8192, hit = 0;
		uint8_t payload[MAKE_SIZE_MAX];

		bytes[at] ^= (uint8_t)(1u << at % 8);
		make_write(make_other, bytes, n);
		bytes[at] ^= (uint8_t)(1u << at % 8);
		make_read_all(make_other, 20, &seen);
		assert_int_equal(seen.error, 0);
		if (at < 8192) { /* the other head is used */
			assert_int_equal(seen.records, 20);
			assert_int_equal(seen.tail.head_damaged, at < 4096);
			continue;
		}
		for (; hit < 20; hit++) {
			size_t k = 40 + make_payload(hit, payload);

			if (at < place + k)
				break;
			place += k;
		}
		if (hit == 20) { /* END: like an incomplete record */
			assert_int_equal(seen.records, 20);
			assert_int_equal(seen.tail.torn, n - place);
			assert_false(seen.tail.ended);
			continue;
		}
		assert_int_equal(seen.records, 19);
		assert_int_equal(seen.damages, 1);
		assert_int_equal(seen.first_damage, place);
		assert_int_equal(seen.skipped, 40 + make_payload(hit, payload));
		assert_true(seen.tail.ended);
	}
	free(bytes);
}

/* Pieces removed, inserted, zeroed, one after another: no record that is returned is wrong (make_check), and untouched
 * records are returned. */
static void test_pieces(void **state)
{
	enum { RECORDS = 60 };
	uint64_t starts[RECORDS + 2], x = 88172645463325252u;
	struct make_seen seen;
	size_t n;
	uint8_t *bytes, *copy;

	make_spool(make_path, RECORDS, true);
	bytes = make_read(make_path, &n);
	copy = malloc(2 * n);
	starts[0] = 8192;
	for (uint64_t i = 0; i < RECORDS; i++) {
		uint8_t payload[MAKE_SIZE_MAX];

		starts[i + 1] = starts[i] + 40 + make_payload(i, payload);
	}
	for (int round = 0; round < 600; round++) {
		size_t from, k, size = n, untouched = 0;

		x ^= x << 13, x ^= x >> 7, x ^= x << 17;
		from = 8192 + x % (n - 8192);
		k = 1 + (x >> 32) % 3000;
		k = k < n - from ? k : n - from;
		memcpy(copy, bytes, n);
		if (round % 3 == 0) {
			memset(copy + from, 0, k);
		} else if (round % 3 == 1) {
			memmove(copy + from, copy + from + k, n - from - k);
			size -= k;
		} else {
			memmove(copy + from + k, copy + from, n - from);
			memset(copy + from, 'R', k);
			size += k;
		}
		for (uint64_t i = 0; i < RECORDS; i++)
			untouched += starts[i + 1] <= from || starts[i] >= from + (round % 3 < 2 ? k : 0);
		make_write(make_other, copy, size);
		make_read_all(make_other, RECORDS, &seen);
		assert_int_equal(seen.error, 0);
		/* If bytes are missing from a payload (1), its length covers complete records behind it, which count. */
		assert_true(seen.records <= RECORDS && seen.records >= untouched);
		assert_true(seen.records == RECORDS || seen.damages || seen.tail.torn);
	}
	free(bytes);
	free(copy);
}

/* A record that was removed cleanly is missed by its number; one that is repeated is damage. */
static void test_missing(void **state)
{
	uint8_t payload[MAKE_SIZE_MAX], *bytes, *copy;
	struct make_seen seen;
	size_t n, from = 8192, k;

	make_spool(make_path, 10, true);
	bytes = make_read(make_path, &n);
	copy = malloc(2 * n);
	for (uint64_t i = 0; i < 4; i++)
		from += 40 + make_payload(i, payload);
	k = 40 + make_payload(4, payload);
	memcpy(copy, bytes, n);
	memmove(copy + from, copy + from + k, n - from - k);
	make_write(make_other, copy, n - k);
	make_read_all(make_other, 10, &seen);
	assert_int_equal(seen.records, 9);
	assert_int_equal(seen.damages, 1);
	assert_int_equal(seen.first_damage, from);
	assert_int_equal(seen.skipped, 0);
	memcpy(copy, bytes, n);
	memmove(copy + from + k, copy + from, n - from);
	make_write(make_other, copy, n + k);
	make_read_all(make_other, 10, &seen);
	assert_int_equal(seen.records, 10);
	assert_int_equal(seen.damages, 1);
	assert_int_equal(seen.skipped, k);
	assert_true(seen.tail.ended);
	free(bytes);
	free(copy);
}

/* Garbage at the end, zeros as from file systems, and a spool after a spool are incomplete ends. */
static void test_tails(void **state)
{
	struct make_seen seen;
	size_t n, m;
	uint8_t *bytes, *inner, *copy;

	make_spool(make_path, 10, false);
	bytes = make_read(make_path, &n);
	copy = calloc(1, n + 100000);
	memcpy(copy, bytes, n);
	make_write(make_other, copy, n + 100000);
	make_read_all(make_other, 10, &seen);
	assert_int_equal(seen.records, 10);
	assert_int_equal(seen.damages, 0);
	assert_int_equal(seen.tail.torn, 100000);
	free(bytes);
	free(copy);
	unlink(make_other);

	/* A capture of a spool: nothing of the inner one is a record of the outer one, even if the outer one is damaged. */
	struct spool_head head = {0};
	struct spool_writer *w;
	struct err err = ERR_INIT;

	inner = make_read(make_path, &m);
	assert_int_equal(spool_create(make_other, &head, &w, &err), 0);
	assert_int_equal(spool_append(w, SPOOL_DATA, SPOOL_SHORT, 0, inner, m, &err), 0);
	assert_int_equal(spool_end(w, &err), 0);
	spool_writer_free(w);
	bytes = make_read(make_other, &n);
	bytes[8192 + 5] ^= 1;
	make_write(make_other, bytes, n);
	make_read_all(make_other, 0, &seen);
	assert_int_equal(seen.others, 1); /* END */
	assert_int_equal(seen.skipped, 40 + m);
	free(bytes);
	free(inner);
}

/* The check of a head as in spool.md. */
static void set_check(uint8_t *head, size_t size)
{
	uint64_t check;

	memset(head + 16, 0, 8);
	check = XXH3_64bits(head, size);
	for (int i = 0; i < 8; i++)
		head[16 + i] = (uint8_t)(check >> 8 * i);
}

static void test_heads(void **state)
{
	static const char text[] = "this is a letter, and no spool; it is long enough to be one, though";
	struct make_seen seen;
	size_t n;
	uint8_t *bytes;
	struct spool_head head = {0};
	struct spool_writer *w;
	struct err err = ERR_INIT;

	make_write(make_other, text, sizeof(text));
	make_read_all(make_other, 0, &seen);
	assert_int_equal(seen.error, -ERR_INPUT);
	make_write(make_other, "x", 1);
	make_read_all(make_other, 0, &seen);
	assert_int_equal(seen.error, -ERR_INPUT);
	make_write(make_other, "", 0);
	make_read_all(make_other, 0, &seen);
	assert_int_equal(seen.error, -ERR_TRUNCATED);
	make_spool(make_path, 3, true);
	bytes = make_read(make_path, &n);
	bytes[100] ^= 1;
	bytes[4096 + 100] ^= 1;
	make_write(make_other, bytes, n);
	make_read_all(make_other, 0, &seen);
	assert_int_equal(seen.error, -ERR_INPUT);
	/* A newer version, in both heads; in only one of them it is damage. */
	bytes[100] ^= 1;
	bytes[4096 + 100] ^= 1;
	bytes[8] = 2;
	set_check(bytes, 4096);
	memcpy(bytes + 4096, bytes, 4096);
	make_write(make_other, bytes, n);
	make_read_all(make_other, 0, &seen);
	assert_int_equal(seen.error, -ERR_VERSION);
	bytes[8] = 1;
	set_check(bytes, 4096);
	make_write(make_other, bytes, n);
	make_read_all(make_other, 3, &seen);
	assert_int_equal(seen.error, 0);
	free(bytes);
	unlink(make_other);
	/* A profile of the largest size, and one byte more. */
	head.profile_size = SPOOL_PROFILE_MAX + 1;
	head.profile = calloc(1, head.profile_size + 1);
	assert_int_equal(spool_create(make_other, &head, &w, &err), -ERR_LIMIT);
	assert_int_equal(access(make_other, F_OK), -1);
	head.profile_size--;
	err = ERR_INIT;
	assert_int_equal(spool_create(make_other, &head, &w, &err), 0);
	spool_writer_free(w);
	make_read_all(make_other, 0, &seen);
	assert_int_equal(seen.error, 0);
	/* Truncated in any of its bytes. */
	bytes = make_read(make_other, &n);
	for (size_t cut = 0; cut < n / 2; cut += 4095) {
		make_write(make_other, bytes, cut);
		make_read_all(make_other, 0, &seen);
		assert_int_equal(seen.error, -ERR_TRUNCATED);
	}
	free(bytes);
	spool_head_clear(&head);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(test_##name, make_setup, make_teardown)
	const struct CMUnitTest tests[] = {
		TEST(round), TEST(large),  TEST(no_overwriting), TEST(truncations), TEST(continue),
		TEST(flips), TEST(pieces), TEST(missing),        TEST(tails),       TEST(heads),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
