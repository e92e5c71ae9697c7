/*
 * A stored domain, and lines that come: far from its triangles it is found under the same name; across a triangle, in a part that
 * is far from the region and where no point has changed, it is not.
 */
#include "reuse_fixture.h"

#include "lineset.h"

enum { FAR = 4, ACROSS = 5 };

/* A triangle whose circumcentre is in the region, and the ends of two pieces: far above it, and through its middle, outside of
 * its circle. Each is in a segment of its own, so that boxes are
 * small. */
static const struct point points[7] = {
	{.x = 0, .y = 0, .z = 1, .cls = 2},       {.x = 1000, .y = 0, .z = 2, .cls = 2},
	{.x = 500, .y = 900, .z = 3, .cls = 2},   {.x = -200, .y = 3000, .z = 4, .cls = 2},
	{.x = 1200, .y = 3000, .z = 5, .cls = 2}, {.x = -200, .y = 800, .z = 6, .cls = 2},
	{.x = 1200, .y = 800, .z = 7, .cls = 2},
};
static const uint32_t sources[7] = {1, 2, 3, FAR, FAR, ACROSS, ACROSS};

/* `live`: the source of lines that is live, or 0. */
static struct generation lines_of(struct folder *f, uint32_t live)
{
	static const struct grid_lines totals = {.lines = 1, .vertices = 2, .bytes = 64};
	static struct grid_segment_info info[7];
	struct generation g = {.folder = *f};
	struct set all = {(struct point *)(uintptr_t)points, (uint32_t *)(uintptr_t)sources, 7};
	struct err err = ERR_INIT;

	for (uint32_t i = 0; i < 7; i++) {
		struct set part = {(struct point *)(uintptr_t)&points[i], (uint32_t *)(uintptr_t)&sources[i], 1};
		char name[16];

		snprintf(name, sizeof name, "g%u-%u", live, i);
		CHECK(stage_set(f, name, &part, GRID_STAGE_MIN, &info[i], &err));
	}
	g.m = manifest_of(info, 7, SOURCES);
	g.m.generation = 2;
	manifest_count(&g.m, &all);
	for (uint32_t i = FAR; i <= ACROSS; i++) {
		struct grid_source *s = &g.m.sources[i - 1];

		s->kind = GRID_LINE_VERTICES;
		s->name = "";
		s->lines = &totals;
		s->removed = live == i ? 0 : 2;
	}
	CHECK(grid_manifest_write(f->fd, "m", &g.m, &err));
	g.reader = reader_open(f, "m", GRID_NEWEST, 1 << 20);
	g.budget = (struct pipe_budget){
		.load = LOAD, .cap = CAP, .threads = 1, .domain_bytes = pipe_domain_bytes(CAP, grid_reader_bytes(g.reader.grid))};
	g.memory = aligned_alloc(64, (g.budget.domain_bytes + 63) & ~(size_t)63);
	pipe_key_init(&g.key, g.reader.grid, &view);
	return g;
}

static void lines_end(struct generation *g)
{
	free(g->memory);
	reader_close(&g->reader);
	free(g->m.sources);
}

static struct cut_region region_at(int32_t x, int32_t y)
{
	const int32_t box[4] = {-4000, -4000, 4000, 4000};
	struct cut_region r, half[2];

	cut_region_root(box, &r);
	while (r.wx > 5 && cut_region_split(&r, half))
		r = half[cut_region_holds(&half[1], x, y)];
	return r;
}

static void test_lines_that_come(void **state)
{
	struct folder f = folder_new(), store = folder_new();
	const struct cut_region r = region_at(500, 311);
	struct lineset_piece far = {{-200, 3000}, {1200, 3000}, 0}, across = {{-200, 800}, {1200, 800}, 0};
	struct mesh_domain plain, d, found;
	struct pipe_stored first, again, other, as;
	struct generation g;
	struct digest without;
	struct pipe_reuse_params smaller;
	struct err err = ERR_INIT;
	void *memory;
	size_t held;

	(void)state;
	CHECK(lineset_write(f.fd, "lineset-4", &far, 1, 0, &err));
	CHECK(lineset_write(f.fd, "lineset-5", &across, 1, 0, &err));
	g = lines_of(&f, 0);
	memory = aligned_alloc(64, (g.budget.domain_bytes + 4096) & ~(size_t)63);
	make(&g, &r, &plain);
	assert_int_equal(plain.ntriangle, 1);
	without = plain.digest;
	keep(&g, store.fd, &r, &first);
	lines_end(&g);

	g = lines_of(&f, ACROSS);
	assert_int_equal(reuse(&g, store.fd, &r, memory, false, &found, &as), PIPE_E_ABSENT);
	lines_end(&g);

	g = lines_of(&f, FAR);
	assert_non_null(grid_lines(g.reader.grid));
	assert_int_equal(reuse(&g, store.fd, &r, memory, false, &found, &as), 0);
	make(&g, &r, &d);
	check_same(&d, &found);
	keep(&g, store.fd, &r, &again);
	assert_memory_equal(&again.id, &first.id, sizeof first.id);
	lines_end(&g);

	g = lines_of(&f, ACROSS);
	assert_int_equal(reuse(&g, store.fd, &r, memory, false, &found, &as), PIPE_E_ABSENT);
	make(&g, &r, &d);
	assert_true(d.ntriangle >= 2);
	assert_false(digest_equal(d.digest, without));
	keep(&g, store.fd, &r, &other);
	assert_true(digest_equal(other.id.base, first.id.base) && !digest_equal(other.id.list, first.id.list));
	assert_int_equal(reuse(&g, store.fd, &r, memory, false, &found, &as), 0);
	assert_true(digest_equal(found.digest, other.digest));
	smaller = reuse_params(&g, store.fd, &r, memory);
	smaller.cap = CAP - 1;
	assert_int_equal(pipe_reuse(&smaller, &found, &as, &held, &err), PIPE_E_ABSENT);
	lines_end(&g);

	g = lines_of(&f, 0);
	assert_int_equal(reuse(&g, store.fd, &r, memory, false, &found, &as), 0);
	assert_true(digest_equal(found.digest, without));
	lines_end(&g);
	free(memory);
	folder_remove(&f);
	folder_remove(&store);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_lines_that_come)};

	no_sync();
	return cmocka_run_group_tests(tests, NULL, NULL);
}
