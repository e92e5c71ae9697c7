/* Random domains, for tests of the store. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "made.h"

void made_domain(uint32_t nvertex, uint32_t nopen, uint32_t ntriangle, const int32_t low[3], const int32_t high[3],
		 struct made *m)
{
	struct mesh_domain *d = &m->d;
	int32_t at[3];

	memset(m, 0, sizeof *m);
	memset(m->proof, 0x5a, MADE_PROOF);
	m->beside = (struct store_beside){.content = {8, 9}, .proof = m->proof, .proof_size = MADE_PROOF - 3};
	*d = (struct mesh_domain){
		.nvertex = nvertex, .nopen = nopen, .ntriangle = ntriangle, .digest = {10, 11}, .nhull = 12, .counts.points = 13};
	d->vertex = calloc(nvertex + 1, sizeof *d->vertex);
	d->link = calloc(nopen + 1, sizeof *d->link);
	d->triangle = calloc(ntriangle + 1, sizeof *d->triangle);
	d->nedges = ntriangle % 2 ? ntriangle : 0; /* in half of the domains */
	d->edges = calloc(d->nedges + 1, 1);
	for (uint32_t i = 0; i < d->nedges; i++)
		d->edges[i] = (uint8_t)rand() & 7;
	for (unsigned i = 0; i < MESH_RULES; i++)
		d->counts.removed[i] = 100 + i;
	for (uint32_t i = 0; i < nvertex; i++) {
		for (unsigned k = 0; k < 3; k++) {
			uint64_t wide = (uint64_t)((int64_t)high[k] - low[k]) + 1;

			at[k] = (int32_t)(low[k] + (int64_t)(((uint64_t)rand() << 31 | (uint64_t)rand()) % wide));
			if (i >= nvertex - 2)
				at[k] = i == nvertex - 1 ? high[k] : low[k];
		}
		d->vertex[i] = i < nopen ? (struct mesh_vertex){rand() - rand(), rand() - rand(), rand() - rand()} :
					   (struct mesh_vertex){at[0], at[1], at[2]};
	}
	for (uint32_t i = 0; i < nopen; i++)
		d->link[i] = (struct mesh_link){(uint64_t)rand() << 40, (uint64_t)rand(), (uint32_t)rand()};
	for (uint32_t i = 0; i < ntriangle; i++)
		for (unsigned k = 0; k < 3; k++)
			d->triangle[i][k] = i + 1 == ntriangle ? nvertex - 1 - k : (uint32_t)rand() % nvertex;
}

void made_free(struct made *m)
{
	free(m->d.vertex);
	free(m->d.link);
	free(m->d.triangle);
	free(m->d.edges);
}

void made_same(const struct mesh_domain *a, const struct mesh_domain *b)
{
	assert_true(a->nvertex == b->nvertex && a->nopen == b->nopen && a->ntriangle == b->ntriangle);
	assert_memory_equal(a->vertex, b->vertex, a->nvertex * sizeof *a->vertex);
	assert_memory_equal(a->link, b->link, a->nopen * sizeof *a->link);
	assert_memory_equal(a->triangle, b->triangle, a->ntriangle * sizeof *a->triangle);
	assert_int_equal(a->nedges, b->nedges);
	assert_memory_equal(a->edges, b->edges, a->nedges);
	assert_memory_equal(a->counts.removed, b->counts.removed, sizeof a->counts.removed);
	assert_true(digest_equal(a->digest, b->digest) && a->nhull == b->nhull && a->counts.points == b->counts.points);
}
