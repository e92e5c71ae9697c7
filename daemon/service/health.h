/* Of this room only: the state of health checks. */
#ifndef HEALTH_H
#define HEALTH_H

#include "service.h"

struct check;
struct check_wait;

struct health_state {
	struct check *now;       /* is under way; NULL: none is */
	struct check_wait *next; /* wait for another one */
	struct health last;
	uint64_t last_ns; /* when that check began; 0: there was none */
	uint64_t changes; /* of geoid grids, then */
};

int health_new(struct health_state **ret, struct err *err);
struct health_state *health_free(struct health_state *); /* NULL is fine; returns NULL */

#endif
