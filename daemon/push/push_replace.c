/*
 * Files of the dataset that a push replaces.
 *
 * The model: a file that is staged whole replaces the live sources of its path, or the source that the client names; a file that
 * is not staged replaces nothing. The commit removes the old sources in the generation in which it adds the new ones, so at any
 * time exactly one of them counts. Replaced sources are kept by number, because the commit may start from a newer manifest than
 * the push did.
 */
#include <stdlib.h>
#include <string.h>

#include "push_priv.h"

static int by_id(const void *a, const void *b)
{
	uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;

	return x < y ? -1 : x > y;
}

/* Worker. The live source that a path or a name refers to; with several of one path, any of them. */
int push_replace_target(struct push *p, struct push_request *rq)
{
	const struct grid_manifest *m = p->base;
	size_t paths = 0, names = 0, path = 0, name = 0;

	rq->target = 0;
	if (!*rq->replaces)
		return 0;
	for (size_t i = 0; m && i < m->nsources; i++) {
		if (m->sources[i].removed)
			continue;
		if (!strcmp(m->sources[i].path, rq->replaces)) {
			paths++;
			path = i;
		}
		if (!strcmp(m->sources[i].name, rq->replaces)) {
			names++;
			name = i;
		}
	}
	if (paths || names == 1) {
		rq->target = 1 + (paths ? path : name);
		return 0;
	}
	if (!names) {
		err_set(&rq->err, ERR_INPUT, "the dataset %s has no file %.200s that it could replace", p->dataset->name,
			rq->replaces);
		return err_add_hint(&rq->err, "acutctl dataset log %s --files lists them", p->dataset->name);
	}
	err_set(&rq->err, ERR_INPUT, "the dataset %s has %zu files %.200s", p->dataset->name, names, rq->replaces);
	return err_add_hint(&rq->err, "name one of them by its whole path: acutctl dataset log %s --files lists them",
			    p->dataset->name);
}

/* Loop: memory for the lists, before anything is promised. */
int push_replace_room(struct push *p, const struct push_request *rq, struct err *err)
{
	if ((!rq->replace && !rq->target) || p->is_replaced || !p->base)
		return 0;
	p->is_replaced = calloc(p->base->nsources + 1, sizeof *p->is_replaced);
	p->replaced = calloc(p->base->nsources + 1, sizeof *p->replaced);
	if (p->is_replaced && p->replaced)
		return 0;
	push_replace_free(p);
	return err_set(err, ERR_NOMEM, "no memory for %zu files of the dataset", p->base->nsources);
}

void push_replace_free(struct push *p)
{
	free(p->is_replaced);
	free(p->replaced);
	p->is_replaced = NULL;
	p->replaced = NULL;
	p->nreplaced = 0;
}

void push_replace_nothing(struct push *p)
{
	p->nreplaced = 0;
	if (p->is_replaced && p->base)
		memset(p->is_replaced, 0, p->base->nsources * sizeof *p->is_replaced);
}

bool push_replace_means(const struct grid_source *target, const struct grid_source *s)
{
	return s == target || (*target->path && !strcmp(s->path, target->path));
}

static void replace_source(struct push *p, size_t i, uint32_t *n)
{
	if (p->is_replaced[i])
		return;
	p->is_replaced[i] = true;
	p->replaced[p->nreplaced++] = p->base->sources[i].id;
	++*n;
}

static void replace_path(struct push *p, const char *path, uint32_t *n)
{
	size_t at = NAMES_START;
	uint32_t i;

	while (*path && names_next(&p->base_paths, path, &at, &i))
		replace_source(p, i, n);
}

/* Loop: a file of this push counts now. Returns how many of the dataset it replaces. */
uint32_t push_replace_note(struct push *p, const char *path, bool replace, size_t target)
{
	uint32_t n = 0;

	if (p->is_replaced && replace)
		replace_path(p, path, &n);
	if (p->is_replaced && target) {
		replace_source(p, target - 1, &n);
		replace_path(p, p->base->sources[target - 1].path, &n);
	}
	return n;
}

/* Worker, in the commit: `m` becomes the next manifest. */
int push_replace_apply(struct push *p, struct grid_manifest *m, struct err *err)
{
	size_t found = 0;

	if (!p->nreplaced)
		return 0;
	qsort(p->replaced, p->nreplaced, sizeof *p->replaced, by_id);
	for (size_t i = 0; i < m->nsources; i++) {
		struct grid_source *s = &m->sources[i];

		if (s->removed || !bsearch(&s->id, p->replaced, p->nreplaced, sizeof *p->replaced, by_id))
			continue;
		s->removed = m->generation;
		found++;
	}
	if (found == p->nreplaced)
		return 0;
	err_set(err, ERR_BUSY, "a file that this push replaces was meanwhile removed from the dataset %s", p->dataset->name);
	return err_add_hint(err, "push again: what is there already is then skipped");
}
