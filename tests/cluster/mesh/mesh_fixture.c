/* A work folder with a dataset, and the mesh of its points made in one process and gathered from packs. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cmocka.h>

#include "io.h"
#include "mesh_fixture.h"
#include "repeat.h"

enum { SOURCES = 5, EMITTER = 1 << 20 };

static void commit(const struct run *run)
{
	struct work_attempt *a = NULL;
	struct err err = ERR_INIT;

	CHECK(work_begin(run->work, WORK_COMMIT, 0, &a, &err));
	CHECK(work_result_file(a, WORK_IN_DATASET "/manifest", &err));
	CHECK(work_publish(a, &err));
	work_end(a);
}

uint32_t run_gathers;

void run_make(struct run *run, const char *folder, struct set set, unsigned segments, uint32_t tasks)
{
	struct work_about about = {.id = 7, .memory = 64 << 20};
	struct grid_segment_info info[8];
	struct err err = ERR_INIT;
	struct grid_manifest m;
	struct folder data;

	*run = (struct run){.set = set, .tasks = tasks, .p = {.view = "", .memory = 64 << 20}};
	snprintf(run->folder, sizeof run->folder, "%s", folder);
	about.tasks[WORK_COMMIT] = about.tasks[WORK_PLAN] = 1;
	about.tasks[WORK_MESH] = tasks;
	about.tasks[WORK_GATHER] = run_gathers;
	about.tasks[WORK_SUM] = about.tasks[WORK_FINISH] = run_gathers > 0;
	CHECK(work_make(folder, &about, NULL, 0, &run->work, &err));
	work_set_patience(run->work, 0);
	data.fd = openat(work_fd(run->work), WORK_IN_DATASET, O_RDONLY | O_DIRECTORY);
	assert_true(data.fd >= 0);
	stage_sources(&data, &set, segments, info);
	m = manifest_of(info, segments, SOURCES);
	manifest_count(&m, &set);
	CHECK(grid_manifest_write(data.fd, "manifest", &m, &err));
	free(m.sources);
	close(data.fd);
	commit(run);
}

void run_remove(struct run *run)
{
	struct err err = ERR_INIT;

	run->work = work_close(run->work);
	set_free(&run->set);
	CHECK(io_folder_remove(AT_FDCWD, run->folder, &err));
}

/* ---- meshes ---- */

void whole_free(struct whole *w)
{
	free(w->domain);
	*w = (struct whole){0};
}

static void add(struct whole *w, const char *region, const struct mesh_domain *d)
{
	if (w->n == w->room) {
		w->room = w->room ? 2 * w->room : 64;
		w->domain = realloc(w->domain, w->room * sizeof *w->domain);
		assert_non_null(w->domain);
	}
	w->domain[w->n] = (struct whole_domain){.digest = d->digest, .own = d->own_digest, .vertices = d->counts.used};
	snprintf(w->domain[w->n++].region, CUT_REGION_TEXT_SIZE, "%s", region);
}

static struct pipe_emitter *emitter_of(const struct run *run, const struct lattice *lattice)
{
	struct pipe_emitter *e = NULL;
	struct err err = ERR_INIT;

	CHECK(pipe_emitter_new(lattice, EMITTER, work_fd(run->work), &e, &err));
	return e;
}

static int take_block(void *ctx, const struct mesh_block *b, struct err *err)
{
	(void)ctx, (void)b, (void)err;
	return 0;
}
static const struct mesh_sink sink = {.block = take_block};

static void finish(struct pipe_emitter *e, struct whole *w)
{
	struct err err = ERR_INIT;

	CHECK(pipe_emitter_finish(e, &w->totals, &err));
	pipe_emitter_free(e);
}

static struct view view_of(const struct run *run, const struct grid_manifest *m)
{
	struct err err = ERR_INIT;
	struct view view;

	CHECK(view_resolve(run->p.view, &m->lattice, m->unit_xy, m->unit_z, &view, &err));
	view_bind(&view, &m->lattice);
	return view;
}

void whole_make(const struct run *run, uint32_t load, uint32_t cap, struct whole *ret)
{
	struct pipe_budget budget;
	struct mesh_counts empty;
	struct grid_reader *reader = NULL;
	struct pipe_emitter *e;
	struct cut_plan plan = {0};
	struct err err = ERR_INIT;
	struct grid *grid = NULL;
	struct view view;
	uint64_t need = 0;
	void *memory, *more;
	int dirfd = openat(work_fd(run->work), WORK_IN_DATASET, O_RDONLY | O_DIRECTORY), r;

	*ret = (struct whole){0};
	CHECK(grid_open(dirfd, "manifest", GRID_NEWEST, NULL, 1 << 20, &grid, &err));
	CHECK(pipe_budget_kept((uint64_t)1 << 30, 1, grid, load, cap, &budget, &err));
	memory = aligned_alloc(64, (budget.domain_bytes + 63) & ~(size_t)63);
	more = aligned_alloc(64, (grid_reader_bytes(grid) + 63) & ~(size_t)63);
	view = view_of(run, grid_manifest(grid));
	e = emitter_of(run, &grid_manifest(grid)->lattice);
	r = pipe_plan_make(grid, &view, &budget, memory, &plan, &empty, &err);
	if (r == PIPE_E_EMPTY)
		pipe_emit_empty(e, &empty);
	else
		CHECK(r);
	for (size_t i = 0; i < plan.n;) {
		const struct pipe_known known = {.flat = plan.leaf[i].flat};
		char text[CUT_REGION_TEXT_SIZE];
		struct mesh_domain d;

		r = pipe_domain(grid, &view, &plan.leaf[i].region, &known, &budget, memory, &d, &need, &err);
		if (r == PIPE_E_SPLIT) {
			CHECK(grid_reader_new(grid, more, grid_reader_bytes(grid), &reader, &err));
			CHECK(pipe_plan_split(&plan, i, reader, &view, need, cap, &err));
			reader = grid_reader_free(reader);
			ret->splits++;
			continue;
		}
		CHECK(r);
		add(ret, cut_region_text(&plan.leaf[i].region, text), &d);
		CHECK(pipe_emit(e, &d, &plan.leaf[i].region, &sink, &err));
		i++;
	}
	finish(e, ret);
	cut_plan_done(&plan);
	view_done(&view);
	grid_close(grid);
	close(dirfd);
	free(memory);
	free(more);
}

static void gather_pack(const struct store_pack *k, struct pipe_emitter *e, struct whole *ret)
{
	struct err err = ERR_INIT;

	for (uint64_t i = 0; i < k->n; i++) {
		struct store_pack_entry entry;
		struct cut_region region;
		struct mesh_domain d;
		void *memory;

		CHECK(store_pack_entries(k, i, 1, &entry, &err));
		memory = malloc(store_pack_memory(&entry) + 1);
		CHECK(store_pack_get(k, &entry, memory, store_pack_memory(&entry), &d, &err));
		assert_true(cut_region_parse(entry.region, &region));
		add(ret, entry.region, &d);
		CHECK(pipe_emit(e, &d, &region, &sink, &err));
		free(memory);
	}
}

/* What a record says of the places of domains is what the index has. */
static void check_extent(const struct store_pack *k, const struct mesh_extent *x)
{
	struct mesh_extent found;
	struct err err = ERR_INIT;

	mesh_extent_begin(&found);
	for (uint64_t i = 0; i < k->n; i++) {
		const struct mesh_group *g = &x->group[i / x->each];
		struct store_pack_entry e;

		CHECK(store_pack_entries(k, i, 1, &e, &err));
		mesh_extent_add(&found, &e);
		assert_true(i / x->each < x->n && store_pack_memory(&e) <= x->largest);
		for (int a = 0; a < 2 && e.ntriangle; a++)
			assert_true(g->box[a] <= e.box[a] && g->box[a + 2] >= e.box[a + 3] && x->box[a] <= e.box[a] &&
				    x->box[a + 3] >= e.box[a + 3]);
	}
	assert_true(mesh_extent_same(&found, x));
}

void whole_gather(const struct run *run, struct whole *ret, struct mesh_sums *ret_sums)
{
	struct mesh_plan_about about;
	struct grid_manifest *m = NULL;
	struct err err = ERR_INIT;
	struct pipe_emitter *e;

	*ret = (struct whole){0};
	*ret_sums = (struct mesh_sums){0};
	CHECK(grid_manifest_read(work_fd(run->work), WORK_IN_DATASET "/manifest", &m, &err));
	CHECK(mesh_plan_about(run->work, &about, &err));
	assert_int_equal(about.tasks, run->tasks);
	e = emitter_of(run, &m->lattice);
	for (uint32_t i = 0; i < run->tasks; i++) {
		struct mesh_task t;
		struct store_pack k;
		int fd;

		CHECK(mesh_task_about(run->work, i, &t, &err));
		mesh_sums_add(ret_sums, &t.sums);
		assert_true(!*t.pack == !t.sums.domains);
		if (!*t.pack)
			continue;
		assert_int_equal(t.bytes, t.sums.bytes);
		CHECK(work_file_open(run->work, t.pack, t.bytes, &fd, &err));
		CHECK(store_pack_open(fd, t.pack, &k, &err));
		assert_true(digest_equal(k.of, about.of) && k.n == t.sums.domains);
		check_extent(&k, &t.extent);
		gather_pack(&k, e, ret);
		close(fd);
	}
	if (!ret->n)
		pipe_emit_empty(e, &about.empty);
	finish(e, ret);
	mesh_plan_about_done(&about);
	grid_manifest_free(m);
}

void whole_same(const struct whole *a, const struct whole *b)
{
	const struct pipe_totals *x = &a->totals, *y = &b->totals;

	assert_int_equal(a->n, b->n);
	for (size_t i = 0; i < a->n; i++) {
		assert_string_equal(a->domain[i].region, b->domain[i].region);
		assert_true(digest_equal(a->domain[i].digest, b->domain[i].digest) &&
			    digest_equal(a->domain[i].own, b->domain[i].own) && a->domain[i].vertices == b->domain[i].vertices);
	}
	assert_true(x->vertices == y->vertices && x->triangles == y->triangles && x->hull == y->hull && x->domains == y->domains);
	assert_true(digest_equal(x->digest, y->digest) && digest_equal(x->vertex_digest, y->vertex_digest));
	assert_true(x->counts.points == y->counts.points && x->counts.used == y->counts.used);
	assert_memory_equal(x->counts.removed, y->counts.removed, sizeof x->counts.removed);
	assert_true(x->counts.most.points == y->counts.most.points);
}

/* ---- runs ---- */

char run_top[64], run_folder[128];

void set_up(struct run *run, struct set set, unsigned segments, uint32_t tasks)
{
	static unsigned n;

	snprintf(run_folder, sizeof run_folder, "%s/work-%u", run_top, n++);
	run_make(run, run_folder, set, segments, tasks);
}

void run_all(const struct run *run)
{
	struct err err = ERR_INIT;

	CHECK(mesh_phase_plan(run->work, &run->p, &err));
	for (uint32_t i = 0; i < run->tasks; i++)
		CHECK(mesh_phase_mesh(run->work, run->tasks - 1 - i, &run->p, &err)); /* in any order */
}

/* The packs against one process, and the records against both. */
void compare(const struct run *run, const struct whole *want)
{
	struct mesh_sums sums;
	struct whole got;

	whole_gather(run, &got, &sums);
	whole_same(&got, want);
	assert_true(sums.domains == want->n && sums.triangles == want->totals.triangles);
	if (want->n) {
		assert_true(sums.vertices == want->totals.vertices && sums.hull == want->totals.hull);
		assert_true(digest_equal(sums.digest, want->totals.digest));
		assert_true(digest_equal(sums.vertex_digest, want->totals.vertex_digest));
		assert_true(sums.counts.points == want->totals.counts.points &&
			    sums.counts.most.points == want->totals.counts.most.points);
		assert_memory_equal(sums.counts.removed, want->totals.counts.removed, sizeof sums.counts.removed);
	}
	whole_free(&got);
}

static unsigned asked, kill_at;

static int killed(void *ctx)
{
	if (kill_at && ++asked == kill_at)
		raise(SIGKILL);
	return 0;
}

struct work *run_opened(const struct run *run, unsigned at)
{
	struct work *work = NULL;
	struct err err = ERR_INIT;

	CHECK(work_open(run->folder, &work, &err));
	kill_at = at;
	work_set_interrupt(work, killed, NULL);
	return work;
}

int run_begin(void **state)
{
	repeat_folder(run_top, sizeof run_top, "run");
	return 0;
}

int run_end(void **state)
{
	return repeat_remove(run_top);
}

int status_of(pid_t pid)
{
	int status;

	assert_int_equal(waitpid(pid, &status, 0), pid);
	return status;
}

struct set small_set(uint64_t *seed)
{
	enum { SHAPE_LINE = SHAPES, SHAPE_FEW, SHAPE_GRID, SHAPE_CONVEX, ALL };
	unsigned shape = (unsigned)random_below(seed, ALL);
	size_t n = (size_t)random_below(seed, random_below(seed, 4) ? 300 : 8);
	struct set s;

	if (!n)
		n = 1;
	s = set_make(shape < SHAPES ? (enum shape)shape : SHAPE_UNIFORM, n, 5, random_next(seed));
	for (size_t i = 0; i < n && shape >= SHAPES; i++) {
		int32_t at = (int32_t)random_below(seed, 500);
		struct point *p = &s.pts[i];

		p->x = shape == SHAPE_LINE ? 3 * at : shape == SHAPE_CONVEX ? at : (int32_t)random_below(seed, 9);
		p->y = shape == SHAPE_LINE   ? 2 * at - 700 :
		       shape == SHAPE_CONVEX ? at * at :
		       shape == SHAPE_FEW    ? (int32_t)random_below(seed, 2) :
					       (int32_t)random_below(seed, 9);
	}
	return s;
}
