/* The state of health checks: of this room and its tests. */
#ifndef HEALTH_H
#define HEALTH_H

#include "service.h"

struct check;
struct check_wait;

struct health_state {
	struct check *running;      /* NULL: none is */
	struct check_wait *waiting; /* for the next check */
	struct health last;
	uint64_t last_ns;      /* when that check began; 0: there was none */
	uint64_t last_changes; /* geoids_changes, then */
};

int health_new(struct health_state **ret, struct err *err);
struct health_state *health_free(struct health_state *); /* NULL is fine; returns NULL */

#endif
