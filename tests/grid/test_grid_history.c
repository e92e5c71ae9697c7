/*
 * The history of a dataset in small: pushes, removals, restored sources, merges and prunes in any order, against a
 * model that is a list of records with sources. After each step everything that can be read must agree with the model:
 * all live records of a generation, in order, and counts and content sums of any range. There are few coordinates, so
 * positions, cells and sources collide. ACUT_FUZZ_CASES: how many.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "grid_block.h"
#include "grid_fixture.h"
#include "grid_rewrite.h"
#include "repeat.h"

enum { SOURCES = 400, SEGMENTS = 64, RECORDS = 200000 };

struct history {
	struct folder f;
	uint64_t rng;
	struct grid_segment_info segments[SEGMENTS];
	size_t nsegments;
	struct grid_source sources[SOURCES];
	struct grid_span spans[SOURCES]; /* a source is restored at most once */
	size_t nsources;
	uint32_t last; /* number of the last source */
	uint64_t generation, oldest;
	unsigned files;    /* file names so far */
	struct point *pts; /* the model: all records ever, except the pruned ones */
	uint32_t *ids;
	size_t n;
	int32_t side;
	uint64_t merges, prunes, checks;
};

static struct grid_source *source_of(struct history *h, uint32_t id)
{
	for (size_t i = 0; i < h->nsources; i++)
		if (h->sources[i].id == id)
			return &h->sources[i];
	return NULL;
}

/* ---- steps ---- */

static void push(struct history *h)
{
	unsigned files = 1 + (unsigned)random_below(&h->rng, 3);
	size_t n = random_below(&h->rng, 8) ? random_below(&h->rng, 60) : random_below(&h->rng, 3000), first = h->n;
	struct set set = {h->pts + first, h->ids + first, n};
	struct err err = ERR_INIT;
	char name[32];

	if (h->nsources + files > SOURCES || h->nsegments == SEGMENTS || h->n + n > RECORDS)
		return;
	h->generation++;
	for (size_t i = 0; i < n; i++) {
		set.pts[i] = (struct point){.x = (int32_t)random_below(&h->rng, (uint64_t)h->side) - h->side / 2,
					    .y = (int32_t)random_below(&h->rng, (uint64_t)h->side) - h->side / 2,
					    .z = (int32_t)random_below(&h->rng, 5),
					    .cls = (uint8_t)random_below(&h->rng, 3)};
		set.ids[i] = h->last + 1 + (uint32_t)(i * files / n);
	}
	for (unsigned i = 0; i < files; i++)
		h->sources[h->nsources++] =
			(struct grid_source){.id = ++h->last, .added = h->generation, .name = "f", .path = ""};
	for (size_t i = 0; i < n; i++)
		source_of(h, set.ids[i])->points++;
	snprintf(name, sizeof name, "push%u", h->files++);
	CHECK(stage_set(&h->f, name, &set, 0, &h->segments[h->nsegments++], &err));
	h->n += n;
}

static void take_away(struct history *h)
{
	h->generation++;
	for (size_t i = 0; i < h->nsources; i++)
		if (!h->sources[i].removed && !random_below(&h->rng, 3))
			h->sources[i].removed = h->generation;
}

static void bring_back(struct history *h)
{
	h->generation++;
	for (size_t i = 0; i < h->nsources; i++) {
		struct grid_source *s = &h->sources[i];

		if (!s->removed || s->nearlier || random_below(&h->rng, 2))
			continue;
		h->spans[s->id % SOURCES] = (struct grid_span){s->added, s->removed};
		s->earlier = &h->spans[s->id % SOURCES];
		s->nearlier = 1;
		s->added = h->generation;
		s->removed = 0;
	}
}

static void rewrite(struct history *h, const size_t *which, size_t n, const uint32_t *drop, size_t ndrop)
{
	struct grid_segment_info some[SEGMENTS], made;
	struct grid_rewrite_params p = {
		.dirfd = h->f.fd, .segments = some, .nsegments = n, .nsources = h->last, .drop = drop, .ndrop = ndrop};
	struct grid_rewrite *w;
	struct err err = ERR_INIT;
	char name[32];
	size_t kept = 0;
	int rc;

	for (size_t i = 0; i < n; i++)
		some[i] = h->segments[which[i]];
	snprintf(name, sizeof name, "made%u", h->files++);
	p.name = name;
	p.memory = grid_rewrite_min_bytes(some, n, p.nsources) + random_below(&h->rng, 1 << 20);
	CHECK(grid_rewrite_new(&p, &w, &err));
	while (!(rc = grid_rewrite_step(w, &err)))
		;
	CHECK(rc == GRID_REWRITE_DONE ? 0 : rc);
	CHECK(grid_rewrite_finish(w, &made, &err));
	for (size_t i = 0; i < h->nsegments; i++) {
		bool old = false;

		for (size_t k = 0; k < n; k++)
			old = old || which[k] == i;
		if (old)
			unlinkat(h->f.fd, h->segments[i].file, 0);
		else
			h->segments[kept++] = h->segments[i];
	}
	h->segments[kept++] = made;
	h->nsegments = kept;
}

static void merge(struct history *h)
{
	size_t which[SEGMENTS], n = 0;

	for (size_t i = 0; i < h->nsegments; i++)
		if (random_below(&h->rng, 2))
			which[n++] = i;
	if (n < 2)
		return;
	rewrite(h, which, n, NULL, 0);
	h->merges++;
}

static bool lives(const struct grid_source *s, uint64_t from, uint64_t to)
{
	for (uint64_t g = from; g <= to; g++)
		if (grid_source_live(s, g))
			return true;
	return false;
}

/* The simple way: removes each source that is in no remaining generation. */
static void prune(struct history *h)
{
	uint32_t drop[SOURCES];
	size_t ndrop = 0, n = 0;
	bool more = true;

	if (h->generation <= h->oldest)
		return;
	h->oldest += 1 + random_below(&h->rng, h->generation - h->oldest);
	for (size_t i = 0; i < h->nsources; i++)
		if (!lives(&h->sources[i], h->oldest, h->generation))
			drop[ndrop++] = h->sources[i].id;
	while (more) {
		more = false;
		for (size_t i = 0; !more && i < h->nsegments; i++) {
			struct err err = ERR_INIT;
			uint64_t points;

			CHECK(grid_segment_count_sources(h->f.fd, &h->segments[i], drop, ndrop, &points, &err));
			more = points > 0;
			if (more)
				rewrite(h, &i, 1, drop, ndrop);
		}
	}
	for (size_t i = 0; i < h->nsources; i++) {
		bool goes = false;

		for (size_t k = 0; k < ndrop; k++)
			goes = goes || drop[k] == h->sources[i].id;
		if (!goes)
			h->sources[n++] = h->sources[i];
	}
	h->nsources = n;
	for (size_t i = n = 0; i < h->n; i++) {
		if (!source_of(h, h->ids[i]))
			continue;
		h->pts[n] = h->pts[i];
		h->ids[n++] = h->ids[i];
	}
	h->n = n;
	h->prunes++;
}

/* ---- checks ---- */

struct total {
	struct digest sum;
	uint64_t n;
	struct point last; /* the previous record of a scan */
};

static void add(struct total *t, const struct point *p)
{
	digest_add(&t->sum, grid_record_hash(p));
	t->n++;
}

/* Sums a sequence so that its order matters: a scan must be the model's sequence. */
static int add_all(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct total *t = ctx;

	for (size_t i = 0; i < n; i++) {
		assert_int_equal(point_source(&pts[i]), 0);
		assert_true(t->n == 0 || point_compare(&t->last, &pts[i]) <= 0);
		add(t, &pts[i]);
		t->last = pts[i];
	}
	return 0;
}

static struct total model(struct history *h, uint64_t generation, uint64_t lo, uint64_t hi)
{
	struct total t = {0};
	uint32_t last = 0;
	bool is = false;

	for (size_t i = 0; i < h->n; i++) {
		uint64_t key = point_morton(h->pts[i].x, h->pts[i].y);

		if (h->ids[i] != last)
			is = grid_source_live(source_of(h, h->ids[i]), generation);
		last = h->ids[i];
		if (is && key >= lo && key <= hi)
			add(&t, &h->pts[i]);
	}
	return t;
}

static void check_range(struct history *h, struct reader *r, uint64_t generation, uint64_t lo, uint64_t hi)
{
	struct total want = model(h, generation, lo, hi), scanned = {0};
	struct digest sum;
	struct err err = ERR_INIT;
	uint64_t count;
	bool exact;

	CHECK(grid_sum(r->r, lo, hi, &sum, &err));
	assert_true(digest_equal(sum, want.sum));
	CHECK(grid_count(r->r, lo, hi, &count, &exact, &err));
	assert_true(exact ? count == want.n : count >= want.n);
	CHECK(grid_scan(r->r, lo, hi, add_all, &scanned, &err));
	assert_int_equal(scanned.n, want.n);
	assert_true(digest_equal(scanned.sum, want.sum));
	h->checks++;
}

static void check(struct history *h)
{
	struct grid_manifest m = manifest_of(h->segments, h->nsegments, 0);
	uint64_t generation = h->oldest + random_below(&h->rng, h->generation - h->oldest + 1);
	struct err err = ERR_INIT;
	struct reader r;
	struct grid *gone;

	free(m.sources);
	m.sources = h->sources;
	m.nsources = h->nsources;
	m.generation = h->generation;
	m.oldest = h->oldest;
	CHECK(grid_manifest_write(h->f.fd, "manifest", &m, &err));
	r = reader_open(&h->f, "manifest", generation, 1 << 20);
	check_range(h, &r, generation, 0, UINT64_MAX);
	assert_int_equal(grid_points(r.grid), model(h, generation, 0, UINT64_MAX).n);
	for (int i = 0; i < 4; i++) {
		int32_t x = (int32_t)random_below(&h->rng, (uint64_t)h->side) - h->side / 2;
		uint64_t lo = point_morton(x, x), hi = lo + (random_next(&h->rng) >> random_below(&h->rng, 64));

		check_range(h, &r, generation, lo, hi < lo ? UINT64_MAX : hi);
	}
	reader_close(&r);
	if (h->oldest > 1)
		assert_int_equal(grid_open(h->f.fd, "manifest", h->oldest - 1, NULL, 1 << 20, &gone, &err), -ERR_NOTFOUND);
}

static void live(uint64_t seed, unsigned steps, uint64_t done[3])
{
	struct history h = {.f = folder_new(), .rng = seed, .generation = 0, .oldest = 1};

	h.side = random_below(&h.rng, 2) ? 4 : random_below(&h.rng, 2) ? 60 : 1 << 20;
	h.pts = malloc(RECORDS * sizeof *h.pts);
	h.ids = malloc(RECORDS * sizeof *h.ids);
	push(&h);
	for (unsigned i = 0; i < steps; i++) {
		switch (random_below(&h.rng, 10)) {
		case 0:
		case 1:
			merge(&h);
			break;
		case 2:
			take_away(&h);
			break;
		case 3:
			bring_back(&h);
			break;
		case 4:
			if (!random_below(&h.rng, 3))
				prune(&h);
			break;
		default:
			push(&h);
		}
		check(&h);
	}
	done[0] += h.merges;
	done[1] += h.prunes;
	done[2] += h.checks;
	free(h.pts);
	free(h.ids);
	folder_remove(&h.f);
}

static void test_lives(void **state)
{
	unsigned n = (unsigned)repeat_cases(12);
	uint64_t done[3] = {0};

	for (unsigned i = 0; i < n; i++)
		live(UINT64_C(1000003) * (i + 1), 40, done);
	printf("%u lives: %llu merges, %llu prunes, %llu ranges compared\n", n, (unsigned long long)done[0],
	       (unsigned long long)done[1], (unsigned long long)done[2]);
	assert_true(done[0] && done[1]);
}

int main(void)
{
	no_sync();
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_lives)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
