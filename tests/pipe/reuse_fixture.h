/* What tests of finished domains share: generations on disk, their domains in a store, and damaged files of the store. */
#ifndef REUSE_FIXTURE_H
#define REUSE_FIXTURE_H

/* Each test uses a part of it. */
#pragma GCC diagnostic ignored "-Wunused-function"

#include <fcntl.h>
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

#include "err.h"
#include "grid_fixture.h"
#include "pipe.h"
#include "pipe_priv.h"

enum { LOAD = 400, CAP = 40000, SOURCES = 6 };

static uint64_t rng;

static uint64_t rnd(uint64_t n)
{
	return random_below(&rng, n);
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

static struct view view = VIEW_INIT; /* tests with another one put it back */

/* `dead`: bit set of sources; their records are in the segments nevertheless. */
static struct generation generation_of(const struct set *s, unsigned segments, unsigned dead)
{
	struct generation g = {.folder = folder_new()};
	struct err err = ERR_INIT;
	size_t reader_size;

	stage_sources(&g.folder, s, segments, g.info);
	g.m = manifest_of(g.info, segments, SOURCES);
	g.m.generation = 2;
	manifest_count(&g.m, s);
	for (unsigned i = 0; i < SOURCES; i++)
		if (dead >> i & 1)
			g.m.sources[i].removed = 2;
	CHECK(grid_manifest_write(g.folder.fd, "m", &g.m, &err));
	g.reader = reader_open_use(&g.folder, "m", GRID_NEWEST, &(struct grid_use){.slots = view.slots}, 1 << 20);
	reader_size = grid_reader_bytes(g.reader.grid);
	g.budget =
		(struct pipe_budget){.load = LOAD, .cap = CAP, .threads = 1, .domain_bytes = pipe_domain_bytes(CAP, reader_size)};
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

/* `all` points in a square of side `side`, `some` of source 4 in a corner of it, and more of source 5 elsewhere in the
 * corner. */
static struct set points_more(size_t all, size_t some, uint32_t side)
{
	size_t n = all + 2 * some;
	struct set s = {calloc(n, sizeof *s.pts), calloc(n, sizeof *s.ids), n};

	for (size_t i = 0; i < n; i++) {
		uint32_t within = i < all ? side : side / 6;

		s.pts[i] = (struct point){.x = (int32_t)rnd(within) - (int32_t)(side / 2),
					  .y = (int32_t)rnd(within) - 77,
					  .z = (int32_t)rnd(50),
					  .cls = rnd(20) ? 2 : 7,
					  .ret = 0x11};
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
	CHECK(pipe_store(store, &g->key, r, &d, g->memory, ret, NULL, &err));
	assert_true(digest_equal(ret->digest, d.digest));
	assert_int_equal(ret->triangles, d.ntriangle);
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

static int reuse_as(struct generation *g, int store, const struct cut_region *r, void *memory, bool light, bool sums,
		    struct mesh_domain *ret, struct pipe_stored *ret_stored)
{
	struct pipe_reuse_params p = reuse_params(g, store, r, memory);
	struct err err = ERR_INIT;
	size_t held = 0;
	int rc;

	p.light = light;
	p.sums = sums;
	rc = pipe_reuse(&p, ret, ret_stored, &held, &err);
	if (rc < 0)
		fail_msg("%s", err.message);
	assert_true(rc || held <= g->budget.domain_bytes);
	return rc;
}

static int reuse(struct generation *g, int store, const struct cut_region *r, void *memory, bool light, struct mesh_domain *ret,
		 struct pipe_stored *ret_stored)
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
	/* With weights it can depend on the order of segments, if not all that is read fits at once. */
	assert_true(view.nweight || a->counts.halo == b->counts.halo);
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

/* ---- files of the store ---- */

static void name_of(const struct store_id *id, char name[128])
{
	char base[DIGEST_HEX_SIZE], list[DIGEST_HEX_SIZE];

	digest_hex(id->base, base);
	snprintf(name, 128, "%.2s/d-%s-%s", base, base, digest_hex(id->list, list));
}

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

#endif
