/*
 * Batches (grid_manifest.h): the sources of a manifest by their numbers and lives. They are all that a reader of points needs to
 * know of sources, and are in the manifest wherever the sources themselves are.
 */
#include <stdlib.h>
#include <string.h>

#include "grid_manifest_priv.h"

static bool same_lives(const struct grid_source *a, const struct grid_source *b)
{
	return a->added == b->added && a->removed == b->removed && a->nearlier == b->nearlier &&
	       (!a->nearlier || !memcmp(a->earlier, b->earlier, a->nearlier * sizeof *a->earlier));
}

/* Whether source i begins a batch. */
static bool begins(const struct grid_source *s, const bool *apart, size_t i)
{
	return !i || s[i].id != s[i - 1].id + 1 || s[i].kind != s[i - 1].kind || !s[i].id || !same_lives(&s[i], &s[i - 1]) ||
	       (apart && apart[i] != apart[i - 1]);
}

struct grid_batch *manifest_batches_of(const struct grid_source *s, size_t n, const bool *apart, size_t *ret_n)
{
	struct grid_batch *batch;
	size_t nbatches = 0;

	for (size_t i = 0; i < n; i++)
		nbatches += begins(s, apart, i);
	batch = calloc(nbatches + 1, sizeof *batch);
	if (!batch)
		return NULL;
	*ret_n = nbatches;
	nbatches = 0;
	for (size_t i = 0; i < n; i++) {
		if (begins(s, apart, i))
			batch[nbatches++] = (struct grid_batch){.first = s[i].id,
								.apart = apart && apart[i],
								.kind = s[i].kind,
								.added = s[i].added,
								.removed = s[i].removed,
								.earlier = s[i].earlier,
								.nearlier = s[i].nearlier};
		batch[nbatches - 1].n++;
	}
	return batch;
}

/* ---- reading ---- */

static const char *unpack_file(struct cursor *c, struct grid_sources_file *ret)
{
	if (!manifest_unpack_text(c, ret->name, sizeof ret->name) || !ret->name[0] || ret->name[0] == '.' ||
	    strchr(ret->name, '/'))
		return "a file of sources has no proper name";
	ret->bytes = cursor_u64(c);
	ret->n = cursor_u32(c);
	ret->check = cursor_u64(c);
	if (c->bad || !ret->n || ret->bytes > MANIFEST_MOST || ret->bytes < SOURCES_HEAD + CHECK_BYTES ||
	    ret->n > (ret->bytes - SOURCES_HEAD - CHECK_BYTES) / SOURCE_LAST)
		return "a file of sources has an impossible size";
	return NULL;
}

const char *manifest_unpack_batches(struct cursor *c, struct grid_manifest *m, const struct limits *limits)
{
	uint64_t in_files = 0, apart = 0, here = 0;

	for (size_t i = 0; i < m->nfiles; i++) {
		const char *fault = unpack_file(c, &m->files[i]);

		for (size_t k = 0; !fault && k < i; k++)
			if (!strcmp(m->files[k].name, m->files[i].name) || m->files[k].check == m->files[i].check)
				fault = "a file of sources is named twice";
		if (fault)
			return fault;
		in_files += m->files[i].n;
	}
	for (size_t i = 0; i < m->nbatches; i++) {
		struct grid_batch *b = &m->batches[i];
		uint8_t where;

		b->first = cursor_u32(c);
		b->n = cursor_u32(c);
		where = cursor_u8(c);
		b->apart = where;
		b->added = cursor_u64(c);
		b->removed = cursor_u64(c);
		if (!manifest_unpack_spans(c, m, limits->spans, &b->earlier, &b->nearlier) || where > 1)
			return "a batch of sources in it is malformed";
		*(b->apart ? &apart : &here) += b->n;
	}
	m->nall = apart + here;
	return here != m->nsources || apart != in_files ? "its batches are not its sources" : NULL;
}

const char *manifest_take_lives(struct grid_manifest *m)
{
	size_t at = 0;

	for (size_t i = 0; i < m->nbatches; i++) {
		struct grid_batch *b = &m->batches[i];

		for (uint32_t k = 0; !b->apart && k < b->n; k++, at++) {
			struct grid_source *s = &m->sources[at];

			b->kind = k ? b->kind : s->kind;
			if (s->id != b->first + k || s->kind != b->kind)
				return "a source is not in its batch";
			s->added = b->added;
			s->removed = b->removed;
			s->earlier = b->earlier;
			s->nearlier = b->nearlier;
		}
	}
	return NULL;
}

/* ---- by number ---- */

static int by_first(const void *a, const void *b)
{
	uint32_t x = ((const struct grid_batch *)a)->first, y = ((const struct grid_batch *)b)->first;

	return x < y ? -1 : x > y;
}

uint64_t grid_manifest_all(const struct grid_manifest *m)
{
	return m->batches ? m->nall : m->nsources;
}

struct grid_batch *grid_batches_sorted(const struct grid_manifest *m, size_t *ret_n)
{
	struct grid_batch *b;

	if (!m->batches) {
		b = manifest_batches_of(m->sources, m->nsources, NULL, ret_n);
	} else {
		b = malloc((m->nbatches + 1) * sizeof *b);
		*ret_n = m->nbatches;
		if (b && *ret_n)
			memcpy(b, m->batches, m->nbatches * sizeof *b);
	}
	if (b && *ret_n)
		qsort(b, *ret_n, sizeof *b, by_first);
	return b;
}

const struct grid_batch *grid_batches_find(const struct grid_batch *b, size_t n, uint32_t source)
{
	size_t lo = 0, hi = n;

	while (lo < hi) {
		size_t mid = lo + (hi - lo) / 2;

		if (b[mid].first <= source)
			lo = mid + 1;
		else
			hi = mid;
	}
	return lo && source - b[lo - 1].first < b[lo - 1].n ? &b[lo - 1] : NULL;
}

const char *manifest_batches_fault(const struct grid_manifest *m, bool *ret_nomem)
{
	size_t n = 0;
	struct grid_batch *b = grid_batches_sorted(m, &n);
	const char *fault = NULL;

	*ret_nomem = !b;
	for (size_t i = 0; b && !fault && i < n; i++) {
		const struct grid_source lives = {.id = b[i].first,
						  .added = b[i].added,
						  .removed = b[i].removed,
						  .earlier = b[i].earlier,
						  .nearlier = b[i].nearlier};

		fault = manifest_source_fault(m, &lives);
		if (!b[i].n || b[i].n - 1 > UINT32_MAX - b[i].first)
			fault = "a batch of sources has numbers that it cannot have";
		if (!fault && i && b[i - 1].first + (b[i - 1].n - 1) >= b[i].first)
			fault = "two sources have the same number";
	}
	free(b);
	return fault;
}
