/*
 * Whose turn it is in the loop.
 *
 * The model: a connection that is ready has a short turn (conn.c), and those that are ready take turns. That is fair
 * between connections, and a user may have many; so what the loop does for each user is timed. Who has had more than a
 * quarter of it of late comes after everybody else, listening sockets and streams included, until that is over: a flood delays
 * its own user's requests, and those of others by one turn. Nothing is refused here, and nobody is cut off.
 */
#include "clock.h"
#include "server_priv.h"

#define WINDOW_NS 100000000u /* of late */
#define SHARE_NS 25000000u   /* of it */

/* Users whose numbers agree in the last bits have one account. */
static struct turn *account(struct server *s, uint32_t uid, uint64_t now)
{
	struct turn *t = &s->turns[uid % (sizeof s->turns / sizeof s->turns[0])];
	uint64_t past = now - t->since_ns;

	if (past >= WINDOW_NS) {
		t->used_ns = past >= 2 * WINDOW_NS ? 0 : t->used_ns / 2;
		t->since_ns = now;
	}
	return t;
}

bool turn_later(struct server *s, uint32_t uid, uint64_t now)
{
	return account(s, uid, now)->used_ns > SHARE_NS;
}

uint64_t turn_used(struct server *s, uint32_t uid, uint64_t since)
{
	uint64_t now = clock_mono_ns();

	account(s, uid, now)->used_ns += now - since;
	return now;
}
