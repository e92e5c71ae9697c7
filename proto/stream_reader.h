/* A reader of the mesh stream, shared by its frames (stream_reader.c) and the payloads of head, changes and tail
 * (stream_parts.c). */
#ifndef STREAM_READER_H
#define STREAM_READER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "cursor.h"
#include "err.h"
#include "stream.h"
#include "stream_bytes.h"

struct stream_reader {
	uint64_t offset; /* bytes fed */
	uint8_t header[STREAM_HEADER_SIZE];
	uint8_t *memory; /* free bytes, then the payload */
	uint8_t *payload;
	size_t room;   /* bytes at payload */
	size_t length; /* of the payload, once the header is complete */
	size_t got;    /* bytes of the current frame */
	enum stream_type type;
	uint64_t checksum;

	bool has_head, has_base, any_block, done, failed;
	struct err why; /* if failed */
	struct stream_head head;
	char *view, *wkt; /* of the head */
	struct stream_base base;
	const struct stream_region *gone; /* of the current frame */
	size_t ngone;
	uint64_t regions, region_triangles; /* invalid regions that came */
	struct stream_block block;
	uint64_t *foreign; /* of the block, if its place is `local` */
	size_t foreign_room;
	struct stream_tail tail;
	uint64_t blocks, vertices, triangles, last_index;
	int32_t box[6]; /* of the vertices so far */
};

/* Each reads the payload of the current frame. -ERR_PROTO: it is malformed, or contradicts what came before. */
int stream_read_head(struct stream_reader *, struct err *err);
int stream_read_base(struct stream_reader *, struct err *err);
int stream_read_gone(struct stream_reader *, struct err *err);
int stream_read_tail(struct stream_reader *, struct err *err);
/* The payload must end here, except for padding. -ERR_PROTO: it does not; `what` names it in the message. */
int stream_read_end(struct cursor *, const char *what, struct err *err);
/* Before the first block, or before the tail of a stream without blocks. */
int stream_check_gone(const struct stream_reader *, struct err *err);

#endif
