/* Events of the log: the table, what a sink gets, untrusted names, counts; and the catalogue of messages. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "err.h"
#include "log.h"

static struct {
	int calls, event, line;
	enum log_level level;
	char message[2048], dataset[512], file[512], code[64], function[64];
	bool none_dataset, has_user, takes;
	uint64_t job;
	uint32_t uid, pid;
} got;

static bool sink(void *ctx, const struct log_entry *e)
{
	assert_ptr_equal(ctx, &got);
	got.calls++;
	got.event = e->event;
	got.level = e->level;
	got.line = e->place->line;
	snprintf(got.function, sizeof got.function, "%s", e->place->function);
	snprintf(got.message, sizeof got.message, "%s", e->message);
	got.none_dataset = !e->about->dataset;
	snprintf(got.dataset, sizeof got.dataset, "%s", e->about->dataset ? e->about->dataset : "");
	snprintf(got.file, sizeof got.file, "%s", e->about->file ? e->about->file : "");
	snprintf(got.code, sizeof got.code, "%s", e->about->code ? e->about->code : "");
	got.has_user = e->about->has_user;
	got.uid = e->about->uid;
	got.pid = e->about->pid;
	got.job = e->about->job;
	return got.takes;
}

static void test_table(void **state)
{
	for (int i = 0; i < LOG_EVENTS; i++) {
		const char *id = log_event_id((enum log_event)i);

		assert_int_equal(strlen(id), 32);
		assert_int_equal(strspn(id, "0123456789abcdef"), 32);
		assert_true(log_event_subject((enum log_event)i)[0] != 0);
		for (int k = 0; k < i; k++) {
			assert_string_not_equal(id, log_event_id((enum log_event)k));
			assert_string_not_equal(log_event_name((enum log_event)i), log_event_name((enum log_event)k));
		}
	}
	/* Filters of administrators use these. */
	assert_string_equal(log_event_id(LOG_EVENT_READY), "6c5a079f14bf44a5ae6dfb537c615d60");
	assert_string_equal(log_event_id(LOG_EVENT_JOB_FAILED), "d6d1513041a8411d9aa9fdb3165d0a83");
	assert_int_equal(log_event_level(LOG_EVENT_DAMAGE), LOG_LEVEL_ERROR);
}

static void test_fields(void **state)
{
	struct err err = ERR_INIT;

	got.takes = true;
	log_set_sink(sink, &got);
	log_event(LOG_EVENT_JOB_DONE, &(struct log_about){.job = 7, ABOUT_USER(0), .pid = 12, .dataset = "v\nx\x1b[31m"},
		  "job %d of %s", 7,
		  "a\tb\xff\xc2\x9b"
		  "\xc3\xbc");
	assert_int_equal(got.event, LOG_EVENT_JOB_DONE);
	assert_int_equal(got.level, LOG_LEVEL_INFO);
	assert_string_equal(got.message, "job 7 of a?b???\xc3\xbc");
	assert_string_equal(got.dataset, "v?x?[31m");
	assert_string_equal(got.function, "test_fields");
	assert_true(got.line > 0 && got.has_user && got.uid == 0 && got.pid == 12 && got.job == 7);

	err_set(&err, ERR_CORRUPT, "checksum");
	err_add_file(&err, "x\r.seg");
	log_event_err(LOG_EVENT_DAMAGE, NULL, "damaged", &err);
	assert_string_equal(got.message, "damaged: x?.seg: checksum");
	assert_string_equal(got.file, "x?.seg");
	assert_string_equal(got.code, "corrupt");
	assert_true(got.none_dataset && !got.has_user);

	log_info("a line");
	assert_int_equal(got.event, -1);
	log_set_sink(NULL, NULL);
}

static void test_counts(void **state)
{
	uint64_t before = log_event_count(LOG_EVENT_EVICTED);
	int calls = got.calls;

	log_set_sink(sink, &got);
	log_set_level(LOG_LEVEL_WARNING);
	log_event(LOG_EVENT_EVICTED, NULL, "hidden");
	assert_int_equal(log_event_count(LOG_EVENT_EVICTED), before + 1);
	assert_int_equal(got.calls, calls);
	log_set_level(LOG_LEVEL_INFO);
	log_set_sink(NULL, NULL);
}

/* What the sink does not accept goes to stderr, where the journal's stream needs levels. */
static void test_fallback(void **state)
{
	char text[256] = "";
	int pipes[2], old = dup(STDERR_FILENO);
	ssize_t n;

	assert_int_equal(pipe(pipes), 0);
	dup2(pipes[1], STDERR_FILENO);
	got.takes = false;
	log_set_sink(sink, &got);
	log_event(LOG_EVENT_DISK_FULL, NULL, "full");
	log_set_sink(NULL, NULL);
	dup2(old, STDERR_FILENO);
	n = read(pipes[0], text, sizeof text - 1);
	assert_true(n > 0);
	assert_string_equal(text, "acut: warning: full\n");
	close(old);
	close(pipes[0]);
	close(pipes[1]);
}

static char *slurp(const char *path)
{
	static char text[1 << 17];
	int fd = open(path, O_RDONLY | O_CLOEXEC);
	ssize_t n = fd < 0 ? -1 : read(fd, text, sizeof text - 1);

	assert_true(n > 0);
	text[n] = 0;
	close(fd);
	return text;
}

/* One entry for each event, and no others; each says what it means and what to do. */
static void test_catalogue(void **state)
{
	const char *path = getenv("ACUT_CATALOG");
	char *text, *at;
	int entries = 0;

	assert_non_null(path);
	text = slurp(path);
	for (at = text; (at = strstr(at, "\n-- ")); at++)
		entries++;
	for (int i = 0; i < LOG_EVENTS; i++) {
		char head[256];
		char *body, *end;

		snprintf(head, sizeof head, "\n-- %s\nSubject: %s\nDefined-By: acut\nDocumentation: man:acutd(8)\n\n",
			 log_event_id((enum log_event)i), log_event_subject((enum log_event)i));
		at = strstr(text, head);
		if (!at)
			fail_msg("etc/acut.catalog has no entry with the id and subject of %s",
				 log_event_name((enum log_event)i));
		body = at + strlen(head);
		end = strstr(body, "\n-- ");
		if (end)
			*end = 0;
		if (strlen(body) < 40 || !strstr(body, "\n\n"))
			fail_msg("the entry of %s says too little", log_event_name((enum log_event)i));
		if (end)
			*end = '\n';
	}
	if (entries != LOG_EVENTS)
		fail_msg("etc/acut.catalog has %d entries for %d events: an entry is of no event", entries, LOG_EVENTS);
}

/* Events that a client can cause at will are counted each time, and logged only some times. */
static void test_flood(void **state)
{
	uint64_t cut = log_event_count(LOG_EVENT_CLIENT_CUT), done = log_event_count(LOG_EVENT_JOB_DONE);

	log_set_sink(sink, &got);
	log_set_level(LOG_LEVEL_INFO);
	got.takes = true;
	got.calls = 0;
	for (int i = 0; i < 5000; i++)
		log_event(LOG_EVENT_CLIENT_CUT, NULL, "a client is cut off");
	assert_in_range(got.calls, 20, 200);
	assert_int_equal(log_event_count(LOG_EVENT_CLIENT_CUT) - cut, 5000);
	/* The rest is logged as a number, once, even if no further event of that kind comes. */
	got.calls = 0;
	log_report_suppressed(false);
	assert_int_equal(got.calls, 0);
	log_report_suppressed(true);
	assert_int_equal(got.calls, 1);
	assert_non_null(strstr(got.message, "4900 more times"));
	log_report_suppressed(true);
	assert_int_equal(got.calls, 1);
	got.calls = 0;
	for (int i = 0; i < 5000; i++)
		log_event(LOG_EVENT_JOB_DONE, NULL, "a job is done");
	assert_int_equal(got.calls, 5000);
	assert_int_equal(log_event_count(LOG_EVENT_JOB_DONE) - done, 5000);
	log_set_sink(NULL, NULL);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_table),    cmocka_unit_test(test_fields),    cmocka_unit_test(test_counts),
		cmocka_unit_test(test_fallback), cmocka_unit_test(test_catalogue), cmocka_unit_test(test_flood),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
