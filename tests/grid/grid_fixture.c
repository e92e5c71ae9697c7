/* Shared by the tests of the grid (grid_fixture.h). Uses only public headers. */
#include "grid_fixture.h"

#include <dirent.h>
#include <fcntl.h>
#include <stdarg.h>
#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "io.h"
#include "repeat.h"

void check_ok(int rc, const struct err *err, const char *what, const char *file, int line)
{
	char text[1200];

	if (!rc)
		return;
	print_error("%s: %d, %s\n", what, rc, err_format(err, text, sizeof text));
	_fail(file, line);
}

/* ---- folders ---- */

struct folder folder_new(void)
{
	struct folder f;

	repeat_folder(f.path, sizeof f.path, "grid");
	f.fd = open(f.path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	assert_true(f.fd >= 0);
	return f;
}

static size_t folder_each(const struct folder *f, const char *suffix, bool erase)
{
	DIR *d = opendir(f->path);
	struct dirent *e;
	size_t n = 0;

	assert_non_null(d);
	while ((e = readdir(d))) {
		size_t len = strlen(e->d_name), tail = strlen(suffix);

		if (e->d_name[0] == '.' || len < tail || strcmp(e->d_name + len - tail, suffix))
			continue;
		n++;
		if (erase && unlinkat(f->fd, e->d_name, 0) != 0) {
			struct folder sub = {.fd = openat(f->fd, e->d_name, O_RDONLY | O_DIRECTORY | O_CLOEXEC)};

			assert_true(sub.fd >= 0);
			snprintf(sub.path, sizeof sub.path, "%.50s/%.12s", f->path, e->d_name);
			folder_each(&sub, "", true);
			close(sub.fd);
			assert_int_equal(unlinkat(f->fd, e->d_name, AT_REMOVEDIR), 0);
		}
	}
	closedir(d);
	return n;
}

size_t folder_files(const struct folder *f, const char *suffix)
{
	return folder_each(f, suffix, false);
}

void folder_remove(struct folder *f)
{
	folder_each(f, "", true);
	close(f->fd);
	assert_int_equal(rmdir(f->path), 0);
}

size_t open_descriptors(void)
{
	size_t n = 0;

	for (int fd = 0; fd < 1024; fd++)
		n += fcntl(fd, F_GETFD) != -1;
	return n;
}

/* ---- point sets ---- */

static int32_t coordinate(enum shape shape, uint64_t *rng)
{
	switch (shape) {
	case SHAPE_UNIFORM:
		return (int32_t)random_below(rng, 2000000) - 1000000;
	case SHAPE_CLUSTERED:
		return (int32_t)(random_below(rng, 5) * 400000000u) + (int32_t)(random_below(rng, 40) * random_below(rng, 40));
	case SHAPE_DUPLICATES:
		return (int32_t)random_below(rng, 12) - 6;
	case SHAPE_EXTREME:
		switch (random_below(rng, 5)) {
		case 0:
			return INT32_MIN;
		case 1:
			return INT32_MAX;
		case 2:
			return (int32_t)random_below(rng, 3) - 1;
		default:
			return (int32_t)random_next(rng);
		}
	default:
		return -77;
	}
}

struct set set_make(enum shape shape, size_t n, unsigned sources, uint64_t seed)
{
	struct set s = {calloc(n + 1, sizeof *s.pts), calloc(n + 1, sizeof *s.ids), n};
	uint64_t rng = seed;

	for (size_t i = 0; i < n; i++) {
		struct point *p = &s.pts[i];

		p->x = coordinate(shape, &rng);
		p->y = coordinate(shape, &rng);
		p->z = (int32_t)random_below(&rng, 50) - 25;
		p->cls = (uint8_t)(random_below(&rng, 20) ? random_below(&rng, 4) : random_below(&rng, 256));
		p->ret = (uint8_t)random_below(&rng, 256);
		p->tag = (uint16_t)random_below(&rng, 16);
		/* Sources in stretches, as from files, and sometimes mixed. */
		s.ids[i] = 1 + (uint32_t)(random_below(&rng, 3) ? i * sources / n : random_below(&rng, sources));
	}
	return s;
}

static int32_t gcd(int32_t a, int32_t b)
{
	while (b) {
		int32_t c = a % b;

		a = b;
		b = c;
	}
	return abs(a);
}

static int half(const int32_t v[2])
{
	return v[1] < 0 || (v[1] == 0 && v[0] < 0);
}

static int by_direction(const void *a, const void *b)
{
	const int32_t *p = a, *q = b;

	return half(p) != half(q) ? half(p) - half(q) : q[0] * p[1] - q[1] * p[0];
}

struct set set_polygon(int32_t reach)
{
	int32_t(*side)[2] = malloc((size_t)(2 * reach + 1) * (size_t)(2 * reach + 1) * sizeof *side), at[2] = {0, 0};
	struct set s = {0};

	for (int32_t x = -reach; x <= reach; x++)
		for (int32_t y = -reach; y <= reach; y++)
			if (gcd(x, y) == 1) {
				side[s.n][0] = x;
				side[s.n++][1] = y;
			}
	qsort(side, s.n, sizeof *side, by_direction);
	s.pts = calloc(s.n, sizeof *s.pts);
	s.ids = calloc(s.n, sizeof *s.ids);
	for (size_t i = 0; i < s.n; i++) {
		s.pts[i] = (struct point){.x = at[0], .y = at[1], .z = (int32_t)(i % 17), .cls = i % 5 ? 1 : 2, .ret = 0x11};
		s.ids[i] = 1;
		at[0] += side[i][0];
		at[1] += side[i][1];
	}
	free(side);
	return s;
}

void set_free(struct set *s)
{
	free(s->pts);
	free(s->ids);
	*s = (struct set){0};
}

struct tagged {
	struct point p;
	uint32_t id;
};

static int by_order(const void *a, const void *b)
{
	const struct tagged *x = a, *y = b;
	int c = point_compare(&x->p, &y->p);

	return c ? c : (x->id > y->id) - (x->id < y->id);
}

void set_sort(struct set *s)
{
	struct tagged *t = calloc(s->n + 1, sizeof *t);

	for (size_t i = 0; i < s->n; i++)
		t[i] = (struct tagged){s->pts[i], s->ids[i]};
	qsort(t, s->n, sizeof *t, by_order);
	for (size_t i = 0; i < s->n; i++) {
		s->pts[i] = t[i].p;
		s->ids[i] = t[i].id;
	}
	free(t);
}

void set_shuffle(struct set *s, uint64_t seed)
{
	for (size_t i = s->n; i > 1; i--) {
		size_t k = random_below(&seed, i);
		struct point p = s->pts[k];
		uint32_t id = s->ids[k];

		s->pts[k] = s->pts[i - 1];
		s->ids[k] = s->ids[i - 1];
		s->pts[i - 1] = p;
		s->ids[i - 1] = id;
	}
}

/* ---- cells, by halving ---- */

struct halving {
	const struct set *s;
	struct ref_cell *cells;
	size_t n, cap;
};

static void halve(struct halving *h, size_t first, size_t n, uint64_t lo, unsigned bits)
{
	const struct point *p = h->s->pts + first;

	if (!n)
		return;
	if (n > GRID_CELL_RECORDS && bits) {
		uint64_t middle = lo + ((uint64_t)1 << (bits - 1));
		size_t left = 0;

		while (left < n && point_morton(p[left].x, p[left].y) < middle)
			left++;
		halve(h, first, left, lo, bits - 1);
		halve(h, first + left, n - left, middle, bits - 1);
		return;
	}
	if (h->n == h->cap) {
		h->cap = h->cap ? 2 * h->cap : 64;
		h->cells = realloc(h->cells, h->cap * sizeof *h->cells);
		assert_non_null(h->cells);
	}
	struct ref_cell *c = &h->cells[h->n++];

	*c = (struct ref_cell){
		.lo = lo,
		.hi = bits == 64 ? UINT64_MAX : lo + ((uint64_t)1 << bits) - 1,
		.first = first,
		.n = n,
		.box = {INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN},
	};
	for (size_t i = 0; i < n; i++) {
		struct digest d = digest_hash(&p[i], sizeof p[i]); /* tags have no source index here */

		c->box[0] = p[i].x < c->box[0] ? p[i].x : c->box[0];
		c->box[1] = p[i].y < c->box[1] ? p[i].y : c->box[1];
		c->box[2] = p[i].x > c->box[2] ? p[i].x : c->box[2];
		c->box[3] = p[i].y > c->box[3] ? p[i].y : c->box[3];
		c->distinct += !i || p[i].x != p[i - 1].x || p[i].y != p[i - 1].y;
		digest_add(&c->sum, d);
	}
}

struct ref_cell *ref_cells(const struct set *s, size_t *ret_n)
{
	struct halving h = {.s = s};

	halve(&h, 0, s->n, 0, 64);
	*ret_n = h.n;
	return h.cells;
}

/* ---- datasets ---- */

int stage_set(const struct folder *f, const char *name, const struct set *s, size_t memory, struct grid_segment_info *ret,
	      struct err *err)
{
	struct grid_stage_params params = {
		.dirfd = f->fd, .name = name, .memory = memory ? memory : (size_t)64 << 20, .durable = false};
	struct grid_stage *stage;
	int rc = grid_stage_new(&params, &stage, err);

	if (rc)
		return rc;
	for (size_t at = 0, n; rc == 0 && at < s->n; at += n) {
		for (n = 1; at + n < s->n && n < 777 && s->ids[at + n] == s->ids[at];)
			n++;
		rc = grid_stage_source(stage, s->ids[at], err);
		if (rc == 0)
			rc = grid_stage_add(stage, s->pts + at, n, err);
	}
	if (rc == 0)
		rc = grid_stage_seal(stage, ret, err);
	grid_stage_free(stage);
	return rc;
}

void stage_sources(const struct folder *f, const struct set *s, unsigned segments, struct grid_segment_info *ret)
{
	for (unsigned i = 0; i < segments; i++) {
		struct set part = {calloc(s->n + 1, sizeof *s->pts), calloc(s->n + 1, sizeof *s->ids), 0};
		struct err err = ERR_INIT;
		char name[16];

		for (size_t k = 0; k < s->n; k++)
			if (s->ids[k] % segments == i) {
				part.pts[part.n] = s->pts[k];
				part.ids[part.n++] = s->ids[k];
			}
		snprintf(name, sizeof name, "s%u", i);
		CHECK(stage_set(f, name, &part, GRID_STAGE_MIN, &ret[i], &err));
		set_free(&part);
	}
}

void manifest_count(struct grid_manifest *m, const struct set *s)
{
	for (size_t i = 0; i < m->nsources; i++)
		m->sources[i].points = 0;
	for (size_t k = 0; k < s->n; k++)
		m->sources[s->ids[k] - 1].points++;
}

struct grid_manifest manifest_of(struct grid_segment_info *segments, size_t n, uint32_t sources)
{
	static char names[8][32];
	struct grid_manifest m = {
		.lattice = {.scale_xy = {1, -2}, .scale_z = {1, -3}, .k = {5, -6, 7}},
		.crs = "EPSG:26910",
		.unit_xy = "metre",
		.unit_z = "unknown",
		.generation = 1,
		.segments = segments,
		.nsegments = n,
		.nsources = sources,
	};

	m.sources = calloc(sources + 1, sizeof *m.sources);
	for (uint32_t i = 0; i < sources; i++) {
		m.sources[i] = (struct grid_source){.id = i + 1, .added = 1};
		snprintf(names[i % 8], sizeof names[i % 8], "file %u\n\xff.las", i % 8 + 1);
		m.sources[i].name = names[i % 8];
	}
	return m;
}

struct reader reader_open(const struct folder *f, const char *manifest, uint64_t generation, size_t index_memory)
{
	return reader_open_use(f, manifest, generation, NULL, index_memory);
}

struct reader reader_open_use(const struct folder *f, const char *manifest, uint64_t generation, const struct grid_use *use,
			      size_t index_memory)
{
	struct reader r = {0};
	struct err err = ERR_INIT;

	CHECK(grid_open_use(f->fd, manifest, generation, use, NULL, index_memory, &r.grid, &err));
	r.memory = malloc(grid_reader_bytes(r.grid));
	CHECK(grid_reader_new(r.grid, r.memory, grid_reader_bytes(r.grid), &r.r, &err));
	return r;
}

void reader_close(struct reader *r)
{
	r->r = grid_reader_free(r->r);
	r->grid = grid_close(r->grid);
	free(r->memory);
}

int gather_sink(void *ctx, const struct point *pts, size_t n, struct err *err)
{
	struct gather *g = ctx;

	if (g->n + n > g->cap) {
		g->cap = 2 * (g->n + n);
		g->pts = realloc(g->pts, g->cap * sizeof *g->pts);
	}
	memcpy(g->pts + g->n, pts, n * sizeof *pts);
	g->n += n;
	g->largest = n > g->largest ? n : g->largest;
	return 0;
}

/* ---- ranges ---- */

static uint64_t key_of(const struct point *p)
{
	return point_morton(p->x, p->y);
}

void random_range(const struct set *s, uint64_t *rng, uint64_t *lo, uint64_t *hi)
{
	uint64_t a = random_next(rng), b = random_next(rng);

	if (s->n && random_below(rng, 4)) {
		size_t i = random_below(rng, s->n), k = i + random_below(rng, random_below(rng, 2) ? 3000 : 50);

		a = key_of(&s->pts[i]) - random_below(rng, 2);
		b = key_of(&s->pts[k < s->n ? k : s->n - 1]) + random_below(rng, 2);
	}
	*lo = a < b ? a : b;
	*hi = a < b ? b : a;
}

void reader_check(struct reader *r, const struct set *live, uint64_t lo, uint64_t hi, bool must_be_exact)
{
	struct gather g = {0};
	struct err err = ERR_INIT;
	struct digest sum = {0, 0}, got;
	size_t first = 0, n = 0;
	uint64_t count;
	bool exact;

	while (first < live->n && key_of(&live->pts[first]) < lo)
		first++;
	while (first + n < live->n && key_of(&live->pts[first + n]) <= hi) {
		digest_add(&sum, digest_hash(&live->pts[first + n], sizeof(struct point)));
		n++;
	}
	CHECK(grid_scan(r->r, lo, hi, gather_sink, &g, &err));
	assert_int_equal(g.n, n);
	if (n)
		assert_memory_equal(g.pts, live->pts + first, n * sizeof *g.pts);
	assert_true(g.largest <= GRID_CELL_RECORDS);
	CHECK(grid_count(r->r, lo, hi, &count, &exact, &err));
	assert_true(count >= n && (count == n || !exact) && (exact || !must_be_exact));
	CHECK(grid_sum(r->r, lo, hi, &got, &err));
	assert_true(digest_equal(sum, got));
	free(g.pts);
}
