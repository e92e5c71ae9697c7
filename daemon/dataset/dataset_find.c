/* Datasets by name: search, lists, and information about one. */
#include <string.h>

#include "dataset_priv.h"

int dataset_name_check(const char *name, struct err *err)
{
	if (dataset_name_valid(name))
		return 0;
	err_set(err, ERR_USAGE, "\"%.80s\" cannot name a dataset", name);
	return err_add_hint(err, "use up to %d letters, digits, '_', '-' and '.', not starting with '.' or '-'",
			    DATASET_NAME_MAX);
}

bool dataset_name_valid(const char *name)
{
	static const char more[] = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_.-";
	size_t n = strlen(name);

	return n && n <= DATASET_NAME_MAX && strspn(name, more) == n && *name != '.' && *name != '-';
}

struct dataset *dataset_find(struct datasets *ds, const char *name, const struct peer *peer)
{
	struct dataset *d;

	THREAD_LOOP_ONLY();
	for (d = ds->first; d; d = d->next)
		if (!d->removed_us && !strcmp(d->name, name))
			return !d->onestep || rights_acts_as(peer, d->uid) ? d : NULL;
	return NULL;
}

static bool is_listed(const struct dataset *d, const struct peer *peer)
{
	return !d->onestep && !d->removed_us && (d->generation || d->pending || dataset_created(d)) &&
	       rights_allow(peer, RIGHT_READ, d->uid, d->gid, d->mode);
}

unsigned dataset_list(const struct datasets *ds, const char *name, const struct peer *peer, unsigned max, struct dataset **ret)
{
	struct dataset *d;
	unsigned n = 0;

	THREAD_LOOP_ONLY();
	/* The page is sorted by insertion. It usually fills soon, and most of the others sort behind its last entry. */
	for (d = ds->first; d && max; d = d->next) {
		unsigned i;

		if (strcmp(d->name, name) <= 0 || (n == max && strcmp(d->name, ret[n - 1]->name) > 0) || !is_listed(d, peer))
			continue;
		n += n < max;
		for (i = n - 1; i && strcmp(d->name, ret[i - 1]->name) < 0; i--)
			ret[i] = ret[i - 1];
		ret[i] = d;
	}
	return n;
}

void dataset_info(const struct dataset *d, struct dataset_info *ret)
{
	const struct pending *q;

	*ret = (struct dataset_info){
		.name = d->name,
		.id = d->id,
		.generation = d->generation,
		.points = d->points,
		.bytes = d->bytes,
		.files = d->files,
		.uid = d->uid,
		.gid = d->gid,
		.mode = d->mode,
		.lattice = d->lattice,
		.crs = d->crs,
		.unit_xy = d->unit_xy,
		.unit_z = d->unit_z,
		.created_us = d->created_us,
		.pushed_us = d->pushed_us,
		.pushes = d->pushes,
		.oldest = d->oldest,
		.segments = d->segments,
		.merging = merge_at_work(d),
		.removed_us = d->removed_us,
		.until_us = dataset_until_us(d),
		.pinned = d->pinned,
	};
	memcpy(ret->box, d->box, sizeof ret->box);
	for (q = d->pending; q; q = q->next) {
		ret->pending++;
		ret->pending_files += q->files;
		ret->pending_points += q->points;
		ret->pending_until_us = pending_until_us(q);
	}
	if (d->pending)
		ret->pending_uid = d->pending->uid;
}

struct dataset *dataset_removed_after(struct datasets *ds, uint64_t id, const struct peer *peer)
{
	struct dataset *d, *best = NULL;

	if (!id)
		datasets_expire(ds);
	for (d = ds->first; d; d = d->next)
		if (dataset_restorable(d, peer) && d->id > id && (!best || d->id < best->id))
			best = d;
	return best;
}

int dataset_not_found(const char *name, bool removed, struct err *err)
{
	err_set(err, ERR_NOTFOUND, "there is no %sdataset \"%.100s\"", removed ? "removed " : "", name);
	return err_add_hint(err,
			    removed ? "acutctl datasets --removed lists what can be restored" : "acutctl datasets lists them");
}

bool dataset_restorable(const struct dataset *d, const struct peer *peer)
{
	return d->removed_us && rights_allow(peer, RIGHT_OWN, d->uid, d->gid, d->mode);
}
