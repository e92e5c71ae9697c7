/*
 * Frames: what is written is read again; every breach of PROTOCOL.md is an error of its own; a descriptor
 * never leaks; memory stays under its caps.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <dirent.h>
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include "err.h"
#include "frame.h"

static unsigned open_descriptors(void)
{
	DIR *dir = opendir("/proc/self/fd");
	unsigned n = 0;

	assert_non_null(dir);
	while (readdir(dir))
		n++;
	closedir(dir);
	return n;
}

struct pair {
	struct frame_conn *conn;
	int raw; /* the other end */
};

static struct pair pair_new(const struct frame_limits *limits)
{
	struct err err = ERR_INIT;
	struct pair pair;
	int sv[2];

	assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, sv), 0);
	assert_int_equal(frame_conn_new(sv[0], limits, &pair.conn, &err), 0);
	pair.raw = sv[1];
	return pair;
}

static void pair_free(struct pair *pair)
{
	pair->conn = frame_conn_free(pair->conn);
	if (pair->raw >= 0)
		close(pair->raw);
}

/* Sends bytes with `nfd` descriptors (copies of standard error). */
static void raw_send(int fd, const void *bytes, size_t n, unsigned nfd)
{
	union {
		struct cmsghdr align;
		char bytes[CMSG_SPACE(64 * sizeof(int))];
	} control = {0};
	struct iovec iov = {.iov_base = (void *)bytes, .iov_len = n};
	struct msghdr msg = {.msg_iov = &iov, .msg_iovlen = 1};

	if (nfd > 0) {
		struct cmsghdr *c = &control.align;
		int two = 2;

		msg.msg_control = &control;
		msg.msg_controllen = CMSG_SPACE(nfd * sizeof(int));
		c->cmsg_level = SOL_SOCKET;
		c->cmsg_type = SCM_RIGHTS;
		c->cmsg_len = CMSG_LEN(nfd * sizeof(int));
		for (unsigned i = 0; i < nfd; i++)
			memcpy(CMSG_DATA(c) + i * sizeof two, &two, sizeof two);
	}
	assert_int_equal(sendmsg(fd, &msg, MSG_NOSIGNAL), (ssize_t)n);
}

/* What most tests send. */
static const Acut__V1__Message *hello(void)
{
	static char *features[] = {"a", "b"};
	static Acut__V1__Hello h = {.base = PROTOBUF_C_MESSAGE_INIT(&acut__v1__hello__descriptor),
				    .version_min = 1,
				    .version_max = 7,
				    .build = "0.1 \xc3\xa4",
				    .n_features = 2,
				    .features = features,
				    .program = "test"};
	static Acut__V1__Message m = {.base = PROTOBUF_C_MESSAGE_INIT(&acut__v1__message__descriptor),
				      .body_case = ACUT__V1__MESSAGE__BODY_HELLO,
				      .hello = &h};
	return &m;
}

/* A frame as bytes; returns its size. */
static size_t frame_bytes(const Acut__V1__Message *m, uint32_t id, unsigned descriptors, uint8_t *to)
{
	struct frame_header header = {.length = (uint32_t)acut__v1__message__get_packed_size(m),
				      .request_id = id,
				      .descriptors = (uint8_t)descriptors};

	frame_header_put(&header, to);
	return FRAME_HEADER_SIZE + acut__v1__message__pack(m, to + FRAME_HEADER_SIZE);
}

static void check_hello(struct frame_conn *conn, uint32_t want_id, bool want_fd)
{
	struct err err = ERR_INIT;
	Acut__V1__Message *m = NULL;
	uint32_t id = 0;
	int fd = -5;

	assert_int_equal(frame_conn_recv(conn, &id, &m, &fd, &err), 0);
	assert_int_equal(id, want_id);
	assert_int_equal(m->body_case, ACUT__V1__MESSAGE__BODY_HELLO);
	assert_int_equal(m->hello->version_max, 7);
	assert_int_equal(m->hello->n_features, 2);
	assert_string_equal(m->hello->features[1], "b");
	assert_string_equal(m->hello->build, "0.1 \xc3\xa4");
	if (want_fd) {
		assert_true(fd >= 0);
		assert_true(fcntl(fd, F_GETFD) & FD_CLOEXEC);
		close(fd);
	} else {
		assert_int_equal(fd, -1);
	}
	assert_null(frame_message_free(m));
}

static int recv_result(struct frame_conn *conn, struct err *err)
{
	Acut__V1__Message *m = NULL;
	uint32_t id;
	int fd = -1;
	int r = frame_conn_recv(conn, &id, &m, &fd, err);

	if (r != 0) {
		assert_null(m);
		assert_int_equal(fd, -1);
	}
	if (fd >= 0)
		close(fd);
	frame_message_free(m);
	return r;
}

/* ---- */

static void test_header(void **state)
{
	struct frame_header in = {.length = 0x1234, .request_id = 0x89abcdef, .descriptors = 1}, out;
	static const uint8_t want[16] = {0x41, 0x43, 1,    0,    0x34, 0x12, 0, 0,
					 0xef, 0xcd, 0xab, 0x89, 1,    0,    0, 0};
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
	    {0, 0x42, ERR_PROTO, "magic"},     {1, 0, ERR_PROTO, "magic"},
	    {2, 2, ERR_VERSION, "version"},    {3, 1, ERR_VERSION, "version"},
	    {6, 1, ERR_PROTO, "length"},       {7, 4, ERR_PROTO, "length"},
	    {12, 2, ERR_PROTO, "descriptors"}, {12, 255, ERR_PROTO, "descriptors"},
	    {13, 1, ERR_PROTO, "padding"},     {14, 1, ERR_PROTO, "padding"},
	    {15, 1, ERR_PROTO, "padding"},
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

/* Rows one by one make the very bytes that protobuf makes of the list; a page that is full says so and stays. */
static void test_page(void **state)
{
	Acut__V1__Job row = ACUT__V1__JOB__INIT, *rows[4096];
	Acut__V1__Jobs list = ACUT__V1__JOBS__INIT;
	uint8_t packed[FRAME_BODY_MAX], want[FRAME_BODY_MAX];
	char view[2 * FRAME_MAX] = "";
	struct frame_page page;

	for (int kind = 0; kind < 3; kind++) {
		const unsigned texts[] = {0, 300, FRAME_PAGE_SIZE / 2};

		page.n = list.n_jobs = 0;
		list.jobs = rows;
		row.id = 7;
		memset(view, 'v', texts[kind]);
		view[texts[kind]] = 0;
		row.view = view;
		for (int more = 0; more < 2; more++) {
			size_t n = frame_page_pack(&page, ACUT__V1__MESSAGE__BODY_JOBS, more, packed);

			list.more = more;
			assert_int_equal(n, acut__v1__message__pack(FRAME_MESSAGE(JOBS, jobs, &list), want));
			assert_memory_equal(packed, want, n);
			while (more == 0 && list.n_jobs < 4096 && frame_page_add(&page, &row.base))
				rows[list.n_jobs++] = &row;
		}
		assert_true(kind == 0 || list.n_jobs < 4096);
		assert_true(list.n_jobs > 0);
	}
	page.n = 0;
	memset(view, 'v', sizeof view - 1);
	assert_false(frame_page_add(&page, &row.base));
	assert_int_equal(page.n, 0);
}

/* ---- any message as a row ---- */

static uint64_t dice = 1;

static uint64_t roll(void)
{
	dice = dice * 6364136223846793005u + 1442695040888963407u;
	return dice >> 33;
}

/* Small ones, and those at the ends of what a length of bytes can say. */
static uint64_t any_number(void)
{
	return roll() % 3 ? roll() % 4 : ((uint64_t)1 << roll() % 64) - roll() % 2;
}

static const char *any_text(void)
{
	static const char long_text[] = "0123456789012345678901234567890123456789012345678901234567890123456789"
					"0123456789012345678901234567890123456789012345678901234567890123456789";

	return roll() % 3 ? long_text + sizeof long_text - 1 - roll() % sizeof long_text : "";
}

static ProtobufCMessage *any_message(const ProtobufCMessageDescriptor *what, unsigned depth);

static void any_value(const ProtobufCFieldDescriptor *field, void *at, unsigned depth)
{
	switch (field->type) {
	case PROTOBUF_C_TYPE_MESSAGE:
		*(ProtobufCMessage **)at = any_message(field->descriptor, depth + 1);
		break;
	case PROTOBUF_C_TYPE_STRING:
		*(const char **)at = any_text();
		break;
	case PROTOBUF_C_TYPE_BYTES:
		*(ProtobufCBinaryData *)at = (ProtobufCBinaryData){roll() % 5, (uint8_t *)any_text()};
		((ProtobufCBinaryData *)at)->len = strnlen((char *)((ProtobufCBinaryData *)at)->data, roll() % 5);
		break;
	case PROTOBUF_C_TYPE_DOUBLE:
		*(double *)at = roll() % 3 ? (double)roll() / 7 - 1e8 : roll() % 2 ? 0 : -0.0;
		break;
	case PROTOBUF_C_TYPE_UINT64:
	case PROTOBUF_C_TYPE_INT64:
		*(uint64_t *)at = roll() % 9 ? any_number() : -any_number();
		break;
	case PROTOBUF_C_TYPE_BOOL:
		*(protobuf_c_boolean *)at = roll() % 2;
		break;
	default:
		*(uint32_t *)at = (uint32_t)(roll() % 9 ? any_number() : -any_number());
		break;
	}
}

static size_t value_bytes(const ProtobufCFieldDescriptor *field)
{
	return field->type == PROTOBUF_C_TYPE_BYTES ? sizeof(ProtobufCBinaryData) : field->type == PROTOBUF_C_TYPE_BOOL ? sizeof(protobuf_c_boolean)
	       : field->type == PROTOBUF_C_TYPE_UINT32 || field->type == PROTOBUF_C_TYPE_INT32 ? 4 : 8;
}

static void *kept[4096];
static unsigned nkept;

static void *keep(size_t size)
{
	assert_true(nkept < sizeof kept / sizeof *kept);
	return kept[nkept++] = calloc(1, size);
}

static ProtobufCMessage *any_message(const ProtobufCMessageDescriptor *what, unsigned depth)
{
	ProtobufCMessage *m = keep(what->sizeof_message);

	protobuf_c_message_init(what, m);
	for (unsigned i = 0; i < what->n_fields && depth < 4; i++) {
		const ProtobufCFieldDescriptor *field = &what->fields[i];
		uint8_t *at = (uint8_t *)m + field->offset, *quantifier = (uint8_t *)m + field->quantifier_offset;

		if (roll() % 4 == 0 || field->flags & PROTOBUF_C_FIELD_FLAG_ONEOF)
			continue;
		if (field->label == PROTOBUF_C_LABEL_REPEATED) {
			size_t n = roll() % 4, size = value_bytes(field);
			uint8_t *list = keep(4 * size);

			for (size_t k = 0; k < n; k++)
				any_value(field, list + k * size, depth);
			*(void **)at = list;
			*(size_t *)quantifier = n;
			continue;
		}
		any_value(field, at, depth);
		if (field->label == PROTOBUF_C_LABEL_OPTIONAL && field->type != PROTOBUF_C_TYPE_MESSAGE && field->type != PROTOBUF_C_TYPE_STRING)
			*(protobuf_c_boolean *)quantifier = roll() % 2;
	}
	return m;
}

/* Whatever is in it: the bytes are the library's. */
static void test_page_rows(void **state)
{
	const ProtobufCMessageDescriptor *all = &acut__v1__message__descriptor;
	uint8_t want[FRAME_PAGE_SIZE];
	struct frame_page page;
	unsigned rows = 0;

	for (unsigned i = 0; i < 40 * all->n_fields; i++) {
		const ProtobufCFieldDescriptor *kind = &all->fields[i % all->n_fields];
		ProtobufCMessage *m;
		size_t size, lead = 2;

		if (kind->type != PROTOBUF_C_TYPE_MESSAGE)
			continue;
		m = any_message(kind->descriptor, 0);
		size = protobuf_c_message_pack(m, want);
		page.n = 0;
		assert_true(frame_page_add(&page, m));
		for (size_t rest = size >> 7; rest; rest >>= 7)
			lead++;
		assert_int_equal(page.n, lead + size);
		assert_memory_equal(page.rows + lead, want, size);
		rows++;
		while (nkept)
			free(kept[--nkept]);
	}
	assert_true(rows > 1000);
}

/* It goes as any message does, and all that was charged is given back. */
static void test_page_sent(void **state)
{
	struct ledger *ledger = ledger_new(1 << 20);
	struct frame_limits limits = {.ledger = ledger};
	struct pair a = pair_new(&limits);
	uint64_t before = ledger_held(ledger, LEDGER_MESSAGE);
	Acut__V1__Job row = ACUT__V1__JOB__INIT;
	Acut__V1__Message *m;
	struct frame_page page = {.n = 0};
	struct frame_conn *b;
	struct err err = ERR_INIT;
	uint32_t id;
	int fd;

	assert_int_equal(frame_conn_new(a.raw, NULL, &b, &err), 0);
	for (row.id = 1; row.id < 4; row.id++)
		assert_true(frame_page_add(&page, &row.base));
	assert_int_equal(frame_conn_send_page(a.conn, 9, ACUT__V1__MESSAGE__BODY_JOBS, &page, true, &err), 0);
	assert_int_equal(frame_conn_flush(a.conn, &err), 0);
	assert_int_equal(ledger_held(ledger, LEDGER_MESSAGE), before);
	assert_int_equal(frame_conn_recv(b, &id, &m, &fd, &err), 0);
	assert_int_equal(id, 9);
	assert_int_equal(m->body_case, ACUT__V1__MESSAGE__BODY_JOBS);
	assert_int_equal(m->jobs->n_jobs, 3);
	assert_int_equal(m->jobs->jobs[2]->id, 3);
	assert_true(m->jobs->more);
	frame_message_free(m);
	frame_conn_free(b);
	a.raw = -1;
	pair_free(&a);
	ledger_free(ledger);
}

/* Bytes dribble in one at a time; nothing is there before the last one. */
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

/* No descriptor is left to the process: that is nobody's breach. */
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

/* 64 KiB of empty jobs ask for megabytes: refused by the cap and by the ledger, and all is given back. */
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

/* Counted as they lie there: fields of messages in messages and of none that is known, numbers of lists, packed or not. */
static void test_fields(void **state)
{
	static const uint8_t plain[] = {0x08, 1, 0x08, 2, 0x11, 0, 0, 0, 0, 0, 0, 0, 0, 0x1d, 0, 0, 0, 0}; /* 4 that are not known */
	static const uint8_t jobs[] = {0xb2, 2, 8, 0x0a, 0, 0x0a, 4, 0x08, 1, 0x10, 2}; /* Jobs, 2 of them, 2 fields in one: 5 */
	static const uint8_t unended[] = {0x08, 1, 0x08, 2, 0x80}; /* 2, and what is malformed */
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

/* More than its limits let it have is a breach, and costs no memory. */
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

/* Cut off: what it had is given back at once, and the other side finds the end. */
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

/* A peer that never reads: the queue fills to its cap and not a byte further; all that was queued arrives. */
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

/* A frame that the socket takes in parts: its descriptor goes once, with the first. */
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
	assert_int_equal(frame_conn_send(p.conn, 1, FRAME_MESSAGE(HELLO, hello, &h), dup(2), &err),
			 -ERR_LIMIT);
	assert_int_equal(open_descriptors(), before);
	text[FRAME_BODY_MAX - 8] = '\0';
	assert_int_equal(frame_conn_send(p.conn, 1, FRAME_MESSAGE(HELLO, hello, &h), -1, &err), 0);
	assert_int_equal(frame_conn_queued(p.conn), FRAME_MAX);
	free(text);
	pair_free(&p);
}

static void test_text_not_utf8(void **state)
{
	static const char *bad[] = {"\x80",         "a\xff",        "\xc0\xaf",
				    "\xe0\x80\x80", "\xed\xa0\x80", "\xf4\x90\x80\x80",
				    "\xc3",         "\xe2\x82"};
	uint8_t bytes[256];

	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
		Acut__V1__PushBegin b = ACUT__V1__PUSH_BEGIN__INIT;
		struct err err = ERR_INIT;
		Acut__V1__Message *m;
		char copy[16];
		size_t n;

		b.dataset = (char *)bad[i];
		n = frame_bytes(FRAME_MESSAGE(PUSH_BEGIN, push_begin, &b), 1, 0, bytes);
		assert_int_equal(frame_message_unpack(bytes + 16, n - 16, 1 << 20, NULL, &m, &err),
				 -ERR_PROTO);
		assert_string_equal(err.field, "dataset");
		strcpy(copy, bad[i]);
		b.dataset = frame_text_clean(copy);
		n = frame_bytes(FRAME_MESSAGE(PUSH_BEGIN, push_begin, &b), 1, 0, bytes);
		assert_int_equal(frame_message_unpack(bytes + 16, n - 16, 1 << 20, NULL, &m, &err), 0);
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
		cmocka_unit_test(test_page),
		cmocka_unit_test(test_page_rows),
		cmocka_unit_test(test_page_sent),
	    cmocka_unit_test(test_one_byte_writes),
	    cmocka_unit_test(test_every_truncation),
	    cmocka_unit_test(test_descriptors),
	    cmocka_unit_test(test_descriptor_drip),
	    cmocka_unit_test(test_no_room_for_a_descriptor),
	    cmocka_unit_test(test_malformed_message),
	    cmocka_unit_test(test_unknown_kind),
	    cmocka_unit_test(test_caps),
		cmocka_unit_test(test_fields),
		cmocka_unit_test(test_fields_of_a_connection),
	    cmocka_unit_test(test_charged), cmocka_unit_test(test_cut),
	    cmocka_unit_test(test_queue_cap),
	    cmocka_unit_test(test_sent_in_parts),
	    cmocka_unit_test(test_too_large),
	    cmocka_unit_test(test_text_not_utf8),
	    cmocka_unit_test(test_errors_over_the_wire),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
