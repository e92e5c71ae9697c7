/*
 * Frames: control messages on a Unix stream socket (protocol.md). Used by acutd and by libacut.
 *
 * A frame is a header of 16 bytes and a protobuf Message; together at most 64 KiB. At most one descriptor goes with a
 * frame, sent with its first byte. A frame_conn never reads beyond the end of a frame, so a descriptor always belongs
 * to the frame that is being read. A surplus descriptor is closed, and is a protocol violation, which ends the
 * connection. No call waits. A frame_conn must not be shared by threads.
 */
#ifndef FRAME_H
#define FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "acut.pb-c.h"
#include "ledger.h"

struct err;

/* ---- the header ---- */

#define FRAME_MAGIC 0x4341u /* "AC" */
#define FRAME_VERSION 1u
#define FRAME_HEADER_SIZE 16u
#define FRAME_MAX 65536u /* header and message */
#define FRAME_BODY_MAX (FRAME_MAX - FRAME_HEADER_SIZE)

/* The protocol versions that HELLO negotiates: of the messages, not of the frame. */
#define FRAME_PROTOCOL_MIN 1u
#define FRAME_PROTOCOL_MAX 1u

struct frame_header {
	uint32_t length;     /* bytes of the message after the header */
	uint32_t request_id; /* chosen by the client, > 0; an answer repeats it; 0: not an answer */
	uint8_t descriptors; /* that go with this frame: 0 or 1 */
};

/* Layout: u16 magic, u16 version, u32 length, u32 request id, u8 descriptors, 3 zero bytes. */
void frame_header_put(const struct frame_header *, uint8_t bytes[FRAME_HEADER_SIZE]);
/* -ERR_PROTO (not a frame, a length or count out of bounds, padding not zero); -ERR_VERSION. */
int frame_header_get(const uint8_t bytes[FRAME_HEADER_SIZE], struct frame_header *ret, struct err *err);

/* ---- messages ---- */

/* Whether it has at most `most` fields, including those of nested messages and the numbers of lists. */
bool frame_message_fields(const void *bytes, size_t size, unsigned most);
/* Unpacks `size` bytes. The message may take at most `cap` bytes, which are charged to `ledger` (may be NULL).
 * -ERR_PROTO: malformed, larger than the cap, or a text that is not UTF-8. -ERR_BUSY: the ledger has not enough memory.
 * A body that is unknown to this build gives body_case 0 (answer it with ERR_UNSUPPORTED). */
int frame_message_unpack(const void *bytes, size_t size, size_t cap, struct ledger *ledger, Acut__V1__Message **ret,
			 struct err *err);
/* Only for messages from this room (also from frame_conn_recv). Returns NULL. */
Acut__V1__Message *frame_message_free(Acut__V1__Message *);

/* ---- a connection ---- */

struct frame_limits {
	size_t queue;          /* bytes of queued frames; 0: 256 KiB */
	size_t message;        /* bytes of one unpacked message; 0: 1 MiB */
	unsigned fields;       /* fields of one message, including nested messages; 0: any number */
	struct ledger *ledger; /* charged for buffers and messages (LEDGER_MESSAGE); may be NULL */
};

/* Positive results. After AGAIN and FULL the connection remains usable. */
enum {
	FRAME_E_AGAIN = 1, /* nothing more can be done until poll reports an event */
	FRAME_E_EOF = 2,   /* the other side has closed, between two frames */
	FRAME_E_FULL = 3,  /* the queue is full, or the ledger has not enough memory: nothing was queued */
};

struct frame_conn;

/* Takes over `fd` (a connected stream socket), makes it non-blocking and close-on-exec. On failure the descriptor stays
 * the caller's. `limits` NULL: the defaults. */
int frame_conn_new(int fd, const struct frame_limits *limits, struct frame_conn **ret, struct err *err);
/* Closes the socket and every queued descriptor. NULL is fine; returns NULL. */
struct frame_conn *frame_conn_free(struct frame_conn *);
/* Frees its memory at once: queued frames and a partial frame are dropped, and the connection is shut down. Later calls
 * fail with *why, as after a violation. May be called at any time. */
void frame_conn_cut(struct frame_conn *, const struct err *why);
int frame_conn_fd(const struct frame_conn *);
/* Events to poll for: POLLIN, and POLLOUT while frames are queued. The values are also those of EPOLLIN and EPOLLOUT. */
short frame_conn_events(const struct frame_conn *);
size_t frame_conn_queued(const struct frame_conn *); /* bytes not yet sent */
size_t frame_conn_held(const struct frame_conn *);   /* bytes of its memory, with the queue and a partial frame */

/* Receives the next frame. 0: sets *ret_message (free it with frame_message_free), *ret_id and *ret_fd (-1: none; else
 * the caller's, close-on-exec). FRAME_E_AGAIN, FRAME_E_EOF, or negative: -ERR_PROTO, -ERR_VERSION, -ERR_IO, -ERR_BUSY.
 * After a negative result each further call returns it again, but an Error can still be sent. */
int frame_conn_recv(struct frame_conn *, uint32_t *ret_id, Acut__V1__Message **ret_message, int *ret_fd, struct err *err);

/* Queues a message. `fd` (-1: none) belongs to the connection from now on, whatever the result. 0 or FRAME_E_FULL;
 * -ERR_LIMIT: the message is larger than a frame; -ERR_NOMEM. Call frame_conn_flush next. */
int frame_conn_send(struct frame_conn *, uint32_t id, const Acut__V1__Message *, int fd, struct err *err);
/* The same for a page of a list; `list` is its field in Message. */
struct frame_page;
int frame_conn_send_page(struct frame_conn *, uint32_t id, Acut__V1__Message__BodyCase list, const struct frame_page *, bool more,
			 struct err *err);
/* The same for an Error with the content of *why. */
int frame_conn_send_error(struct frame_conn *, uint32_t id, const struct err *why, struct err *err);
/* Sends what the socket accepts. 0: everything is sent. FRAME_E_AGAIN, FRAME_E_EOF, -ERR_IO. */
int frame_conn_flush(struct frame_conn *, struct err *err);

/* A page of a list, packed row by row. Starts with n = 0. It is smaller than a frame can be, because malloc gets 64 KiB
 * directly from the kernel, which clears them each time. */
enum { FRAME_PAGE_SIZE = 60 << 10, FRAME_PAGE_AROUND = 16 };
struct frame_page {
	size_t n;
	uint8_t rows[FRAME_PAGE_SIZE];
};
/* Adds a row. False: it does not fit, and nothing changed. */
bool frame_page_add(struct frame_page *, const ProtobufCMessage *row);
/* Adds a text of the list itself, as its field of this number (below 100,000). */
bool frame_page_text(struct frame_page *, unsigned field, const char *text);
/* Packs it as a Message of at most n + FRAME_PAGE_AROUND bytes. Returns its size. */
size_t frame_page_pack(const struct frame_page *, Acut__V1__Message__BodyCase list, bool more, uint8_t *ret);

/* Size of `message` as a frame; more than FRAME_MAX cannot be sent (for paging of lists). */
size_t frame_message_size(const Acut__V1__Message *message);

/* ---- errors over the wire ---- */

/* An Error with its texts (bytes that are not UTF-8 become '?'). It must not be copied or moved. */
struct frame_error {
	Acut__V1__Error body;
	char message[512], file[256], field[64], hint[384];
};
void frame_error_from_err(const struct err *, struct frame_error *ret);
/* Fills *err and returns -code. A code that is unknown to this build becomes ERR_INTERNAL. */
int frame_error_to_err(const Acut__V1__Error *, struct err *err);

/* Makes a text valid UTF-8, in place: each invalid byte becomes '?'. Returns text. */
char *frame_text_clean(char *text);

/* A Message with one body: FRAME_MESSAGE(PROBED, probed, &p). */
#define FRAME_MESSAGE(CASE, member, ptr)                                                       \
	(&(Acut__V1__Message){.base = PROTOBUF_C_MESSAGE_INIT(&acut__v1__message__descriptor), \
			      .body_case = ACUT__V1__MESSAGE__BODY_##CASE,                     \
			      .member = (ptr)})

#endif
