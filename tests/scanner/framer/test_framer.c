/* Framers: the same telegrams, counts and bad telegrams however the bytes are divided; nothing is lost without a report. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "err.h"
#include "framer.h"
#include "profile.h"

enum { TEXT = 1 << 20 };

/* The output as text: "offset:bytes" for telegrams, "!reason@offset+size" for bad ones. */
struct seen {
	char *text;
	size_t n;
	int64_t first, last;
	uint64_t stop_at; /* the sink returns 7 at this number */
};

static void note(struct seen *s, const void *bytes, size_t size)
{
	if (s->n + size >= TEXT)
		abort();
	memcpy(s->text + s->n, bytes, size);
	s->n += size;
	s->text[s->n] = '\0';
}

static int sink(void *ctx, const struct telegram *t)
{
	struct seen *s = ctx;
	char head[80];

	note(s, head,
	     (size_t)snprintf(head, sizeof head, t->file_begins || t->file_ends || t->file ? "%llu%s:%llu%s " : "%llu%s:",
			      (unsigned long long)t->offset, t->file_begins ? "<" : "", (unsigned long long)t->file,
			      t->file_ends ? ">" : ""));
	note(s, t->at, t->size);
	note(s, "|", 1);
	s->first = t->first_ns;
	s->last = t->time_ns;
	return s->stop_at && t->number + 1 == s->stop_at ? 7 : 0;
}

static void bad(void *ctx, enum framer_reason why, uint64_t offset, uint64_t size)
{
	char head[80];

	note(ctx, head,
	     (size_t)snprintf(head, sizeof head, "!%s@%llu+%llu|", framer_reason_name(why), (unsigned long long)offset,
			      (unsigned long long)size));
}

static unsigned rnd(unsigned *seed)
{
	return (*seed = *seed * 1664525 + 1013904223) >> 8;
}

/* Pieces of `piece` bytes; 0: of random sizes. A '\1' of `gaps` at an offset: a gap before it. */
static void run(const struct profile *p, const void *bytes, size_t size, size_t piece, unsigned seed, const char *gaps,
		struct seen *s, struct framer_counts *c)
{
	struct framer *f;
	struct err err = ERR_INIT;
	size_t at = 0;

	s->n = 0;
	s->text[0] = '\0';
	assert_int_equal(framer_new(p, sink, s, &f, &err), 0);
	framer_on_bad(f, bad, s);
	while (at < size) {
		size_t n = piece ? piece : rnd(&seed) % 200 + 1;
		uint8_t *copy;

		n = n > size - at ? size - at : n;
		for (size_t i = 1; gaps && i < n; i++)
			if (gaps[at + i])
				n = i;
		if (gaps && gaps[at])
			framer_gap(f);
		copy = malloc(n); /* so that a sanitizer sees an access beyond the end */
		memcpy(copy, (const uint8_t *)bytes + at, n);
		assert_int_equal(framer_feed(f, copy, n, (int64_t)at), 0);
		free(copy);
		at += n;
		framer_counts(f, c);
		assert_int_equal(c->bytes, c->framed + c->skipped + c->held);
	}
	assert_int_equal(framer_end(f), 0);
	framer_counts(f, c);
	assert_int_equal(c->bytes, size);
	assert_int_equal(c->bytes, c->framed + c->skipped);
	assert_int_equal(c->held, 0);
	framer_free(f);
}

static struct seen seen_new(void)
{
	return (struct seen){.text = calloc(1, TEXT)};
}

/* All divisions give `wanted`; NULL: the same as in one piece. */
static void check(const struct profile *p, const void *bytes, size_t size, const char *gaps, const char *wanted)
{
	struct seen whole = seen_new(), cut = seen_new();
	struct framer_counts a, b;

	run(p, bytes, size, size, 0, gaps, &whole, &a);
	if (wanted)
		assert_string_equal(whole.text, wanted);
	for (size_t piece = 0; piece < 20; piece++) {
		run(p, bytes, size, piece < 12 ? piece : 0, (unsigned)piece, gaps, &cut, &b);
		assert_true(whole.n == cut.n && !memcmp(whole.text, cut.text, whole.n));
		assert_memory_equal(&a, &b, sizeof a);
	}
	free(whole.text);
	free(cut.text);
}

static struct profile kind(enum profile_framer framer, uint32_t most)
{
	struct profile p = {.framer = framer, .telegram_max = most};

	return p;
}

#define CHECK(p, bytes, wanted) check(&(p), bytes, sizeof(bytes) - 1, NULL, wanted)

static void test_stx_etx(void **state)
{
	struct profile p = kind(PROFILE_FRAMER_STX_ETX, 5);

	CHECK(p, "\2abc\3\2\3\2de\3", "0:abc|5:|7:de|");
	CHECK(p, "xx\2a\3yy\3\2b\3zz", "!garbage@0+2|2:a|!garbage@5+3|8:b|!garbage@11+2|");
	CHECK(p, "\2ab\2cd\3\2\2e\3", "!cut@0+3|3:cd|!cut@7+1|8:e|");
	CHECK(p, "\2abcde\3\2abcdef\3\2g\3", "0:abcde|!too-long@7+7|!garbage@14+1|15:g|");
	CHECK(p, "\2abcdefgh\2i\3\2j", "!too-long@0+7|!garbage@7+2|9:i|!unfinished@12+2|");
	CHECK(p, "\2abcde\2f\3", "!cut@0+6|6:f|");
	/* the gap is before b: the incomplete telegram is bad, and what follows does not begin a telegram */
	check(&p, "\2ab\3\2c\3", 7, "\0\0\1\0\0\0\0", "!gap@0+2|!garbage@2+2|4:c|");
}

static void test_line(void **state)
{
	struct profile p = kind(PROFILE_FRAMER_LINE, 5);

	CHECK(p, "abc\r\nde\n\nf", "0:abc|5:de|8:|9:f|");
	CHECK(p, "abcde\r\nabcdef\r\ng\r\n", "0:abcde|!too-long@7+7|!garbage@14+1|15:g|");
	CHECK(p, "abcdefg\nh\n", "!too-long@0+7|!garbage@7+1|8:h|");
	CHECK(p, "abcdef\nh\n", "!too-long@0+7|7:h|");
	CHECK(p, "a\rb\n\r\n", "0:a\rb|4:|");
	check(&p, "1 2\n3 4\n5 6\n", 12, "\0\0\0\0\0\1\0\0\0\0\0\0", "0:1 2|!gap@4+1|!garbage@5+3|8:5 6|");
	/* also at the end of a line, because the beginning of the next one may be missing */
	check(&p, "1 2\n3 4\n5 6\n", 12, "\0\0\0\0\1\0\0\0\0\0\0\0", "0:1 2|!garbage@4+4|8:5 6|");
	p.starts_torn = true;
	CHECK(p, "2 3\n4 5\n", "!garbage@0+4|4:4 5|");
}

static void test_fixed(void **state)
{
	struct profile p = kind(PROFILE_FRAMER_FIXED, 100);

	p.fixed_size = 4;
	CHECK(p, "abcdefghij", "0:abcd|4:efgh|!unfinished@8+2|");
	check(&p, "abcdefghij", 10, "\0\0\0\0\0\0\1\0\0\0", "0:abcd|!gap@4+2|6:ghij|");
	memcpy(p.sync, "SY", 2);
	p.sync_size = 2;
	CHECK(p, "SYabSYcdxxSSYefSYg", "0:SYab|4:SYcd|!garbage@8+3|11:SYef|!unfinished@15+3|");
	CHECK(p, "SYabS", "0:SYab|!unfinished@4+1|");
	CHECK(p, "xxSx", "!garbage@0+4|");
}

static void test_length(void **state)
{
	struct profile p = kind(PROFILE_FRAMER_LENGTH, 10);

	p.length_size = 2;
	p.length_big_endian = true;
	p.length_add = 2;
	CHECK(p, "\0\3abc\0\0\0\1d", "0:\0\3abc|"); /* strcmp compares the first part */
	memcpy(p.sync, "\xaa\x55", 2);
	p.sync_size = 2;
	p.length_offset = 2;
	p.length_size = 1;
	p.length_add = 0;
	CHECK(p, "\xaa\x55\5ab\xaa\x55\6abc", "0:\xaa\x55\5ab|5:\xaa\x55\6abc|");
	CHECK(p, "x\xaa\x55\5ab\xaa\xaa\x55\4c", "!garbage@0+1|1:\xaa\x55\5ab|!garbage@6+1|7:\xaa\x55\4c|");
	CHECK(p, "\xaa\x55\xff\xaa\x55\4c\xaa\x55\1\xaa\x55\12",
	      "!bad-length@0+1|!garbage@1+2|3:\xaa\x55\4c|!bad-length@7+1|!garbage@8+2|!unfinished@10+3|");
	check(&p, "\xaa\x55\5ab\xaa\x55\4c", 9, "\0\0\0\0\1\0\0\0\0", "!gap@0+4|!garbage@4+1|5:\xaa\x55\4c|");
	p.length_size = 4;
	CHECK(p, "\xaa\x55\xff\xff\xff\xff...", "!bad-length@0+1|!garbage@1+8|");
}

static void test_stream(void **state)
{
	struct profile p = kind(PROFILE_FRAMER_STREAM, 10);
	struct seen s = seen_new();
	struct framer_counts c;

	run(&p, "abcdef", 6, 4, 0, NULL, &s, &c);
	assert_string_equal(s.text, "0:abcd|4:ef|");
	free(s.text);
}

/* A sink that wants no more ends the feed; the next feed continues. */
static void test_stop(void **state)
{
	struct profile p = kind(PROFILE_FRAMER_STX_ETX, 5);
	struct seen s = seen_new();
	struct framer_counts c;
	struct framer *f;
	struct err err = ERR_INIT;

	s.stop_at = 2;
	assert_int_equal(framer_new(&p, sink, &s, &f, &err), 0);
	assert_int_equal(framer_feed(f, "\2a\3\2b\3\2c\3", 9, 0), 7);
	assert_int_equal(framer_feed(f, "\2d\3", 3, 0), 0);
	assert_string_equal(s.text, "0:a|3:b|9:d|");
	framer_counts(f, &c);
	assert_true(c.framed == 9 && c.skipped == 3);
	framer_free(f);
	free(s.text);
}

static void test_times(void **state)
{
	struct profile p = kind(PROFILE_FRAMER_STX_ETX, 200);
	struct seen s = seen_new();
	struct framer *f;
	struct err err = ERR_INIT;

	assert_int_equal(framer_new(&p, sink, &s, &f, &err), 0);
	assert_int_equal(framer_feed(f, "\2a\3\2", 4, 100), 0);
	assert_true(s.first == 100 && s.last == 100);
	assert_int_equal(framer_feed(f, "b", 1, 200), 0);
	assert_int_equal(framer_feed(f, "c\3\2", 3, 300), 0);
	assert_true(s.first == 100 && s.last == 300);
	assert_int_equal(framer_feed(f, "d\3\2e", 4, 400), 0);
	assert_true(s.first == 300 && s.last == 400);
	for (int i = 0; i < 150; i++) /* more times than are kept */
		assert_int_equal(framer_feed(f, "x", 1, 500 + i), 0);
	assert_int_equal(framer_feed(f, "\3", 1, 900), 0);
	assert_true(s.first == 400 && s.last == 900);
	framer_free(f);
	free(s.text);
}

/* ---- LAS ---- */

static void put(uint8_t *at, size_t size, uint64_t v)
{
	for (size_t i = 0; i < size; i++)
		at[i] = (uint8_t)(v >> 8 * i);
}

/* A file with n records of format 0 and e EVLRs of 100 bytes; returns its size. */
static size_t las(uint8_t *at, unsigned minor, uint64_t n, unsigned e)
{
	size_t head = minor == 4 ? 375 : minor == 3 ? 235 : 227, size = head + 54 + n * 20;

	memset(at, 'p', size + e * 160);
	memset(at, 0, head);
	memcpy(at, "LASF", 4);
	at[24] = 1;
	at[25] = (uint8_t)minor;
	put(at + 94, 2, head);
	put(at + 96, 4, head + 54);
	put(at + 105, 2, 20);
	put(at + (minor == 4 ? 247 : 107), minor == 4 ? 8 : 4, n);
	if (e && minor == 4) {
		put(at + 235, 8, size + 10);
		put(at + 243, 4, e);
		size += 10;
	}
	for (unsigned i = 0; i < e; i++, size += 160)
		put(at + size + 20, 8, 100);
	return size;
}

static void test_las(void **state)
{
	struct profile p = kind(PROFILE_FRAMER_LAS, 1);
	uint8_t *bytes = calloc(1, 700000);
	struct seen s = seen_new();
	struct framer_counts c;
	size_t n = 0;

	for (unsigned minor = 0; minor < 5; minor++) {
		n += las(bytes + n, minor, minor * 100, minor == 4 ? 3 : 0);
		if (minor == 2) {
			memcpy(bytes + n, "LAS garbage LASF but none, long enough to be looked at", 54);
			memset(bytes + n + 54, 'x', 400);
			n += 454;
		}
	}
	n += las(bytes + n, 2, 9000, 0); /* more than a piece */
	n += las(bytes + n, 4, 3269, 0); /* 27 bytes less than a piece, so that EVLR heads do not fit */
	n += las(bytes + n, 4, 3268, 2);
	check(&p, bytes, n, NULL, NULL);
	run(&p, bytes, n, n, 0, NULL, &s, &c);
	assert_int_equal(c.files, 8);
	assert_int_equal(c.by[FRAMER_HEADER], 1);
	assert_int_equal(c.bad, 1);
	assert_int_equal(c.skipped, 454);
	/* a truncated one */
	run(&p, bytes, n - 1, n, 0, NULL, &s, &c);
	assert_int_equal(c.files, 7);
	assert_int_equal(c.by[FRAMER_END], 1);
	free(bytes);
	free(s.text);
}

static void test_las_nonsense(void **state)
{
	static const struct {
		size_t at, size;
		uint64_t v;
	} wrong[] = {
		{24, 1, 2},     {25, 1, 5},           {94, 2, 100}, {96, 4, 50},          {104, 1, 11},
		{104, 1, 0x80}, {105, 2, 19},         {104, 1, 5},  {247, 8, UINT64_MAX}, {247, 8, UINT64_C(1) << 45},
		{235, 8, 10},   {235, 8, UINT64_MAX},
	};
	struct profile p = kind(PROFILE_FRAMER_LAS, 1);
	uint8_t *bytes = calloc(1, 4000);
	struct seen s = seen_new();
	struct framer_counts c;

	for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
		size_t n = las(bytes, 4, 10, 1), good;

		put(bytes + wrong[i].at, wrong[i].size, wrong[i].v);
		good = las(bytes + n, 4, 5, 0);
		check(&p, bytes, n + good, NULL, NULL);
		run(&p, bytes, n + good, n + good, 0, NULL, &s, &c);
		assert_true(c.files == 1 && c.bad == 1 && c.framed == good);
		assert_int_equal(c.by[FRAMER_LAZ], wrong[i].at == 104 && wrong[i].v == 0x80);
	}
	/* an invalid EVLR: the earlier pieces are reported as broken, and the next file is found */
	for (int i = 0; i < 2; i++) {
		size_t n = las(bytes, 4, 10, 2), good;

		put(bytes + n - 160 * (size_t)(2 - i) + 20, 8, UINT64_MAX);
		good = las(bytes + n, 4, 5, 0);
		check(&p, bytes, n + good, NULL, NULL);
		run(&p, bytes, n + good, n + good, 0, NULL, &s, &c);
		assert_true(c.files == 1 && c.bad == 1 && c.by[FRAMER_HEADER] == 1);
	}
	free(bytes);
	free(s.text);
}

/* ---- any bytes ---- */

static void test_random(void **state)
{
	static uint8_t bytes[3000];
	struct profile kinds[8];
	unsigned seed = 5;

	kinds[0] = kind(PROFILE_FRAMER_STX_ETX, 7);
	kinds[1] = kind(PROFILE_FRAMER_LINE, 7);
	kinds[2] = kind(PROFILE_FRAMER_FIXED, 7);
	kinds[2].fixed_size = 7;
	kinds[3] = kinds[2];
	memcpy(kinds[3].sync, "\2\3\2", 3);
	kinds[3].sync_size = 3;
	kinds[4] = kind(PROFILE_FRAMER_LENGTH, 9);
	kinds[4].length_size = 1;
	kinds[5] = kinds[4];
	memcpy(kinds[5].sync, "\2\2\3", 3);
	kinds[5].sync_size = 3;
	kinds[5].length_offset = 4;
	kinds[6] = kind(PROFILE_FRAMER_LAS, 9);
	kinds[7] = kind(PROFILE_FRAMER_STX_ETX, 1);
	for (int turn = 0; turn < 12; turn++) {
		static char gaps[sizeof bytes];

		for (size_t i = 0; i < sizeof bytes; i++) {
			bytes[i] = (uint8_t) "\2\3\n\r\5LASF\1\4"[rnd(&seed) % 11];
			gaps[i] = turn % 2 && rnd(&seed) % 100 == 0;
		}
		for (size_t k = 0; k < 8; k++)
			check(&kinds[k], bytes, sizeof bytes, gaps, NULL);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_stx_etx), cmocka_unit_test(test_line),   cmocka_unit_test(test_fixed),
		cmocka_unit_test(test_length),  cmocka_unit_test(test_stream), cmocka_unit_test(test_stop),
		cmocka_unit_test(test_times),   cmocka_unit_test(test_las),    cmocka_unit_test(test_las_nonsense),
		cmocka_unit_test(test_random),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
