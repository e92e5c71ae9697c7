/*
 * Permissions.
 *
 * The model: a peer is examined when it connects, and again when the rules change. Decisions follow from the peer and from owner,
 * group and mode of the object. What is decided at a request holds until it is done, even if its connection is closed.
 */
#include "rights.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "err.h"
#include "ledger.h"

/* ---- peers ---- */

static int compare_groups(const void *a, const void *b)
{
	uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;

	return x < y ? -1 : x > y;
}

int rights_groups(int fd, struct ledger *ledger, struct peer *peer, struct err *err)
{
	_Static_assert(sizeof(gid_t) == sizeof(uint32_t), "groups are kept as the kernel gives them");
	uint32_t few[64], *all = few;
	socklen_t size = sizeof few;
	int r = getsockopt(fd, SOL_SOCKET, SO_PEERGROUPS, few, &size);

	peer->groups = NULL;
	peer->ngroups = 0;
	/* ENODATA: no process made the socket. */
	if (r != 0 && errno != ERANGE)
		return errno == ENODATA ? 0 : err_sys(err, errno, "the client's groups cannot be read");
	if (!size)
		return 0;
	if (!ledger_take(ledger, LEDGER_MESSAGE, size))
		return err_set(err, ERR_BUSY, "there is no memory left for the %zu groups of a client", size / sizeof *all);
	all = malloc(size);
	if (!all) {
		ledger_give(ledger, LEDGER_MESSAGE, size);
		return err_set(err, ERR_NOMEM, "no memory for the groups of a client");
	}
	/* The groups of a connection do not change, so the second answer has the size that the first one reported. */
	if (r == 0) {
		memcpy(all, few, size);
	} else if (getsockopt(fd, SOL_SOCKET, SO_PEERGROUPS, all, &size) != 0) {
		r = err_sys(err, errno, "the client's groups cannot be read");
		ledger_give(ledger, LEDGER_MESSAGE, size);
		free(all);
		return r;
	}
	peer->groups = all;
	peer->ngroups = size / sizeof *all;
	qsort(all, peer->ngroups, sizeof *all, compare_groups);
	return 0;
}

void rights_groups_free(struct ledger *ledger, struct peer *peer)
{
	if (!peer->groups)
		return;
	ledger_give(ledger, LEDGER_MESSAGE, peer->ngroups * sizeof *peer->groups);
	free((void *)peer->groups);
	peer->groups = NULL;
	peer->ngroups = 0;
}

bool rights_in_group(const struct peer *peer, uint32_t gid)
{
	if (gid == RIGHTS_NOBODY)
		return false;
	return peer->gid == gid ||
	       (peer->ngroups && bsearch(&gid, peer->groups, peer->ngroups, sizeof *peer->groups, compare_groups));
}

void rights_set_admin(const struct rights *rules, struct peer *peer)
{
	peer->admin = !peer->uid || peer->uid == rules->self || rights_in_group(peer, rules->admin_gid);
}

int rights_connect(const struct rights *rules, const struct peer *peer, struct err *err)
{
	if (rights_admin(peer) || rules->gid == RIGHTS_NOBODY || rights_in_group(peer, rules->gid))
		return 0;
	err_set(err, ERR_PERM, "this acutd serves members of the group %s only", rules->group);
	return err_add_hint(err, "ask an administrator to add you to it (usermod -aG %s NAME), and log in again", rules->group);
}

struct peer rights_without_groups(const struct peer *peer)
{
	struct peer kept = *peer;

	kept.groups = NULL;
	kept.ngroups = 0;
	return kept;
}

struct peer rights_of_user(uint32_t uid, uint32_t pid)
{
	return (struct peer){.uid = uid, .pid = pid, .gid = RIGHTS_NOBODY, .admin = !uid || uid == geteuid()};
}

bool rights_admin(const struct peer *peer)
{
	return peer->admin || !peer->uid;
}

bool rights_acts_as(const struct peer *peer, uint32_t uid)
{
	return rights_admin(peer) || peer->uid == uid;
}

/* ---- datasets ---- */

bool rights_allow(const struct peer *peer, enum right right, uint32_t uid, uint32_t gid, uint32_t mode)
{
	uint32_t bit = right == RIGHT_READ ? 4 : 2;

	if (rights_admin(peer))
		return true;
	if (right == RIGHT_OWN || right == RIGHT_CHOWN)
		return right == RIGHT_OWN && peer->uid == uid;
	if (peer->uid == uid)
		return mode & bit << 6;
	return mode & (rights_in_group(peer, gid) ? bit << 3 : bit);
}
