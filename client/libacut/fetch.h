/* Inside libacut: a fetch, between the file that reads the stream and those that begin one in other ways. */
#ifndef FETCH_H
#define FETCH_H

#include "call.h"
#include "cursor.h"
#include "feed.h"

struct fetch {
	struct acut *acut;
	uint64_t job;
	bool torn; /* check is not between two blocks */
	bool continued;
	bool other;   /* the head is not of the stream that is to go on */
	bool unasked; /* nor of the kind that was asked for */
	bool stepped; /* acut_fetch_step: stop after each frame */
	bool given;   /* a frame was whole with the last read */
	bool over;    /* no more frames come */
	unsigned reads;
	struct stream_reader_state from;
	struct digest id;    /* of the stream; when continued, that of the state */
	int64_t k[3];        /* of the state */
	struct cursor state; /* the rest of it: check's */
	struct feed feed;
	uint64_t since; /* 0: the whole mesh */
	const struct acut_changes_sink *changes;
	uint32_t request;
	int fd;
	struct stream_reader *reader;
};

/* After call_begin; the connection has it from now on. NULL: a->err. */
struct fetch *fetch_new(struct acut *, const struct acut_mesh_sink *);
/* Asks, and has the pipe. */
int fetch_begin(struct fetch *);
/* Reads to the end: 0. A stepped fetch reads to the next frame: 1. */
int fetch_stream(struct fetch *);
/* Closes the pipe, keeps what acut_fetch_state needs. Returns r. */
int fetch_end(struct fetch *, int r);
/* All three. */
int fetch_run(struct fetch *);
/* From acut_fetch_state; borrowed until the head has come. -ERR_CORRUPT: the bytes are damaged; -ERR_VERSION. */
int fetch_read_state(struct fetch *, const uint8_t *bytes, size_t size, struct err *);

#endif
