/*
 * The rules that every manifest must obey, checked after reading and before writing. They do not cover the files and
 * points of generations; acut-grid-dump --check derives those.
 */
#include <stdlib.h>
#include <string.h>

#include "grid_disk.h"
#include "grid_manifest_priv.h"
#include "order.h"
#include "point.h"
#include "utf8.h"

static bool text_ok(const char *text, size_t size)
{
	return strnlen(text, size) < size;
}

static int compare_names(const void *a, const void *b)
{
	return strcmp(*(char *const *)a, *(char *const *)b);
}

static const char *segment_fault(const struct grid_segment_info *s)
{
	uint64_t classes = 0;

	if (!text_ok(s->file, sizeof s->file) || !s->file[0] || strchr(s->file, '/') || s->file[0] == '.')
		return "a segment has no proper file name";
	for (unsigned i = 0; i < 256; i++) {
		if (s->classes[i] > s->points)
			return "a segment has more points of a class than points";
		classes += s->classes[i];
	}
	if (classes != s->points || !s->points != !s->cells || s->cells > s->points || s->bytes < DISK_HEADER)
		return "the numbers of a segment contradict each other";
	if (s->points && (s->box[0] > s->box[2] || s->box[1] > s->box[3]))
		return "the box of a segment is inverted";
	if (s->points ?
		    s->lo > s->hi || s->lo < point_morton(s->box[0], s->box[1]) || s->hi > point_morton(s->box[2], s->box[3]) :
		    s->lo || s->hi)
		return "a segment has keys that its box does not have";
	return NULL;
}

static const char *spans_fault(const struct grid_source *s)
{
	if (s->nearlier > UINT16_MAX)
		return "a source has too many spans";
	for (size_t i = 0; i < s->nearlier; i++) {
		uint64_t next = i + 1 < s->nearlier ? s->earlier[i + 1].added : s->added;

		if (s->earlier[i].removed <= s->earlier[i].added || s->earlier[i].removed >= next)
			return "the spans of a source overlap";
	}
	return NULL;
}

static const char *lines_fault(const struct grid_source *s)
{
	if (s->kind >= GRID_SOURCE_KINDS)
		return "a source is of no known kind";
	if (!s->lines != (s->kind == GRID_POINTS))
		return "a source has lines that its kind does not have";
	if (s->kind == GRID_LINES && s->points)
		return "a source of lines has points";
	return s->kind == GRID_LINE_VERTICES && ((s->name && *s->name) || (s->path && *s->path)) ? "line vertices have a name" :
												   NULL;
}

const char *manifest_source_fault(const struct grid_manifest *m, const struct grid_source *s)
{
	if (!s->id)
		return "a source has the number 0";
	if (s->name && !text_ok(s->name, GRID_SOURCE_NAME))
		return "the name of a source is too long";
	if (s->path && !text_ok(s->path, GRID_SOURCE_PATH))
		return "the path of a source is too long";
	if (s->overridden && !text_ok(s->overridden, GRID_SOURCE_OVERRIDDEN))
		return "the overridden coordinate system of a source is too long";
	if (s->reading && !text_ok(s->reading, GRID_SOURCE_READING))
		return "the reading of a source is too long";
	if (s->added > m->generation || s->removed > m->generation)
		return "a source belongs to a generation that does not exist yet";
	if (s->removed && s->removed < s->added)
		return "a source was removed before it was added";
	return lines_fault(s) ? lines_fault(s) : spans_fault(s);
}

static const char *generation_fault(const struct grid_manifest *m, size_t i)
{
	const struct grid_generation *g = &m->generations[i];

	if (!g->number || g->number > m->generation || (i && g->number <= g[-1].number))
		return "a generation has a number that it cannot have";
	if (g->kind < GRID_PUSH || g->kind >= GRID_KINDS)
		return "a generation is of no known kind";
	if (g->undoes > g->number)
		return "a generation undoes one that does not exist yet";
	if (g->user && !text_ok(g->user, GRID_USER))
		return "the name of a user is too long";
	return NULL;
}

static const char *find_repeats(const struct grid_manifest *m, bool *ret_nomem)
{
	size_t most = m->nsegments > m->nsources ? m->nsegments : m->nsources;
	const char **names = malloc((most + 1) * sizeof *names);
	uint32_t *ids = (uint32_t *)names;
	const char *fault = NULL;

	*ret_nomem = !names;
	if (!names)
		return NULL;
	for (size_t i = 0; i < m->nsegments; i++)
		names[i] = m->segments[i].file;
	qsort(names, m->nsegments, sizeof *names, compare_names);
	for (size_t i = 1; i < m->nsegments; i++)
		if (!strcmp(names[i], names[i - 1]))
			fault = "a segment is named twice";
	for (size_t i = 0; i < m->nsources; i++)
		ids[i] = m->sources[i].id;
	qsort(ids, m->nsources, sizeof *ids, order_u32);
	for (size_t i = 1; i < m->nsources; i++)
		if (ids[i] == ids[i - 1])
			fault = "two sources have the same number";
	free(names);
	return fault;
}

/* It goes into outputs: one line of UTF-8. */
static const char *wkt_fault(const struct grid_manifest *m)
{
	size_t n = m->wkt ? strnlen(m->wkt, GRID_WKT) : 0, one;

	if (n == GRID_WKT)
		return "the WKT of its coordinate system is too long";
	for (size_t i = 0; i < n; i += one)
		if (!(one = utf8_printable(m->wkt + i, n - i)))
			return "the WKT of its coordinate system is no line of text";
	return m->wkt_since > m->generation ? "its WKT is of a generation that does not exist yet" : NULL;
}

const char *grid_manifest_check(const struct grid_manifest *m, bool *ret_nomem)
{
	struct lattice back;
	char text[LATTICE_TEXT_SIZE];
	const char *fault = wkt_fault(m);
	unsigned sets = 0;

	*ret_nomem = false;
	if (!text_ok(m->crs, sizeof m->crs) || !text_ok(m->unit_xy, sizeof m->unit_xy) || !text_ok(m->unit_z, sizeof m->unit_z) ||
	    !text_ok(m->geoid, sizeof m->geoid) || !text_ok(m->choices, sizeof m->choices))
		return "a text is too long";
	if (!lattice_parse(lattice_text(&m->lattice, text), &back))
		return "the lattice is invalid";
	for (size_t i = 0; !fault && i < m->nsegments; i++)
		fault = segment_fault(&m->segments[i]);
	for (size_t i = 0; !fault && i < m->nsources; i++)
		fault = manifest_source_fault(m, &m->sources[i]);
	for (size_t i = 0; !fault && i < m->ngenerations; i++)
		fault = generation_fault(m, i);
	for (size_t i = 0; i < m->nsources; i++)
		sets += m->sources[i].kind == GRID_LINE_VERTICES && grid_source_live(&m->sources[i], m->generation);
	if (!fault && sets > 1)
		fault = "its newest generation has two line sets";
	if (!fault && m->oldest > m->generation)
		fault = "its oldest generation does not exist yet";
	return fault ? fault : find_repeats(m, ret_nomem);
}
