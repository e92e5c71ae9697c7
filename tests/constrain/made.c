#include "made.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "err.h"
#include "finish.h"
#include "sets.h"

enum { SCRATCH = 1 << 19 };
static uint64_t scratch[SCRATCH / 8];

void *made_scratch(void)
{
	return scratch;
}

size_t made_scratch_size(void)
{
	assert_true(cut_load_scratch_bytes(SETS_MAX_N) <= sizeof(scratch));
	return sizeof(scratch);
}

static void trace_lines(struct made *m, struct cut_cover *cover)
{
	struct err err = ERR_INIT;

	m->trace->lines = m->c.depends;
	if (m->src->line_sum && m->trace->lines.box[0] <= m->trace->lines.box[2])
		assert_int_equal(m->src->line_sum(m->src->ctx, m->trace->lines.box, &m->trace->lines.sum, &err), 0);
	assert_int_equal(cut_cover_end(cover, m->src, &err), 0);
}

void made_domain(struct made *m, struct mesh_domain *ret)
{
	static const int64_t k[3] = {0, 0, 0};
	const uint32_t cap = 2 * SETS_MAX_N;
	struct tri *tri = tri_init(m->memory, cap);
	struct cut_load load = {.out = tri_input(tri),
				.cap = SETS_MAX_N,
				.scratch = made_scratch(),
				.scratch_size = made_scratch_size(),
				.trace = m->trace};
	struct cut_cover cover = {.trace = m->trace};
	struct finish f = {0};
	struct err err = ERR_INIT;
	uint64_t need = 0;
	int rc;

	assert_int_equal(cut_load_from(m->src, m->view, m->region, &load, &need, &err), 0);
	m->n = load.n;
	m->c = (struct constrain){.src = m->src};
	f.out.counts = load.counts;
	*ret = f.out;
	if (tri_run(tri, load.n) == TRI_E_FLAT) {
		finish_init(&f, m->region, k, tri);
		finish_flat(&f);
		*ret = f.out;
		return;
	}
	m->c = (struct constrain){.src = m->src,
				  .view = m->view,
				  .region = m->region,
				  .lines = m->lines,
				  .arena = m->memory,
				  .size = MADE_BYTES,
				  .used = tri_bytes(cap),
				  .tri = tri,
				  .cover = m->trace ? &cover : NULL,
				  .not_verified = m->not_verified};
	rc = constrain_run(&m->c, &need, &err);
	if (rc)
		fail_msg("%d, %s", rc, err.message);
	if (m->trace)
		trace_lines(m, &cover);
	finish_init(&f, m->region, k, m->c.tri);
	if (m->c.chosen)
		finish_chosen(&f, m->c.chosen);
	else
		finish_owned(&f);
	assert_true(finish_vertices(&f));
	finish_numbers(&f);
	*ret = f.out;
}

bool made_same(const struct mesh_domain *a, const struct mesh_domain *b)
{
	return a->nvertex == b->nvertex && a->nopen == b->nopen && a->ntriangle == b->ntriangle && a->nhull == b->nhull &&
	       digest_equal(a->digest, b->digest) && digest_equal(a->own_digest, b->own_digest) &&
	       (!a->nvertex || (!memcmp(a->vertex, b->vertex, a->nvertex * sizeof(*a->vertex)) &&
				!memcmp(a->triangle, b->triangle, a->ntriangle * sizeof(*a->triangle))));
}

void made_check_same(const struct mesh_domain *a, const struct mesh_domain *b)
{
	assert_true(made_same(a, b));
}
