/* Writing manifests (grid_manifest.c). */
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "grid_disk.h"
#include "grid_file.h"
#include "grid_block.h"
#include "grid_manifest_priv.h"

static void pack_text(struct packer *p, const char *text)
{
	size_t n = text ? strlen(text) : 0;

	packer_u16(p, (uint16_t)n);
	packer_bytes(p, text, n);
}

static void pack_segment(struct packer *p, const struct grid_segment_info *s)
{
	unsigned classes = 0;

	pack_text(p, s->file);
	packer_u64(p, s->points);
	packer_u64(p, s->cells);
	packer_u64(p, s->bytes);
	for (unsigned i = 0; i < 4; i++)
		packer_i32(p, s->box[i]);
	packer_u64(p, s->sum.hi);
	packer_u64(p, s->sum.lo);
	for (unsigned c = 0; c < 256; c++)
		classes += s->classes[c] != 0;
	packer_u16(p, (uint16_t)classes);
	for (unsigned c = 0; c < 256; c++) {
		if (!s->classes[c])
			continue;
		packer_u8(p, (uint8_t)c);
		packer_u64(p, s->classes[c]);
	}
	packer_u64(p, s->lo);
	packer_u64(p, s->hi);
}

static void pack_lines(struct packer *p, const struct grid_lines *lines)
{
	for (unsigned i = 0; i < GRID_LINE_KINDS; i++)
		packer_u64(p, lines->features[i]);
	packer_u64(p, lines->lines);
	packer_u64(p, lines->vertices);
	packer_u64(p, lines->bytes);
	packer_u64(p, lines->places);
	packer_u64(p, lines->content.hi);
	packer_u64(p, lines->content.lo);
}

static void pack_source(struct packer *p, const struct grid_source *s)
{
	packer_u32(p, s->id);
	packer_u64(p, s->added);
	packer_u64(p, s->removed);
	packer_u64(p, s->points);
	packer_u64(p, s->hash.hi);
	packer_u64(p, s->hash.lo);
	pack_text(p, s->name);
	packer_u64(p, s->size);
	packer_u64(p, (uint64_t)s->mtime_ns);
	pack_text(p, s->path);
	packer_u16(p, (uint16_t)s->nearlier);
	for (size_t i = 0; i < s->nearlier; i++) {
		packer_u64(p, s->earlier[i].added);
		packer_u64(p, s->earlier[i].removed);
	}
	pack_text(p, s->overridden);
	packer_u64(p, s->left_out);
	pack_text(p, s->reading);
	packer_u8(p, s->kind);
	if (s->lines)
		pack_lines(p, s->lines);
}

static void pack_generation(struct packer *p, const struct grid_generation *g)
{
	packer_u64(p, g->number);
	packer_u64(p, (uint64_t)g->time_us);
	packer_u32(p, g->uid);
	packer_u8(p, (uint8_t)g->kind);
	packer_u64(p, g->undoes);
	packer_u32(p, g->files);
	packer_u32(p, g->files_removed);
	packer_u64(p, g->points_added);
	packer_u64(p, g->points_removed);
	packer_u64(p, g->lines_added);
	packer_u64(p, g->lines_removed);
	packer_u64(p, g->content.hi);
	packer_u64(p, g->content.lo);
	pack_text(p, g->user);
}

static uint64_t count_spans(const struct grid_manifest *m)
{
	uint64_t spans = 0;

	for (size_t i = 0; i < m->nsources; i++)
		spans += m->sources[i].nearlier;
	return spans;
}

static uint64_t count_lines(const struct grid_manifest *m)
{
	uint64_t lines = 0;

	for (size_t i = 0; i < m->nsources; i++)
		lines += m->sources[i].lines != NULL;
	return lines;
}

/* Packs the file into `out`; returns its size, or 0 if it does not fit. */
static size_t pack(const struct grid_manifest *m, void *out, size_t size)
{
	struct packer p = packer_of(out, size);
	char text[LATTICE_TEXT_SIZE];
	uint64_t bytes, check;

	packer_bytes(&p, DISK_MANIFEST_MAGIC, 8);
	packer_u32(&p, DISK_MANIFEST_VERSION);
	packer_u32(&p, 0);
	packer_u64(&p, 0); /* size, below */
	packer_u64(&p, m->generation);
	packer_u32(&p, (uint32_t)m->nsegments);
	packer_u32(&p, (uint32_t)m->nsources);
	packer_u64(&p, grid_manifest_oldest(m));
	packer_u32(&p, (uint32_t)m->ngenerations);
	packer_u32(&p, (uint32_t)count_spans(m));
	packer_u32(&p, (uint32_t)count_lines(m));
	pack_text(&p, lattice_text(&m->lattice, text));
	pack_text(&p, m->crs);
	pack_text(&p, m->unit_xy);
	pack_text(&p, m->unit_z);
	for (size_t i = 0; i < m->nsegments; i++)
		pack_segment(&p, &m->segments[i]);
	for (size_t i = 0; i < m->nsources; i++)
		pack_source(&p, &m->sources[i]);
	pack_text(&p, m->geoid);
	pack_text(&p, m->choices);
	pack_text(&p, m->wkt);
	packer_u64(&p, m->wkt_since);
	for (size_t i = 0; i < m->ngenerations; i++)
		pack_generation(&p, &m->generations[i]);
	bytes = packer_size(&p) + CHECK_BYTES;
	memcpy((uint8_t *)out + 16, &bytes, sizeof bytes);
	check = grid_check(out, packer_size(&p), 0);
	packer_u64(&p, check);
	return p.bad ? 0 : bytes;
}

/* An upper bound of the file's size. */
static uint64_t max_bytes(const struct grid_manifest *m)
{
	uint64_t bytes = HEAD_BYTES + HEAD_MORE + HEAD_LINES + TEXTS_MOST + (m->wkt ? strlen(m->wkt) : 0) +
			 m->nsegments * (uint64_t)SEGMENT_MOST + CHECK_BYTES;

	for (size_t i = 0; i < m->nsources; i++) {
		const struct grid_source *s = &m->sources[i];

		bytes += SOURCE_LEAST + SOURCE_MORE + SOURCE_SPANS + SOURCE_READ + SOURCE_KIND + (s->lines ? LINES_BYTES : 0) +
			 s->nearlier * SPAN_BYTES + (s->name ? strlen(s->name) : 0) + (s->path ? strlen(s->path) : 0) +
			 (s->overridden ? strlen(s->overridden) : 0) + (s->reading ? strlen(s->reading) : 0);
	}
	for (size_t i = 0; i < m->ngenerations; i++)
		bytes += GENERATION_LEAST + GENERATION_LINES + (m->generations[i].user ? strlen(m->generations[i].user) : 0);
	return bytes;
}

int grid_manifest_write(int dirfd, const char *name, const struct grid_manifest *m, struct err *err)
{
	struct grid_file f;
	bool nomem;
	const char *fault = grid_manifest_check(m, &nomem);

	if (fault)
		return err_set(err, ERR_INTERNAL, "not a manifest to write: %s", fault);
	size_t len = strlen(name);
	uint64_t most = max_bytes(m);

	if (!len || len >= GRID_NAME_MAX || most > MANIFEST_MOST)
		return err_set(err, ERR_LIMIT, "a manifest of %zu sources cannot be written as '%s'", m->nsources, name);
	uint8_t *bytes = nomem ? NULL : malloc(2 * most);

	if (!bytes)
		return err_set(err, ERR_NOMEM, "no memory for a manifest of %zu sources", m->nsources);
	int rc = grid_file_create(&f, dirfd, name, bytes + most, most, err);

	if (rc == 0) {
		size_t n = pack(m, bytes, most);

		rc = n ? grid_file_append(&f, bytes, n, err) : err_set(err, ERR_INTERNAL, "a manifest is larger than it can be");
		if (rc == 0)
			rc = grid_file_publish(&f, GRID_DURABLE, err);
		grid_file_abort(&f);
	}
	free(bytes);
	return rc;
}
