/* Permissions on a dataset, with messages, and how many datasets one user may have (user-datasets; administrators have no
 * limit). */
#include "dataset_priv.h"
#include "mode.h"

int dataset_rights(const struct dataset *d, const struct peer *peer, enum right right, struct err *err)
{
	static const char *const what[] = {[RIGHT_READ] = "read", [RIGHT_WRITE] = "push into"};
	char text[MODE_TEXT_SIZE];

	if (rights_allow(peer, right, d->uid, d->gid, d->onestep ? 0600 : d->mode))
		return 0;
	if (right == RIGHT_CHOWN) {
		err_set(err, ERR_PERM, "only an administrator may give the dataset %s another owner", d->name);
		return err_add_hint(err, "ask an administrator of the daemon; acutctl dataset chgrp gives it another group");
	}
	if (right == RIGHT_OWN || d->onestep)
		return err_set(err, ERR_PERM, "the dataset %s belongs to the user with id %u", d->name, d->uid);
	err_set(err, ERR_PERM, "the dataset %s belongs to the user with id %u, and its mode %s does not let you %s it", d->name,
		d->uid, mode_text(d->mode, text), what[right]);
	return err_add_hint(err, "its owner can change that: acutctl dataset chmod %s+%c %s",
			    rights_in_group(peer, d->gid) ? "g" : "o", right == RIGHT_READ ? 'r' : 'w', d->name);
}

int dataset_access(struct datasets *ds, const char *name, const struct peer *peer, enum right right, struct dataset **ret,
		   struct err *err)
{
	struct dataset *d = dataset_find(ds, name, peer);
	int r = d ? dataset_rights(d, peer, right, err) : dataset_not_found(name, false, err);

	if (!r)
		*ret = d;
	return r;
}

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
	if (!ds->core->p.limits.user.datasets || rights_admin(peer))
		return 0;
	own = dataset_owned(ds, peer->uid, &removed);
	if (own < ds->core->p.limits.user.datasets)
		return 0;
	if (removed)
		err_set(err, ERR_LIMIT,
			"this user has %u datasets, %u of them removed but not deleted yet; one user may have %u "
			"(user-datasets)",
			own, removed, ds->core->p.limits.user.datasets);
	else
		err_set(err, ERR_LIMIT, "this user has %u datasets; one user may have %u (user-datasets)", own,
			ds->core->p.limits.user.datasets);
	err_add_hint(
		err,
		"push into an existing one, remove some (they count until keep-removed is over), or ask an administrator for more");
	return err_add_place(err, ERR_NO_OFFSET, "user-datasets");
}
