/*
 * Finished domains in the store, with real caches: what is made of one generation is found in another exactly where
 * making it gives the same, byte for byte; an emission from the fronts alone gives the same totals; damaged domains are
 * made again.
 */
#include <dirent.h>

#include "io.h"
#include "reuse_fixture.h"

/* ---- consecutive generations ---- */

static uint64_t judged, found, hiding;

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
		hiding += a.counts.removed[VIEW_BY_WEIGHT] > 0;
	}
	free(memory);
	cut_plan_done(&plan);
}

static void test_generations(void **state)
{
	const unsigned cases = getenv("ACUT_SLOW") ? 200 : 25;

	(void)state;
	no_sync();
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

/* Classes and sources with weights. The sources of a slot can have other numbers in the new generation. */
static void weigh(uint32_t side, bool renumbered)
{
	const int32_t radius[] = {(int32_t)(side / 90) + 1, (int32_t)(side / 40) + 1, (int32_t)(side / 200)};
	struct slots_list list = {NULL, 0, 0};
	struct err err = ERR_INIT;

	view_done(&view);
	view = VIEW_INIT;
	assert_true(view_weight_set(&view, 7, radius[0]));
	assert_true(slots_list_add(&list, 2, 2, radius[1]) &&
		    slots_list_add(&list, renumbered ? 77 : 4, renumbered ? 99 : 5, radius[2]));
	CHECK(view_weight_sources(&view, &list, &err));
	slots_list_free(&list);
}

static void test_weights(void **state)
{
	const unsigned cases = getenv("ACUT_SLOW") ? 200 : 20;

	(void)state;
	no_sync();
	judged = found = hiding = 0;
	for (unsigned c = 1; c < cases; c++) {
		struct set s;
		struct generation old, new;
		struct folder store = folder_new();
		uint32_t side;
		bool less;

		rng = 5000 + c;
		side = 300 + (uint32_t)rnd(100000);
		less = rnd(2);
		s = points_of(3000 + rnd(9000), side);
		weigh(side, rnd(2));
		old = generation_of(&s, 1 + (unsigned)rnd(3), 0x30 | (less ? 8 : 0));
		weigh(side, rnd(2));
		new = generation_of(&s, 1 + (unsigned)rnd(4),
				    (view.slots->n == 2 && rnd(2) ? 0x20 : 0x30) | (less && rnd(3) ? 8 : 0));
		compare_generations(&old, &new, store.fd);
		generation_end(&old);
		generation_end(&new);
		folder_remove(&store);
		set_free(&s);
	}
	printf("%llu of %llu domains with weights found in the next generation, in %llu of them positions are hidden\n",
	       (unsigned long long)found, (unsigned long long)judged, (unsigned long long)hiding);
	assert_true(found > judged / 2 && found < judged && hiding > found / 2);
	view_done(&view);
	view = VIEW_INIT;
}

/* ---- earlier sites bound a halo ---- */

static bool before_of(struct generation *g, int store, const struct cut_region *r, struct pipe_before *ret)
{
	const struct pipe_reuse_params p = reuse_params(g, store, r, g->memory);

	return pipe_before(&p, ret);
}

/* Points of source 1, and more of source 2 in a corner of them; each source has its own segment. */
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
			/* Not all of the earlier sites exist. */
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

/* One generation stores its domains; the next one splits few regions, only changed ones; a third one finds the parts. */
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
		struct pipe_reuse_params p = reuse_params(g, store.fd, NULL, g->memory);
		struct cut_plan plan = plan_of(g), again;
		size_t before = plan.n, made = 0, fits = 0, there = 0;
		struct err err = ERR_INIT;
		struct pipe_stored as;
		uint64_t points = 0, told = 0;

		p.load = LOAD;
		p.there = count_there;
		p.ctx = &told;
		CHECK(pipe_refine(&p, &plan, &err));
		for (size_t i = 0; i < plan.n; i++) {
			struct store_version version;
			size_t n;

			CHECK(store_versions(store.fd, pipe_key_of(&g->key, &plan.leaf[i].region), &version, 1, &n, &err));
			/* Parts of outgrown leaves are small, too. */
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
				CHECK(pipe_store(store.fd, &g->key, &plan.leaf[i].region, &d, g->memory, &as, NULL, &err));
				made++;
			}
			points += d.counts.points;
		}
		assert_int_equal(told, there);
		/* They are still a partition, and all of them are found the next time. */
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

/* If much has changed, large regions are faster: the plan stays. */
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
			struct pipe_reuse_params p = reuse_params(&g[i], store.fd, NULL, g[i].memory);

			p.load = LOAD;
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
						       reuse(g, store, r, g->memory, light, &d, &as),
					 0);
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
	struct pipe_reuse_params p = reuse_params(g, store, r, g->memory);
	const struct io_table *before = io;
	struct io_table counting = *io;
	struct err err = ERR_INIT;
	struct mesh_domain d;
	size_t held;
	int rc;

	p.sums = true;
	p.light = true;
	p.hint = give_hint;
	p.after_ns = after_ns;
	counting.readdir = count_readdir;
	hints.asked = hints.listed = 0;
	io = &counting;
	rc = pipe_reuse(&p, &d, ret, &held, &err);
	io = before;
	assert_true(rc >= 0);
	return rc;
}

/* A remembered list is tried first, which avoids reading the folder; if it does not exist, or is of another generation,
 * the folder is read. */
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
	/* A caller that knows the earlier domains asks only for later ones, which no hint names. */
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

/* ---- damage ---- */

/* Any byte of the file wrong, or missing at its end: absent, and removed. The front does not cover the rest. */
static void test_damage(void **state)
{
	struct folder store = folder_new();
	struct generation g;
	struct pipe_stored as, got;
	struct mesh_domain d;
	struct cut_plan plan;
	struct set s;
	char name[128];
	const struct cut_region *r;
	unsigned nobodys = 0;

	(void)state;
	rng = 9;
	s = points_of(3000, 5000);
	g = generation_of(&s, 1, 0);
	plan = plan_of(&g);
	r = &plan.leaf[plan.n / 2].region;
	keep(&g, store.fd, r, &as);
	name_of(&as.id, name);
	assert_true(as.triangles > 20);
	for (uint64_t at = 0; at < as.bytes; at += at < 600 ? 7 : 61) {
		int light;

		assert_int_equal(reuse(&g, store.fd, r, g.memory, true, &d, &got), 0);
		assert_int_equal(reuse(&g, store.fd, r, g.memory, false, &d, &got), 0);
		flip(&store, name, (off_t)at);
		light = reuse(&g, store.fd, r, g.memory, true, &d, &got);
		/* Padding after vertices and triangles is not checked. */
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

/* Many generations each find their own; what was in the folder before version 3 is removed. */
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

/* The key of a mesh, by which its stream is continued, is that of format.md: another version of the kernel has another. */
static void test_key(void **state)
{
	const struct pipe_key key = {.content = {1, 2}, .part = {{3, 4}, {5, 6}}};
	const struct digest parts[3] = {key.content, key.part[0], key.part[1]};
	const struct cut_region root = {.x = 8, .y = 16, .wx = 3, .wy = 4};
	char all[256], text[CUT_REGION_TEXT_SIZE];
	size_t n = sizeof PIPE_KERNEL;

	memcpy(all, PIPE_KERNEL, n);
	memcpy(all + n, parts, sizeof parts);
	n += sizeof parts;
	cut_region_text(&root, text);
	memcpy(all + n, text, strlen(text));
	assert_true(digest_equal(pipe_key_mesh(&key, &root), digest_hash(all, n + strlen(text))));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_generations), cmocka_unit_test(test_weights),     cmocka_unit_test(test_before),
		cmocka_unit_test(test_refine),      cmocka_unit_test(test_refine_much), cmocka_unit_test(test_fronts),
		cmocka_unit_test(test_hints),       cmocka_unit_test(test_damage),      cmocka_unit_test(test_versions),
		cmocka_unit_test(test_key),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
