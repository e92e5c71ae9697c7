/* The daemon and its event loop; shared by main.c and loop.c. */
#ifndef LOOP_H
#define LOOP_H

#include <stdbool.h>
#include <stdint.h>
#include <systemd/sd-event.h>

#include "config.h"
#include "marker.h"
#include "notify.h"

struct err;

#define PASSED_SOCKETS_MAX 16

struct daemon {
	struct config config;
	struct marker store;
	int statefd, cachefd, state_lock, cache_lock, socket_lock;
	int sockets[PASSED_SOCKETS_MAX]; /* listening sockets */
	int nsockets;
	bool bound; /* the socket was made for --socket */
	sd_event *event;
	struct ledger *ledger;
	struct sched *sched;
	struct catalogue *catalogue;
	struct service *service;
	struct server *server;
	sd_event_source *tick, *stop_timeout;
	struct notify notify;
	bool ticking, stopping, over;
	uint64_t tick_usec; /* that the timer was set to */
	uint64_t slow_ns;   /* when a slow round was last logged; 0: never */
	char warning[256];  /* of the start; "": none */
	uint64_t idle_ns;   /* since when it is idle; 0: busy */
	uint64_t heaped;    /* the most small blocks since heap_trim trimmed, in bytes */
};

/* Makes the event loop, with signals and timer. */
int loop_make(struct daemon *, struct err *err);
/* Calls `handler` when `fd` is readable. */
int loop_watch(struct daemon *, int fd, sd_event_io_handler_t handler, struct err *err);
int loop_on_sched(sd_event_source *, int fd, uint32_t events, void *daemon);
int loop_on_catalogue(sd_event_source *, int fd, uint32_t events, void *daemon);

#endif
