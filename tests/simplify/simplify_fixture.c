#include "simplify_fixture.h"

#include <stdio.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "check.h"
#include "lineset.h"
#include "simplify_priv.h"

uint64_t rng;
atomic_uint fixture_settled, fixture_again, fixture_nearby, fixture_windows, fixture_strips;

void fixture_begin(void)
{
	no_sync();
	/* Thousands of small files: on a disk these take most of the time. */
	if (!access("/dev/shm", W_OK))
		setenv("TMPDIR", "/dev/shm", 0);
	fixture_settled = fixture_again = fixture_nearby = fixture_windows = fixture_strips = 0;
}

uint64_t rnd(uint64_t n)
{
	return random_below(&rng, n);
}

/* ---- datasets ---- */

static const struct grid_lines totals = {.lines = 1, .vertices = 2, .bytes = 64};

struct dataset dataset_of(struct set *s, unsigned segments, const struct chain_lines *lines)
{
	struct dataset d = {.folder = folder_new(), .lines = lines};
	struct grid_manifest m;
	struct err err = ERR_INIT;
	char name[32];

	if (lines)
		chain_lines_add(lines, s, FIXTURE_LINES);
	stage_sources(&d.folder, s, segments, d.info);
	m = manifest_of(d.info, segments, lines ? FIXTURE_LINES : FIXTURE_SOURCES);
	m.lattice.k[0] = (int64_t)rnd(2000) - 1000;
	m.lattice.k[1] = INT64_C(1) << 40;
	m.lattice.k[2] = -7;
	if (lines) {
		struct lineset_piece *copy = calloc(lines->n + 1, sizeof *copy);

		memcpy(copy, lines->piece, lines->n * sizeof *copy);
		m.sources[FIXTURE_LINES - 1].kind = GRID_LINE_VERTICES;
		m.sources[FIXTURE_LINES - 1].name = "";
		m.sources[FIXTURE_LINES - 1].lines = &totals;
		snprintf(name, sizeof name, "lineset-%d", FIXTURE_LINES);
		CHECK(lineset_write(d.folder.fd, name, copy, lines->n, lines->far, &err));
		free(copy);
	}
	manifest_count(&m, s);
	CHECK(grid_manifest_write(d.folder.fd, "m", &m, &err));
	free(m.sources);
	d.reader = reader_open(&d.folder, "m", GRID_NEWEST, 1 << 20);
	return d;
}

void dataset_end(struct dataset *d)
{
	reader_close(&d->reader);
	folder_remove(&d->folder);
}

/* ---- simplifications ---- */

static void set_limits(struct simplify *s, const struct how *how)
{
	s->load = how->load;
	s->block = how->block;
	s->segments = how->segments;
	s->room = how->room;
	s->grow = how->grow;
	s->near = how->near;
	s->fill = how->fill;
	s->inward = how->inward;
	s->loose = how->loose;
	s->nearby = &fixture_nearby;
	s->windows = &fixture_windows;
	s->settled = how->inward ? NULL : &fixture_settled;
	s->again = how->inward || how->room || how->grow ? NULL : &fixture_again;
}

struct worker {
	pthread_t thread;
	struct simplify *s;
	atomic_uint *next;
	void *memory;
	int r;
	struct err err;
};

static void *work(void *ctx)
{
	struct worker *w = ctx;
	uint32_t i;

	while (!w->r && (i = atomic_fetch_add(w->next, 1)) < simplify_tasks(w->s))
		w->r = simplify_task(w->s, i, w->memory, &w->err);
	return NULL;
}

static void run_threads(struct simplify *s, const struct simplify_params *p, unsigned n)
{
	struct worker *w = calloc(n, sizeof *w);
	atomic_uint next = 0;

	for (unsigned i = 0; i < n; i++) {
		w[i] = (struct worker){.s = s, .next = &next, .err = ERR_INIT};
		w[i].memory = aligned_alloc(64, (p->memory + 63) & ~(size_t)63);
		assert_int_equal(pthread_create(&w[i].thread, NULL, work, &w[i]), 0);
	}
	for (unsigned i = 0; i < n; i++) {
		pthread_join(w[i].thread, NULL);
		check_ok(w[i].r, &w[i].err, "simplify_task", __FILE__, __LINE__);
		free(w[i].memory);
	}
	free(w);
}

static void run_tasks(struct simplify **s, const struct simplify_params *p, const struct how *how, void *memory)
{
	struct err err = ERR_INIT;
	uint32_t n = simplify_tasks(*s), left = n;

	while (left) {
		uint32_t i = how->shuffle ? (uint32_t)rnd(n) : n - left;

		if (how->shuffle && simplify_task_done(*s, i))
			continue;
		CHECK(simplify_task(*s, i, memory, &err));
		assert_true(simplify_task_done(*s, i));
		left--;
		if (rnd(100) >= how->stop)
			continue;
		simplify_free(*s);
		CHECK(simplify_open(p, s, &err));
		set_limits(*s, how);
		assert_int_equal(simplify_tasks(*s), n);
	}
}

/* The same memory for all, so that its pages are there. */
static void *task_memory(size_t bytes)
{
	static void *memory;
	static size_t most;

	if (bytes > most) {
		free(memory);
		most = (bytes + 63) & ~(size_t)63;
		memory = aligned_alloc(64, most);
	}
	return memory;
}

struct folder simplify_in_folder(const struct dataset *d, const struct view *view, const struct how *how,
				 struct simplify_report *ret)
{
	struct folder f = folder_new();
	struct simplify_params p = {.grid = d->reader.grid,
				    .view = view,
				    .max_error = how->max_error,
				    .max_points = how->max_points,
				    .memory = simplify_memory_min(d->reader.grid) + how->more,
				    .index_memory = 1 << 16,
				    .dirfd = f.fd,
				    .linesfd = d->folder.fd};
	struct err err = ERR_INIT;
	struct simplify *s;
	void *memory = task_memory(p.memory);
	char name[32];
	int r;

	snprintf(name, sizeof name, "lineset-%d", FIXTURE_LINES);
	p.lines = d->lines ? name : NULL;
	CHECK(simplify_open(&p, &s, &err));
	do {
		set_limits(s, how);
		if (how->threads)
			run_threads(s, &p, how->threads);
		else
			run_tasks(&s, &p, how, memory);
		r = simplify_next(s, &err);
		fixture_strips += !r && s->strip && grid_points(s->strip) < grid_points(s->chosen);
		if (!r && rnd(100) < how->stop) {
			simplify_free(s);
			CHECK(simplify_open(&p, &s, &err));
		}
	} while (!r && !(how->no_rounds && s->at.step == SIMPLIFY_CHECK));
	simplify_free(s);
	if (how->no_rounds && !r)
		return f;
	if (r != SIMPLIFY_E_DONE)
		check_ok(r, &err, "simplify_next", __FILE__, __LINE__);
	CHECK(simplify_report_read(f.fd, ret, &err));
	assert_int_equal(folder_files(&f, ""), 3);
	return f;
}

struct reader simplify_reader(const struct dataset *d, const struct folder *f, const char *manifest)
{
	struct grid_use use = {.no_lines = !d->lines, .linesfd = d->folder.fd};
	struct reader reader = {.grid = NULL};
	struct err err = ERR_INIT;
	char name[32];
	size_t bytes;

	snprintf(name, sizeof name, "lineset-%d", FIXTURE_LINES);
	use.lines = d->lines ? name : NULL;
	CHECK(grid_open_use(f->fd, manifest, GRID_NEWEST, &use, NULL, 1 << 16, &reader.grid, &err));
	bytes = grid_reader_bytes(reader.grid);
	reader.memory = malloc(bytes);
	CHECK(grid_reader_new(reader.grid, reader.memory, bytes, &reader.r, &err));
	return reader;
}

/* ---- brute force ---- */

struct point *positions_of(const struct reader *reader, const struct view *view, size_t *ret_n)
{
	struct gather g = {0};
	struct err err = ERR_INIT;
	size_t n = 0;

	CHECK(grid_scan(reader->r, 0, UINT64_MAX, gather_sink, &g, &err));
	for (size_t i = 0; i < g.n; i++) {
		const struct point *p = &g.pts[i];
		bool again;

		if (view_judge(view, p) != VIEW_KEPT)
			continue;
		again = n && g.pts[n - 1].x == p->x && g.pts[n - 1].y == p->y;
		if (again && !view_prefers(view, p, &g.pts[n - 1]))
			continue;
		n -= again;
		g.pts[n++] = *p;
	}
	*ret_n = n;
	return g.pts;
}

static __int128 turn(const int32_t a[2], const int32_t b[2], const struct point *p)
{
	return (__int128)((int64_t)b[0] - a[0]) * ((int64_t)p->y - a[1]) -
	       (__int128)((int64_t)b[1] - a[1]) * ((int64_t)p->x - a[0]);
}

/* If the closed triangle has the point: how far it is from the plane, as |n| / d, by its three weights. */
static bool distance_in(const struct tri_result *r, const uint32_t c[3], const struct point *p, __int128 *ret_n, __int128 *ret_d)
{
	__int128 weight[3], n = 0, d = 0;

	for (unsigned k = 0; k < 3; k++) {
		weight[k] = turn(r->xy[c[(k + 1) % 3]], r->xy[c[(k + 2) % 3]], p);
		if (weight[k] < 0)
			return false;
		n += weight[k] * ((int64_t)r->z[c[k]] - p->z);
		d += weight[k];
	}
	*ret_n = n < 0 ? -n : n;
	*ret_d = d;
	return true;
}

static void test_point(const struct reader *chosen, const struct tri_result *r, const struct point *p, struct distance *far)
{
	bool any = false;

	for (uint32_t i = 0; i < r->ntriangle; i++) {
		const uint32_t *c = r->triangle[i].corner;
		__int128 n, d;

		if (c[0] == TRI_GHOST || c[1] == TRI_GHOST || c[2] == TRI_GHOST || !distance_in(r, c, p, &n, &d) ||
		    chain_lines_out(chosen, r, c))
			continue;
		any = true;
		if (n * far->d > far->n * d) {
			far->n = n;
			far->d = d;
		}
	}
	far->tested += any;
	far->outside += !any;
}

/* Ranges of coordinates are small here, so that products of two fractions fit. */
struct distance distance_of(const struct dataset *d, const struct reader *chosen, const struct point *all, size_t nall,
			    const struct point *pts, size_t n)
{
	struct distance far = {.n = 0, .d = 1};
	struct mesh_vertex *v = calloc(n + 1, sizeof *v);
	struct tri_result r;
	struct tri_pieces *pieces = NULL;
	struct tri *t;

	for (size_t i = 0; i < n; i++)
		v[i] = (struct mesh_vertex){pts[i].x, pts[i].y, pts[i].z};
	t = n < 3 ? NULL : check_tri(v, (uint32_t)n);
	if (t && d->lines)
		chain_lines_insert(d->lines, t, v, (uint32_t)n, &pieces);
	if (t) {
		tri_result(t, &r);
		far.triangles = r.ntriangle;
		for (size_t i = 0; i < nall; i++)
			test_point(chosen, &r, &all[i], &far);
	}
	free(pieces);
	free(t);
	free(v);
	return far;
}
