/* For tests of plan files: a folder, plans, and the file of job 7, generation 3. */
#ifndef PLAN_FIXTURE_H
#define PLAN_FIXTURE_H

/* Each test uses some of it. */
#pragma GCC diagnostic ignored "-Wunused-function"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "err.h"
#include "io.h"
#include "log.h"
#include "plan_file.h"
#include "repeat.h"

enum { RECORD = 104 };

static int dirfd;
static char folder[64];

static int setup(void **state)
{
	repeat_folder(folder, sizeof folder, "plan");
	dirfd = open(folder, O_RDONLY | O_DIRECTORY);
	return dirfd < 0;
}

static int teardown(void **state)
{
	unlinkat(dirfd, "plan-7", 0);
	unlinkat(dirfd, "plan-7.tmp", 0);
	close(dirfd);
	return rmdir(folder);
}

/* The root of a box, split n - 1 times; each time the last leaf is split. */
static struct cut_plan plan_of(size_t n)
{
	static const int32_t box[4] = {0, 0, 1 << 30, 1 << 30};
	struct cut_plan p = {calloc(n, sizeof(struct cut_leaf)), 1, n};

	cut_region_root(box, &p.leaf[0].region);
	while (p.n < n) {
		struct cut_region half[2];

		assert_true(cut_region_split(&p.leaf[p.n - 1].region, half));
		p.leaf[p.n - 1].region = half[0];
		p.leaf[p.n++].region = half[1];
	}
	for (size_t i = 0; i < n; i++) {
		p.leaf[i].count = 1000 + i;
		p.leaf[i].exact = i % 2;
		p.leaf[i].stuck = (uint8_t)(i % 8);
		p.leaf[i].above = i % 3 ? 0 : 77 * i;
	}
	return p;
}

static void same_leaf(const struct cut_leaf *a, const struct cut_leaf *b)
{
	assert_true(cut_region_same(&a->region, &b->region));
	assert_int_equal(a->count, b->count);
	assert_int_equal(a->exact, b->exact);
	assert_int_equal(a->stuck, b->stuck);
	assert_int_equal(a->above, b->above);
}

static int read_plan(struct cut_plan *plan, struct plan_kept *kept, size_t *seen)
{
	struct plan_file *f = plan_file_new(dirfd, 7, 3, true, NULL);
	struct err err = ERR_INIT;
	int r = plan_file_read(f, plan, kept, seen, &err);

	plan_file_free(f);
	return r;
}

static struct digest write_plan(struct plan_file *f, const struct cut_plan *p, uint32_t cap)
{
	struct plan_kept kept = {.load = 500, .cap = cap};
	struct err err = ERR_INIT;

	assert_int_equal(plan_file_write(f, p, &kept, &err), 0);
	return kept.base;
}

static void split_leaf(struct plan_file *f, const struct cut_region *whole, struct cut_leaf half[2])
{
	struct cut_region r[2];
	struct err err = ERR_INIT;

	assert_true(cut_region_split(whole, r));
	half[0] = (struct cut_leaf){.region = r[0], .count = 11, .above = 9};
	half[1] = (struct cut_leaf){.region = r[1], .count = 12, .exact = true};
	assert_int_equal(plan_file_split(f, whole, half, &err), 0);
}

static size_t leaves_now(void)
{
	struct plan_kept kept;
	struct cut_plan q = {0};
	size_t seen, n;
	int r = read_plan(&q, &kept, &seen);

	n = r ? 0 : q.n;
	if (r)
		assert_int_equal(r, PLAN_FILE_ABSENT);
	else
		cut_plan_done(&q);
	return n;
}

static struct plan_done done_of(const struct cut_leaf *leaf, uint64_t salt)
{
	return (struct plan_done){.region = leaf->region,
				  .base = {1, salt},
				  .list = {2, salt},
				  .digest = {3, salt},
				  .payload = 4 * salt,
				  .triangles = 5 + salt,
				  .bytes = 6 + salt};
}

struct records {
	struct plan_done done[16];
	size_t n;
};

static int add_record(void *ctx, const struct plan_done *d, struct err *err)
{
	struct records *t = ctx;

	t->done[t->n++] = *d;
	return t->n == 16 ? 77 : 0;
}

static size_t records_now(struct records *t)
{
	struct err err = ERR_INIT;

	t->n = 0;
	assert_int_equal(plan_file_each_done(dirfd, 7, add_record, t, &err), 0);
	return t->n;
}

#endif
