/*
 * Generations (grid_manifest.h): which sources are live in a generation, and what each generation added and removed. A
 * source can be live in several spans of generations: a revert restores it without writing its records again.
 */
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_manifest_priv.h"
#include "order.h"

bool grid_batch_live(const struct grid_batch *b, uint64_t generation)
{
	if (b->added <= generation)
		return !b->removed || b->removed > generation;
	for (size_t i = 0; i < b->nearlier; i++)
		if (b->earlier[i].added <= generation && b->earlier[i].removed > generation)
			return true;
	return false;
}

bool grid_source_live(const struct grid_source *s, uint64_t generation)
{
	const struct grid_batch alone = {
		.added = s->added, .removed = s->removed, .earlier = s->earlier, .nearlier = s->nearlier};

	return grid_batch_live(&alone, generation);
}

int grid_source_restore(struct grid_source *s, uint64_t generation, struct grid_span *spans, struct err *err)
{
	if (s->nearlier >= UINT16_MAX)
		return err_set(err, ERR_LIMIT,
			       s->kind == GRID_LINE_VERTICES ? "lines were removed and brought back too often" :
							       "a file was removed and brought back too often");
	if (s->nearlier)
		memcpy(spans, s->earlier, s->nearlier * sizeof *spans);
	spans[s->nearlier++] = (struct grid_span){s->added, s->removed};
	s->earlier = spans;
	s->added = generation;
	s->removed = 0;
	return 0;
}

const char *grid_generation_kind_text(enum grid_generation_kind kind)
{
	static const char *const texts[GRID_KINDS] = {
		[GRID_PUSH] = "push",   [GRID_REVERT] = "revert", [GRID_REPLACE] = "replace",
		[GRID_PRUNE] = "prune", [GRID_IMPORT] = "import",
	};

	return kind < GRID_KINDS && texts[kind] ? texts[kind] : "unknown";
}

uint64_t grid_manifest_oldest(const struct grid_manifest *m)
{
	return m->oldest || !m->generation ? m->oldest : 1;
}

/* ---- totals from the sources ---- */

static struct grid_generation *find(struct grid_generation *all, size_t n, uint64_t number)
{
	size_t a = 0, b = n;

	while (a < b) {
		size_t mid = a + (b - a) / 2;

		if (all[mid].number < number)
			a = mid + 1;
		else
			b = mid;
	}
	return a < n && all[a].number == number ? &all[a] : NULL;
}

static void tally_span(const struct grid_source *s, uint64_t added, uint64_t removed, struct grid_generation *all, size_t n)
{
	struct grid_generation *from = find(all, n, added), *to = removed ? find(all, n, removed) : NULL;

	if (added == removed || s->kind == GRID_LINE_VERTICES)
		return;
	if (from) {
		from->files++;
		from->points_added += s->points;
		from->lines_added += s->lines ? s->lines->lines : 0;
		digest_add(&from->content, s->hash);
	}
	if (to) {
		to->files_removed++;
		to->points_removed += s->points;
		to->lines_removed += s->lines ? s->lines->lines : 0;
	}
}

void grid_generations_tally(const struct grid_manifest *m, struct grid_generation *all, size_t n)
{
	for (size_t i = 0; i < n; i++) {
		all[i].files = all[i].files_removed = 0;
		all[i].points_added = all[i].points_removed = 0;
		all[i].lines_added = all[i].lines_removed = 0;
		all[i].content = (struct digest){0, 0};
	}
	for (size_t i = 0; i < m->nsources; i++) {
		const struct grid_source *s = &m->sources[i];

		for (size_t k = 0; k < s->nearlier; k++)
			tally_span(s, s->earlier[k].added, s->earlier[k].removed, all, n);
		tally_span(s, s->added, s->removed, all, n);
	}
}

/* ---- manifests that do not list their generations ---- */

/* The generations that added or removed a source, ascending, each once. */
static size_t list_numbers(const struct grid_manifest *m, uint64_t *numbers)
{
	size_t n = 0, kept = 0;

	for (size_t i = 0; i < m->nsources; i++) {
		numbers[n++] = m->sources[i].added;
		numbers[n++] = m->sources[i].removed;
	}
	qsort(numbers, n, sizeof *numbers, order_u64);
	for (size_t i = 0; i < n; i++)
		if (numbers[i] && numbers[i] <= m->generation && (!kept || numbers[kept - 1] != numbers[i]))
			numbers[kept++] = numbers[i];
	return kept;
}

bool grid_manifest_derive(struct grid_manifest *m)
{
	uint64_t *numbers = calloc(2 * m->nsources + 1, sizeof *numbers);
	size_t n = numbers ? list_numbers(m, numbers) : 0;

	m->generations = numbers ? calloc(n + 1, sizeof *m->generations) : NULL;
	for (size_t i = 0; m->generations && i < n; i++)
		m->generations[i] = (struct grid_generation){.number = numbers[i], .kind = GRID_PUSH, .user = ""};
	free(numbers);
	if (!m->generations)
		return false;
	m->ngenerations = n;
	grid_generations_tally(m, m->generations, n);
	for (size_t i = 0; i < n; i++)
		if (m->generations[i].files_removed)
			m->generations[i].kind = m->generations[i].files ? GRID_REPLACE : GRID_REVERT;
	return true;
}
