/*
 * Inputs: what the words of a command line name. A file, a folder (its survey files), an archive (those in it), a list of names,
 * or a pipe; each is opened when it is its turn.
 */
#ifndef CTL_INPUT_H
#define CTL_INPUT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/stat.h>

#include "lines_export.h"
#include "session.h"

struct ctl_input_options {
	const char *name, *format, *columns, *manifest; /* NULL: not given */
	bool decimal_comma, accept_truncated;
	const char *layer, *kind_field; /* of files of lines */
};

struct ctl_input {
	char *name;
	int fd;         /* -1: opened when it is its turn; else the reading end of a pipe */
	int kept;       /* a regular file with all of a pipe, or an unpacked member of an archive; 0: none */
	bool anonymous; /* standard input without --name */
	bool refused;
	bool verified; /* by --manifest, as this file: */
	dev_t dev;
	ino_t ino;
	off_t size;
	struct timespec mtime, ctime;
	const char *entry; /* NULL, or its name in dirfd: opened there, and only as the file that was seen */
	int dirfd;
	const char *path; /* NULL, or its absolute path, where `name` is another */
	int copier;       /* the process that empties the pipe; 0: none */
	uint8_t *head;    /* of a pipe: its first bytes, which are read already; at least 4, unless it has fewer */
	unsigned nhead;
	const char *label;                        /* NULL, or its name in the dataset, by --name */
	const struct lines_export_options *lines; /* NULL, or a file of lines, and what they are; it is kept as a text */
	struct lines_exported exported;           /* what was in it */
	struct ctl_archive *archive;              /* NULL, or the archive whose member it is, by number */
	size_t member;
};

struct ctl_inputs {
	struct session *session;
	const struct ctl_input_options *opt;
	const char *format; /* as --input-format, or as a pipe's first bytes show; NULL: each by its content */
	struct ctl_input *input;
	size_t n, room;
	const struct lines_export_options *lines; /* NULL, or all words are files of lines */
	const char *no_pipes;                     /* why no pipe is taken; NULL: they are, and are waited for */
	bool each;          /* the caller prints what became of each: that all were refused is no failure of its own */
	const double *crop; /* NULL, or the box (x1, y1, x2, y2) outside of which no point is asked for */
	struct ctl_archive *archives;
};

struct ctl_inputs ctl_inputs_of(struct session *, const struct ctl_input_options *);
/* Files, folders (their survey files, sorted), lists (@FILE), "-"; checked against --manifest. *ret is empty on failure. */
int ctl_inputs_gather(struct ctl_inputs *ret, char **word, unsigned nword, struct err *err);
/* A file of lines. `options` is borrowed. */
int ctl_inputs_add_lines(struct ctl_inputs *, const char *name, const struct lines_export_options *options, struct err *err);
/* A copy of `file`, or if it is an archive its members. In a folder an archive without survey files is passed over. */
int ctl_inputs_add(struct ctl_inputs *, const struct ctl_input *file, bool from_folder, struct err *err);
void ctl_inputs_done(struct ctl_inputs *);
/* -ERR_USAGE if one of the outputs, which a NULL ends, is one of the inputs. */
int ctl_inputs_not_outputs(const struct ctl_inputs *, const char *const *output, struct err *err);

/* *ret_fd is the caller's; -1 of a pipe. A member of an archive is unpacked, and stays so until it is dropped. */
int ctl_input_open(struct ctl_inputs *, struct ctl_input *, int *ret_fd, struct err *err);
void ctl_input_drop(struct ctl_input *);
/* Opens a file that is named, without waiting for anything. */
int ctl_input_open_file(const char *name, int *ret_fd, struct err *err);
/* Its absolute path, links as they are; NULL if it has none. */
const char *ctl_input_path(const struct ctl_input *, char *buf, size_t size);

/* Records what a file is; whether it is the same file with the same bytes; whether nothing else of it has changed either. */
void ctl_input_see(struct ctl_input *, const struct stat *);
bool ctl_input_same(const struct ctl_input *, const struct stat *);
bool ctl_input_unchanged(const struct ctl_input *, const struct stat *);

/* ---- pipes ---- */

/* Lets the daemon make a pipe and starts a process that copies into it. Prints its failure; exit status. */
int ctl_input_start_pipe(struct ctl_inputs *, struct ctl_input *, struct acut_push *);
/* After the input was staged: whether all of it was copied. */
int ctl_input_finish_pipe(struct ctl_input *, struct err *err);
/* All of it into a file without a name. */
int ctl_input_keep_pipe(struct ctl_inputs *, const struct ctl_input *, int *ret_fd, struct err *err);

/* ---- formats ---- */

/* Formats that the daemon of this version reads, and archives that are unpacked here; a row without a name ends each. */
extern const struct ctl_input_format {
	const char *name, *extensions, *help; /* extensions: ".las .laz" */
	const char *folders;                  /* those of them that folders and archives are searched for */
} ctl_input_formats[], ctl_input_archives[];
/* The format that a word names, by its name or an extension ("laz"); NULL: none. */
const struct ctl_input_format *ctl_input_format_of(const char *word);

#endif
