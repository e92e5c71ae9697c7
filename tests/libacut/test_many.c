/*
 * Many inputs at once: never more unanswered than the daemon takes, answers in any order, told in the order of
 * the inputs; what is left out, refused, or ends it all.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "fake.h"

enum { N = 100, WINDOW = 8, LEFT_OUT = 13 };

/* ---- a daemon that answers backwards, as late as it can ---- */

struct late {
	unsigned held, most, expected, seen; /* questions about files */
	struct question {
		uint32_t id;
		bool probe;
		char name[32], path[64];
		bool checksum, add;
	} question[2 * WINDOW];
};

static void answer_one(struct fake *f, const struct question *q)
{
	Acut__V1__Probed probed = ACUT__V1__PROBED__INIT;
	Acut__V1__FileDone done = ACUT__V1__FILE_DONE__INIT;
	unsigned i = 0;

	sscanf(q->name, "%u.las", &i);
	if (i % 10 == 7) {
		fake_answer_error(f, q->id, "bad-input", q->name);
		return;
	}
	probed.name = done.name = (char *)q->name;
	probed.points = done.points = 1000 + i;
	probed.known = i % 10 == 3 ? 1 : i % 10 == 4 ? 2 : 0;
	/* What else was asked comes back as texts that are there. */
	probed.crs = (char *)q->path;
	probed.plane = (char *)(q->checksum && q->add ? "both" : "none");
	if (q->probe)
		fake_send(f, q->id, FRAME_MESSAGE(PROBED, probed, &probed), -1);
	else
		fake_send(f, q->id, FRAME_MESSAGE(FILE_DONE, file_done, &done), -1);
}

static void hold(struct fake *f, uint32_t id, const Acut__V1__Message *m)
{
	struct late *l = f->ctx;
	struct question *q = &l->question[l->held++ % (2 * WINDOW)];

	q->id = id;
	q->probe = m->body_case == ACUT__V1__MESSAGE__BODY_PROBE;
	snprintf(q->name, sizeof q->name, "%s", q->probe ? m->probe->name : m->file->name);
	if (q->probe) {
		snprintf(q->path, sizeof q->path, "%.*s", (int)m->probe->path.len, (const char *)m->probe->path.data);
		q->checksum = m->probe->checksum;
		q->add = m->probe->add;
	}
	l->seen++;
	l->most = l->held > l->most ? l->held : l->most;
	if (l->held < WINDOW && l->seen < l->expected)
		return;
	while (l->held)
		answer_one(f, &l->question[--l->held]);
}

static void serve_late(struct fake *f)
{
	Acut__V1__Done done = ACUT__V1__DONE__INIT;
	Acut__V1__PushBegun begun = ACUT__V1__PUSH_BEGUN__INIT;
	Acut__V1__Message *m;
	uint32_t id;
	int fd;

	while (fake_recv(f, &id, &m, &fd)) {
		if (fd >= 0)
			close(fd);
		begun.note = (char *)"taken up";
		if (m->body_case == ACUT__V1__MESSAGE__BODY_HELLO)
			fake_answer_hello(f, id);
		else if (m->body_case == ACUT__V1__MESSAGE__BODY_PUSH_BEGIN)
			fake_send(f, id, FRAME_MESSAGE(PUSH_BEGUN, push_begun, &begun), -1);
		else if (m->body_case == ACUT__V1__MESSAGE__BODY_PROBE || m->body_case == ACUT__V1__MESSAGE__BODY_FILE)
			hold(f, id, m);
		else
			fake_send(f, id, FRAME_MESSAGE(DONE, done, &done), -1);
		frame_message_free(m);
	}
}

/* ---- the caller ---- */

struct caller {
	char name[32], path[64];
	size_t opened, told, refused, known, next;
	size_t end_at, fail_at; /* N: never */
	int flags;
};

static int open_one(void *ctx, size_t i, struct acut_push_input *ret)
{
	struct caller *c = ctx;
	FILE *f;

	assert_int_equal(i, c->opened++);
	if (i == c->fail_at)
		return -1;
	if (i % LEFT_OUT == 0)
		return 1;
	f = tmpfile();
	ret->fd = dup(fileno(f));
	fclose(f);
	snprintf(c->name, sizeof c->name, "%zu.las", i);
	snprintf(c->path, sizeof c->path, "/survey/%zu.las", i);
	ret->name = c->name;
	ret->path = c->path;
	return 0;
}

static int told(struct caller *c, size_t i, const struct acut_failure *why, uint64_t points)
{
	while (c->next % LEFT_OUT == 0)
		c->next++;
	assert_int_equal(i, c->next++);
	c->told++;
	if (why) {
		assert_int_equal(i % 10, 7);
		assert_int_equal(why->code, ACUT_E_INPUT);
		c->refused++;
	} else {
		assert_int_equal(points, 1000 + i);
	}
	return i == c->end_at;
}

static int probed(void *ctx, size_t i, const struct acut_failure *why, const struct acut_probe *p)
{
	struct caller *c = ctx;
	char path[64];

	if (!why) {
		snprintf(path, sizeof path, "/survey/%zu.las", i);
		assert_string_equal(p->crs, path);
		assert_string_equal(p->plane, c->flags ? "both" : "none");
		assert_int_equal(p->known, i % 10 == 3 ? ACUT_KNOWN : i % 10 == 4 ? ACUT_KNOWN_ADOPTED : 0);
		c->known += p->known != 0;
	}
	return told(c, i, why, why ? 0 : p->points);
}

static int staged(void *ctx, size_t i, const struct acut_failure *why, const struct acut_file_result *r)
{
	return told(ctx, i, why, why ? 0 : r->points);
}

static struct acut_push_each each_of(struct caller *c)
{
	*c = (struct caller){.end_at = N, .fail_at = N};
	return (struct acut_push_each){open_one, probed, staged, c};
}

static void test_many(void **state)
{
	unsigned before = fake_open_descriptors();
	const size_t asked = N - (N + LEFT_OUT - 1) / LEFT_OUT;
	struct acut_push_options options = {.dataset = "alps", .checksum = true, .add = true};
	struct late late = {.expected = (unsigned)asked};
	struct acut_push_each each;
	struct acut_push *push;
	struct caller caller;
	struct fake *f;
	struct acut *a = fake_attach(&f, serve_late, &late, NULL);

	assert_int_equal(acut_push_begin(a, &options, &push), 0);
	assert_string_equal(acut_push_note(push), "taken up");
	each = each_of(&caller);
	caller.flags = 1;
	assert_int_equal(acut_push_probe_each(push, N, &each), 0);
	assert_int_equal(caller.told, asked);
	assert_int_equal(caller.opened, N);
	assert_true(caller.refused > 5 && caller.known > 10);
	assert_int_equal(late.most, WINDOW);
	late.seen = 0;
	each = each_of(&caller);
	assert_int_equal(acut_push_file_each(push, N, &each), 0);
	assert_int_equal(caller.told, asked);
	assert_int_equal(late.most, WINDOW);
	assert_int_equal(acut_push_file_each(push, 0, &each), 0);
	acut_push_leave(push);
	acut_close(a);
	fake_stop(f);
	assert_int_equal(fake_open_descriptors(), before);
}

/* What ends it leaves the connection whole: late answers are dropped. */
static void test_ends(void **state)
{
	unsigned before = fake_open_descriptors();
	struct acut_push_options options = {.dataset = "alps"};
	struct late late = {.expected = 8};
	struct acut_push_each each;
	struct acut_push *push;
	struct caller caller;
	struct fake *f;
	struct acut *a = fake_attach(&f, serve_late, &late, NULL);
	double seconds;

	assert_int_equal(acut_push_begin(a, &options, &push), 0);
	each = each_of(&caller);
	caller.end_at = 5;
	assert_int_equal(acut_push_probe_each(push, N, &each), -ACUT_E_CANCELLED);
	assert_int_equal(caller.told, 5);
	assert_int_equal(acut_ping(a, &seconds), 0);
	each = each_of(&caller);
	caller.end_at = 7; /* a refused one: its own failure is the call's */
	assert_int_equal(acut_push_probe_each(push, N, &each), -ACUT_E_INPUT);
	each = each_of(&caller);
	caller.fail_at = 4;
	assert_int_equal(acut_push_probe_each(push, N, &each), -ACUT_E_CANCELLED);
	assert_int_equal(acut_ping(a, &seconds), 0);
	acut_push_leave(push);
	acut_close(a);
	fake_stop(f);
	assert_int_equal(fake_open_descriptors(), before);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_many),
		cmocka_unit_test(test_ends),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
