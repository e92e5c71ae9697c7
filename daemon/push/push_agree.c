/*
 * How the files of a push, and its dataset, get one coordinate system, plane and lattice: what the room agree needs of a push.
 */
#include <string.h>

#include "push_priv.h"

/* ---- its files ---- */

static struct agree_input *input_at(void *ctx, size_t i)
{
	struct push_probed *probe = &((struct push *)ctx)->probes[i];

	return probe->excluded ? NULL : &probe->in;
}

/* Each excluded file gets its error as the answer to its File. */
static int exclude(void *ctx, size_t i, const struct err *why)
{
	struct push *p = ctx;

	return atomic_load(&p->cancel) ? -ERR_CANCELLED : push_exclude(&p->probes[i], why);
}

static const struct crs_info *keep(void *ctx, const struct crs_info *crs)
{
	return push_keep_crs(ctx, crs);
}

struct agree_inputs push_inputs(struct push *p)
{
	return (struct agree_inputs){.n = p->nprobes, .at = input_at, .exclude = exclude, .keep = keep, .ctx = p};
}

/* ---- its dataset ---- */

int push_heights(const struct push *p, struct err *err)
{
	const char *base = p->base->geoid;

	if (agree_geoid_same(base, p->agree.geoid_text))
		return 0;
	if (*base)
		err_set(err, ERR_USAGE, "the heights of the dataset %s are %s, those of this push %s", p->dataset->name, base,
			*p->agree.geoid_text ? p->agree.geoid_text : "as the files have them");
	else
		err_set(err, ERR_USAGE, "the heights of the dataset %s are as its files had them, not shifted by a geoid",
			p->dataset->name);
	return err_add_hint(err, "push with the geoid of the dataset, or into a dataset of its own");
}

int push_agree_begin(struct push *p, struct err *err)
{
	struct geoids_found found;
	int r = agree_plane_words(&p->agree, err);

	if (!r && *p->agree.geoid)
		r = geoids_find(p->pushes->geoids, p->agree.geoid, &found, err);
	if (!r && *p->agree.geoid)
		r = agree_geoid_found(&p->agree, found.path, found.hash, err);
	return !r && p->base ? push_heights(p, err) : r;
}

/* ---- WKT: of the first source that carries one, kept with the coordinate system of the inputs (push_table.c) ---- */

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
		found = agree_wkt_part(&p->agree, p->adopt->wkt);
	for (size_t i = 0; !found && !p->aborted && i < p->ncrs; i++)
		if (p->crs_seen[i]->wkt)
			found = agree_wkt_part(&p->agree, p->crs_seen[i]->wkt);
	m->wkt = found;
	return found;
}
