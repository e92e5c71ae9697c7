/*
 * The WKT of a dataset: of the first source that carries one which says what the dataset is in (crs_wkt_holds). It is kept with
 * the coordinate system of the inputs (push_table.c). One that a person gave counts for inputs without.
 */
#include <stdlib.h>
#include <string.h>

#include "push_priv.h"

int push_wkt_take(const struct push *p, struct push_request *rq, const struct input *in)
{
	const char *own = p->overrides && agree_known(p->assume.text) ? "" : input_wkt(in);
	const char *wkt = !*own && p->assume_wkt ? p->assume_wkt : own;

	free(rq->wkt);
	rq->wkt = *wkt ? strdup(wkt) : NULL;
	return *wkt && !rq->wkt ? err_set(&rq->err, ERR_NOMEM, "no memory for a coordinate system") : 0;
}

int push_wkt_given(struct push *p, const char *text, struct err *err)
{
	char *normal = *text ? malloc(CRS_WKT_MAX + 1) : NULL;
	size_t n = normal ? crs_wkt_normal(text, strlen(text), normal) : 0;

	free(p->assume_wkt);
	p->assume_wkt = n ? strdup(normal) : NULL;
	free(normal);
	return (*text && !normal) || (n && !p->assume_wkt) ? err_set(err, ERR_NOMEM, "no memory for a coordinate system") : 0;
}

static char *part_that_holds(const struct push *p, const char *wkt)
{
	struct crs_bytes part = crs_wkt_holds(wkt, p->crs, p->unit_xy, p->unit_z);

	return part.size ? strndup(part.at, part.size) : NULL;
}

char *push_wkt_put(const struct push *p, struct grid_manifest *m)
{
	char *found = NULL;

	m->wkt_since = m->generation;
	if (p->base && p->base->wkt && *p->base->wkt) {
		m->wkt = p->base->wkt;
		m->wkt_since = p->base->wkt_since;
		return NULL;
	}
	/* Of the files of an interrupted push: whose it is is not known, so a commit needs all of them. Then of the new ones. */
	if (p->adopt && (!m->generation || p->nadopt_named == p->adopt->nsources) && p->adopt->wkt && *p->adopt->wkt)
		found = part_that_holds(p, p->adopt->wkt);
	for (size_t i = 0; !found && !p->aborted && i < p->ncrs; i++)
		if (p->crs_seen[i]->wkt)
			found = part_that_holds(p, p->crs_seen[i]->wkt);
	m->wkt = found;
	return found;
}
