/*
 * Chains of generations over one store, thousands of cases: real segments; manifests in which sources are added,
 * removed and restored; lines that come and go; small ranges with many equal positions; ranges at the ends of the lattice; views;
 * two lattices. Each mesh is the whole one, made at once, with its lines. A stored domain must be equal to one that is made, and
 * a mesh made with stored domains equal to one made without, also if only the fronts are read. The use of the plan and of earlier
 * sites for a halo must not change the result.
 *
 * ACUT_FUZZ_CASES: how many; ACUT_FUZZ_SEED: the first.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "chain_lines.h"
#include "err.h"
#include "grid_fixture.h"
#include "grid_stage.h"
#include "io.h"
#include "pipe.h"
#include "pipe_priv.h"
#include "store.h"
#include "repeat.h"

/* From this family on sources are separate. */
enum { LOCAL = 5 };
enum { CAP = 40000, SOURCES = 25, LEAVES = 90, STEPS = 6, SEGMENTS = 25 };
/* The last sources have line vertices, in cases with lines; one of them is live, or none. */
enum { LINES = 2, POINTS = SOURCES - LINES };

static uint64_t rng, plan_seed;
static uint64_t domains, found, proved, fronts, meshes, bounded, sited, both;
static uint64_t lined, crossed, outs, windows;
static struct folder store;
static struct view view;
static bool with_lines;
static struct chain_lines lines[LINES];

static uint64_t rnd(uint64_t n)
{
	return random_below(&rng, n);
}

/* ---- points ---- */

static struct point point_at(unsigned family, uint32_t range)
{
	static const int32_t ends[6] = {INT32_MIN, INT32_MIN + 1, -1, 0, INT32_MAX - 1, INT32_MAX};
	struct point p = {.x = (int32_t)rnd(range) - (int32_t)(range / 2),
			  .y = (int32_t)rnd(range) - 3,
			  .z = (int32_t)rnd(4),
			  .cls = (uint8_t)(rnd(12) ? 1 + rnd(2) : 7),
			  .ret = rnd(3) ? 0x11 : 0x22,
			  .tag = rnd(12) ? 0 : POINT_WITHHELD};

	if (family == 0) {
		p.x = ends[rnd(6)];
		p.y = ends[rnd(6)];
	} else if (family == 1 && rnd(2)) {
		p.x += 1000003;
		p.y += 700001;
	} else if (family == 2) {
		p.y = 2 * p.x;
	}
	return p;
}

static struct set points_of(unsigned family, size_t n, uint32_t range)
{
	struct set s = {calloc(n, sizeof *s.pts), calloc(n, sizeof *s.ids), n};

	for (size_t i = 0; i < n; i++) {
		/* The first source has many points; sometimes another source repeats a record exactly. */
		s.pts[i] = i && !rnd(10) ? s.pts[rnd(i)] : point_at(family, range);
		s.ids[i] = rnd(3) && family < LOCAL ? 1 : 1 + (uint32_t)rnd(POINTS);
		/* Each stays in a corner: cells of its segments are small, and few regions see a change. */
		if (family >= LOCAL) {
			s.pts[i] = point_at(family, 1 + range / 5);
			s.pts[i].x += (int32_t)(s.ids[i] % 5 * range / 5);
			s.pts[i].y += (int32_t)(s.ids[i] / 5 * range / 5);
		}
	}
	return s;
}

/* ---- a generation ---- */

/* Segments, shared by generations. */
struct layout {
	struct folder folder;
	struct grid_segment_info info[SEGMENTS];
	unsigned n;
};

/* Sources that are not in `there` were pruned. */
static struct layout layout_new(const struct set *s, unsigned there)
{
	struct layout l = {.folder = folder_new()};
	unsigned segments = rnd(2) ? SEGMENTS : 1 + (unsigned)rnd(SEGMENTS);
	uint64_t salt = rnd(SEGMENTS);
	struct err err = ERR_INIT;

	for (unsigned i = 0; i < segments; i++) {
		struct set part = {calloc(s->n + 1, sizeof *s->pts), calloc(s->n + 1, sizeof *s->ids), 0};
		char name[16];

		for (size_t k = 0; k < s->n; k++)
			if ((s->ids[k] + salt) % segments == i && (there >> (s->ids[k] - 1) & 1)) {
				part.pts[part.n] = s->pts[k];
				part.ids[part.n++] = s->ids[k];
			}
		snprintf(name, sizeof name, "s%u", i);
		if (part.n)
			CHECK(stage_set(&l.folder, name, &part, GRID_STAGE_MIN, &l.info[l.n++], &err));
		set_free(&part);
	}
	for (uint32_t i = 0; i < LINES && with_lines; i++) {
		struct chain_lines copy = lines[i];
		char name[32];

		snprintf(name, sizeof name, "lineset-%u", POINTS + 1 + i);
		CHECK(lineset_write(l.folder.fd, name, copy.piece, copy.n, copy.far, &err));
	}
	return l;
}

struct generation {
	struct layout *layout;
	struct grid_manifest m;
	struct reader reader;
	struct pipe_budget budget;
	struct pipe_key key;
	const struct chain_lines *lines; /* NULL: none */
	void *memory, *other;
};

static void generation_begin(struct generation *g, struct layout *l, const struct set *s, unsigned dead, bool moved)
{
	struct err err = ERR_INIT;

	*g = (struct generation){.layout = l, .m = manifest_of(l->info, l->n, SOURCES)};
	g->m.generation = 2;
	if (moved)
		g->m.lattice.k[0] += 12345;
	manifest_count(&g->m, s);
	for (unsigned i = 0; i < SOURCES; i++)
		if (dead >> i & 1)
			g->m.sources[i].removed = 2;
	for (unsigned i = POINTS; i < SOURCES && with_lines; i++) {
		static const struct grid_lines totals = {.lines = 1, .vertices = 2, .bytes = 64};

		g->m.sources[i].kind = GRID_LINE_VERTICES;
		g->m.sources[i].name = "";
		g->m.sources[i].lines = &totals;
		if (!(dead >> i & 1))
			g->lines = &lines[i - POINTS];
	}
	CHECK(grid_manifest_write(l->folder.fd, "m", &g->m, &err));
	g->reader = reader_open(&l->folder, "m", GRID_NEWEST, 1 << 20);
	g->budget = (struct pipe_budget){
		.load = CAP, .cap = CAP, .threads = 1, .domain_bytes = pipe_domain_bytes(CAP, grid_reader_bytes(g->reader.grid))};
	g->memory = aligned_alloc(64, (g->budget.domain_bytes + 63) & ~(size_t)63);
	g->other = aligned_alloc(64, (g->budget.domain_bytes + 63) & ~(size_t)63);
	view_bind(&view, &g->m.lattice);
	pipe_key_init(&g->key, g->reader.grid, &view);
}

static void generation_end(struct generation *g)
{
	free(g->memory);
	free(g->other);
	reader_close(&g->reader);
	free(g->m.sources);
	unlinkat(g->layout->folder.fd, "m", 0);
}

/* ---- regions ---- */

/* The same regions are split in the same way in all generations of a case. */
static void cut(const struct cut_region *r, struct cut_region *leaf, unsigned *n, unsigned depth)
{
	char text[CUT_REGION_TEXT_SIZE];
	struct cut_region half[2];
	struct digest d;

	cut_region_text(r, text);
	d = digest_hash(text, strlen(text));
	d.lo ^= plan_seed;
	if (depth < 34 && *n < LEAVES - 40 && random_below(&d.lo, 10) < (depth < 5 ? 9 : 6) && cut_region_split(r, half)) {
		cut(&half[0], leaf, n, depth + 1);
		cut(&half[1], leaf, n, depth + 1);
	} else {
		leaf[(*n)++] = *r;
	}
}

static void check_same(const struct mesh_domain *a, const struct mesh_domain *b, bool light)
{
	assert_int_equal(a->nvertex, b->nvertex);
	assert_int_equal(a->nopen, b->nopen);
	assert_int_equal(a->ntriangle, b->ntriangle);
	assert_true(digest_equal(a->digest, b->digest) && digest_equal(a->closed_digest, b->closed_digest));
	assert_int_equal(a->counts.points, b->counts.points);
	assert_int_equal(a->counts.used, b->counts.used);
	assert_int_equal(a->counts.halo, b->counts.halo);
	assert_memory_equal(a->counts.removed, b->counts.removed, sizeof a->counts.removed);
	assert_true(digest_equal(a->own_digest, b->own_digest));
	assert_int_equal(a->nhull, b->nhull);
	if (!a->ntriangle)
		return;
	assert_memory_equal(a->box, b->box, sizeof a->box);
	assert_memory_equal(a->vertex, b->vertex, (light ? a->nopen : a->nvertex) * sizeof *a->vertex);
	if (a->nopen)
		assert_memory_equal(a->link, b->link, a->nopen * sizeof *a->link);
	assert_true(light == !b->triangle);
	if (!light)
		assert_memory_equal(a->triangle, b->triangle, a->ntriangle * sizeof *a->triangle);
}

static void make(struct generation *g, const struct cut_region *r, struct mesh_domain *ret)
{
	struct err err = ERR_INIT;
	uint64_t need;

	CHECK(pipe_domain(g->reader.grid, &view, r, NULL, &g->budget, g->memory, ret, &need, &err));
}

static struct pipe_reuse_params reuse_params(const struct generation *g, int storefd, const struct cut_region *r, void *memory)
{
	return (struct pipe_reuse_params){.storefd = storefd,
					  .grid = g->reader.grid,
					  .view = &view,
					  .key = &g->key,
					  .region = r,
					  .cap = CAP,
					  .memory = memory,
					  .size = g->budget.domain_bytes};
}

static bool reuse(struct generation *g, const struct cut_region *r, bool light, struct mesh_domain *ret)
{
	struct pipe_reuse_params p = reuse_params(g, store.fd, r, g->other);
	struct err err = ERR_INIT;
	struct pipe_stored as;
	size_t held;
	struct store_front front;
	int rc;

	p.light = light;
	rc = pipe_reuse(&p, ret, &as, &held, &err);
	if (rc < 0)
		fail_msg("%s", err.message);
	if (rc)
		return false;
	CHECK(store_head(store.fd, &as.id, &front, &err));
	proved += !digest_equal(front.beside.content, g->key.content);
	return true;
}

/* With what the plan and an earlier generation know of its halo: in `other`. False: nothing is known. */
static bool make_known(struct generation *g, const struct cut_plan *plan, unsigned i, struct mesh_domain *ret)
{
	const struct cut_region *r = &plan->leaf[i].region;
	const struct pipe_reuse_params p = reuse_params(g, store.fd, r, g->other);
	struct pipe_before before;
	struct pipe_known known = {.sites = plan->leaf[i].known && rnd(4) ? plan->sites : NULL};
	struct err err = ERR_INIT;
	uint64_t need;

	if (rnd(4) && pipe_before(&p, &before))
		known.before = &before;
	if (!known.before && !known.sites)
		return false;
	bounded += known.before != NULL;
	sited += known.sites != NULL;
	both += known.before && known.sites;
	CHECK(pipe_domain(g->reader.grid, &view, r, &known, &g->budget, g->other, ret, &need, &err));
	return true;
}

static void emit(struct pipe_emitter *e, struct mesh_domain *d, const struct cut_region *r)
{
	struct err err = ERR_INIT;

	CHECK(pipe_emit(e, d, r, NULL, &err));
}

static void check_totals(struct pipe_totals a, struct pipe_totals b)
{
	a.counts.cells_read = b.counts.cells_read = a.counts.points_read = b.counts.points_read = 0;
	assert_memory_equal(&a, &b, sizeof a);
}

static int probe_leaves(struct generation *g, const struct cut_region *leaf, unsigned n, uint32_t load, const atomic_bool *cancel,
			struct cut_plan *ret, struct err *why)
{
	struct grid_reader *reader;
	struct err err = ERR_INIT;

	*ret = (struct cut_plan){.load = load};
	CHECK(cut_plan_room(ret, n, &err));
	CHECK(grid_reader_new(g->reader.grid, g->memory, g->budget.domain_bytes, &reader, &err));
	for (; ret->n < n; ret->n++) {
		ret->leaf[ret->n] = (struct cut_leaf){.region = leaf[ret->n]};
		CHECK(cut_count(reader, &leaf[ret->n], &ret->leaf[ret->n].count, &err));
	}
	grid_reader_free(reader);
	return pipe_plan_probe(g->reader.grid, &view, &g->budget, g->memory, cancel, ret, why);
}

static unsigned cancelled;

/* One of the regions, as of leaves that may have few positions: a halo has more than those that are nearly empty, so it
 * is found together with others. All fit, so none is split. */
static void plan_known(struct generation *g, const struct cut_region *leaf, unsigned n, struct cut_plan *ret)
{
	const atomic_bool stop = true;
	struct err err = ERR_INIT;
	uint32_t load = 8u << rnd(8);
	int r = probe_leaves(g, leaf, n, load, &stop, ret, &err); /* may find that nothing has to be read */

	assert_true(!r || r == -ERR_CANCELLED);
	cancelled += r != 0;
	cut_plan_done(ret);
	err_clear(&err);
	CHECK(probe_leaves(g, leaf, n, load, NULL, ret, &err));
	assert_int_equal(ret->n, n);
}

/* The mesh of a window that has everything in it is the whole mesh. */
static void check_window(struct generation *g, const struct pipe_totals *whole)
{
	struct view all = view;
	struct pipe_emitter *e;
	struct pipe_totals totals;
	struct mesh_counts empty;
	struct cut_plan plan;
	struct err err = ERR_INIT;
	uint64_t need;
	int rc;

	all.window = VIEW_CROP_BOX;
	for (unsigned i = 0; i < 4; i++)
		all.window_box[i] = (i < 2 ? INT32_MIN : INT32_MAX) + g->m.lattice.k[i % 2];
	view_bind(&all, &g->m.lattice);
	rc = pipe_plan(g->reader.grid, &all, &g->budget, g->memory, &plan, &empty, &err);
	if (rc == PIPE_E_EMPTY)
		return;
	assert_int_equal(rc, 0);
	CHECK(pipe_emitter_new(&g->m.lattice, 1 << 16, g->layout->folder.fd, &e, &err));
	pipe_emitter_part(e);
	for (size_t i = 0; i < plan.n; i++) {
		struct mesh_domain d;

		CHECK(pipe_domain(g->reader.grid, &all, &plan.leaf[i].region, NULL, &g->budget, g->memory, &d, &need, &err));
		emit(e, &d, &plan.leaf[i].region);
	}
	CHECK(pipe_emitter_finish(e, &totals, &err));
	assert_int_equal(totals.triangles, whole->triangles);
	assert_true(digest_equal(totals.digest, whole->digest));
	pipe_emitter_free(e);
	cut_plan_done(&plan);
	windows++;
}

static void one_generation(struct generation *g)
{
	struct cut_region leaf[LEAVES], root;
	struct pipe_emitter *made, *taken;
	struct pipe_totals a, b;
	struct cut_plan plan;
	struct err err = ERR_INIT;
	int32_t box[4];
	unsigned n = 0;

	if (!grid_box(g->reader.grid, box))
		return;
	cut_region_root(box, &root);
	cut(&root, leaf, &n, 0);
	plan_known(g, leaf, n, &plan);
	CHECK(pipe_emitter_new(&g->m.lattice, 1 << 16, g->layout->folder.fd, &made, &err));
	CHECK(pipe_emitter_new(&g->m.lattice, 1 << 16, g->layout->folder.fd, &taken, &err));
	if (pipe_has_out(g->reader.grid)) {
		pipe_emitter_part(made);
		pipe_emitter_part(taken);
		outs++;
	}
	for (unsigned i = 0; i < n; i++) {
		struct mesh_domain d, e, k;
		struct pipe_stored as;
		bool light = rnd(2), hit, known;

		domains++;
		hit = reuse(g, &leaf[i], light, &e);
		make(g, &leaf[i], &d);
		if (hit) {
			found++;
			fronts += light;
			check_same(&d, &e, light && e.ntriangle);
			emit(taken, &e, &leaf[i]);
		}
		known = make_known(g, &plan, i, &k);
		if (known)
			check_same(&d, &k, false);
		known = known && rnd(2);
		if (rnd(4))
			CHECK(pipe_store(store.fd, &g->key, &leaf[i], known ? &k : &d, known ? g->other : g->memory, &as, NULL,
					 &err));
		emit(made, &d, &leaf[i]);
		if (!hit) {
			make(g, &leaf[i], &d);
			emit(taken, &d, &leaf[i]);
		}
	}
	CHECK(pipe_emitter_finish(made, &a, &err));
	CHECK(pipe_emitter_finish(taken, &b, &err));
	check_totals(a, b);
	crossed += chain_lines_check(&g->reader, &view, g->lines, &a);
	lined += g->lines && g->lines->n;
	if (g->lines && rnd(2))
		check_window(g, &a);
	cut_plan_done(&plan);
	meshes++;
	pipe_emitter_free(made);
	pipe_emitter_free(taken);
}

/* ---- chains ---- */

/* The sources of lines that are dead: all of them, or all but one. */
static unsigned line_sources(void)
{
	unsigned all = ((1u << LINES) - 1) << POINTS;

	return with_lines && rnd(4) ? all & ~(1u << (POINTS + rnd(LINES))) : all;
}

static void one_case(uint64_t seed)
{
	unsigned family, dead, lost;
	struct layout l;
	struct set s;

	rng = seed * UINT64_C(0x9e3779b97f4a7c15) + 1;
	plan_seed = random_next(&rng);
	family = (unsigned)rnd(12);
	s = points_of(family, family >= LOCAL ? 100 + rnd(900) : 3 + rnd(70),
		      rnd(3) ? 2 + (uint32_t)rnd(family >= LOCAL ? 60 : 8) : 2 + (uint32_t)rnd(1000));
	view = VIEW_INIT;
	view.duplicates = rnd(2) ? VIEW_LOWEST : VIEW_HIGHEST;
	view.keep_noise = rnd(2);
	view.keep_withheld = rnd(2);
	view.ground = rnd(4) == 0;
	if (rnd(4) == 0) {
		view.has_zmax = true;
		view.zmax = 2;
	}
	with_lines = rnd(2);
	for (uint32_t i = 0; i < LINES && with_lines; i++) {
		const struct set points = {s.pts, s.ids, s.n};

		chain_lines_make(&rng, &points, i ? &lines[0] : NULL, &lines[i]);
	}
	for (uint32_t i = 0; i < LINES && with_lines; i++)
		chain_lines_add(&lines[i], &s, POINTS + 1 + i);
	store = folder_new();
	dead = 1u << rnd(POINTS) | 1u << rnd(POINTS) | line_sources();
	lost = rnd(3) ? 0 : dead;
	l = layout_new(&s, ~lost);
	for (unsigned i = 0; i < STEPS; i++) {
		struct generation g;

		generation_begin(&g, &l, &s, dead, rnd(8) == 0);
		one_generation(&g);
		generation_end(&g);
		/* A push, a removal, both, a restored source, or no change. Sometimes in new segments. */
		for (unsigned k = (unsigned)rnd(3); k > 0; k--)
			dead ^= 1u << rnd(POINTS);
		if (rnd(2))
			dead = (dead & ((1u << POINTS) - 1)) | line_sources();
		if (lost & ~dead || rnd(6) == 0) {
			folder_remove(&l.folder);
			lost = rnd(3) ? 0 : dead;
			l = layout_new(&s, ~lost);
		}
	}
	folder_remove(&l.folder);
	folder_remove(&store);
	set_free(&s);
}

static void test_chains(void **state)
{
	uint64_t n = repeat_cases(300), at = repeat_first();

	(void)state;
	no_sync();
	for (uint64_t i = 0; i < n; i++) {
		if (getenv("ACUT_FUZZ_TELL"))
			fprintf(stderr, "%llu\n", (unsigned long long)(at + i));
		one_case(at + i);
	}
	printf("%llu meshes of %llu domains: %llu found, %llu of these of other generations, %llu by their fronts alone\n",
	       (unsigned long long)meshes, (unsigned long long)domains, (unsigned long long)found, (unsigned long long)proved,
	       (unsigned long long)fronts);
	printf("%llu made with sites of an earlier generation, %llu with sites of the plan, %llu with both\n",
	       (unsigned long long)bounded, (unsigned long long)sited, (unsigned long long)both);
	printf("%llu meshes with lines, %llu with areas that are out, %llu crossed triangles, %llu windows\n",
	       (unsigned long long)lined, (unsigned long long)outs, (unsigned long long)crossed, (unsigned long long)windows);
	/* One of many cases can be repeated alone. */
	if (n < 40)
		return;
	assert_true(lined > meshes / 5 && outs > 0 && crossed > lined && windows > 0);
	assert_true(bounded > domains / 100 && sited > 0 && both > 0);
	assert_true(cancelled > 0);
	assert_true(found > domains / 10 && found < domains && proved > domains / 1000 && fronts > found / 4);
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_chains)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
