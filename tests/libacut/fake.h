/* A daemon of a few lines, in a thread, for the tests of libacut. */
#ifndef FAKE_H
#define FAKE_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>

#include "acut.h"
#include "err.h"
#include "frame.h"
#include "stream.h"

struct fake {
	struct frame_conn *conn;
	pthread_t thread;
	void (*serve)(struct fake *);
	void *ctx;
};

/* Starts the thread; *ret_fd is the client's socket. `serve` is to answer the greeting first. */
struct fake *fake_start(void (*serve)(struct fake *), void *ctx, int *ret_fd);
void fake_stop(struct fake *); /* waits for the thread; close the client first */

/* For `serve`. False: the client is gone. *ret is the server's to free. */
bool fake_recv(struct fake *, uint32_t *ret_id, Acut__V1__Message **ret, int *ret_fd);
void fake_send(struct fake *, uint32_t id, const Acut__V1__Message *, int fd);
void fake_close(struct fake *);

/* A pipe's ends; the reading one is to be sent. Writing waits. */
void fake_pipe(int fds[2]);
/* All pieces. False: nobody reads. */
bool fake_write(int fd, const struct stream_piece *, unsigned n);

/* A connection to a fake that was greeted. */
struct acut *fake_attach(struct fake **ret_fake, void (*serve)(struct fake *), void *ctx, const struct acut_options *options);

/* Answers everything until the client is gone; ctx NULL, or a uint64_t that gets the number of an aborted
 * push. */
void fake_serve_all(struct fake *);
void fake_answer_hello(struct fake *, uint32_t id);
void fake_answer_error(struct fake *, uint32_t id, const char *code, const char *message);
void fake_answer_job(struct fake *, uint32_t id, uint64_t job, const char *state, bool final);

/* From now on no time passes for the client, until it is let go on: however slow the fake is, it is not too late. */
void fake_stop_time(void);
void fake_let_time(void);
/* Until it is true, or for ever as far as a test goes. */
void fake_wait(const atomic_bool *);

unsigned fake_open_descriptors(void);

#endif
