/*
 * Finished domains in the store, over real caches: what is made of one generation is found in another exactly where it
 * would be made the same, byte for byte; a reader-less emission from the fronts alone gives the same totals; whatever is
 * damaged is made again.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <dirent.h>
#include <fcntl.h>
#include <unistd.h>
#include <cmocka.h>

#include "err.h"
#include "grid_fixture.h"
#include "io.h"
#include "pipe.h"
#include "pipe_priv.h"

enum { LOAD = 400, CAP = 40000, SOURCES = 6 };

static uint64_t rng;

static uint64_t rnd(uint64_t n)
{
	return rng_below(&rng, n);
}

/* ---- a generation on disk ---- */

struct generation {
	struct folder folder;
	struct grid_segment_info info[4];
	struct grid_manifest m;
	struct reader reader;
	struct pipe_budget budget;
	struct pipe_key key;
	void *memory;
};

static const struct view view = VIEW_INIT;

/* `dead`: by source; they lie in the segments all the same. */
static struct generation generation_of(const struct set *s, unsigned segments, unsigned dead)
{
	struct generation g = {.folder = folder_new()};
	struct err err = ERR_INIT;
	size_t reader_size;

	for (unsigned i = 0; i < segments; i++) {
		struct set part = {calloc(s->n + 1, sizeof *s->pts), calloc(s->n + 1, sizeof *s->ids), 0};
		char name[16];

		for (size_t k = 0; k < s->n; k++)
			if (s->ids[k] % segments == i) {
				part.pts[part.n] = s->pts[k];
				part.ids[part.n++] = s->ids[k];
			}
		snprintf(name, sizeof name, "s%u", i);
		CHECK(stage_set(&g.folder, name, &part, GRID_STAGE_MIN, &g.info[i], &err));
		set_free(&part);
	}
	g.m = manifest_of(g.info, segments, SOURCES);
	g.m.generation = 2;
	for (unsigned i = 0; i < SOURCES; i++) {
		for (size_t k = 0; k < s->n; k++)
			g.m.sources[i].points += s->ids[k] == i + 1;
		if (dead >> i & 1)
			g.m.sources[i].removed = 2;
	}
	CHECK(grid_manifest_write(g.folder.fd, "m", &g.m, &err));
	g.reader = reader_open(&g.folder, "m", GRID_NEWEST, 1 << 20);
	reader_size = grid_reader_bytes(g.reader.grid);
	g.budget = (struct pipe_budget){.load = LOAD, .cap = CAP, .threads = 1, .domain_bytes = pipe_domain_bytes(CAP, reader_size)};
	g.memory = aligned_alloc(64, (g.budget.domain_bytes + 63) & ~(size_t)63);
	pipe_key_init(&g.key, g.reader.grid, &view);
	return g;
}

static void generation_end(struct generation *g)
{
	free(g->memory);
	reader_close(&g->reader);
	free(g->m.sources);
	folder_remove(&g->folder);
}

/* `all` points of side `side`, and some of source 4 in a corner of it; more of source 5 elsewhere in the corner. */
static struct set points_more(size_t all, size_t some, uint32_t side)
{
	size_t n = all + 2 * some;
	struct set s = {calloc(n, sizeof *s.pts), calloc(n, sizeof *s.ids), n};

	for (size_t i = 0; i < n; i++) {
		uint32_t within = i < all ? side : side / 6;

		s.pts[i] = (struct point){.x = (int32_t)rnd(within) - (int32_t)(side / 2), .y = (int32_t)rnd(within) - 77,
					  .z = (int32_t)rnd(50), .cls = rnd(20) ? 2 : 7, .ret = 0x11};
		s.ids[i] = i < all ? 1 + (uint32_t)rnd(3) : i < all + some ? 4 : 5;
	}
	return s;
}

static struct set points_of(size_t all, uint32_t side)
{
	return points_more(all, 30, side);
}

/* ---- domains ---- */

static int make(struct generation *g, const struct cut_region *r, struct mesh_domain *ret)
{
	struct err err = ERR_INIT;
	uint64_t need;
	int rc = pipe_domain(g->reader.grid, &view, r, NULL, &g->budget, g->memory, ret, &need, &err);

	assert_int_equal(rc, 0);
	return rc;
}

static void keep(struct generation *g, int store, const struct cut_region *r, struct pipe_stored *ret)
{
	struct mesh_domain d;
	struct err err = ERR_INIT;

	make(g, r, &d);
	CHECK(pipe_keep(store, &g->key, r, &d, g->memory, ret, NULL, &err));
	assert_true(digest_equal(ret->digest, d.digest));
	assert_int_equal(ret->triangles, d.ntriangle);
}

static int reuse_as(struct generation *g, int store, const struct cut_region *r, void *memory, bool light, bool sums,
		    struct mesh_domain *ret, struct pipe_stored *ret_stored)
{
	const struct pipe_reuse_params p = {.storefd = store, .grid = g->reader.grid, .view = &view, .key = &g->key,
					    .region = r, .cap = CAP, .memory = memory, .size = g->budget.domain_bytes,
					    .light = light, .sums = sums};
	struct err err = ERR_INIT;
	size_t held = 0;
	int rc = pipe_reuse(&p, ret, ret_stored, &held, &err);

	if (rc < 0)
		fail_msg("%s", err.message);
	assert_true(rc || held <= g->budget.domain_bytes);
	return rc;
}

static int reuse(struct generation *g, int store, const struct cut_region *r, void *memory, bool light,
		 struct mesh_domain *ret, struct pipe_stored *ret_stored)
{
	return reuse_as(g, store, r, memory, light, false, ret, ret_stored);
}

static int reuse_sums(struct generation *g, int store, const struct cut_region *r, void *memory, struct mesh_domain *ret,
		      struct pipe_stored *ret_stored)
{
	return reuse_as(g, store, r, memory, true, true, ret, ret_stored);
}

static void check_same(const struct mesh_domain *a, const struct mesh_domain *b)
{
	assert_int_equal(a->nvertex, b->nvertex);
	assert_int_equal(a->nopen, b->nopen);
	assert_int_equal(a->ntriangle, b->ntriangle);
	assert_true(digest_equal(a->digest, b->digest) && digest_equal(a->closed_digest, b->closed_digest));
	assert_true(digest_equal(a->own_digest, b->own_digest) && a->nhull == b->nhull);
	assert_int_equal(a->counts.points, b->counts.points);
	assert_int_equal(a->counts.used, b->counts.used);
	assert_int_equal(a->counts.halo, b->counts.halo);
	assert_memory_equal(a->counts.removed, b->counts.removed, sizeof a->counts.removed);
	if (!a->ntriangle)
		return;
	assert_memory_equal(a->box, b->box, sizeof a->box);
	assert_memory_equal(a->vertex, b->vertex, a->nvertex * sizeof *a->vertex);
	assert_memory_equal(a->triangle, b->triangle, a->ntriangle * sizeof *a->triangle);
	for (uint32_t i = 0; i < a->nopen; i++)
		assert_true(a->link[i].hi == b->link[i].hi && a->link[i].lo == b->link[i].lo &&
			    a->link[i].edges == b->link[i].edges);
}

static struct cut_plan plan_of(struct generation *g)
{
	struct cut_plan plan = {0};
	struct err err = ERR_INIT;

	CHECK(cut_plan_make(g->reader.r, LOAD, &plan, &err));
	return plan;
}

/* ---- one generation after another ---- */

static uint64_t judged, found;

static void compare_generations(struct generation *old, struct generation *new, int store)
{
	struct cut_plan plan = plan_of(new);
	void *memory = aligned_alloc(64, (new->budget.domain_bytes + 63) & ~(size_t)63);

	for (size_t i = 0; i < plan.n; i++) {
		const struct cut_region *r = &plan.leaf[i].region;
		struct pipe_stored as, got;
		struct mesh_domain a, b;

		keep(old, store, r, &as);
		assert_int_equal(reuse(old, store, r, memory, false, &b, &got), 0);
		make(old, r, &a);
		check_same(&a, &b);
		assert_memory_equal(&as.id, &got.id, sizeof as.id);
		assert_int_equal(as.payload, got.payload);
		assert_int_equal(as.bytes, got.bytes);
		judged++;
		if (reuse(new, store, r, memory, false, &b, &got))
			continue;
		found++;
		make(new, r, &a);
		check_same(&a, &b);
	}
	free(memory);
	cut_plan_done(&plan);
}

static void test_generations(void **state)
{
	const unsigned cases = getenv("ACUT_SLOW") ? 200 : 25;

	(void)state;
	skip_fsync();
	for (unsigned c = 1; c < cases; c++) {
		struct set s;
		struct generation old, new;
		struct folder store = folder_new();

		rng = 1000 + c;
		s = points_of(c % 5 ? 2000 + rnd(3000) : 60000, 300 + (uint32_t)rnd(100000));
		old = generation_of(&s, 1 + (unsigned)rnd(3), 0x30 | (rnd(2) ? 8 : 0));
		new = generation_of(&s, 1 + (unsigned)rnd(4), 0x20 | (rnd(3) ? 8 : 0));
		compare_generations(&old, &new, store.fd);
		generation_end(&old);
		generation_end(&new);
		folder_remove(&store);
		set_free(&s);
	}
	printf("%llu of %llu domains found in the next generation\n", (unsigned long long)found, (unsigned long long)judged);
	assert_true(found > judged / 10 * 5 && found < judged);
}

/* ---- what a region stood on bounds its halo ---- */

static bool before_of(struct generation *g, int store, const struct cut_region *r, struct pipe_before *ret)
{
	const struct pipe_reuse_params p = {.storefd = store, .grid = g->reader.grid, .view = &view, .key = &g->key,
					    .region = r, .cap = CAP, .memory = g->memory, .size = g->budget.domain_bytes};

	return pipe_before(&p, ret);
}

/* Points of source 1, and more of source 2 in a corner of them; each has a segment. */
static struct set points_and_more(size_t all, size_t some)
{
	struct set s = points_more(all, some, 3000 + (uint32_t)rnd(100000));

	for (size_t i = 0; i < s.n; i++)
		s.ids[i] = i < all ? 1 : 2;
	return s;
}

static uint64_t compare_bounded(struct generation *new, int store, const struct cut_region *r, void *memory, uint64_t *ret_all)
{
	struct pipe_before before;
	const struct pipe_known known = {.before = &before};
	struct err err = ERR_INIT;
	struct mesh_domain a, b;
	uint64_t need;

	assert_true(before_of(new, store, r, &before));
	make(new, r, &a);
	CHECK(pipe_domain(new->reader.grid, &view, r, &known, &new->budget, memory, &b, &need, &err));
	check_same(&a, &b);
	*ret_all += a.counts.points_read - a.counts.points;
	return b.counts.points_read - b.counts.points;
}

static void test_before(void **state)
{
	uint64_t all = 0, bounded = 0;

	(void)state;
	for (unsigned c = 1; c < 12; c++) {
		struct folder store = folder_new();
		struct generation old, new, less;
		struct pipe_before none;
		struct pipe_stored as;
		struct cut_plan plan;
		struct set s;
		void *memory;

		rng = 70 + c;
		s = points_and_more(8000, 20 + rnd(200));
		old = generation_of(&s, 2, 2);
		new = generation_of(&s, 2, 0);
		less = generation_of(&s, 2, 1);
		memory = aligned_alloc(64, (new.budget.domain_bytes + 63) & ~(size_t)63);
		plan = plan_of(&new);
		assert_false(before_of(&new, store.fd, &plan.leaf[0].region, &none));
		for (size_t i = 0; i < plan.n; i++) {
			const struct cut_region *r = &plan.leaf[i].region;

			keep(&old, store.fd, r, &as);
			bounded += compare_bounded(&new, store.fd, r, memory, &all);
			/* What it stood on is not all there. */
			assert_false(before_of(&less, store.fd, r, &none));
		}
		free(memory);
		cut_plan_done(&plan);
		generation_end(&old);
		generation_end(&new);
		generation_end(&less);
		folder_remove(&store);
		set_free(&s);
	}
	printf("%llu points read for halos, without what was known %llu\n", (unsigned long long)bounded, (unsigned long long)all);
	assert_true(bounded < all);
}

/* ---- plans that grew a little ---- */

static void count_there(void *ctx, const struct cut_region *r, const struct mesh_domain *d, const struct pipe_stored *as)
{
	(void)r;
	assert_null(d->triangle);
	assert_int_equal(d->ntriangle, as->triangles);
	++*(uint64_t *)ctx;
}

/* What one generation stored; the next one cuts few regions, and only such that changed; a third finds the parts. */
static void test_refine(void **state)
{
	struct folder store = folder_new();
	struct generation old, new;
	struct set s;

	(void)state;
	rng = 21;
	s = points_more(40000, 300, 100000);
	old = generation_of(&s, 1, 0x30);
	new = generation_of(&s, 2, 0);
	for (unsigned round = 0; round < 2; round++) {
		struct generation *g = round ? &new : &old;
		struct pipe_reuse_params p = {.storefd = store.fd, .grid = g->reader.grid, .view = &view, .key = &g->key,
					      .load = LOAD, .cap = CAP, .memory = g->memory, .size = g->budget.domain_bytes};
		struct cut_plan plan = plan_of(g), again;
		size_t before = plan.n, made = 0, fits = 0, there = 0;
		struct err err = ERR_INIT;
		struct pipe_stored as;
		uint64_t points = 0, told = 0;

		p.there = count_there;
		p.ctx = &told;
		CHECK(pipe_refine(&p, &plan, &err));
		for (size_t i = 0; i < plan.n; i++) {
			struct store_version version;
			size_t n;

			CHECK(store_versions(store.fd, pipe_key_of(&g->key, &plan.leaf[i].region), &version, 1, &n, &err));
			/* Also what outgrew its leaf is small. */
			assert_true(!round || n || plan.leaf[i].count <= LOAD / 2);
			fits += plan.leaf[i].fits;
		}
		assert_int_equal(fits, round ? plan.n : 0);
		assert_true(round ? plan.n > before && plan.n < before + before / 4 : plan.n == before);
		for (size_t i = 0; i < plan.n; i++) {
			struct mesh_domain d;
			int r = reuse(g, store.fd, &plan.leaf[i].region, g->memory, true, &d, &as);

			assert_int_equal(plan.leaf[i].there, !r);
			there += !r;
			if (r) {
				make(g, &plan.leaf[i].region, &d);
				CHECK(pipe_keep(store.fd, &g->key, &plan.leaf[i].region, &d, g->memory, &as, NULL, &err));
				made++;
			}
			points += d.counts.points;
		}
		assert_int_equal(told, there);
		/* They are a partition still, and all of it is found the next time. */
		assert_int_equal(points, grid_points(g->reader.grid));
		assert_true(round ? made < plan.n / 3 : made == plan.n);
		again = plan_of(g);
		CHECK(pipe_refine(&p, &again, &err));
		assert_int_equal(again.n, plan.n);
		for (size_t i = 0; i < plan.n; i++)
			assert_true(cut_region_same(&again.leaf[i].region, &plan.leaf[i].region));
		cut_plan_done(&plan);
		cut_plan_done(&again);
	}
	generation_end(&old);
	generation_end(&new);
	folder_remove(&store);
	set_free(&s);
}

/* Where much has changed large regions are faster: the plan stays. */
static void test_refine_much(void **state)
{
	struct folder store = folder_new();
	struct set s = points_more(40000, 0, 100000);
	struct generation g[2];
	struct err err = ERR_INIT;

	(void)state;
	for (size_t i = 0; i < 60; i++)
		s.ids[i * 600] = 4; /* everywhere */
	for (unsigned i = 0; i < 2; i++) {
		struct cut_plan plan;
		size_t before;

		g[i] = generation_of(&s, 1 + i, i ? 0 : 0x18);
		plan = plan_of(&g[i]);
		before = plan.n;
		for (size_t k = 0; !i && k < plan.n; k++) {
			struct pipe_stored as;

			keep(&g[i], store.fd, &plan.leaf[k].region, &as);
		}
		if (i) {
			struct pipe_reuse_params p = {.storefd = store.fd, .grid = g[i].reader.grid, .view = &view, .key = &g[i].key,
						      .load = LOAD, .cap = CAP, .memory = g[i].memory,
						      .size = g[i].budget.domain_bytes};

			CHECK(pipe_refine(&p, &plan, &err));
			assert_int_equal(plan.n, before);
		}
		cut_plan_done(&plan);
	}
	generation_end(&g[0]);
	generation_end(&g[1]);
	folder_remove(&store);
	set_free(&s);
}

/* ---- emission from the fronts ---- */

enum how { MADE, WHOLE, LIGHT, SUMS };

static struct pipe_totals emit_all(struct generation *g, int store, enum how how)
{
	const bool light = how == LIGHT || how == SUMS;
	struct cut_plan plan = plan_of(g);
	struct pipe_emitter *emitter = NULL;
	struct pipe_totals totals;
	struct err err = ERR_INIT;

	CHECK(pipe_emitter_new(&g->m.lattice, 1 << 17, g->folder.fd, &emitter, &err));
	pipe_emitter_sums(emitter, how == SUMS);
	for (size_t i = 0; i < plan.n; i++) {
		const struct cut_region *r = &plan.leaf[i].region;
		struct pipe_stored as;
		struct mesh_domain d;

		if (!store || (light && i % 5 == 4))
			make(g, r, &d);
		else
			assert_int_equal(how == SUMS ? reuse_sums(g, store, r, g->memory, &d, &as) :
						       reuse(g, store, r, g->memory, light, &d, &as), 0);
		assert_true(!store || !light || i % 5 == 4 || !d.triangle);
		CHECK(pipe_emit(emitter, &d, r, NULL, &err));
	}
	CHECK(pipe_emitter_finish(emitter, &totals, &err));
	pipe_emitter_free(emitter);
	cut_plan_done(&plan);
	return totals;
}

static void test_fronts(void **state)
{
	struct folder store = folder_new();
	struct generation g;
	struct pipe_totals made, whole, light, sums;
	struct cut_plan plan;
	struct pipe_stored as;
	struct set s;

	(void)state;
	rng = 7;
	s = points_of(6000, 5000);
	g = generation_of(&s, 2, 0x10);
	plan = plan_of(&g);
	for (size_t i = 0; i < plan.n; i++)
		keep(&g, store.fd, &plan.leaf[i].region, &as);
	cut_plan_done(&plan);
	made = emit_all(&g, 0, MADE);
	whole = emit_all(&g, store.fd, WHOLE);
	light = emit_all(&g, store.fd, LIGHT);
	sums = emit_all(&g, store.fd, SUMS);
	assert_true(made.triangles > 8000);
	made.counts.cells_read = whole.counts.cells_read = light.counts.cells_read = sums.counts.cells_read = 0;
	made.counts.points_read = whole.counts.points_read = light.counts.points_read = sums.counts.points_read = 0;
	assert_memory_equal(&made, &whole, sizeof made);
	assert_memory_equal(&made, &light, sizeof made);
	assert_memory_equal(&made, &sums, sizeof made);
	assert_true(sums.hull > 10);
	generation_end(&g);
	folder_remove(&store);
	set_free(&s);
}

/* ---- hints ---- */

static struct {
	struct digest base, list;
	unsigned asked, listed;
} hints;

static bool give_hint(void *ctx, struct digest base, struct digest *ret_list)
{
	(void)ctx;
	hints.asked++;
	assert_true(digest_equal(base, hints.base));
	*ret_list = hints.list;
	return true;
}

static struct dirent *count_readdir(void *dir)
{
	hints.listed++;
	return io_system.readdir(dir);
}

static int reuse_hinted(struct generation *g, int store, const struct cut_region *r, int64_t after_ns, struct pipe_stored *ret)
{
	const struct pipe_reuse_params p = {.storefd = store, .grid = g->reader.grid, .view = &view, .key = &g->key,
					    .region = r, .cap = CAP, .memory = g->memory, .size = g->budget.domain_bytes,
					    .sums = true, .light = true, .hint = give_hint, .after_ns = after_ns};
	const struct io_table *before = io;
	struct io_table counting = *io;
	struct err err = ERR_INIT;
	struct mesh_domain d;
	size_t held;
	int rc;

	counting.readdir = count_readdir;
	hints.asked = hints.listed = 0;
	io = &counting;
	rc = pipe_reuse(&p, &d, ret, &held, &err);
	io = before;
	assert_true(rc >= 0);
	return rc;
}

/* What somebody remembers is looked at first and saves the folder; where it is gone, or of another generation, the folder tells. */
static void test_hints(void **state)
{
	struct folder store = folder_new();
	struct cut_region root[2] = {{0}};
	struct generation g[2];
	struct pipe_stored as[2], got;
	struct err err = ERR_INIT;
	struct set s;

	(void)state;
	rng = 12;
	s = points_of(1500, 3000);
	for (unsigned i = 0; i < 2; i++) {
		int32_t box[4];

		g[i] = generation_of(&s, 1, 1u << i);
		assert_true(grid_box(g[i].reader.grid, box));
		cut_region_root(box, &root[i]);
		keep(&g[i], store.fd, &root[i], &as[i]);
		assert_int_equal(as[i].used_ns, 0);
	}
	assert_true(cut_region_same(&root[0], &root[1]) && !digest_equal(as[0].id.list, as[1].id.list));
	hints.base = as[0].id.base;
	for (unsigned i = 0; i < 4; i++) {
		/* The right one, then that of the other generation. */
		hints.list = as[i / 2].id.list;
		assert_int_equal(reuse_hinted(&g[i & 1], store.fd, &root[0], 0, &got), 0);
		assert_memory_equal(&got.id, &as[i & 1].id, sizeof got.id);
		assert_int_equal(hints.asked, 1);
		assert_true((hints.listed > 0) == ((i & 1) != i / 2));
		assert_true(got.used_ns > 0);
	}
	/* Who knows what was there before asks for what came since, which no hint tells. */
	assert_int_equal(reuse_hinted(&g[1], store.fd, &root[0], INT64_MAX, &got), PIPE_E_ABSENT);
	assert_int_equal(hints.asked, 0);
	hints.list = (struct digest){1, 2};
	assert_int_equal(reuse_hinted(&g[0], store.fd, &root[0], 0, &got), 0);
	assert_true(hints.listed > 0);
	hints.list = as[0].id.list;
	CHECK(store_remove(store.fd, &as[0].id, &err));
	assert_int_equal(reuse_hinted(&g[0], store.fd, &root[0], 0, &got), PIPE_E_ABSENT);
	assert_int_equal(reuse_hinted(&g[1], store.fd, &root[0], 0, &got), 0);
	generation_end(&g[0]);
	generation_end(&g[1]);
	folder_remove(&store);
	set_free(&s);
}

/* ---- what is remembered ---- */

enum { MEMORY_MOST = 64 };

static struct {
	struct pipe_summary summary[MEMORY_MOST];
	size_t n;
	unsigned noted, opened, damaged;
	uint32_t cap;
	bool light, whole; /* not only sums are wanted */
} memory;

static struct pipe_summary *remembered(struct digest base)
{
	for (size_t i = 0; i < memory.n; i++)
		if (digest_equal(memory.summary[i].id.base, base))
			return &memory.summary[i];
	return NULL;
}

static bool recall(void *ctx, struct digest base, struct pipe_summary *ret)
{
	const struct pipe_summary *k = remembered(base);

	(void)ctx;
	if (k)
		*ret = *k;
	return k;
}

static void remember(void *ctx, const struct pipe_summary *k)
{
	struct pipe_summary *at = remembered(k->id.base);

	(void)ctx;
	assert_true(at || memory.n < MEMORY_MOST);
	*(at ? at : &memory.summary[memory.n++]) = *k;
	memory.noted++;
}

static int count_openat(int dirfd, const char *name, int flags, mode_t mode)
{
	memory.opened++;
	return io_system.openat(dirfd, name, flags, mode);
}

static int reuse_recalled(struct generation *g, int store, const struct cut_region *r, struct mesh_domain *ret,
		       struct pipe_stored *ret_stored)
{
	const struct pipe_reuse_params p = {.storefd = store, .grid = g->reader.grid, .view = &view, .key = &g->key,
					    .region = r, .cap = memory.cap, .memory = g->memory, .size = g->budget.domain_bytes,
					    .sums = !memory.whole, .light = memory.light, .recall = recall, .remember = remember,
					    .damaged = &memory.damaged};
	const struct io_table *before = io;
	struct io_table counting = *io;
	struct err err = ERR_INIT;
	size_t held;
	int rc;

	counting.openat = count_openat;
	memory.opened = memory.noted = memory.damaged = 0;
	io = &counting;
	rc = pipe_reuse(&p, ret, ret_stored, &held, &err);
	io = before;
	assert_true(rc >= 0);
	/* What it keeps lies in what is held. */
	if (!rc && memory.whole && !memory.light)
		assert_ptr_equal((uint8_t *)g->memory + held, ret->final + (((size_t)ret->nvertex + 7) / 8 + 7) / 8 * 8);
	else if (!rc && !memory.whole)
		assert_int_equal(held, 0);
	return rc;
}

static void check_numbers(const struct mesh_domain *a, const struct mesh_domain *b)
{
	assert_true(a->nvertex == b->nvertex && a->nopen == b->nopen && a->ntriangle == b->ntriangle && a->nhull == b->nhull);
	assert_true(digest_equal(a->digest, b->digest) && digest_equal(a->closed_digest, b->closed_digest) &&
		    digest_equal(a->own_digest, b->own_digest));
	assert_memory_equal(a->box, b->box, sizeof a->box);
	assert_memory_equal(&a->counts, &b->counts, sizeof a->counts);
	assert_true(!a->link && !a->vertex && !a->triangle && !a->final);
}

/* As without: the same file, the same numbers. */
static int check_recalled(struct generation *g, int store, const struct cut_region *r)
{
	struct pipe_stored as = {.used_ns = 0}, want = {.used_ns = 0};
	struct mesh_domain d, wanted;
	int got = reuse_recalled(g, store, r, &d, &as);

	assert_int_equal(reuse_sums(g, store, r, g->memory, &wanted, &want), got);
	if (got)
		return got;
	assert_memory_equal(&as, &want, sizeof as);
	check_numbers(&d, &wanted);
	return 0;
}

static void keep_remembered(struct generation *g, int store, const struct cut_region *r)
{
	struct pipe_summary k;
	struct pipe_stored as;
	struct mesh_domain d;
	struct err err = ERR_INIT;

	make(g, r, &d);
	CHECK(pipe_keep(store, &g->key, r, &d, g->memory, &as, &k, &err));
	assert_true(digest_equal(k.front.beside.content, g->key.content));
	remember(NULL, &k);
}

/* What is remembered of what was written is what is remembered of what was read. */
static void check_read(struct generation *g, int store, const struct cut_region *r)
{
	struct pipe_summary *at = remembered(pipe_key_of(&g->key, r)), was = *at;
	struct pipe_stored as;
	struct mesh_domain d;

	at->id.base = (struct digest){0, 0};
	assert_int_equal(reuse_recalled(g, store, r, &d, &as), 0);
	assert_true(memory.opened >= 1 && memory.noted == 1);
	at->id.base = was.id.base;
	memory.n--;
	at = &memory.summary[memory.n];
	assert_memory_equal(&at->id, &was.id, sizeof was.id);
	assert_memory_equal(&at->reach, &was.reach, sizeof was.reach);
	assert_int_equal(at->live.n, was.live.n);
	assert_memory_equal(at->live.part, was.live.part, was.live.n * sizeof *was.live.part);
	assert_true(digest_equal(at->front.beside.content, was.front.beside.content) && at->front.payload == was.front.payload &&
		    at->front.bytes == was.front.bytes && at->front.whole == was.front.whole);
	check_numbers(&at->front.domain, &was.front.domain);
}

static void name_of(const struct store_id *id, char name[128])
{
	char base[DIGEST_HEX_SIZE], list[DIGEST_HEX_SIZE];

	digest_hex(id->base, base);
	snprintf(name, 128, "%.2s/d-%s-%s", base, base, digest_hex(id->list, list));
}

static void flip(const struct folder *f, const char *name, off_t at);

/* The file was touched, is damaged, or is gone: what is remembered does not hide it. */
static int truncateat(const struct folder *store, const char *name)
{
	int fd = openat(store->fd, name, O_RDWR | O_CLOEXEC), r = ftruncate(fd, 200);

	close(fd);
	return r;
}

static void check_file(struct generation *g, const struct folder *store, const struct cut_region *r)
{
	struct pipe_summary *k = remembered(pipe_key_of(&g->key, r));
	const struct timespec times[2] = {{1000, 0}, {1000, 5}};
	struct pipe_stored as;
	struct mesh_domain d;
	char name[128];

	name_of(&k->id, name);
	assert_int_equal(check_recalled(g, store->fd, r), 0);
	assert_int_equal(memory.opened, 0);
	assert_int_equal(utimensat(store->fd, name, times, 0), 0);
	assert_int_equal(check_recalled(g, store->fd, r), 0);
	assert_int_equal(memory.opened, 0);
	/* Its last use is that of the file, whoever touched it. */
	assert_int_equal(reuse_recalled(g, store->fd, r, &d, &as), 0);
	assert_true(memory.opened == 0 && as.used_ns == INT64_C(1000000000005));
	/* Who wants triangles gets them. */
	memory.whole = true;
	assert_int_equal(reuse_recalled(g, store->fd, r, &d, &as), 0);
	assert_true(memory.opened == 1 && d.triangle && d.vertex && d.link);
	memory.light = true;
	assert_int_equal(reuse_recalled(g, store->fd, r, &d, &as), 0);
	assert_true(memory.opened >= 1 && !d.triangle && d.vertex && d.link);
	memory.light = memory.whole = false;
	memory.cap = (uint32_t)(k->front.domain.counts.used + k->front.domain.counts.halo) - 1;
	assert_int_equal(reuse_recalled(g, store->fd, r, &d, &as), PIPE_E_ABSENT);
	memory.cap = CAP;
	/* One that was cut short is not what it was. */
	assert_int_equal(truncateat(store, name), 0);
	assert_int_equal(reuse_recalled(g, store->fd, r, &d, &as), PIPE_E_ABSENT);
	assert_true(memory.opened >= 1);
	keep_remembered(g, store->fd, r);
	assert_int_equal(check_recalled(g, store->fd, r), 0);
	name_of(&k->id, name); /* it may have another list in this generation */
	assert_int_equal(unlinkat(store->fd, name, 0), 0);
	assert_int_equal(check_recalled(g, store->fd, r), PIPE_E_ABSENT);
	/* Of one that rots the numbers are those that it had; who wants its triangles finds out, and then it is gone. */
	keep_remembered(g, store->fd, r);
	flip(store, name, 100);
	assert_int_equal(reuse_recalled(g, store->fd, r, &d, &as), 0);
	assert_true(memory.opened == 0 && digest_equal(d.digest, k->front.domain.digest));
	memory.whole = true;
	assert_int_equal(reuse_recalled(g, store->fd, r, &d, &as), PIPE_E_ABSENT);
	assert_int_equal(memory.damaged, 1);
	memory.whole = false;
	assert_int_equal(check_recalled(g, store->fd, r), PIPE_E_ABSENT);
}

/* A push into a corner: most of what was stored before is found without a file being opened, the rest as ever. */
static void test_remembered(void **state)
{
	struct folder store = folder_new();
	unsigned unread = 0, there = 0, reads = 0;
	struct generation g[2];
	struct cut_plan plan;
	struct set s;

	(void)state;
	memset(&memory, 0, sizeof memory);
	memory.cap = CAP;
	rng = 13;
	s = points_of(8000, 20000);
	g[0] = generation_of(&s, 4, 1 << 3);
	g[1] = generation_of(&s, 4, 0);
	plan = plan_of(&g[0]);
	assert_in_range(plan.n, 8, MEMORY_MOST);
	for (size_t i = 0; i < plan.n; i++) {
		keep_remembered(&g[0], store.fd, &plan.leaf[i].region);
		check_read(&g[0], store.fd, &plan.leaf[i].region);
	}
	for (unsigned round = 0; round < 2; round++)
		for (size_t i = 0; i < plan.n; i++) {
			const struct cut_region *r = &plan.leaf[i].region;
			struct pipe_summary *k = remembered(pipe_key_of(&g[1].key, r));
			int is = check_recalled(&g[1], store.fd, r);

			there += !is;
			unread += !is && !memory.opened;
			reads += round && !is && memory.opened;
			/* What was read is remembered as of this generation. */
			assert_int_equal(memory.noted, !is && memory.opened);
			assert_true(!memory.noted || digest_equal(k->front.beside.content, g[1].key.content));
		}
	printf("%u of %zu leaves are there, %u found without a file\n", there / 2, plan.n, unread);
	assert_true(there < 2 * plan.n && unread > there * 3 / 4);
	assert_int_equal(reads, 0);
	for (size_t i = 0; i < plan.n; i++)
		if (!check_recalled(&g[1], store.fd, &plan.leaf[i].region))
			check_file(&g[1], &store, &plan.leaf[i].region);
	cut_plan_done(&plan);
	for (unsigned i = 0; i < 2; i++)
		generation_end(&g[i]);
	folder_remove(&store);
	set_free(&s);
}

/* ---- damage ---- */

static void flip(const struct folder *f, const char *name, off_t at)
{
	int fd = openat(f->fd, name, O_RDWR);
	uint8_t byte;

	assert_true(fd >= 0);
	assert_int_equal(pread(fd, &byte, 1, at), 1);
	byte ^= 4;
	assert_int_equal(pwrite(fd, &byte, 1, at), 1);
	close(fd);
}

/* Any byte of the file wrong, or missing at its end: absent, and gone. Of the rest the front knows nothing. */
static void test_damage(void **state)
{
	struct folder store = folder_new();
	struct generation g;
	struct pipe_stored as, got;
	struct mesh_domain d;
	struct cut_plan plan;
	struct set s;
	char name[128], base[DIGEST_HEX_SIZE], list[DIGEST_HEX_SIZE];
	const struct cut_region *r;
	unsigned nobodys = 0;

	(void)state;
	rng = 9;
	s = points_of(3000, 5000);
	g = generation_of(&s, 1, 0);
	plan = plan_of(&g);
	r = &plan.leaf[plan.n / 2].region;
	keep(&g, store.fd, r, &as);
	digest_hex(as.id.base, base);
	snprintf(name, sizeof name, "%.2s/d-%s-%s", base, base, digest_hex(as.id.list, list));
	assert_true(as.triangles > 20);
	for (uint64_t at = 0; at < as.bytes; at += at < 600 ? 7 : 61) {
		int light;

		assert_int_equal(reuse(&g, store.fd, r, g.memory, true, &d, &got), 0);
		assert_int_equal(reuse(&g, store.fd, r, g.memory, false, &d, &got), 0);
		flip(&store, name, (off_t)at);
		light = reuse(&g, store.fd, r, g.memory, true, &d, &got);
		/* Padding after vertices and triangles is nobody's. */
		if (reuse(&g, store.fd, r, g.memory, false, &d, &got) == 0) {
			flip(&store, name, (off_t)at);
			nobodys++;
			continue;
		}
		assert_true(light == 0 || light == PIPE_E_ABSENT);
		assert_true(at > 384 || light == PIPE_E_ABSENT);
		assert_int_equal(faccessat(store.fd, name, F_OK, 0), -1);
		keep(&g, store.fd, r, &got);
		assert_memory_equal(&as, &got, sizeof as);
	}
	assert_in_range(nobodys, 0, 3);
	for (uint64_t cut = 1; cut < as.bytes; cut += 97) {
		int fd = openat(store.fd, name, O_RDWR);

		assert_int_equal(ftruncate(fd, (off_t)(as.bytes - cut)), 0);
		close(fd);
		assert_int_equal(reuse(&g, store.fd, r, g.memory, cut & 1, &d, &got), PIPE_E_ABSENT);
		assert_int_equal(faccessat(store.fd, name, F_OK, 0), -1);
		keep(&g, store.fd, r, &got);
	}
	cut_plan_done(&plan);
	generation_end(&g);
	folder_remove(&store);
	set_free(&s);
}

/* Of many generations each finds its own; what lay in the folder before version 3 goes. */
static void test_versions(void **state)
{
	struct folder store = folder_new();
	struct err err = ERR_INIT;
	struct pipe_stored as[6];
	struct set s;
	int fd;

	(void)state;
	rng = 11;
	s = points_of(1500, 3000);
	for (unsigned i = 0; i < 6; i++) {
		struct cut_region root = {0};
		struct generation g = generation_of(&s, 1, 1u << i);
		int32_t box[4];

		assert_true(grid_box(g.reader.grid, box));
		cut_region_root(box, &root);
		keep(&g, store.fd, &root, &as[i]);
		generation_end(&g);
	}
	for (unsigned i = 0; i < 6; i++) {
		struct cut_region root = {0};
		struct generation g = generation_of(&s, 2, 1u << i);
		struct pipe_stored got;
		struct mesh_domain d;
		int32_t box[4];

		assert_true(grid_box(g.reader.grid, box));
		cut_region_root(box, &root);
		assert_int_equal(reuse(&g, store.fd, &root, g.memory, i & 1, &d, &got), 0);
		assert_int_equal(got.payload, as[i].payload);
		assert_true(digest_equal(got.digest, as[i].digest));
		generation_end(&g);
	}
	fd = openat(store.fd, "d-0123456789abcdef0123456789abcdef", O_WRONLY | O_CREAT, 0600);
	assert_true(fd >= 0);
	close(fd);
	CHECK(store_sweep(store.fd, &err));
	assert_int_equal(faccessat(store.fd, "d-0123456789abcdef0123456789abcdef", F_OK, 0), -1);
	folder_remove(&store);
	set_free(&s);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_generations),
		cmocka_unit_test(test_before),
		cmocka_unit_test(test_refine),
		cmocka_unit_test(test_refine_much),
		cmocka_unit_test(test_fronts),
		cmocka_unit_test(test_hints),
		cmocka_unit_test(test_remembered),
		cmocka_unit_test(test_damage),
		cmocka_unit_test(test_versions),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
