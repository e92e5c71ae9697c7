/*
 * Who may do what: the one place that decides. A peer is what the kernel says of a connection (SO_PEERCRED,
 * SO_PEERGROUPS); what /proc says of a process that may be another one by now is never asked.
 *
 * Admins are root, the daemon's own user and the members of admin-group: all that anybody may do, they may. A job belongs
 * to who submitted it; a dataset has owner, group and mode as a file has, and as of a file the first of owner, group
 * and others that a peer is decides.
 */
#ifndef RIGHTS_H
#define RIGHTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;
struct ledger;

/* Who asks, as the kernel says. The groups are the connection's, borrowed: what is kept is rights_kept. */
struct peer {
	uint32_t uid, pid, gid;
	bool admin;
	uint32_t ngroups;
	const uint32_t *groups; /* sorted */
};
/* What is asked of a dataset. */
enum right {
	RIGHT_READ,  /* mesh, plan, show, log, export; to see it in a list */
	RIGHT_WRITE, /* push, revert */
	RIGHT_OWN,   /* remove, restore, pin, prune, mode and group */
	RIGHT_GIVE,  /* another owner */
};

enum { RIGHTS_NAME = 64 };
#define RIGHTS_NOBODY UINT32_MAX /* no group, as of a dataset older than groups */

/* Who is served at all. */
struct rights {
	uint32_t self;           /* the daemon's own user */
	uint32_t gid, admin_gid; /* of `group` and admin-group; RIGHTS_NOBODY: not set */
	char group[RIGHTS_NAME]; /* its name, for who is not in it */
};

/* The groups of who is at the other end of that socket into peer->groups, sorted; charged to LEDGER_MESSAGE until
 * rights_groups_free. -ERR_BUSY: no memory for so many. */
int rights_groups(int fd, struct ledger *, struct peer *, struct err *err);
void rights_groups_free(struct ledger *, struct peer *);
/* peer->admin, by these rules. */
void rights_look(const struct rights *, struct peer *);
/* -ERR_PERM: this one is not served. */
int rights_connect(const struct rights *, const struct peer *, struct err *err);

/* What outlives the connection: without the groups, with what they decided. */
struct peer rights_kept(const struct peer *);
/* Who is known by a row of the catalogue. */
struct peer rights_stored(uint32_t uid, uint32_t pid);

bool rights_admin(const struct peer *);
/* As that user: of his jobs, what he added. */
bool rights_as(const struct peer *, uint32_t uid);
bool rights_in_group(const struct peer *, uint32_t gid);

bool rights_allow(const struct peer *, enum right, uint32_t uid, uint32_t gid, uint32_t mode);

#endif
