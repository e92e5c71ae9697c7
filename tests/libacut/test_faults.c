/*
 * Daemons at fault: too slow, gone, of another version, babbling; and none at all. Each ends in the right
 * failure, which stays where the connection is lost and passes where it is not.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "fake.h"

static bool greet(struct fake *f)
{
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	if (!fake_recv(f, &id, &m, &fd))
		return false;
	fake_answer_hello(f, id);
	frame_message_free(m);
	return true;
}

/* Answers the first question only when the second has come: late, and out of turn. */
static void serve_late(struct fake *f)
{
	Acut__V1__Message *m;
	Acut__V1__Done done = ACUT__V1__DONE__INIT;
	uint32_t first, second;
	int fd;

	if (!greet(f) || !fake_recv(f, &first, &m, &fd))
		return;
	frame_message_free(m);
	if (!fake_recv(f, &second, &m, &fd))
		return;
	frame_message_free(m);
	fake_answer_error(f, first, "io", "of the first");
	fake_send(f, first, FRAME_MESSAGE(DONE, done, &done), dup(2));
	fake_send(f, second, FRAME_MESSAGE(DONE, done, &done), dup(2)); /* a descriptor nobody asked for */
	while (fake_recv(f, &first, &m, &fd))
		frame_message_free(m);
}

static void test_timeout_and_late_answer(void **state)
{
	unsigned before = fake_open_descriptors();
	struct acut_options options = {.timeout = 0.2};
	struct fake *f;
	struct acut *a;
	double seconds;

	fake_stop_time();
	a = fake_attach(&f, serve_late, NULL, &options);
	fake_let_time();
	assert_int_equal(acut_ping(a, &seconds), -ACUT_E_TIMEOUT);
	assert_int_equal(acut_error(a)->exit_status, 124);
	fake_stop_time();
	assert_int_equal(acut_ping(a, &seconds), 0);
	assert_true(seconds < 0.2); /* of this question, not of the first */
	fake_let_time();
	acut_close(a);
	fake_stop(f);
	assert_int_equal(fake_open_descriptors(), before);
}

static int third_time(void *ctx)
{
	return ++*(int *)ctx >= 3;
}

static void test_interrupted(void **state)
{
	int asked = -1000; /* while greeting, perhaps */
	struct acut_options options = {.interrupted = third_time, .ctx = &asked};
	struct fake *f;
	struct acut *a = fake_attach(&f, serve_late, NULL, &options);
	double seconds;

	asked = 0;
	assert_int_equal(acut_ping(a, &seconds), -ACUT_E_CANCELLED);
	assert_int_equal(asked, 3);
	asked = -1000;
	assert_int_equal(acut_ping(a, &seconds), 0);
	acut_close(a);
	fake_stop(f);
}

static void serve_death(struct fake *f)
{
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	if (greet(f) && fake_recv(f, &id, &m, &fd))
		frame_message_free(m);
}

static void serve_last_words(struct fake *f)
{
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	if (greet(f) && fake_recv(f, &id, &m, &fd)) {
		fake_answer_error(f, 0, "protocol", "that was no good");
		frame_message_free(m);
	}
}

static void serve_wrong_kind(struct fake *f)
{
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	if (greet(f) && fake_recv(f, &id, &m, &fd)) {
		fake_answer_job(f, id, 1, "done", true);
		frame_message_free(m);
	}
	while (fake_recv(f, &id, &m, &fd))
		frame_message_free(m);
}

static void serve_noise(struct fake *f)
{
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	if (!greet(f) || !fake_recv(f, &id, &m, &fd))
		return;
	frame_message_free(m);
	if (write(frame_conn_fd(f->conn), "HTTP/1.1 200 OK\r\n\r\n", 19) != 19)
		abort();
}

static void test_daemon_at_fault(void **state)
{
	static const struct {
		void (*serve)(struct fake *);
		int code;
		bool dead;
		const char *text;
	} row[] = {
		{serve_death, ACUT_E_NODAEMON, true, "closed the connection"},
		{serve_last_words, ACUT_E_PROTO, true, "that was no good"},
		{serve_wrong_kind, ACUT_E_PROTO, false, "not asked for"},
		{serve_noise, ACUT_E_PROTO, true, "no frame"},
	};

	for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
		struct fake *f;
		struct acut *a = fake_attach(&f, row[i].serve, NULL, NULL);
		double seconds;

		assert_int_equal(acut_ping(a, &seconds), -row[i].code);
		if (!strstr(acut_error(a)->message, row[i].text))
			fail_msg("row %zu: %s", i, acut_error(a)->message);
		if (row[i].dead) {
			assert_int_equal(acut_ping(a, &seconds), -row[i].code); /* stays so */
			assert_int_equal(acut_dispatch(a), -row[i].code);
		}
		acut_close(a);
		fake_stop(f);
	}
}

static void serve_other_version(struct fake *f)
{
	Acut__V1__Hello hello = ACUT__V1__HELLO__INIT;
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	if (!fake_recv(f, &id, &m, &fd))
		return;
	hello.version_min = 5;
	hello.version_max = 9;
	fake_send(f, id, FRAME_MESSAGE(HELLO, hello, &hello), -1);
	frame_message_free(m);
}

/* A daemon with the features of f->ctx, which gets questions that it does not answer. */
static void serve_features(struct fake *f)
{
	Acut__V1__Hello hello = ACUT__V1__HELLO__INIT;
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	hello.version_min = hello.version_max = 1;
	hello.build = "fake 7";
	hello.features = f->ctx;
	while (hello.features[hello.n_features])
		hello.n_features++;
	while (fake_recv(f, &id, &m, &fd)) {
		if (m->body_case == ACUT__V1__MESSAGE__BODY_HELLO)
			fake_send(f, id, FRAME_MESSAGE(HELLO, hello, &hello), -1);
		else
			fake_answer_error(f, id, "busy", "it was asked");
		frame_message_free(m);
	}
}

static int begin(struct acut *a, const struct acut_push_options *o)
{
	struct acut_push *push;

	return acut_push_begin(a, o, &push);
}

/* What an older daemon would ignore is not asked of it. */
static void test_features(void **state)
{
	static char *none[] = {"push", "mesh", NULL}, *all[] = {"push", "mode", "later", "decimal-comma", "override", NULL};
	const struct acut_push_options plain = {.dataset = "alps", .override_crs = "", .strict = true};
	const struct acut_push_options over[] = {
		{.dataset = "alps", .override_crs = "EPSG:1"},
		{.dataset = "alps", .override_unit_xy = "ft"},
		{.dataset = "alps", .override_unit_z = "ft"},
	};

	for (unsigned known = 0; known < 2; known++) {
		struct fake *f;
		struct acut *a = fake_attach(&f, serve_features, known ? all : none, NULL);

		assert_int_equal(begin(a, &plain), -ACUT_E_BUSY);
		for (unsigned i = 0; i < sizeof over / sizeof *over; i++) {
			assert_int_equal(begin(a, &over[i]), known ? -ACUT_E_BUSY : -ACUT_E_VERSION);
			assert_true(known || strstr(acut_error(a)->message, "(acutd fake 7) does not know"));
		}
		assert_int_equal(acut_decimal_comma(a, false), 0);
		assert_int_equal(acut_decimal_comma(a, true), known ? 0 : -ACUT_E_VERSION);
		assert_true(known || strstr(acut_error(a)->message, "--decimal-comma"));
		assert_int_equal(acut_dataset_mode(a, ""), 0);
		assert_int_equal(acut_dataset_mode(a, "600"), known ? 0 : -ACUT_E_VERSION);
		assert_true(known || strstr(acut_error(a)->message, "--mode"));
		acut_close(a);
		fake_stop(f);
	}
}

static void serve_nothing(struct fake *f) {}

static void test_no_greeting(void **state)
{
	struct fake *f;
	struct acut *a;
	double seconds;
	int fd;

	f = fake_start(serve_other_version, NULL, &fd);
	assert_int_equal(acut_attach(fd, NULL, &a), -ACUT_E_VERSION);
	assert_non_null(strstr(acut_error(a)->message, "5 to 9"));
	assert_int_equal(acut_ping(a, &seconds), -ACUT_E_VERSION);
	acut_close(a);
	fake_stop(f);
	f = fake_start(serve_nothing, NULL, &fd);
	assert_int_equal(acut_attach(fd, NULL, &a), -ACUT_E_NODAEMON);
	acut_close(a);
	fake_stop(f);
}

static void test_connect(void **state)
{
	char dir[] = "/tmp/acut-test-XXXXXX", path[64], lengthy[200];
	struct sockaddr_un address = {.sun_family = AF_UNIX};
	struct acut_options options = {.timeout = 0.1};
	unsigned before = fake_open_descriptors();
	struct acut *a;
	double seconds;
	int fd;

	assert_non_null(mkdtemp(dir));
	snprintf(path, sizeof path, "%s/s", dir);
	assert_int_equal(acut_connect(path, NULL, &a), -ACUT_E_NODAEMON);
	assert_int_equal(acut_error(a)->exit_status, 69);
	assert_int_equal(acut_ping(a, &seconds), -ACUT_E_NODAEMON);
	assert_int_equal(acut_fd(a), -1);
	assert_int_equal(acut_dispatch(a), -ACUT_E_NODAEMON);
	acut_close(a);
	memset(lengthy, 'x', sizeof lengthy);
	lengthy[sizeof lengthy - 1] = '\0';
	assert_int_equal(acut_connect(lengthy, NULL, &a), -ACUT_E_USAGE);
	acut_close(a);
	/* One that listens and never accepts. */
	fd = socket(AF_UNIX, SOCK_STREAM, 0);
	strcpy(address.sun_path, path);
	assert_int_equal(bind(fd, (struct sockaddr *)&address, sizeof address), 0);
	assert_int_equal(listen(fd, 1), 0);
	assert_int_equal(acut_connect(path, &options, &a), -ACUT_E_TIMEOUT);
	acut_close(a);
	close(fd);
	unlink(path);
	rmdir(dir);
	assert_int_equal(fake_open_descriptors(), before);
}

static void test_two_connections(void **state)
{
	struct fake *f, *g;
	struct acut *a = fake_attach(&f, fake_serve_all, NULL, NULL), *b = fake_attach(&g, serve_death, NULL, NULL);
	const struct acut_job *job;
	double seconds;

	assert_int_equal(acut_submit(a, "alps", 1, "", false, false, &job), 0);
	assert_int_equal(acut_ping(b, &seconds), -ACUT_E_NODAEMON);
	assert_string_equal(job->state, "waiting"); /* untouched by the other */
	assert_int_equal(acut_error(a)->code, 0);
	assert_int_equal(acut_ping(a, &seconds), 0);
	acut_close(a);
	acut_close(b);
	fake_stop(f);
	fake_stop(g);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_timeout_and_late_answer),
		cmocka_unit_test(test_interrupted),
		cmocka_unit_test(test_daemon_at_fault),
		cmocka_unit_test(test_no_greeting),
		cmocka_unit_test(test_features),
		cmocka_unit_test(test_connect),
		cmocka_unit_test(test_two_connections),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
