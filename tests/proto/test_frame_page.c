/* Pages of rows: the bytes are those that protobuf makes of the whole list, whatever a row contains. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "frame.h"
#include "frame_pair.h"

/* Rows added one by one give exactly the bytes that protobuf makes of the list; a full page reports it and does not
 * change. */
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

/* Texts of the list come before its rows; if one does not fit, nothing changes. */
static void test_page_text(void **state)
{
	static struct frame_page page;
	static uint8_t packed[FRAME_BODY_MAX];
	static char text[FRAME_PAGE_SIZE + 2];
	const size_t length[] = {0, 1, 127, 128, 20000, FRAME_PAGE_SIZE};
	Acut__V1__Job row = ACUT__V1__JOB__INIT;
	Acut__V1__Message *m;
	struct err err = ERR_INIT;
	size_t n, before;

	row.id = 5;
	for (unsigned i = 0; i < sizeof length / sizeof *length; i++) {
		memset(text, 'r', length[i]);
		text[length[i]] = 0;
		page.n = 0;
		if (length[i] == FRAME_PAGE_SIZE) {
			assert_false(frame_page_text(&page, 3, text));
			assert_int_equal(page.n, 0);
			continue;
		}
		assert_true(frame_page_text(&page, 3, text));
		assert_true(frame_page_text(&page, 3, "thin"));
		assert_true(frame_page_add(&page, &row.base));
		n = frame_page_pack(&page, ACUT__V1__MESSAGE__BODY_JOBS, true, packed);
		assert_int_equal(frame_message_unpack(packed, n, 1 << 20, NULL, &m, &err), 0);
		assert_int_equal(m->jobs->n_rules, 2);
		assert_string_equal(m->jobs->rules[0], text);
		assert_string_equal(m->jobs->rules[1], "thin");
		assert_int_equal(m->jobs->n_jobs, 1);
		assert_int_equal(m->jobs->jobs[0]->id, 5);
		assert_true(m->jobs->more);
		frame_message_free(m);
	}
	memset(text, 'r', sizeof text - 1);
	for (page.n = 0; frame_page_text(&page, 99999, "thin");)
		assert_true(page.n <= sizeof page.rows);
	before = page.n;
	assert_false(frame_page_text(&page, 3, text));
	assert_int_equal(page.n, before);
}

/* ---- any message as a row ---- */

static uint64_t dice = 1;

static uint64_t roll(void)
{
	dice = dice * 6364136223846793005u + 1442695040888963407u;
	return dice >> 33;
}

/* Small ones, and those at the limits of a length of bytes. */
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
	return field->type == PROTOBUF_C_TYPE_BYTES                                          ? sizeof(ProtobufCBinaryData) :
	       field->type == PROTOBUF_C_TYPE_BOOL                                           ? sizeof(protobuf_c_boolean) :
	       field->type == PROTOBUF_C_TYPE_UINT32 || field->type == PROTOBUF_C_TYPE_INT32 ? 4 :
											       8;
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
		if (field->label == PROTOBUF_C_LABEL_OPTIONAL && field->type != PROTOBUF_C_TYPE_MESSAGE &&
		    field->type != PROTOBUF_C_TYPE_STRING)
			*(protobuf_c_boolean *)quantifier = roll() % 2;
	}
	return m;
}

/* Whatever it contains: the bytes are the library's. */
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

/* It is sent like any message, and everything is uncharged. */
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

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_page),
		cmocka_unit_test(test_page_text),
		cmocka_unit_test(test_page_rows),
		cmocka_unit_test(test_page_sent),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
