/* The files that a manifest names, and the lines of a generation. */
#include <stdio.h>
#include <string.h>

#include "grid_manifest.h"

static void name_file(const struct grid_source *s, const char *what, uint64_t bytes, struct grid_named *ret)
{
	*ret = (struct grid_named){.bytes = bytes, .source = s};
	snprintf(ret->name, sizeof ret->name, "%s-%u", what, s->id);
}

size_t grid_source_files(const struct grid_source *s, struct grid_named ret[GRID_SOURCE_FILES])
{
	if (s->kind == GRID_POINTS)
		return 0;
	if (s->kind == GRID_LINES) {
		name_file(s, "lines", s->lines->bytes, ret);
		return 1;
	}
	name_file(s, "lineset", s->lines->bytes, ret);
	if (!s->lines->places)
		return 1;
	name_file(s, "places", s->lines->places * GRID_PLACE_BYTES, ret + 1);
	return 2;
}

bool grid_manifest_next_file(const struct grid_manifest *m, struct grid_named_at *at, struct grid_named *ret)
{
	struct grid_named of[GRID_SOURCE_FILES];

	if (at->i < m->nsegments) {
		const struct grid_segment_info *s = &m->segments[at->i++];

		*ret = (struct grid_named){.bytes = s->bytes};
		memcpy(ret->name, s->file, sizeof ret->name);
		return true;
	}
	if (at->i - m->nsegments < m->nfiles) {
		const struct grid_sources_file *f = &m->files[at->i++ - m->nsegments];

		*ret = (struct grid_named){.bytes = f->bytes, .of_sources = true};
		memcpy(ret->name, f->name, sizeof ret->name);
		return true;
	}
	/* Sources in these files have none of their own. */
	for (; at->i - m->nsegments - m->nfiles < m->nsources; at->i++, at->of = 0) {
		size_t n = grid_source_files(&m->sources[at->i - m->nsegments - m->nfiles], of);

		if (at->of == n)
			continue;
		*ret = of[at->of++];
		return true;
	}
	return false;
}

size_t grid_manifest_files(const struct grid_manifest *m)
{
	struct grid_named_at at = {0};
	struct grid_named f;
	size_t n = 0;

	while (grid_manifest_next_file(m, &at, &f))
		n++;
	return n;
}

bool grid_manifest_has_file(const struct grid_manifest *m, const char *name)
{
	struct grid_named_at at = {0};
	struct grid_named f;

	while (grid_manifest_next_file(m, &at, &f))
		if (!strcmp(f.name, name))
			return true;
	return false;
}

uint64_t grid_manifest_bytes(const struct grid_manifest *m)
{
	struct grid_named_at at = {0};
	struct grid_named f;
	uint64_t bytes = 0;

	while (grid_manifest_next_file(m, &at, &f))
		bytes += f.bytes;
	return bytes;
}

size_t grid_manifest_lines(const struct grid_manifest *m, uint64_t generation, struct digest *ret)
{
	size_t n = 0;

	*ret = (struct digest){0, 0};
	for (size_t i = 0; i < m->nsources; i++) {
		if (m->sources[i].kind != GRID_LINES || !grid_source_live(&m->sources[i], generation))
			continue;
		digest_add(ret, m->sources[i].lines->content);
		n++;
	}
	return n;
}

const struct grid_source *grid_manifest_line_vertices(const struct grid_manifest *m, uint64_t generation)
{
	for (size_t i = m->nsources; i-- > 0;)
		if (m->sources[i].kind == GRID_LINE_VERTICES && grid_source_live(&m->sources[i], generation))
			return &m->sources[i];
	return NULL;
}

bool grid_manifest_lacks_line_set(const struct grid_manifest *m, uint64_t generation)
{
	struct digest content;

	return !grid_manifest_line_vertices(m, generation) && grid_manifest_lines(m, generation, &content);
}

void grid_line_segment(uint32_t source, char ret_stem[32])
{
	snprintf(ret_stem, 32, "vertices-%u", source);
}

bool grid_is_line_segment(const char *file)
{
	char stem[32];
	unsigned source;

	if (sscanf(file, "vertices-%u", &source) != 1)
		return false;
	grid_line_segment(source, stem);
	return !strncmp(file, stem, strlen(stem)) && !strcmp(file + strlen(stem), ".seg");
}
