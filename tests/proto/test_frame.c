/* Frames: what is written is read again; every violation of protocol.md has its own error; a descriptor never leaks. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <poll.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "err.h"
#include "frame.h"
#include "frame_pair.h"

static void test_header(void **state)
{
	struct frame_header in = {.length = 0x1234, .request_id = 0x89abcdef, .descriptors = 1}, out;
	static const uint8_t want[16] = {0x41, 0x43, 1, 0, 0x34, 0x12, 0, 0, 0xef, 0xcd, 0xab, 0x89, 1, 0, 0, 0};
	uint8_t bytes[16];
	struct err err = ERR_INIT;

	frame_header_put(&in, bytes);
	assert_memory_equal(bytes, want, 16);
	assert_int_equal(frame_header_get(bytes, &out, &err), 0);
	assert_int_equal(out.length, in.length);
	assert_int_equal(out.request_id, in.request_id);
	assert_int_equal(out.descriptors, 1);
}

static void test_header_bad(void **state)
{
	static const struct {
		unsigned at;
		uint8_t value;
		enum err_code code;
		const char *field;
	} row[] = {
		{0, 0x42, ERR_PROTO, "magic"},     {1, 0, ERR_PROTO, "magic"},          {2, 2, ERR_VERSION, "version"},
		{3, 1, ERR_VERSION, "version"},    {6, 1, ERR_PROTO, "length"},         {7, 4, ERR_PROTO, "length"},
		{12, 2, ERR_PROTO, "descriptors"}, {12, 255, ERR_PROTO, "descriptors"}, {13, 1, ERR_PROTO, "padding"},
		{14, 1, ERR_PROTO, "padding"},     {15, 1, ERR_PROTO, "padding"},
	};
	struct frame_header good = {.length = 10, .request_id = 1}, out;

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		struct err err = ERR_INIT;
		uint8_t bytes[16];

		frame_header_put(&good, bytes);
		bytes[row[i].at] = row[i].value;
		assert_int_equal(frame_header_get(bytes, &out, &err), -(int)row[i].code);
		assert_string_equal(err.field, row[i].field);
	}
}

static void test_length_limit(void **state)
{
	struct frame_header h = {.length = FRAME_BODY_MAX}, out;
	struct err err = ERR_INIT;
	uint8_t bytes[16];

	frame_header_put(&h, bytes);
	assert_int_equal(frame_header_get(bytes, &out, &err), 0);
	h.length++;
	frame_header_put(&h, bytes);
	assert_int_equal(frame_header_get(bytes, &out, &err), -ERR_PROTO);
}

static void test_round_trip(void **state)
{
	unsigned before = open_descriptors();
	struct pair a = pair_new(NULL);
	struct frame_conn *b;
	struct err err = ERR_INIT;

	assert_int_equal(frame_conn_new(a.raw, NULL, &b, &err), 0);
	assert_int_equal(frame_conn_events(a.conn), POLLIN);
	assert_int_equal(frame_conn_send(a.conn, 1, hello(), -1, &err), 0);
	assert_int_equal(frame_conn_send(a.conn, 2, hello(), dup(2), &err), 0);
	assert_int_equal(frame_conn_send(a.conn, 3, hello(), -1, &err), 0);
	assert_int_equal(frame_conn_send(a.conn, 4, hello(), dup(2), &err), 0);
	assert_int_equal(frame_conn_events(a.conn), POLLIN | POLLOUT);
	assert_int_equal(frame_conn_queued(a.conn), 4 * frame_message_size(hello()));
	assert_int_equal(frame_conn_flush(a.conn, &err), 0);
	assert_int_equal(frame_conn_queued(a.conn), 0);
	check_hello(b, 1, false);
	check_hello(b, 2, true);
	check_hello(b, 3, false);
	check_hello(b, 4, true);
	assert_int_equal(recv_result(b, &err), FRAME_E_AGAIN);
	a.raw = -1;
	pair_free(&a);
	assert_int_equal(recv_result(b, &err), FRAME_E_EOF);
	assert_int_equal(frame_conn_send(b, 1, hello(), dup(2), &err), 0);
	assert_int_equal(frame_conn_flush(b, &err), FRAME_E_EOF);
	frame_conn_free(b);
	assert_int_equal(open_descriptors(), before);
}

/* Bytes come one at a time; nothing is returned before the last one. */
static void test_one_byte_writes(void **state)
{
	struct pair p = pair_new(NULL);
	struct err err = ERR_INIT;
	uint8_t bytes[256];
	size_t n = frame_bytes(hello(), 9, 1, bytes);

	for (size_t i = 0; i < n; i++) {
		assert_int_equal(recv_result(p.conn, &err), FRAME_E_AGAIN);
		raw_send(p.raw, bytes + i, 1, i == 0);
	}
	check_hello(p.conn, 9, true);
	pair_free(&p);
}

static void test_every_truncation(void **state)
{
	uint8_t bytes[256];
	size_t n = frame_bytes(hello(), 9, 1, bytes);
	unsigned before = open_descriptors();

	for (size_t cut = 0; cut < n; cut++) {
		struct pair p = pair_new(NULL);
		struct err err = ERR_INIT;

		if (cut > 0)
			raw_send(p.raw, bytes, cut, 1);
		close(p.raw);
		p.raw = -1;
		if (cut == 0) {
			assert_int_equal(recv_result(p.conn, &err), FRAME_E_EOF);
		} else {
			assert_int_equal(recv_result(p.conn, &err), -ERR_PROTO);
			assert_non_null(strstr(err.message, "middle of a frame"));
			assert_int_equal(recv_result(p.conn, &err), -ERR_PROTO); /* stays broken */
		}
		pair_free(&p);
	}
	assert_int_equal(open_descriptors(), before);
}

static void test_descriptors(void **state)
{
	static const struct {
		unsigned said, sent;
		const char *text;
	} row[] = {
		{0, 1, "announces none"}, {1, 0, "came without"},    {1, 2, "2 descriptors"},
		{0, 2, "2 descriptors"},  {1, 40, "40 descriptors"},
	};
	unsigned before = open_descriptors();

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		struct pair p = pair_new(NULL);
		struct err err = ERR_INIT;
		uint8_t bytes[256];
		size_t n = frame_bytes(hello(), 1, row[i].said, bytes);

		raw_send(p.raw, bytes, n, row[i].sent);
		assert_int_equal(recv_result(p.conn, &err), -ERR_PROTO);
		assert_non_null(strstr(err.message, row[i].text));
		pair_free(&p);
		assert_int_equal(open_descriptors(), before);
	}
}

/* One descriptor with each byte of a frame, and one with the byte after its end. */
static void test_descriptor_drip(void **state)
{
	unsigned before = open_descriptors();
	struct pair p = pair_new(NULL);
	struct err err = ERR_INIT;
	uint8_t bytes[256];
	size_t n = frame_bytes(hello(), 1, 1, bytes);

	raw_send(p.raw, bytes, 4, 1);
	assert_int_equal(recv_result(p.conn, &err), FRAME_E_AGAIN);
	raw_send(p.raw, bytes + 4, n - 4, 1);
	assert_int_equal(recv_result(p.conn, &err), -ERR_PROTO);
	pair_free(&p);
	assert_int_equal(open_descriptors(), before);

	/* The second frame's descriptor is not taken for the first one's. */
	p = pair_new(NULL);
	n = frame_bytes(hello(), 1, 0, bytes);
	raw_send(p.raw, bytes, n, 0);
	n = frame_bytes(hello(), 2, 1, bytes);
	raw_send(p.raw, bytes, n, 1);
	err_clear(&err);
	check_hello(p.conn, 1, false);
	check_hello(p.conn, 2, true);
	pair_free(&p);
	assert_int_equal(open_descriptors(), before);
}

/* The process has no free descriptor: that is not a violation. */
static void test_no_room_for_a_descriptor(void **state)
{
	struct pair p = pair_new(NULL);
	struct err err = ERR_INIT;
	struct rlimit old, low;
	uint8_t bytes[256];
	size_t n = frame_bytes(hello(), 1, 1, bytes);

	raw_send(p.raw, bytes, n, 1);
	assert_int_equal(getrlimit(RLIMIT_NOFILE, &old), 0);
	low = old;
	low.rlim_cur = 3;
	assert_int_equal(setrlimit(RLIMIT_NOFILE, &low), 0);
	assert_int_equal(recv_result(p.conn, &err), -ERR_BUSY);
	assert_int_equal(setrlimit(RLIMIT_NOFILE, &old), 0);
	pair_free(&p);
}

static void test_malformed_message(void **state)
{
	struct pair p = pair_new(NULL);
	struct err err = ERR_INIT;
	uint8_t bytes[20];
	struct frame_header h = {.length = 4, .request_id = 1};

	frame_header_put(&h, bytes);
	memset(bytes + 16, 0xff, 4);
	raw_send(p.raw, bytes, 20, 0);
	assert_int_equal(recv_result(p.conn, &err), -ERR_PROTO);
	assert_non_null(strstr(err.message, "malformed"));
	pair_free(&p);
}

static void test_unknown_kind(void **state)
{
	static const uint8_t bytes[] = {0x82, 0x4b, 0x01, 0x00}; /* field 1200, length 1 */
	struct err err = ERR_INIT;
	Acut__V1__Message *m;

	assert_int_equal(frame_message_unpack(bytes, sizeof bytes, 1 << 20, NULL, &m, &err), 0);
	assert_int_equal(m->body_case, ACUT__V1__MESSAGE__BODY__NOT_SET);
	frame_message_free(m);
	assert_int_equal(frame_message_unpack(bytes, 0, 1 << 20, NULL, &m, &err), 0);
	assert_int_equal(m->body_case, ACUT__V1__MESSAGE__BODY__NOT_SET);
	frame_message_free(m);
}

static void test_text_not_utf8(void **state)
{
	static const char *bad[] = {"\x80", "a\xff",   "\xc0\xaf", "\xe0\x80\x80", "\xed\xa0\x80", "\xf4\x90\x80\x80",
				    "\xc3", "\xe2\x82"};
	uint8_t bytes[256];

	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
		Acut__V1__PushBegin b = ACUT__V1__PUSH_BEGIN__INIT;
		struct err err = ERR_INIT;
		Acut__V1__Message *m;
		char copy[16];
		size_t n;

		b.dataset = (char *)bad[i];
		n = frame_bytes(FRAME_MESSAGE(PUSH_BEGIN, push_begin, &b), 1, 0, bytes);
		assert_int_equal(frame_message_unpack(bytes + 16, n - 16, 1 << 20, NULL, &m, &err), -ERR_PROTO);
		assert_string_equal(err.field, "dataset");
		strcpy(copy, bad[i]);
		b.dataset = frame_text_clean(copy);
		n = frame_bytes(FRAME_MESSAGE(PUSH_BEGIN, push_begin, &b), 1, 0, bytes);
		assert_int_equal(frame_message_unpack(bytes + 16, n - 16, 1 << 20, NULL, &m, &err), 0);
		frame_message_free(m);
	}
}

/* Texts are tested eight bytes at a time: one invalid byte among any number of valid ones, or none. */
static void test_text_lengths(void **state)
{
	char text[64];
	uint8_t bytes[256];

	for (size_t len = 1; len < 40; len++)
		for (size_t at = 0; at <= len; at++) {
			Acut__V1__PushBegin b = ACUT__V1__PUSH_BEGIN__INIT;
			struct err err = ERR_INIT;
			Acut__V1__Message *m;
			size_t n;

			memset(text, 'x', len);
			text[len] = 0;
			if (at < len)
				text[at] = (char)0x80;
			b.dataset = text;
			n = frame_bytes(FRAME_MESSAGE(PUSH_BEGIN, push_begin, &b), 1, 0, bytes);
			assert_int_equal(frame_message_unpack(bytes + 16, n - 16, 1 << 20, NULL, &m, &err),
					 at < len ? -ERR_PROTO : 0);
			if (at < len)
				continue;
			assert_string_equal(m->push_begin->dataset, text);
			frame_message_free(m);
			memcpy(text + len - 1, "\xc3\xbc", 3);
			n = frame_bytes(FRAME_MESSAGE(PUSH_BEGIN, push_begin, &b), 1, 0, bytes);
			assert_int_equal(frame_message_unpack(bytes + 16, n - 16, 1 << 20, NULL, &m, &err), 0);
			assert_string_equal(m->push_begin->dataset, text);
			frame_message_free(m);
		}
}

static void test_errors_over_the_wire(void **state)
{
	struct pair p = pair_new(NULL);
	struct err why = ERR_INIT, err = ERR_INIT, got = ERR_INIT;
	struct frame_conn *b;
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	assert_int_equal(frame_conn_new(p.raw, NULL, &b, &err), 0);
	err_set(&why, ERR_TRUNCATED, "point 7 ends early");
	err_add_file(&why, "a\xff.las");
	err_add_place(&why, 0, "points");
	err_add_hint(&why, "copy the file again");
	assert_int_equal(frame_conn_send_error(p.conn, 5, &why, &err), 0);
	assert_int_equal(frame_conn_flush(p.conn, &err), 0);
	assert_int_equal(frame_conn_recv(b, &id, &m, &fd, &err), 0);
	assert_int_equal(m->body_case, ACUT__V1__MESSAGE__BODY_ERROR);
	assert_int_equal(frame_error_to_err(m->error, &got), -ERR_TRUNCATED);
	assert_string_equal(got.message, "point 7 ends early");
	assert_string_equal(got.file, "a?.las");
	assert_string_equal(got.field, "points");
	assert_string_equal(got.hint, "copy the file again");
	assert_int_equal(got.offset, 0);
	frame_message_free(m);
	frame_conn_free(b);
	p.raw = -1;
	pair_free(&p);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_header),
		cmocka_unit_test(test_header_bad),
		cmocka_unit_test(test_length_limit),
		cmocka_unit_test(test_round_trip),
		cmocka_unit_test(test_one_byte_writes),
		cmocka_unit_test(test_every_truncation),
		cmocka_unit_test(test_descriptors),
		cmocka_unit_test(test_descriptor_drip),
		cmocka_unit_test(test_no_room_for_a_descriptor),
		cmocka_unit_test(test_malformed_message),
		cmocka_unit_test(test_unknown_kind),
		cmocka_unit_test(test_text_not_utf8),
		cmocka_unit_test(test_text_lengths),
		cmocka_unit_test(test_errors_over_the_wire),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
