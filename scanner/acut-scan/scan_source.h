/*
 * Sources: a push converts spools to sources, each the bytes of a LAS file or of a text, by passes over the spool. The first pass
 * finds points and extent, the second one the hash of the bytes that the last one writes.
 */
#ifndef SCAN_SOURCE_H
#define SCAN_SOURCE_H

#include "decoder.h"
#include "digest.h"
#include "err.h"
#include "ground.h"
#include "las.h"
#include "profile.h"
#include "replay.h"
#include "scan.h"
#include "spool.h"

struct scan_spool {
	const char *file; /* as it was named */
	struct spool_head head;
	char id[33];
	struct profile profile;
	const struct decoder *decoder;
	/* of the first pass; later passes read no further */
	bool passed;
	uint64_t records, damaged; /* damaged: bytes in its middle that are no records */
	struct spool_tail tail;
	struct replay_counts counts;
};
/* Reads its head, and its profile. */
int scan_spool_open(struct program *, const char *file, struct scan_spool *ret, struct err *);
void scan_spool_clear(struct scan_spool *);
/* A pass over the records. 0, what a sink answered, or -ERR. `stop` is asked now and then, NULL: whether a
 * signal asks for an end: -ERR_CANCELLED. */
int scan_spool_pass(struct scan_spool *, const struct replay_sinks *, bool (*stop)(void *ctx), struct err *);

enum scan_kind { SCAN_GROUND, SCAN_LAS_FILE, SCAN_TEXT_LINES };
struct scan_source {
	struct scan_spool *spool;
	struct pose_track *track; /* GROUND: borrowed */
	enum scan_kind kind;
	uint64_t file;              /* LAS_FILE: its number in the spool */
	char name[256];             /* that the dataset keeps */
	char path[64];              /* identity: "spool:ID", "spool:ID/2" */
	char hash[DIGEST_HEX_SIZE]; /* of its bytes */
	uint64_t size;
	uint64_t points; /* 0 of LAS_FILE: not counted */
	struct ground_counts ground;
	struct las_params las;
	uint8_t head[LAS_HEAD_MAX];
	size_t head_size;
};
/* The sources of a spool, one for each pass that it takes: a malloced array. -ERR_INPUT: it has no points. */
int scan_source_find(struct program *, struct scan_spool *, struct pose_track *, struct scan_source **ret, size_t *ret_n,
		     struct err *);
/* Its bytes into a sink, in order; the sink's non-zero answer ends it. `stop` NULL: as of a pass. */
int scan_source_write(const struct scan_source *, int (*put)(void *ctx, const void *, size_t), bool (*stop)(void *ctx), void *ctx,
		      struct err *);

/* scan_save.c: into a file that is not there yet, or "-" */
int scan_source_save(const struct scan_source *, const char *name, struct err *);

/* ---- scan_feed.c: the bytes of a source into the pipe that the daemon made, from a thread of its own ---- */

struct scan_feed;
/* Takes `fd`. Of points that take the track it writes the head at once, and the rest after scan_feed_go. */
int scan_feed_new(const struct scan_source *, int fd, struct scan_feed **ret, struct err *);
void scan_feed_go(struct scan_feed *);
/* Waits for its end; if it was not read to its end, it is stopped. 0, also if the daemon closed its side (its answer has the
 * reason); -ERR: the spool or the poses could not be read. NULL is fine. */
int scan_feed_free(struct scan_feed *, bool stop, struct err *);

/* ---- scan_push_report.c ---- */

enum scan_state { SCAN_STAGED, SCAN_KNOWN, SCAN_ADOPTED, SCAN_REFUSED, SCAN_WRITTEN };
struct scan_result {
	const struct scan_source *source;
	enum scan_state state;
	uint64_t points, moved;
	uint32_t replaced;
	char *warning;
	uint64_t generation; /* that has it; 0: none */
	bool first;          /* of its spool */
	struct err err;      /* of REFUSED */
};
void scan_push_print(struct program *, const struct scan_result *);
/* At the end: the dataset. */
void scan_push_print_all(struct program *, uint64_t generation, uint64_t points, double seconds);
/* The properties of the poses, before anything is sent. */
void scan_push_print_poses(struct program *, const struct pose_track *);

#endif
