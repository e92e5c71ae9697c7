/* The daemon as one thing, and its loop; shared by main.c and loop.c. */
#ifndef LOOP_H
#define LOOP_H

#include <stdbool.h>
#include <stdint.h>
#include <systemd/sd-event.h>

#include "config.h"
#include "marker.h"
#include "notify.h"

struct err;

#define HAND_OVER_MAX 16

struct daemon {
	struct config config;
	struct marker store;
	int statefd, cachefd, state_lock, cache_lock, socket_lock;
	int sockets[HAND_OVER_MAX]; /* that listen */
	int nsockets;
	bool bound; /* the socket is ours by --socket */
	sd_event *event;
	struct ledger *ledger;
	struct sched *sched;
	struct catalogue *catalogue;
	struct service *service;
	struct server *server;
	sd_event_source *tick, *last;
	struct notify notify;
	bool ticking, stopping, over;
	uint64_t tick_usec; /* that the tick was set to */
	uint64_t slow_ns;   /* when a slow round was told last, 0: never */
	char warning[256];  /* that the start found; "": none */
	uint64_t idle_ns;   /* since when, 0: busy */
	uint64_t heaped;    /* the most that heap_trim has seen since it trimmed */
};

/* The event loop with its signals and its tick. */
int loop_make(struct daemon *, struct err *err);
/* `handler` as soon as `fd` is readable. */
int loop_watch(struct daemon *, int fd, sd_event_io_handler_t handler, struct err *err);
int loop_on_sched(sd_event_source *, int fd, uint32_t events, void *daemon);
int loop_on_catalogue(sd_event_source *, int fd, uint32_t events, void *daemon);

#endif
