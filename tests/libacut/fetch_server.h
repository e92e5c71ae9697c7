/*
 * A server that streams one small mesh, well or badly, and a receiver that checks what comes. The mesh has four points and two
 * blocks of one triangle each; the second block uses two vertices of the first again.
 */
#ifndef FETCH_SERVER_H
#define FETCH_SERVER_H

#include <stdatomic.h>

#include "fake.h"

/* What the server does. */
enum how {
	GOOD,
	BAD_DIGEST,
	BAD_VERTEX_DIGEST,
	ERROR_TAIL,
	ERROR_SOCKET,
	CUT,     /* ends the stream after the first block */
	DEATH,   /* and closes the connection, too */
	STALL,   /* sends nothing more */
	NO_PIPE, /* answers without a descriptor */
	REFUSED,
	LATE_MESH, /* waits until the client has heard of progress */
	GIVEN_UP,  /* waits until nobody reads */
	OTHER_STREAM,
	CHANGES,       /* this and the following: changes, with one removed region */
	CHANGES_WRONG, /* the digest of the region is wrong */
	CHANGES_OLDER, /* of another generation */
	CHANGES_CUT    /* the region is missing */
};

/* Set by the client: it got a message of progress; it has given up. */
extern atomic_bool progressed, given_up;

struct server {
	enum how how;
	bool reader_gone;     /* the client closed the pipe before the end */
	uint64_t from, since; /* of the last Fetch */
	char wanted[40];      /* stream id of the last Fetch */
};

void serve(struct fake *); /* the context is a struct server */

/* The context of the got_ functions: counts and values of what came. */
struct got {
	unsigned heads, blocks, tails, progress, stop_at, bases, gone;
	struct acut_mesh_head head;
	char coordinate[48], stream_id[40];
	double x;
};

int got_head(void *ctx, const struct acut_mesh_head *head);
int got_block(void *ctx, const struct acut_mesh_block *b);
int got_tail(void *ctx, const struct acut_mesh_tail *tail);
void got_progress(void *ctx, const struct acut_progress *p);

#endif
