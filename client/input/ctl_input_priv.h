/* Shared by the files of this room only. */
#ifndef CTL_INPUT_PRIV_H
#define CTL_INPUT_PRIV_H

#include "ctl_input.h"
#include "ctl_unpack.h"

struct ctl_archive_member {
	struct ctl_unpack_member in; /* its texts are static, but for the name */
	char *path;                  /* absolute, "ARCHIVE/MEMBER"; NULL: it has none */
	const char *name;            /* in the archive */
};

struct ctl_archive {
	struct ctl_archive *next;
	struct ctl_input file; /* the archive itself, as it was seen */
	char *path;            /* absolute; NULL: it has none */
	enum ctl_unpack_kind kind;
	struct ctl_archive_member *member;
	size_t n, room;
	unsigned left_out; /* members that are no survey files */
	char first_left_out[64];
	bool hidden;    /* there are hidden members, which are passed over */
	struct err why; /* it cannot be read: the one input that stands for it is refused with this error */
	bool summed;    /* --manifest: */
	unsigned char sum[32];
};

/* Adds the members of an archive, or one input that is refused with why it cannot be read. *ret_is false: `file` is no archive,
 * or cannot be opened, and nothing was added. */
int ctl_archive_add(struct ctl_inputs *, const struct ctl_input *file, bool from_folder, bool *ret_is, struct err *err);
/* Names that are taken from folders: "a.laz.gz", "a.zip". */
bool ctl_archive_named(const char *name);
/* Unpacks a member into input->kept, once. */
int ctl_archive_keep(struct ctl_inputs *, struct ctl_input *, struct err *err);
void ctl_archive_free(struct ctl_inputs *);

int ctl_input_append(struct ctl_inputs *, const struct ctl_input *, const char *name, struct err *err);
/* Writes a file of lines into input->kept, once (ctl_input_lines.c). */
int ctl_lines_keep(struct ctl_inputs *, struct ctl_input *, struct err *err);

/* By its extension. */
bool ctl_input_is_survey(const char *name, size_t n);
/* ".las, .laz or .xyz": what folders are searched for. Returns buf. */
char *ctl_input_endings(char *buf, size_t size);

/* A file without a name. *ret_folder: where it is, for messages. */
int ctl_temp_open(const char **ret_folder, int *ret_fd, struct err *err);

/* Every input against opt->manifest; the error names the first that does not agree, its hint the others. */
int ctl_manifest_check(struct ctl_inputs *, struct err *err);

/* Reads the first bytes of a pipe, to recognise its format; the copy begins with them. */
int ctl_pipe_peek(struct ctl_inputs *, struct ctl_input *, struct err *err);
/* Asks the daemon, which is connected to if need be, about a file that begins so: -ERR_INPUT if it cannot be read. */
int ctl_pipe_check(struct ctl_inputs *, const struct ctl_input *, struct err *err);
void ctl_pipe_stop(struct ctl_input *);

#endif
