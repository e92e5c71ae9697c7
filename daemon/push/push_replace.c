/*
 * Files of the dataset that a push puts others in the place of.
 *
 * The model: a file that is staged whole takes the place of the live sources of its path, or of the path that the client
 * names; what is not staged replaces nothing. The commit removes them in the generation in which it adds the others, so
 * there is no time at which both or neither count. Which they are is known by the numbers of the sources, since the commit
 * may start from a newer manifest than the push began with.
 */
#include <stdlib.h>
#include <string.h>

#include "push_priv.h"

static int by_id(const void *a, const void *b)
{
	uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;

	return x < y ? -1 : x > y;
}

/* The live source that the client means by a path or a name: any of its path, where several have it. Worker. */
int push_replace_target(struct push *p, struct push_ask *a)
{
	const struct grid_manifest *m = p->base;
	size_t paths = 0, names = 0, path = 0, name = 0;

	a->target = 0;
	if (!*a->replaces)
		return 0;
	for (size_t i = 0; m && i < m->nsources; i++) {
		if (m->sources[i].removed)
			continue;
		if (!strcmp(m->sources[i].path, a->replaces)) {
			paths++;
			path = i;
		}
		if (!strcmp(m->sources[i].name, a->replaces)) {
			names++;
			name = i;
		}
	}
	if (paths || names == 1) {
		a->target = 1 + (paths ? path : name);
		return 0;
	}
	if (!names) {
		err_set(&a->err, ERR_INPUT, "the dataset %s has no file %.200s that it could replace", p->dataset->name,
			a->replaces);
		return err_add_hint(&a->err, "acutctl dataset log %s --files lists them", p->dataset->name);
	}
	err_set(&a->err, ERR_INPUT, "the dataset %s has %zu files %.200s", p->dataset->name, names, a->replaces);
	return err_add_hint(&a->err, "name one of them by its whole path: acutctl dataset log %s --files lists them",
			    p->dataset->name);
}

/* Loop: room for what may be replaced, before anything is promised. */
int push_replace_room(struct push *p, const struct push_ask *a, struct err *err)
{
	if ((!a->replace && !a->target) || p->goes || !p->base)
		return 0;
	p->goes = calloc(p->base->nsources + 1, sizeof *p->goes);
	p->gone = calloc(p->base->nsources + 1, sizeof *p->gone);
	if (p->goes && p->gone)
		return 0;
	push_replace_free(p);
	return err_set(err, ERR_NOMEM, "no memory for %zu files of the dataset", p->base->nsources);
}

void push_replace_free(struct push *p)
{
	free(p->goes);
	free(p->gone);
	p->goes = NULL;
	p->gone = NULL;
	p->ngone = 0;
}

void push_replace_nothing(struct push *p)
{
	p->ngone = 0;
	if (p->goes && p->base)
		memset(p->goes, 0, p->base->nsources * sizeof *p->goes);
}

bool push_replace_means(const struct grid_source *target, const struct grid_source *s)
{
	return s == target || (*target->path && !strcmp(s->path, target->path));
}

static void goes(struct push *p, size_t i, uint32_t *n)
{
	if (p->goes[i])
		return;
	p->goes[i] = true;
	p->gone[p->ngone++] = p->base->sources[i].id;
	++*n;
}

static void goes_all(struct push *p, const char *path, uint32_t *n)
{
	size_t at = NAMES_START;
	uint32_t i;

	while (*path && names_next(&p->base_paths, path, &at, &i))
		goes(p, i, n);
}

/* Loop: a file of this push counts now; how many of the dataset do no more. */
uint32_t push_replace_note(struct push *p, const char *path, bool replace, size_t target)
{
	uint32_t n = 0;

	if (p->goes && replace)
		goes_all(p, path, &n);
	if (p->goes && target) {
		goes(p, target - 1, &n);
		goes_all(p, p->base->sources[target - 1].path, &n);
	}
	return n;
}

/* Worker, of the commit: `m` is to be the next manifest. */
int push_replace_apply(struct push *p, struct grid_manifest *m, struct err *err)
{
	size_t found = 0;

	if (!p->ngone)
		return 0;
	qsort(p->gone, p->ngone, sizeof *p->gone, by_id);
	for (size_t i = 0; i < m->nsources; i++) {
		struct grid_source *s = &m->sources[i];

		if (s->removed || !bsearch(&s->id, p->gone, p->ngone, sizeof *p->gone, by_id))
			continue;
		s->removed = m->generation;
		found++;
	}
	if (found == p->ngone)
		return 0;
	err_set(err, ERR_BUSY, "a file that this push replaces was meanwhile removed from the dataset %s", p->dataset->name);
	return err_add_hint(err, "push again: what is there already is then skipped");
}
