/*
 * A run that reads a selection, and beside it the generation, for the files of hidden positions: the generation's segments stay
 * until it ends, if they are opened when they are read, and the memory of both grids is counted.
 *
 * Linked with --wrap of grid_reopens and pipe_domain.
 */
#include <stdatomic.h>
#include <unistd.h>

#include "fixture.h"

#include "grid.h"
#include "job_priv.h"
#include "pipe.h"
#include "run_priv.h"

static struct {
	atomic_bool closed, inside;
	struct run *run; /* whose domain is being made */
} gate;

/* As if the generation had very many segments: a selection has one. */
bool __wrap_grid_reopens(const struct grid *g);
bool __wrap_grid_reopens(const struct grid *g)
{
	return grid_manifest(g)->nsegments > 1;
}

int __real_pipe_domain(const struct grid *grid, const struct view *v, const struct cut_region *region,
		       const struct pipe_known *known, const struct pipe_budget *budget, void *memory, struct mesh_domain *ret,
		       uint64_t *ret_need, struct err *err);
int __wrap_pipe_domain(const struct grid *grid, const struct view *v, const struct cut_region *region,
		       const struct pipe_known *known, const struct pipe_budget *budget, void *memory, struct mesh_domain *ret,
		       uint64_t *ret_need, struct err *err);

int __wrap_pipe_domain(const struct grid *grid, const struct view *v, const struct cut_region *region,
		       const struct pipe_known *known, const struct pipe_budget *budget, void *memory, struct mesh_domain *ret,
		       uint64_t *ret_need, struct err *err)
{
	gate.run = run_domain_of(known->ctx)->run;
	atomic_store(&gate.inside, true);
	while (atomic_load(&gate.closed))
		usleep(1000);
	return __real_pipe_domain(grid, v, region, known, budget, memory, ret, ret_need, err);
}

static void add_held(void *ctx, const struct core_holder *holder)
{
	uint64_t *sum = ctx;

	sum[0] += holder->held[LEDGER_INDEX];
	sum[1] += holder->held[LEDGER_MANIFEST];
}

static void job_of(struct dataset *d, const char *view)
{
	uint64_t sum[2] = {0}, before = ledger_held(h.ledger, LEDGER_MANIFEST);
	struct job *job;

	atomic_store(&gate.inside, false);
	atomic_store(&gate.closed, true);
	job = submit(d, false, view);
	turn_until(atomic_load(&gate.inside) || job_state_final(info_of(job).state));
	assert_true(atomic_load(&gate.inside));
	assert_non_null(gate.run->origin);
	assert_true(gate.run->reading);
	service_holders(h.service, add_held, sum);
	assert_int_equal(sum[0], ledger_held(h.ledger, LEDGER_INDEX));
	assert_int_equal(sum[1], ledger_held(h.ledger, LEDGER_MANIFEST) - before);
	atomic_store(&gate.closed, false);
	turn_until_final(job);
	turn_until(!service_active(h.service));
	assert_int_equal(info_of(job).state, JOB_done);
}

static void generation_behind_selection(void **state)
{
	struct dataset *d;
	struct job *job;

	(void)state;
	dataset_release(push_file_as("valley", "a.xyz", text_file(20000, 1)));
	d = push_file_as("valley", "b.xyz", text_file(20000, 2));
	job_of(d, "view 1 thin=5000:median weight=0:100 hidden");
	/* The selection is there before the run opens the generation. */
	job = submit(d, false, "view 1 thin=5000:median weight=0:200");
	turn_until_final(job);
	turn_until(!service_active(h.service));
	job_of(d, "view 1 thin=5000:median weight=0:200 hidden");
	dataset_release(d);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {TEST(generation_behind_selection)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
