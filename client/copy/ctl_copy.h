/* A folder that files of the daemon are brought into: backups and exports. */
#ifndef CTL_COPY_H
#define CTL_COPY_H

#include "session.h"

struct ctl_copy {
	struct session *session;
	const char *dir;
	char what[96];     /* as in the mark of the folder: "state", "dataset NAME" */
	char identity[64]; /* of what is brought; "": not known */
	struct ctl_copy_place {
		uint64_t device, inode; /* 0: not known */
		const char *what;
	} place[2]; /* folders of the daemon: nothing is brought into these */
	bool flat;  /* all files in the folder itself */
	bool no_links;
	int dirfd;
	int storefd; /* of the marker of the store, until the catalogue comes; -1 */
	uint64_t store_size;
	int64_t begun_us;
	char **name; /* that came, in the order of time */
	size_t n, room;
	uint64_t files, bytes;         /* all of them */
	uint64_t new_files, new_bytes; /* not there before */
	uint64_t linked, removed;      /* of the new ones; that are of an earlier time */
	struct err err;
};

/* Makes DIR, or takes the one of an earlier time of the same kind. */
int ctl_copy_begin(struct ctl_copy *, struct err *err);
/* The callback `file` of an acut_backup_sink; ctx is the struct ctl_copy, whose err has the failure (-1). */
int ctl_copy_file(void *ctx, const struct acut_backup_file *);
/* All files came: removes those of an earlier time. */
int ctl_copy_end(struct ctl_copy *, struct err *err);
void ctl_copy_done(struct ctl_copy *);

#endif
