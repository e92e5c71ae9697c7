/*
 * Notifications for the service manager: ready, status, watchdog, more time. No effect if acutd was not started by one.
 */
#ifndef NOTIFY_H
#define NOTIFY_H

#include <stdbool.h>
#include <stdint.h>

struct service_work;

enum { NOTIFY_TEXT = 160 };

struct notify {
	uint64_t watchdog_usec; /* 0: there is no watchdog */
	uint64_t pinged_ns, status_ns, extended_ns;
	bool serving;
	bool stale; /* the status has changed since it was sent */
	char status[NOTIFY_TEXT];
};

/* Reads the environment. Do not move the struct afterwards. Until notify_ready, each progress_step of this thread extends the
 * time of the start; from then on it feeds the watchdog. */
void notify_start(struct notify *);
void notify_ready(struct notify *);
/* The stop takes at most `usec`. */
void notify_stopping(struct notify *, uint64_t usec);
/* After each round of the loop: feeds the watchdog, and sends the status if it has changed, at most once a second. */
void notify_round(struct notify *, const struct service_work *);
/* Microseconds within which notify_round must be called; UINT64_MAX: any time. */
uint64_t notify_wait(const struct notify *);

#endif
