/* Profiles as commands ask for them. */
#ifndef SCAN_PROFILE_H
#define SCAN_PROFILE_H

#include "profile.h"
#include "scan.h"

/* The folders of --profiles, or the built-in ones. */
int scan_profile_set(struct program *, struct profile_set **ret, struct err *);

/* A profile and its text, on its own. */
struct scan_profile {
	struct profile profile;
	char *text;
	size_t size;
};
/* By --profile: a name of the set, or (with a slash, or ending in .conf) a file. -ERR_USAGE, -ERR_INPUT. */
int scan_profile_named(const struct profile_set *, const char *which, struct scan_profile *ret, struct err *);
int scan_profile_copy(const struct profile_entry *, struct scan_profile *ret, struct err *);
void scan_profile_done(struct scan_profile *);

#endif
