/*
 * An output file: complete, or not there. It gets its name when it is published.
 */
#ifndef OUTFILE_H
#define OUTFILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct err;
struct outfile;

/* Takes the place of `path` when published. Regular files are written under a temporary name beside it;
 * standard output ("-"), pipes and devices are written as they are. */
int outfile_new(const char *path, bool no_clobber, struct outfile **ret, struct err *err);
/* A nameless file on the same file system (for standard output, and NULL: in $TMPDIR, else /var/tmp). */
int outfile_spool(const struct outfile *, struct outfile **ret, struct err *err);
/* A second place to append, for bytes that come after the whole output but are written meanwhile. */
int outfile_annex(struct outfile *, struct outfile **ret, struct err *err);
/* Of one that is not joined, and not used any more: what it has in the output's file is gone. */
int outfile_annex_drop(struct outfile *annex, struct err *err);
/* Room for n bytes at the end of the buffer (n <= OUTFILE_BUFFER - OUTFILE_BUFFER_KEPT), NULL on failure; outfile_used tells
 * how many were used. OUTFILE_BUFFER_BEHIND bytes after them may be overwritten, too. */
void *outfile_room(struct outfile *, size_t n, struct err *err);
void outfile_used(struct outfile *, size_t n);
/* Bytes that are free in the buffer: no more than these are taken without writing it. */
size_t outfile_left(const struct outfile *);
int outfile_write(struct outfile *, const void *bytes, size_t n, struct err *err);
/* Overwrite bytes written before, or put bytes behind the end, with a hole before them; only if the output can seek. */
int outfile_patch(struct outfile *, uint64_t at, const void *bytes, size_t n, struct err *err);
/* Appends all of a spool or annex. Of an annex larger than OUTFILE_BUFFER to an output that can seek, up to 4095
 * records of `record` bytes (an odd number; -ERR_INTERNAL: it is not) come from its end to its front, so that nothing need be
 * copied. With 0 the annex is copied in its order, unless the output was filled up: for records of several sizes, as lines
 * of text. */
int outfile_join(struct outfile *, struct outfile *from, size_t record, struct err *err);
/* For formats that can have bytes without a meaning before an annex: an output of `size` bytes is filled up to this size, at
 * which nothing of the annex need be copied or moved when it is joined. */
uint64_t outfile_padded(uint64_t size, const struct outfile *annex);
int outfile_pad(struct outfile *, const struct outfile *annex, uint8_t byte, struct err *err);
/* Reads back from a spool: n bytes at `at`. */
int outfile_read(struct outfile *, uint64_t at, void *bytes, size_t n, struct err *err);
bool outfile_seekable(const struct outfile *);
uint64_t outfile_size(const struct outfile *);
const char *outfile_name(const struct outfile *); /* as it was given, for messages */
const char *outfile_base(const struct outfile *); /* in its folder; NULL: it is in none */
/* Flush, fsync, rename, fsync of the folder. */
int outfile_publish(struct outfile *, struct err *err);
/* Removes what was not published. */
struct outfile *outfile_free(struct outfile *);

#define OUTFILE_BUFFER (1u << 20)
#define OUTFILE_BUFFER_KEPT 4096 /* what may stay in it when it was written */
#define OUTFILE_BUFFER_BEHIND 16
#define OUTFILE_ANNEX_AT (1ull << 37) /* an output with an annex stays below this size until they are joined */

/* ---- an output that is kept while it is written, in NAME.part, so that a later run goes on with it ---- */

/* A part of a kept file from offset `from` on, and its hashes. */
struct outfile_sum {
	uint64_t from, size, chain, part;
};
bool outfile_part_can(const struct outfile *);
/* A new output becomes a kept one: with `on` it continues the file of an earlier one, and outfile_part_go_on comes next; else
 * that file is replaced. -ERR_BUSY: another process has it. */
int outfile_part_begin(struct outfile *, bool on, struct err *err);
/* -ERR_CORRUPT: the file has something else. `annex` is checked when the annex is opened. */
int outfile_part_go_on(struct outfile *, const struct outfile_sum *, const struct outfile_sum *annex, struct err *err);
/* Bytes up to here may be patched later: they are not compared when a kept output is continued. */
int outfile_part_from_here(struct outfile *, struct err *err);
uint64_t outfile_part_size(const struct outfile *); /* with its annex */
/* The sums of it and of its annex, as far as they were flushed. */
void outfile_part_sums(const struct outfile *, struct outfile_sum *ret, struct outfile_sum *ret_annex);
int outfile_part_sync(struct outfile *, struct err *err); /* flushed and durable, its annex too */
void outfile_part_discard(const struct outfile *);        /* removes it, if it was begun and nothing refers to it */
void outfile_part_clean(const struct outfile *);          /* removes what is beside NAME.part */
/* The caller's state of it, in NAME.part.state. Read (*ret to be freed; -ERR_GONE: there is none); replaced as a whole, and
 * durable. */
int outfile_part_load(const struct outfile *, uint8_t **ret, size_t *ret_size, struct err *err);
int outfile_part_store(const struct outfile *, const uint8_t *bytes, size_t size, struct err *err);
int outfile_part_damaged(const struct outfile *, struct err *err);     /* -ERR_CORRUPT, of its state */
void outfile_part_name_state(const struct outfile *, struct err *err); /* the file that the error is about */

/* ---- an output that is complete before it gets its name, which another process gives it ---- */

/* Of a new output, before anything else: it will be published as .NAME.TAG.part beside its place. */
int outfile_hold(struct outfile *, const char *tag, struct err *err);
/* What tells it from others when it has its name. */
struct outfile_held {
	uint64_t size, inode;
};
int outfile_held(const struct outfile *, struct outfile_held *ret, struct err *err); /* of one that was published */
/* Gives it the name `path`; does nothing if another process has done that. -ERR_GONE: it is neither there nor here.
 * -ERR_CORRUPT: it is there, but is another file or of another size. */
int outfile_settle(const char *path, const char *tag, const struct outfile_held *, bool no_clobber, struct err *err);
/* Takes the name away again from the output, if it has it: the file is then held as before. */
int outfile_unsettle(const char *path, const char *tag, const struct outfile_held *, struct err *err);
/* Removes what is held for `path` by that tag, if it is there. */
void outfile_held_drop(const char *path, const char *tag);

/* One that several processes write, each at places of its own. `make` makes it, empty and durable, and `open` opens it, for
 * outfile_patch (-ERR_GONE: it is not there any more). It stays when the process ends, until it gets its name. */
int outfile_shared_make(const char *path, bool no_clobber, const char *tag, struct err *err);
int outfile_shared_open(const char *path, const char *tag, struct outfile **ret, struct err *err);
int outfile_shared_sync(struct outfile *, struct err *err);

/* ---- a folder of files that appear together ---- */

/* A folder, made if need be, with another one in it that has the files until all of them are complete. The index is the file
 * that lists them: with no_clobber a folder that has one is an error. */
struct outfile_folder;
int outfile_folder_new(const char *dir, const char *index, bool no_clobber, struct outfile_folder **ret, struct err *err);
/* One of several folders with files for `dir`, named by its tag: .tiles.TAG.part. It takes no lock. Without
 * a tag it is outfile_folder_new. With `joins` it is that of
 * the process which moves the files of all of them (outfile_folder_settle). Else clear and move do nothing, and it stays where
 * outfile_folder_keep was called. */
int outfile_folder_hold(const char *dir, const char *index, bool no_clobber, const char *tag, bool joins,
			struct outfile_folder **ret, struct err *err);
/* Of a file that was published in the inner folder. */
int outfile_folder_held(const struct outfile_folder *, const char *name, struct outfile_held *ret, struct err *err);
/* As outfile_settle, of a file in the folder of that tag; and removes that folder, with all that is in it. */
int outfile_folder_settle(struct outfile_folder *, const char *tag, const char *name, const struct outfile_held *,
			  struct err *err);
void outfile_folder_drop(const char *dir, const char *tag);
bool outfile_folder_has(const struct outfile_folder *, const char *name, const struct outfile_held *); /* it has its name */
/* A file is in the folder of that tag and has not got its name. */
bool outfile_folder_waits(const struct outfile_folder *, const char *tag, const char *name);
/* The outer folder has the bytes of a file that was published in the inner folder. */
bool outfile_folder_same(const struct outfile_folder *, const char *name);
/* A new file in the inner folder; nameless files are made there, too. */
int outfile_folder_file(const struct outfile_folder *, const char *name, struct outfile **ret, struct err *err);
/* Before the first is moved: -ERR_USAGE if names exist and must not be replaced; else the old index is removed, since it will
 * not be true any more. `name` writes the name of file i. */
int outfile_folder_clear(struct outfile_folder *, size_t n, const char *(*name)(void *ctx, size_t i, char *buf), void *ctx,
			 struct err *err);
/* Moves a file that was published in the inner folder to the outer one. */
int outfile_folder_move(struct outfile_folder *, const char *name, struct err *err);
int outfile_folder_sync(struct outfile_folder *, struct err *err);
void outfile_folder_keep(struct outfile_folder *); /* all is in its place: a folder that was made stays */
struct outfile_folder *outfile_folder_free(struct outfile_folder *);
#define OUTFILE_NAME 96 /* room for the name of a file */

#endif
