/*
 * The phase mesh: the domains of a range of top leaves, in plan order, in one pack.
 *
 * The model: one arena and one open grid for all domains. A top leaf is halved down to the load as a plan of the whole would be,
 * and a region that does not fit with its halo is split as in acutd; load and cap are those of the plan. Where no split helps, a
 * top leaf gets as much as the memory of the run allows. So the pack depends on the dataset, the plan and that memory alone, and
 * a repeated attempt writes the same bytes.
 */
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "err.h"
#include "io.h"
#include "mesh_priv.h"
#include "store_pack.h"

#define HUGE_PAGE ((size_t)2 << 20)
/* Below, an arena of huge pages clears more memory than its domains use. */
#define HUGE_LEAVES 8

struct making {
	struct phase *s;
	struct mesh_plan plan;
	uint64_t memory;                  /* for the arena */
	bool huge;                        /* with huge pages */
	struct pipe_budget usual, budget; /* of the plan; of the arena */
	struct pipe_key key;
	uint8_t *arena;
	size_t arena_bytes;
	struct store_packer *packer;
	uint64_t lists; /* charged for the index of the pack */
	struct mesh_sums sums;
	struct mesh_extent extent;
};

/* ---- memory ---- */

static size_t huge_round(size_t n)
{
	return (n + HUGE_PAGE - 1) & ~(HUGE_PAGE - 1);
}

static void give_arena(struct making *m)
{
	if (!m->arena)
		return;
	munmap(m->arena, m->arena_bytes);
	ledger_give(m->s->ledger, LEDGER_DOMAIN, m->budget.domain_bytes);
	m->arena = NULL;
}

/* In place of the one before. */
static int take_arena(struct making *m, const struct pipe_budget *budget, struct err *err)
{
	void *at;

	give_arena(m);
	if (!ledger_take(m->s->ledger, LEDGER_DOMAIN, budget->domain_bytes))
		return phase_needs(m->s, phase_arena_needs(m->s, budget->domain_bytes), err);
	m->arena_bytes = huge_round(budget->domain_bytes) + HUGE_PAGE;
	at = mmap(NULL, m->arena_bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
	if (at == MAP_FAILED) {
		ledger_give(m->s->ledger, LEDGER_DOMAIN, budget->domain_bytes);
		return err_set(err, ERR_NOMEM, "no memory for a domain of %zu bytes", budget->domain_bytes);
	}
	m->arena = at;
	m->budget = *budget;
	madvise(at, m->arena_bytes, m->huge ? MADV_HUGEPAGE : MADV_NOHUGEPAGE);
	return 0;
}

static int take_usual(struct making *m, bool many, struct err *err)
{
	struct err why = ERR_INIT;

	m->memory = phase_arena(m->s);
	m->huge = many || m->plan.top > HUGE_LEAVES * m->plan.load;
	if (!pipe_budget_kept(m->memory, 1, m->s->grid, m->plan.load, m->plan.cap, &m->usual, &why))
		return take_arena(m, &m->usual, err);
	/* The plan was made with the same memory, and the dataset has not changed. */
	err_set(err, ERR_LIMIT, "a domain does not fit a task with the memory that it has now: %s", why.message);
	return err_add_hint(err, "give tasks the memory with which the plan was made");
}

/* An arena for a region of so many positions, as acutd has it for points in convex position. */
static int take_wide(struct making *m, uint64_t positions, struct err *err)
{
	const struct pipe_wide params = {m->memory, 1, positions, (uint64_t)m->budget.cap + 1};
	struct pipe_budget wide;
	uint64_t bytes;

	give_arena(m);
	err_clear(err);
	if (!pipe_budget_wide(&params, m->s->grid, &wide, &bytes, err))
		return take_arena(m, &wide, err);
	if (bytes == UINT64_MAX)
		return err_add_hint(err, "leave out points");
	err->need = phase_arena_needs(m->s, bytes);
	return err_add_hint(err, "begin a new run with --task-memory %lluM or more",
			    (unsigned long long)((err->need + (1 << 20) - 1) >> 20));
}

/* With huge pages it begins on one. */
static void *arena_of(const struct making *m)
{
	return (void *)(((uintptr_t)m->arena + HUGE_PAGE - 1) & ~(uintptr_t)(HUGE_PAGE - 1));
}

/* The index of the pack grows with the domains. */
static int charge_index(struct making *m, struct err *err)
{
	uint64_t held = store_packer_held(m->packer);

	if (held <= m->lists)
		return 0;
	if (!ledger_take(m->s->ledger, LEDGER_PLAN, held - m->lists)) {
		err_set(err, ERR_LIMIT, "a task makes %llu domains or more, and their list does not fit its memory",
			(unsigned long long)m->sums.domains);
		return err_add_hint(err, "make more tasks with --task-points, or give them more memory with --task-memory");
	}
	m->lists = held;
	return 0;
}

/* ---- domains ---- */

static int with_reader(struct making *m, struct grid_reader **ret, struct err *err)
{
	return grid_reader_new(m->s->grid, arena_of(m), grid_reader_bytes(m->s->grid), ret, err);
}

static int split(struct making *m, struct cut_plan *plan, size_t i, uint64_t need, struct err *err)
{
	struct grid_reader *reader = NULL;
	int r = with_reader(m, &reader, err);

	if (!r)
		r = pipe_plan_split(plan, i, reader, &m->s->view, need, m->budget.cap, err);
	grid_reader_free(reader);
	return r;
}

static int make_one(struct making *m, struct cut_plan *plan, size_t i, bool *ret_made, struct err *err)
{
	const struct pipe_known known = {.flat = plan->leaf[i].flat};
	struct mesh_domain domain = {0};
	struct pipe_stored stored;
	uint64_t need = 0;
	int r = pipe_domain(m->s->grid, &m->s->view, &plan->leaf[i].region, &known, &m->budget, arena_of(m), &domain, &need, err);

	*ret_made = r == 0;
	if (r)
		return r == PIPE_E_SPLIT ? split(m, plan, i, need, err) : r;
	sums_add_domain(&m->sums, &domain);
	r = pipe_pack(m->packer, &m->key, &plan->leaf[i].region, &domain, arena_of(m), known.flat, &stored, err);
	return r ? r : charge_index(m, err);
}

static int make_below(struct making *m, const struct cut_region *region, struct err *err)
{
	struct grid_reader *reader = NULL;
	struct cut_plan plan = {0};
	bool made;
	int r = with_reader(m, &reader, err);

	if (!r)
		r = cut_plan_below(reader, region, m->plan.leaves == 1, m->budget.load, &plan, err);
	grid_reader_free(reader);
	if (!r && m->plan.flat)
		cut_plan_make_flat(&plan);
	for (size_t i = 0; !r && i < plan.n; i += made) {
		made = false;
		r = work_check_interrupt(m->s->work, err);
		if (!r)
			r = make_one(m, &plan, i, &made, err);
	}
	cut_plan_done(&plan);
	return r;
}

/* A top leaf of which a region does not fit, however small it is, is begun again with a wider arena. The next one is not wider
 * for that, so domains do not depend on the division. */
static int make_leaf(struct making *m, const struct cut_region *region, struct err *err)
{
	const size_t before = store_packer_domains(m->packer);
	const struct mesh_sums sums = m->sums;
	int r = make_below(m, region, err);

	while (pipe_budget_narrow(&m->budget, m->s->grid, r, err)) {
		r = take_wide(m, err->need, err);
		if (!r)
			r = store_packer_keep(m->packer, before, err);
		if (r)
			return r;
		m->sums = sums;
		r = make_below(m, region, err);
	}
	if (!r && m->budget.cap != m->usual.cap)
		r = take_arena(m, &m->usual, err);
	return r == -ERR_BUSY ? phase_needs(m->s, 2 * m->s->p->memory, err) : r;
}

/* ---- the pack ---- */

static int make_pack(struct making *m, const struct cut_region *region, uint64_t n, struct err *err)
{
	struct work_attempt *a = m->s->attempt;
	char name[WORK_NAME];
	int fd = -1, r = work_attempt_file(a, WORK_IN_MESH, "pack", "", name, err);

	if (!r)
		r = io_open(work_fd(m->s->work), name, O_RDWR | O_CREAT | O_EXCL, 0640, &fd, err);
	if (!r)
		r = store_packer_new(fd, name, m->plan.of, &m->packer, err);
	for (uint64_t i = 0; !r && i < n; i++)
		r = make_leaf(m, &region[i], err);
	if (!r)
		r = store_packer_finish(m->packer, &m->sums.bytes, err);
	if (!r)
		r = io_sync(fd, name, err);
	if (!r)
		r = extent_of_pack(fd, name, &m->extent, err);
	store_packer_free(m->packer);
	ledger_give(m->s->ledger, LEDGER_PLAN, m->lists);
	io_close(fd);
	if (!r)
		r = work_result_file(a, name, err);
	return r ? r : extent_record(a, &m->extent, err);
}

static int open_all(struct making *m, struct err *err)
{
	struct phase *s = m->s;
	int r = phase_open(s, err);

	if (!r)
		r = view_parse(m->plan.view, &s->view, err);
	if (r)
		return r;
	if (!digest_equal(m->plan.content, grid_content(s->grid)))
		return err_set(err, ERR_CHANGED, "the dataset is not the one that was planned");
	view_bind(&s->view, &grid_manifest(s->grid)->lattice);
	pipe_key_init(&m->key, s->grid, &s->view);
	return 0;
}

static int make_range(struct making *m, const struct cut_region *region, uint64_t n, struct err *err)
{
	uint64_t bytes = n * sizeof *region;
	int r;

	if (!n)
		return 0; /* nothing to do */
	if (!ledger_take(m->s->ledger, LEDGER_PLAN, bytes))
		return phase_needs(m->s, m->s->p->memory + bytes, err);
	r = open_all(m, err);
	if (!r)
		r = take_usual(m, n >= HUGE_LEAVES, err);
	if (!r)
		r = make_pack(m, region, n, err);
	give_arena(m);
	ledger_give(m->s->ledger, LEDGER_PLAN, bytes);
	return r;
}

static int run(struct phase *s, uint32_t task, struct err *err)
{
	struct making m = {.s = s};
	struct cut_region *region = NULL;
	char name[WORK_NAME];
	uint64_t n = 0;
	int fd, r = phase_plan_open(s->work, &m.plan, name, &fd, err);

	if (r)
		return r;
	r = mesh_plan_leaves(&m.plan, task, &region, &n, err);
	io_close(fd);
	if (!r)
		r = make_range(&m, region, n, err);
	if (!r)
		r = mesh_sums_record(s->attempt, &m.sums, err);
	free(region);
	mesh_plan_done(&m.plan);
	return r;
}

int mesh_phase_mesh(struct work *w, uint32_t task, const struct mesh_phase_params *p, struct err *err)
{
	return phase_run(w, WORK_MESH, task, p, run, err);
}
