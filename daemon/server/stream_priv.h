/* A stream to a client: what its files share. Loop thread, except where a function says otherwise. */
#ifndef STREAM_PRIV_H
#define STREAM_PRIV_H

#include "run.h"
#include "server_priv.h"
#include "stream.h"

/* A frame that is being written: its pieces, and how far it is. */
struct out_frame {
	bool ready;
	struct stream_piece piece[STREAM_PIECES];
	unsigned n, at; /* pieces; the one being written */
	size_t done;    /* bytes of it */
	uint8_t scratch[STREAM_SCRATCH];
};

/* ---- stream_changes.c: frames of a stream of changes, between head and blocks ---- */

/* A base, then lists of removed regions, through one frame that is filled again and again. */
struct out_changes {
	struct out_frame frame;
	uint64_t n, at; /* regions; of these, in frames so far */
	struct stream_region region[];
};
/* Copies the changes; the first frame is ready to be written. Adds the bytes that it takes of LEDGER_PIPE to *charged. free()
 * ends it before all is sent. */
int out_changes_new(const struct run_changes *, struct ledger *, size_t *charged, struct out_changes **ret, struct err *err);
/* Call when the frame is written. Fills the next one; after the last it frees the changes and returns NULL. */
struct out_changes *out_changes_next(struct out_changes *);

/* ---- stream_out.c ---- */

enum { STREAM_FRAME_HEAD, STREAM_FRAME_CHANGES, STREAM_FRAME_BLOCK, STREAM_FRAME_TAIL, STREAM_FRAMES };

struct stream_out {
	struct run_output output; /* first: stream_of */
	struct stream_out *next;
	struct conn *conn; /* its connection, until the end */
	uint64_t job;
	uint32_t request; /* of the Fetch */
	int fd;           /* the pipe; -1: closed */
	sd_event_source *io;
	struct out_frame frame[STREAM_FRAMES]; /* that of STREAM_FRAME_CHANGES is not used */
	struct out_changes *changes;           /* NULL: there are none, or all are sent */
	char *view, *wkt;                      /* texts that the head points to */
	size_t view_bytes;                     /* charged for them, and for the changes */
	bool system;                           /* the head has the coordinate system whole */
	bool lines;                            /* the head says whether the mesh has lines */
	uint64_t blocks;                       /* number of the next block */
	uint64_t blocked_ns;                   /* since when bytes wait for the reader; 0: none wait */
	bool paused;                           /* a worker has the block (on_spool, on_refill) */
	bool ended;                            /* the run does not call it any more */
	bool gone;                             /* the pipe is closed */

	int spool; /* rest of the block, in a file; -1: none */
	uint64_t spool_size, spool_at;
	uint8_t *buffer; /* RUN_OUTPUT_BUFFER, of spooled bytes */
	size_t buffered, written;
};

static inline struct stream_out *stream_of(struct run_output *output)
{
	return (struct stream_out *)output;
}

void stream_drop(struct stream_out *); /* closes the pipe; frees the stream when the run has ended, too */
void stream_spool_close(struct stream_out *);

/* ---- stream_pipe.c ---- */

void stream_pump(struct stream_out *);                                        /* writes what is ready, until the pipe is full */
void stream_wait_writable(struct stream_out *, bool wait);                    /* whether the loop wakes when the pipe has room */
int stream_on_pipe(sd_event_source *, int fd, uint32_t events, void *stream); /* sd_event_io_handler_t */

/* ---- stream_run.c ---- */

extern const struct run_output_calls stream_run_calls;

#endif
