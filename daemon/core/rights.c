/*
 * Who may do what.
 *
 * The model: a connection's peer is looked at once, when it comes, and again when the rules change. All questions are
 * answered from that and from the owner, group and mode of what is asked for; what was decided when something was asked
 * holds until it is done, also when its connection has gone.
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

static int by_number(const void *a, const void *b)
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
	/* ENODATA: the socket was never that of a process. */
	if (r != 0 && errno != ERANGE)
		return errno == ENODATA ? 0 : err_sys(err, errno, "the client's groups cannot be found out");
	if (!size)
		return 0;
	if (!ledger_take(ledger, LEDGER_MESSAGE, size))
		return err_set(err, ERR_BUSY, "there is no memory left for the %zu groups of a client", size / sizeof *all);
	all = malloc(size);
	if (!all) {
		ledger_give(ledger, LEDGER_MESSAGE, size);
		return err_set(err, ERR_NOMEM, "no memory for the groups of a client");
	}
	/* Those of a connection do not change: the second answer is as long as the first said. */
	if (r == 0) {
		memcpy(all, few, size);
	} else if (getsockopt(fd, SOL_SOCKET, SO_PEERGROUPS, all, &size) != 0) {
		r = err_sys(err, errno, "the client's groups cannot be found out");
		ledger_give(ledger, LEDGER_MESSAGE, size);
		free(all);
		return r;
	}
	peer->groups = all;
	peer->ngroups = size / sizeof *all;
	qsort(all, peer->ngroups, sizeof *all, by_number);
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
	return peer->gid == gid || (peer->ngroups && bsearch(&gid, peer->groups, peer->ngroups, sizeof *peer->groups, by_number));
}

void rights_look(const struct rights *rules, struct peer *peer)
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

struct peer rights_kept(const struct peer *peer)
{
	struct peer kept = *peer;

	kept.groups = NULL;
	kept.ngroups = 0;
	return kept;
}

struct peer rights_stored(uint32_t uid, uint32_t pid)
{
	return (struct peer){.uid = uid, .pid = pid, .gid = RIGHTS_NOBODY, .admin = !uid || uid == geteuid()};
}

bool rights_admin(const struct peer *peer)
{
	return peer->admin || !peer->uid;
}

bool rights_as(const struct peer *peer, uint32_t uid)
{
	return rights_admin(peer) || peer->uid == uid;
}

/* ---- what is owned ---- */

bool rights_allow(const struct peer *peer, enum right right, uint32_t uid, uint32_t gid, uint32_t mode)
{
	uint32_t bit = right == RIGHT_READ ? 4 : 2;

	if (rights_admin(peer))
		return true;
	if (right == RIGHT_OWN || right == RIGHT_GIVE)
		return right == RIGHT_OWN && peer->uid == uid;
	if (peer->uid == uid)
		return mode & bit << 6;
	return mode & (rights_in_group(peer, gid) ? bit << 3 : bit);
}
