/*
 * What systemd is told: that acutd serves, what it does, that it is alive, and that it needs longer. Nothing of it where acutd
 * was not started by a service manager.
 */
#ifndef NOTIFY_H
#define NOTIFY_H

#include <stdbool.h>
#include <stdint.h>

struct service_work;

enum { NOTIFY_TEXT = 160 };

struct notify {
	uint64_t watchdog_usec; /* 0: nobody watches */
	uint64_t pinged_ns, told_ns, extended_ns;
	bool serving;
	bool behind; /* the text that was told last is not true any more */
	char told[NOTIFY_TEXT];
};

/* From the environment; `n` stays where it is. Until notify_ready, each progress_step of this thread gives the start more
 * time; from then on it is a sign of life. */
void notify_start(struct notify *);
void notify_ready(struct notify *);
/* The stop takes `usec` at most. */
void notify_stopping(struct notify *, uint64_t usec);
/* After each round of the loop: the sign of life, and what goes on, where that has changed and a second has passed. */
void notify_round(struct notify *, const struct service_work *);
/* Within so many microseconds the loop has to come round once; UINT64_MAX: it need not. */
uint64_t notify_wait(const struct notify *);

#endif
