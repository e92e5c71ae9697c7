/*
 * Which sources of a manifest are in files of sources (grid_manifest.h), and writing such a file.
 *
 * The model: a new file takes in the older ones that have at most twice as many sources as it, the smallest first. So each of the
 * others has more than twice as many as the next smaller one, there are about log2 n, and a source is written again log1.5 n
 * times, however many generations there are.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "err.h"
#include "grid_block.h"
#include "grid_disk.h"
#include "grid_file.h"
#include "grid_manifest_priv.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

enum { BUFFER = 64 << 10 }; /* more than a source takes */

unsigned grid_sources_here = 128;

/* Of the manifest's files: those that stay, and the sources in the new one. */
struct choice {
	const struct grid_manifest *m;
	bool keep[GRID_SOURCES_FILES];
	uint32_t *in; /* each source: the number of its file and 1; 0: none */
	size_t loose; /* sources of points that are in no file that stays */
};

static void find_files(struct choice *c)
{
	const struct grid_manifest *m = c->m;
	size_t count[GRID_SOURCES_FILES] = {0};

	for (size_t i = 0; i < m->nsources; i++)
		for (size_t k = 0; m->sources[i].file && m->sources[i].kind == GRID_POINTS && k < m->nfiles; k++)
			if (m->files[k].check == m->sources[i].file) {
				c->in[i] = (uint32_t)k + 1;
				count[k]++;
			}
	/* One of whose sources some are gone is not as the manifest must say. */
	for (size_t k = 0; k < m->nfiles; k++)
		c->keep[k] = count[k] == m->files[k].n;
	for (size_t i = 0; i < m->nsources; i++)
		c->loose += m->sources[i].kind == GRID_POINTS && (!c->in[i] || !c->keep[c->in[i] - 1]);
}

/* Takes files into the new one. */
static void join_files(struct choice *c)
{
	const struct grid_manifest *m = c->m;

	for (;;) {
		size_t least = m->nfiles, kept = 0;

		for (size_t k = 0; k < m->nfiles; k++) {
			kept += c->keep[k];
			if (c->keep[k] && (least == m->nfiles || m->files[k].n < m->files[least].n))
				least = k;
		}
		if (!kept || (m->files[least].n > 2 * c->loose && kept < GRID_SOURCES_FILES))
			return;
		c->keep[least] = false;
		c->loose += m->files[least].n;
	}
}

static void note(const struct choice *c, bool made, struct grid_apart *a, struct apart *ret)
{
	const struct grid_manifest *m = c->m;

	for (size_t k = 0; k < m->nfiles; k++) {
		if (c->keep[k])
			ret->files[ret->nfiles++] = m->files[k];
		else
			memcpy(a->dropped[a->ndropped++], m->files[k].name, sizeof a->dropped[0]);
	}
	for (size_t i = 0; i < m->nsources; i++) {
		bool kept = c->in[i] && c->keep[c->in[i] - 1];

		ret->fresh[i] = made && m->sources[i].kind == GRID_POINTS && !kept;
		ret->apart[i] = kept || ret->fresh[i];
		ret->nfresh += ret->fresh[i];
	}
	ret->nfiles += made;
	a->made = made;
}

int manifest_apart_choose(const struct grid_manifest *m, struct grid_apart *a, struct apart *ret, struct err *err)
{
	struct choice c = {.m = m};
	bool made;

	*ret = (struct apart){0};
	a->made = false;
	a->ndropped = 0;
	c.in = calloc(m->nsources + 1, sizeof *c.in);
	ret->apart = calloc(m->nsources + 1, sizeof *ret->apart);
	ret->fresh = calloc(m->nsources + 1, sizeof *ret->fresh);
	if (!c.in || !ret->apart || !ret->fresh) {
		free(c.in);
		manifest_apart_done(ret);
		return err_set(err, ERR_NOMEM, "no memory for a manifest of %zu sources", m->nsources);
	}
	find_files(&c);
	made = c.loose > grid_sources_here;
	if (made)
		join_files(&c);
	note(&c, made, a, ret);
	free(c.in);
	return 0;
}

void manifest_apart_done(struct apart *a)
{
	free(a->apart);
	free(a->fresh);
	a->apart = a->fresh = NULL;
}

/* ---- writing ---- */

static int by_id(const void *a, const void *b)
{
	uint32_t x = (*(const struct grid_source *const *)a)->id, y = (*(const struct grid_source *const *)b)->id;

	return x < y ? -1 : x > y;
}

static const struct grid_source **sort_fresh(const struct grid_manifest *m, const struct apart *apart, uint64_t *ret_bytes)
{
	const struct grid_source **s = malloc((apart->nfresh + 1) * sizeof *s);
	size_t n = 0;

	*ret_bytes = SOURCES_HEAD + CHECK_BYTES;
	for (size_t i = 0; s && i < m->nsources; i++) {
		if (!apart->fresh[i])
			continue;
		s[n++] = &m->sources[i];
		*ret_bytes += manifest_source_bytes(&m->sources[i]);
	}
	if (s && n)
		qsort(s, n, sizeof *s, by_id);
	return s;
}

/* Appends the bytes that were packed, and counts them. */
static void put(struct grid_file *out, const struct packer *p, const uint8_t *bytes, XXH3_state_t *sum)
{
	XXH3_64bits_update(sum, bytes, packer_size(p));
	grid_file_commit(out, packer_size(p));
}

/* It packs source after source, so that a file of many takes no more memory than one of few. */
static int put_file(struct grid_file *out, const struct grid_source *const *s, struct grid_sources_file *f, struct err *err)
{
	XXH3_state_t sum;
	struct packer p;
	uint8_t *to;
	int rc = grid_file_reserve(out, SOURCES_HEAD, &to, err);

	if (rc)
		return rc;
	XXH3_64bits_reset(&sum);
	p = packer_of(to, SOURCES_HEAD);
	packer_bytes(&p, DISK_SOURCES_MAGIC, 8);
	packer_u32(&p, DISK_SOURCES_VERSION);
	packer_u32(&p, f->n);
	packer_u64(&p, f->bytes);
	put(out, &p, to, &sum);
	for (size_t i = 0; i < f->n; i++) {
		size_t n = manifest_source_bytes(s[i]);

		rc = grid_file_reserve(out, n, &to, err);
		if (rc)
			return rc;
		p = packer_of(to, n);
		manifest_pack_source(&p, s[i]);
		if (p.bad)
			return err_set(err, ERR_INTERNAL, "a source is larger than it can be");
		put(out, &p, to, &sum);
	}
	f->check = XXH3_64bits_digest(&sum);
	rc = grid_file_append(out, &f->check, sizeof f->check, err);
	return rc || grid_file_place(out) == f->bytes ? rc : err_set(err, ERR_INTERNAL, "a file of sources has another size");
}

int manifest_apart_write(int dirfd, const struct grid_manifest *m, struct grid_apart *a, struct apart *apart, struct err *err)
{
	const char *name = a->as ? a->as : a->name;
	struct grid_sources_file *f = &apart->files[apart->nfiles - 1];
	const struct grid_source **s;
	struct grid_file out = GRID_FILE_INIT;
	uint8_t *buffer;
	int rc;

	*f = (struct grid_sources_file){.n = (uint32_t)apart->nfresh};
	s = sort_fresh(m, apart, &f->bytes);
	if (strlen(name) >= GRID_NAME_MAX || (a->name && strlen(a->name) >= sizeof f->name) || f->bytes > MANIFEST_MOST) {
		free(s);
		return err_set(err, ERR_LIMIT, "%zu sources cannot be written as '%s'", apart->nfresh, name);
	}
	buffer = s ? malloc(BUFFER) : NULL;
	if (!buffer) {
		free(s);
		return err_set(err, ERR_NOMEM, "no memory for a file of %zu sources", apart->nfresh);
	}
	rc = grid_file_create(&out, dirfd, name, buffer, BUFFER, err);
	if (rc == 0)
		rc = put_file(&out, s, f, err);
	if (a->name)
		snprintf(f->name, sizeof f->name, "%s", a->name);
	else
		snprintf(f->name, sizeof f->name, "sources-%016llx", (unsigned long long)f->check);
	a->file = *f;
	/* The name becomes durable with that of the manifest. */
	if (rc == 0)
		rc = grid_file_publish(&out, GRID_DURABLE_DATA, err);
	grid_file_abort(&out);
	free(buffer);
	free(s);
	return rc;
}
