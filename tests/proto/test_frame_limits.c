/*
 * The cost of a connection: memory stays below its limits and is charged, a queue that nobody reads ends at its limit,
 * messages that are too large are not sent, and everything is uncharged.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "err.h"
#include "frame.h"
#include "frame_pair.h"

/* 64 KiB of empty jobs require megabytes: rejected by the limit and by the ledger, and everything is uncharged. */
static void test_caps(void **state)
{
	enum { N = 16000 };
	uint8_t *bytes = malloc(8 + 2 * N);
	struct ledger *ledger = ledger_new(1 << 20);
	struct err err = ERR_INIT;
	Acut__V1__Message *m = NULL;
	size_t n = 0;

	bytes[n++] = 0xb2; /* field 38: Jobs */
	bytes[n++] = 0x02;
	bytes[n++] = (uint8_t)(0x80 | (2 * N & 0x7f));
	bytes[n++] = (uint8_t)(0x80 | (2 * N >> 7 & 0x7f));
	bytes[n++] = (uint8_t)(2 * N >> 14);
	for (int i = 0; i < N; i++) {
		bytes[n++] = 0x0a; /* field 1: Job, empty */
		bytes[n++] = 0;
	}
	assert_int_equal(frame_message_unpack(bytes, n, 64 << 20, NULL, &m, &err), 0);
	assert_int_equal(m->jobs->n_jobs, N);
	m = frame_message_free(m);
	assert_int_equal(frame_message_unpack(bytes, n, 1 << 20, ledger, &m, &err), -ERR_PROTO);
	assert_non_null(strstr(err.message, "unpacks to more than"));
	assert_int_equal(ledger_held(ledger, LEDGER_MESSAGE), 0);
	err_clear(&err);
	assert_int_equal(frame_message_unpack(bytes, n, 64 << 20, ledger, &m, &err), -ERR_BUSY);
	assert_int_equal(ledger_held(ledger, LEDGER_MESSAGE), 0);
	err_clear(&err);
	assert_int_equal(frame_message_unpack(bytes, n, 64 << 10, NULL, &m, &err), -ERR_PROTO);
	assert_null(m);
	ledger_free(ledger);
	free(bytes);
}

/* Counted in the packed bytes: fields of nested messages and of unknown ones, numbers of lists, packed or not. */
static void test_fields(void **state)
{
	static const uint8_t plain[] = {0x08, 1, 0x08, 2, 0x11, 0, 0, 0, 0, 0, 0, 0, 0, 0x1d, 0, 0, 0, 0}; /* 4 unknown ones */
	static const uint8_t jobs[] = {0xb2, 2, 8, 0x0a, 0, 0x0a, 4, 0x08, 1, 0x10, 2}; /* Jobs, 2 of them, 2 fields in one: 5 */
	static const uint8_t unended[] = {0x08, 1, 0x08, 2, 0x80};                      /* 2, and malformed bytes */
	static const uint8_t beyond[] = {0x08, 1, 0xb2, 2, 100, 0x0a, 0, 0x0a, 0};
	static const uint8_t group[] = {0x08, 1, 0x0b, 0x08, 1, 0x08, 1};
	Acut__V1__PushBegin begin = ACUT__V1__PUSH_BEGIN__INIT;
	Acut__V1__Inspected inspected = ACUT__V1__INSPECTED__INIT;
	Acut__V1__Message m = ACUT__V1__MESSAGE__INIT;
	double crop[4] = {1, 2, 3, 4};
	uint64_t flags[300] = {0};
	uint8_t bytes[4096];
	size_t n;

	assert_true(frame_message_fields(plain, sizeof plain, 4) && !frame_message_fields(plain, sizeof plain, 3));
	assert_true(frame_message_fields(jobs, sizeof jobs, 5) && !frame_message_fields(jobs, sizeof jobs, 4));
	assert_true(frame_message_fields(unended, sizeof unended, 2) && !frame_message_fields(unended, sizeof unended, 1));
	assert_true(frame_message_fields(beyond, sizeof beyond, 1) && frame_message_fields(group, sizeof group, 1));
	assert_true(frame_message_fields(plain, 0, 0));
	begin.n_crop = 4;
	begin.crop = crop;
	m.body_case = ACUT__V1__MESSAGE__BODY_PUSH_BEGIN;
	m.push_begin = &begin;
	n = acut__v1__message__pack(&m, bytes);
	assert_true(frame_message_fields(bytes, n, 6) && !frame_message_fields(bytes, n, 5)); /* itself, the list, 4 in it */
	inspected.n_flags = 300;
	inspected.flags = flags;
	m.body_case = ACUT__V1__MESSAGE__BODY_INSPECTED;
	m.inspected = &inspected;
	n = acut__v1__message__pack(&m, bytes);
	assert_true(frame_message_fields(bytes, n, 302) && !frame_message_fields(bytes, n, 301));
}

/* More fields than its limit are a violation, and cost no memory. */
static void test_fields_of_a_connection(void **state)
{
	struct frame_limits limits = {.fields = 3};
	struct pair p = pair_new(&limits);
	struct err err = ERR_INIT;
	uint8_t frame[64];
	const struct frame_header header = {.length = 8, .request_id = 1};

	frame_header_put(&header, frame);
	memcpy(frame + FRAME_HEADER_SIZE, (const uint8_t[]){0x08, 1, 0x08, 1, 0x08, 1, 0x08, 1}, 8);
	assert_int_equal(write(p.raw, frame, FRAME_HEADER_SIZE + 8), FRAME_HEADER_SIZE + 8);
	assert_int_equal(recv_result(p.conn, &err), -ERR_PROTO);
	assert_non_null(strstr(err.message, "more than 3 fields"));
	pair_free(&p);
}

static void test_charged(void **state)
{
	struct ledger *ledger = ledger_new(1 << 20);
	struct frame_limits limits = {.ledger = ledger};
	struct pair p = pair_new(&limits);
	struct err err = ERR_INIT;
	uint8_t bytes[256];
	size_t n = frame_bytes(hello(), 9, 1, bytes);
	uint64_t idle = ledger_held(ledger, LEDGER_MESSAGE);

	assert_true(idle > 0);
	raw_send(p.raw, bytes, n, 1);
	check_hello(p.conn, 9, true);
	assert_int_equal(ledger_held(ledger, LEDGER_MESSAGE), idle);
	raw_send(p.raw, bytes, n / 2, 1);
	assert_int_equal(recv_result(p.conn, &err), FRAME_E_AGAIN);
	assert_true(ledger_held(ledger, LEDGER_MESSAGE) > idle);
	assert_int_equal(frame_conn_send(p.conn, 1, hello(), dup(2), &err), 0);
	pair_free(&p);
	assert_int_equal(ledger_held(ledger, LEDGER_MESSAGE), 0);
	ledger_free(ledger);
}

/* Cut: its memory is freed at once, and the other side finds the end. */
static void test_cut(void **state)
{
	struct ledger *ledger = ledger_new(1 << 20);
	struct frame_limits limits = {.ledger = ledger};
	struct pair p = pair_new(&limits);
	struct err err = ERR_INIT, why = ERR_INIT;
	uint8_t bytes[256];
	size_t n = frame_bytes(hello(), 9, 1, bytes);
	uint64_t idle = ledger_held(ledger, LEDGER_MESSAGE);

	assert_int_equal(frame_conn_held(p.conn), idle);
	raw_send(p.raw, bytes, n / 2, 1);
	assert_int_equal(recv_result(p.conn, &err), FRAME_E_AGAIN);
	assert_int_equal(frame_conn_send(p.conn, 1, hello(), dup(2), &err), 0);
	assert_int_equal(frame_conn_held(p.conn), ledger_held(ledger, LEDGER_MESSAGE));
	assert_true(frame_conn_held(p.conn) > idle);
	err_set(&why, ERR_BUSY, "too much");
	frame_conn_cut(p.conn, &why);
	assert_int_equal(ledger_held(ledger, LEDGER_MESSAGE), idle);
	assert_int_equal(frame_conn_queued(p.conn), 0);
	assert_int_equal(recv_result(p.conn, &err), -ERR_BUSY);
	assert_int_equal(recv(p.raw, bytes, sizeof bytes, 0), 0);
	pair_free(&p);
	assert_int_equal(ledger_held(ledger, LEDGER_MESSAGE), 0);
	ledger_free(ledger);
}

/* A peer that never reads: the queue fills exactly to its limit; everything queued arrives. */
static void test_queue_cap(void **state)
{
	unsigned before = open_descriptors(), sent = 0, got = 0;
	struct frame_limits limits = {.queue = 4096};
	struct pair p = pair_new(&limits);
	struct err err = ERR_INIT;
	struct frame_conn *b;
	int r, flushed;

	for (;;) {
		r = frame_conn_send(p.conn, sent + 1, hello(), sent % 50 == 0 ? dup(2) : -1, &err);
		if (r != 0)
			break;
		sent++;
		frame_conn_flush(p.conn, &err);
	}
	assert_int_equal(r, FRAME_E_FULL);
	assert_true(frame_conn_queued(p.conn) <= 4096);
	assert_int_equal(frame_conn_new(p.raw, NULL, &b, &err), 0);
	do {
		flushed = frame_conn_flush(p.conn, &err);
		while (recv_result(b, &err) == 0)
			got++;
	} while (flushed == FRAME_E_AGAIN);
	assert_int_equal(flushed, 0);
	assert_int_equal(got, sent);
	frame_conn_free(b);
	p.raw = -1;
	pair_free(&p);
	assert_int_equal(open_descriptors(), before);
}

/* A frame that the socket accepts in parts: its descriptor is sent once, with the first part. */
static void test_sent_in_parts(void **state)
{
	unsigned before = open_descriptors();
	struct pair p = pair_new(NULL);
	struct err err = ERR_INIT;
	Acut__V1__Hello h = ACUT__V1__HELLO__INIT;
	Acut__V1__Message *m = NULL;
	char *text = malloc(60001);
	struct frame_conn *b;
	int small = 1, fd = -1, parts = 0, r;
	uint32_t id;

	memset(text, 'a', 60000);
	text[60000] = '\0';
	h.build = text;
	assert_int_equal(setsockopt(frame_conn_fd(p.conn), SOL_SOCKET, SO_SNDBUF, &small, sizeof small), 0);
	assert_int_equal(frame_conn_new(p.raw, NULL, &b, &err), 0);
	assert_int_equal(frame_conn_send(p.conn, 1, FRAME_MESSAGE(HELLO, hello, &h), dup(2), &err), 0);
	do {
		parts += frame_conn_flush(p.conn, &err) == FRAME_E_AGAIN;
		r = frame_conn_recv(b, &id, &m, &fd, &err);
	} while (r == FRAME_E_AGAIN);
	assert_int_equal(r, 0);
	assert_true(parts > 1);
	assert_true(fd >= 0);
	assert_string_equal(m->hello->build, text);
	close(fd);
	frame_message_free(m);
	free(text);
	frame_conn_free(b);
	p.raw = -1;
	pair_free(&p);
	assert_int_equal(open_descriptors(), before);
}

static void test_too_large(void **state)
{
	struct pair p = pair_new(NULL);
	struct err err = ERR_INIT;
	char *text = malloc(FRAME_MAX + 1);
	Acut__V1__Hello h = ACUT__V1__HELLO__INIT;
	unsigned before = open_descriptors();

	memset(text, 'a', FRAME_MAX);
	text[FRAME_MAX] = '\0';
	h.build = text;
	assert_int_equal(frame_conn_send(p.conn, 1, FRAME_MESSAGE(HELLO, hello, &h), dup(2), &err), -ERR_LIMIT);
	assert_int_equal(open_descriptors(), before);
	text[FRAME_BODY_MAX - 8] = '\0';
	assert_int_equal(frame_conn_send(p.conn, 1, FRAME_MESSAGE(HELLO, hello, &h), -1, &err), 0);
	assert_int_equal(frame_conn_queued(p.conn), FRAME_MAX);
	free(text);
	pair_free(&p);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_caps),
		cmocka_unit_test(test_fields),
		cmocka_unit_test(test_fields_of_a_connection),
		cmocka_unit_test(test_charged),
		cmocka_unit_test(test_cut),
		cmocka_unit_test(test_queue_cap),
		cmocka_unit_test(test_sent_in_parts),
		cmocka_unit_test(test_too_large),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
