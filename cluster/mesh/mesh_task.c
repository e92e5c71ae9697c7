/*
 * The phase mesh: the domains of a range of top leaves, in plan order, in one pack.
 *
 * The model: one arena and one open grid for all domains. A top leaf is halved down to the load as a plan of the whole would be,
 * and a region that does not fit with its halo is split as in acutd; load and cap are those of the plan. So the pack depends on
 * the dataset and the plan alone, and a repeated attempt writes the same bytes.
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
	struct pipe_budget budget;
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

static int take_arena(struct making *m, bool huge, struct err *err)
{
	struct phase *s = m->s;
	const uint64_t left = ledger_left(s->ledger), lists = phase_lists(s), memory = left > lists ? left - lists : 0;
	struct err why = ERR_INIT;
	void *at;

	if (pipe_budget_kept(memory, 1, s->grid, m->plan.load, m->plan.cap, &m->budget, &why) ||
	    !ledger_take(s->ledger, LEDGER_DOMAIN, m->budget.domain_bytes)) {
		/* The plan was made with the same memory, and the dataset has not changed. */
		err_set(err, ERR_LIMIT, "a domain does not fit a task with the memory that it has now: %s", why.message);
		return err_add_hint(err, "give tasks the memory with which the plan was made");
	}
	m->arena_bytes = huge_round(m->budget.domain_bytes) + HUGE_PAGE;
	at = mmap(NULL, m->arena_bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
	if (at == MAP_FAILED) {
		ledger_give(s->ledger, LEDGER_DOMAIN, m->budget.domain_bytes);
		return err_set(err, ERR_NOMEM, "no memory for a domain of %zu bytes", m->budget.domain_bytes);
	}
	m->arena = at;
	madvise(at, m->arena_bytes, huge ? MADV_HUGEPAGE : MADV_NOHUGEPAGE);
	return 0;
}

static void give_arena(struct making *m)
{
	if (!m->arena)
		return;
	munmap(m->arena, m->arena_bytes);
	ledger_give(m->s->ledger, LEDGER_DOMAIN, m->budget.domain_bytes);
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
		r = pipe_plan_split(plan, i, reader, &m->s->view, need, m->plan.cap, err);
	grid_reader_free(reader);
	if (r == -ERR_LIMIT)
		err_add_hint(err, "give tasks more memory with --task-memory");
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

static int make_leaf(struct making *m, const struct cut_region *region, struct err *err)
{
	struct grid_reader *reader = NULL;
	struct cut_plan plan = {0};
	bool made;
	int r = with_reader(m, &reader, err);

	if (!r)
		r = cut_plan_below(reader, region, m->plan.leaves == 1, m->plan.load, &plan, err);
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
		r = take_arena(m, n >= HUGE_LEAVES || m->plan.top > HUGE_LEAVES * m->plan.load, err);
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
