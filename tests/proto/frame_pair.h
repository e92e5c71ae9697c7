/* What the tests of frames share: a connection whose other end is a plain socket, and the message that most of them send. */
#ifndef FRAME_PAIR_H
#define FRAME_PAIR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "frame.h"

/* The number of open descriptors of this process. */
unsigned open_descriptors(void);

struct pair {
	struct frame_conn *conn;
	int raw; /* the other end */
};

struct pair pair_new(const struct frame_limits *limits);
void pair_free(struct pair *pair);

/* Sends bytes with `nfd` descriptors (copies of standard error). */
void raw_send(int fd, const void *bytes, size_t n, unsigned nfd);

/* What most tests send. */
const Acut__V1__Message *hello(void);

/* A frame as bytes; returns its size. */
size_t frame_bytes(const Acut__V1__Message *m, uint32_t id, unsigned descriptors, uint8_t *to);

/* Receives hello(). */
void check_hello(struct frame_conn *conn, uint32_t want_id, bool want_fd);

/* Result of frame_conn_recv; a received message is freed. */
int recv_result(struct frame_conn *conn, struct err *err);

#endif
