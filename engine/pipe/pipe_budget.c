/*
 * The size of domains: the loads that a budget can have, and the memory that each needs.
 */
#include "pipe.h"

#include <inttypes.h>

#include "err.h"
#include "parse.h"
#include "pipe_priv.h"
#include "tri.h"

const uint32_t pipe_load[PIPE_LOADS] = {1u << 15, 1u << 17, 1u << 19, 1u << 20};

/* Room for the halo: an eighth of the load, plus what a small, ragged region needs. Measured halos of ordinary surveys
 * are 0.5 to 6 % of a region's points (algorithm.md 4); a region that needs more is split. */
static uint32_t cap_of(uint32_t load)
{
	return load + load / 8 + 4096;
}

/* The largest load with at most that cap; at least the smallest of pipe_load. */
static uint32_t load_of(uint32_t cap)
{
	uint32_t load = cap > 4096 ? (uint32_t)(((uint64_t)cap - 4096) * 8 / 9) : 0;

	return load > pipe_load[0] ? load : pipe_load[0];
}

size_t pipe_domain_bytes(uint32_t cap, size_t reader_bytes)
{
	return PIPE_TRACE + align_line(reader_bytes) + align_line(tri_bytes(cap)) + ALIGN_LINE;
}

static size_t reader_bytes_of(const struct grid *grid)
{
	/* Block buffers of one segment, as long as no grid is known; the estimate is repeated with the grid. */
	return grid ? grid_reader_bytes(grid) : (size_t)1 << 18;
}

size_t pipe_budget_min(const struct grid *grid)
{
	return PIPE_MADE_AND_SENT * pipe_domain_bytes(cap_of(pipe_load[0]), reader_bytes_of(grid));
}

int pipe_budget(uint64_t memory, unsigned threads, const struct grid *grid, struct pipe_budget *ret, struct err *err)
{
	size_t reader = reader_bytes_of(grid), bytes = 0;
	char need[32], have[32];
	int rung;

	if (!threads)
		threads = 1;
	for (unsigned t = threads; t; t--) {
		for (rung = PIPE_LOADS; rung-- > 0;) {
			bytes = pipe_domain_bytes(cap_of(pipe_load[rung]), reader);
			/* One more than there are threads: a finished domain is sent while all threads compute. */
			if (bytes * (t + 1) <= memory)
				break;
		}
		/* Fewer threads only if not even the smallest load fits them all. */
		if (rung >= 0) {
			*ret = (struct pipe_budget){
				.load = pipe_load[rung],
				.cap = cap_of(pipe_load[rung]),
				.domain_bytes = bytes,
				.threads = t,
			};
			return 0;
		}
	}
	err_set(err, ERR_LIMIT, "meshing needs %s for its domains, and %s are free", parse_size_text(pipe_budget_min(grid), need),
		parse_size_text(memory, have));
	return err_add_hint(err, "start the daemon with more memory, or wait for other jobs to end");
}

/* No region needs more: all points, and what tables of weights take. */
static uint64_t positions_most(const struct grid *grid)
{
	return grid ? 2 * grid_points(grid) : UINT64_MAX;
}

bool pipe_budget_narrow(const struct pipe_budget *budget, const struct grid *grid, int r, const struct err *err)
{
	return r == -ERR_LIMIT && err->need > budget->cap && budget->cap < positions_most(grid);
}

int pipe_budget_wide(const struct pipe_wide *w, const struct grid *grid, struct pipe_budget *ret, uint64_t *ret_need,
		     struct err *err)
{
	const uint64_t most = positions_most(grid), estimate = w->positions < most ? w->positions : most,
		       positions = estimate > w->least ? estimate : w->least;
	const size_t reader = reader_bytes_of(grid);
	uint64_t low = w->least ? w->least : positions, cap = positions < TRI_MAX_POINTS / 2 ? 2 * positions : TRI_MAX_POINTS;
	char need[32], have[32];

	if (low > TRI_MAX_POINTS || w->domains * pipe_domain_bytes((uint32_t)low, reader) > w->memory) {
		*ret_need = UINT64_MAX;
		if (positions > TRI_MAX_POINTS)
			return err_set(err, ERR_LIMIT, "a region needs %" PRIu64 " positions, and can have %u", positions,
				       TRI_MAX_POINTS);
		*ret_need = w->domains * pipe_domain_bytes((uint32_t)positions, reader);
		return err_set(err, ERR_LIMIT, "a region of %" PRIu64 " positions needs %s of memory, not %s", positions,
			       parse_size_text(*ret_need, need), parse_size_text(w->memory, have));
	}
	while (low < cap) {
		uint64_t middle = low + (cap - low + 1) / 2;

		if (w->domains * pipe_domain_bytes((uint32_t)middle, reader) <= w->memory)
			low = middle;
		else
			cap = middle - 1;
	}
	*ret = (struct pipe_budget){
		.load = load_of((uint32_t)cap),
		.cap = (uint32_t)cap,
		.domain_bytes = pipe_domain_bytes((uint32_t)cap, reader),
		.threads = 1,
	};
	return 0;
}

int pipe_budget_fixed(uint32_t load, uint64_t memory, size_t fixed, size_t each, const struct grid *grid, struct pipe_budget *ret,
		      struct err *err)
{
	uint32_t cap = cap_of(load);
	size_t domain = pipe_domain_bytes(cap, reader_bytes_of(grid));
	uint64_t bytes = domain + fixed + (uint64_t)each * cap;
	char need[32], have[32];

	if (bytes <= memory) {
		*ret = (struct pipe_budget){.load = load, .cap = cap, .domain_bytes = domain, .threads = 1};
		return 0;
	}
	err_set(err, ERR_LIMIT, "a region needs %s of memory, not %s", parse_size_text(bytes, need),
		parse_size_text(memory, have));
	err->need = bytes;
	return -ERR_LIMIT;
}

int pipe_budget_kept(uint64_t memory, unsigned threads, const struct grid *grid, uint32_t load, uint32_t cap,
		     struct pipe_budget *ret, struct err *err)
{
	size_t bytes = pipe_domain_bytes(cap, reader_bytes_of(grid));
	uint64_t carried = memory / bytes;
	char need[32], have[32];

	if (!carried)
		return err_set(err, ERR_LIMIT, "a domain of the plan that was kept needs %s, %s are left of the memory",
			       parse_size_text(bytes, need), parse_size_text(memory, have));
	if (!threads)
		threads = 1;
	/* As above, one more than there are threads; but a single one suffices. */
	if (carried <= threads)
		threads = carried > 1 ? (unsigned)carried - 1 : 1;
	*ret = (struct pipe_budget){.load = load, .cap = cap, .domain_bytes = bytes, .threads = threads};
	return 0;
}
