/* Writing manifests (grid_manifest.c). */
#include <stdlib.h>
#include <string.h>

#include "cursor.h"
#include "err.h"
#include "grid_disk.h"
#include "grid_file.h"
#include "grid_block.h"
#include "grid_manifest_priv.h"
#include "io.h"

void manifest_pack_text(struct packer *p, const char *text)
{
	size_t n = text ? strlen(text) : 0;

	packer_u16(p, (uint16_t)n);
	packer_bytes(p, text, n);
}

static void pack_segment(struct packer *p, const struct grid_segment_info *s)
{
	unsigned classes = 0;

	manifest_pack_text(p, s->file);
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

void manifest_pack_source(struct packer *p, const struct grid_source *s)
{
	packer_u32(p, s->id);
	packer_u64(p, s->points);
	packer_u64(p, s->hash.hi);
	packer_u64(p, s->hash.lo);
	manifest_pack_text(p, s->name);
	packer_u64(p, s->size);
	packer_u64(p, (uint64_t)s->mtime_ns);
	manifest_pack_text(p, s->path);
	manifest_pack_text(p, s->overridden);
	packer_u64(p, s->left_out);
	manifest_pack_text(p, s->reading);
	packer_u8(p, s->kind);
	if (s->lines)
		pack_lines(p, s->lines);
}

static size_t text_bytes(const char *text)
{
	return text ? strlen(text) : 0;
}

uint64_t manifest_source_bytes(const struct grid_source *s)
{
	return SOURCE_LAST + (s->lines ? LINES_BYTES : 0) + text_bytes(s->name) + text_bytes(s->path) +
	       text_bytes(s->overridden) + text_bytes(s->reading);
}

static void pack_file(struct packer *p, const struct grid_sources_file *f)
{
	manifest_pack_text(p, f->name);
	packer_u64(p, f->bytes);
	packer_u32(p, f->n);
	packer_u64(p, f->check);
}

static void pack_batch(struct packer *p, const struct grid_batch *b)
{
	packer_u32(p, b->first);
	packer_u32(p, b->n);
	packer_u8(p, b->apart);
	packer_u64(p, b->added);
	packer_u64(p, b->removed);
	packer_u16(p, (uint16_t)b->nearlier);
	for (size_t i = 0; i < b->nearlier; i++) {
		packer_u64(p, b->earlier[i].added);
		packer_u64(p, b->earlier[i].removed);
	}
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
	manifest_pack_text(p, g->user);
}

/* A manifest, and where its sources go. */
struct packing {
	const struct grid_manifest *m;
	const struct apart *apart; /* NULL: all are in the manifest */
	struct grid_batch *batches;
	size_t nbatches;
	uint64_t here, lines, spans; /* counts in the file */
	uint64_t most;               /* an upper bound of its size */
};

static bool is_here(const struct packing *of, size_t source)
{
	return !of->apart || !of->apart->apart[source];
}

static bool packing_init(struct packing *of, const struct grid_manifest *m, const struct apart *apart)
{
	*of = (struct packing){.m = m, .apart = apart};
	of->batches = manifest_batches_of(m->sources, m->nsources, apart ? apart->apart : NULL, &of->nbatches);
	if (!of->batches)
		return false;
	of->most = HEAD_BYTES + HEAD_MORE + HEAD_LINES + HEAD_APART + TEXTS_MOST + text_bytes(m->wkt) +
		   m->nsegments * (uint64_t)SEGMENT_MOST + (apart ? apart->nfiles * (uint64_t)(FILE_LEAST + 64) : 0) +
		   CHECK_BYTES;
	for (size_t i = 0; i < of->nbatches; i++) {
		of->spans += of->batches[i].nearlier;
		of->most += BATCH_LEAST + of->batches[i].nearlier * SPAN_BYTES;
	}
	for (size_t i = 0; i < m->nsources; i++) {
		if (!is_here(of, i))
			continue;
		of->here++;
		of->lines += m->sources[i].lines != NULL;
		of->most += manifest_source_bytes(&m->sources[i]);
	}
	for (size_t i = 0; i < m->ngenerations; i++)
		of->most += GENERATION_LEAST + GENERATION_LINES + text_bytes(m->generations[i].user);
	return true;
}

static void pack_head(struct packer *p, const struct packing *of)
{
	const struct grid_manifest *m = of->m;
	char text[LATTICE_TEXT_SIZE];

	packer_bytes(p, DISK_MANIFEST_MAGIC, 8);
	packer_u32(p, DISK_MANIFEST_VERSION);
	packer_u32(p, 0);
	packer_u64(p, 0); /* size, later */
	packer_u64(p, m->generation);
	packer_u32(p, (uint32_t)m->nsegments);
	packer_u32(p, (uint32_t)of->here);
	packer_u64(p, grid_manifest_oldest(m));
	packer_u32(p, (uint32_t)m->ngenerations);
	packer_u32(p, (uint32_t)of->spans);
	packer_u32(p, (uint32_t)of->lines);
	packer_u32(p, of->apart ? (uint32_t)of->apart->nfiles : 0);
	packer_u32(p, (uint32_t)of->nbatches);
	manifest_pack_text(p, lattice_text(&m->lattice, text));
	manifest_pack_text(p, m->crs);
	manifest_pack_text(p, m->unit_xy);
	manifest_pack_text(p, m->unit_z);
}

/* Packs the file into `out`; returns its size, or 0 if it does not fit. */
static size_t pack(const struct packing *of, void *out)
{
	const struct grid_manifest *m = of->m;
	struct packer p = packer_of(out, of->most);
	uint64_t bytes, check;

	pack_head(&p, of);
	for (size_t i = 0; i < m->nsegments; i++)
		pack_segment(&p, &m->segments[i]);
	for (size_t i = 0; of->apart && i < of->apart->nfiles; i++)
		pack_file(&p, &of->apart->files[i]);
	for (size_t i = 0; i < of->nbatches; i++)
		pack_batch(&p, &of->batches[i]);
	for (size_t i = 0; i < m->nsources; i++)
		if (is_here(of, i))
			manifest_pack_source(&p, &m->sources[i]);
	manifest_pack_text(&p, m->geoid);
	manifest_pack_text(&p, m->choices);
	manifest_pack_text(&p, m->wkt);
	packer_u64(&p, m->wkt_since);
	for (size_t i = 0; i < m->ngenerations; i++)
		pack_generation(&p, &m->generations[i]);
	bytes = packer_size(&p) + CHECK_BYTES;
	memcpy((uint8_t *)out + 16, &bytes, sizeof bytes);
	check = grid_check(out, packer_size(&p), 0);
	packer_u64(&p, check);
	return p.bad ? 0 : bytes;
}

static int write_packed(int dirfd, const char *name, const struct packing *of, struct err *err)
{
	struct grid_file f = GRID_FILE_INIT;
	uint8_t *bytes = malloc(2 * of->most);
	int rc;

	if (!bytes)
		return err_set(err, ERR_NOMEM, "no memory for a manifest of %zu sources", of->m->nsources);
	rc = grid_file_create(&f, dirfd, name, bytes + of->most, of->most, err);
	if (rc == 0) {
		size_t n = pack(of, bytes);

		rc = n ? grid_file_append(&f, bytes, n, err) : err_set(err, ERR_INTERNAL, "a manifest is larger than it can be");
		if (rc == 0)
			rc = grid_file_publish(&f, GRID_DURABLE, err);
		grid_file_abort(&f);
	}
	free(bytes);
	return rc;
}

static int write_manifest(int dirfd, const char *name, const struct grid_manifest *m, const struct apart *apart, struct err *err)
{
	struct packing of;
	size_t len = strlen(name);
	int rc;

	if (!packing_init(&of, m, apart))
		return err_set(err, ERR_NOMEM, "no memory for a manifest of %zu sources", m->nsources);
	if (!len || len >= GRID_NAME_MAX || of.most > MANIFEST_MOST)
		rc = err_set(err, ERR_LIMIT, "a manifest of %zu sources cannot be written as '%s'", m->nsources, name);
	else
		rc = write_packed(dirfd, name, &of, err);
	free(of.batches);
	return rc;
}

static int check(const struct grid_manifest *m, struct err *err)
{
	bool nomem = false;
	const char *fault = m->bare ? "its sources were not read" : grid_manifest_check(m, &nomem);

	if (fault)
		return err_set(err, ERR_INTERNAL, "not a manifest to write: %s", fault);
	return nomem ? err_set(err, ERR_NOMEM, "no memory for a manifest of %zu sources", m->nsources) : 0;
}

int grid_manifest_write(int dirfd, const char *name, const struct grid_manifest *m, struct err *err)
{
	int rc = check(m, err);

	return rc ? rc : write_manifest(dirfd, name, m, NULL, err);
}

int grid_manifest_write_apart(int dirfd, const char *name, struct grid_apart *a, const struct grid_manifest *m, struct err *err)
{
	struct apart apart;
	int rc = check(m, err);

	a->made = false;
	a->ndropped = 0;
	if (rc == 0)
		rc = manifest_apart_choose(m, a, &apart, err);
	if (rc)
		return rc;
	if (a->made)
		rc = manifest_apart_write(dirfd, m, a, &apart, err);
	a->made = a->made && rc == 0;
	if (rc == 0)
		rc = write_manifest(dirfd, name, m, &apart, err);
	if (rc && a->made) {
		io->unlinkat(dirfd, a->as ? a->as : a->name, 0);
		a->made = false;
	}
	manifest_apart_done(&apart);
	return rc;
}
