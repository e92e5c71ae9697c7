/*
 * Fairness between users in the event loop.
 *
 * The model: sd-event calls ready connections in rotation, and each gets a short time slice (conn.c). That is fair between
 * connections, but a user may have many. So the loop measures the time that it spends for each user. If a user's share of the
 * last WINDOW_NS exceeds SHARE_NS, the priority of this user's connections falls below that of all other sources, listening
 * sockets and streams included, until the share has decreased. A flood of requests therefore delays its own user, and others by
 * one time slice at most. Nothing is refused here, and nobody is disconnected.
 */
#include "clock.h"
#include "server_priv.h"

#define WINDOW_NS 100000000u
#define SHARE_NS 25000000u

/* Users with the same last 8 bits share an account. An account halves when a window is over. */
static struct fair_account *account_of(struct server *s, uint32_t uid, uint64_t now_ns)
{
	struct fair_account *account = &s->fair[uid % (sizeof s->fair / sizeof s->fair[0])];
	uint64_t age_ns = now_ns - account->since_ns;

	if (age_ns >= WINDOW_NS) {
		account->used_ns = age_ns >= 2 * WINDOW_NS ? 0 : account->used_ns / 2;
		account->since_ns = now_ns;
	}
	return account;
}

bool fair_is_behind(struct server *s, uint32_t uid, uint64_t now_ns)
{
	THREAD_LOOP_ONLY();
	return account_of(s, uid, now_ns)->used_ns > SHARE_NS;
}

void fair_charge(struct server *s, uint32_t uid, uint64_t since_ns)
{
	uint64_t now_ns = clock_mono_ns();

	THREAD_LOOP_ONLY();
	account_of(s, uid, now_ns)->used_ns += now_ns - since_ns;
}
