/* Inputs that are gzip files and zip archives: each file in them is an input of its own. */
#ifndef CTL_ARCHIVE_H
#define CTL_ARCHIVE_H

#include "ctl.h"
#include "ctl_unpack.h"

struct ctl_archive_member {
	struct ctl_unpack_member in; /* its texts are static, but for the name */
	char *path;                  /* absolute, "ARCHIVE/MEMBER"; NULL: it has none */
	const char *name;            /* in the archive */
};

struct ctl_archive {
	struct ctl_archive *next;
	struct ctl_input file; /* the archive itself, as it was when it was looked at */
	char *path;            /* absolute; NULL: it has none */
	enum ctl_unpack_kind kind;
	struct ctl_archive_member *member;
	size_t n, room;
	unsigned left_out; /* members that are no survey files */
	char first_left_out[64];
	bool hidden;    /* there are members that are hidden, of which nothing is said */
	struct err why; /* it cannot be read: the one input that stands for it is refused so */
	bool summed;    /* --manifest: */
	unsigned char sum[32];
};

/* If the file that `file` tells is an archive: its members behind in->input, or one input that tells why it cannot be read.
 * *ret_is false: it is none, or cannot be opened, and nothing was added. In a folder an archive without survey files is passed
 * over. */
int ctl_archive_add(struct program *, struct ctl_inputs *in, const struct ctl_input *file, bool from_folder, bool *ret_is,
		    struct err *err);
/* Names in folders that are taken: "a.laz.gz", "a.zip". */
bool ctl_archive_named(const char *name);
/* Unpacks a member into input->kept, once. */
int ctl_archive_keep(struct program *, struct ctl_input *, struct err *err);
/* It is not needed any more. */
void ctl_archive_drop(struct ctl_input *);
void ctl_archive_free(struct ctl_inputs *);

#endif
