/* What a peer may do with a dataset, in words. */
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
		return err_add_hint(err, "ask whoever runs the daemon; acutctl dataset chgrp gives it another group");
	}
	if (right == RIGHT_OWN || d->onestep)
		return err_set(err, ERR_PERM, "the dataset %s belongs to the user with id %u", d->name, d->uid);
	err_set(err, ERR_PERM, "the dataset %s belongs to the user with id %u, and its mode %s does not let you %s it", d->name,
		d->uid, mode_text(d->mode, text), what[right]);
	return err_add_hint(err, "its owner can change that: acutctl dataset chmod %s+%c %s",
			    rights_in_group(peer, d->gid) ? "g" : "o", right == RIGHT_READ ? 'r' : 'w', d->name);
}
