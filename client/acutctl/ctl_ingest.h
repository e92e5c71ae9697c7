/*
 * What the two halves of acutctl ingest share: looking and pushing (ctl_ingest.c), moving (ctl_ingest_move.c).
 */
#ifndef CTL_INGEST_H
#define CTL_INGEST_H

#include <limits.h>

#include "ctl.h"

/* A drop folder: opened once, and everything in it reached through this descriptor. */
struct ctl_drop {
	const char *name; /* as the user said it */
	char *path;       /* absolute */
	int fd, done, failed;
};

struct ctl_drop_name {
	char text[NAME_MAX + 16]; /* "done/NAME", below the folder */
};

/* Makes done/ and failed/ where they are not there, and sees to it that files can be moved into them. */
int ctl_drop_open(struct ctl_drop *, const char *name, struct err *err);
void ctl_drop_close(struct ctl_drop *);
/* Moves what was pushed, if it is still what was pushed, under a name that nothing has yet. -ERR_CHANGED: it is not, and stays. */
int ctl_drop_done(const struct ctl_drop *, const struct ctl_input *, struct ctl_drop_name *ret, struct err *err);
/* Likewise what was refused; NAME.error beside it says why. */
int ctl_drop_failed(const struct ctl_drop *, const struct ctl_input *, const char *dataset, const struct err *why,
		    struct ctl_drop_name *ret, struct err *err);

#endif
