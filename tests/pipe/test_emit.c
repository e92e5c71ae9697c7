/*
 * The emitter against what can be counted independently: the triangles of a mesh are distributed to domains at random
 * (the worst case: most vertices are shared) and emitted in random order, through a table that fits and through one
 * that spills. Each vertex must be final in exactly the block of its last triangle, hull vertices never.
 */
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "err.h"
#include "pipe.h"
#include "pipe_table.h"

static uint64_t seed;

static uint32_t rnd(uint32_t n)
{
	seed = seed * 6364136223846793005u + 1442695040888963407u;
	return (uint32_t)((seed >> 33) % n);
}

struct mesh {
	uint32_t w, h, nvertex, ntriangle, ndomain;
	uint32_t (*triangle)[3];
	uint32_t *domain; /* of each triangle */
	uint32_t *order;  /* domains in emission order */
	uint32_t *rank;   /* of each domain in that order */
	uint32_t *last;   /* of each vertex: rank of its last domain */
	bool *hull;
};

static void mesh_make(struct mesh *m, uint32_t w, uint32_t h, uint32_t ndomain, bool scattered)
{
	uint32_t i, k, n = 0;

	*m = (struct mesh){.w = w, .h = h, .nvertex = w * h, .ndomain = ndomain};
	m->triangle = calloc((size_t)(w - 1) * (h - 1) * 2, sizeof *m->triangle);
	m->domain = calloc((size_t)(w - 1) * (h - 1) * 2, sizeof *m->domain);
	m->order = calloc(ndomain, sizeof *m->order);
	m->rank = calloc(ndomain, sizeof *m->rank);
	m->last = calloc(m->nvertex, sizeof *m->last);
	m->hull = calloc(m->nvertex, sizeof *m->hull);
	for (uint32_t y = 0; y < h; y++)
		for (uint32_t x = 0; x < w; x++) {
			uint32_t a = y * w + x, b = a + 1, c = a + w, d = c + 1, flip = rnd(2);

			m->hull[a] = !x || !y || x == w - 1 || y == h - 1;
			if (x == w - 1 || y == h - 1)
				continue;
			const uint32_t t[2][3] = {{a, b, flip ? d : c}, {flip ? a : b, d, c}};

			for (k = 0; k < 2; k++) {
				memcpy(m->triangle[n], t[k], sizeof t[k]);
				m->domain[n++] = scattered ? rnd(ndomain) : (y * ndomain / h);
			}
		}
	m->ntriangle = n;
	for (i = 0; i < ndomain; i++)
		m->order[i] = i;
	for (i = ndomain; i > 1; i--) {
		uint32_t j = rnd(i), t = m->order[j];

		m->order[j] = m->order[i - 1];
		m->order[i - 1] = t;
	}
	for (i = 0; i < ndomain; i++)
		m->rank[m->order[i]] = i;
	for (i = 0; i < n; i++)
		for (k = 0; k < 3; k++)
			if (m->rank[m->domain[i]] > m->last[m->triangle[i][k]])
				m->last[m->triangle[i][k]] = m->rank[m->domain[i]];
}

static void mesh_free(struct mesh *m)
{
	free(m->triangle);
	free(m->domain);
	free(m->order);
	free(m->rank);
	free(m->last);
	free(m->hull);
}

static struct digest hash_of(const struct mesh *m, uint32_t v)
{
	uint64_t place = (uint64_t)(v % m->w) << 32 | (v / m->w);

	return digest_hash(&place, sizeof place);
}

/* The finished domain `which`, allocated; all vertices that are shared or on the hull are open. */
static void domain_make(const struct mesh *m, uint32_t which, struct mesh_domain *d)
{
	uint32_t *local = malloc(m->nvertex * sizeof *local), i, k, pass;
	bool *shared = calloc(m->nvertex, sizeof *shared);

	*d = (struct mesh_domain){0};
	d->triangle = calloc(m->ntriangle, sizeof *d->triangle);
	d->vertex = calloc(m->nvertex, sizeof *d->vertex);
	d->link = calloc(m->nvertex, sizeof *d->link);
	d->final = calloc(m->nvertex, 1);
	memset(local, 0xff, m->nvertex * sizeof *local);
	for (i = 0; i < m->ntriangle; i++)
		for (k = 0; k < 3; k++)
			shared[m->triangle[i][k]] |= m->domain[i] != which || m->hull[m->triangle[i][k]];
	for (pass = 0; pass < 2; pass++) {
		for (i = 0; i < m->ntriangle; i++)
			for (k = 0; k < 3; k++) {
				uint32_t v = m->triangle[i][k];

				if (m->domain[i] != which || local[v] != UINT32_MAX || shared[v] != !pass)
					continue;
				local[v] = d->nvertex++;
				d->vertex[local[v]] = (struct mesh_vertex){(int32_t)(v % m->w), (int32_t)(v / m->w), 7};
			}
		if (!pass)
			d->nopen = d->nvertex;
	}
	for (i = 0; i < m->ntriangle; i++) {
		if (m->domain[i] != which)
			continue;
		for (k = 0; k < 3; k++) {
			uint32_t v = m->triangle[i][k];
			struct digest a = hash_of(m, m->triangle[i][(k + 1) % 3]);
			struct digest b = hash_of(m, m->triangle[i][(k + 2) % 3]);

			d->triangle[d->ntriangle][k] = local[v];
			if (local[v] < d->nopen) {
				d->link[local[v]].hi += a.hi - b.hi;
				d->link[local[v]].lo += a.lo - b.lo;
				d->link[local[v]].edges++;
			}
		}
		d->ntriangle++;
	}
	/* The emitter compares with the number of positions: all of them, counted once. */
	d->counts.used = which == 0 ? m->nvertex : 0;
	d->nhull = which == 0 ? 2 * (m->w + m->h) - 4 : 0;
	free(local);
	free(shared);
}

static void domain_free(struct mesh_domain *d)
{
	free(d->triangle);
	free(d->vertex);
	free(d->link);
	free(d->final);
}

struct seen {
	const struct mesh *m;
	uint32_t rank;
	uint64_t next; /* number of the next new vertex */
	uint64_t triangles;
	uint32_t *vertex_of; /* stream number to vertex */
	bool *final;         /* of each vertex */
};

static int see_block(void *ctx, const struct mesh_block *b, struct err *err)
{
	struct seen *s = ctx;
	uint32_t i, k;

	(void)err;
	assert_int_equal(b->first, s->next);
	for (i = 0; i < b->nnew; i++)
		s->vertex_of[s->next++] = (uint32_t)(b->vertex[i].y * (int32_t)s->m->w + b->vertex[i].x);
	for (i = 0; i < b->nforeign; i++)
		assert_true(b->foreign[i] < b->first);
	for (i = 0; i < b->nforeign + b->nnew; i++) {
		uint64_t number = i < b->nforeign ? b->foreign[i] : b->first + i - b->nforeign;
		uint32_t v = s->vertex_of[number];
		bool final = b->final[i / 8] >> (i % 8) & 1;

		assert_false(s->final[v]);
		assert_int_equal(final, !s->m->hull[v] && s->m->last[v] == s->rank);
		s->final[v] = final;
	}
	/* The triangles are those of the domain, as positions. */
	for (i = 0; i < b->ntriangle; i++)
		for (k = 0; k < 3; k++)
			assert_true(b->triangle[i][k] < b->nforeign + b->nnew);
	s->triangles += b->ntriangle;
	return 0;
}

static void emit_mesh(struct mesh *m, size_t memory, bool drop_one)
{
	struct lattice lattice = {.k = {1000000, -5, 0}};
	struct seen seen = {.m = m};
	struct mesh_sink sink = {&seen, see_block};
	struct cut_region region = {.wx = 32, .wy = 32, .inf = 15};
	struct pipe_emitter *e = NULL;
	struct pipe_totals totals;
	struct err err = ERR_INIT;
	struct mesh_domain d;
	int dir = open("/tmp", O_RDONLY | O_DIRECTORY);
	uint32_t i;

	seen.vertex_of = calloc(m->nvertex, sizeof *seen.vertex_of);
	seen.final = calloc(m->nvertex, 1);
	assert_int_equal(pipe_emitter_new(&lattice, memory, dir, &e, &err), 0);
	for (i = 0; i < m->ndomain; i++) {
		domain_make(m, m->order[i], &d);
		seen.rank = i;
		if (!(drop_one && i == m->ndomain / 2))
			assert_int_equal(pipe_emit(e, &d, &region, drop_one ? NULL : &sink, &err), 0);
		domain_free(&d);
	}
	if (drop_one) {
		assert_int_equal(pipe_emitter_finish(e, &totals, &err), -ERR_INTERNAL);
	} else {
		assert_int_equal(pipe_emitter_finish(e, &totals, &err), 0);
		assert_int_equal(totals.vertices, m->nvertex);
		assert_int_equal(totals.triangles, m->ntriangle);
		assert_int_equal(seen.triangles, m->ntriangle);
		assert_int_equal(totals.hull, 2 * (m->w + m->h) - 4);
		for (i = 0; i < m->nvertex; i++)
			assert_int_equal(seen.final[i], !m->hull[i]);
	}
	pipe_emitter_free(e);
	close(dir);
	free(seen.vertex_of);
	free(seen.final);
}

static void test_random_order(void **state)
{
	(void)state;
	for (uint32_t i = 0; i < 60; i++) {
		struct mesh m;

		seed = i;
		mesh_make(&m, 2 + rnd(20), 2 + rnd(20), 1 + rnd(12), i & 1);
		emit_mesh(&m, 1 << 20, false);
		mesh_free(&m);
	}
}

static void test_spill(void **state)
{
	struct mesh m;

	(void)state;
	seed = 77;
	mesh_make(&m, 200, 150, 23, true);
	emit_mesh(&m, PIPE_TABLE_FRAMES_MIN * PIPE_TABLE_PAGE, false);
	emit_mesh(&m, 8 << 20, false);
	mesh_free(&m);
}

static void test_missing_domain(void **state)
{
	struct mesh m;

	(void)state;
	seed = 5;
	mesh_make(&m, 30, 30, 9, false);
	emit_mesh(&m, 1 << 20, true);
	mesh_free(&m);
}

/* The table alone, against a simple array: positions added and closed in random order, far more than fit it. */
static void test_table(void **state)
{
	enum { N = 30000 };
	struct pipe_table *t = NULL;
	struct err err = ERR_INIT;
	int dir = open("/tmp", O_RDONLY | O_DIRECTORY);
	uint64_t *sum = calloc(N, sizeof *sum), *number = calloc(N, sizeof *number), count = 0, next = 1;

	(void)state;
	seed = 9;
	assert_int_equal(pipe_table_new(PIPE_TABLE_FRAMES_MIN * PIPE_TABLE_PAGE, dir, &t, &err), 0);
	for (uint32_t i = 0; i < 300000; i++) {
		uint32_t v = rnd(i < 150000 ? N : N / 2);
		bool close_it = sum[v] && rnd(2);
		uint64_t delta = close_it ? (uint64_t)0 - sum[v] : 1 + rnd(1000);
		struct pipe_vertex add = {.place = v * 0x100000001u, .number = next, .hi = delta, .edges = 1}, got;
		int r = pipe_table_add(t, &add, &got, &err);

		sum[v] += delta;
		if (!number[v]) {
			assert_int_equal(r, PIPE_TABLE_NEW);
			number[v] = next++;
			count++;
		} else {
			assert_int_equal(r, sum[v] ? PIPE_TABLE_KNOWN : PIPE_TABLE_CLOSED);
		}
		assert_int_equal(got.number, number[v]);
		assert_int_equal(got.hi, sum[v]);
		if (!sum[v]) {
			number[v] = 0;
			count--;
		}
		assert_int_equal(pipe_table_count(t), count);
	}
	assert_true(pipe_table_spilled_pages(t) > 0);
	pipe_table_free(t);
	close(dir);
	free(sum);
	free(number);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_table),
		cmocka_unit_test(test_random_order),
		cmocka_unit_test(test_spill),
		cmocka_unit_test(test_missing_domain),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
