/*
 * Permissions: the one place that decides. A peer is what the kernel reports of a connection (SO_PEERCRED, SO_PEERGROUPS). /proc
 * is never read, since the process number may belong to another process by then.
 *
 * Administrators are root, the daemon's own user, and the members of admin-group. They may do what any user may. A job belongs to
 * the user who submitted it. A dataset has owner, group and mode, as a file has; the first class of owner, group and others that
 * the peer is in decides. All functions may be called by any thread.
 */
#ifndef RIGHTS_H
#define RIGHTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;
struct ledger;

/* The user of a connection, as the kernel reports. The groups belong to the connection: keep a copy by rights_without_groups. */
struct peer {
	uint32_t uid, pid, gid;
	bool admin;
	uint32_t ngroups;
	const uint32_t *groups; /* sorted */
};
/* What may be done with a dataset. */
enum right {
	RIGHT_READ,  /* mesh, plan, show, log, export, see it in a list */
	RIGHT_WRITE, /* push, revert */
	RIGHT_OWN,   /* remove, restore, pin, prune, discard pushes of others, mode and group */
	RIGHT_CHOWN, /* give it another owner */
};

enum { RIGHTS_NAME = 64 };
#define RIGHTS_NOBODY UINT32_MAX /* no user or group; group of a dataset that is older than groups */

/* The rules of this daemon. */
struct rights {
	uint32_t self;           /* the daemon's own user */
	uint32_t gid, admin_gid; /* settings group and admin-group; RIGHTS_NOBODY: not set */
	char group[RIGHTS_NAME]; /* its name, for the refusal of others */
};

/* Reads the groups of the peer of a socket into peer->groups, sorted. They are charged to LEDGER_MESSAGE until
 * rights_groups_free. -ERR_BUSY: no memory for so many. */
int rights_groups(int fd, struct ledger *, struct peer *, struct err *err);
void rights_groups_free(struct ledger *, struct peer *);
/* Sets peer->admin by these rules. */
void rights_set_admin(const struct rights *, struct peer *);
/* -ERR_PERM: this peer is not served. */
int rights_connect(const struct rights *, const struct peer *, struct err *err);

/* A copy that may outlive the connection: peer->admin stays as it was decided. */
struct peer rights_without_groups(const struct peer *);
/* A user of a row of the catalogue. Administrator if root or the daemon's own user. */
struct peer rights_of_user(uint32_t uid, uint32_t pid);

bool rights_admin(const struct peer *);
/* May act as that user: with the user's jobs and grids. */
bool rights_acts_as(const struct peer *, uint32_t uid);
bool rights_in_group(const struct peer *, uint32_t gid);

bool rights_allow(const struct peer *, enum right, uint32_t uid, uint32_t gid, uint32_t mode);

#endif
