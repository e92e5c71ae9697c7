/* How many datasets one user may have (user-datasets). No limit holds for admins. */
#include "dataset_priv.h"

unsigned dataset_owned(const struct datasets *ds, uint32_t uid, unsigned *ret_removed)
{
	unsigned n = 0, removed = 0;

	for (const struct dataset *d = ds->first; d && !d->onestep; d = d->next)
		if (d->uid == uid) {
			n++;
			removed += d->removed_us != 0;
		}
	*ret_removed = removed;
	return n;
}

int dataset_limit(struct datasets *ds, const struct peer *peer, struct err *err)
{
	unsigned removed, own;

	THREAD_LOOP_ONLY();
	if (!ds->core->p.user.datasets || rights_admin(peer))
		return 0;
	own = dataset_owned(ds, peer->uid, &removed);
	if (own < ds->core->p.user.datasets)
		return 0;
	if (removed)
		err_set(err, ERR_LIMIT,
			"this user has %u datasets, %u of them removed but not gone yet, and %u are all that one user may "
			"have (user-datasets)",
			own, removed, ds->core->p.user.datasets);
	else
		err_set(err, ERR_LIMIT, "this user has %u datasets, and %u are all that one user may have (user-datasets)", own,
			ds->core->p.user.datasets);
	err_add_hint(
		err,
		"push into one that is there, remove some (they count until keep-removed is over), or ask an administrator for more");
	return err_add_place(err, ERR_NO_OFFSET, "user-datasets");
}
